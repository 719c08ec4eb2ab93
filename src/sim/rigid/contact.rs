//! Contacts of rigid bodies with colliders and with each other.
//!
//! *Method*: points on the surfaces (`samples.rs`) against signed distances. Contacts are found once a substep, within the distance that
//! the bodies can move in it. Depth is removed first, by moving the bodies without a change of velocity. Sequential impulses ([catto05])
//! then make the velocities satisfy gap + Δt n·(v_a − v_b) ≥ 0 with Coulomb friction; impulses accumulate over the substep, and may
//! decrease again when the liquid lifts a body. Restitution is added to the velocities at the end of the substep.
//! *Departs from [catto05]*: impulses start at zero in each substep, so that a frame is the whole state; depth does not add to velocities.
//!
//! Symbols: n → `normal`, out of b, the collider or the second body; λ → `normal_impulse` [kg m/s].
//! Limits: a stack converges layer by layer. Bodies that are thinner than a
//! substep's motion are stopped at their points only.

use super::samples::{SurfacePoint, surface_points};
use crate::{
    math::Vec3,
    solid::{Motion, Pose, RigidBody, Shape, Solid},
};
use nalgebra::Vector3;

/// Sweeps over the contacts at the start of a substep, for the depth and the rebounds, and after the impulses of an iteration. With 30
/// a stack of four boxes stands.
pub(super) const START_SWEEPS: u32 = 30;
const DEPTH_SWEEPS: u32 = 10;
pub(super) const ITERATION_SWEEPS: u32 = 4;

/// Largest motion in a substep, over the inner radius.
const LARGEST_MOTION: f64 = 0.25;

/// Part of the depth that a substep removes.
const DEPTH_PART: f64 = 0.2;

/// Depth that remains, over the inner radius of the body: without it contacts at rest begin and end.
const ALLOWED_DEPTH: f64 = 1e-3;

/// Speed of an impact below which bodies do not rebound, in speeds that gravity gives in a substep.
const RESTING_STEPS: f64 = 2.0;

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
    pub(super) motion: Option<Motion>,
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
        shapes.iter().map(obstacle).collect()
    }
}

/// Contact of a body with a collider or a second body.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    a: usize,
    /// `None`: a collider.
    b: Option<usize>,
    /// From the centres of mass of a and b to the point of contact, at the start of the substep [m].
    arms: [Vector3<f64>; 2],
    /// Out of the collider or second body.
    normal: Vector3<f64>,
    /// Distance at the start of the substep; negative: depth [m].
    gap: f64,
    /// Velocity of the collider there [m/s].
    velocity: Vector3<f64>,
    friction: f64,
    restitution: f64,
    /// Speed of approach at the start of the substep, with gravity [m/s].
    approach: f64,
    pub(super) normal_impulse: f64,
    tangential_impulse: Vector3<f64>,
    rebound_impulse: f64,
    /// Displacement along the normal over the mass that it moves, which removes the depth [m/kg].
    displacement: f64,
    /// Depth that is not removed [m].
    allowed: f64,
    /// The smaller inner radius of both [m].
    inner_radius: f64,
}

impl Contact {
    /// The bodies and the depth at the start of the substep, over the smaller inner radius.
    pub(super) fn depth(&self) -> ([Option<usize>; 2], f64) {
        ([Some(self.a), self.b], -self.gap.min(0.0) / self.inner_radius)
    }

    /// Goes back to the impulses `before`, but for the part `kept` of their changes.
    pub(super) fn shorten(&mut self, before: &Self, kept: f64) {
        let change = self.normal_impulse - before.normal_impulse;
        self.normal_impulse = before.normal_impulse + change * kept;
        let change = self.tangential_impulse - before.tangential_impulse;
        self.tangential_impulse = before.tangential_impulse + change * kept;
    }
}

/// A shape at its poses at the start and at the end of a substep.
#[derive(Clone, Copy)]
pub(super) struct Placed<'a> {
    pub(super) obstacle: &'a Obstacle,
    pub(super) before: Pose,
    pub(super) now: Pose,
    /// Centre of mass at the start of the substep [m]; of colliders nothing.
    pub(super) center_of_mass: Vector3<f64>,
}

impl Placed<'_> {
    fn center(&self) -> Vec3 {
        self.before.to_world(self.obstacle.center)
    }

    /// Displacement in the substep of the point that is at `x` at its start [m].
    fn displacement(&self, x: Vec3) -> Vec3 {
        self.now.to_world(self.before.to_local(x)) - x
    }

    /// Bound of the displacement of all its points [m]; of an unbounded one, near `x`.
    fn largest_displacement(&self, x: Vec3) -> f32 {
        let Self { obstacle, before, now, .. } = self;
        if obstacle.reach.is_finite() {
            let turn = (now.rotation - before.rotation).norm() * obstacle.reach;
            self.displacement(self.center()).norm() + turn
        } else {
            self.displacement(x).norm()
        }
    }

    /// Distance and normal at `x` at the start of the substep.
    fn contact(&self, x: Vec3) -> (f32, Vec3) {
        let (d, n) = self.obstacle.shape.contact(self.before.to_local(x));
        (d, self.before.rotation * n)
    }
}

/// Finds the contacts of body `a` with `other`, which is body `b` or a collider.
pub(super) fn find(
    (a, body): (usize, &Placed<'_>),
    (b, other): (Option<usize>, &Placed<'_>),
    dt: f64,
    found: &mut Vec<Contact>,
) {
    let center = body.center();
    let margin = body.largest_displacement(center) + other.largest_displacement(center);
    let reach = body.obstacle.reach + other.obstacle.reach + margin;
    if reach.is_finite() && (center - other.center()).norm() > reach {
        return;
    }
    let allowed = ALLOWED_DEPTH * body.obstacle.inner_radius;
    let inner_radius = body.obstacle.inner_radius.min(other.obstacle.inner_radius);
    let (friction, restitution) = match b {
        Some(_) => (
            (body.obstacle.friction * other.obstacle.friction).sqrt(),
            body.obstacle.restitution.max(other.obstacle.restitution),
        ),
        None => (body.obstacle.friction, body.obstacle.restitution),
    };
    let mut add = |x: Vec3, normal: Vec3, gap: f32| {
        let velocity = if b.is_some() { Vec3::zeros() } else { other.displacement(x) / dt as f32 };
        let approach = (other.displacement(x) - body.displacement(x)).dot(&normal);
        found.push(Contact {
            a,
            b,
            arms: [x.cast() - body.center_of_mass, x.cast() - other.center_of_mass],
            normal: normal.cast(),
            gap: f64::from(gap),
            velocity: velocity.cast(),
            friction,
            restitution,
            approach: f64::from(approach) / dt,
            normal_impulse: 0.0,
            tangential_impulse: Vector3::zeros(),
            rebound_impulse: 0.0,
            displacement: 0.0,
            allowed,
            inner_radius,
        });
    };
    for point in &body.obstacle.points {
        let x = body.before.to_world(point.x);
        let (d, n) = other.contact(x);
        if d - point.radius < margin {
            add(x - n * point.radius, n, d - point.radius);
        }
    }
    // A ball touches anything at one point, which the first loop has found.
    if matches!(body.obstacle.shape, Shape::Sphere { .. }) {
        return;
    }
    for point in &other.obstacle.points {
        let x = other.before.to_world(point.x);
        let (d, n) = body.contact(x);
        if d - point.radius < margin {
            add(x - n * d, -n, d - point.radius);
        }
    }
}

/// Mass that a contact along `direction` moves [kg].
fn effective_mass(contact: &Contact, bodies: &[RigidBody], direction: &Vector3<f64>) -> f64 {
    let inverse = |body: &RigidBody, arm: &Vector3<f64>| {
        let turn = arm.cross(direction);
        1.0 / body.mass() + turn.dot(&(body.world_inverse_inertia() * turn))
    };
    let of_second = contact.b.map_or(0.0, |b| inverse(&bodies[b], &contact.arms[1]));
    1.0 / (inverse(&bodies[contact.a], &contact.arms[0]) + of_second)
}

fn relative_velocity(contact: &Contact, bodies: &[RigidBody]) -> Vector3<f64> {
    let velocity = |body: &RigidBody, arm| body.velocity() + body.angular_velocity().cross(arm);
    let other = contact.b.map_or(contact.velocity, |b| velocity(&bodies[b], &contact.arms[1]));
    velocity(&bodies[contact.a], &contact.arms[0]) - other
}

fn apply(contact: &Contact, bodies: &mut [RigidBody], impulse: Vector3<f64>) {
    bodies[contact.a].apply(impulse, contact.arms[0].cross(&impulse));
    if let Some(b) = contact.b {
        bodies[b].apply(-impulse, -contact.arms[1].cross(&impulse));
    }
}

/// Moves bodies apart where they overlap, without a change of velocity.
pub(super) fn separate(contacts: &mut [Contact], bodies: &mut [RigidBody]) {
    if contacts.iter().all(|contact| contact.gap >= -contact.allowed) {
        return;
    }
    // Displacements and rotation vectors.
    let mut moved = vec![[Vector3::zeros(); 2]; bodies.len()];
    let along = |contact: &Contact, moved: &[[Vector3<f64>; 2]]| {
        let of = |body: usize, arm: &Vector3<f64>| {
            (moved[body][0] + moved[body][1].cross(arm)).dot(&contact.normal)
        };
        of(contact.a, &contact.arms[0]) - contact.b.map_or(0.0, |b| of(b, &contact.arms[1]))
    };
    for _ in 0..DEPTH_SWEEPS {
        for contact in contacts.iter_mut().filter(|contact| contact.gap < -contact.allowed) {
            let wanted = -DEPTH_PART * (contact.gap + contact.allowed) - along(contact, &moved);
            let total =
                (contact.displacement + wanted * effective_mass(contact, bodies, &contact.normal)).max(0.0);
            let change = contact.normal * (total - contact.displacement);
            contact.displacement = total;
            let sides = [(Some(contact.a), change, contact.arms[0]), (contact.b, -change, contact.arms[1])];
            for (body, change, arm) in sides {
                if let Some(body) = body {
                    moved[body][0] += change / bodies[body].mass();
                    moved[body][1] += bodies[body].world_inverse_inertia() * arm.cross(&change);
                }
            }
        }
    }
    for contact in contacts.iter_mut() {
        contact.gap += along(contact, &moved);
    }
    for (body, [displacement, rotation]) in bodies.iter_mut().zip(moved) {
        body.shift(displacement, rotation);
    }
}

/// Sweeps over the contacts `sweeps` times, in order.
pub(super) fn resolve(contacts: &mut [Contact], bodies: &mut [RigidBody], dt: f64, sweeps: u32) {
    for _ in 0..sweeps {
        for contact in contacts.iter_mut() {
            let n = contact.normal;
            let speed = relative_velocity(contact, bodies).dot(&n) + contact.gap.max(0.0) / dt;
            let total = (contact.normal_impulse - speed * effective_mass(contact, bodies, &n)).max(0.0);
            let change = total - contact.normal_impulse;
            contact.normal_impulse = total;
            if change != 0.0 {
                apply(contact, bodies, n * change);
            }
            apply_friction(contact, bodies);
        }
    }
}

/// Coulomb friction of a contact.
fn apply_friction(contact: &mut Contact, bodies: &mut [RigidBody]) {
    if contact.friction == 0.0
        || (contact.normal_impulse == 0.0 && contact.tangential_impulse == Vector3::zeros())
    {
        return;
    }
    let n = contact.normal;
    let v = relative_velocity(contact, bodies);
    let slip = v - n * n.dot(&v);
    let speed = slip.norm();
    let mass = if speed > 0.0 { effective_mass(contact, bodies, &(slip / speed)) } else { 0.0 };
    let wanted = contact.tangential_impulse - slip * mass;
    let limit = contact.friction * contact.normal_impulse;
    let total = if wanted.norm() > limit { wanted * (limit / wanted.norm()) } else { wanted };
    let change = total - contact.tangential_impulse;
    contact.tangential_impulse = total;
    apply(contact, bodies, change);
}

/// Adds the velocities of rebounds; `resting` is the speed that gravity gives in a substep [m/s].
pub(super) fn rebound(contacts: &mut [Contact], bodies: &mut [RigidBody], resting: f64) {
    let target = |contact: &Contact| {
        let is_impact = contact.approach > RESTING_STEPS * resting && contact.restitution > 0.0;
        if is_impact { contact.restitution * contact.approach } else { 0.0 }
    };
    if !contacts.iter().any(|contact| contact.normal_impulse > 0.0 && target(contact) > 0.0) {
        return;
    }
    for _ in 0..START_SWEEPS {
        for contact in contacts.iter_mut().filter(|contact| contact.normal_impulse > 0.0) {
            let n = contact.normal;
            let lacking = target(contact) - relative_velocity(contact, bodies).dot(&n);
            let total = (contact.rebound_impulse + lacking * effective_mass(contact, bodies, &n)).max(0.0);
            let change = total - contact.rebound_impulse;
            contact.rebound_impulse = total;
            apply(contact, bodies, n * change);
        }
    }
}
