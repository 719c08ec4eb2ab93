//! Sums over the neighbours of vortons, weighted by a Gaussian.
//!
//! *Method*: Σ_q ζ_s(x_p − x_q) a_q, with ζ_s the Gaussian of standard deviation s along each axis and s the
//! smaller core of a pair. Pairs at a larger distance than [`CUTOFF`] · s are omitted. Leaves of the octree
//! search leaves within the cutoff of the smaller of both widest cores. So cores of any size and strays cost
//! no more than their neighbours. Coincident vortons of one core are one source.

use super::super::{
    Vortons,
    octree::{CellIndex, Octree, representatives},
    pairs,
};
use crate::math::elementary::powf;
use crate::{
    math::Vec3,
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};
use std::{f32::consts::PI, ops::Range};

/// The cutoff of the Gaussian, in standard deviations. At 3 the value there is one per cent of the maximum,
/// and the grid of vortons becomes visible in their diffusion; at 5 there are twice the pairs.
pub(super) const CUTOFF: f32 = 4.0;

/// The fraction of the second moment of the Gaussian within [`CUTOFF`]: for a sphere, erf(4/√2) − √(2/π)(4 +
/// 4³/3) e⁻⁸.
pub(super) const SECOND_MOMENT_WITHIN_CUTOFF: f32 = 0.993_155_9;

/// Points per leaf at most: two rows of eight. Four times as many test twice the pairs; half as many cost as
/// much in cells.
const MAX_LEAF_POINTS: usize = 16;

/// Leaves per task.
const LEAVES_PER_TASK: usize = 16;

/// Vortons in the order of an octree, for repeated sums over neighbours.
pub(super) struct NeighbourSums {
    tree: Octree,
    leaves: Vec<CellIndex>,
    /// The end of each leaf in the order.
    ends: Vec<usize>,
    /// The widest core of every cell [m].
    widest: Vec<f32>,
    /// Ranges of coincident vortons in the order.
    coincident: Vec<Range<usize>>,
    /// ζ_s(0)/s² of every vorton [1/m⁵].
    center_weights: Vec<f32>,
    /// Positions [m] and 1/s² [1/m²] in the order.
    positions: Vec<[f32; 4]>,
}

/// The weight of a pair.
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

impl NeighbourSums {
    /// Sorts vortons for sums over their neighbours.
    pub(super) fn new(vortons: &Vortons) -> Self {
        let mut tree = Octree::new(&vortons.position, MAX_LEAF_POINTS);
        let coincident = tree.group_coincident(&vortons.core, MAX_LEAF_POINTS);
        let (leaves, ends) = tree.leaves();
        let widest = tree.reduce_up(0.0, f32::max, |i| vortons.core[i]);
        let mut positions = vec![[0.0; 4]; vortons.len()];
        par::fill(&mut positions, |at| {
            let i = tree.order[at] as usize;
            let (x, s) = (vortons.position[i], vortons.core[i]);
            [x.x, x.y, x.z, (s * s).recip()]
        });
        let mut center_weights = vec![0.0; vortons.len()];
        par::fill(&mut center_weights, |i| unit_gaussian() / vortons.core[i].powi(5));
        Self { tree, leaves, ends, widest, coincident, positions, center_weights }
    }

    /// The weight of [`Weight::Diffusion`] of a vorton for itself [1/m⁵].
    pub(super) fn weight_of_itself(&self, i: usize) -> f32 {
        self.center_weights[i]
    }

    /// The weighted sums of `values(i)` over the neighbours of each vorton, including itself.
    pub(super) fn sums(&self, weight: Weight, values: impl Fn(usize) -> [f32; 4] + Sync) -> Vec<[f32; 4]> {
        let count = self.positions.len();
        let mut sources = vec![Source([0.0; 8]); count];
        par::fill(&mut sources, |at| {
            let ([x, y, z, i], [a, b, c, d]) = (self.positions[at], values(self.tree.order[at] as usize));
            Source([x, y, z, i, a, b, c, d])
        });
        for range in &self.coincident {
            merge(&mut sources[range.clone()]);
        }
        let mut sorted = vec![[0.0; 4]; count];
        par::for_parts(&mut sorted, &self.ends, LEAVES_PER_TASK, |leaf, out| {
            let neighbours = self.neighbours(self.leaves[leaf]);
            let start = self.ends[leaf] - out.len();
            let targets = &self.positions[start..self.ends[leaf]];
            simd::dispatch(LeafSums { targets, neighbours: &neighbours, sources: &sources, weight, out });
        });
        let mut inverse = par::Inverse::default();
        inverse.rebuild(&self.tree.order);
        let mut out = vec![[0.0; 4]; count];
        par::fill(&mut out, |i| sorted[inverse.of(i)]);
        out
    }

    /// The leaves within the cutoff of a leaf, as ranges of the order, with coincident vortons represented.
    fn neighbours(&self, leaf: CellIndex) -> Vec<Range<usize>> {
        let (cells, own) = (&self.tree.cells, &self.tree.cells[leaf.at()]);
        let (mut ranges, mut open) = (Vec::new(), vec![CellIndex::ROOT]);
        while let Some(c) = open.pop() {
            let cell = &cells[c.at()];
            let reach = own.radius + cell.radius + CUTOFF * self.widest[leaf.at()].min(self.widest[c.at()]);
            if (cell.center - own.center).norm() > reach * 1.000_01 {
                continue;
            }
            match cell.is_leaf() {
                true if self.coincident.is_empty() => ranges.push(cell.places()),
                true => ranges.extend(representatives(cell.places(), &self.coincident)),
                false => open.extend(cell.children_reversed()),
            }
        }
        ranges
    }
}

/// Adds all coincident sources to the first of them.
fn merge(coincident: &mut [Source]) {
    let sum = |k: usize| coincident.iter().map(|Source(q)| f64::from(q[k])).sum::<f64>() as f32;
    let sums = [4, 5, 6, 7].map(sum);
    coincident[0].0[4..].copy_from_slice(&sums);
}

/// The value of the Gaussian of standard deviation 1 at its centre.
fn unit_gaussian() -> f32 {
    powf(2.0 * PI, -1.5)
}

/// The sums at the vortons of a leaf.
struct LeafSums<'a> {
    targets: &'a [[f32; 4]],
    neighbours: &'a [Range<usize>],
    sources: &'a [Source],
    weight: Weight,
    out: &'a mut [[f32; 4]],
}

impl Pass for LeafSums<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (cutoff2, half) = (splat::<L>(CUTOFF * CUTOFF), splat::<L>(-0.5));
        let (zero, unit) = (splat::<L>(0.0), splat::<L>(unit_gaussian()));
        for (targets, out) in self.targets.chunks(LANES).zip(self.out.chunks_mut(LANES)) {
            let at = |lane: usize| targets[lane.min(targets.len() - 1)];
            let x = pairs::columns::<L>(|lane| Vec3::new(at(lane)[0], at(lane)[1], at(lane)[2]));
            let own = L::load(&std::array::from_fn(|lane| at(lane)[3]));
            let mut sums = [zero; 4];
            for Source(q) in self.neighbours.iter().flat_map(|range| &self.sources[range.clone()]) {
                let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
                let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                // The larger 1/s² is that of the smaller core.
                let other = splat::<L>(q[3]);
                let inverse = L::select(own.less(other), other, own);
                let rho2 = r2 * inverse;
                let zeta = (unit * inverse) * (inverse.sqrt() * (half * rho2).exp());
                let full = if self.weight == Weight::Diffusion { zeta * inverse } else { zeta };
                let weight = L::select(rho2.less(cutoff2), full, zero);
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

    /// A cloud of vortons, with positions and cores modified by `change`.
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

    fn values(i: usize) -> [f32; 4] {
        [1.0, i as f32, (i % 7) as f32, -0.5]
    }

    /// The number of pairs that are tested.
    fn tested_pairs(sums: &NeighbourSums) -> usize {
        let leaf = |&leaf: &CellIndex| {
            let targets = sums.tree.cells[leaf.at()].count();
            targets * sums.neighbours(leaf).iter().map(Range::len).sum::<usize>()
        };
        sums.leaves.iter().map(leaf).sum()
    }

    fn assert_agrees_with_all_pairs(vortons: &Vortons) {
        let found = NeighbourSums::new(vortons).sums(Weight::Density, values);
        for p in (0..vortons.len()).step_by(97) {
            let mut exact = [0.0_f64; 4];
            for q in 0..vortons.len() {
                let s = vortons.core[p].min(vortons.core[q]);
                let rho2 = (vortons.position[p] - vortons.position[q]).norm_squared() / (s * s);
                if rho2 < CUTOFF * CUTOFF {
                    let zeta = f64::from(unit_gaussian() / s.powi(3)) * f64::from(-0.5 * rho2).exp();
                    (0..4).for_each(|k| exact[k] += zeta * f64::from(values(q)[k]));
                }
            }
            for k in 0..4 {
                let error = (f64::from(found[p][k]) - exact[k]).abs();
                assert!(error <= 1e-4 * exact[k].abs() + 1e-3, "{p}: {:?} for {exact:?}", found[p]);
            }
        }
    }

    #[test]
    fn a_few_wide_cores_do_not_widen_the_search() {
        let even = tested_pairs(&NeighbourSums::new(&cloud(|_, _, _| {})));
        let mixed = cloud(|i, _, core| {
            if i % 20 == 0 {
                *core = 0.3;
            }
        });
        assert_agrees_with_all_pairs(&mixed);
        // Two leaves of three have a wide core and search each other's surroundings; the others search as far
        // as before.
        let few = cloud(|i, _, core| {
            if i % 400 == 0 {
                *core = 0.3;
            }
        });
        assert_agrees_with_all_pairs(&few);
        let wide = tested_pairs(&NeighbourSums::new(&few));
        assert!((wide as f64) < 1.1 * even as f64, "{wide} for {even}");
    }

    #[test]
    fn coincident_vortons_are_one_source() {
        let coincident = |i: usize, x: &mut Vec3, core: &mut f32| {
            if i.is_multiple_of(2) {
                (*x, *core) = (Vec3::repeat(0.4), if i.is_multiple_of(4) { 0.02 } else { 0.05 });
            }
        };
        let vortons = cloud(coincident);
        assert_agrees_with_all_pairs(&vortons);
        let found = tested_pairs(&NeighbourSums::new(&vortons));
        let even = tested_pairs(&NeighbourSums::new(&cloud(|_, _, _| {})));
        assert!(found < 3 * even, "{found} for {even}");
    }
}
