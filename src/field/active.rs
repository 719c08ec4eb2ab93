//! Which bricks of the density are computed.
//!
//! Only those near the surface matter, and those are near particles whose neighbourhood is not filled. Every brick that
//! such a particle reaches is computed, but for those that lie deep: none of them within a spacing, and filled. Around the
//! computed bricks, those that some particle reaches are inside and hold 1. Where a computed value says
//! otherwise beside such a brick, that one is computed too, until nothing contradicts: the surface is closed, whatever
//! the guess was worth.

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

/// The bricks of a density, computed or filled.
pub(super) struct Active {
    pub(super) bricks: Bricks,
    /// Which of them are computed; the others are inside.
    pub(super) computed: Vec<bool>,
}

impl Active {
    pub(super) fn new(cloud: &Cloud, blobs: &Blobs, shells: &[Shell], params: &DensityParams) -> Self {
        let voxel = params.voxel * params.spacing;
        let reached = reached(cloud, blobs, shells, voxel);
        let mut wanted = vec![true; reached.len()];
        if !params.whole {
            par::fill(&mut wanted, |brick| {
                !lies_deep(cloud, shells, reached.coords()[brick], voxel, params.spacing)
            });
        }
        let coords = reached.coords().iter().zip(&wanted).filter(|&(_, &wanted)| wanted).map(|(&c, _)| c);
        Self::around(Bricks::new(coords.collect()), cloud, blobs, voxel)
    }

    /// `computed` and the filled bricks beside them.
    fn around(computed: Bricks, cloud: &Cloud, blobs: &Blobs, voxel: f32) -> Self {
        let beside = par::map_chunks(computed.len(), 64, |range| {
            let mut beside = Vec::new();
            for &[x, y, z] in &computed.coords()[range] {
                for place in 0..27 {
                    let other = [x + place % 3 - 1, y + place / 3 % 3 - 1, z + place / 9 - 1];
                    if computed.find(other).is_none() {
                        beside.push(other);
                    }
                }
            }
            beside.sort_unstable();
            beside.dedup();
            beside
        });
        let beside = Bricks::new(beside.concat());
        let mut filled = vec![false; beside.len()];
        par::fill(&mut filled, |brick| is_reached(cloud, beside.coords()[brick], voxel, blobs.reach()));
        let filled = beside.coords().iter().zip(&filled).filter(|&(_, &filled)| filled).map(|(&c, _)| c);
        let bricks = Bricks::new(computed.coords().iter().copied().chain(filled).collect());
        let computed = bricks.coords().iter().map(|&coord| computed.find(coord).is_some()).collect();
        Self { bricks, computed }
    }

    /// This with the filled bricks that computed values contradict computed as well; `None` if nothing does.
    pub(super) fn grown(
        &self,
        grid: &SparseGrid,
        threshold: f32,
        cloud: &Cloud,
        blobs: &Blobs,
    ) -> Option<Self> {
        let contradicted = par::map_chunks(self.bricks.len(), 64, |range| {
            let mut found = Vec::new();
            for brick in range.filter(|&brick| self.computed[brick]) {
                let around = self.bricks.around(self.bricks.coords()[brick]);
                for (face, beside) in around.into_iter().enumerate() {
                    let filled = beside.filter(|&beside| !self.computed[beside]);
                    if let Some(filled) = filled.filter(|_| opens(grid.brick(brick), face, threshold)) {
                        found.push(self.bricks.coords()[filled]);
                    }
                }
            }
            found
        })
        .concat();
        if contradicted.is_empty() {
            return None;
        }
        let computed = self.bricks.coords().iter().zip(&self.computed).filter(|&(_, &c)| c).map(|(&c, _)| c);
        let computed = Bricks::new(computed.chain(contradicted).collect());
        Some(Self::around(computed, cloud, blobs, grid.voxel))
    }
}

/// Copies the bricks that both have.
pub(super) fn keep(to: &mut SparseGrid, from: &SparseGrid) {
    let bricks = &to.bricks;
    par::for_chunks(&mut to.values, BRICK_NODES, |start, values| {
        if let Some(brick) = from.bricks.find(bricks.coords()[start / BRICK_NODES]) {
            values.copy_from_slice(from.brick(brick));
        }
    });
}

/// The box of a brick's nodes and what is within `reach` of it [m].
pub(super) fn around(coord: [i32; 3], voxel: f32, reach: f32) -> (Vec3, Vec3) {
    let node =
        |axis: usize, step: usize| (f64::from(coord[axis]) * BRICK as f64 + step as f64) * f64::from(voxel);
    let low = Vec3::from_fn(|axis, _| (node(axis, 0) - f64::from(reach)).next_down() as f32);
    let high = Vec3::from_fn(|axis, _| (node(axis, BRICK - 1) + f64::from(reach)).next_up() as f32);
    (low.map(f32::next_down), high.map(f32::next_up))
}

/// Every brick with a node in the box of an open particle's kernel.
fn reached(cloud: &Cloud, blobs: &Blobs, shells: &[Shell], voxel: f32) -> Bricks {
    let coords = par::map_chunks(cloud.len(), par::CHUNK, |range| {
        let mut reached = Vec::new();
        let mut last = None;
        for place in range.filter(|&place| shells[place].open) {
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

/// Whether a particle is within `reach` of a brick's box of nodes.
fn is_reached(cloud: &Cloud, coord: [i32; 3], voxel: f32, reach: f32) -> bool {
    let (low, high) = around(coord, voxel, reach);
    let mut found = false;
    cloud.cells.for_each_stretch(low, high, |mut places| {
        found = found || places.any(|place| within(&cloud.at(place), &low, &high));
    });
    found
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
