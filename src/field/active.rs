//! Which bricks of the density are computed.
//!
//! Only those near the surface matter, and those are near particles whose neighbourhood is not filled. Every brick that
//! such a particle reaches is computed, but for those that lie deep: none of them within a spacing, and filled. Those that
//! only other particles reach are filled: inside, and without values. Where a computed value beside such a brick says
//! otherwise, that one is computed too, until nothing contradicts: the surface is closed, whatever the guess was worth.

use super::{DensityParams, blob::Blobs, cloud::Cloud, density::Shell};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, FACES, SparseGrid, offset},
    math::Vec3,
    par,
};

/// How near to a brick a particle with an open neighbourhood makes it the surface's [spacings].
const NEAR: f32 = 1.0;

/// The fraction of the lattice's particles that fill a brick and what is [`NEAR`].
const FILLED: f32 = 0.6;

/// The bricks of a density, computed or filled; all others are empty.
pub(super) struct Active {
    pub(super) computed: Bricks,
    /// Bricks that are inside, and not computed.
    pub(super) filled: Bricks,
}

impl Active {
    pub(super) fn new(cloud: &Cloud, blobs: &Blobs, shells: &[Shell], params: &DensityParams) -> Self {
        let voxel = params.voxel * params.spacing;
        let open = reached(cloud, blobs, voxel, |place| shells[place].open);
        let mut wanted = vec![true; open.len()];
        if !params.whole {
            par::fill(&mut wanted, |brick| {
                !lies_deep(cloud, shells, open.coords()[brick], voxel, params.spacing)
            });
        }
        let computed = open.coords().iter().zip(&wanted).filter(|&(_, &wanted)| wanted).map(|(&c, _)| c);
        let computed = Bricks::new(computed.collect());
        let closed = reached(cloud, blobs, voxel, |place| !shells[place].open);
        let filled = open.coords().iter().chain(closed.coords()).copied();
        let filled = Bricks::new(filled.filter(|&coord| computed.find(coord).is_none()).collect());
        Self { computed, filled }
    }

    /// Filled bricks that values contradict: a node beside one is outside.
    pub(super) fn contradicted(&self, grid: &SparseGrid, threshold: f32) -> Vec<[i32; 3]> {
        par::map_chunks(grid.bricks.len(), 64, |range| {
            let mut found = Vec::new();
            for brick in range {
                let coord = grid.bricks.coords()[brick];
                for (face, step) in FACES.iter().enumerate() {
                    let beside = std::array::from_fn(|axis| coord[axis] + step[axis]);
                    if self.filled.find(beside).is_some() && opens(grid.brick(brick), face, threshold) {
                        found.push(beside);
                    }
                }
            }
            found
        })
        .concat()
    }

    /// This with filled bricks computed instead.
    pub(super) fn grown(&self, contradicted: Vec<[i32; 3]>) -> Self {
        let computed = Bricks::new(self.computed.coords().iter().copied().chain(contradicted).collect());
        let filled = self.filled.coords().iter().copied().filter(|&coord| computed.find(coord).is_none());
        let filled = Bricks::new(filled.collect());
        Self { computed, filled }
    }
}

/// Copies the bricks that both have; returns which those are.
pub(super) fn keep(to: &mut SparseGrid, from: &SparseGrid) -> Vec<bool> {
    let there: Vec<Option<usize>> = to.bricks.coords().iter().map(|&coord| from.bricks.find(coord)).collect();
    par::for_chunks(&mut to.values, BRICK_NODES, |start, values| {
        if let Some(brick) = there[start / BRICK_NODES] {
            values.copy_from_slice(from.brick(brick));
        }
    });
    there.iter().map(|there| there.is_some()).collect()
}

/// The box of a brick's nodes and what is within `reach` of it [m].
pub(super) fn around(coord: [i32; 3], voxel: f32, reach: f32) -> (Vec3, Vec3) {
    let node =
        |axis: usize, step: usize| (f64::from(coord[axis]) * BRICK as f64 + step as f64) * f64::from(voxel);
    let low = Vec3::from_fn(|axis, _| (node(axis, 0) - f64::from(reach)).next_down() as f32);
    let high = Vec3::from_fn(|axis, _| (node(axis, BRICK - 1) + f64::from(reach)).next_up() as f32);
    (low.map(f32::next_down), high.map(f32::next_up))
}

/// Every brick with a node in the box of the kernel of a particle that is `meant`.
fn reached(cloud: &Cloud, blobs: &Blobs, voxel: f32, meant: impl Fn(usize) -> bool + Sync) -> Bricks {
    let coords = par::map_chunks(cloud.len(), par::CHUNK, |range| {
        let mut reached = Vec::new();
        let mut last = None;
        for place in range.filter(|&place| meant(place)) {
            let blob = blobs.at(cloud, place);
            let brick = |axis: usize, side: f64, round: fn(f64) -> f64| {
                let at = f64::from(blob.center[axis]) + side * f64::from(blob.extents[axis]);
                (round(at / f64::from(voxel)) as i32).div_euclid(BRICK as i32)
            };
            let low = [0, 1, 2].map(|axis| brick(axis, -1.0, f64::ceil));
            let high = [0, 1, 2].map(|axis| brick(axis, 1.0, f64::floor));
            // Neighbours mostly reach the same bricks.
            if last.replace((low, high)) == Some((low, high)) {
                continue;
            }
            for z in low[2]..=high[2] {
                for y in low[1]..=high[1] {
                    reached.extend((low[0]..=high[0]).map(|x| [x, y, z]));
                }
            }
        }
        reached.sort_unstable();
        reached.dedup();
        reached
    });
    Bricks::new(coords.concat())
}

/// Whether a brick is surely inside.
fn lies_deep(cloud: &Cloud, shells: &[Shell], coord: [i32; 3], voxel: f32, spacing: f32) -> bool {
    let (low, high) = around(coord, voxel, NEAR * spacing);
    let (mut inside, mut open) = (0, false);
    cloud.cells.for_each_stretch(low, high, |places| {
        for place in places {
            let x = cloud.at(place);
            if within(&x, &low, &high) {
                inside += 1;
                open |= shells[place].open;
            }
        }
    });
    let lattice = ((high - low) / spacing).product();
    !open && inside as f32 >= FILLED * lattice
}

/// Whether `x` is in the box.
fn within(x: &Vec3, low: &Vec3, high: &Vec3) -> bool {
    (0..3).all(|axis| low[axis] <= x[axis] && x[axis] <= high[axis])
}

/// Whether the nodes on a face of a brick are not all inside.
fn opens(values: &[f32], face: usize, threshold: f32) -> bool {
    let axis = FACES[face].iter().position(|&d| d != 0).expect("a face has an axis");
    let side = if face % 2 == 0 { 0 } else { BRICK - 1 };
    (0..BRICK * BRICK).any(|place| {
        let mut node = [place % BRICK, place / BRICK, 0];
        node.swap(2, axis);
        node[axis] = side;
        // A NaN is not inside.
        !(values[offset(node)] >= threshold)
    })
}
