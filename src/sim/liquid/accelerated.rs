//! The accelerated solver: multipliers that are carried, may fall again, and have momentum.
//!
//! *Method*: the substep is a complementarity problem: find pressures κ ≥ 0 that leave no compression, with κ = 0 where
//! the liquid is below rest density. Its projected Jacobi iteration is κ ← max(0, κ + ω C/D), D the paper's
//! denominator ([pbf] Eq. 11); [nesterov83]'s momentum carries it on, and starts again whenever it leads uphill
//! ([odonoghue15] section 3.2, gradient scheme). Changes of κ move particles as the paper's λ does (Eq. 12), at the
//! present gradients. A substep starts from half of what the last one ended with.
//! *Departs from the paper*: its λ only pushes, and an overshoot stays; here what was pushed too far is let back as
//! long as κ > 0. D is evaluated once a substep, since it only sets the step.
//! See docs/decisions/006 for what other schemes gave.
//!
//! Symbols: κ_i → −λ summed over the substep [m²]; its extrapolation → `applied`; ω → [`RELAXATION`].
//! Limits: the first substep of every frame starts from zero. A particle without neighbours at the substep's start is not
//! corrected within that substep.

use super::{
    density::{Decide, Residual, Unknown, Verdict},
    setup::Setup,
    solve::Solver,
};
use crate::{par, simd::Lanes};

/// ω. With momentum, 0.7 throws a 64-layer column apart within half a second; 0.3 takes 1.3 times the iterations.
const RELAXATION: f32 = 0.5;

/// The part of the last substep's pressures that a substep starts with. At 0 it takes 1.7 times the iterations; above
/// 0.5 errors of the last substep come back and columns at rest jitter (0.7: 0.11 m/s against 0.05; 0.9 blows up).
const WARM_START: f32 = 0.5;

/// An iteration whose largest error is this many times the smallest so far runs away: momentum stops, and ω becomes
/// [`CALMER`] of itself, down to [`CALMEST`]. Regular lattices have modes that momentum amplifies by 1.6 an iteration;
/// unnoticed, one throws a falling block apart within ten iterations.
const GROWN: f64 = 1.5;
const CALMER: f32 = 0.7;
const CALMEST: f32 = 0.1;

/// Errors below this are rounding, and no sign of anything when they grow. Larger, and a mode that grows is noticed an
/// iteration or two later; at 0 every substep of many iterations is calmed dozens of times.
const ROUNDING: f64 = 1e-5;

/// The momentum of the iteration, and what the next substep must know of this one.
#[derive(Debug, Default)]
pub(super) struct Momentum {
    /// Iterations since the momentum was last zero.
    age: u32,
    /// ω of this substep.
    relaxation: f32,
    /// The smallest of the largest errors in this substep that are not rounding.
    least: f64,
    /// How often the iteration was calmed in this frame.
    pub(super) calmed: u32,
    /// Length of the last substep [s]; 0 when there was none in this frame.
    dt: f32,
}

impl Momentum {
    /// Forgets the last substep: what follows depends on positions and velocities alone, so that a frame can be
    /// computed from the one before.
    pub(super) fn forget(&mut self) {
        (self.dt, self.calmed) = (0.0, 0);
    }

    /// Starts a substep of `dt` [s] from the last one's pressures.
    pub(super) fn start(&mut self, solver: &mut Solver, setup: &Setup<'_>, dt: f32) {
        let scale = if self.dt > 0.0 { WARM_START * (dt / self.dt).powi(2) } else { 0.0 };
        (self.age, self.dt) = (0, dt);
        (self.relaxation, self.least) = (RELAXATION, f64::INFINITY);
        solver.unknowns.resize(solver.p.len());
        let Unknown { lambda, applied, last, .. } = &mut solver.unknowns.0;
        par::update(applied, |_, kappa| *kappa = if scale > 0.0 { *kappa * scale } else { 0.0 });
        last.clone_from(applied);
        par::fill(lambda, |i| -last[i]);
        if scale > 0.0 {
            solver.publish(setup.rest.inv_support);
            solver.correct(setup);
        }
    }

    /// Evaluates every constraint and its change of pressure. The residual counts what a step without momentum
    /// would change, so that dilation under pressure is an error like compression.
    pub(super) fn evaluate(&mut self, solver: &mut Solver, setup: &Setup<'_>, first: bool) -> Residual {
        let beta = self.age as f32 / (self.age + 3) as f32; // [nesterov83], as [odonoghue15] Eq. 4 has it
        let step = Step { beta, relaxation: self.relaxation, least: setup.least() };
        let residual = if first {
            solver.evaluate::<true>(setup, &step)
        } else {
            solver.evaluate::<false>(setup, &step)
        };
        self.age = if residual.uphill > 0.0 { 0 } else { self.age + 1 };
        self.least = self.least.min(residual.largest).max(ROUNDING);
        if residual.largest > GROWN * self.least {
            (self.age, self.least) = (0, residual.largest);
            self.relaxation = (CALMER * self.relaxation).max(CALMEST);
            self.calmed += 1;
        }
        residual
    }
}

/// One step of the iteration.
struct Step {
    /// How much of the last change momentum adds.
    beta: f32,
    /// ω.
    relaxation: f32,
    /// The least κ.
    least: f32,
}

impl Decide for Step {
    #[inline(always)]
    fn decide<L: Lanes>(&self, ratio: L, unknown: Unknown<L>) -> (Unknown<L>, Verdict<L>) {
        let Unknown { applied, last, denominator, .. } = unknown;
        let (least, relaxation) = (L::splat(self.least), L::splat(self.relaxation));
        let kappa = least.max(applied + relaxation * (ratio - L::splat(1.0)) / denominator);
        let ahead = least.max(kappa + L::splat(self.beta) * (kappa - last));
        // Where nothing can be corrected κ does not change, and zero times infinity is no number.
        let weight = denominator.min(L::splat(f32::MAX));
        let verdict = Verdict {
            error: (kappa - applied) * weight * L::splat(1.0 / self.relaxation),
            uphill: (applied - kappa) * (kappa - last) * weight,
        };
        (Unknown { lambda: applied - ahead, applied: ahead, last: kappa, denominator }, verdict)
    }
}
