//! XSPH viscosity: smoothing of velocities over neighbours.
//!
//! *Method*: [pbf] Eq. 17. *Departs from the paper*: the sum has the volume weight m/ρ̄_ij with ρ̄_ij = (ρ_i + ρ_j)/2, so
//! that c is a fraction and momentum is conserved exactly. Velocities relative to a neighbour that are small against what
//! gravity adds in a substep are noise of the density solve: `Xsph::rest` damps them more, by a weight which is symmetric.

use super::{
    Xsph, lanes,
    neighbourhood::{NeighbourPairs, Neighbourhood},
    pair::Pair,
    pass::{self, NeighbourPass},
};
use crate::{math::Vec3, par, simd::Lanes};

/// Relative velocity at which half of [`Xsph::rest`] acts, over the velocity that gravity adds in a substep.
const REST_SPEED: f32 = 0.4;

/// Smooths `v` once; `at` has the velocities before, and gravity adds `gain` [m/s] in a substep.
pub(super) fn apply(params: &Xsph, at: Neighbourhood<'_>, gain: f32, v: &mut [Vec3]) {
    let rest_speed2 = (REST_SPEED * gain).powi(2);
    par::for_chunks(v, par::CHUNK, |start, v| {
        pass::run(at.rest.kernel, XsphPass { at, start, params, rest_speed2, v });
    });
}

/// XSPH viscosity of a chunk of particles.
struct XsphPass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    params: &'a Xsph,
    /// Square of the relative velocity at which half of [`Xsph::rest`] acts [m²/s²].
    rest_speed2: f32,
    v: &'a mut [Vec3],
}

impl NeighbourPass for XsphPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        let [strength, rest, rest_speed2] =
            [self.params.strength, self.params.rest, self.rest_speed2].map(|value| L::splat(value));
        let smallest = L::splat(f32::MIN_POSITIVE);
        for (offset, v) in self.v.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.at.motion[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { q2, q, weight, .. } = self.at.pairs::<L>(i, index);
                let other = lanes::gather::<L>(self.at.motion, index);
                let u = [other[0] - own[0], other[1] - own[1], other[2] - own[2]];
                let u2 = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
                let c = strength + rest * rest_speed2 / (rest_speed2 + u2).max(smallest);
                sum = lanes::plus(sum, u, c * weight * P::density(q2, q));
            }
            *v += lanes::total(sum) * self.at.rest.density_scale; // v_i^new, [pbf] Eq. 17
        }
    }
}
