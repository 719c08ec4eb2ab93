//! Rotations whose bits are the same on every system, unlike those of the system's sines (see `elementary`).

use super::elementary::{atan2, cos, sin};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

/// The rotation about X, then Y, then Z by these angles [rad].
pub(crate) fn from_euler_angles(angles: Vector3<f64>) -> UnitQuaternion<f64> {
    let [[sx, cx], [sy, cy], [sz, cz]] =
        [angles.x, angles.y, angles.z].map(|angle| [sin(0.5 * angle), cos(0.5 * angle)]);
    UnitQuaternion::new_unchecked(Quaternion::new(
        cx * cy * cz + sx * sy * sz,
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
    ))
}

/// The angle between two rotations [rad], 0 to π.
pub(crate) fn angle_between(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> f64 {
    let turn = a.rotation_to(b);
    2.0 * atan2(turn.imag().norm(), turn.w.abs())
}

/// The rotation at `part` of the shorter arc from `a` to `b`; `None` if both arcs are half a turn.
pub(crate) fn slerp(
    a: &UnitQuaternion<f64>,
    b: &UnitQuaternion<f64>,
    part: f64,
) -> Option<UnitQuaternion<f64>> {
    // The sine of half the angle of the arc below which it counts as none.
    const NONE: f64 = 1e-9;
    let dot = a.coords.dot(&b.coords);
    let (dot, b) = if dot < 0.0 { (-dot, -b.coords) } else { (dot, b.coords) };
    let across = (1.0 - dot * dot).max(0.0).sqrt();
    if dot == 0.0 {
        return None;
    }
    if across < NONE {
        return Some(*a);
    }
    let angle = atan2(across, dot);
    let coords = (a.coords * sin((1.0 - part) * angle) + b * sin(part * angle)) / across;
    Some(UnitQuaternion::new_normalize(Quaternion::from(coords)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_are_those_of_the_algebra_library() {
        let angles =
            [[0.3, -0.8, 1.1], [2.9, 1.5, -2.2], [0.0, 0.0, 0.0], [-0.1, 4.0, 7.0]].map(Vector3::from);
        let library = |a: Vector3<f64>| UnitQuaternion::from_euler_angles(a.x, a.y, a.z);
        let close = |a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>| (a.coords - b.coords).norm() < 1e-12;
        for a in angles {
            assert!(close(&from_euler_angles(a), &library(a)), "{a}");
            for b in angles.map(from_euler_angles) {
                let a = from_euler_angles(a);
                assert!((angle_between(&a, &b) - a.angle_to(&b)).abs() < 1e-12);
                for part in [0.0, 0.25, 0.9, 1.0] {
                    let (found, expected) = (slerp(&a, &b, part).unwrap(), a.slerp(&b, part));
                    assert!(close(&found, &expected), "{a} {b} {part}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn half_a_turn_has_no_shorter_arc() {
        let turned = from_euler_angles(Vector3::new(std::f64::consts::PI, 0.0, 0.0));
        let none = UnitQuaternion::identity();
        // The cosine of a quarter turn is not 0 in doubles.
        let exact = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
        assert!(slerp(&none, &exact, 0.5).is_none() && slerp(&none, &turned, 0.5).is_some());
        assert!((angle_between(&none, &exact) - std::f64::consts::PI).abs() < 1e-15);
    }
}
