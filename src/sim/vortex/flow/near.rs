//! Sums over what is near, weighed by a Gaussian.
//!
//! *Method*: for targets and sources alike, with ζ_s the Gaussian of standard deviation s along each axis and s the smaller core of
//! a pair, Σ_q ζ_s(x_p − x_q) a_q. Pairs farther apart than [`REACH`] of s count as nothing. Leaves of the octree look for leaves
//! within their own reach, so cores of any sizes, strays and heaps cost what is near them.

use super::super::{
    Vortons,
    lanes::{self, LANES, Lanes, Pass, splat},
    octree::Octree,
    pairs,
};
use crate::{math::Vec3, par};
use std::f32::consts::PI;

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
        let tree = Octree::new(&vortons.position, LEAF);
        let mut leaves: Vec<u32> =
            (0..tree.cells.len() as u32).filter(|&c| tree.cells[c as usize].is_leaf()).collect();
        leaves.sort_unstable_by_key(|&c| tree.cells[c as usize].places().start);
        let ends = leaves.iter().map(|&c| tree.cells[c as usize].places().end).collect();
        let mut places = vec![[0.0; 4]; vortons.len()];
        par::fill(&mut places, |at| {
            let i = tree.order[at] as usize;
            let (x, s) = (vortons.position[i], vortons.core[i]);
            [x.x, x.y, x.z, (s * s).recip()]
        });
        let mut middles = vec![0.0; vortons.len()];
        par::fill(&mut middles, |i| unit() / vortons.core[i].powi(5));
        Self { tree, leaves, ends, places, middles }
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
        let mut sorted = vec![[0.0; 4]; count];
        par::for_parts(&mut sorted, &self.ends, TASK, |leaf, out| {
            let near = self.around(self.leaves[leaf] as usize);
            let start = self.ends[leaf] - out.len();
            let targets = &self.places[start..self.ends[leaf]];
            lanes::run(Around { targets, near: &near, sources: &sources, weight, out });
        });
        let mut inverse = par::Inverse::default();
        inverse.rebuild(&self.tree.order);
        let mut out = vec![[0.0; 4]; count];
        par::fill(&mut out, |i| sorted[inverse.of(i)]);
        out
    }

    /// The leaves within reach of a leaf, as stretches of the order.
    fn around(&self, leaf: usize) -> Vec<std::ops::Range<usize>> {
        let (cells, own) = (&self.tree.cells, &self.tree.cells[leaf]);
        let narrowest = self.places[own.places()].iter().map(|place| place[3]).fold(f32::INFINITY, f32::min);
        let reach = own.radius + REACH / narrowest.sqrt();
        let (mut near, mut open) = (Vec::new(), vec![0_usize]);
        while let Some(c) = open.pop() {
            let cell = &cells[c];
            if (cell.center - own.center).norm() > (reach + cell.radius) * 1.000_01 {
                continue;
            }
            match cell.is_leaf() {
                true => near.push(cell.places()),
                false => open.extend(cell.children().rev()),
            }
        }
        near
    }
}

/// The Gaussian's middle, for a standard deviation of 1.
fn unit() -> f32 {
    (2.0 * PI).powf(-1.5)
}

/// The sums of a leaf.
struct Around<'a> {
    targets: &'a [[f32; 4]],
    near: &'a [std::ops::Range<usize>],
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
                let inverse = own.below(other, other, own);
                let rho2 = r2 * inverse;
                let zeta = (unit * inverse) * (inverse.sqrt() * (half * rho2).exp());
                let full = if self.weight == Weight::Diffusion { zeta * inverse } else { zeta };
                let weight = rho2.below(reach2, full, zero);
                for k in 0..4 {
                    sums[k] += weight * splat(q[4 + k]);
                }
            }
            let rows = sums.map(L::row);
            for (lane, out) in out.iter_mut().enumerate() {
                *out = std::array::from_fn(|k| rows[k][lane]);
            }
        }
    }
}
