//! Sums over what is near, weighed by a Gaussian.
//!
//! *Method*: for targets and sources alike, with ζ_s the Gaussian of standard deviation s along each axis and s the smaller core of
//! a pair, Σ_q ζ_s(x_p − x_q) a_q. Pairs farther apart than [`REACH`] of s count as nothing. Leaves of the octree look for leaves
//! within the reach of both, the lesser of their widest cores', so cores of any sizes and strays cost what is near them. Vortons of
//! one place and core are one source.

use super::super::{
    Vortons,
    octree::{Octree, representatives},
    pairs,
};
use crate::{
    math::Vec3,
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::{f32::consts::PI, ops::Range};

/// Where the Gaussian ends, in standard deviations. At 3 the edge is one per cent of the middle and lattices show in what
/// spreads; at 5 there are twice the pairs.
pub(super) const REACH: f32 = 4.0;

/// How much of the Gaussian's second moment is within [`REACH`]: that of a sphere, erf(4/√2) − √(2/π)(4 + 4³/3) e⁻⁸.
pub(super) const MOMENT: f32 = 0.993_155_9;

/// Points of a leaf at most: two rows of eight. Four times as many test twice the pairs; half as many cost as much in cells.
const LEAF: usize = 16;

/// Leaves a task works on.
const TASK: usize = 16;

/// Vortons in the order of an octree, to be summed over more than once.
pub(super) struct Near {
    tree: Octree,
    leaves: Vec<u32>,
    /// Where each leaf ends in the order.
    ends: Vec<usize>,
    /// The widest core of every cell [m].
    widest: Vec<f32>,
    /// Vortons of one place and core, more than a leaf has: stretches of the order.
    heaps: Vec<Range<usize>>,
    /// ζ_s(0)/s² of every vorton, in its own order [1/m⁵].
    middles: Vec<f32>,
    /// Positions [m] and 1/s² [1/m²] in the order.
    places: Vec<[f32; 4]>,
}

/// What weighs a pair.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weight {
    /// ζ_s [1/m³].
    Density,
    /// ζ_s/s² [1/m⁵].
    Diffusion,
}

/// A source: position, 1/s², and what is summed.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
struct Source([f32; 8]);

impl Near {
    /// Orders vortons.
    pub(super) fn new(vortons: &Vortons) -> Self {
        let mut tree = Octree::new(&vortons.position, LEAF);
        let heaps = tree.group_coincident(&vortons.core, LEAF);
        let (leaves, ends) = tree.leaves();
        let widest = tree.reduce_up(0.0, f32::max, |i| vortons.core[i]);
        let mut places = vec![[0.0; 4]; vortons.len()];
        par::fill(&mut places, |at| {
            let i = tree.order[at] as usize;
            let (x, s) = (vortons.position[i], vortons.core[i]);
            [x.x, x.y, x.z, (s * s).recip()]
        });
        let mut middles = vec![0.0; vortons.len()];
        par::fill(&mut middles, |i| unit() / vortons.core[i].powi(5));
        Self { tree, leaves, ends, widest, heaps, places, middles }
    }

    /// The weight of [`Weight::Diffusion`] that a vorton has for itself [1/m⁵].
    pub(super) fn own(&self, i: usize) -> f32 {
        self.middles[i]
    }

    /// The sums of `carried(i)` over all that is near each vorton, itself included.
    pub(super) fn sums(&self, weight: Weight, carried: impl Fn(usize) -> [f32; 4] + Sync) -> Vec<[f32; 4]> {
        let count = self.places.len();
        let mut sources = vec![Source([0.0; 8]); count];
        par::fill(&mut sources, |at| {
            let ([x, y, z, i], [a, b, c, d]) = (self.places[at], carried(self.tree.order[at] as usize));
            Source([x, y, z, i, a, b, c, d])
        });
        for heap in &self.heaps {
            gather(&mut sources[heap.clone()]);
        }
        let mut sorted = vec![[0.0; 4]; count];
        par::for_parts(&mut sorted, &self.ends, TASK, |leaf, out| {
            let near = self.around(self.leaves[leaf] as usize);
            let start = self.ends[leaf] - out.len();
            let targets = &self.places[start..self.ends[leaf]];
            simd::dispatch(Around { targets, near: &near, sources: &sources, weight, out });
        });
        let mut inverse = par::Inverse::default();
        inverse.rebuild(&self.tree.order);
        let mut out = vec![[0.0; 4]; count];
        par::fill(&mut out, |i| sorted[inverse.of(i)]);
        out
    }

    /// The leaves within reach of a leaf, as stretches of the order; of heaps their one source.
    fn around(&self, leaf: usize) -> Vec<Range<usize>> {
        let (cells, own) = (&self.tree.cells, &self.tree.cells[leaf]);
        let (mut near, mut open) = (Vec::new(), vec![0_usize]);
        while let Some(c) = open.pop() {
            let cell = &cells[c];
            let reach = own.radius + cell.radius + REACH * self.widest[leaf].min(self.widest[c]);
            if (cell.center - own.center).norm() > reach * 1.000_01 {
                continue;
            }
            match cell.is_leaf() {
                true if self.heaps.is_empty() => near.push(cell.places()),
                true => near.extend(representatives(cell.places(), &self.heaps)),
                false => open.extend(cell.children().rev()),
            }
        }
        near
    }
}

/// Makes the first source of a heap the sum of all.
fn gather(heap: &mut [Source]) {
    let sum = |k: usize| heap.iter().map(|Source(q)| f64::from(q[k])).sum::<f64>() as f32;
    let sums = [4, 5, 6, 7].map(sum);
    heap[0].0[4..].copy_from_slice(&sums);
}

/// The Gaussian's middle, for a standard deviation of 1.
fn unit() -> f32 {
    (2.0 * PI).powf(-1.5)
}

/// The sums of a leaf.
struct Around<'a> {
    targets: &'a [[f32; 4]],
    near: &'a [Range<usize>],
    sources: &'a [Source],
    weight: Weight,
    out: &'a mut [[f32; 4]],
}

impl Pass for Around<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (reach2, half) = (splat::<L>(REACH * REACH), splat::<L>(-0.5));
        let (zero, unit) = (splat::<L>(0.0), splat::<L>(unit()));
        for (targets, out) in self.targets.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let at = |lane: usize| targets[lane.min(targets.len() - 1)];
            let x = pairs::columns::<L>(|lane| Vec3::new(at(lane)[0], at(lane)[1], at(lane)[2]));
            let own = L::load(&std::array::from_fn(|lane| at(lane)[3]));
            let mut sums = [zero; 4];
            for Source(q) in self.near.iter().flat_map(|range| &self.sources[range.clone()]) {
                let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
                let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                // The larger 1/s² is that of the smaller core.
                let other = splat::<L>(q[3]);
                let inverse = L::select(own.less(other), other, own);
                let rho2 = r2 * inverse;
                let zeta = (unit * inverse) * (inverse.sqrt() * (half * rho2).exp());
                let full = if self.weight == Weight::Diffusion { zeta * inverse } else { zeta };
                let weight = L::select(rho2.less(reach2), full, zero);
                for k in 0..4 {
                    sums[k] += weight * splat(q[4 + k]);
                }
            }
            let rows = sums.map(L::to_array);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = std::array::from_fn(|k| rows[k][lane]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cloud of vortons whose cores, and some of whose places, are as `change` says.
    fn cloud(change: impl Fn(usize, &mut Vec3, &mut f32)) -> Vortons {
        let noise = |i: usize| ((i * 7919) % 10_007) as f32 / 10_007.0;
        let mut vortons = Vortons::default();
        for i in 0..2000 {
            let (mut x, mut core) = (Vec3::new(noise(3 * i), noise(5 * i + 1), noise(11 * i + 2)), 0.02);
            change(i, &mut x, &mut core);
            vortons.position.push(x);
            vortons.strength.push(Vec3::zeros());
            vortons.core.push(core);
        }
        vortons
    }

    fn carried(i: usize) -> [f32; 4] {
        [1.0, i as f32, (i % 7) as f32, -0.5]
    }

    /// The places that are tested, of all leaves.
    fn tested(near: &Near) -> usize {
        let leaf = |&leaf: &u32| {
            let targets = near.tree.cells[leaf as usize].count();
            targets * near.around(leaf as usize).iter().map(Range::len).sum::<usize>()
        };
        near.leaves.iter().map(leaf).sum()
    }

    fn agree(vortons: &Vortons) {
        let found = Near::new(vortons).sums(Weight::Density, carried);
        for p in (0..vortons.len()).step_by(97) {
            let mut exact = [0.0_f64; 4];
            for q in 0..vortons.len() {
                let s = vortons.core[p].min(vortons.core[q]);
                let rho2 = (vortons.position[p] - vortons.position[q]).norm_squared() / (s * s);
                if rho2 < REACH * REACH {
                    let zeta = f64::from(unit() / s.powi(3)) * f64::from(-0.5 * rho2).exp();
                    (0..4).for_each(|k| exact[k] += zeta * f64::from(carried(q)[k]));
                }
            }
            for k in 0..4 {
                let off = (f64::from(found[p][k]) - exact[k]).abs();
                assert!(off <= 1e-4 * exact[k].abs() + 1e-3, "{p}: {:?} for {exact:?}", found[p]);
            }
        }
    }

    #[test]
    fn wide_cores_among_narrow_ones_look_no_farther() {
        let even = tested(&Near::new(&cloud(|_, _, _| {})));
        let mixed = cloud(|i, _, core| {
            if i % 20 == 0 {
                *core = 0.3;
            }
        });
        agree(&mixed);
        // Leaves with a wide core reach each other, which are two of three, but those without only as far as before.
        let few = cloud(|i, _, core| {
            if i % 400 == 0 {
                *core = 0.3;
            }
        });
        agree(&few);
        let wide = tested(&Near::new(&few));
        assert!((wide as f64) < 1.1 * even as f64, "{wide} for {even}");
    }

    #[test]
    fn heaps_are_one_source() {
        let heap = |i: usize, x: &mut Vec3, core: &mut f32| {
            if i.is_multiple_of(2) {
                (*x, *core) = (Vec3::repeat(0.4), if i.is_multiple_of(4) { 0.02 } else { 0.05 });
            }
        };
        let vortons = cloud(heap);
        agree(&vortons);
        let (heaped, even) = (tested(&Near::new(&vortons)), tested(&Near::new(&cloud(|_, _, _| {}))));
        assert!(heaped < 3 * even, "{heaped} for {even}");
    }
}
