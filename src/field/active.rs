//! Which bricks of the density are computed.
//!
//! *Method*: the density is first sampled everywhere on coarse nodes, at most half a kernel's support apart. A brick
//! whose coarse nodes are all deep inside is filled: it stays without values. One whose coarse nodes are all faint is
//! empty. The others are computed, and where a value beside a brick that is not computed contradicts what that was taken
//! for, it is computed too, until nothing contradicts: the surface is closed, whatever the guess was worth.
//!
//! Within a brick of balls, rows of nodes between coarse nodes that are all deep or all faint are interpolated.
//!
//! Limits: bubbles and drops that no coarse node feels are not found. A drop of one particle is felt, at 0.36 or more; a
//! gap between particles that leaves every coarse node around it deep inside is not a bubble.

use super::{DensityParams, blob::Blobs, cloud::Cloud, fill::compute};
use crate::{
    grid::{BRICK, BRICK_NODES, Bricks, NodeMask, SparseGrid, mask_of, offset},
    par,
};

/// A node is deep inside from this part of the way on between the surface's density and the filled liquid's, 1.
const DEEP: f32 = 0.5;

/// A node is faint below this part of the surface's density: less than the 0.36 at which a drop of one particle is felt.
/// Smaller, and more bricks are computed for nothing.
const FAINT: f32 = 0.5;

/// Bricks that are looked at in one task.
const TASK: usize = 16;

/// The bricks of a density, computed or filled; all others are empty.
pub(super) struct Active {
    pub(super) computed: Bricks,
    /// Bricks that are inside, and not computed.
    pub(super) filled: Bricks,
}

/// The density of balls on coarse nodes.
pub(super) struct Coarse {
    grid: SparseGrid,
    /// Voxels between its nodes.
    step: usize,
    /// From here on nodes are deep inside …
    deep: f32,
    /// … and below this they are faint.
    faint: f32,
}

impl Coarse {
    /// None where coarse nodes would be the nodes themselves.
    /// `threshold` is the balls' own.
    pub(super) fn new(cloud: &Cloud, balls: &Blobs, threshold: f32, params: &DensityParams) -> Option<Self> {
        let step = coarse_step(params);
        let voxel = params.voxel * params.spacing * step as f32;
        (step > 1).then(|| {
            let bricks = reached(cloud, balls, voxel);
            let mut grid = SparseGrid::new(voxel, bricks.clone(), 0.0);
            compute(&mut grid, &bricks, cloud, balls, &|_, _| u64::MAX);
            let (deep, faint) = (threshold + DEEP * (1.0 - threshold), FAINT * threshold);
            Self { grid, step, deep, faint }
        })
    }

    /// The bricks near the surface, and those inside.
    pub(super) fn active(&self) -> Active {
        let Self { grid, step, .. } = self;
        let (mut computed, mut filled) = (Vec::new(), Vec::new());
        for (some_computed, some_filled) in par::map_chunks(grid.bricks.len(), TASK, |range| {
            let (mut computed, mut filled) = (Vec::new(), Vec::new());
            for brick in range {
                let coord = grid.bricks.coords()[brick];
                let nodes = with_upper_sides(grid, coord);
                for part in 0..step.pow(3) {
                    let part = [part % step, part / step % step, part / (step * step)];
                    let (least, most) = extremes(&nodes, part, BRICK / step);
                    let fine = std::array::from_fn(|axis| coord[axis] * *step as i32 + part[axis] as i32);
                    if least >= self.deep {
                        filled.push(fine);
                    } else if most >= self.faint {
                        computed.push(fine);
                    }
                }
            }
            (computed, filled)
        }) {
            computed.extend(some_computed);
            filled.extend(some_filled);
        }
        Active { computed: Bricks::new(computed), filled: Bricks::new(filled) }
    }

    /// Writes the values of the rows of a brick that lie deep or faint, linear between coarse nodes. Returns the others, bit
    /// y + 8 z.
    pub(super) fn settle(&self, coord: [i32; 3], values: &mut [f32; BRICK_NODES]) -> u64 {
        let cells = BRICK / self.step;
        let nodes = self.nodes_of(coord);
        let at = |x: usize, y: usize, z: usize| nodes[x + WITH_SIDES * (y + WITH_SIDES * z)];
        let mut left = 0;
        for cell in 0..cells * cells {
            let [cy, cz] = [cell % cells, cell / cells];
            let is_off = (0..cells).all(|cx| {
                let corners: [f32; 8] =
                    std::array::from_fn(|c| at(cx + (c & 1), cy + (c >> 1 & 1), cz + (c >> 2)));
                corners.iter().all(|&v| v >= self.deep) || corners.iter().all(|&v| v < self.faint)
            });
            for row in 0..self.step * self.step {
                let [dy, dz] = [row % self.step, row / self.step];
                let (y, z) = (cy * self.step + dy, cz * self.step + dz);
                if !is_off {
                    left |= 1 << (y + BRICK * z);
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
        left
    }

    /// The coarse nodes in a brick of the fine grid and the first beyond it, at the beginning of each row.
    fn nodes_of(&self, coord: [i32; 3]) -> [f32; WITH_SIDES.pow(3)] {
        let cells = (BRICK / self.step) as i32;
        let first = coord.map(|c| c * cells);
        let own = self.grid.bricks.find(first.map(|c| c.div_euclid(BRICK as i32)));
        let local = first.map(|c| c.rem_euclid(BRICK as i32) as usize);
        let mut nodes = [0.0; WITH_SIDES.pow(3)];
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
                    nodes[x + WITH_SIDES * (y + WITH_SIDES * z)] = value;
                }
            }
        }
        nodes
    }
}

impl Active {
    /// Every brick that particles reach.
    pub(super) fn everywhere(cloud: &Cloud, balls: &Blobs, voxel: f32) -> Self {
        Self { computed: reached(cloud, balls, voxel), filled: Bricks::default() }
    }

    /// Missing bricks that values contradict: some of the nodes beside them, of bricks `of` that `grid` has, are on the
    /// other side.
    pub(super) fn contradicted(&self, grid: &SparseGrid, threshold: f32, of: &Bricks) -> Vec<[i32; 3]> {
        let sides = sides();
        let mut found = par::map_chunks(of.len(), TASK, |range| {
            let mut found = Vec::new();
            for &coord in &of.coords()[range] {
                let brick = grid.bricks.find(coord).expect("a brick of the grid");
                let inside = mask_of(grid.brick(brick), |&value| value >= threshold);
                for (step, side) in &sides {
                    let meets = |inside: &NodeMask, not: u64| {
                        inside.iter().zip(side).any(|(inside, side)| (inside ^ not) & side != 0)
                    };
                    let (is_inside, is_outside) = (meets(&inside, 0), meets(&inside, u64::MAX));
                    let beside = std::array::from_fn(|axis| coord[axis] + step[axis]);
                    let is_filled = || self.filled.find(beside).is_some();
                    let is_contradicted = if is_inside {
                        grid.bricks.find(beside).is_none() && (is_outside || !is_filled())
                    } else {
                        is_filled()
                    };
                    if is_contradicted {
                        found.push(beside);
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

    /// Takes bricks from the filled ones.
    pub(super) fn open(&mut self, coords: &[[i32; 3]]) {
        let gone = Bricks::new(coords.to_vec());
        let filled = self.filled.coords().iter().copied().filter(|&coord| gone.find(coord).is_none());
        self.filled = Bricks::new(filled.collect());
    }
}

/// Voxels between coarse nodes: a power of two, so that they are nodes of the grid, and at most half the kernel's support.
pub fn coarse_step(params: &DensityParams) -> usize {
    let most = 0.5 * params.kernel_radius / params.voxel;
    [8, 4, 2].into_iter().find(|&step| step as f32 <= most * 1.001).unwrap_or(1)
}

/// Nodes along an edge of a brick with the first layer of its upper neighbours.
const WITH_SIDES: usize = BRICK + 1;

/// The nodes of the brick at `coord` and the first beyond it, 0 where no brick is there.
fn with_upper_sides(grid: &SparseGrid, coord: [i32; 3]) -> [f32; WITH_SIDES.pow(3)] {
    let around: [Option<&[f32]>; 8] = std::array::from_fn(|side| {
        let beside = std::array::from_fn(|axis| coord[axis] + (side >> axis & 1) as i32);
        grid.bricks.find(beside).map(|brick| grid.brick(brick))
    });
    std::array::from_fn(|place| {
        let node = [place % WITH_SIDES, place / WITH_SIDES % WITH_SIDES, place / WITH_SIDES.pow(2)];
        let side = (0..3).map(|axis| (node[axis] / BRICK) << axis).sum::<usize>();
        around[side].map_or(0.0, |values| values[offset(node.map(|i| i % BRICK))])
    })
}

/// The least and the largest value of the part of a brick that begins at `part` · `span` and is `span` cells long.
fn extremes(nodes: &[f32; WITH_SIDES.pow(3)], part: [usize; 3], span: usize) -> (f32, f32) {
    let (mut least, mut most) = (f32::INFINITY, 0.0_f32);
    let range = |axis: usize| part[axis] * span..=(part[axis] + 1) * span;
    for z in range(2) {
        for y in range(1) {
            for x in range(0) {
                let value = nodes[x + WITH_SIDES * (y + WITH_SIDES * z)];
                least = least.min(value);
                most = most.max(value);
            }
        }
    }
    (least, most)
}

/// The steps to a brick's 26 neighbours, and its own nodes beside each.
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

/// Every brick with a node in the box of the kernel of a particle.
pub(super) fn reached(cloud: &Cloud, blobs: &Blobs, voxel: f32) -> Bricks {
    let coords = par::map_chunks(cloud.len(), par::CHUNK, |range| {
        let mut reached = Vec::new();
        let mut last = None;
        for place in range {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// What one brick at the origin, with `inside` of its nodes at 1 and the others at 0, contradicts.
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
    fn values_contradict_what_bricks_beside_them_were_taken_for() {
        // A corner that is inside touches seven bricks, all taken for empty.
        let mut upper: Vec<[i32; 3]> = (1..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]).collect();
        upper.sort_unstable();
        assert_eq!(contradicted(&[], |node| node == [BRICK - 1; 3]), upper);
        // One that is filled agrees with the only node that it touches.
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
