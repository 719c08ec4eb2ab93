//! The paper's solver: Jacobi iterations without memory.
//!
//! *Method*: [pbf] Eqs. 11–12, Jacobi. *Departs from the paper*: equality constraints are under-relaxed.

use super::{
    Constraint,
    density::{self, ConstraintError, Multiplier, MultiplierUpdate, Residual},
    setup::SolverSetup,
    solve::Solver,
};
use crate::simd::Lanes;

/// Fraction of λ that is applied under the equality constraint. At 1 the Jacobi iteration diverges: a filled tank at rest
/// shakes itself to its energy bound. Compression needs no relaxation, since overshoots are not pulled back; there ½ leaves
/// a 32-layer column 2.5 times as compressed.
const EQUALITY_RELAXATION: f32 = 0.5;

/// Evaluates every constraint and its change of λ.
pub(super) fn evaluate(solver: &mut Solver, setup: &SolverSetup<'_>) -> Residual {
    let relaxation = match setup.constraint {
        Constraint::Compression => 1.0,
        Constraint::Equality => EQUALITY_RELAXATION,
    };
    solver.evaluate::<true>(setup, &JacobiUpdate { relaxation, min_error: setup.lower_bound() })
}

/// One iteration of the Jacobi solver.
struct JacobiUpdate {
    /// Fraction of λ that is applied.
    relaxation: f32,
    /// Smallest C that is corrected.
    min_error: f32,
}

impl MultiplierUpdate for JacobiUpdate {
    #[inline(always)]
    fn update<L: Lanes>(
        &self,
        ratio: L,
        _tensile_part: L,
        multiplier: Multiplier<L>,
    ) -> (Multiplier<L>, ConstraintError<L>) {
        let error = density::error(ratio, self.min_error);
        let lambda = L::splat(-self.relaxation) * error / multiplier.denominator; // λ_i, [pbf] Eq. 11
        (Multiplier { lambda, ..multiplier }, ConstraintError { error, uphill: L::splat(0.0) })
    }
}
