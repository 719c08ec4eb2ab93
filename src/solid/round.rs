//! Closest points of the torus, the ellipsoid and the disc.
//!
//! *Method* Torus: in the half plane through the axis it is a circle. Ellipsoid: the closest point y has x_i = y_i (1 + t/a_i²);
//! t is the largest root of Σ (a_i x_i/(t + a_i²))² = 1 [eberly13], found by Newton's iteration from below, where the sum is convex
//! and falls. *Departs from the paper*: none. Double precision throughout.
//!
//! Limits: on the medial axis one of the closest points is taken by a fixed rule.

use crate::math::Vec3;
use nalgebra::Vector3;

/// Most iterations of Newton's method: from the pole each multiplies the distance to it by 3/2 at least, and 1e-12 has 68 such
/// steps to 1.
const MAX_NEWTON_ITERATIONS: usize = 100;

/// A component of a query below this part of its radius counts as that part: a point on the medial plane is moved to the upper
/// side.
const OFF_PLANE: f64 = 1e-12;

/// Distance to a torus and its unit normal.
pub(super) fn torus(x: Vec3, center: Vec3, axis: Vec3, radius: f32, tube: f32) -> (f32, Vec3) {
    let p: Vector3<f64> = x.cast() - center.cast::<f64>();
    let axis = direction(axis.cast(), Vector3::z());
    let along = axis.dot(&p);
    let radial = p - axis * along;
    let across = Vector3::from_fn(|i, _| if i == axis.iamin() { 1.0 } else { 0.0 });
    let out = direction(radial, direction(axis.cross(&across), Vector3::x()));
    let from_ring = out * (radial.dot(&out) - f64::from(radius)) + axis * along;
    ((from_ring.norm() - f64::from(tube)) as f32, direction(from_ring, out).cast())
}

/// Distance to a disc and its unit normal.
pub(super) fn disc(x: Vec3, center: Vec3, normal: Vec3, radius: f32, thickness: f32) -> (f32, Vec3) {
    let p: Vector3<f64> = x.cast() - center.cast::<f64>();
    let axis = direction(normal.cast(), Vector3::z());
    let along = axis.dot(&p);
    let radial = p - axis * along;
    let across = Vector3::from_fn(|i, _| if i == axis.iamin() { 1.0 } else { 0.0 });
    let out = direction(radial, direction(axis.cross(&across), Vector3::x()));
    let up = if along < 0.0 { -axis } else { axis };
    // Beyond the rim and beyond the face.
    let (rim, face) = (radial.dot(&out) - f64::from(radius), along.abs() - 0.5 * f64::from(thickness));
    if rim > 0.0 && face > 0.0 {
        let offset = out * rim + up * face;
        return (offset.norm() as f32, direction(offset, up).cast());
    }
    if rim > face { (rim as f32, out.cast()) } else { (face as f32, up.cast()) }
}

/// Distance to an ellipsoid with its axes along the coordinates, and its unit normal.
pub(super) fn ellipsoid(x: Vec3, center: Vec3, radii: Vec3) -> (f32, Vec3) {
    let p: Vector3<f64> = x.cast() - center.cast::<f64>();
    let a: Vector3<f64> = radii.cast();
    // By symmetry in the first octant; its walls are left by a hair.
    let side = p.map(|c| if c < 0.0 { -1.0 } else { 1.0 });
    let p = Vector3::from_fn(|i, _| p[i].abs().max(OFF_PLANE * a[i]));
    if !p.iter().all(|c| c.is_finite()) {
        return (if x.iter().any(|c| c.is_nan()) { f32::NAN } else { f32::INFINITY }, Vec3::z());
    }
    // t is counted from the pole of the shortest axis, where it would lose its digits.
    let beyond = a.map(|c| c * c - a.min() * a.min());
    let mut t = (0..3).map(|i| a[i] * p[i] - beyond[i]).fold(0.0, f64::max);
    for _ in 0..MAX_NEWTON_ITERATIONS {
        let terms = Vector3::from_fn(|i, _| a[i] * p[i] / (t + beyond[i]));
        let value = terms.norm_squared() - 1.0;
        let slope = -2.0 * (0..3).map(|i| terms[i] * terms[i] / (t + beyond[i])).sum::<f64>();
        let next = t - value / slope;
        if next <= t || next.is_nan() {
            break;
        }
        t = next;
    }
    let y = Vector3::from_fn(|i, _| a[i] * a[i] * p[i] / (t + beyond[i]));
    let gradient = Vector3::from_fn(|i, _| y[i] / (a[i] * a[i]));
    let n = direction(gradient.component_mul(&side), Vector3::z());
    let distance = (p - y).norm();
    ((if t < a.min() * a.min() { -distance } else { distance }) as f32, n.cast())
}

/// The direction of `v`, or `other` where it has none.
fn direction(v: Vector3<f64>, other: Vector3<f64>) -> Vector3<f64> {
    let length = v.norm();
    if length > 1e-300 && length.is_finite() { v / length } else { other }
}
