//! Artificial pressure: particles that come too close repel each other.
//!
//! *Method*: s_corr of [pbf] Eq. 13 in the sum of Eq. 14. *Departs from the paper*: there the term joins every
//! iteration, so that its effect grows with their number and, as a displacement, with 1/Δt². Here it is an
//! acceleration, applied once a substep before the density solve: what it does in a second depends neither on
//! the iterations nor on the substeps, and relative to gravity not on the spacing either. s_corr is measured in
//! the λ that would undo C = 1 on the filled lattice, over τ² with τ = √(spacing/[`SCALE`]).
//!
//! Limits: explicit; a substep moves a particle by at most half a spacing, counted when it would be more.

use super::{ArtificialPressure, rest::Rest, solve::limit};
use crate::{math::Vec3, par, space::Neighbours};

/// Acceleration that stands for strength 1 [m/s²]. With it, two particles half a spacing apart part with about ten g
/// at the paper's k = 0.1. A tenth of it leaves an equality-constrained dam break clumping and gaining energy in
/// every substep; ten times as much boils.
const SCALE: f32 = 981.0;

/// The term and its buffer.
#[derive(Debug)]
pub(super) struct Repulsion {
    params: ArtificialPressure,
    /// Displacements [m].
    push: Vec<Vec3>,
}

impl Repulsion {
    pub(super) fn new(params: ArtificialPressure) -> Self {
        Self { params, push: Vec::new() }
    }

    /// Moves the predicted positions `p` apart for a substep of `dt` [s]; returns how many pushes were cut short.
    pub(super) fn apply(&mut self, rest: &Rest, lists: &Neighbours, p: &mut [Vec3], dt: f32) -> u64 {
        self.push.resize(p.len(), Vec3::zeros());
        let lambda = -self.params.strength * SCALE / rest.spacing / rest.lattice_gradient2;
        let w_reference = 1.0 - self.params.reference.powi(2);
        let power = 3 * self.params.exponent as i32;
        let positions = &*p;
        par::fill(&mut self.push, |i| {
            let mut sum = Vec3::zeros();
            for &j in lists.of(i) {
                let d = (positions[i] - positions[j as usize]) * rest.inv_support;
                let q2 = d.norm_squared();
                if q2 < 1.0 && q2 > 0.0 {
                    let q = q2.sqrt();
                    let s_corr = lambda * ((1.0 - q2) / w_reference).powi(power); // s_corr, [pbf] Eq. 13
                    sum -= d * (s_corr * (1.0 - q) * (1.0 - q) / q);
                }
            }
            sum * (rest.gradient_scale * dt * dt) // the last term of [pbf] Eq. 14, times Δt²/τ²
        });
        let push = &self.push;
        let shortened = par::sum(p.len(), |i| f64::from(u8::from(limit(push[i], rest.spacing).1)));
        par::update(p, |i, x| *x += limit(push[i], rest.spacing).0);
        shortened as u64
    }
}
