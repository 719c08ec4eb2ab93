//! Relaxation: rotation of strengths towards the local vorticity.
//!
//! *Method*: [pedrizzetti92] with [alvarez24]'s correction: Γ ← [(1 − f) Γ + f |Γ| ω̂]/√b₂, f = 1 − e^(−dt/τ)
//! and b₂ = 1 − 2f(1 − f)(1 − cos) of the angle between Γ and ω, so that |Γ| stays.

use super::super::Gradient;
use crate::{math::Vec3, par};

/// Below this b₂, Γ and ω are opposite and f is a half: the direction of rotation is undetermined.
const MIN_B2: f32 = 1e-6;

/// Rotates every strength by the fraction `f` towards the vorticity of its velocity gradient.
pub(super) fn relax(strength: &mut [Vec3], gradient: &[Gradient], f: f32) {
    par::update(strength, |i, strength| {
        let omega = curl(&gradient[i]);
        let (size, vorticity) = (strength.norm(), omega.norm());
        // The direction of a zero vector is undefined.
        if size == 0.0 || vorticity == 0.0 {
            return;
        }
        let cos = (*strength / size).dot(&(omega / vorticity));
        let b2 = 1.0 - 2.0 * f * (1.0 - f) * (1.0 - cos);
        if b2 > MIN_B2 {
            *strength = (*strength * (1.0 - f) + omega * (f * size / vorticity)) / b2.sqrt(); // [alvarez24]
        }
    });
}

/// ω = ∇ × u.
fn curl(g: &Gradient) -> Vec3 {
    Vec3::new(g[(2, 1)] - g[(1, 2)], g[(0, 2)] - g[(2, 0)], g[(1, 0)] - g[(0, 1)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strengths_rotate_and_keep_their_size() {
        // A rotation about z: ω = (0, 0, 2).
        let gradient = [Gradient::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0); 3];
        for f in [0.0, 0.1, 0.5, 1.0] {
            let mut strength = [Vec3::new(0.3, 0.4, 0.0), Vec3::new(0.0, 3.0, -4.0), Vec3::zeros()];
            relax(&mut strength, &gradient, f);
            assert!(
                (strength[0].norm() - 0.5).abs() < 1e-6 && (strength[1].norm() - 5.0).abs() < 1e-5,
                "{f}"
            );
            assert_eq!(strength[2], Vec3::zeros());
            // A right angle: tan = f/(1 − f).
            let angle = strength[0].z.atan2(strength[0].xy().norm());
            assert!((angle - f.atan2(1.0 - f)).abs() < 1e-6, "{f}: {angle}");
        }
        let mut opposite = [Vec3::new(0.0, 0.0, -1.0)];
        relax(&mut opposite, &gradient[..1], 0.5);
        assert_eq!(opposite, [Vec3::new(0.0, 0.0, -1.0)]);
    }
}
