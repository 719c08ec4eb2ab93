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
pub(super) const REST_SPEED: f32 = 0.4;

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState, lanes::Node},
        space::{CellGrid, Neighbours},
    };

    #[test]
    fn slow_relative_motion_is_damped_more_and_momentum_is_conserved() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let random =
            |k: usize| ((k as u32).wrapping_mul(2_654_435_761).rotate_left(9) >> 16) as f32 / 65536.0 - 0.5;
        let p: Vec<Vec3> = (0..512)
            .map(|k| {
                let cell = Vec3::new((k % 8) as f32, (k / 8 % 8) as f32, (k / 64) as f32);
                (cell + Vec3::new(random(3 * k), random(3 * k + 1), random(3 * k + 2)) * 0.2) * 0.1
            })
            .collect();
        let lists = Neighbours::build(&CellGrid::new(&p, rest.support), &p, rest.support);
        let nodes: Vec<Node> =
            (0..512).map(|i| Node::new(p[i] * rest.inv_support, 1.0 + 0.1 * random(i))).collect();
        let drift = Vec3::new(2.0, 0.0, -1.0);
        let noise = |k: usize| Vec3::new(random(3 * k), random(3 * k + 1), random(3 * k + 2));
        // Kinetic energy of the noise that is left, for noise of `speed` where gravity adds `gain` [m/s].
        let left = |params: &Xsph, speed: f32, gain: f32| {
            let before: Vec<Vec3> = (0..512).map(|k| drift + noise(k) * speed).collect();
            let motion: Vec<Node> = before.iter().map(|&v| Node::new(v, 0.0)).collect();
            let at = Neighbourhood { rest: &rest, nodes: &nodes, motion: &motion, lists: &lists };
            let mut after = before.clone();
            apply(params, at, gain, &mut after);
            let sum = |v: &[Vec3]| v.iter().map(|v| v.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
            let moved = (sum(&after) - sum(&before)).norm() / 512.0;
            assert!(moved < 1e-6, "momentum changes by {moved} m/s");
            let energy = |v: &[Vec3]| v.iter().map(|v| f64::from((v - drift).norm_squared())).sum::<f64>();
            energy(&after) / energy(&before)
        };
        let [plain, both] = [0.0, 0.4].map(|rest| Xsph { strength: 0.01, rest });
        let without = left(&plain, 0.1, 0.1);
        assert!((0.95..0.99).contains(&without), "{without}");
        assert!((left(&plain, 1e-3, 0.1) - without).abs() < 1e-3, "the paper's term is linear");
        assert!((left(&both, 0.1, 0.0) - without).abs() < 1e-9, "nothing rests without gravity");
        let [slow, fast] = [1e-3, 10.0].map(|speed| left(&both, speed, 0.1));
        assert!(
            (0.5..0.7).contains(&slow) && (fast - without).abs() < 1e-3,
            "slow {slow}, fast {fast}, without {without}"
        );
    }
}
