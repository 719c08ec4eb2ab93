//! Name, volume and area of shapes.
//!
//! *Method*: in closed form; the area of an ellipsoid by the formula of [thomsen04], whose error is at most 1.1 %. A mesh by its samples: each
//! sample nearer to the surface than a voxel h counts as h² (1 − |d|/h), which sums to the area.
//! *Limits*: the samples do not resolve parts of a mesh thinner than a voxel.

use super::{MeshShape, Shape};
use crate::math::elementary::powf;
use crate::{math::Vec3, sdf::Sampled};
use std::f32::consts::PI;

/// Exponent of the mean of [thomsen04].
const POWER: f32 = 1.6075;

impl Shape {
    /// Key of the shape in presets.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Plane { .. } => "plane",
            Self::Box { .. } => "box",
            Self::Sphere { .. } => "sphere",
            Self::Capsule { .. } => "capsule",
            Self::Tank { .. } => "tank",
            Self::Torus { .. } => "torus",
            Self::Ellipsoid { .. } => "ellipsoid",
            Self::Disc { .. } => "disc",
            Self::Mesh(_) => "mesh",
        }
    }

    /// Area of the surface [m²]; 0 for a plane.
    pub(crate) fn area(&self) -> f32 {
        match self {
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
                let [a, b, c] = radii.map(|radius| powf(radius, POWER));
                4.0 * PI * powf((a * b + b * c + c * a) / 3.0, 1.0 / POWER)
            }
            Shape::Disc { radius, thickness, .. } => 2.0 * PI * radius * (radius + thickness),
            Shape::Mesh(mesh) => sampled(mesh),
        }
    }

    /// Volume inside [m³]; zero for meshes, unbounded shapes and negative dimensions.
    pub(crate) fn volume(&self) -> f64 {
        use std::f64::consts::PI;
        match self {
            Shape::Box { min, max } => {
                (0..3).map(|axis| (f64::from(max[axis]) - f64::from(min[axis])).max(0.0)).product()
            }
            Shape::Sphere { radius, .. } => 4.0 / 3.0 * PI * length_of(*radius).powi(3),
            Shape::Capsule { from, to, radius } => {
                let square = |axis: usize| (f64::from(to[axis]) - f64::from(from[axis])).powi(2);
                let length = (0..3).map(square).sum::<f64>().sqrt();
                PI * length_of(*radius).powi(2) * (length + 4.0 / 3.0 * length_of(*radius))
            }
            Shape::Torus { radius, tube, .. } => {
                2.0 * PI * PI * length_of(*radius) * length_of(*tube).powi(2)
            }
            Shape::Ellipsoid { radii, .. } => {
                4.0 / 3.0 * PI * radii.iter().map(|&radius| length_of(radius)).product::<f64>()
            }
            Shape::Disc { radius, thickness, .. } => PI * length_of(*radius).powi(2) * length_of(*thickness),
            Shape::Plane { .. } | Shape::Tank { .. } | Shape::Mesh(_) => 0.0,
        }
    }
}

/// A length that may be negative in a preset that is being checked [m].
fn length_of(dimension: f32) -> f64 {
    f64::from(dimension).max(0.0)
}

fn sampled(mesh: &MeshShape) -> f32 {
    let area = |(samples, part): (&Sampled, f32)| {
        let near = |d: &f32| f64::from((1.0 - d.abs() / samples.voxel).max(0.0));
        let nodes: f64 = samples.values.iter().map(near).sum();
        (nodes as f32) * (samples.voxel * mesh.scale).powi(2) * part
    };
    mesh.fields().map(area).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    #[test]
    fn shapes_have_their_volumes() {
        use std::f64::consts::PI;
        let center = [1.0; 3];
        for (shape, exact) in [
            (Shape::Box { min: [0.0; 3], max: [1.0, 2.0, 3.0] }, 6.0),
            (Shape::Box { min: [0.0; 3], max: [1.0, -2.0, 3.0] }, 0.0),
            (Shape::Sphere { center, radius: 2.0 }, 32.0 / 3.0 * PI),
            (Shape::Capsule { from: [0.0; 3], to: [0.0, 3.0, 4.0], radius: 3.0 }, 81.0 * PI),
            (Shape::Capsule { from: [0.0; 3], to: [0.0, 3.0, 4.0], radius: -0.1 }, 0.0),
            (Shape::Torus { center, axis: center, radius: 2.0, tube: 0.5 }, PI * PI),
            (Shape::Torus { center, axis: center, radius: 2.0, tube: -0.5 }, 0.0),
            (Shape::Ellipsoid { center, radii: [1.0, 2.0, 3.0] }, 8.0 * PI),
            (Shape::Disc { center, normal: center, radius: 2.0, thickness: 0.5 }, 2.0 * PI),
            (Shape::Ellipsoid { center, radii: [-1.0, -2.0, 3.0] }, 0.0),
        ] {
            assert!((shape.volume() - exact).abs() < 1e-6, "{shape:?}: {}", shape.volume());
        }
    }

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
            (Shape::Disc { center: from, normal: to, radius: 0.5, thickness: 0.1 }, 0.6 * PI, 1e-6),
            (ellipsoid([3.0, 1.0, 3.0]), oblate, 0.011),
            (ellipsoid([1.0, 1.0, 3.0]), prolate, 0.011),
        ] {
            let found = shape.area();
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
        let (found, exact) = (Shape::Mesh(mesh).area(), 9.0 * capsule.area());
        assert!((found / exact - 1.0).abs() < 0.05, "{found} for {exact}");
    }
}
