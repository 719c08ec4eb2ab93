//! Viscous drag between the liquid and rigid bodies.
//!
//! *Method*: the system of `viscosity.rs` with six more unknowns for each body, its change of velocity and angular velocity: with D of the
//! half space behind a particle's nearest point (`walls/no_slip.rs`) a particle gains D (J U − v) and the body M⁻¹ Σ Jᵀ D (v − J U). Both rows
//! together are symmetric with masses as weights. The conjugate gradients run in this inner product, so that every search direction is a sum of
//! forces and their reactions: each iterate conserves linear and angular momentum. A body that is much lighter than the liquid adds a few
//! large eigenvalues, each of which takes an iteration.
//!
//! Symbols: J U → velocity of the body at the particle, [`Drag::velocity`]; D → `resistance`; M → mass and inertia over the mass of a
//! particle; U → (velocity, angular velocity).
//! Limits: those of `walls/no_slip.rs`: bodies are taken as flat within the support of the kernel.

use super::{
    rigid::sum_by_body,
    rigid_pairs::{NO_PAIR, RigidPair},
    rigid_system::Lever,
    walls::Resistance,
};
use crate::{math::Vec3, par, solid::RigidBody};
use nalgebra::{Matrix6, Vector3, Vector6};

/// Drag between a particle and a body.
#[derive(Clone, Copy, Debug)]
struct Drag {
    particle: u32,
    body: u32,
    /// From the body's centre of mass to the particle [m].
    arm: Vec3,
    resistance: Resistance,
}

impl Drag {
    /// Velocity at the particle of a body with the velocities `u`.
    fn velocity(&self, u: &[Vector6<f64>]) -> Vec3 {
        let u = &u[self.body as usize];
        let linear: Vector3<f64> = u.fixed_rows::<3>(0).into();
        let angular: Vector3<f64> = u.fixed_rows::<3>(3).into();
        (linear + angular.cross(&self.arm.cast())).cast()
    }

    /// A force at the particle as force and torque on the body.
    fn lever(&self, force: Vec3) -> Lever {
        let (force, arm): (Vector3<f64>, Vector3<f64>) = (force.cast(), self.arm.cast());
        let torque = arm.cross(&force);
        [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    }
}

/// The bodies in the conjugate gradients; without bodies nothing.
#[derive(Debug, Default)]
pub(super) struct ViscousBodies {
    /// In ascending order of particles, with the index of the first of each, or [`NO_PAIR`].
    drags: Vec<Drag>,
    first: Vec<u32>,
    /// Mass and inertia over the mass of a particle, and its inverse.
    mass: Vec<Matrix6<f64>>,
    inverse: Vec<Matrix6<f64>>,
    /// Velocity and angular velocity before the solve [m/s], [1/s].
    velocity: Vec<Vector6<f64>>,
    direction: Vec<Vector6<f64>>,
    product: Vec<Vector6<f64>>,
    residual: Vec<Vector6<f64>>,
    change: Vec<Vector6<f64>>,
}

impl ViscousBodies {
    /// The bodies at the `pairs` of particles near them, which are at `p`; `resistance` gives D of a particle and a body, if it is not zero.
    pub(super) fn assemble(
        &mut self,
        bodies: &[RigidBody],
        (pairs, p): (&[RigidPair], &[Vec3]),
        particle_mass: f64,
        resistance: impl Fn(usize, usize) -> Option<Resistance> + Sync,
    ) {
        if bodies.is_empty() {
            return;
        }
        let found = par::map_chunks(pairs.len(), par::CHUNK, |range| {
            let drag = |k: usize| {
                let RigidPair { particle, body, .. } = pairs[k];
                let resistance = resistance(particle as usize, body as usize)?;
                let arm = (p[particle as usize].cast() - bodies[body as usize].position()).cast();
                Some(Drag { particle, body, arm, resistance })
            };
            range.filter_map(drag).collect::<Vec<_>>()
        });
        self.drags = found.concat();
        self.first.clear();
        self.first.resize(p.len(), NO_PAIR);
        for (k, drag) in (0..).zip(&self.drags) {
            let first = &mut self.first[drag.particle as usize];
            *first = (*first).min(k);
        }
        self.mass = bodies.iter().map(|body| body.mass_matrix() / particle_mass).collect();
        let invert = |mass: &Matrix6<f64>| mass.try_inverse().unwrap_or_else(Matrix6::zeros);
        self.inverse = self.mass.iter().map(invert).collect();
        let velocity = |body: &RigidBody| {
            let [v, w] = [body.velocity(), body.angular_velocity()];
            Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
        };
        self.velocity = bodies.iter().map(velocity).collect();
        for buffer in [&mut self.product, &mut self.residual, &mut self.change] {
            buffer.clear();
            buffer.resize(bodies.len(), Vector6::zeros());
        }
        self.direction.clone_from(&self.velocity);
    }

    fn is_empty(&self) -> bool {
        self.mass.is_empty()
    }

    /// Completes the product of Δt A with the direction: `product` has that of the particles with velocities `direction`, without the
    /// velocities of bodies. Returns what is missing in the direction times (1 + Δt A) times the direction.
    pub(super) fn multiply(&mut self, direction: impl Fn(usize) -> Vec3 + Sync, product: &mut [Vec3]) -> f64 {
        if self.is_empty() {
            return 0.0;
        }
        let Self { drags, first, mass, inverse, direction: u, product: body_product, .. } = self;
        let (drags, u) = (&*drags, &*u);
        par::update(product, |i, product| {
            let own = drags.get(first[i] as usize..).unwrap_or_default();
            for drag in own.iter().take_while(|drag| drag.particle as usize == i) {
                *product -= drag.resistance.times(drag.velocity(u));
            }
        });
        let zero = ([0.0; 6], 0.0);
        let sums = sum_by_body(
            drags.len(),
            u.len(),
            &zero,
            |k, sums| {
                let drag = &drags[k];
                let (v, at_body) = (direction(drag.particle as usize), drag.velocity(u));
                let force = drag.resistance.times(at_body - v);
                let (lever, curvature) = &mut sums[drag.body as usize];
                lever.iter_mut().zip(drag.lever(force)).for_each(|(sum, more)| *sum += more);
                let cross = drag.resistance.times(at_body).dot(&v);
                *curvature += f64::from(force.dot(&at_body) - cross);
            },
            |(lever, curvature), (more, more_curvature)| {
                lever.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
                *curvature += more_curvature;
            },
        );
        let mut missing = 0.0;
        for (body, (lever, curvature)) in sums.into_iter().enumerate() {
            body_product[body] = inverse[body] * Vector6::from(lever);
            missing += curvature + u[body].dot(&(mass[body] * u[body]));
        }
        missing
    }

    /// Starts from no change, once [`Self::multiply`] had the velocities before the solve as the direction.
    pub(super) fn start(&mut self) {
        for (residual, product) in self.residual.iter_mut().zip(&self.product) {
            *residual = -product;
        }
        self.direction.clone_from(&self.residual);
    }

    /// Advances change and residual along the direction by `alpha`.
    pub(super) fn advance(&mut self, alpha: f64) {
        for body in 0..self.mass.len() {
            self.change[body] += self.direction[body] * alpha;
            self.residual[body] -= (self.direction[body] + self.product[body]) * alpha;
        }
    }

    /// The next direction: the residual plus `beta` times the last.
    pub(super) fn update_direction(&mut self, beta: f64) {
        for (direction, residual) in self.direction.iter_mut().zip(&self.residual) {
            *direction = residual + *direction * beta;
        }
    }

    /// Squares of residual and change, with masses as weights.
    pub(super) fn norms2(&self) -> [f64; 2] {
        [&self.residual, &self.change].map(|of| {
            let square = |(v, mass): (&Vector6<f64>, &Matrix6<f64>)| v.dot(&(mass * v));
            of.iter().zip(&self.mass).map(square).sum()
        })
    }

    /// Square of the velocities before the solve, with masses as weights.
    pub(super) fn velocity2(&self) -> f64 {
        self.velocity.iter().zip(&self.mass).map(|(v, mass)| v.dot(&(mass * v))).sum()
    }

    /// Impulses and angular impulses on the bodies, over the mass of a particle [m/s], [m²/s].
    pub(super) fn impulses(&self) -> Vec<Lever> {
        self.mass.iter().zip(&self.change).map(|(mass, change)| (mass * change).into()).collect()
    }
}
