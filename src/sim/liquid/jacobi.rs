//! The paper's solver: every iteration corrects the error it finds, and forgets.
//!
//! *Method*: [pbf] Eqs. 11–12, Jacobi. *Departs from the paper*: equality constraints are under-relaxed.

use super::{
    Constraint,
    density::{Decide, Residual, Unknown, Verdict},
    setup::Setup,
    solve::{self, Solver},
};
use crate::simd::Lanes;

/// The fraction of λ taken under the equality constraint. At 1 the Jacobi iteration diverges: a filled tank at rest
/// shakes itself to its energy bound. Compression needs none, since what is pushed too far is not pulled back, and
/// there ½ leaves a 32-layer column 2.5 times as compressed.
const EQUALITY_RELAXATION: f32 = 0.5;

/// Evaluates every constraint and its λ.
pub(super) fn evaluate(solver: &mut Solver, setup: &Setup<'_>) -> Residual {
    let relaxation = match setup.constraint {
        Constraint::Compression => 1.0,
        Constraint::Equality => EQUALITY_RELAXATION,
    };
    solver.evaluate::<true>(setup, &Jacobi { relaxation, least: setup.least() })
}

/// One iteration.
struct Jacobi {
    /// The part of λ that is taken.
    relaxation: f32,
    /// The least C that is corrected.
    least: f32,
}

impl Decide for Jacobi {
    #[inline(always)]
    fn decide<L: Lanes>(&self, ratio: L, unknown: Unknown<L>) -> (Unknown<L>, Verdict<L>) {
        let error = solve::error(ratio, self.least);
        let lambda = L::splat(-self.relaxation) * error / unknown.denominator; // λ_i, [pbf] Eq. 11
        (Unknown { lambda, ..unknown }, Verdict { error, uphill: L::splat(0.0) })
    }
}
