//! The kernel of the density: a cubic spline.

use super::sorted_particles::{Moments, SortedParticles, Weight};

/// V_j W(0, h) of every particle, in the cells' order.
pub(super) fn weights(particles: &SortedParticles, radius: f32) -> Vec<f32> {
    particles.moments::<Spline, false, _>(radius, |_| true, |_, moments: &Moments| 1.0 / moments.zeroth)
}

/// The kernel K.
struct Spline;

impl Weight for Spline {
    #[inline(always)]
    fn of(q: f32) -> f32 {
        kernel(q)
    }
}

/// K(q) = W(r, h)/W(0, h) of the cubic spline.
#[inline(always)]
pub(super) fn kernel(q: f32) -> f32 {
    let a = (1.0 - q).max(0.0);
    let b = (0.5 - q).max(0.0);
    2.0 * a * a * a - 8.0 * b * b * b
}
