//! A tree of boxes over triangles that move, and the pairs of them that may come close.
//!
//! *Method*: a binary tree of bounding boxes over triangles in the order of their places at the start along Morton's curve; its shape stays,
//! its boxes are found again for each search. A box has the places at the start of a span of time and the ways during it, so that what moves
//! together is not taken for something that sweeps over the whole way ([hubbard95]'s swept boxes, seen from each other).
//!
//! Limits: a sheet that is turned inside out keeps the order that it began with, and so do its boxes: they grow with how far what was near has
//! moved apart.

use super::elements::Elements;
use crate::{math::Vec3, par, sim::sheet::lanes::Vectors};

/// Triangles of a leaf.
const LEAF: usize = 4;

/// Leaves that a task looks up.
const TASK: usize = 16;

/// Where something is, and the ways of its parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Swept {
    low: Vec3,
    high: Vec3,
    least: Vec3,
    most: Vec3,
}

impl Swept {
    /// Nothing.
    fn none() -> Self {
        let all = Vec3::repeat(f32::INFINITY);
        Self { low: all, high: -all, least: all, most: -all }
    }

    /// A point and its way.
    #[inline]
    pub(super) fn of([x, way]: Moving) -> Self {
        Self { low: x, high: x, least: way, most: way }
    }

    #[inline]
    pub(super) fn and(self, other: Self) -> Self {
        Self {
            low: self.low.inf(&other.low),
            high: self.high.sup(&other.high),
            least: self.least.inf(&other.least),
            most: self.most.sup(&other.most),
        }
    }

    /// Whether the two can come within `reach` of each other along any axis.
    #[inline]
    pub(super) fn meets(&self, other: &Self, reach: f32) -> bool {
        let mut apart = false;
        for axis in 0..3 {
            let one = self.low[axis] - other.high[axis] + (self.least[axis] - other.most[axis]).min(0.0);
            let two = other.low[axis] - self.high[axis] + (other.least[axis] - self.most[axis]).min(0.0);
            apart |= one.max(two) > reach;
        }
        !apart
    }
}

/// A place and a way.
pub(super) type Moving = [Vec3; 2];

/// All points, each with its place and its way together: they are read in no order.
pub(super) fn moving(x: &Vectors, way: impl Fn(usize) -> Vec3 + Sync) -> Vec<Moving> {
    let mut out = par::repeated([Vec3::zeros(); 2], x.len());
    par::fill(&mut out, |i| [x.get(i), way(i)]);
    out
}

/// The shape of the tree.
#[derive(Debug)]
pub(super) struct Tree {
    /// Triangles in the order of the leaves.
    order: Vec<u32>,
}

/// The boxes of a tree at a time.
#[derive(Debug)]
pub(super) struct Boxes {
    /// Of the triangles, in their order.
    triangles: Vec<Swept>,
    /// The root is 1, the children of k are 2 k and 2 k + 1; the second half are the leaves.
    nodes: Vec<Swept>,
}

impl Tree {
    /// Over the triangles where they are at the start.
    pub(super) fn new(elements: &Elements) -> Self {
        let all = elements.rest.iter().copied();
        let low = all.clone().fold(Vec3::repeat(f32::INFINITY), |low, x| low.inf(&x));
        let high = all.fold(Vec3::repeat(f32::NEG_INFINITY), |high, x| high.sup(&x));
        let scale = f64::from(1 << 20) / f64::from((high - low).max()).max(f64::from(f32::MIN_POSITIVE));
        let mut keys: Vec<(u64, u32)> = Vec::with_capacity(elements.triangles.len());
        for (number, corners) in elements.triangles.iter().enumerate() {
            let centre = corners.map(|i| elements.rest[i as usize] - low).iter().sum::<Vec3>() / 3.0;
            let cell = centre.map(|v| (f64::from(v) * scale) as u64);
            keys.push((spread(cell.x) | spread(cell.y) << 1 | spread(cell.z) << 2, number as u32));
        }
        par::sort_by_key(&mut keys, |&key| key);
        Self { order: keys.into_iter().map(|(_, number)| number).collect() }
    }

    /// The boxes for places and ways.
    pub(super) fn boxes(&self, elements: &Elements, points: &[Moving]) -> Boxes {
        let swept = |i: u32| Swept::of(points[i as usize]);
        let mut triangles = par::repeated(Swept::none(), self.order.len());
        par::fill(&mut triangles, |k| {
            let [a, b, c] = elements.triangles[self.order[k] as usize];
            swept(a).and(swept(b)).and(swept(c))
        });
        let leaves = self.order.len().div_ceil(LEAF);
        let mut level = leaves.next_power_of_two();
        let mut nodes = par::repeated(Swept::none(), 2 * level);
        par::fill(&mut nodes[level..level + leaves], |leaf| {
            let own = &triangles[leaf * LEAF..triangles.len().min((leaf + 1) * LEAF)];
            own.iter().fold(Swept::none(), |all, one| all.and(*one))
        });
        while level > 1 {
            let (above, own) = nodes.split_at_mut(level);
            par::fill(&mut above[level / 2..], |k| own[2 * k].and(own[2 * k + 1]));
            level /= 2;
        }
        Boxes { triangles, nodes }
    }

    /// The leaves with a triangle of which a corner is meant.
    pub(super) fn leaves_with(&self, elements: &Elements, is_meant: impl Fn(u32) -> bool) -> Vec<bool> {
        let has = |k: &u32| elements.triangles[*k as usize].iter().any(|&i| is_meant(i));
        self.order.chunks(LEAF).map(|leaf| leaf.iter().any(has)).collect()
    }

    /// Calls `f(found, triangle, other, the box of each)` for every pair of triangles that may come within `reach`, of some leaves those with one in a leaf that is `meant`, and returns what it found, in an
    /// order that does not depend on the threads.
    pub(super) fn pairs<T: Send>(
        &self,
        boxes: &Boxes,
        reach: f32,
        meant: Option<&[bool]>,
        f: impl Fn(&mut Vec<T>, [u32; 2], [&Swept; 2]) + Sync,
    ) -> Vec<Vec<T>> {
        let leaves = boxes.nodes.len() / 2;
        par::map_chunks(self.order.len().div_ceil(LEAF), TASK, |range| {
            let (mut found, mut stack) = (Vec::new(), Vec::new());
            let is_meant = |leaf: usize| meant.is_none_or(|meant| meant[leaf]);
            for leaf in range.filter(|&leaf| is_meant(leaf)) {
                let own = &boxes.nodes[leaves + leaf];
                stack.push((1, leaves));
                while let Some((node, under)) = stack.pop() {
                    // The last leaf under a node; those before this one have looked for it themselves.
                    let is_past = (node + 1) * under - leaves <= leaf
                        && (meant.is_none() || (under == 1 && is_meant(node - leaves)));
                    if is_past || !own.meets(&boxes.nodes[node], reach) {
                        continue;
                    }
                    if under > 1 {
                        stack.push((2 * node + 1, under / 2));
                        stack.push((2 * node, under / 2));
                    } else {
                        self.leaves(boxes, reach, [leaf, node - leaves], &f, &mut found);
                    }
                }
            }
            found
        })
    }

    fn leaves<T>(
        &self,
        boxes: &Boxes,
        reach: f32,
        [one, two]: [usize; 2],
        f: &impl Fn(&mut Vec<T>, [u32; 2], [&Swept; 2]),
        found: &mut Vec<T>,
    ) {
        let of = |leaf: usize| leaf * LEAF..self.order.len().min((leaf + 1) * LEAF);
        for i in of(one) {
            for j in of(two).filter(|&j| one != two || j > i) {
                let both = [&boxes.triangles[i], &boxes.triangles[j]];
                if both[0].meets(both[1], reach) {
                    f(found, [self.order[i], self.order[j]], both);
                }
            }
        }
    }
}

/// Every third bit from one of 21.
fn spread(v: u64) -> u64 {
    let mut v = v & 0x1f_ffff;
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        v = (v | v << shift) & mask;
    }
    v
}
