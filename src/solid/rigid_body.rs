//! Rigid bodies: mass, centre of mass and inertia of shapes, and their motion in a substep.
//!
//! *Method*: mass properties by summing cells of a grid that covers the bounds of the shape, each with the part of it that is inside
//! by its signed distance; the volume is exact where there is a closed form. In a substep the body moves from its pose at the
//! start with one linear and one angular velocity (symplectic Euler; the rotation is that of the angular velocity half a substep
//! later, which conserves angular momentum exactly and energy to second order). Impulses change both velocities, and the pose at the end follows.
//!
//! Symbols: M → `mass` [kg]; I → `inertia` about the centre of mass [kg m²]; L → `angular_momentum` [kg m²/s].
//! State and impulses are double precision. At the end of a frame the state is rounded to single precision ([`RigidBody::round`]),
//! which frames store.

use super::{Pose, Shape};
use crate::{
    frame::{Stream, StreamKind},
    math::{
        Vec3,
        elementary::{cos, sin},
    },
};
use nalgebra::{Matrix3, Matrix6, Quaternion, Unit, UnitQuaternion, Vector3};

/// Cells along the longest side of the bounds. A ball of 48 cells across has its moment of inertia to 0.1 %.
const CELLS: f32 = 48.0;

/// Mass, centre of mass and inertia of a solid of uniform density, in its own axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MassProperties {
    /// Density [kg/m³].
    pub(crate) density: f64,
    /// Mass [kg].
    pub(crate) mass: f64,
    /// Centre of mass [m].
    pub(crate) center: Vector3<f64>,
    /// Tensor of inertia about the centre of mass [kg m²].
    pub(crate) inertia: Matrix3<f64>,
}

impl MassProperties {
    /// The properties of a bounded shape of `density` [kg/m³]; `None` if it is unbounded or has no volume.
    pub(crate) fn new(shape: &Shape, density: f64) -> Option<Self> {
        let (low, high) = shape.bounds()?;
        let (parts, cell) = filled_cells(shape, CELLS)?;
        // Sums over cells relative to the middle of the bounds.
        let middle = (low + high) / 2.0;
        let (mut inside, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for (x, part) in parts {
            let r: Vector3<f64> = (x - middle).cast();
            inside += part;
            first += r * part;
            second += r * r.transpose() * part;
        }
        let cell: Vector3<f64> = cell.cast();
        let volume = match shape {
            Shape::Mesh(_) => inside * cell.product(),
            _ => shape.volume(),
        };
        let mass = density * volume;
        if !(inside > 0.0 && mass > 0.0 && mass.is_finite()) {
            return None;
        }
        let center = first / inside;
        // Cells are boxes, not points.
        let own = Matrix3::from_diagonal(&cell.component_mul(&cell)) / 12.0;
        let moments = second / inside - center * center.transpose() + own;
        let inertia = (Matrix3::identity() * moments.trace() - moments) * mass;
        Some(Self { density, mass, center: center + middle.cast(), inertia })
    }
}

/// Middles of the cells of a bounded shape, of which there are `along` along its longest side, the part of each that is inside (0 to 1), and
/// the size of a cell [m]; `None` if the shape has no size.
pub(crate) fn filled_cells(shape: &Shape, along: f32) -> Option<(Vec<(Vec3, f64)>, Vec3)> {
    let (low, high) = shape.bounds()?;
    let size = high - low;
    let longest = size.max();
    if !(longest > 0.0 && longest.is_finite()) {
        return None;
    }
    let count = size.map(|side| (side / longest * along).ceil().max(1.0));
    let cell = size.component_div(&count);
    let width = (cell.sum() / 3.0).max(f32::MIN_POSITIVE);
    let mut parts = Vec::new();
    for k in 0..count.z as u32 {
        for j in 0..count.y as u32 {
            for i in 0..count.x as u32 {
                let index = Vec3::new(i as f32, j as f32, k as f32).add_scalar(0.5);
                let x = low + index.component_mul(&cell);
                parts.push((x, f64::from((0.5 - shape.signed_distance(x) / width).clamp(0.0, 1.0))));
            }
        }
    }
    Some((parts, cell))
}

/// A rigid body that moves freely.
#[derive(Clone, Debug)]
pub(crate) struct RigidBody {
    properties: MassProperties,
    inverse_inertia: Matrix3<f64>,
    /// Position of the centre of mass [m], and the rotation from its own axes to the world's.
    position: Vector3<f64>,
    rotation: UnitQuaternion<f64>,
    /// Velocity of the centre of mass [m/s].
    velocity: Vector3<f64>,
    angular_momentum: Vector3<f64>,
    /// Position and rotation at the start of the substep.
    start: (Vector3<f64>, UnitQuaternion<f64>),
    /// Inverse of the inertia in the world's axes, in the middle of the substep [1/(kg m²)].
    world_inverse_inertia: Matrix3<f64>,
    /// Length of the substep [s].
    dt: f64,
}

/// What a frame stores of a body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct BodyState {
    /// Position of the origin of its own axes [m].
    pub(crate) position: Vec3,
    /// Rotation as a unit quaternion (i, j, k) and w.
    pub(crate) rotation: (Vec3, f32),
    /// Velocity of the centre of mass [m/s].
    pub(crate) velocity: Vec3,
    /// Angular velocity [rad/s].
    pub(crate) angular_velocity: Vec3,
}

/// The surface of a rigid body, as other systems touch it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BodySurface<'a> {
    pub(crate) shape: &'a Shape,
    /// All of the shape is within `reach` of `center` [m], in its own axes.
    pub(crate) center: Vec3,
    pub(crate) reach: f32,
    pub(crate) inner_radius: f32,
    /// Coefficient of friction.
    pub(crate) friction: f32,
}

impl RigidBody {
    /// A body in that state; `None` if its inertia cannot be inverted.
    pub(crate) fn new(properties: MassProperties, state: &BodyState) -> Option<Self> {
        let inverse_inertia = properties.inertia.try_inverse()?;
        let (imaginary, real) = state.rotation;
        let [i, j, k] = imaginary.cast::<f64>().into();
        let rotation = Unit::new_normalize(Quaternion::new(f64::from(real), i, j, k));
        let position = state.position.cast() + rotation.to_rotation_matrix() * properties.center;
        let mut body = Self {
            properties,
            inverse_inertia,
            position,
            rotation,
            velocity: state.velocity.cast(),
            angular_momentum: Vector3::zeros(),
            start: (position, rotation),
            world_inverse_inertia: Matrix3::zeros(),
            dt: 0.0,
        };
        body.angular_momentum = body.in_world(&properties.inertia, &rotation) * state.angular_velocity.cast();
        body.world_inverse_inertia = body.in_world(&inverse_inertia, &rotation);
        Some(body)
    }

    /// A tensor of its own axes in those of the world.
    fn in_world(&self, tensor: &Matrix3<f64>, rotation: &UnitQuaternion<f64>) -> Matrix3<f64> {
        let turn = rotation.to_rotation_matrix();
        turn.matrix() * tensor * turn.matrix().transpose()
    }

    /// The state, rounded to single precision, from which the body continues as a body made of it would.
    pub(crate) fn round(&mut self) -> BodyState {
        let omega = self.in_world(&self.inverse_inertia, &self.rotation) * self.angular_momentum;
        let q = self.rotation.coords;
        let state = BodyState {
            position: self.pose().position,
            rotation: (Vec3::new(q.x as f32, q.y as f32, q.z as f32), q.w as f32),
            velocity: self.velocity.cast(),
            angular_velocity: omega.cast(),
        };
        if let Some(rounded) = Self::new(self.properties, &state) {
            *self = rounded;
        }
        state
    }

    /// Starts a substep of `dt` [s] with an acceleration [m/s²].
    pub(crate) fn start_substep(&mut self, dt: f64, acceleration: Vector3<f64>) {
        self.start = (self.position, self.rotation);
        self.dt = dt;
        let first = self.in_world(&self.inverse_inertia, &self.rotation) * self.angular_momentum;
        let half = turned(&self.rotation, first * (0.5 * dt));
        self.world_inverse_inertia = self.in_world(&self.inverse_inertia, &half);
        self.velocity += acceleration * dt;
        self.advance();
    }

    /// Moves the body from its pose at the start of the substep to that at the end, with the present velocities.
    pub(crate) fn advance(&mut self) {
        self.position = self.start.0 + self.velocity * self.dt;
        self.rotation = turned(&self.start.1, self.angular_velocity() * self.dt);
    }

    /// Adds a linear impulse [kg m/s] and an angular one about the centre of mass [kg m²/s].
    pub(crate) fn apply(&mut self, linear: Vector3<f64>, angular: Vector3<f64>) {
        self.velocity += linear / self.properties.mass;
        self.angular_momentum += angular;
    }

    /// Moves the poses at the start and at the end of the substep by a displacement [m] and a rotation vector [rad].
    pub(crate) fn shift(&mut self, displacement: Vector3<f64>, rotation: Vector3<f64>) {
        self.start = (self.start.0 + displacement, turned(&self.start.1, rotation));
        self.advance();
    }

    /// Linear and angular velocity, to be returned to ([`RigidBody::return_to`]).
    pub(crate) fn momenta(&self) -> [Vector3<f64>; 2] {
        [self.velocity, self.angular_momentum]
    }

    /// Keeps the part `kept` (0 to 1) of what changed since `before`.
    pub(crate) fn return_to(&mut self, before: [Vector3<f64>; 2], kept: f64) {
        self.velocity = before[0] + (self.velocity - before[0]) * kept;
        self.angular_momentum = before[1] + (self.angular_momentum - before[1]) * kept;
    }

    /// Where the body is.
    pub(crate) fn pose(&self) -> Pose {
        pose(&self.properties, &self.position, &self.rotation)
    }

    /// Where the body was at the start of the substep.
    pub(crate) fn start_pose(&self) -> Pose {
        pose(&self.properties, &self.start.0, &self.start.1)
    }

    /// Where it is between the start (0) and the end (1) of the substep.
    pub(crate) fn pose_between(&self, part: f32) -> Pose {
        let part = f64::from(part);
        let rotation = turned(&self.start.1, self.angular_velocity() * (self.dt * part));
        pose(&self.properties, &(self.start.0 + self.velocity * (self.dt * part)), &rotation)
    }

    /// Density [kg/m³].
    pub(crate) fn density(&self) -> f64 {
        self.properties.density
    }

    /// Mass [kg].
    pub(crate) fn mass(&self) -> f64 {
        self.properties.mass
    }

    /// Position of the centre of mass at the start of the substep [m].
    pub(crate) fn start_position(&self) -> Vector3<f64> {
        self.start.0
    }

    /// Distance of the centre of mass from a point in its own axes [m].
    pub(crate) fn distance_from_center(&self, x: Vec3) -> f64 {
        (self.properties.center - x.cast()).norm()
    }

    /// Position of the centre of mass [m].
    pub(crate) fn position(&self) -> Vector3<f64> {
        self.position
    }

    /// Velocity of the centre of mass [m/s].
    pub(crate) fn velocity(&self) -> Vector3<f64> {
        self.velocity
    }

    /// Angular velocity of the substep [rad/s].
    pub(crate) fn angular_velocity(&self) -> Vector3<f64> {
        self.world_inverse_inertia * self.angular_momentum
    }

    /// Inverse of the inertia in the world's axes [1/(kg m²)].
    pub(crate) fn world_inverse_inertia(&self) -> &Matrix3<f64> {
        &self.world_inverse_inertia
    }

    /// Mass [kg] and inertia [kg m²] about the centre of mass, in the world's axes in the middle of the substep.
    pub(crate) fn mass_matrix(&self) -> Matrix6<f64> {
        let mut all = Matrix6::identity() * self.properties.mass;
        let inertia = self.world_inverse_inertia.try_inverse().unwrap_or_else(Matrix3::zeros);
        all.fixed_view_mut::<3, 3>(3, 3).copy_from(&inertia);
        all
    }

    /// Kinetic energy of what changed since `momenta` alone: what an implicit step dissipates [J].
    pub(crate) fn energy_of_change(&self, momenta: &[Vector3<f64>; 2]) -> f64 {
        let [v, l] = [self.velocity - momenta[0], self.angular_momentum - momenta[1]];
        0.5 * (self.properties.mass * v.norm_squared() + l.dot(&(self.world_inverse_inertia * l)))
    }

    /// Kinetic energy [J].
    pub(crate) fn kinetic_energy(&self) -> f64 {
        let omega = self.in_world(&self.inverse_inertia, &self.rotation) * self.angular_momentum;
        0.5 * (self.properties.mass * self.velocity.norm_squared() + self.angular_momentum.dot(&omega))
    }
}

/// The poses of the rigid bodies among the streams of a frame; empty if it has none.
pub(crate) fn body_poses(streams: &[Stream]) -> Vec<Pose> {
    let stream = streams.iter().find(|stream| stream.kind == StreamKind::RigidBodies);
    let columns = |stream: &Stream| {
        let (positions, imaginary) = (stream.vec3("position")?, stream.vec3("rotation")?);
        let pose = |((&position, q), &w): ((&Vec3, &Vec3), &f32)| {
            let turn = Quaternion::from_parts(f64::from(w), q.cast::<f64>());
            let rotation = Unit::new_normalize(turn).to_rotation_matrix();
            Pose { position, rotation: rotation.matrix().cast() }
        };
        Some(positions.iter().zip(imaginary).zip(stream.f32("rotation_w")?).map(pose).collect())
    };
    stream.and_then(columns).unwrap_or_default()
}

fn pose(properties: &MassProperties, position: &Vector3<f64>, rotation: &UnitQuaternion<f64>) -> Pose {
    let matrix = rotation.to_rotation_matrix();
    let origin = position - matrix.matrix() * properties.center;
    Pose { position: origin.cast(), rotation: matrix.matrix().cast() }
}

/// `rotation` turned further by the rotation vector `by` [rad].
fn turned(rotation: &UnitQuaternion<f64>, by: Vector3<f64>) -> UnitQuaternion<f64> {
    let angle = by.norm();
    // sin(a/2)/a tends to 1/2.
    let scale = if angle > 1e-9 { sin(0.5 * angle) / angle } else { 0.5 };
    let turn = Quaternion::from_parts(cos(0.5 * angle), by * scale);
    Unit::new_normalize(turn * rotation.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(angular_velocity: Vec3) -> BodyState {
        BodyState {
            position: Vec3::new(1.0, 2.0, 3.0),
            rotation: (Vec3::zeros(), 1.0),
            velocity: Vec3::zeros(),
            angular_velocity,
        }
    }

    fn apply_at(body: &mut RigidBody, impulse: Vector3<f64>, x: Vector3<f64>) {
        body.apply(impulse, (x - body.position()).cross(&impulse));
    }

    #[test]
    fn shapes_have_their_mass_centre_and_inertia() {
        let center = [3.0, -1.0, 0.5];
        let boxed = |a: f64, b: f64| 12.0 * (a * a + b * b) / 12.0;
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 8.0;
        for (shape, mass, moments) in [
            (
                Shape::Box { min: [2.5, -2.0, -1.0], max: [3.5, 0.0, 2.0] },
                12.0,
                [boxed(2.0, 3.0), boxed(1.0, 3.0), boxed(1.0, 2.0)],
            ),
            (Shape::Sphere { center, radius: 2.0 }, 2.0 * ball, [2.0 * ball * 0.4 * 4.0; 3]),
        ] {
            let found = MassProperties::new(&shape, 2.0).expect("it has a volume");
            assert!((found.mass / mass - 1.0).abs() < 1e-6, "{shape:?}: {}", found.mass);
            assert!((found.center - Vector3::from(center.map(f64::from))).norm() < 1e-5, "{}", found.center);
            for (axis, moment) in moments.into_iter().enumerate() {
                let off = found.inertia[(axis, axis)] / moment - 1.0;
                assert!(off.abs() < 2e-3, "{shape:?}, axis {axis}: {off}");
            }
            assert!(found.inertia[(0, 1)].abs() < 1e-6 * found.inertia.norm());
        }
        assert_eq!(MassProperties::new(&Shape::Tank { min: [0.0; 3], max: [1.0; 3] }, 1.0), None);
    }

    #[test]
    fn a_free_top_keeps_its_angular_momentum_and_nearly_its_energy() {
        let brick = Shape::Box { min: [-0.5, -1.0, -1.5], max: [0.5, 1.0, 1.5] };
        let properties = MassProperties::new(&brick, 1.0).expect("it has a volume");
        // About the middle axis rotation is unstable: the top turns over.
        let mut top = RigidBody::new(properties, &state(Vec3::new(0.01, 5.0, 0.0))).expect("it has inertia");
        let (momentum, energy) = (top.angular_momentum, top.kinetic_energy());
        let mut turned_over = false;
        for _ in 0..4000 {
            top.start_substep(0.005, Vector3::zeros());
            turned_over |= (top.rotation * Vector3::y()).dot(&momentum) < 0.0;
            assert!((top.kinetic_energy() / energy - 1.0).abs() < 2e-3, "{}", top.kinetic_energy() / energy);
        }
        assert!(turned_over && top.angular_momentum == momentum);
    }

    #[test]
    fn a_body_made_of_a_rounded_state_has_the_same_bits() {
        let properties =
            MassProperties::new(&Shape::Sphere { center: [0.3; 3], radius: 0.7 }, 3.0).expect("a volume");
        let mut body = RigidBody::new(properties, &state(Vec3::new(0.3, -2.0, 1.1))).expect("inertia");
        body.start_substep(0.013, Vector3::new(0.1, 0.2, -9.81));
        apply_at(&mut body, Vector3::new(0.4, 3.0, -1.0), Vector3::new(1.3, 2.0, 3.9));
        body.advance();
        let mut copy = RigidBody::new(properties, &body.round()).expect("inertia");
        for body in [&mut body, &mut copy] {
            body.start_substep(0.01, Vector3::zeros());
        }
        assert_eq!((body.pose(), body.momenta()), (copy.pose(), copy.momenta()));
        let moved = body.pose().to_world(Vec3::repeat(0.3)).cast();
        assert!((moved - body.position()).norm() < 1e-6, "the centre of the ball is that of mass");
    }

    #[test]
    fn an_impulse_at_a_point_moves_and_turns_the_body() {
        let cube = Shape::Box { min: [-0.5; 3], max: [0.5; 3] };
        let properties = MassProperties::new(&cube, 6.0).expect("it has a volume");
        let mut body = RigidBody::new(properties, &state(Vec3::zeros())).expect("it has inertia");
        body.start_substep(0.1, Vector3::zeros());
        let before = body.momenta();
        apply_at(&mut body, Vector3::new(0.0, 0.0, 6.0), Vector3::new(1.5, 2.0, 3.0));
        // I = M/6 = 1 kg m²; L = r × J = (0, −3, 0).
        assert!((body.velocity() - Vector3::z()).norm() < 1e-12);
        assert!((body.angular_velocity() - Vector3::new(0.0, -3.0, 0.0)).norm() < 1e-6);
        let arm = Vector3::new(1.5, 2.0, 3.0) - body.position();
        let edge = body.velocity() + body.angular_velocity().cross(&arm);
        assert!((edge - Vector3::new(0.0, 0.0, 2.5)).norm() < 1e-6, "{edge}");
        body.return_to(before, 0.5);
        assert!((body.velocity().z - 0.5).abs() < 1e-12);
    }
}
