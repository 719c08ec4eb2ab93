//! The accelerated solver: projected Jacobi iterations with momentum and a warm start.
//!
//! *Method*: the substep is a complementarity problem: find pressures κ ≥ κ₀ that leave no compression, with κ = κ₀ where
//! the liquid is below rest density. κ₀ is 0 at surfaces and solids, and a little below inside of the liquid, which bears tension
//! (docs/decisions/040). Its projected Jacobi iteration is κ ← max(κ₀, κ + ω C/D), with the paper's
//! denominator D ([pbf] Eq. 11). [nesterov83]'s momentum extrapolates κ; it restarts whenever it points uphill
//! ([odonoghue15] section 3.2, gradient scheme). Changes of κ move particles as the paper's λ does (Eq. 12), with
//! gradients at the positions that [`Directions`] names. A substep starts from a part of the last one's final pressures.
//! *Departs from the paper*: there λ only pushes, and an overshoot stays; here an overshoot is reversed as long as
//! κ > 0. D is evaluated once a substep, since it only scales the step. The warm start ignores pressures that lasted for one
//! substep only, as those of an impact. A frame starts with the same part of the
//! pressure that balances the cohesion, which is the same everywhere.
//! See docs/decisions/006 for measurements of other schemes.
//!
//! Symbols: κ_i → −λ summed over the substep [m²]; its extrapolation → `applied`; ω → [`RELAXATION`].
//! Limits: the first substep of every frame starts from no pressure of the last one, so that a frame can be computed from what is
//! stored. A particle without neighbours at the start of the substep
//! is not corrected in that substep.

use super::{
    Kernel,
    density::{ConstraintError, Multiplier, MultiplierUpdate, Residual},
    setup::SolverSetup,
    solve::{Directions, Solver},
};
use crate::{par, simd::Lanes};

/// Relaxation factor ω. With momentum, 0.7 throws a 64-layer column apart within half a second; 0.3 takes 1.3 times the
/// iterations.
const RELAXATION: f32 = 0.5;

/// Fraction of the last substep's pressures with which a substep starts. At 0 it takes 1.7 times the iterations; above
/// 0.5 errors of the last substep return and columns at rest jitter (0.7: 0.11 m/s against 0.05; 0.9 diverges).
const WARM_START: f32 = 0.5;

/// The same for liquid with surface tension under gravity, where every particle is under pressure. With 0.4 and more, columns of 64 layers
/// and a cup of water of 60 are thrown up; 0.2 also holds columns of 100 for longer. The dam break takes 1.15 times the iterations of 0.5.
const WARM_START_WITH_TENSION: f32 = 0.3;

/// Growth of the largest error over the smallest so far at which an iteration is diverging. Momentum then restarts, and ω
/// is multiplied by [`RELAXATION_REDUCTION`], down to [`MIN_RELAXATION`]. Regularly spaced particles have modes that
/// momentum amplifies by 1.6 an iteration; undetected, one throws a falling block apart within ten iterations.
const DIVERGENCE_GROWTH: f64 = 1.5;
const RELAXATION_REDUCTION: f32 = 0.7;
const MIN_RELAXATION: f32 = 0.1;

/// Tensile strength of the liquid: largest −p/ρ₀ over the acceleration of gravity and forces times the spacing [1]. Liquid that falls faster
/// at its lower end is stretched; with 0 it dilates, and tears into rings. With 20 a thin jet tears into rags. The paper's kernels bear
/// none.
const TENSILE_STRENGTH: f32 = 4.0;

/// Errors below this are rounding errors, and their growth is ignored. If larger, a growing mode is detected an iteration
/// or two later; at 0 every substep with many iterations is slowed dozens of times.
pub(super) const MIN_SIGNIFICANT_ERROR: f64 = 1e-5;

/// State of the momentum, within a substep and from one to the next.
#[derive(Debug, Default)]
pub(super) struct Momentum {
    /// Iterations since the last restart.
    age: u32,
    /// ω of this substep.
    relaxation: f32,
    /// Smallest of the largest errors in this substep that are above rounding.
    smallest: f64,
    /// Number of times that the iteration was slowed in this frame.
    pub(super) slowed: u32,
    /// Length of the last substep [s]; 0 in the first substep of a frame and in the second solve of a substep.
    dt: f32,
    /// p/ρ₀ that counts as that of the substep before the first of a frame [m²/s²].
    first_pressure: f32,
    /// Tensile strength in this substep [m²].
    tension: f32,
    /// Part of the last pressures with which a substep starts.
    warm_start: f32,
    /// Whether the frame has had a substep.
    started: bool,
    /// κ/dt² = p/ρ₀ of the substep before the last [m²/s²]; empty in the first two substeps of a frame.
    pub(super) pressure: Vec<f32>,
}

impl Momentum {
    /// The momentum of a liquid that has p/ρ₀ = `first_pressure` [m²/s²] before the first substep of a frame.
    pub(super) fn new(first_pressure: f32) -> Self {
        let warm_start = if first_pressure > 0.0 { WARM_START_WITH_TENSION } else { WARM_START };
        Self { first_pressure, warm_start, ..Self::default() }
    }

    /// Resets the warm start: the next frame then depends on positions and velocities alone, and can be computed from the
    /// last stored frame.
    pub(super) fn reset(&mut self) {
        (self.dt, self.slowed, self.started) = (0.0, 0, false);
        self.pressure.clear();
    }

    /// Keeps the pressures of this solve in `kept`, from which another solve of the substep takes none.
    pub(super) fn keep(&mut self, solver: &Solver, kept: &mut Vec<f32>) {
        kept.clone_from(&solver.multipliers.0.applied);
        self.dt = 0.0;
    }

    /// Returns the pressures that [`Momentum::keep`] kept, for the next substep after one of `dt` [s].
    pub(super) fn give_back(&mut self, solver: &mut Solver, kept: &mut Vec<f32>, dt: f32) {
        std::mem::swap(&mut solver.multipliers.0.applied, kept);
        self.dt = dt;
    }

    /// Whether this substep's iteration has been slowed because it diverged.
    pub(super) fn is_slowed(&self) -> bool {
        self.relaxation < RELAXATION
    }

    /// Starts a substep of `dt` [s] from the last one's pressures. Returns whether there were any.
    pub(super) fn start(
        &mut self,
        solver: &mut Solver,
        setup: &SolverSetup<'_>,
        dt: f32,
        directions: Directions<'_>,
    ) -> bool {
        let last_dt = std::mem::replace(&mut self.dt, dt);
        self.age = 0;
        (self.relaxation, self.smallest) = (RELAXATION, f64::INFINITY);
        solver.multipliers.resize(solver.p.len());
        let Multiplier { lambda, applied, last, .. } = &mut solver.multipliers.0;
        let is_first = !std::mem::replace(&mut self.started, true);
        if last_dt == 0.0 {
            let kappa = if is_first { self.warm_start * dt * dt * self.first_pressure } else { 0.0 };
            last.fill(kappa);
            if kappa == 0.0 {
                applied.fill(0.0);
                lambda.fill(0.0);
                return false;
            }
        } else {
            par::update(applied, |_, kappa| *kappa /= last_dt * last_dt);
            let before = &self.pressure;
            // The smaller of both in magnitude, if they have the same sign.
            let lasting = |i: usize, pressure: f32| {
                before.get(i).map_or(pressure, |before| pressure.clamp(before.min(0.0), before.max(0.0)))
            };
            let part = self.warm_start * dt * dt;
            par::fill(last, |i| part * lasting(i, applied[i]));
            self.pressure.clone_from(applied);
        }
        applied.clone_from(last);
        par::fill(lambda, |i| -last[i]);
        solver.clear_pin_pressures();
        solver.publish(setup.rest.inv_support);
        solver.evaluate_directions_at(directions, setup.rest);
        solver.correct(setup);
        solver.restore_pins_with_work(directions.x);
        true
    }

    /// Tensile strength in this substep [m²].
    pub(super) fn tension(&self) -> f32 {
        self.tension
    }

    /// ω of this substep.
    pub(super) fn relaxation(&self) -> f32 {
        self.relaxation
    }

    /// Evaluates every constraint and its change of pressure. The residual is the change of a step without momentum, so
    /// that dilation under pressure is an error like compression.
    ///
    /// The tensile strength follows from the `body_acceleration` [m/s²] of the liquid.
    pub(super) fn evaluate(
        &mut self,
        solver: &mut Solver,
        setup: &SolverSetup<'_>,
        body_acceleration: f32,
        first: bool,
    ) -> Residual {
        let beta = self.age as f32 / (self.age + 3) as f32; // [nesterov83], as [odonoghue15] Eq. 4 has it
        let rest = setup.rest;
        let strength = match rest.kernel {
            Kernel::Wendland => TENSILE_STRENGTH,
            Kernel::Poly6Spiky => 0.0,
        };
        self.tension = strength * body_acceleration * rest.spacing * self.dt * self.dt;
        let step = AcceleratedUpdate {
            beta,
            relaxation: self.relaxation,
            smallest: setup.lower_bound(),
            tension: self.tension,
        };
        let residual = if first {
            solver.evaluate::<true>(setup, &step)
        } else {
            solver.evaluate::<false>(setup, &step)
        };
        self.age = if residual.uphill > 0.0 { 0 } else { self.age + 1 };
        self.smallest = self.smallest.min(residual.largest).max(MIN_SIGNIFICANT_ERROR);
        if residual.largest > DIVERGENCE_GROWTH * self.smallest {
            (self.age, self.smallest) = (0, residual.largest);
            self.relaxation = (RELAXATION_REDUCTION * self.relaxation).max(MIN_RELAXATION);
            self.slowed += 1;
        }
        residual
    }
}

/// One iteration of the accelerated solver.
struct AcceleratedUpdate {
    /// Part of the last change that momentum adds.
    beta: f32,
    /// ω of this substep.
    relaxation: f32,
    /// Lower bound of κ at the surface [m²].
    smallest: f32,
    /// How far κ inside the liquid may be below that [m²].
    tension: f32,
}

impl MultiplierUpdate for AcceleratedUpdate {
    #[inline(always)]
    fn update<L: Lanes>(
        &self,
        ratio: L,
        tensile_part: L,
        multiplier: Multiplier<L>,
    ) -> (Multiplier<L>, ConstraintError<L>) {
        let Multiplier { applied, last, denominator, .. } = multiplier;
        let relaxation = L::splat(self.relaxation);
        let smallest = L::splat(self.smallest) - L::splat(self.tension) * tensile_part;
        let kappa = smallest.max(applied + relaxation * (ratio - L::splat(1.0)) / denominator);
        let ahead = smallest.max(kappa + L::splat(self.beta) * (kappa - last));
        // Where nothing can be corrected κ does not change, and zero times infinity is NaN.
        let weight = denominator.min(L::splat(f32::MAX));
        let found = ConstraintError {
            error: (kappa - applied) * weight * L::splat(1.0 / self.relaxation),
            uphill: (applied - kappa) * (kappa - last) * weight,
        };
        (Multiplier { lambda: applied - ahead, applied: ahead, last: kappa, denominator }, found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::Vec3,
        sim::liquid::{Constraint, Kernel, calibration::RestState, walls::Walls},
        simd::ScalarLanes,
    };

    /// κ after one step from `applied`, for ρ/ρ₀ with the deficit, of a particle that is 1 inside the liquid and 0 at its surface.
    fn step(smallest: f32, tension: f32, applied: f32, [ratio, tensile_part]: [f32; 2]) -> f32 {
        let update = AcceleratedUpdate { beta: 0.0, relaxation: 0.5, smallest, tension };
        let splat = |value: f32| ScalarLanes::splat(value);
        let before = Multiplier {
            lambda: splat(0.0),
            applied: splat(applied),
            last: splat(applied),
            denominator: splat(1.0),
        };
        update.update(splat(ratio), splat(tensile_part), before).0.applied.to_array()[0]
    }

    #[test]
    fn dilated_liquid_bears_tension_inside_and_none_at_its_surface() {
        assert_eq!(step(0.0, 0.01, 0.0, [0.9, 1.0]), -0.01, "at most its strength");
        assert_eq!(step(0.0, 0.01, 0.0, [0.99, 1.0]), -0.5 * (1.0 - 0.99_f32), "as little as is needed");
        assert_eq!(step(0.0, 0.01, 0.0, [0.9, 0.75]), -0.0075, "less near the surface");
        assert_eq!(step(0.0, 0.01, -0.01, [0.9, 0.0]), 0.0, "none at the surface");
        assert_eq!(step(0.0, 0.0, 0.02, [0.9, 1.0]), 0.0, "none without gravity");
        assert_eq!(
            step(f32::NEG_INFINITY, 0.0, 0.0, [0.9, 1.0]),
            -0.5 * (1.0 - 0.9_f32),
            "the paper's constraint"
        );
        assert!(step(0.0, 0.01, 0.0, [f32::NAN, 1.0]).is_nan(), "what is undefined is detected");
    }

    #[test]
    fn a_substep_starts_from_a_part_of_the_lesser_of_the_last_two_pressures() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Equality, softening: 0.0 };
        // Particles without neighbours: nothing moves them.
        let x: Vec<Vec3> = (0..5).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
        let mut solver = Solver::default();
        solver.p.clone_from(&x);
        solver.find_cells(&rest).expect("no crowd");
        solver.build_lists(&setup);
        let mut momentum = Momentum::new(3.0);
        let part = |pressures: [f32; 5]| pressures.map(|pressure| WARM_START_WITH_TENSION * pressure);
        let mut start = |dt: f32, ended_with: [f32; 5]| {
            momentum.start(&mut solver, &setup, dt, Directions { theta: 0.1, x: &x });
            let started: Vec<f32> = solver.multipliers.0.applied.iter().map(|k| k / (dt * dt)).collect();
            solver.multipliers.0.applied = ended_with.map(|pressure| pressure * dt * dt).to_vec();
            started
        };
        assert_eq!(
            start(0.5, [4.0, 2.0, 2.0, 0.0, -2.0]),
            part([3.0; 5]),
            "a frame starts with a part of its own pressure"
        );
        assert_eq!(
            start(0.5, [2.0, 6.0, -8.0, 8.0, -4.0]),
            part([4.0, 2.0, 2.0, 0.0, -2.0]),
            "only one is known"
        );
        // In a substep of another length the pressures are the same.
        assert_eq!(start(0.25, [0.0; 5]), part([2.0, 2.0, 0.0, 0.0, -2.0]));
        assert_eq!(start(0.25, [0.0; 5]), part([0.0; 5]));
    }
}
