//! Contacts of rigid bodies with colliders and with each other.
//!
//! *Method*: points on the surfaces (`samples.rs`) against signed distances. Contacts are found once a substep, within the distance that
//! the bodies can move in it, and act across a surface, not along it: a point of a floor in front of a body that glides on it is level with
//! the edge of the body, and nearest to its side. Depth is removed first, by moving the bodies without a change of velocity. Sequential
//! impulses ([catto05]) then make the velocities satisfy gap + Δt n·(v_a − v_b) ≥ 0 with Coulomb friction; impulses accumulate over the
//! substep, and may decrease again when the liquid lifts a body. Restitution is added to the velocities at the end of the substep.
//! *Departs from [catto05]*: impulses start at zero in each substep, so that a frame is the whole state; depth does not add to velocities.
//!
//! Symbols: n → `normal`, out of b, the collider or the second body; λ → `normal_impulse` [kg m/s].
//! Limits: a stack converges layer by layer. Bodies that are thinner than a
//! substep's motion are stopped at their points only.

use super::obstacle::Placed;
use crate::{
    math::Vec3,
    solid::{RigidBody, Shape},
};
use nalgebra::Vector3;

/// Maximum number of sweeps over the contacts at the start of a substep, without friction and then with it: friction of normal impulses that
/// have not converged would move a stack.
pub(super) const START_SWEEPS: u32 = 240;

/// Change of velocity in a sweep below which sweeps end, over that by gravity in a substep; without gravity, over that in the first sweep.
const TOLERANCE: f64 = 1e-4;

/// Sweeps for the rebounds, for the depth, and after the impulses of an iteration.
const REBOUND_SWEEPS: u32 = 30;
const DEPTH_SWEEPS: u32 = 10;
pub(super) const ITERATION_SWEEPS: u32 = 4;

/// Part of the depth that a substep removes.
const DEPTH_PART: f64 = 0.2;

/// Depth that remains, over the inner radius of the body: without it contacts at rest begin and end.
const ALLOWED_DEPTH: f64 = 1e-3;

/// Speed of an impact below which bodies do not rebound, in speeds that gravity gives in a substep.
const RESTING_STEPS: f64 = 2.0;

/// Contact of a body with a collider or a second body.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    a: usize,
    /// `None`: a collider.
    b: Option<usize>,
    /// From the centres of mass of a and b to the point of contact, at the start of the substep [m].
    pub(super) arms: [Vector3<f64>; 2],
    /// Out of the collider or second body.
    pub(super) normal: Vector3<f64>,
    /// Distance at the start of the substep; negative: depth [m].
    pub(super) gap: f64,
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
    pub(super) inner_radius: f64,
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

/// Finds the contacts of body `a` with `other`, which is body `b` or a collider.
pub(super) fn find(
    (a, body): (usize, &Placed<'_>),
    (b, other): (Option<usize>, &Placed<'_>),
    dt: f64,
    found: &mut Vec<Contact>,
) {
    let Some(margin) = body.margin(other) else { return };
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
        let surface = x - n * point.radius;
        if d - point.radius < margin && body.is_facing(surface, -n) {
            add(surface, n, d - point.radius);
        }
    }
    // A ball touches anything at one point, which the first loop has found.
    if !matches!(body.obstacle.shape, Shape::Sphere { .. }) {
        for point in other.points() {
            let x = other.before.to_world(point.x);
            let (d, n) = body.contact(x);
            if d - point.radius < margin && other.is_facing(x - n * point.radius, -n) {
                add(x - n * d, -n, d - point.radius);
            }
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

/// Sweeps over the contacts in order, at most `sweeps` times, with friction or without. `scale` is the speed that gravity gives in the substep [m/s].
pub(super) fn resolve(
    contacts: &mut [Contact],
    bodies: &mut [RigidBody],
    (dt, mut scale): (f64, f64),
    (sweeps, has_friction): (u32, bool),
) {
    for sweep in 0..sweeps {
        let mut largest = 0.0_f64;
        for contact in contacts.iter_mut() {
            let n = contact.normal;
            let mass = effective_mass(contact, bodies, &n);
            let speed = relative_velocity(contact, bodies).dot(&n) + contact.gap.max(0.0) / dt;
            let total = (contact.normal_impulse - speed * mass).max(0.0);
            let change = total - contact.normal_impulse;
            contact.normal_impulse = total;
            if change != 0.0 {
                apply(contact, bodies, n * change);
                largest = largest.max(change.abs() / mass);
            }
            if has_friction {
                largest = largest.max(apply_friction(contact, bodies));
            }
        }
        if sweep == 0 && scale == 0.0 {
            scale = largest;
        }
        if largest <= TOLERANCE * scale {
            break;
        }
    }
}

/// Coulomb friction of a contact. Returns the change of velocity [m/s].
fn apply_friction(contact: &mut Contact, bodies: &mut [RigidBody]) -> f64 {
    if contact.friction == 0.0
        || (contact.normal_impulse == 0.0 && contact.tangential_impulse == Vector3::zeros())
    {
        return 0.0;
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
    if mass > 0.0 { change.norm() / mass } else { 0.0 }
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
    for _ in 0..REBOUND_SWEEPS {
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
