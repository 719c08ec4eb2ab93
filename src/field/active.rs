//! Selection of the bricks of the density that are computed.
//!
//! *Method*: the density is first sampled everywhere on coarse nodes, at most half a kernel's support apart.
//! A brick whose coarse nodes are all deep inside is filled: it stays without values. One whose coarse nodes
//! are all faint is empty. The others are computed. If a value next to a brick that is not computed
//! contradicts its classification, that brick is computed too, until nothing contradicts. The surface is
//! therefore closed, however good the classification was.
//!
//! Within a brick of isotropic kernels, rows of nodes between coarse nodes that are all deep or all faint are
//! interpolated.
//!
//! Limits: bubbles and drops that affect no coarse node are not found. A drop of one particle is found, with
//! a density of 0.36 or more. A gap between particles that leaves every coarse node around it deep inside is
//! no bubble.

use super::{
    DensityParams, fill::compute, particle_kernel::ParticleKernels, sorted_particles::SortedParticles,
};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, NodeMask, SparseGrid, bricks_in_boxes, mask_of, node_of, offset},
    par,
};

/// A node is deep inside from this fraction between the surface's density and that of the filled liquid, 1.
const DEEP_FRACTION: f32 = 0.5;

/// A node is faint below this fraction of the surface's density, less than the 0.36 of a drop of one
/// particle. If it is smaller, more bricks are computed in vain.
const FAINT_FRACTION: f32 = 0.5;

/// Bricks of a task.
const BRICKS_PER_TASK: usize = 16;

/// The bricks of a density, computed or filled; all others are empty.
pub(super) struct Active {
    pub(super) computed: Bricks,
    /// Bricks that are inside, and not computed.
    pub(super) filled: Bricks,
}

/// Size of the grids of a surface, estimated on coarse nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct SurfaceSize {
    /// Bricks of the coarse nodes.
    pub(crate) coarse_bricks: usize,
    /// Bricks of the density that are computed, but for those opened later.
    pub(crate) bricks: usize,
    /// Edges of the grid that cross the surface.
    pub(crate) vertices: usize,
    /// Bricks within the band of the distance.
    pub(crate) distance_bricks: usize,
}

/// The density of isotropic kernels on coarse nodes.
pub(super) struct Coarse {
    grid: SparseGrid,
    /// Voxels between its nodes.
    step: usize,
    /// The density from which nodes are deep inside …
    deep: f32,
    /// … and the density below which they are faint.
    faint: f32,
}

impl Coarse {
    /// Samples the density on coarse nodes; `None` if these would be the nodes themselves. `threshold` is
    /// that of isotropic kernels.
    pub(super) fn new(
        particles: &SortedParticles,
        isotropic_kernels: &ParticleKernels,
        threshold: f32,
        params: &DensityParams,
    ) -> Option<Self> {
        let step = coarse_step(params);
        let voxel = params.voxel * params.spacing * step as f32;
        (step > 1).then(|| {
            let bricks = bricks_in_reach(particles, isotropic_kernels, voxel);
            let mut grid = SparseGrid::new(voxel, bricks.clone(), 0.0);
            compute(&mut grid, &bricks, particles, isotropic_kernels, &|_, _| u64::MAX);
            let (deep, faint) = (threshold + DEEP_FRACTION * (1.0 - threshold), FAINT_FRACTION * threshold);
            Self { grid, step, deep, faint }
        })
    }

    /// The bricks near the surface, and those inside. Lone particles that are `small` may affect no coarse node: the
    /// bricks around them are computed unless they are inside.
    pub(super) fn active(&self, particles: &SortedParticles, small: &[usize]) -> Active {
        let Self { grid, step, .. } = self;
        let (mut computed, mut filled) = (Vec::new(), Vec::new());
        for (some_computed, some_filled) in par::map_chunks(grid.bricks.len(), BRICKS_PER_TASK, |range| {
            let (mut computed, mut filled) = (Vec::new(), Vec::new());
            for brick in range {
                let coord = grid.bricks.coords()[brick];
                let nodes = with_upper_layer(grid, coord);
                for part in 0..step.pow(3) {
                    let part = [part % step, part / step % step, part / (step * step)];
                    let (smallest, largest) = extremes(&nodes, part, BRICK / step);
                    let fine = std::array::from_fn(|axis| coord[axis] * *step as i32 + part[axis] as i32);
                    if smallest >= self.deep {
                        filled.push(fine);
                    } else if largest >= self.faint {
                        computed.push(fine);
                    }
                }
            }
            (computed, filled)
        }) {
            computed.extend(some_computed);
            filled.extend(some_filled);
        }
        let filled = Bricks::new(filled);
        let voxel = f64::from(grid.voxel) / *step as f64;
        let boxes = small.iter().map(|&place| {
            let node = |axis: usize| (f64::from(particles.at(place)[axis]) / voxel).floor() as i32;
            [0, 1].map(|side| [0, 1, 2].map(|axis| (node(axis) + side).div_euclid(BRICK as i32)))
        });
        let around = bricks_in_boxes(boxes.collect()).into_iter();
        computed.extend(around.filter(|&coord| filled.find(coord).is_none()));
        Active { computed: Bricks::new(computed), filled }
    }

    /// The size of the surface's grids, with a distance in a band of so many voxels.
    ///
    /// A surface of area A crosses 1.5 A/h² edges of a grid of cells h, hence the grid's own edges are as many as
    /// the coarse ones times the square of the step. Drops between the coarse nodes are not seen: of lone particles
    /// at half a kernel's support a fifth.
    pub(super) fn surface_size(&self, active: &Active, threshold: f32, band: f32) -> SurfaceSize {
        let Self { grid, step, .. } = self;
        let mut size = SurfaceSize {
            coarse_bricks: grid.bricks.len(),
            bricks: active.computed.len(),
            ..SurfaceSize::default()
        };
        let mut in_band = Vec::new();
        for (crossings, bricks) in par::map_chunks(grid.bricks.len(), BRICKS_PER_TASK, |range| {
            let (mut crossings, mut boxes) = (0, Vec::new());
            for &coord in &grid.bricks.coords()[range] {
                let nodes = with_upper_layer(grid, coord);
                let is_inside = |node: [usize; 3]| {
                    nodes[node[0] + WITH_UPPER_LAYER * (node[1] + WITH_UPPER_LAYER * node[2])] >= threshold
                };
                for place in 0..BRICK_NODES {
                    let node = node_of([0; 3], place).map(|i| i as usize);
                    let next = |axis: usize| std::array::from_fn(|d| node[d] + usize::from(d == axis));
                    let crossed = (0..3).filter(|&axis| is_inside(node) != is_inside(next(axis))).count();
                    if crossed > 0 {
                        crossings += crossed;
                        boxes.push(bricks_of_cell(coord, node, *step, band));
                    }
                }
            }
            (crossings, bricks_in_boxes(boxes))
        }) {
            size.vertices += crossings * step * step;
            in_band.extend(bricks);
        }
        size.distance_bricks = Bricks::new(in_band).len();
        size
    }

    /// Interpolates the rows of a brick that are deep or faint linearly between coarse nodes. Returns the
    /// other rows, bit y + 8 z.
    pub(super) fn interpolate_rows(&self, coord: [i32; 3], values: &mut [f32; BRICK_NODES]) -> u64 {
        let cells = BRICK / self.step;
        let nodes = self.nodes_of(coord);
        let at = |x: usize, y: usize, z: usize| nodes[x + WITH_UPPER_LAYER * (y + WITH_UPPER_LAYER * z)];
        let mut remaining = 0;
        for cell in 0..cells * cells {
            let [cy, cz] = [cell % cells, cell / cells];
            let is_settled = (0..cells).all(|cx| {
                let corners: [f32; 8] =
                    std::array::from_fn(|c| at(cx + (c & 1), cy + (c >> 1 & 1), cz + (c >> 2)));
                corners.iter().all(|&v| v >= self.deep) || corners.iter().all(|&v| v < self.faint)
            });
            for row in 0..self.step * self.step {
                let [dy, dz] = [row % self.step, row / self.step];
                let (y, z) = (cy * self.step + dy, cz * self.step + dz);
                if !is_settled {
                    remaining |= 1 << (y + BRICK * z);
                    continue;
                }
                let [ty, tz] = [dy, dz].map(|d| d as f32 / self.step as f32);
                let along = |x: usize| {
                    let low = at(x, cy, cz) * (1.0 - ty) + at(x, cy + 1, cz) * ty;
                    let high = at(x, cy, cz + 1) * (1.0 - ty) + at(x, cy + 1, cz + 1) * ty;
                    low * (1.0 - tz) + high * tz
                };
                for cx in 0..cells {
                    let (first, second) = (along(cx), along(cx + 1));
                    for dx in 0..self.step {
                        let tx = dx as f32 / self.step as f32;
                        values[offset([cx * self.step + dx, y, z])] = first * (1.0 - tx) + second * tx;
                    }
                }
            }
        }
        remaining
    }

    /// The coarse nodes in a brick of the fine grid and the first beyond it, at the beginning of each row.
    fn nodes_of(&self, coord: [i32; 3]) -> [f32; WITH_UPPER_LAYER.pow(3)] {
        let cells = (BRICK / self.step) as i32;
        let first = coord.map(|c| c * cells);
        let own = self.grid.bricks.find(first.map(|c| c.div_euclid(BRICK as i32)));
        let local = first.map(|c| c.rem_euclid(BRICK as i32) as usize);
        let mut nodes = [0.0; WITH_UPPER_LAYER.pow(3)];
        for z in 0..=cells as usize {
            for y in 0..=cells as usize {
                for x in 0..=cells as usize {
                    let place = [local[0] + x, local[1] + y, local[2] + z];
                    let value = match own {
                        Some(own) if place.iter().all(|&i| i < BRICK) => self.grid.brick(own)[offset(place)],
                        _ => self
                            .grid
                            .get([first[0] + x as i32, first[1] + y as i32, first[2] + z as i32])
                            .unwrap_or(0.0),
                    };
                    nodes[x + WITH_UPPER_LAYER * (y + WITH_UPPER_LAYER * z)] = value;
                }
            }
        }
        nodes
    }
}

/// The box of bricks of the grid within `band` voxels of a cell of coarse nodes, in the coarse brick at `coord`.
fn bricks_of_cell(coord: [i32; 3], cell: [usize; 3], step: usize, band: f32) -> [[i32; 3]; 2] {
    let band = band.ceil().min(BRICK as f32 * 8.0) as i32;
    let first = |axis: usize| (coord[axis] * BRICK as i32 + cell[axis] as i32) * step as i32;
    let brick = |node: i32| node.div_euclid(BRICK as i32);
    [
        [0, 1, 2].map(|axis| brick(first(axis) - band)),
        [0, 1, 2].map(|axis| brick(first(axis) + step as i32 + band)),
    ]
}

impl Active {
    /// Every brick within the kernels of particles.
    pub(super) fn all_in_reach(
        particles: &SortedParticles,
        isotropic_kernels: &ParticleKernels,
        voxel: f32,
    ) -> Self {
        Self { computed: bricks_in_reach(particles, isotropic_kernels, voxel), filled: Bricks::default() }
    }

    /// Missing bricks whose classification is contradicted: some of the adjacent nodes, of bricks `of` that
    /// `grid` has, are on the other side.
    pub(super) fn contradicted(&self, grid: &SparseGrid, threshold: f32, of: &Bricks) -> Vec<[i32; 3]> {
        let sides = sides();
        let mut found = par::map_chunks(of.len(), BRICKS_PER_TASK, |range| {
            let mut found = Vec::new();
            for &coord in &of.coords()[range] {
                let brick = grid.bricks.find(coord).expect("a brick of the grid");
                let inside = mask_of(grid.brick(brick), |&value| value >= threshold);
                for (step, side) in &sides {
                    let has_node_on_side = |inside: &NodeMask, not: u64| {
                        inside.iter().zip(side).any(|(inside, side)| (inside ^ not) & side != 0)
                    };
                    let (is_inside, is_outside) =
                        (has_node_on_side(&inside, 0), has_node_on_side(&inside, u64::MAX));
                    let neighbour = std::array::from_fn(|axis| coord[axis] + step[axis]);
                    let is_filled = || self.filled.find(neighbour).is_some();
                    let is_contradicted = if is_inside {
                        grid.bricks.find(neighbour).is_none() && (is_outside || !is_filled())
                    } else {
                        is_filled()
                    };
                    if is_contradicted {
                        found.push(neighbour);
                    }
                }
            }
            found
        })
        .concat();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Removes bricks from the filled ones.
    pub(super) fn remove_filled(&mut self, coords: &[[i32; 3]]) {
        let removed = Bricks::new(coords.to_vec());
        let filled = self.filled.coords().iter().copied().filter(|&coord| removed.find(coord).is_none());
        self.filled = Bricks::new(filled.collect());
    }
}

/// Voxels between coarse nodes: a power of two, so that they are nodes of the grid, and at most half the
/// kernel's support.
pub(crate) fn coarse_step(params: &DensityParams) -> usize {
    let largest = 0.5 * params.kernel_radius / params.voxel;
    [8, 4, 2].into_iter().find(|&step| step as f32 <= largest * 1.001).unwrap_or(1)
}

/// The scale of the smallest kernel that affects a coarse node wherever it is: half its support is a step.
pub(super) fn smallest_scale(params: &DensityParams) -> f32 {
    coarse_step(params) as f32 / (1.001 * 0.5 * params.kernel_radius / params.voxel)
}

/// Nodes along an edge of a brick with the first layer of its upper neighbours.
const WITH_UPPER_LAYER: usize = BRICK + 1;

/// The nodes of the brick at `coord` and the first beyond it; 0 where there is no brick.
fn with_upper_layer(grid: &SparseGrid, coord: [i32; 3]) -> [f32; WITH_UPPER_LAYER.pow(3)] {
    let around: [Option<&[f32]>; 8] = std::array::from_fn(|side| {
        let neighbour = std::array::from_fn(|axis| coord[axis] + (side >> axis & 1) as i32);
        grid.bricks.find(neighbour).map(|brick| grid.brick(brick))
    });
    std::array::from_fn(|place| {
        let node = [
            place % WITH_UPPER_LAYER,
            place / WITH_UPPER_LAYER % WITH_UPPER_LAYER,
            place / WITH_UPPER_LAYER.pow(2),
        ];
        let side = (0..3).map(|axis| (node[axis] / BRICK) << axis).sum::<usize>();
        around[side].map_or(0.0, |values| values[offset(node.map(|i| i % BRICK))])
    })
}

/// The smallest and the largest value of the part of a brick that begins at `part` · `span` and is `span`
/// cells long.
fn extremes(nodes: &[f32; WITH_UPPER_LAYER.pow(3)], part: [usize; 3], span: usize) -> (f32, f32) {
    let (mut smallest, mut largest) = (f32::INFINITY, 0.0_f32);
    let range = |axis: usize| part[axis] * span..=(part[axis] + 1) * span;
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let value = nodes[x + WITH_UPPER_LAYER * (y + WITH_UPPER_LAYER * z)];
                smallest = smallest.min(value);
                largest = largest.max(value);
            }
        }
    }
    (smallest, largest)
}

/// The steps to a brick's 26 neighbours, and its own nodes adjacent to each.
fn sides() -> Vec<([i32; 3], NodeMask)> {
    let steps = (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]).filter(|&step| step != [0; 3]);
    let touches = |step: [i32; 3], place: usize| {
        let node = [place % BRICK, place / BRICK % BRICK, place / (BRICK * BRICK)];
        (0..3).all(|axis| match step[axis] {
            0 => true,
            -1 => node[axis] == 0,
            _ => node[axis] == BRICK - 1,
        })
    };
    let places: Vec<usize> = (0..BRICK_NODES).collect();
    steps.map(|step| (step, mask_of(&places, |&place| touches(step, place)))).collect()
}

/// Every brick with a node in the box of a particle's kernel.
pub(super) fn bricks_in_reach(particles: &SortedParticles, kernels: &ParticleKernels, voxel: f32) -> Bricks {
    let coords = par::map_chunks(particles.len(), par::CHUNK, |range| {
        let mut boxes = Vec::new();
        for place in range {
            let kernel = kernels.at(particles, place);
            let brick = |axis: usize, side: f64, round: fn(f64) -> f64| {
                let at = f64::from(kernel.center[axis]) + side * f64::from(kernel.extents[axis]);
                (round(at / f64::from(voxel)) as i32).div_euclid(BRICK as i32)
            };
            let low = [0, 1, 2].map(|axis| brick(axis, -1.0, f64::ceil));
            let high = [0, 1, 2].map(|axis| brick(axis, 1.0, f64::floor));
            // Consecutive particles mostly reach the same bricks.
            if boxes.last() != Some(&[low, high]) {
                boxes.push([low, high]);
            }
        }
        bricks_in_boxes(boxes)
    });
    Bricks::new(coords.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The classifications contradicted by one brick at the origin, with `inside` of its nodes at 1 and the
    /// others at 0.
    fn contradicted(filled: &[[i32; 3]], inside: impl Fn([usize; 3]) -> bool) -> Vec<[i32; 3]> {
        let bricks = Bricks::new(vec![[0; 3]]);
        let mut grid = SparseGrid::new(1.0, bricks.clone(), 0.0);
        for (place, value) in grid.values.iter_mut().enumerate() {
            let node = [place % BRICK, place / BRICK % BRICK, place / (BRICK * BRICK)];
            *value = f32::from(u8::from(inside(node)));
        }
        let active = Active { computed: Bricks::default(), filled: Bricks::new(filled.to_vec()) };
        active.contradicted(&grid, 0.5, &bricks)
    }

    #[test]
    fn values_contradict_the_classification_of_adjacent_bricks() {
        // An inside corner node touches seven bricks, all classified as empty.
        let mut upper: Vec<[i32; 3]> = (1..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]).collect();
        upper.sort_unstable();
        assert_eq!(contradicted(&[], |node| node == [BRICK - 1; 3]), upper);
        // A filled brick agrees with the only node that it touches.
        upper.pop();
        assert_eq!(contradicted(&[[1, 1, 1]], |node| node == [BRICK - 1; 3]), upper);
        let all_but_the_corner = |node: [usize; 3]| node != [0; 3];
        let around: Vec<[i32; 3]> = (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]).collect();
        let lower = contradicted(&around, all_but_the_corner);
        assert_eq!(lower.len(), 7);
        assert!(lower.iter().flatten().all(|&v| v <= 0));
        assert!(contradicted(&around, |_| true).is_empty() && contradicted(&[], |_| false).is_empty());
        assert_eq!(contradicted(&[[0, 0, -1]], |_| false), [[0, 0, -1]]);
    }
}
