//! XSPH viscosity: neighbours move together.
//!
//! *Method*: [pbf] Eq. 17. *Departs from the paper*: the sum carries the volume weight m/ρ̄_ij with
//! ρ̄_ij = (ρ_i + ρ_j)/2, so that c is a fraction and the term keeps momentum exactly.

use super::{Xsph, vorticity::Neighbourhood};
use crate::{math::Vec3, par};

/// The term and its buffer.
#[derive(Debug)]
pub(super) struct Viscosity {
    c: f32,
    smoothed: Vec<Vec3>,
}

impl Viscosity {
    pub(super) fn new(params: &Xsph) -> Self {
        Self { c: params.strength, smoothed: Vec::new() }
    }

    /// Smooths `v` once.
    pub(super) fn apply(&mut self, at: Neighbourhood<'_>, v: &mut Vec<Vec3>) {
        self.smoothed.resize(v.len(), Vec3::zeros());
        let velocities = &*v;
        par::fill(&mut self.smoothed, |i| {
            let mut sum = Vec3::zeros();
            at.each(i, |j, _, q, weight| {
                let w = at.rest.density_scale * weight * (1.0 - q * q).powi(3);
                sum += (velocities[j] - velocities[i]) * w;
            });
            velocities[i] + sum * self.c // v_i^new, [pbf] Eq. 17
        });
        std::mem::swap(v, &mut self.smoothed);
    }
}
