//! Density constraints: densities, their gradients and the update of the multipliers, eight particles at a time.
//!
//! *Method*: [pbf] Eqs. 1, 2 and 8. The sums of each particle run over eight neighbours at a time. Then the sums of eight
//! particles are reduced and their multipliers updated together, so that every step is vectorised.
//! *Departs from the paper*: under the compression constraint, C includes the density that a particle lacks at the free
//! surface, so that surface particles resist clustering as those of the bulk do (see [`surface_deficit`]).
//! Symbols: ρ_i/ρ₀ → `ratio` [1]; part of C that stays → `retained` [1]; part of the tensile strength that a particle bears →
//! `tensile_part` [1]; κ, λ → see [`Multiplier`] [m²].

use super::{
    Constraint,
    images::BodySamples,
    lanes::{self, Node},
    pair::Pair,
    pass::NeighbourPass,
    setup::SolverSetup,
};
use crate::{
    math::Vec3,
    simd::{LANES, Lanes},
    space::Neighbours,
};

/// The Lagrange multipliers of all particles.
#[derive(Debug, Default)]
pub(super) struct MultiplierColumns(pub(super) Multiplier<Vec<f32>>);

/// Lagrange multiplier of a density constraint, as the solvers store it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Multiplier<T> {
    /// Change of λ by the last evaluation [m²].
    pub(super) lambda: T,
    /// κ by which positions have been moved [m²]; this and the following belong to the accelerated solver.
    pub(super) applied: T,
    /// κ before extrapolation [m²].
    pub(super) last: T,
    /// D + ε [1/m²]; infinite where nothing can be corrected.
    pub(super) denominator: T,
}

/// Error of one constraint, or of several.
#[derive(Clone, Copy, Debug)]
pub(super) struct ConstraintError<T> {
    /// Value of the constraint [1].
    pub(super) error: T,
    /// Uphill component of the momentum; the sign of its sum decides about a restart.
    pub(super) uphill: T,
}

/// Update of multipliers from densities.
pub(super) trait MultiplierUpdate: Sync {
    /// The new multipliers for ρ/ρ₀, and the error. `tensile_part` is 1 inside the liquid, and falls to 0 towards its surface and
    /// solids. Must be inlined.
    fn update<L: Lanes>(
        &self,
        ratio: L,
        tensile_part: L,
        multiplier: Multiplier<L>,
    ) -> (Multiplier<L>, ConstraintError<L>);
}

/// Evaluates errors and leaves the multipliers unchanged.
pub(super) struct NoUpdate {
    /// Smallest error that counts.
    pub(super) lower_bound: f32,
}

impl MultiplierUpdate for NoUpdate {
    #[inline(always)]
    fn update<L: Lanes>(
        &self,
        ratio: L,
        _tensile_part: L,
        multiplier: Multiplier<L>,
    ) -> (Multiplier<L>, ConstraintError<L>) {
        (multiplier, ConstraintError { error: error(ratio, self.lower_bound), uphill: L::splat(0.0) })
    }
}

/// C_i, at least `lower_bound`; NaN is kept, so that it is detected.
#[inline(always)]
pub(super) fn error<L: Lanes>(ratio: L, lower_bound: f32) -> L {
    L::splat(lower_bound).max(ratio - L::splat(1.0)) // C_i, [pbf] Eq. 1
}

/// Residual of the density constraints.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Residual {
    /// Mean constraint error.
    pub(super) average: f64,
    /// Largest constraint error.
    pub(super) largest: f64,
    /// Sum of [`ConstraintError::uphill`].
    pub(super) uphill: f64,
}

/// Partial sums of a [`Residual`] over one chunk, by lanes.
#[derive(Clone, Copy, Default)]
pub(super) struct PartialResidual {
    error: [f64; LANES],
    uphill: [f64; LANES],
    largest: [f32; LANES],
}

impl MultiplierColumns {
    /// Resizes to the number of particles.
    pub(super) fn resize(&mut self, count: usize) {
        for slice in self.slices_mut() {
            slice.resize(count, 0.0);
        }
    }

    pub(super) fn len(&self) -> usize {
        self.0.lambda.len()
    }

    pub(super) fn slices_mut(&mut self) -> [&mut Vec<f32>; 4] {
        let Multiplier { lambda, applied, last, denominator } = &mut self.0;
        [lambda, applied, last, denominator]
    }
}

impl Residual {
    /// Sum over chunks, in their order.
    pub(super) fn of(partials: &[PartialResidual], count: usize) -> Self {
        let (mut total, mut sum) = (Self::default(), 0.0);
        for partial in partials {
            sum += partial.error.iter().sum::<f64>();
            total.uphill += partial.uphill.iter().sum::<f64>();
            total.largest = partial.largest.iter().fold(total.largest, |most, &e| most.max(f64::from(e)));
        }
        Self { average: sum / count.max(1) as f64, ..total }
    }
}

impl PartialResidual {
    /// Adds the first `count` lanes.
    #[inline(always)]
    fn add<L: Lanes>(&mut self, found: ConstraintError<L>, count: usize) {
        let (mut error, mut uphill) = (found.error.to_array(), found.uphill.to_array());
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

/// What the passes over a chunk of particles read.
#[derive(Clone, Copy)]
pub(super) struct Chunk<'a> {
    pub(super) setup: &'a SolverSetup<'a>,
    pub(super) nodes: &'a [Node],
    pub(super) lists: &'a Neighbours,
    /// Distances to the nearest solid when the lists were built [m].
    pub(super) clearance: &'a [f32],
    /// What the particles near rigid bodies see of them.
    pub(super) samples: BodySamples<'a>,
    /// Index of the first particle of the chunk.
    pub(super) start: usize,
}

impl Chunk<'_> {
    /// Density of the solids at `x` and its gradient, without that of rigid bodies where these have images; skipped where `clearance`
    /// excludes it.
    #[inline(always)]
    pub(super) fn boundary_density(&self, i: usize, x: Vec3) -> (f32, Vec3) {
        if self.clearance[i] > self.setup.boundary_reach() {
            (0.0, Vec3::zeros())
        } else {
            self.samples.boundary_density(i, x, self.setup.walls)
        }
    }
}

/// Evaluation of a chunk of constraints, with or without gradients.
pub(super) struct DensityPass<'a, D, const GRADIENTS: bool> {
    pub(super) at: Chunk<'a>,
    /// ρ/ρ₀.
    pub(super) ratio: &'a mut [f32],
    /// Density that the free surface lacks, over ρ₀; computed with gradients and read without.
    pub(super) deficit: &'a mut [f32],
    /// 1 inside the liquid, 0 at its surface and at solids; computed with gradients and read without.
    pub(super) tensile_part: &'a mut [f32],
    /// Part of C that this substep does not correct; empty: none.
    pub(super) retained: &'a [f32],
    pub(super) multiplier: Multiplier<&'a mut [f32]>,
    pub(super) update: &'a D,
}

impl<D: MultiplierUpdate, const GRADIENTS: bool> NeighbourPass for DensityPass<'_, D, GRADIENTS> {
    type Out = PartialResidual;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> PartialResidual {
        let mut partial = PartialResidual::default();
        let Self { at, ratio, deficit, tensile_part, retained, multiplier, update } = self;
        for first in (0..ratio.len()).step_by(LANES) {
            let count = LANES.min(ratio.len() - first);
            let densities = densities::<L, P, GRADIENTS>(&at, at.start + first, count);
            let before = Multiplier {
                lambda: read(multiplier.lambda, first),
                applied: read(multiplier.applied, first),
                last: read(multiplier.last, first),
                denominator: if GRADIENTS {
                    L::load(&densities.denominator)
                } else {
                    read(multiplier.denominator, first)
                },
            };
            let lacking: L = if GRADIENTS { L::load(&densities.deficit) } else { read(deficit, first) };
            let retained = if retained.is_empty() { L::splat(0.0) } else { read(retained, first) };
            // Pinned particles, of which everything is retained, bear none.
            let tension: L = if GRADIENTS {
                L::splat(0.0).max(L::load(&densities.tensile_part) - retained)
            } else {
                read(tensile_part, first)
            };
            let ratio_with_deficit = L::load(&densities.ratio) + lacking - retained;
            let (after, found) = update.update(ratio_with_deficit, tension, before);
            partial.add(found, count);
            write(ratio, first, L::load(&densities.ratio));
            write(deficit, first, lacking);
            write(tensile_part, first, tension);
            write(multiplier.lambda, first, after.lambda);
            write(multiplier.applied, first, after.applied);
            write(multiplier.last, first, after.last);
            write(multiplier.denominator, first, after.denominator);
        }
        partial
    }
}

/// Eight values from `first` on, padded with ones, which are valid divisors.
#[inline(always)]
fn read<L: Lanes>(from: &[f32], first: usize) -> L {
    if let Some(row) = from[first..].first_chunk() {
        return L::load(row);
    }
    let mut row = [1.0; LANES];
    row[..from.len() - first].copy_from_slice(&from[first..]);
    L::load(&row)
}

/// Writes values back to where [`read`] read them.
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
    /// Density that the free surface lacks, with gradients.
    deficit: [f32; LANES],
    /// 1 inside the liquid, with gradients.
    tensile_part: [f32; LANES],
}

/// Density that a particle lacks at the free surface, from |∇_i C_i|² [1/m²], over ρ₀.
///
/// The kernel of a particle at the surface reaches into the air. Without this term the outermost layer is below rest
/// density, and is compressed along the surface and into the liquid until it is not: particles cluster in pairs, and a drop
/// loses 4 to 7 % of its volume to its own surface tension. A half space of air at the distance of the surface lacks a
/// density that grows from zero with the gradient. Its square, up to the exact value of the outermost layer of a flat surface,
/// fits the layers of the seeding lattice to 0.01 for Wendland's kernel up to h = 3 spacings (Poly6 and Spiky: 0.03), and
/// vanishes for the small gradients of the bulk. At a contact line, solids take the place of a share `of_solids` of the air:
/// uncapped, a block that touches walls swells by 2.3 % per second without gravity, capped by 0.6 %. In the first layer at a rigid body the part
/// of the gradient along the normal does not count ([`BodySamples::without_gaps`]). It is evaluated once in a solve of the accelerated solver, like ghost
/// particles of air ([schechter12]), and in every iteration of the Jacobi solver.
#[inline(always)]
fn surface_deficit(setup: &SolverSetup<'_>, gradient2: f32, of_solids: f32) -> f32 {
    let rest = setup.rest;
    match setup.constraint {
        Constraint::Compression => {
            (rest.surface_deficit_scale * gradient2).min(rest.surface_deficit * (1.0 - of_solids))
        }
        Constraint::Equality => 0.0,
    }
}

/// Evaluates `count` particles from `first` on. The remaining ratios and denominators are 1.
#[inline(always)]
fn densities<L: Lanes, P: Pair, const GRADIENTS: bool>(
    at: &Chunk<'_>,
    first: usize,
    count: usize,
) -> Densities {
    let (rest, setup, zero) = (at.setup.rest, at.setup, L::splat(0.0));
    let mut density = [zero; LANES];
    let (mut gradient, mut gradient2) = ([[zero; LANES]; 3], [zero; LANES]);
    // The padding of the last eight neighbours counts as 1 each, like the particle itself.
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
            sum += P::density(q2, q);
            if GRADIENTS {
                let slope = P::slope(q);
                slopes2 += slope * slope * q2;
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
    let mut out = Densities {
        ratio: [1.0; LANES],
        denominator: [1.0; LANES],
        deficit: [0.0; LANES],
        tensile_part: [0.0; LANES],
    };
    let (mut boundary, mut of_images2) = ([(0.0, Vec3::zeros()); LANES], [0.0; LANES]);
    for k in 0..count {
        boundary[k] = at.boundary_density(first + k, at.nodes[first + k].vector() * rest.support);
        for sample in at.samples.of(first + k) {
            boundary[k].0 += sample.image.density;
            boundary[k].1 += sample.image.gradient;
            of_images2[k] += sample.image.others2;
        }
        out.ratio[k] = rest.density_scale * (sums[k] + itself[k]) + boundary[k].0; // ρ_i/ρ₀, [pbf] Eq. 2
    }
    if GRADIENTS {
        let [x, y, z] = [L::sums(&gradient[0]), L::sums(&gradient[1]), L::sums(&gradient[2])];
        let gradient2 = L::sums(&gradient2);
        let g = rest.gradient_scale;
        for k in 0..count {
            let own_gradient = Vec3::new(x[k], y[k], z[k]) * -g + boundary[k].1; // [pbf] Eq. 8, k = i
            let others2 = g * g * gradient2[k] + of_images2[k];
            let all = own_gradient.norm_squared() + others2; // Σ_k |∇_k C_i|²
            out.denominator[k] = setup.denominator(all);
            let deficit = |gradient: Vec3| surface_deficit(setup, gradient.norm_squared(), boundary[k].0);
            out.deficit[k] = deficit(at.samples.without_gaps(first + k, own_gradient));
            // No tension across a gap.
            let lacking = deficit(own_gradient) + boundary[k].0;
            out.tensile_part[k] = (1.0 - lacking * rest.inv_tension_free).max(0.0);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState, jacobi, solve::Solver, walls::Walls},
        solid::{Shape, Solid},
    };

    #[test]
    fn the_liquid_bears_tension_inside_and_none_at_its_surface_or_at_solids() {
        for kernel_radius in [2.0, 2.5] {
            let rest = RestState::new(Kernel::Wendland, 0.02, kernel_radius);
            let floor = Shape::Plane { point: [0.0, 0.0, -0.01], normal: [0.0, 0.0, 1.0] };
            let walls = Walls::new(&[Solid::fixed(floor)], &rest);
            let constraint = Constraint::Compression;
            let setup = SolverSetup { rest: &rest, walls: &walls, constraint, softening: 0.0 };
            let position = |k: u32| Vec3::new((k % 9) as f32, (k / 9 % 9) as f32, (k / 81) as f32) * 0.02;
            let mut solver = Solver::default();
            solver.p = (0..729).map(position).collect();
            solver.find_cells(&rest).expect("no crowd");
            solver.build_lists(&setup);
            jacobi::evaluate(&mut solver, &setup);
            let part = |layer: usize| solver.tensile_part[4 + 9 * 4 + 81 * layer];
            let parts: Vec<f32> = (0..9).map(part).collect();
            assert!(part(0) == 0.0 && part(8) == 0.0, "{kernel_radius}: {parts:?}");
            assert!((3..6).all(|layer| part(layer) > 0.95), "{kernel_radius}: {parts:?}");
            // Everything of a pinned particle is retained.
            solver.retained = vec![1e6; 729];
            jacobi::evaluate(&mut solver, &setup);
            assert!(solver.tensile_part.iter().all(|&part| part == 0.0));
        }
    }
}
