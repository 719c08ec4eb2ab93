//! Fast sweeping on bricks: the Eikonal equation |∇u| = 1 from pinned distances, in eight sweep orders.
//!
//! *Method* [zhao05]: Godunov upwind differences and Gauss–Seidel sweeps in eight orders; [gourlay17]: blocks
//! run in a wavefront as their predecessors in the sweep's direction finish. A node reads its six neighbours.
//! Those before it in the sweep are done, those after it wait for it, so the wavefront gives the bits of the
//! sequential sweep ([`sweep_in_order`]) for any number of threads.
//!
//! *Departs from the paper*: sweeps are repeated until nothing changes. A brick has converged if its last
//! pass changed nothing and the facing layers of its neighbours have not changed since. A pass would change
//! nothing, so it is skipped. The equation is solved relative to the smallest neighbour, which keeps single
//! precision accurate far from the surface.
//!
//! Symbols: u distance [voxels]; a ≤ b ≤ c the smaller neighbour of each axis.
//!
//! Limits: first order; the error grows as h log 1/h with the distance from a point source.

use super::{
    brick_blocks::BrickBlocks,
    godunov::{ORDERS, lowered, smaller, until_converged, update},
};
use crate::grid::{BRICK, BRICK_NODES, Bricks, SparseGrid, node_of};
use crate::par;
use std::sync::RwLock;
use std::sync::atomic::{AtomicBool, Ordering};

/// Distances after sweeping.
#[derive(Clone, Debug, PartialEq)]
pub struct Swept {
    /// One number per node, in the order of the seeds [voxels]: pinned distances as negative numbers,
    /// unchanged; distances below the band; ∞ at nodes that no front reached within the band.
    pub distance: Vec<f32>,
    /// How many nodes hold ∞.
    pub unreached: usize,
    /// Sweeps run until nothing changed, including the last ones that changed nothing.
    pub sweeps: usize,
}

impl Swept {
    /// Counts the nodes of `distance` that were not reached.
    pub(super) fn new(distance: Vec<f32>, sweeps: usize) -> Self {
        let unreached = par::map_chunks(distance.len(), par::CHUNK, |range| {
            distance[range].iter().filter(|d| d.is_infinite()).count()
        });
        Self { distance, unreached: unreached.into_iter().sum(), sweeps }
    }
}

/// Extends pinned distances to all nodes by fast sweeping until nothing changes.
///
/// `seeds` has 512 numbers per brick [voxels]: pinned distances as negative numbers, ∞ at all other nodes.
/// Distances of `band` and more are not written. Missing bricks hold no distance. A thread takes blocks of
/// `block`³ bricks at a time, which changes the time and never the result.
///
/// # Panics
/// If `seeds` has another length, or `block` is 0.
pub fn sweep(bricks: &Bricks, seeds: &[f32], band: f32, block: usize) -> Swept {
    let swept = SweptBricks::new(bricks, seeds, band, block);
    let sweeps = until_converged(|| swept.converged(), |order| swept.sweep(order));
    Swept::new(swept.distances(), sweeps)
}

const NO_PANIC: &str = "a pass over a block does not panic";

/// The bricks during the sweeps.
///
/// No two threads ever request the same lock for writing, and none reads while another writes: the wavefront
/// never runs face neighbours at once. The locks prove that to the compiler, and cost one uncontended
/// operation each. Atomic numbers in their place were no faster (two full solves of 256³ on one thread: 2.89
/// s, with locks 2.85 s).
struct SweptBricks {
    blocks: BrickBlocks,
    neighbours: Vec<[Option<u32>; 6]>,
    values: Vec<RwLock<[f32; BRICK_NODES]>>,
    /// Whether a pass over the brick could change anything.
    active: Vec<AtomicBool>,
    band: f32,
}

/// Nodes along the edge of a brick with one layer of its neighbours around it.
const EDGE: usize = BRICK + 2;

/// Distances in a brick and in the facing layers of its neighbours; the twelve edges are never read.
type Padded = [f32; EDGE * EDGE * EDGE];

/// The place of the first node of a brick's row (0..64, y fastest) in a padded brick.
fn padded(row: usize) -> usize {
    1 + EDGE * (row % BRICK + 1) + EDGE * EDGE * (row / BRICK + 1)
}

impl SweptBricks {
    fn new(bricks: &Bricks, seeds: &[f32], band: f32, block: usize) -> Self {
        assert_eq!(seeds.len(), bricks.len() * BRICK_NODES, "one number per node");
        let values = par::map(bricks.len(), |brick| {
            let mut values = [0.0; BRICK_NODES];
            values.copy_from_slice(&seeds[brick * BRICK_NODES..(brick + 1) * BRICK_NODES]);
            RwLock::new(values)
        });
        let active = (0..bricks.len()).map(|_| AtomicBool::new(true)).collect();
        Self {
            blocks: BrickBlocks::new(bricks, block),
            neighbours: bricks.neighbours(),
            values,
            active,
            band,
        }
    }

    /// Whether no pass would change anything.
    fn converged(&self) -> bool {
        !self.active.iter().any(|active| active.load(Ordering::Relaxed))
    }

    /// One sweep over all bricks in the given order, as a wavefront.
    fn sweep(&self, order: [i32; 3]) {
        self.blocks.wavefront(order, |brick| self.pass(brick, order));
    }

    /// The distances of all bricks.
    fn distances(&self) -> Vec<f32> {
        let mut distance = vec![0.0; self.values.len() * BRICK_NODES];
        par::for_chunks(&mut distance, BRICK_NODES, |start, out| {
            out.copy_from_slice(&*self.values[start / BRICK_NODES].read().expect(NO_PANIC));
        });
        distance
    }

    /// One Gauss–Seidel pass over a brick in the given order.
    fn pass(&self, brick: usize, order: [i32; 3]) {
        if !self.active[brick].load(Ordering::Relaxed) {
            return;
        }
        let mut own = *self.values[brick].read().expect(NO_PANIC);
        let u = self.gather(brick, &own);
        let changed = relax(&mut own, u, order, self.band);
        self.active[brick].store(changed.is_some(), Ordering::Relaxed);
        let Some(faces) = changed else { return };

        // Neighbours become active if the layer they read has changed.
        *self.values[brick].write().expect(NO_PANIC) = own;
        for (other, _) in self.neighbours[brick].iter().zip(faces).filter(|(_, changed)| *changed) {
            if let Some(other) = *other {
                self.active[other as usize].store(true, Ordering::Relaxed);
            }
        }
    }

    /// The brick's distances with the facing layers of its neighbours, ∞ where there is none.
    fn gather(&self, brick: usize, own: &[f32; BRICK_NODES]) -> Padded {
        const LAST: usize = BRICK - 1;
        let mut u = [f32::INFINITY; EDGE * EDGE * EDGE];
        let mut put = |at: usize, row: &[f32]| {
            for (to, from) in u[at..at + row.len()].iter_mut().zip(row) {
                *to = from.abs();
            }
        };
        for (row, values) in own.chunks_exact(BRICK).enumerate() {
            put(padded(row), values);
        }
        for (face, other) in self.neighbours[brick].iter().enumerate() {
            let Some(other) = *other else { continue };
            let values = self.values[other as usize].read().expect(NO_PANIC);
            let row = |row: usize| &values[row * BRICK..(row + 1) * BRICK];
            for i in 0..BRICK {
                match face {
                    0 => (0..BRICK).for_each(|j| put(padded(i * BRICK + j) - 1, &row(i * BRICK + j)[LAST..])),
                    1 => {
                        (0..BRICK).for_each(|j| put(padded(i * BRICK + j) + BRICK, &row(i * BRICK + j)[..1]))
                    }
                    2 => put(padded(i * BRICK) - EDGE, row(i * BRICK + LAST)),
                    3 => put(padded(i * BRICK + LAST) + EDGE, row(i * BRICK)),
                    4 => put(padded(i) - EDGE * EDGE, row(LAST * BRICK + i)),
                    _ => put(padded(LAST * BRICK + i) + EDGE * EDGE, row(i)),
                }
            }
        }
        u
    }
}

/// Lowers the free distances of a brick in the given order; returns which of its faces changed, or `None` if
/// nothing changed.
fn relax(own: &mut [f32; BRICK_NODES], mut u: Padded, order: [i32; 3], band: f32) -> Option<[bool; 6]> {
    let run =
        |direction: i32| if direction > 0 { [0, 1, 2, 3, 4, 5, 6, 7] } else { [7, 6, 5, 4, 3, 2, 1, 0] };
    let mut any = false;
    let mut faces = [false; 6];
    for z in run(order[2]) {
        for y in run(order[1]) {
            let row: usize = y + BRICK * z;
            let values: &mut [f32; BRICK] =
                (&mut own[row * BRICK..(row + 1) * BRICK]).try_into().expect("a row");
            let start = padded(row);
            let nearest = |u: &Padded, x: usize| {
                let i = start + x;
                [
                    smaller(u[i - 1], u[i + 1]),
                    smaller(u[i - EDGE], u[i + EDGE]),
                    smaller(u[i - EDGE * EDGE], u[i + EDGE * EDGE]),
                ]
            };

            // A row that no neighbour lowers does not change: tested for eight nodes at once.
            let mut lowers = [false; BRICK];
            for x in 0..BRICK {
                lowers[x] = lowered(values[x], nearest(&u, x), band);
            }
            if lowers == [false; BRICK] {
                continue;
            }
            let mut changed = 0_u8;
            for x in run(order[0]) {
                if let Some(distance) = update(values[x], nearest(&u, x), band) {
                    values[x] = distance;
                    u[start + x] = distance;
                    changed |= 1 << x;
                }
            }
            if changed != 0 {
                any = true;
                let at = [changed & 1 != 0, changed >> 7 != 0, y == 0, y == 7, z == 0, z == 7];
                faces = std::array::from_fn(|face| faces[face] || at[face]);
            }
        }
    }
    any.then_some(faces)
}

/// [`sweep`] without blocks and threads: every node of the grid in the order of the sweep, one after the
/// other. The reference that `sweep` is tested against, bit for bit; `sweeps` is a multiple of eight.
pub fn sweep_in_order(bricks: &Bricks, seeds: &[f32], band: f32) -> Swept {
    let mut grid = SparseGrid::of(1.0, bricks.clone(), seeds.to_vec());
    let mut sweeps = 0;
    let mut changed = true;
    while changed {
        changed = false;
        for order in ORDERS {
            changed |= one_sweep_in_order(&mut grid, order, band);
            sweeps += 1;
        }
    }
    Swept::new(grid.values, sweeps)
}

/// One sweep over all nodes in the given order; returns whether anything changed.
fn one_sweep_in_order(grid: &mut SparseGrid, order: [i32; 3], band: f32) -> bool {
    let node = |slot: usize| node_of(grid.bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES);
    let mut nodes: Vec<([i32; 3], usize)> = (0..grid.values.len()).map(|slot| (node(slot), slot)).collect();
    nodes.sort_by_key(|(node, _)| [order[2] * node[2], order[1] * node[1], order[0] * node[0]]);
    let mut changed = false;
    for (node, slot) in nodes {
        let at = |axis: usize, step: i32| {
            let mut other = node;
            other[axis] += step;
            grid.get(other).map_or(f32::INFINITY, f32::abs)
        };
        let nearest = [0, 1, 2].map(|axis| at(axis, -1).min(at(axis, 1)));
        if let Some(distance) = update(grid.values[slot], nearest, band) {
            grid.values[slot] = distance;
            changed = true;
        }
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::sdf::{SdfParams, Seeds, seeds};

    /// A field on bricks around the origin whose level 1 is the surface of `distance` [m], voxel 1.
    fn shape(half: f32, distance: impl Fn(Vec3) -> f32 + Sync) -> SparseGrid {
        SparseGrid::sample(1.0, Vec3::repeat(-half), Vec3::repeat(half - 1.0), |x| {
            (1.0 - distance(x) / half).max(0.0)
        })
    }

    /// White noise in 0..2 that depends on the place alone.
    fn noise(x: Vec3) -> f32 {
        let key = (x.x as i64 * 73_856_093) ^ (x.y as i64 * 19_349_663) ^ (x.z as i64 * 83_492_791);
        let mixed = (key as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        mixed as f32 / (1 << 23) as f32
    }

    /// Sphere, torus, noise and sparse clumps of noise.
    fn fields() -> Vec<(&'static str, SparseGrid)> {
        let torus = |x: Vec3| ((x.x.hypot(x.y) - 9.0).powi(2) + x.z * x.z).sqrt() - 4.0;
        let clumps = Bricks::new(vec![[0, 0, 0], [1, 0, 0], [1, 1, 0], [3, 0, 0], [0, 1, 2], [-2, -2, -2]]);
        let mut sparse = SparseGrid::new(1.0, clumps, 0.0);
        for slot in 0..sparse.values.len() {
            let node = node_of(sparse.bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES);
            sparse.values[slot] = noise(Vec3::new(node[0] as f32, node[1] as f32, node[2] as f32)) - 0.85;
        }
        vec![
            ("sphere", shape(16.0, |x| (x - Vec3::new(0.3, -0.2, 0.1)).norm() - 9.7)),
            ("torus", shape(16.0, torus)),
            ("noise", SparseGrid::sample(1.0, Vec3::zeros(), Vec3::repeat(15.0), noise)),
            ("sparse", sparse),
        ]
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|v| v.to_bits()).collect()
    }

    #[test]
    fn the_wavefront_has_the_bits_of_the_sequential_sweep() {
        for (name, field) in fields() {
            for band in [3.0, f32::INFINITY] {
                let seeds = seeds(&field, 1.0, &SdfParams { band, ..SdfParams::default() });
                let reference = sweep_in_order(&seeds.bricks, &seeds.distance, band);
                assert!(seeds.pinned > 0 && reference.distance != seeds.distance, "{name} has work to do");
                let cases = [(1, 1), (3, 2), (8, 3), (2, 64), (2, 1), (3, 1), (8, 1), (1, 2)];
                for (threads, block) in cases.into_iter().take(if crate::is_soak() { 8 } else { 4 }) {
                    let swept =
                        par::with_threads(threads, || sweep(&seeds.bricks, &seeds.distance, band, block));
                    let same = bits(&swept.distance) == bits(&reference.distance);
                    assert!(same, "{name}, band {band}, {threads} threads, blocks of {block}");
                    assert_eq!(swept.unreached, reference.unreached);
                    assert!(swept.sweeps <= reference.sweeps + 8);
                }
            }
        }
    }

    #[test]
    fn every_single_sweep_has_the_bits_of_the_sequential_one() {
        // The converged result does not depend on the order, so the distances after every sweep are compared
        // too.
        for (name, field) in fields() {
            let Seeds { bricks, distance, .. } =
                seeds(&field, 1.0, &SdfParams { band: f32::INFINITY, ..SdfParams::default() });
            let mut reference = SparseGrid::of(1.0, bricks, distance.clone());
            let runs = [(1, 1), (2, 1), (3, 1), (8, 1), (1, 2), (8, 2), (3, 3)].map(|(threads, block)| {
                (threads, SweptBricks::new(&reference.bricks, &distance, f32::INFINITY, block))
            });
            for (sweep, order) in ORDERS.into_iter().cycle().take(12).enumerate() {
                one_sweep_in_order(&mut reference, order, f32::INFINITY);
                for (threads, swept) in &runs {
                    par::with_threads(*threads, || swept.sweep(order));
                    let same = bits(&swept.distances()) == bits(&reference.values);
                    assert!(same, "{name}, sweep {sweep}, {threads} threads");
                }
            }
        }
    }

    #[test]
    fn pinned_nodes_keep_their_distance() {
        for (_, field) in fields() {
            let Seeds { bricks, distance, .. } = seeds(&field, 1.0, &SdfParams::default());
            let swept = sweep(&bricks, &distance, 3.0, 1);
            for (before, after) in distance.iter().zip(&swept.distance) {
                assert!(if *before < 0.0 { before == after } else { *after > 0.0 && !after.is_nan() });
                assert!(after.is_infinite() || after.abs() < 3.0);
            }
        }
    }

    #[test]
    fn unreached_nodes_are_counted() {
        // One pinned node; the second brick touches nothing that holds a distance.
        let bricks = Bricks::new(vec![[0, 0, 0], [2, 0, 0]]);
        let mut seeds = vec![f32::INFINITY; 2 * BRICK_NODES];
        seeds[0] = -0.5;
        let swept = sweep(&bricks, &seeds, f32::INFINITY, 1);
        assert_eq!(swept.unreached, BRICK_NODES);
        assert_eq!(swept.distance[7], 7.5);
        assert_eq!(sweep(&bricks, &seeds, 2.0, 1).unreached, 2 * BRICK_NODES - 4);
        assert_eq!(sweep(&Bricks::default(), &[], 3.0, 1).sweeps, 0);
    }
}
