//! Contacts of points of sheets with rigid bodies, and the unknowns of their solve.

use crate::{
    math::Vec3,
    sim::sheet::{implicit, vectors::Vectors},
    solid::RigidBody,
};
use nalgebra::{Vector3, Vector6};

/// A point of a sheet near a rigid body.
#[derive(Clone, Copy, Debug)]
pub(super) struct BodyContact {
    pub(super) point: usize,
    /// Number of the point among the unknowns of a solve.
    pub(super) slot: usize,
    /// `None`: a collider behind a point that a body touches.
    pub(super) body: Option<usize>,
    /// Where the point is without contact [m].
    pub(super) x: Vec3,
    /// From the body's centre of mass to it [m].
    pub(super) arm: Vector3<f64>,
    /// Out of the body.
    pub(super) normal: Vec3,
    /// Distance beyond what is to be kept along the normal, and displacement relative to the body across it, both without contact [m].
    pub(super) base: Vec3,
    pub(super) friction: f32,
    /// Stiffness of the contact along the normal and across it while it is solved, as masses [kg].
    pub(super) stiffness: [f32; 2],
    /// Λ, and the largest friction, which is that of the last solve [kg·m].
    pub(super) push: Vec3,
    pub(super) limit: f32,
}

/// Where a body is without contact of sheets: centre of mass [m] and angular velocity [rad/s].
pub(super) type Free = [Vector3<f64>; 2];

/// The contacts of a substep.
#[derive(Debug)]
pub(in crate::sim) struct BodyContacts {
    pub(super) list: Vec<BodyContact>,
    pub(super) free: Vec<Free>,
    /// The largest change of Λ over the stiffness in the first solve [m].
    pub(super) first_change: Option<f32>,
    /// First guess of the first solve, and the displacements by all solves; of the implicit integrator.
    pub(super) guess: Option<Unknowns>,
    pub(super) solution: Option<Unknowns>,
}

impl BodyContacts {
    /// Whether there are impulses.
    pub(in crate::sim) fn is_pushing(&self) -> bool {
        self.list.iter().any(|contact| contact.push != Vec3::zeros())
    }

    /// Energies of the bodies that sheets push, which had `momenta` at the start of the substep: of their motion, and ½ ΔV·MΔV, which the
    /// substep dissipates \[J\]. `None`: no body is pushed.
    pub(in crate::sim) fn energies(
        &self,
        bodies: &[RigidBody],
        momenta: &[[Vector3<f64>; 2]],
    ) -> Option<[f64; 2]> {
        let mut is_pushed = vec![false; bodies.len()];
        let pushing = self.list.iter().filter(|contact| contact.push != Vec3::zeros());
        pushing.filter_map(|contact| contact.body).for_each(|body| is_pushed[body] = true);
        let of = |(index, (body, momenta)): (usize, (&RigidBody, &[Vector3<f64>; 2]))| {
            is_pushed[index].then(|| [body.kinetic_energy(), body.energy_of_change(momenta)])
        };
        let pushed = bodies.iter().zip(momenta).enumerate().filter_map(of);
        pushed.reduce(|sum, one| [sum[0] + one[0], sum[1] + one[1]])
    }

    /// Number of contacts with bodies that have an impulse.
    pub(in crate::sim) fn touching(&self) -> u64 {
        let touches = |contact: &&BodyContact| contact.body.is_some() && contact.push != Vec3::zeros();
        self.list.iter().filter(touches).count() as u64
    }

    /// Starts from the solution of the last substep, which took `before` [s], for one of `dt` [s], as contacts often push as they did.
    pub(in crate::sim) fn warm_start(&mut self, last: Self, before: f64, dt: f64) {
        self.guess = last.solution;
        if let Some(guess) = &mut self.guess {
            guess.scale((dt / before).powi(2));
        }
    }
}

impl BodyContact {
    /// A contact at the `gap` beyond what is to be kept and a displacement `slip`, both without contact.
    pub(super) fn new(
        point: usize,
        body: Option<usize>,
        x: Vec3,
        (normal, gap, slip): (Vec3, f32, Vec3),
        friction: f32,
    ) -> Self {
        Self {
            point,
            slot: point,
            body,
            x,
            arm: Vector3::zeros(),
            normal,
            base: normal * gap + (slip - normal * normal.dot(&slip)),
            friction,
            stiffness: [0.0; 2],
            push: Vec3::zeros(),
            limit: 0.0,
        }
    }

    /// Displacement of the point relative to the body since the contact was found, from which `base` counts [m].
    pub(super) fn relative(&self, x: Vec3, body: Option<(&RigidBody, &Free)>, dt: f64) -> Vec3 {
        let moved = body.map_or_else(Vector3::zeros, |(body, free)| {
            let turned = (body.angular_velocity() - free[1]) * dt;
            body.position() - free[0] + turned.cross(&self.arm)
        });
        self.base + (x - self.x) - moved.cast::<f32>()
    }

    /// Λ − k y along the normal and across it.
    fn wanted(&self, y: Vec3) -> (f32, Vec3) {
        let (pushed, apart) = (self.normal.dot(&self.push), self.normal.dot(&y));
        let along = pushed - self.stiffness[0] * apart;
        (along, (self.push - self.normal * pushed) - (y - self.normal * apart) * self.stiffness[1])
    }

    /// P(Λ − k y), where the relative displacement is `y`.
    pub(super) fn force(&self, y: Vec3) -> Vec3 {
        let (along, across) = self.wanted(y);
        let length = across.norm();
        let held = if length > self.limit { across * (self.limit / length) } else { across };
        self.normal * along.max(0.0) + held
    }

    /// Takes the force at `y` as Λ, and returns the change. The friction of the next solve is that of its part along the normal, which is
    /// never negative; along the normal of their sum it may be, by rounding.
    pub(super) fn accept(&mut self, y: Vec3) -> Vec3 {
        let before = self.push;
        (self.push, self.limit) = (self.force(y), self.friction * self.wanted(y).0.max(0.0));
        self.push - before
    }

    /// Change of the force at `y` along a step `w`.
    pub(super) fn curvature(&self, y: Vec3, w: Vec3) -> f64 {
        let (along, across) = self.wanted(y);
        let step = self.normal.dot(&w);
        let side = w - self.normal * step;
        let length = across.norm();
        let normal = if along > 0.0 { step * step } else { 0.0 };
        let tangential = if length > self.limit {
            // The derivative of the projection to a disc.
            self.limit / length * (side.norm_squared() - (side.dot(&across) / length).powi(2)).max(0.0)
        } else {
            side.norm_squared()
        };
        f64::from(self.stiffness[0] * normal + self.stiffness[1] * tangential)
    }

    /// Displacement that a change of Λ stands for, by the stiffness [m].
    pub(super) fn displacement(&self, change: Vec3) -> f32 {
        let along = self.normal.dot(&change);
        (along.abs() / self.stiffness[0]).max((change - self.normal * along).norm() / self.stiffness[1])
    }
}

/// Displacements of points [m], and of bodies with their rotations [m], [rad].
#[derive(Debug)]
pub(super) struct Unknowns {
    pub(super) points: Vectors,
    pub(super) bodies: Vec<Vector6<f64>>,
}

impl Unknowns {
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let bodies = self.bodies.iter().zip(&other.bodies).map(|(a, b)| a.dot(b));
        self.points.dot(&other.points) + bodies.sum::<f64>()
    }

    pub(super) fn scale(&mut self, by: f64) {
        self.points.update(|_, axes| axes.into_iter().flatten().for_each(|value| *value *= by as f32));
        self.bodies.iter_mut().for_each(|body| *body *= by);
    }

    /// f self + g other.
    pub(super) fn combine(&mut self, f: f64, other: &Self, g: f64) {
        implicit::combine(&mut self.points, f as f32, &other.points, g as f32);
        self.bodies.iter_mut().zip(&other.bodies).for_each(|(a, b)| *a = *a * f + b * g);
    }

    /// Displacement of a contact's point relative to its body.
    pub(super) fn relative(&self, contact: &BodyContact) -> Vec3 {
        let moved: Vector3<f64> = contact.body.map_or_else(Vector3::zeros, |body| {
            let body = &self.bodies[body];
            body.fixed_rows::<3>(0) + body.fixed_rows::<3>(3).cross(&contact.arm)
        });
        self.points.get(contact.slot) - moved.cast::<f32>()
    }

    /// Adds a force on a contact's point, and the opposite on its body.
    pub(super) fn push(&mut self, contact: &BodyContact, force: Vec3) {
        self.points.add(contact.slot, force);
        if let Some(body) = contact.body {
            self.bodies[body] -= wrench(contact, force.cast());
        }
    }
}

/// Force and torque about the centre of mass of a force at a contact.
pub(super) fn wrench(contact: &BodyContact, force: Vector3<f64>) -> Vector6<f64> {
    let torque = contact.arm.cross(&force);
    Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        math::Random,
        solid::{BodyState, MassProperties, Shape},
    };
    use std::f64::consts::PI;

    #[test]
    fn energies_are_those_of_pushed_bodies_alone() {
        let properties =
            MassProperties::new(&Shape::Sphere { center: [0.0; 3], radius: 0.5 }, 12.0 / PI).unwrap();
        let body = |velocity| {
            let state = BodyState {
                position: Vec3::zeros(),
                rotation: (Vec3::zeros(), 1.0),
                velocity,
                angular_velocity: Vec3::zeros(),
            };
            RigidBody::new(properties, &state).unwrap()
        };
        // 2 kg each.
        let bodies = [body(Vec3::x()), body(Vec3::z() * 3.0)];
        let momenta = [[Vector3::zeros(); 2]; 2];
        let mut contact = BodyContact::new(0, Some(1), Vec3::zeros(), (Vec3::z(), 0.0, Vec3::zeros()), 0.0);
        let of = |contact: BodyContact| {
            BodyContacts {
                list: vec![contact],
                free: Vec::new(),
                first_change: None,
                guess: None,
                solution: None,
            }
            .energies(&bodies, &momenta)
        };
        assert_eq!(of(contact), None);
        contact.push = Vec3::z();
        let [motion, dissipated] = of(contact).expect("one is pushed");
        assert!((motion - 9.0).abs() < 0.02 && (dissipated - 9.0).abs() < 0.02, "{motion}, {dissipated}");
    }

    #[test]
    fn a_contact_that_opens_keeps_no_friction_and_stays_finite() {
        let random = Random::new([1, 2, 3]);
        let vector = |k| random.vector(k) - Vec3::repeat(0.5);
        for k in 0..1000 {
            let normal = vector(4 * k).normalize();
            let mut contact = BodyContact::new(0, None, Vec3::zeros(), (normal, 0.0, Vec3::zeros()), 0.7);
            contact.stiffness = [1.0, 3.0];
            contact.accept(vector(4 * k + 1) - normal);
            assert!(contact.limit > 0.0 && contact.push.dot(&normal) > 0.0, "{contact:?}");
            // It opens, with the friction of the last solve.
            let change = contact.accept(vector(4 * k + 2) + normal * 4.0);
            assert!(contact.limit == 0.0 && change.norm() > 0.0, "{contact:?}");
            let [held, opened] = [Vec3::zeros(), normal].map(|y| contact.force(y));
            assert!(held.norm() < 1e-5 && opened.norm() < 1e-5, "{held} {opened}");
            assert!(contact.curvature(Vec3::zeros(), normal).is_finite());
        }
    }
}
