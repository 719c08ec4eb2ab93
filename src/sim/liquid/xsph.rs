//! XSPH viscosity: smoothing of velocities over neighbours.
//!
//! *Method*: [pbf] Eq. 17. *Departs from the paper*: the sum has the volume weight m/ρ̄_ij with ρ̄_ij = (ρ_i + ρ_j)/2, so
//! that c is a fraction and momentum is conserved exactly.

use super::{
    Xsph, lanes,
    neighbourhood::{NeighbourPairs, Neighbourhood},
    pair::Pair,
    pass::{self, NeighbourPass},
};
use crate::{math::Vec3, par, simd::Lanes};

/// Smooths `v` once; `at` has the velocities before.
pub(super) fn apply(params: &Xsph, at: Neighbourhood<'_>, v: &mut [Vec3]) {
    par::for_chunks(v, par::CHUNK, |start, v| {
        pass::run(at.rest.kernel, XsphPass { at, start, c: params.strength, v });
    });
}

/// XSPH viscosity of a chunk of particles.
struct XsphPass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    c: f32,
    v: &'a mut [Vec3],
}

impl NeighbourPass for XsphPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        let c = self.c * self.at.rest.density_scale;
        for (offset, v) in self.v.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.at.motion[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { q2, q, weight, .. } = self.at.pairs::<L>(i, index);
                let other = lanes::gather::<L>(self.at.motion, index);
                let u = [other[0] - own[0], other[1] - own[1], other[2] - own[2]];
                sum = lanes::plus(sum, u, weight * P::density(q2, q));
            }
            *v += lanes::total(sum) * c; // v_i^new, [pbf] Eq. 17
        }
    }
}
