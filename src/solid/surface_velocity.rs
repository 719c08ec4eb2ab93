//! How the surface of a mesh that deforms moves at a time: along its normal, and in itself.
//!
//! *Method*: a point of the surface moves as the nearest point of the triangles, between whose corners velocities are interpolated. Its
//! angular velocity is that of the nearest rigid motion: Ω = I⁻¹ L of its area, least squares. No orientation or hole of the mesh matters.
//!
//! Symbols: L → `momentum`, Σ A r × v [m⁴/s]; I → `inertia`, Σ A (r² − r rᵀ) [m⁴]; r from the centre of the area.

use super::{Deformation, MeshShape, Pose};
use crate::{
    math::Vec3,
    sdf::{TriangleBvh, Triangles, closest_point},
};
use nalgebra::{Matrix3, Vector3};

/// Velocity of the surface of a mesh at a time, in the axes of its collider.
#[derive(Debug)]
pub(crate) struct SurfaceVelocity {
    /// From the file's axes, after its scale.
    pose: Pose,
    scale: f32,
    mesh: Triangles,
    bvh: TriangleBvh,
    /// Of the vertices, in the file's units and axes [1/s].
    velocity: Vec<Vec3>,
}

impl SurfaceVelocity {
    /// Velocities of `shape` at `time` [s], as the mean over a `half_interval` [s] before and after; `None` if it does not deform.
    pub(crate) fn new(shape: &MeshShape, time: f64, half_interval: f64) -> Option<Self> {
        let deformation = shape.deformation()?;
        let mesh = mesh_at(deformation, time);
        let (bvh, velocity) = (TriangleBvh::new(&mesh), deformation.velocities(time, half_interval));
        Some(Self { pose: shape.pose(), scale: shape.scale, mesh, bvh, velocity })
    }

    /// Velocity of the surface nearest to `x` [m/s].
    pub(crate) fn at(&self, x: Vec3) -> Vec3 {
        let local = self.pose.to_local(x) / self.scale;
        let Some(nearest) = self.bvh.nearest(local, f32::INFINITY) else { return Vec3::zeros() };
        let corners = self.mesh.corners(nearest.triangle as usize);
        let weights = barycentric(&corners, closest_point(&corners, local));
        let of = self.mesh.triangles[nearest.triangle as usize].map(|corner| self.velocity[corner as usize]);
        self.pose.rotation * (of[0] * weights[0] + of[1] * weights[1] + of[2] * weights[2]) * self.scale
    }

    /// Mean position of the vertices [m].
    pub(crate) fn middle(&self) -> Vec3 {
        let sum: Vector3<f64> = self.mesh.positions.iter().map(|x| x.cast::<f64>()).sum();
        self.pose.to_world((sum / self.mesh.positions.len() as f64).cast() * self.scale)
    }
}

/// Angular velocity of `shape` at `time` [1/s] by the motion of its vertices, as the mean over a `half_interval` [s] before and after.
pub(crate) fn angular_velocity(shape: &MeshShape, time: f64, half_interval: f64) -> Vec3 {
    let Some(deformation) = shape.deformation() else { return Vec3::zeros() };
    let velocity = deformation.velocities(time, half_interval);
    if velocity.iter().all(|v| *v == Vec3::zeros()) {
        return Vec3::zeros();
    }
    let mesh = mesh_at(deformation, time);
    let mut faces = Vec::with_capacity(mesh.triangles.len());
    let (mut area, mut middle, mut mean) = (0.0, Vector3::zeros(), Vector3::zeros());
    for (number, triangle) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = mesh.corners(number).map(|x| x.cast::<f64>());
        let [u, v, w] = triangle.map(|corner| velocity[corner as usize].cast::<f64>());
        let (own, x, v) = ((b - a).cross(&(c - a)).norm(), (a + b + c) / 3.0, (u + v + w) / 3.0);
        (area, middle, mean) = (area + own, middle + x * own, mean + v * own);
        faces.push((own, x, v));
    }
    if area == 0.0 {
        return Vec3::zeros();
    }
    let (middle, mean) = (middle / area, mean / area);
    let (mut momentum, mut inertia) = (Vector3::<f64>::zeros(), Matrix3::<f64>::zeros());
    for (area, x, v) in faces {
        let (r, v) = (x - middle, v - mean);
        momentum += r.cross(&v) * area;
        inertia += (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * area;
    }
    let omega = inertia.try_inverse().map_or(Vector3::zeros(), |inverse| inverse * momentum);
    shape.pose().rotation * omega.cast()
}

/// The mesh at a time, in the file's units and axes.
fn mesh_at(deformation: &Deformation, time: f64) -> Triangles {
    Triangles { positions: deformation.positions(time), triangles: deformation.triangles().to_vec() }
}

/// Barycentric coordinates of a point of a triangle; of one without area, of its nearest corner.
fn barycentric(&[a, b, c]: &[Vec3; 3], x: Vec3) -> [f32; 3] {
    let (u, v, d) = (b - a, c - a, x - a);
    let normal = u.cross(&v);
    let square = normal.norm_squared();
    let second = d.cross(&v).dot(&normal) / square;
    let third = u.cross(&d).dot(&normal) / square;
    if second.is_finite() && third.is_finite() {
        let second = second.clamp(0.0, 1.0);
        let third = third.clamp(0.0, 1.0 - second);
        return [1.0 - second - third, second, third];
    }
    let distances = [a, b, c].map(|corner| (x - corner).norm_squared());
    let nearest =
        (0..3).fold(0, |best, corner| if distances[corner] < distances[best] { corner } else { best });
    std::array::from_fn(|corner| if corner == nearest { 1.0 } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    /// Two boxes, of which one may be seen from inside and one lacks a side, after `motion` of their corners.
    fn boxes(inside_out: bool, open: bool, motion: impl Fn(Vec3) -> Vec3) -> MeshShape {
        let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
        let block =
            |shift: f32| (0..8).map(move |i| Vec3::from_fn(|axis, _| corner(i, axis)) + Vec3::x() * shift);
        let before: Vec<Vec3> = block(0.0).chain(block(2.0)).collect();
        let after = before.iter().map(|&x| motion(x)).collect();
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let first = sides.iter().skip(usize::from(open)).flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        let second =
            sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).map(|face| face.map(|i| i + 8));
        let turned = |[a, b, c]: [u32; 3]| if inside_out { [a, c, b] } else { [a, b, c] };
        let faces = first.chain(second.map(turned)).collect();
        let deformation = Deformation::new(faces, vec![before, after], vec![0.0, 0.1], 16).unwrap();
        let mut shape = MeshShape::new("made here");
        shape.scale = 0.5;
        shape.rotate = [90.0, 0.0, 0.0];
        shape.fill_deforming(Arc::new(deformation));
        shape
    }

    #[test]
    fn surfaces_move_along_themselves_and_turn() {
        // A turn about the file's z by 0.1 rad a second, which becomes −y, and a motion along it.
        let omega = Vec3::new(0.0, -0.1, 0.0);
        let turn = |x: Vec3| x + (Vec3::z() * 0.1).cross(&x) * 0.1 + Vec3::z() * 0.02;
        for inside_out in [false, true] {
            let shape = boxes(inside_out, false, turn);
            assert!((angular_velocity(&shape, 0.05, 1e-3) - omega).norm() < 1e-4);
            // At the end the half after it is at rest.
            assert!((angular_velocity(&shape, 0.1, 1e-3) - omega * 0.5).norm() < 1e-4);
            assert_eq!(angular_velocity(&shape, 0.2, 1e-3), Vec3::zeros());
            let surface = SurfaceVelocity::new(&shape, 0.05, 1e-3).unwrap();
            for x in [[0.25, 0.1, 0.05], [1.3, -0.2, 0.1], [1.0, 0.0, 0.3]].map(Vec3::from) {
                // The nearest point of a face that is 0.05 m off at most.
                let found = surface.at(x) - Vec3::new(0.0, -0.1, 0.0);
                assert!((found - omega.cross(&x)).norm() < 0.1 * 0.06, "{x}: {found}");
            }
            assert!((surface.middle() - Vec3::new(0.5, -0.005, 0.0)).norm() < 5e-3, "{}", surface.middle());
        }
        let glide = |x: Vec3| x + Vec3::new(0.03, 0.02, 0.01);
        assert!(angular_velocity(&boxes(true, true, glide), 0.05, 1e-3).norm() < 1e-5);
        assert!((angular_velocity(&boxes(true, true, turn), 0.05, 1e-3) - omega).norm() < 1e-4);
        // Growth is no turn.
        assert!(angular_velocity(&boxes(false, false, |x| x * 1.1), 0.05, 1e-3).norm() < 1e-5);
        // Half a turn between two samples: in the middle all triangles lie on a line.
        let turned = boxes(false, false, |x| Vec3::new(-x.x, -x.y, x.z));
        assert_eq!(angular_velocity(&turned, 0.05, 1e-3), Vec3::zeros());
        assert_eq!(angular_velocity(&MeshShape::new("rigid.ply"), 0.0, 1e-3), Vec3::zeros());
        assert!(SurfaceVelocity::new(&MeshShape::new("rigid.ply"), 0.0, 1e-3).is_none());
    }

    #[test]
    fn weights_are_those_of_the_point() {
        let corners = [Vec3::zeros(), Vec3::x() * 2.0, Vec3::y()];
        let x = Vec3::new(0.5, 0.25, 0.0);
        let [a, b, c] = barycentric(&corners, x);
        assert!((a - 0.5).abs() < 1e-6 && (b - 0.25).abs() < 1e-6 && (c - 0.25).abs() < 1e-6);
        assert_eq!(
            barycentric(&[Vec3::zeros(), Vec3::x(), Vec3::x() * 2.0], Vec3::x() * 1.8),
            [0.0, 0.0, 1.0]
        );
    }
}
