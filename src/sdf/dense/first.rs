//! First-order fast sweeping on a dense grid: sweeps in eight orders over blocks, until nothing changes.
//!
//! *Method* [zhao05], [gourlay17]: as on bricks (`sdf/sweep.rs`), blocks run in a wavefront, each when its predecessors in the
//! sweep's direction are finished. So the bits are those of the sequential sweep ([`sweep_in_order`]) for any size of blocks and any
//! number of threads.
//! *Departs from the papers*: a converged block is skipped, which changes no bit: its last pass changed nothing, and neither have
//! the layers that it reads of its neighbours since. At the start a block counts as converged if neither it nor a neighbour has a
//! pinned node: all that it reads is ∞.

use super::{
    layout::Layout,
    skewed::{BlockValues, Skewed, Source},
};
use crate::{
    par,
    sdf::{
        Swept,
        godunov::{ORDERS, smaller, until_converged, update},
    },
};
use std::sync::RwLock;
use std::sync::atomic::{AtomicBool, Ordering};

pub(super) const NO_PANIC: &str = "a pass over a block does not panic";

/// The blocks during the sweeps.
///
/// No two threads ever request the same lock for writing, and none reads while another writes: the wavefront
/// never runs face neighbours at once.
pub(super) struct SweptBlocks {
    layout: Layout,
    values: Vec<RwLock<BlockValues>>,
    /// Whether a pass over the block could change anything.
    active: Vec<AtomicBool>,
    /// Whether a pass over a row of the block could change it.
    due: Vec<Vec<AtomicBool>>,
    band: f32,
}

impl SweptBlocks {
    pub(super) fn new(layout: Layout, seeds: &[f32], band: f32) -> Self {
        let values = layout.split(seeds);
        let has_pins: Vec<bool> = par::map(values.len(), |block| values[block].iter().any(|v| v.is_finite()));
        let touches = |block: usize| layout.around(block).into_iter().flatten().any(|other| has_pins[other]);
        let starts: Vec<bool> = (0..has_pins.len()).map(|block| has_pins[block] || touches(block)).collect();
        let rows = |block: usize| layout.size(block)[1] * layout.size(block)[2];
        Self {
            due: par::map(starts.len(), |block| {
                (0..rows(block)).map(|_| AtomicBool::new(starts[block])).collect()
            }),
            active: starts.into_iter().map(AtomicBool::new).collect(),
            values: (0..)
                .zip(values)
                .map(|(block, nodes)| RwLock::new(BlockValues::new(nodes, layout.size(block)[0])))
                .collect(),
            layout,
            band,
        }
    }

    /// Whether no pass would change anything.
    pub(super) fn converged(&self) -> bool {
        !self.active.iter().any(|active| active.load(Ordering::Relaxed))
    }

    /// One sweep over all blocks in the given order, as a wavefront.
    pub(super) fn sweep(&self, order: [i32; 3]) {
        self.layout.wavefront(order, |block| self.pass(block, order));
    }

    /// The distances of the whole box.
    pub(super) fn distances(&self) -> Vec<f32> {
        self.layout.join(|block, read| read(&self.values[block].read().expect(NO_PANIC).nodes))
    }

    /// One Gauss–Seidel pass over a block in the given order.
    fn pass(&self, block: usize, order: [i32; 3]) {
        if !self.active[block].load(Ordering::Relaxed) {
            return;
        }
        let size = self.layout.size(block);
        let [_, sy, sz] = size;
        let faces = self.layout.around(block);
        let due = &self.due[block];
        let mut skewed = Skewed::new(size, order, |y, z| due[y + sy * z].load(Ordering::Relaxed));
        let changed = {
            let own = self.values[block].read().expect(NO_PANIC);
            let around = faces.map(|face| face.map(|other| self.values[other].read().expect(NO_PANIC)));
            let around =
                std::array::from_fn(|face| Some((&**around[face].as_ref()?, self.layout.size(faces[face]?))));
            skewed.relax(&Source { own: &own, order, around }, self.band)
        };
        self.active[block].store(changed, Ordering::Relaxed);
        for (row, due) in due.iter().enumerate() {
            due.store(changed && skewed.is_due(row % sy, row / sy), Ordering::Relaxed);
        }
        if !changed {
            return;
        }

        // Rows of neighbours that read a row that has changed become due.
        let activate = |face: usize, y: usize, z: usize| {
            let Some(other) = faces[face] else { return };
            let [_, oy, oz] = self.layout.size(other);
            let (y, z) = match face {
                2 => (oy - 1, z),
                3 => (0, z),
                4 => (y, oz - 1),
                5 => (y, 0),
                _ => (y, z),
            };
            self.due[other][y + oy * z].store(true, Ordering::Relaxed);
            self.active[other].store(true, Ordering::Relaxed);
        };
        skewed.scatter(&mut self.values[block].write().expect(NO_PANIC), |y, z, ends| {
            let at = [ends[0], ends[1], y == 0, y + 1 == sy, z == 0, z + 1 == sz];
            (0..6).filter(|&face| at[face]).for_each(|face| activate(face, y, z));
        });
    }
}

/// Extends pinned distances to every node of a box by fast sweeping of first order, until nothing changes.
///
/// `seeds` has one number per node [voxels], x fastest: pinned distances as negative numbers, ∞ at all other
/// nodes. Distances of `band` and more are not written. `block` is the number of nodes of a block along each
/// axis; it changes the time, never the result.
///
/// # Panics
/// If `seeds` has another length than the box, or a block has no node.
pub fn sweep(nodes: [usize; 3], seeds: &[f32], band: f32, block: [usize; 3]) -> Swept {
    let blocks = SweptBlocks::new(Layout::new(nodes, block), seeds, band);
    let sweeps = until_converged(|| blocks.converged(), |order| blocks.sweep(order));
    Swept::new(blocks.distances(), sweeps)
}

/// [`sweep`] without blocks and threads: every node in the order of the sweep, one after the other. The
/// reference that `sweep` is tested against bit for bit, and timed against; `sweeps` is a multiple of eight.
pub fn sweep_in_order(nodes: [usize; 3], seeds: &[f32], band: f32) -> Swept {
    let mut distance = seeds.to_vec();
    let mut sweeps = 0;
    let mut changed = true;
    while changed {
        changed = false;
        for order in ORDERS {
            changed |= one_sweep_in_order(nodes, &mut distance, order, band);
            sweeps += 1;
        }
    }
    Swept::new(distance, sweeps)
}

/// One sweep over all nodes in the given order; returns whether anything changed.
pub(super) fn one_sweep_in_order(
    nodes: [usize; 3],
    distance: &mut [f32],
    order: [i32; 3],
    band: f32,
) -> bool {
    let strides = [1, nodes[0], nodes[0] * nodes[1]];
    let along = |axis: usize, i: usize| if order[axis] > 0 { i } else { nodes[axis] - 1 - i };
    let mut changed = false;
    for z in 0..nodes[2] {
        for y in 0..nodes[1] {
            for x in 0..nodes[0] {
                let node = [along(0, x), along(1, y), along(2, z)];
                let at = node[0] + node[1] * strides[1] + node[2] * strides[2];
                let mut nearest = [f32::INFINITY; 3];
                for axis in 0..3 {
                    if node[axis] > 0 {
                        nearest[axis] = distance[at - strides[axis]].abs();
                    }
                    if node[axis] + 1 < nodes[axis] {
                        nearest[axis] = smaller(nearest[axis], distance[at + strides[axis]].abs());
                    }
                }
                if let Some(lower) = update(distance[at], nearest, band) {
                    distance[at] = lower;
                    changed = true;
                }
            }
        }
    }
    changed
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::simd::tests::in_both_forms;

    /// White noise in 0..1 that depends on the number alone.
    pub(crate) fn noise(i: usize) -> f32 {
        let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed >> 40) as f32 / (1 << 24) as f32
    }

    /// Boxes of nodes with pinned distances: about a ball, about single nodes, noise, one node in a corner,
    /// none, and boxes without depth.
    pub(crate) fn cases() -> Vec<(&'static str, [usize; 3], Vec<f32>)> {
        let pinned = |nodes: [usize; 3], pin: &dyn Fn([f32; 3], usize) -> Option<f32>| -> Vec<f32> {
            (0..nodes.iter().product())
                .map(|i| {
                    let x = [i % nodes[0], i / nodes[0] % nodes[1], i / (nodes[0] * nodes[1])];
                    pin(x.map(|v| v as f32), i).map_or(f32::INFINITY, |d| -d)
                })
                .collect()
        };
        let ball = |x: [f32; 3]| ((x[0] - 9.3).powi(2) + (x[1] - 12.1).powi(2) + (x[2] - 8.0).powi(2)).sqrt();
        let ball = move |x: [f32; 3], _: usize| Some((ball(x) - 5.7).abs()).filter(|d| *d < 1.5);
        let rare = |_: [f32; 3], i: usize| (noise(i) < 0.002).then(|| noise(i + 7) + 1e-6);
        let dense = |_: [f32; 3], i: usize| (noise(i) < 0.1).then(|| 5.0 * noise(i + 7) + 1e-6);
        let corner = |_: [f32; 3], i: usize| (i == 0).then_some(0.5);
        vec![
            ("ball", [22, 25, 19], pinned([22, 25, 19], &ball)),
            ("rare", [33, 17, 24], pinned([33, 17, 24], &rare)),
            ("noise", [16, 24, 15], pinned([16, 24, 15], &dense)),
            ("corner", [19, 9, 11], pinned([19, 9, 11], &corner)),
            ("nothing", [9, 9, 9], pinned([9, 9, 9], &|_, _| None)),
            ("layer", [31, 29, 1], pinned([31, 29, 1], &rare)),
            ("row", [1, 1, 40], pinned([1, 1, 40], &corner)),
        ]
    }

    pub(crate) const BLOCKS: [[usize; 3]; 7] =
        [[1, 1, 1], [3, 5, 2], [8, 8, 8], [16, 8, 4], [7, 9, 30], [5, 17, 8], [64, 64, 64]];

    pub(crate) fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|v| v.to_bits()).collect()
    }

    #[test]
    fn every_sweep_has_the_bits_of_the_sequential_one() {
        // The converged result does not depend on the order, so the distances after every sweep are compared
        // too.
        for (name, nodes, seeds) in cases() {
            for band in [f32::INFINITY, 4.5] {
                let new = |block| SweptBlocks::new(Layout::new(nodes, block), &seeds, band);
                let runs: Vec<_> = BLOCKS
                    .into_iter()
                    .flat_map(|block| [1, 2, 5].map(|threads| (block, threads, new(block))))
                    .collect();
                let mut reference = seeds.clone();
                for (sweep, order) in ORDERS.into_iter().cycle().take(11).enumerate() {
                    one_sweep_in_order(nodes, &mut reference, order, band);
                    for (block, threads, blocks) in &runs {
                        par::with_threads(*threads, || blocks.sweep(order));
                        let same = bits(&blocks.distances()) == bits(&reference);
                        assert!(same, "{name}, {block:?}, {threads} threads, sweep {sweep}");
                    }
                }
            }
        }
    }

    #[test]
    fn every_sweep_has_the_same_bits_in_both_forms_of_lanes() {
        for (name, nodes, seeds) in cases() {
            for (block, band) in BLOCKS.into_iter().zip([f32::INFINITY, 4.5].into_iter().cycle()) {
                let [scalar, fastest] = in_both_forms(|| {
                    let blocks = SweptBlocks::new(Layout::new(nodes, block), &seeds, band);
                    let sweeps = ORDERS.into_iter().cycle().take(11).map(|order| {
                        blocks.sweep(order);
                        bits(&blocks.distances())
                    });
                    sweeps.collect::<Vec<_>>()
                });
                assert!(scalar == fastest, "{name}, {block:?}");
            }
        }
    }

    #[test]
    fn one_sweep_fills_its_octant_and_eight_fill_the_box() {
        let nodes = [13, 11, 17];
        let middle = [6, 5, 8];
        let mut seeds = vec![f32::INFINITY; nodes.iter().product()];
        seeds[middle[0] + nodes[0] * (middle[1] + nodes[1] * middle[2])] = -1e-6;
        for order in ORDERS {
            let blocks = SweptBlocks::new(Layout::new(nodes, [4; 3]), &seeds, f32::INFINITY);
            blocks.sweep(order);
            for (i, &distance) in blocks.distances().iter().enumerate() {
                let node = [i % nodes[0], i / nodes[0] % nodes[1], i / (nodes[0] * nodes[1])];
                // A neighbour of the pinned node reads it in any order, so one step behind the octant is
                // reached too.
                let behind: i32 =
                    (0..3).map(|axis| ((middle[axis] as i32 - node[axis] as i32) * order[axis]).max(0)).sum();
                assert_eq!(distance.is_finite(), behind <= 1, "{node:?} {order:?}");
            }
        }
        let blocks = SweptBlocks::new(Layout::new(nodes, [4; 3]), &seeds, f32::INFINITY);
        ORDERS.into_iter().for_each(|order| blocks.sweep(order));
        // Further sweeps change last digits alone.
        let end = sweep_in_order(nodes, &seeds, f32::INFINITY).distance;
        for (eight, end) in blocks.distances().iter().zip(end) {
            assert!((eight - end).abs() < 1e-5 && eight.is_finite(), "{eight} {end}");
        }
    }

    #[test]
    fn the_end_has_the_bits_of_the_sequential_sweeps() {
        for (name, nodes, seeds) in cases() {
            for band in [f32::INFINITY, 4.5] {
                let reference = sweep_in_order(nodes, &seeds, band);
                for block in BLOCKS {
                    let found = sweep(nodes, &seeds, band, block);
                    assert_eq!(bits(&found.distance), bits(&reference.distance), "{name}, {block:?}");
                    assert_eq!(found.unreached, reference.unreached);
                    assert!(found.sweeps <= reference.sweeps + 8);
                }
                for (before, after) in seeds.iter().zip(&reference.distance) {
                    assert!(if *before < 0.0 { before == after } else { *after > 0.0 && !after.is_nan() });
                    assert!(after.is_infinite() || *after < band);
                }
            }
        }
    }

    #[test]
    fn a_dense_box_has_the_bits_of_its_bricks() {
        use crate::grid::{BRICK, BRICK_NODES, Bricks, node_of};
        let nodes = [24, 16, 32];
        let seeds: Vec<f32> = (0..nodes.iter().product())
            .map(|i| if noise(i) < 0.01 { -noise(i + 3) - 1e-6 } else { f32::INFINITY })
            .collect();
        let coords = (0..nodes.iter().product::<usize>() / BRICK_NODES).map(|i| [i % 3, i / 3 % 2, i / 6]);
        let bricks = Bricks::new(coords.map(|c| c.map(|v| v as i32)).collect());
        let index = |slot: usize| {
            let node = node_of(bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES).map(|v| v as usize);
            node[0] + nodes[0] * (node[1] + nodes[1] * node[2])
        };
        let on_bricks: Vec<f32> = (0..seeds.len()).map(|slot| seeds[index(slot)]).collect();
        for band in [3.0, f32::INFINITY] {
            let sparse = crate::sdf::sweep(&bricks, &on_bricks, band, 1);
            let dense = sweep(nodes, &seeds, band, [2 * BRICK; 3]);
            assert!((0..seeds.len()).all(|slot| sparse.distance[slot] == dense.distance[index(slot)]));
            assert_eq!(sparse.unreached, dense.unreached);
        }
    }
}
