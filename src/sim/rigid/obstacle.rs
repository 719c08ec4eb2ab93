//! Rigid bodies and colliders as obstacles of each other.

use super::{
    deforming::{Deformed, DeformingCollider},
    samples::{SurfacePoint, surface_points},
};
use crate::{
    math::Vec3,
    solid::{Motion, Pose, RigidBody, Shape, Solid},
};
use nalgebra::Vector3;

/// Largest motion in a substep, over the inner radius.
const LARGEST_MOTION: f64 = 0.25;

/// Length over which the direction of a surface is found, over the inner radius.
const FACING_STEP: f64 = 0.1;

/// Minimum cosine between a surface's normal and the direction of a contact across it: one of the faces of a box always has 0.577.
const FACING_COSINE: f32 = 0.5;

/// A shape as an obstacle, with the points of its surface.
#[derive(Clone, Debug)]
pub(super) struct Obstacle {
    pub(super) shape: Shape,
    pub(super) points: Vec<SurfacePoint>,
    /// All of the shape is within `reach` of `center` [m]; infinite for planes.
    pub(super) center: Vec3,
    pub(super) reach: f32,
    pub(super) inner_radius: f64,
    pub(super) friction: f64,
    pub(super) restitution: f64,
    /// Motion by keyframes; `None`: none, or a body.
    motion: Option<Motion>,
    /// A collider whose shape or size changes.
    deforming: Option<Box<DeformingCollider>>,
}

impl Obstacle {
    pub(super) fn new(shape: &Shape, friction: f32, restitution: f32) -> Self {
        let (center, reach) = shape.bounding_ball().unwrap_or((Vec3::zeros(), f32::INFINITY));
        Self {
            shape: shape.clone(),
            points: surface_points(shape),
            center,
            reach,
            inner_radius: f64::from(shape.inner_radius()),
            friction: f64::from(friction),
            restitution: f64::from(restitution),
            motion: None,
            deforming: None,
        }
    }

    /// Largest motion in a substep [m].
    pub(super) fn largest_motion(&self) -> f64 {
        LARGEST_MOTION * self.inner_radius
    }

    /// A collider, whose friction and restitution are those of the body that touches it. A tank is six planes, so that a ball in its
    /// corner touches three.
    pub(super) fn collider(solid: &Solid) -> Vec<Self> {
        let shapes = match solid.shape {
            Shape::Tank { min, max } => {
                let face = |axis: usize, side: f32| {
                    let mut normal = [0.0; 3];
                    normal[axis] = side;
                    Shape::Plane { point: if side > 0.0 { min } else { max }, normal }
                };
                (0..3).flat_map(|axis| [face(axis, 1.0), face(axis, -1.0)]).collect()
            }
            ref other => vec![other.clone()],
        };
        let obstacle = |shape| Self { motion: solid.motion.clone(), ..Self::new(shape, 0.0, 0.0) };
        let mut obstacles: Vec<Self> = shapes.iter().map(obstacle).collect();
        if let (Some(deforming), [collider]) = (DeformingCollider::of(solid), &mut *obstacles) {
            (collider.center, collider.reach) = deforming.bounding_ball();
            collider.inner_radius *= deforming.smallest_scale();
            collider.deforming = Some(Box::new(deforming));
        }
        obstacles
    }

    /// A collider in the substep from `now` [s] of `dt` [s]. What changes its shape then has the shape of its start, if one of the `bodies` may touch it.
    pub(super) fn place(&self, now: f64, dt: f64, bodies: &[Placed<'_>]) -> Placed<'_> {
        let pose = |time| self.motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time));
        let mut placed = Placed {
            obstacle: self,
            before: pose(now),
            now: pose(now + dt),
            center_of_mass: Vector3::zeros(),
            bound: None,
            deformed: None,
        };
        if let Some(deforming) = &self.deforming {
            placed.bound = Some(deforming.largest_displacement(now, dt));
            if bodies.iter().any(|body| body.margin(&placed).is_some()) {
                placed.deformed = Some(deforming.at(now, dt, &self.points));
            }
        }
        placed
    }
}

/// A shape at its poses at the start and at the end of a substep.
pub(super) struct Placed<'a> {
    pub(super) obstacle: &'a Obstacle,
    pub(super) before: Pose,
    pub(super) now: Pose,
    /// Centre of mass at the start of the substep [m]; of colliders nothing.
    pub(super) center_of_mass: Vector3<f64>,
    /// Bound of the displacement of all its points [m], if they do not move with the poses alone.
    bound: Option<f32>,
    deformed: Option<Deformed>,
}

impl<'a> Placed<'a> {
    /// A rigid body.
    pub(super) fn body(obstacle: &'a Obstacle, body: &RigidBody) -> Self {
        let (before, now, center_of_mass) = (body.start_pose(), body.pose(), body.start_position());
        Self { obstacle, before, now, center_of_mass, bound: None, deformed: None }
    }

    fn center(&self) -> Vec3 {
        self.before.to_world(self.obstacle.center)
    }

    /// Points of the surface at the start of the substep, in its own axes.
    pub(super) fn points(&self) -> &[SurfacePoint] {
        self.deformed.as_ref().map_or(&self.obstacle.points, Deformed::points)
    }

    /// Displacement in the substep of the point that is at `x` at its start [m].
    pub(super) fn displacement(&self, x: Vec3) -> Vec3 {
        let local = self.before.to_local(x);
        let moved = self.deformed.as_ref().map_or(local, |deformed| deformed.moved(local));
        self.now.to_world(moved) - x
    }

    /// Bound of the displacement of all its points [m]; of an unbounded one, near `x`.
    fn largest_displacement(&self, x: Vec3) -> f32 {
        let Self { obstacle, before, now, .. } = self;
        if let Some(bound) = self.bound {
            bound
        } else if obstacle.reach.is_finite() {
            let turn = (now.rotation - before.rotation).norm() * obstacle.reach;
            self.displacement(self.center()).norm() + turn
        } else {
            self.displacement(x).norm()
        }
    }

    /// Distance within which this body and `other` may touch in the substep [m]; `None` if they are farther away.
    pub(super) fn margin(&self, other: &Self) -> Option<f32> {
        let center = self.center();
        let margin = self.largest_displacement(center) + other.largest_displacement(center);
        let reach = self.obstacle.reach + other.obstacle.reach + margin;
        let is_far = reach.is_finite() && (center - other.center()).norm() > reach;
        (!is_far).then_some(margin)
    }

    fn shape(&self) -> &Shape {
        self.deformed.as_ref().map_or(&self.obstacle.shape, Deformed::shape)
    }

    /// Distance and normal at `x` at the start of the substep.
    pub(super) fn contact(&self, x: Vec3) -> (f32, Vec3) {
        let (d, n) = self.shape().contact(self.before.to_local(x));
        (d, self.before.rotation * n)
    }

    /// Whether the surface at `x`, or one of those that meet at this edge, faces the unit vector `direction`.
    pub(super) fn is_facing(&self, x: Vec3, direction: Vec3) -> bool {
        let (shape, step) = (self.shape(), (FACING_STEP * self.obstacle.inner_radius) as f32);
        let distance = |x: Vec3| shape.signed_distance(self.before.to_local(x));
        distance(x + direction * step) - distance(x) >= FACING_COSINE * step
    }
}
