//! Evaluates constraints: density, its gradients, and what a solver makes of them, eight particles at a time.
//!
//! *Method*: [pbf] Eqs. 1, 2 and 8. Each particle's sums run over eight neighbours at a time; then the sums of eight
//! particles are folded and decided upon together, so that no step is done for one number alone.
//! Symbols: ρ_i/ρ₀ → `ratio` [1]; κ, λ → see [`Unknown`] [m²].

use super::{
    lanes::{self, Node},
    pair::Pair,
    pass::NeighbourPass,
    setup::Setup,
};
use crate::{
    math::Vec3,
    simd::{LANES, Lanes},
    space::Neighbours,
};

/// A neighbourhood counts as filled when |∇_i C_i| is below this fraction of its value on a flat free surface.
const FILLED: f32 = 0.2;

/// The multipliers of all particles.
#[derive(Debug, Default)]
pub(super) struct Unknowns(pub(super) Unknown<Vec<f32>>);

/// A multiplier, as its solver keeps it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unknown<T> {
    /// The change of λ that the last evaluation decided [m²].
    pub(super) lambda: T,
    /// κ that positions have been moved by [m²]; the accelerated solver's, like the following.
    pub(super) applied: T,
    /// κ before extrapolation [m²].
    pub(super) last: T,
    /// D + ε [1/m²]; infinite where nothing can be corrected.
    pub(super) denominator: T,
}

/// What a solver says of one constraint, or of several.
#[derive(Clone, Copy, Debug)]
pub(super) struct Verdict<T> {
    /// The constraint's error [1].
    pub(super) error: T,
    /// How far momentum leads uphill: the part of the sum whose sign asks for a restart.
    pub(super) uphill: T,
}

/// What turns densities into changes of multipliers.
pub(super) trait Decide: Sync {
    /// The multipliers that follow from ρ/ρ₀. To be inlined always.
    fn decide<L: Lanes>(&self, ratio: L, unknown: Unknown<L>) -> (Unknown<L>, Verdict<L>);
}

/// What one evaluation of the constraints found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Residual {
    /// Mean constraint error.
    pub(super) average: f64,
    /// Largest constraint error.
    pub(super) largest: f64,
    /// Mean |C| where the neighbourhood is filled; of evaluations with gradients.
    pub(super) bulk: f64,
    /// Σ of [`Verdict::uphill`].
    pub(super) uphill: f64,
}

/// Partial sums of a [`Residual`] over one chunk: by lanes, so that eight are added at once.
#[derive(Clone, Copy, Default)]
pub(super) struct Partial {
    error: [f64; LANES],
    uphill: [f64; LANES],
    largest: [f32; LANES],
    bulk_sum: f64,
    bulk: u64,
}

impl Unknowns {
    /// Makes them as many as there are particles.
    pub(super) fn resize(&mut self, count: usize) {
        for slice in self.slices_mut() {
            slice.resize(count, 0.0);
        }
    }

    pub(super) fn len(&self) -> usize {
        self.0.lambda.len()
    }

    pub(super) fn slices_mut(&mut self) -> [&mut Vec<f32>; 4] {
        let Unknown { lambda, applied, last, denominator } = &mut self.0;
        [lambda, applied, last, denominator]
    }
}

impl Residual {
    /// The sum of the chunks, in their order.
    pub(super) fn of(partials: &[Partial], count: usize) -> Self {
        let (mut total, mut sum, mut bulk) = (Self::default(), 0.0, 0);
        for partial in partials {
            sum += partial.error.iter().sum::<f64>();
            total.uphill += partial.uphill.iter().sum::<f64>();
            total.largest = partial.largest.iter().fold(total.largest, |most, &e| most.max(f64::from(e)));
            total.bulk += partial.bulk_sum;
            bulk += partial.bulk;
        }
        Self { average: sum / count.max(1) as f64, bulk: total.bulk / bulk.max(1) as f64, ..total }
    }
}

impl Partial {
    /// Counts the first `count` of the verdicts.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, verdict: Verdict<L>, count: usize) {
        let (mut error, mut uphill) = (verdict.error.to_array(), verdict.uphill.to_array());
        error[count..].fill(0.0);
        uphill[count..].fill(0.0);
        for lane in 0..LANES {
            let error = error[lane].abs();
            self.error[lane] += f64::from(error);
            self.uphill[lane] += f64::from(uphill[lane]);
            self.largest[lane] = self.largest[lane].max(error);
        }
    }
}

/// The particles that a chunk's passes read.
#[derive(Clone, Copy)]
pub(super) struct Chunk<'a> {
    pub(super) setup: &'a Setup<'a>,
    pub(super) nodes: &'a [Node],
    pub(super) lists: &'a Neighbours,
    /// Distances to the nearest solid when the lists were built [m].
    pub(super) clearance: &'a [f32],
    /// Index of the chunk's first particle.
    pub(super) start: usize,
}

impl Chunk<'_> {
    /// The solids' share at `x`, where the lists do not rule it out.
    #[inline(always)]
    pub(super) fn share(&self, i: usize, x: Vec3) -> (f32, Vec3) {
        if self.clearance[i] > self.setup.share_reach() {
            (0.0, Vec3::zeros())
        } else {
            self.setup.walls.share(x)
        }
    }
}

/// Evaluates a chunk of constraints, with or without their gradients.
pub(super) struct DensityPass<'a, D, const GRADIENTS: bool> {
    pub(super) at: Chunk<'a>,
    /// ρ/ρ₀.
    pub(super) ratio: &'a mut [f32],
    pub(super) unknown: Unknown<&'a mut [f32]>,
    pub(super) decide: &'a D,
}

impl<D: Decide, const GRADIENTS: bool> NeighbourPass for DensityPass<'_, D, GRADIENTS> {
    type Out = Partial;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> Partial {
        let mut partial = Partial::default();
        let Self { at, ratio, unknown, decide } = self;
        for first in (0..ratio.len()).step_by(LANES) {
            let count = LANES.min(ratio.len() - first);
            let densities = densities::<L, P, GRADIENTS>(&at, at.start + first, count, &mut partial);
            let before = Unknown {
                lambda: read(unknown.lambda, first),
                applied: read(unknown.applied, first),
                last: read(unknown.last, first),
                denominator: if GRADIENTS {
                    L::load(&densities.denominator)
                } else {
                    read(unknown.denominator, first)
                },
            };
            let (after, verdict) = decide.decide(L::load(&densities.ratio), before);
            partial.add(verdict, count);
            write(ratio, first, L::load(&densities.ratio));
            write(unknown.lambda, first, after.lambda);
            write(unknown.applied, first, after.applied);
            write(unknown.last, first, after.last);
            write(unknown.denominator, first, after.denominator);
        }
        partial
    }
}

/// Eight numbers from `first` on, filled up with ones, by which can be divided.
#[inline(always)]
fn read<L: Lanes>(from: &[f32], first: usize) -> L {
    if let Some(row) = from[first..].first_chunk() {
        return L::load(row);
    }
    let mut row = [1.0; LANES];
    row[..from.len() - first].copy_from_slice(&from[first..]);
    L::load(&row)
}

/// Writes what [`read`] has read.
#[inline(always)]
fn write<L: Lanes>(to: &mut [f32], first: usize, values: L) {
    if let Some(row) = to[first..].first_chunk_mut() {
        *row = values.to_array();
    } else {
        let count = to.len() - first;
        to[first..].copy_from_slice(&values.to_array()[..count]);
    }
}

/// Densities of eight particles.
struct Densities {
    /// ρ/ρ₀.
    ratio: [f32; LANES],
    /// D + ε [1/m²], with gradients.
    denominator: [f32; LANES],
}

/// Evaluates `count` particles from `first` on; with gradients, counts what is filled. The remaining ratios and
/// denominators are 1.
#[inline(always)]
fn densities<L: Lanes, P: Pair, const GRADIENTS: bool>(
    at: &Chunk<'_>,
    first: usize,
    count: usize,
    partial: &mut Partial,
) -> Densities {
    let (rest, setup, zero) = (at.setup.rest, at.setup, L::splat(0.0));
    let mut density = [zero; LANES];
    let (mut gradient, mut gradient2) = ([[zero; LANES]; 3], [zero; LANES]);
    // What fills up the last eight neighbours counts as 1 each, like the particle itself.
    let mut itself = [1.0; LANES];
    for k in 0..count {
        let i = first + k;
        let own = lanes::spread::<L>(at.nodes[i]);
        let mut neighbours = at.lists.rows::<L>(i);
        itself[k] -= neighbours.padding() as f32;
        let (mut sum, mut slopes, mut slopes2) = (zero, [zero; 3], zero);
        while let Some(index) = neighbours.next() {
            let (d, q2) = lanes::offset(own, lanes::gather::<L>(at.nodes, index));
            let q = q2.sqrt();
            sum = sum + P::density(q2, q);
            if GRADIENTS {
                let slope = P::slope(q);
                slopes2 = slopes2 + slope * slope * q2;
                slopes = lanes::plus(slopes, d, slope);
            }
        }
        density[k] = sum;
        if GRADIENTS {
            gradient2[k] = slopes2;
            [gradient[0][k], gradient[1][k], gradient[2][k]] = slopes;
        }
    }
    let sums = L::sums(&density);
    let mut out = Densities { ratio: [1.0; LANES], denominator: [1.0; LANES] };
    let mut shares = [(0.0, Vec3::zeros()); LANES];
    for k in 0..count {
        shares[k] = at.share(first + k, at.nodes[first + k].vector() * rest.support);
        out.ratio[k] = rest.density_scale * (sums[k] + itself[k]) + shares[k].0; // ρ_i/ρ₀, [pbf] Eq. 2
    }
    if GRADIENTS {
        let [x, y, z] = [L::sums(&gradient[0]), L::sums(&gradient[1]), L::sums(&gradient[2])];
        let gradient2 = L::sums(&gradient2);
        let (g, surface) = (rest.gradient_scale, FILLED * 1.5 * rest.inv_support);
        for k in 0..count {
            let own_gradient = Vec3::new(x[k], y[k], z[k]) * -g + shares[k].1; // [pbf] Eq. 8, k = i
            let all = own_gradient.norm_squared() + g * g * gradient2[k]; // Σ_k |∇_k C_i|²
            out.denominator[k] = setup.denominator(all);
            if own_gradient.norm() < surface {
                partial.bulk_sum += f64::from((out.ratio[k] - 1.0).abs());
                partial.bulk += 1;
            }
        }
    }
    out
}
