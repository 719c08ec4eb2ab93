//! Second-order Eikonal solve: the first-order distances give each node's upwind stencil, and one more solve
//! with differences of second order improves its distance.
//!
//! *Method* [sethian99]: one-sided differences of second order where two upwind nodes lie in a row, of first
//! order where one does. Along each axis the stencil holds the neighbour with the smaller first-order
//! distance, and the node behind it if that is nearer still. Every stencil holds only nearer nodes, so a
//! node's distance follows once those of its stencil are known. Sweeps in eight orders over blocks, as at
//! first order, find such nodes, and no node is computed twice. The result does not depend on the order in
//! which that happens.
//!
//! *Departs from the papers*: the first-order distance replaces the order of acceptance. Across the surface a
//! pinned distance counts as negative, so that nodes just behind one layer of pinned nodes have second order
//! too. An axis along which the solution would not ascend is dropped, the one with the farthest neighbour
//! first.
//!
//! Symbols: u distance of second, v of first order [voxels]; u₁, u₂ the first and second node upwind.
//!
//! Limits: first order where fronts collide and behind sharp edges, whose distance has a kink; second order
//! elsewhere.

use super::{Swept, godunov::ORDERS};
use crate::par;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, AtomicU16, AtomicU32, Ordering};

/// How nodes are connected, and the blocks they are swept in.
pub trait Nodes: Sync {
    /// A node's place, from which its neighbours are found.
    type At: Copy;

    /// How many blocks there are.
    fn blocks(&self) -> usize;

    /// How many nodes a block has.
    fn size(&self, block: usize) -> usize;

    /// Calls `work` for every block, after its predecessors in the direction of the sweep.
    fn wavefront(&self, order: [i32; 3], work: impl Fn(usize) + Sync);

    /// Calls `f` for every block with a node two steps or fewer along an axis from one of this block's.
    fn for_each_near(&self, block: usize, f: impl FnMut(usize));

    /// Calls `f(place in the block, node)` for every node of a block in the order of the sweep.
    fn for_each(&self, block: usize, order: [i32; 3], f: impl FnMut(usize, Self::At));

    /// The index of a node among all.
    fn slot(&self, at: Self::At) -> usize;

    /// The next node beyond a face (−x, +x, −y, +y, −z, +z), if there is one.
    fn next(&self, at: Self::At, face: usize) -> Option<Self::At>;

    /// The index of a next node that is known to exist.
    fn step(&self, slot: usize, face: usize) -> usize;
}

/// The order of the differences that the Eikonal equation is solved with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Order {
    /// First order: the error is a few tenths of a voxel far from the surface.
    #[default]
    First,
    /// Second order: a tenth of the error, at a few times the cost.
    Second,
}

impl Order {
    /// The band of the first-order sweeps [voxels] that reaches every node within `band`. At second order it
    /// is wider: a node's first-order distance is larger by a few tenths of a voxel, and by one for tiny
    /// balls.
    pub fn reach(self, band: f32) -> f32 {
        match self {
            Self::First => band,
            Self::Second => 1.0 + 1.1 * band,
        }
    }
}

/// Second-order distances below `band` from the first-order ones; `inside` is the indicator.
pub fn refine<N: Nodes>(nodes: &N, first: Swept, band: f32, inside: impl Fn(usize) -> bool + Sync) -> Swept {
    let Swept { distance: first, sweeps: mut total, .. } = first;
    // The stencil of each node, and how many of a block's nodes wait for a distance.
    let stencils: Vec<Vec<AtomicU16>> = par::map(nodes.blocks(), |block| {
        let mut stencils = vec![0; nodes.size(block)];
        nodes.for_each(block, [1; 3], |place, at| stencils[place] = stencil(nodes, &first, &inside, at));
        stencils.into_iter().map(AtomicU16::new).collect()
    });
    let unsolved = |block: usize| stencils[block].iter().filter(|s| s.load(Ordering::Relaxed) != 0).count();
    let waiting: Vec<AtomicU32> = par::map(nodes.blocks(), |block| AtomicU32::new(unsolved(block) as u32));

    // Distances are written once, ∞ until then; the wavefront orders reads of nodes in other blocks.
    let known = |v: f32| AtomicU32::new(if v < 0.0 { -v } else { f32::INFINITY }.to_bits());
    let mut distance: Vec<AtomicU32> = (0..first.len()).map(|_| AtomicU32::new(0)).collect();
    par::fill(&mut distance, |slot| known(first[slot]));
    let active: Vec<AtomicBool> = (0..nodes.blocks()).map(|_| AtomicBool::new(true)).collect();
    let mut sweeps = 0;
    while (0..nodes.blocks())
        .any(|block| active[block].load(Ordering::Relaxed) && waiting[block].load(Ordering::Relaxed) > 0)
    {
        let order = ORDERS[sweeps % ORDERS.len()];
        nodes.wavefront(order, |block| {
            let before = waiting[block].load(Ordering::Relaxed);
            if before == 0 || !active[block].load(Ordering::Relaxed) {
                return;
            }
            let mut found = 0;
            nodes.for_each(block, order, |place, at| {
                let stencil = stencils[block][place].load(Ordering::Relaxed);
                if stencil == 0 {
                    return;
                }
                let slot = nodes.slot(at);
                if let Some(u) = distance_at(nodes, &distance, slot, stencil) {
                    distance[slot].store(u.to_bits(), Ordering::Relaxed);
                    stencils[block][place].store(0, Ordering::Relaxed);
                    found += 1;
                }
            });
            // A node that is not ready stays so, in any order, until a node near it has its distance.
            waiting[block].store(before - found, Ordering::Relaxed);
            active[block].store(found > 0, Ordering::Relaxed);
            if found > 0 {
                nodes.for_each_near(block, |other| active[other].store(true, Ordering::Relaxed));
            }
        });
        sweeps += 1;
    }
    total += sweeps;
    let waits = waiting.iter().any(|waiting| waiting.load(Ordering::Relaxed) > 0);
    assert!(!waits, "a stencil holds only nearer nodes, so none waits for itself");

    let mut refined = first;
    par::update(&mut refined, |slot, v| {
        if *v >= 0.0 {
            let u = f32::from_bits(distance[slot].load(Ordering::Relaxed));
            *v = if u < band { u } else { f32::INFINITY };
        }
    });
    Swept::new(refined, total)
}

/// A stencil has three bits per axis: no node (0), one (`ONE`), two (`TWO`), or two with the surface between
/// them (`ACROSS`); plus `HIGH` where they are the higher neighbours.
const ONE: u16 = 1;
const TWO: u16 = 2;
const ACROSS: u16 = 3;
const HIGH: u16 = 4;

/// The upwind stencil of a node; 0 for one that is pinned or that no front reached.
#[inline]
fn stencil<N: Nodes>(nodes: &N, first: &[f32], inside: &(impl Fn(usize) -> bool + Sync), at: N::At) -> u16 {
    let own = first[nodes.slot(at)];
    if !(own >= 0.0 && own.is_finite()) {
        return 0;
    }
    let magnitude = |at: Option<N::At>| at.map_or(f32::INFINITY, |at| first[nodes.slot(at)].abs());
    let mut all = 0;
    for axis in 0..3 {
        let sides = [nodes.next(at, 2 * axis), nodes.next(at, 2 * axis + 1)];
        let (low, high) = (magnitude(sides[0]), magnitude(sides[1]));
        let side = usize::from(high < low);
        let (Some(near), near_magnitude) = (sides[side], if side == 1 { high } else { low }) else {
            continue;
        };
        if near_magnitude >= own {
            continue;
        }
        let far = nodes.next(near, 2 * axis + side);
        let across = far.is_some_and(|far| {
            let pinned = first[nodes.slot(far)] < 0.0 && first[nodes.slot(near)] < 0.0;
            pinned && inside(nodes.slot(far)) != inside(nodes.slot(near))
        });
        let kind = match () {
            () if across => ACROSS,
            () if magnitude(far) < near_magnitude => TWO,
            () => ONE,
        };
        all |= (kind | if side == 1 { HIGH } else { 0 }) << (3 * axis);
    }
    all
}

/// The distance of a node, if those of its stencil are known.
#[inline]
fn distance_at<N: Nodes>(nodes: &N, distance: &[AtomicU32], slot: usize, stencil: u16) -> Option<f32> {
    let read = |slot: usize| f32::from_bits(distance[slot].load(Ordering::Relaxed));
    let mut near = [f32::INFINITY; 3];
    // The slope between the two nodes of an axis; below zero where there is no second one.
    let mut slope = [-1.0; 3];
    for axis in 0..3 {
        let code = stencil >> (3 * axis);
        if code & 3 == 0 {
            continue;
        }
        let face = 2 * axis + usize::from(code & HIGH != 0);
        let one = nodes.step(slot, face);
        near[axis] = read(one);
        if near[axis] == f32::INFINITY {
            return None;
        }
        if code & 3 >= TWO {
            let two = read(nodes.step(one, face));
            if two == f32::INFINITY {
                return None;
            }
            slope[axis] = if code & 3 == ACROSS { near[axis] + two } else { near[axis] - two };
        }
    }
    Some(upwind(near, slope))
}

/// The root of Σ (∂u)² = 1 with one-sided differences: (u − u₁), or (3u − 4u₁ + u₂)/2 where `slope` = u₁ − u₂
/// ≥ 0. `near` is u₁, ∞ for an axis without a node; at least one is finite.
#[inline]
fn upwind(near: [f32; 3], slope: [f32; 3]) -> f32 {
    // Everything relative to the lowest neighbour: each axis is w (u − t)², w = 9/4 and t = u₁ + (u₁ − u₂)/3
    // at second order, w = 1 and t = u₁ at first.
    let base = near[0].min(near[1]).min(near[2]);
    let mut axes = [0, 1, 2].map(|axis| {
        let second = slope[axis] >= 0.0;
        let u1 = near[axis] - base;
        (u1, if second { u1 + slope[axis] / 3.0 } else { u1 }, if second { 2.25 } else { 1.0_f32 })
    });
    // Nearest neighbour first.
    for (i, j) in [(0, 1), (1, 2), (0, 1)] {
        if axes[j].0 < axes[i].0 {
            axes.swap(i, j);
        }
    }
    for count in [3, 2] {
        let (farthest, _, _) = axes[count - 1];
        if farthest == f32::INFINITY {
            continue;
        }
        let (mut w, mut wt, mut wtt) = (0.0, 0.0, 0.0);
        for &(_, t, weight) in &axes[..count] {
            w += weight;
            wt += weight * t;
            wtt += weight * t * t;
        }
        let under = wt * wt - w * (wtt - 1.0);
        let u = (wt + under.max(0.0).sqrt()) / w;
        if under >= 0.0 && u >= farthest {
            return base + u;
        }
    }
    let (_, t, w) = axes[0];
    base + t + if w > 1.0 { 2.0 / 3.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{BRICK_NODES, Bricks, SparseGrid, is_set};
    use crate::math::Vec3;
    use crate::sdf::{SdfParams, SeedRule, linked::LinkedBricks, seeds};

    /// Every node once, in ascending order of its distance of first order.
    fn in_order<N: Nodes>(nodes: &N, first: &[f32], inside: impl Fn(usize) -> bool + Sync) -> Vec<f32> {
        let mut all = Vec::new();
        for block in 0..nodes.blocks() {
            nodes.for_each(block, [1; 3], |_, at| {
                let slot = nodes.slot(at);
                all.push((first[slot], slot, stencil(nodes, first, &inside, at)));
            });
        }
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let distance: Vec<AtomicU32> = first.iter().map(|v| AtomicU32::new(v.abs().to_bits())).collect();
        for (v, slot, stencil) in all {
            if v >= 0.0 && v.is_finite() {
                let u = distance_at(nodes, &distance, slot, stencil).expect("nearer nodes come first");
                distance[slot].store(u.to_bits(), Ordering::Relaxed);
            }
        }
        let value = |i: usize| f32::from_bits(distance[i].load(Ordering::Relaxed));
        (0..first.len()).map(|i| if first[i] < 0.0 { first[i] } else { value(i) }).collect()
    }

    fn bits(values: &[f32]) -> Vec<u32> {
        values.iter().map(|v| v.to_bits()).collect()
    }

    #[test]
    fn bricks_have_the_bits_of_every_node_once() {
        let clumps = Bricks::new(vec![[0, 0, 0], [1, 0, 0], [1, 1, 0], [3, 0, 0], [0, 1, 2], [-2, -2, -2]]);
        let mut field = SparseGrid::new(1.0, clumps, 0.0);
        for (i, value) in field.values.iter_mut().enumerate() {
            *value = ((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / (1 << 23) as f32 - 0.8;
        }
        for band in [3.0, f32::INFINITY] {
            let params = SdfParams { band, seed: SeedRule::Plane, order: Order::Second, block: 1 };
            let seeds = seeds(&field, 1.0, &params);
            let inside = |i: usize| is_set(&seeds.inside[i / BRICK_NODES], i % BRICK_NODES);
            let first = crate::sdf::sweep(&seeds.bricks, &seeds.distance, band, 1);
            let linked = LinkedBricks::new(&seeds.bricks, 1);
            let reference = in_order(&linked, &first.distance, inside);
            for (threads, block) in [(1, 1), (2, 1), (5, 1), (1, 3), (5, 2)] {
                let linked = LinkedBricks::new(&seeds.bricks, block);
                let found = crate::par::with_threads(threads, || {
                    refine(&linked, first.clone(), f32::INFINITY, inside)
                });
                assert!(seeds.pinned > 100 && bits(&found.distance) == bits(&reference));
            }
        }
    }

    #[test]
    fn planes_are_exact_at_either_order_and_parabolas_at_second() {
        for n in [Vec3::new(1.0, 2.0, 3.0), Vec3::new(4.0, 1.0, 0.5), Vec3::new(0.0, 3.0, 1.0)] {
            let n = n.normalize();
            for far in [2.0, 5.0, 4000.0] {
                for second in [false, true] {
                    let near = [0, 1, 2].map(|axis| far - n[axis]);
                    let slope = [0, 1, 2].map(|axis| if second { n[axis] } else { -1.0 });
                    assert!((upwind(near, slope) - far).abs() < 6.0 * f32::EPSILON * far.max(1.0));
                }
            }
        }
        // u = x²/4 + … has slope 1 at x = 2 and is exact there: u₁ = 1/4, u₂ = 0.
        assert!((upwind([0.25, f32::INFINITY, f32::INFINITY], [0.25, -1.0, -1.0]) - 1.0).abs() < 1e-6);
        // An axis along which the solution would descend is dropped.
        assert_eq!(upwind([2.0, 9.0, f32::INFINITY], [-1.0, -1.0, -1.0]), 3.0);
    }
}
