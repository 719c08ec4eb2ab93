//! Parameters of the density solver, and what surrounds the particles.

use super::{Constraint, calibration::RestState, walls::Walls};

/// Skin of the neighbour lists beyond h, as a fraction of h.
pub(super) const LIST_SKIN: f32 = 0.1;

/// What the solver reads in addition to the particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct SolverSetup<'a> {
    pub(super) rest: &'a RestState,
    pub(super) walls: &'a Walls,
    pub(super) constraint: Constraint,
    /// ε [1/m²].
    pub(super) softening: f32,
}

impl SolverSetup<'_> {
    /// Lower bound of C_i and κ_i: under the compression constraint nothing pulls.
    pub(super) fn lower_bound(&self) -> f32 {
        match self.constraint {
            Constraint::Compression => 0.0,
            Constraint::Equality => f32::NEG_INFINITY,
        }
    }

    /// Skin of the neighbour lists [m].
    pub(super) fn skin(&self) -> f32 {
        LIST_SKIN * self.rest.support
    }

    /// Distance from a solid at which its density ends, for particles that move within the skin of the lists [m].
    #[inline(always)]
    pub(super) fn boundary_reach(&self) -> f32 {
        self.rest.support + self.rest.wall_shift.abs() + LIST_SKIN * self.rest.support
    }

    /// Whether a particle may touch a solid from which it was `clearance` [m] away when the lists were built, after a displacement
    /// since then, squared [m²].
    #[inline(always)]
    pub(super) fn is_near_solid(&self, clearance: f32, displacement2: f32) -> bool {
        let distance = clearance - 0.5 * self.rest.spacing;
        distance <= 0.0 || displacement2 >= distance * distance
    }

    /// Σ_k |∇_k C_i|² + ε [1/m²]; infinite without neighbours, where nothing can be corrected and ε = 0 would divide by
    /// zero.
    #[inline(always)]
    pub(super) fn denominator(&self, gradient2: f32) -> f32 {
        let denominator = gradient2 + self.softening;
        if denominator <= 1e-6 * self.rest.rest_gradient2 { f32::INFINITY } else { denominator }
    }
}
