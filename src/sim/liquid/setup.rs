//! What the passes of the density solver share besides the particles.

use super::{Constraint, rest::Rest, walls::Walls};

/// How far lists reach beyond h, as a fraction of h.
pub(super) const SKIN: f32 = 0.1;

/// What the solver needs to know besides the particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup<'a> {
    pub(super) rest: &'a Rest,
    pub(super) walls: &'a Walls,
    pub(super) constraint: Constraint,
    /// ε [1/m²].
    pub(super) softening: f32,
}

impl Setup<'_> {
    /// The least C_i that counts, and the least κ_i: nothing pulls under the compression constraint.
    pub(super) fn least(&self) -> f32 {
        match self.constraint {
            Constraint::Compression => 0.0,
            Constraint::Equality => f32::NEG_INFINITY,
        }
    }

    /// How far from a solid its share of density may reach, for particles that move within the lists' skin [m].
    #[inline(always)]
    pub(super) fn share_reach(&self) -> f32 {
        self.rest.support + self.rest.wall_shift.abs() + SKIN * self.rest.support
    }

    /// Σ_k |∇_k C_i|² + ε [1/m²]; infinite without neighbours, where nothing can be corrected, and at ε = 0
    /// nothing may be divided.
    #[inline(always)]
    pub(super) fn denominator(&self, gradient2: f32) -> f32 {
        let denominator = gradient2 + self.softening;
        if denominator <= 1e-6 * self.rest.lattice_gradient2 { f32::INFINITY } else { denominator }
    }
}
