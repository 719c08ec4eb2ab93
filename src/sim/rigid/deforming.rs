//! Colliders whose shape or size changes, as obstacles of rigid bodies.
//!
//! *Method*: in a substep the collider has the shape of its start. Its surface moves with the nearest point of its triangles
//! (`solid/surface_velocity.rs`), so that bodies are pushed along the normal and dragged along by friction.
//! Limits: what is thinner than the distance of the points of a body, and of its own points, is not felt.

use super::samples::SurfacePoint;
use crate::{
    math::Vec3,
    solid::{Deformation, MeshShape, Shape, Solid, SurfaceVelocity},
};
use std::{cell::OnceCell, collections::BTreeSet};

/// Cells along the longest side of a mesh, of which each has at most one point.
const CELLS_ALONG_SIDE: f32 = 16.0;

/// A collider whose shape or size changes.
#[derive(Clone, Debug)]
pub(super) struct DeformingCollider {
    solid: Solid,
    /// Points of a mesh at which contacts are found: triangles, and the weights of their corners.
    places: Vec<(u32, [f32; 3])>,
}

/// The surface of a collider that deforms, in a substep.
pub(super) struct Deformed {
    now: f64,
    dt: f64,
    shape: Shape,
    points: Vec<SurfacePoint>,
    /// Size at the end over that at the start.
    growth: f32,
    /// Computed when it is needed: `None` of what only changes its size.
    velocity: OnceCell<Option<SurfaceVelocity>>,
}

impl DeformingCollider {
    /// `None` if the solid keeps its form.
    pub(super) fn of(solid: &Solid) -> Option<Self> {
        let made = || Self { solid: solid.clone(), places: scattered_places(&solid.shape) };
        solid.is_deforming().then(made)
    }

    /// Centre and radius of a ball that contains it at all times, in its own axes [m].
    pub(super) fn bounding_ball(&self) -> (Vec3, f32) {
        let [smallest, largest] = self.solid.scales();
        match self.solid.shape.bounding_ball() {
            Some(ball) if smallest == largest => (ball.0 * largest, ball.1 * largest),
            _ => (Vec3::zeros(), self.solid.shape.reach() * largest),
        }
    }

    /// Smallest size over that of the shape as written.
    pub(super) fn smallest_scale(&self) -> f64 {
        f64::from(self.solid.scales()[0])
    }

    /// Bound of the displacement of its points in the substep from `now` [s] of `dt` [s], with that of its pose [m].
    pub(super) fn largest_displacement(&self, now: f64, dt: f64) -> f32 {
        (self.solid.fastest(now, now + dt) * dt) as f32
    }

    /// Its surface in the substep from `now` [s] of `dt` [s]; `points` are those of the shape as written.
    pub(super) fn at(&self, now: f64, dt: f64, points: &[SurfacePoint]) -> Deformed {
        let (solid, scale) =
            (&self.solid, |time| self.solid.motion.as_ref().map_or(1.0, |motion| motion.scale(time)));
        let shape = solid.shape_at(now).into_owned();
        let points = match &shape {
            Shape::Mesh(mesh) if mesh.deformation().is_some() => self.points_of(mesh, now),
            _ => points
                .iter()
                .map(|point| SurfacePoint { x: point.x * scale(now), radius: point.radius * scale(now) })
                .collect(),
        };
        Deformed { now, dt, shape, points, growth: scale(now + dt) / scale(now), velocity: OnceCell::new() }
    }

    fn points_of(&self, mesh: &MeshShape, time: f64) -> Vec<SurfacePoint> {
        let Some(deformation) = mesh.deformation() else { return Vec::new() };
        let positions = deformation.positions(time);
        let place = |&(triangle, weights): &(u32, [f32; 3])| {
            let corners = deformation.triangles()[triangle as usize].map(|corner| positions[corner as usize]);
            blend(corners, weights)
        };
        let points: Vec<Vec3> = self.places.iter().map(place).collect();
        mesh.place(&points).into_iter().map(|x| SurfacePoint { x, radius: 0.0 }).collect()
    }
}

impl Deformed {
    /// The shape at the start of the substep.
    pub(super) fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Points of its surface at the start of the substep, in its own axes.
    pub(super) fn points(&self) -> &[SurfacePoint] {
        &self.points
    }

    /// Where the surface nearest to `x` takes it until the end of the substep, in its own axes.
    pub(super) fn moved(&self, x: Vec3) -> Vec3 {
        let velocity = self.velocity.get_or_init(|| match &self.shape {
            Shape::Mesh(mesh) => SurfaceVelocity::new(mesh, self.now + 0.5 * self.dt, 0.5 * self.dt),
            _ => None,
        });
        let by = velocity.as_ref().map_or_else(Vec3::zeros, |velocity| velocity.at(x) * self.dt as f32);
        (x + by) * self.growth
    }
}

fn blend(corners: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// Places on the triangles of a mesh that deforms, its vertices first, one at most in each cell of a grid around its first sample; none on other shapes.
fn scattered_places(shape: &Shape) -> Vec<(u32, [f32; 3])> {
    let Shape::Mesh(mesh) = shape else { return Vec::new() };
    let Some(mesh) = mesh.deformation().map(Deformation::first_mesh) else { return Vec::new() };
    let Some((low, high)) = mesh.bounds() else { return Vec::new() };
    let cell = (high - low).max() / CELLS_ALONG_SIDE;
    let (mut taken, mut places) = (BTreeSet::new(), Vec::new());
    let mut take = |triangle: usize, weights: [f32; 3]| {
        let at = (blend(mesh.corners(triangle), weights) - low) / cell;
        if taken.insert([at.x, at.y, at.z].map(|c| c as u32)) {
            places.push((triangle as u32, weights));
        }
    };
    for triangle in 0..mesh.triangles.len() {
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            .into_iter()
            .for_each(|weights| take(triangle, weights));
    }
    for triangle in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(triangle);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let parts = (longest / cell).ceil().max(1.0) as u16;
        for i in 0..=parts {
            for j in 0..=parts - i {
                let [u, v] = [i, j].map(|k| f32::from(k) / f32::from(parts));
                take(triangle, [1.0 - u - v, u, v]);
            }
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        control::Unwatched,
        sim::{
            World,
            rigid::{BodyParams, RigidBodies},
        },
        solid::{Interpolation, Keyframe, Motion},
    };
    use std::sync::Arc;

    const SECONDS: f64 = 1.5;

    /// A box from `low` to `high` whose corners, from the first second to the last, are displaced by `motion`.
    fn mesh(low: [f32; 3], high: [f32; 3], motion: impl Fn(Vec3, f32) -> Vec3) -> Solid {
        let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { high[axis] } else { low[axis] };
        let corners =
            |time: f32| (0..8).map(|i| motion(Vec3::from_fn(|axis, _| corner(i, axis)), time)).collect();
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces = sides.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let times: Vec<f64> = (0..=15).map(|k| 0.1 * f64::from(k)).collect();
        let samples = times.iter().map(|&time| corners(time as f32)).collect();
        let mut shape = MeshShape::new("made here");
        shape.fill_deforming(Arc::new(Deformation::new(faces, samples, times, 16).unwrap()));
        Solid::fixed(Shape::Mesh(shape))
    }

    /// Position and velocity of a body after [`SECONDS`].
    fn end_of(body: BodyParams, gravity: Vec3, solid: Solid) -> (Vec3, Vec3) {
        let world = World { gravity, solids: vec![solid] };
        let mut bodies = RigidBodies::new(&[body], &world).unwrap();
        for frame in 0..36 {
            bodies.begin_frame();
            bodies.advance([f64::from(frame) / 24.0, 1.0 / 24.0], &mut Unwatched).unwrap();
        }
        assert!((36.0 / 24.0 - SECONDS).abs() < 1e-9);
        (bodies.states[0].position, bodies.states[0].velocity)
    }

    fn crate_at(half: f32, position: [f32; 3]) -> BodyParams {
        BodyParams { position, ..BodyParams::new(Shape::Box { min: [-half; 3], max: [half; 3] }, 1000.0) }
    }

    #[test]
    fn a_mesh_that_deforms_pushes_a_body_as_far_as_it_comes() {
        // As wide as the body, narrower than the distance of its points, and as a wall that bulges.
        for half in [0.5, 0.03] {
            let glide = |x: Vec3, time: f32| x + Vec3::x() * 0.5 * time;
            let paddle = mesh([-0.1, 0.07 - half, 0.07 - half], [0.0, 0.07 + half, 0.07 + half], glide);
            let body = BodyParams { friction: 0.0, ..crate_at(0.4, [0.5, 0.07, 0.07]) };
            let (x, v) = end_of(body, Vec3::zeros(), paddle);
            assert!((x.x - 1.15).abs() < 0.01 && (v.x - 0.5).abs() < 5e-3, "{half}: at {x}, {v}");
        }
        let bulge = |x: Vec3, time: f32| if x.x < 0.0 { x } else { x + Vec3::x() * 0.5 * time };
        let (x, v) = end_of(
            crate_at(0.1, [0.3, 0.0, 0.0]),
            Vec3::zeros(),
            mesh([-0.3, -0.5, -0.5], [0.0, 0.5, 0.5], bulge),
        );
        assert!((x.x - 0.85).abs() < 0.01 && (v.x - 0.5).abs() < 5e-3, "at {x}, {v}");
    }

    #[test]
    fn friction_takes_a_body_along_the_surface() {
        let glide = |x: Vec3, time: f32| x + Vec3::x() * 0.5 * time;
        let floor = || mesh([-1.0, -0.5, -0.2], [1.0, 0.5, 0.0], glide);
        let (x, v) = end_of(crate_at(0.1, [0.0, 0.0, 0.1]), Vec3::z() * -9.81, floor());
        // It slips for v / (μ g) = 0.17 s.
        let expected = 0.5 * 1.5 - 0.25 / (2.0 * 0.3 * 9.81);
        assert!((x.x - expected).abs() < 0.01 && (v.x - 0.5).abs() < 5e-3, "at {x}, {v}");
        assert!((x.z - 0.1).abs() < 2e-3, "{x}");
        let smooth = BodyParams { friction: 0.0, ..crate_at(0.1, [0.0, 0.0, 0.1]) };
        let (x, _) = end_of(smooth, Vec3::z() * -9.81, floor());
        assert!(x.x.abs() < 1e-3, "{x}");
    }

    #[test]
    fn a_collider_that_grows_pushes_a_body_away() {
        let key = |frame, scale| Keyframe {
            frame,
            position: [0.0; 3],
            rotation: [0.0; 3],
            quaternion: None,
            scale,
        };
        let motion = Motion::new(&[key(0, 1.0), key(24, 2.0)], Interpolation::Linear, 24.0, 0);
        let ball = Solid { motion, ..Solid::fixed(Shape::Sphere { center: [0.0; 3], radius: 0.2 }) };
        let (x, v) = end_of(crate_at(0.1, [0.32, 0.0, 0.0]), Vec3::zeros(), ball);
        // After the first second it flies on as fast as the ball grew.
        assert!((x.x - 0.6).abs() < 0.01 && (v.x - 0.2).abs() < 5e-3, "at {x}, {v}");
    }

    #[test]
    fn places_cover_the_surface() {
        let solid = mesh([0.0; 3], [1.0, 0.5, 0.1], |x, time| x * (1.0 + time));
        let collider = DeformingCollider::of(&solid).unwrap();
        for (time, size) in [(0.0, 1.0), (1.0, 2.0)] {
            let deformed = collider.at(time, 0.01, &[]);
            assert!((100..2000).contains(&deformed.points().len()), "{}", deformed.points().len());
            for k in 0..200_u16 {
                let part = |prime: u16| f32::from(k * prime % 199) / 199.0;
                let x = Vec3::new(part(37), 0.5 * part(73), if k % 2 == 0 { 0.0 } else { 0.1 }) * size;
                let gap = deformed.points().iter().map(|point| (point.x - x).norm()).fold(f32::MAX, f32::min);
                assert!(gap < 0.12 * size, "{gap} m from {x}");
            }
        }
    }
}
