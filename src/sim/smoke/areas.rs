//! The areas of shapes.
//!
//! *Method*: in closed form; an ellipsoid by the formula of [thomsen04], whose error is at most 1.1 %. A mesh by its samples: each
//! sample nearer to the surface than a voxel h counts as h² (1 − |d|/h), which sums to the area.
//! *Limits*: the samples do not resolve parts of a mesh thinner than a voxel.

use crate::{
    math::Vec3,
    solid::{MeshShape, Shape},
};
use std::f32::consts::PI;

/// Exponent of the mean of [thomsen04].
const POWER: f32 = 1.6075;

/// The area of a shape [m²]; 0 for a plane.
pub(super) fn area(shape: &Shape) -> f32 {
    match shape {
        Shape::Plane { .. } => 0.0,
        Shape::Box { min, max } | Shape::Tank { min, max } => {
            let size = Vec3::from(*max) - Vec3::from(*min);
            2.0 * (size.x * size.y + size.y * size.z + size.z * size.x)
        }
        Shape::Sphere { radius, .. } => 4.0 * PI * radius * radius,
        Shape::Capsule { from, to, radius } => {
            let length = (Vec3::from(*to) - Vec3::from(*from)).norm();
            2.0 * PI * radius * (length + 2.0 * radius)
        }
        Shape::Torus { radius, tube, .. } => 4.0 * PI * PI * radius * tube,
        Shape::Ellipsoid { radii, .. } => {
            let [a, b, c] = radii.map(|radius| radius.powf(POWER));
            4.0 * PI * ((a * b + b * c + c * a) / 3.0).powf(1.0 / POWER)
        }
        Shape::Mesh(mesh) => sampled(mesh),
    }
}

fn sampled(mesh: &MeshShape) -> f32 {
    let samples = mesh.samples();
    let near = |d: &f32| f64::from((1.0 - d.abs() / samples.voxel).max(0.0));
    let nodes: f64 = samples.values.iter().map(near).sum();
    (nodes as f32) * (samples.voxel * mesh.scale).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sdf::Sampled;
    use std::sync::Arc;

    #[test]
    fn shapes_have_their_areas() {
        let (from, to) = ([0.0; 3], [0.0, 3.0, 4.0]);
        let ellipsoid = |radii| Shape::Ellipsoid { center: [1.0; 3], radii };
        // Oblate and prolate spheroids, eccentricity √(1 − 1/9), have areas in closed form.
        let e = (1.0_f32 - 1.0 / 9.0).sqrt();
        let oblate = 2.0 * PI * 9.0 * (1.0 + (1.0 - e * e) / e * e.atanh());
        let prolate = 2.0 * PI * (1.0 + 3.0 / e * e.asin());
        for (shape, exact, off) in [
            (Shape::Plane { point: from, normal: to }, 0.0, 0.0),
            (Shape::Box { min: [0.0; 3], max: [2.0, 1e-3, 3.0] }, 12.01, 1e-6),
            (Shape::Tank { min: [0.0; 3], max: [2.0, 1.0, 3.0] }, 22.0, 1e-6),
            (Shape::Sphere { center: from, radius: 0.5 }, PI, 1e-6),
            (Shape::Capsule { from, to, radius: 0.01 }, PI * 0.02 * 5.02, 1e-6),
            (Shape::Torus { center: from, axis: to, radius: 2.0, tube: 0.1 }, 0.8 * PI * PI, 1e-6),
            (ellipsoid([3.0, 1.0, 3.0]), oblate, 0.011),
            (ellipsoid([1.0, 1.0, 3.0]), prolate, 0.011),
        ] {
            let found = area(&shape);
            assert!((found - exact).abs() <= off * exact, "{shape:?}: {found} for {exact}");
        }
    }

    #[test]
    fn meshes_have_the_area_of_their_samples() {
        let capsule = Shape::Capsule { from: [0.0, 0.0, -0.8], to: [0.0, 0.0, 0.8], radius: 0.05 };
        let (voxel, origin) = (0.02, Vec3::new(-0.1, -0.1, -0.9));
        let nodes = [11, 11, 91];
        let at = |n: u32| Vec3::new((n % 11) as f32, (n / 11 % 11) as f32, (n / 121) as f32) * voxel + origin;
        let values = (0..11 * 11 * 91).map(|n| capsule.signed_distance(at(n))).collect();
        let mut mesh = MeshShape::new("capsule.ply");
        mesh.scale = 3.0;
        mesh.fill(Arc::new(Sampled { origin, voxel, nodes, values }));
        let (found, exact) = (area(&Shape::Mesh(mesh)), 9.0 * area(&capsule));
        assert!((found / exact - 1.0).abs() < 0.05, "{found} for {exact}");
    }
}
