//! Two-way coupling of the liquid with rigid bodies, within the iterations of the density solve.
//!
//! *Method*: a body is a solid whose pose at the end of the substep follows from its velocities. Whatever a body does to a particle, by
//! its density, by projection, by friction and by surface tension, acts on the body with the opposite sign at the same place, so that momentum is
//! conserved to rounding, but for corrections of particles that are shortened, which are counted. Reactions alone diverge where a body is
//! light (the added-mass instability). Therefore an iteration solves the pressures of all particles at a body together with the six velocities of the body: with the diagonal D of
//! the liquid and the rows u_i of the body, (D + U M⁻¹ Uᵀ) κ = C, by the identity of Woodbury with a system of six unknowns for each body. Projections and
//! friction, which only push, are solved with them as well (`rigid_system.rs`).
//! *Departs from*: [akinci12], whose coupling is explicit and whose bodies are sampled with particles; here solids are distance fields. The
//! pressures at the body are those of the strong coupling of [gissler19], without an iteration of their own.
//!
//! Symbols: κ_i, D_i → `denominator`, λ → see `density.rs`; u_i = (∇ρ, r × ∇ρ) → [`Lever`], with r from the centre of mass to the
//! particle; M → mass and inertia of the body over the mass of a particle. Impulses by Δt over the mass of a particle are displacements [m].
//! Limits: the particles at two bodies at once are solved for each of them separately.

use super::{
    images::{BodySamples, PairSample},
    rigid_pairs::{ImageLists, ImageNodes, RigidPair},
    rigid_system::{Lever, dot, lever, yield_to},
    walls::{ROUNDING, Walls},
};
use crate::{
    math::Vec3,
    par,
    solid::{BodySurface, Pose, RigidBody},
};
use nalgebra::Vector3;

/// Rigid bodies that share the liquid's substeps.
pub(in crate::sim) trait CoupledBodies {
    /// The bodies.
    fn bodies(&self) -> &[RigidBody];

    /// Their surfaces, and the bodies.
    fn surfaces(&self) -> (Vec<BodySurface<'_>>, &[RigidBody]);

    /// The bodies, to which impulses are added.
    fn bodies_mut(&mut self) -> &mut [RigidBody];

    /// Upper bound of the speed of their points [m/s].
    fn max_speed(&self) -> f64;

    /// Starts the substep from `now` [s] of `dt` [s]: moves bodies with gravity, and keeps them out of solids and of each other.
    fn start_substep(&mut self, now: f64, dt: f64);

    /// Resolves contacts after impulses, and moves the bodies accordingly.
    fn resolve_contacts(&mut self);

    /// Keeps the impulses of contacts before a correction.
    fn save_contacts(&mut self);

    /// Keeps the part `kept` of the impulses of contacts since [`CoupledBodies::save_contacts`].
    fn shorten_contacts(&mut self, kept: f64);

    /// Ends the substep: rebounds.
    fn end_substep(&mut self);
}

/// A particle that a rigid body projected out of itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct RigidContact {
    pub(super) particle: u32,
    pub(super) body: u32,
    /// Where it is [m].
    pub(super) x: Vec3,
    /// Normal out of the body, or direction of friction.
    pub(super) normal: Vec3,
    /// The projection [m], or the change of velocity [m/s].
    pub(super) push: Vec3,
}

/// What the solver keeps of the rigid bodies in a substep.
#[derive(Debug, Default)]
pub(super) struct RigidSide {
    /// The particles near bodies, in ascending order.
    pub(super) pairs: Vec<RigidPair>,
    /// What an iteration evaluates at each of them.
    pub(super) samples: Vec<PairSample>,
    /// The pairs of the neighbours of each of them.
    pub(super) images: ImageLists,
    /// The pairs in the layout of the sums over [`Self::images`].
    pub(super) image_nodes: ImageNodes,
    /// Index of the first pair of each particle, or `NO_PAIR`; empty without bodies.
    pub(super) first_pair: Vec<u32>,
    /// Whether the pairs have the surfaces at the current positions and poses.
    pub(super) is_sampled: bool,
    /// Whether a body has moved farther than its skin since [`Self::pairs`] were found.
    pub(super) stale: bool,
    /// Poses of the bodies when [`Self::pairs`] were found.
    pub(super) listed_at: Vec<Pose>,
    /// Projections by solids in the last correction [m]; empty without bodies.
    pub(super) projection: Vec<Vec3>,
    /// Linear and angular impulse of the liquid on each body in this substep.
    impulse: Vec<[Vector3<f64>; 2]>,
    /// Velocities of the bodies and these impulses before the last correction.
    before: Vec<[[Vector3<f64>; 2]; 2]>,
}

/// Whether solids displaced a particle to `x` by `push`, apart from rounding errors.
#[inline]
pub(super) fn is_pushed(x: Vec3, push: Vec3) -> bool {
    push.amax() > ROUNDING * x.amax()
}

fn add_lever(sum: &mut Lever, more: &Lever) {
    sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

/// Sums over pairs by body, in chunks of fixed length.
pub(super) fn sum_by_body<T: Clone + Send + Sync>(
    count: usize,
    bodies: usize,
    zero: &T,
    add: impl Fn(usize, &mut [T]) + Sync,
    merge: impl Fn(&mut T, &T),
) -> Vec<T> {
    let partials = par::map_chunks(count, par::CHUNK.max(16 * bodies), |range| {
        let mut sums = vec![zero.clone(); bodies];
        range.for_each(|k| add(k, &mut sums));
        sums
    });
    let mut total = vec![zero.clone(); bodies];
    for partial in &partials {
        total.iter_mut().zip(partial).for_each(|(sum, more)| merge(sum, more));
    }
    total
}

impl RigidSide {
    /// Starts a substep.
    pub(super) fn start_substep(&mut self, bodies: usize) {
        self.impulse.clear();
        self.impulse.resize(bodies, [Vector3::zeros(); 2]);
    }

    /// Sets the number of particles.
    pub(super) fn resize(&mut self, particles: usize, has_bodies: bool) {
        self.projection.clear();
        self.projection.resize(if has_bodies { particles } else { 0 }, Vec3::zeros());
    }

    /// Starts sums of projections from zero.
    pub(super) fn start_projection(&mut self) {
        self.projection.fill(Vec3::zeros());
    }

    /// Ends the validity of what is sampled, because particles or bodies move.
    pub(super) fn discard_samples(&mut self) {
        self.is_sampled = false;
    }

    /// What the particles near bodies see of them, as far as it is sampled, and the projections of the correction.
    pub(super) fn samples_and_projection(&mut self) -> (BodySamples<'_>, &mut Vec<Vec3>) {
        let first_pair = if self.is_sampled { &*self.first_pair } else { &[] };
        (BodySamples { first_pair, pairs: &self.pairs, samples: &self.samples }, &mut self.projection)
    }

    /// Keeps the velocities before a correction.
    pub(super) fn save(&mut self, bodies: &[RigidBody]) {
        self.before.clear();
        self.before
            .extend(bodies.iter().zip(&self.impulse).map(|(body, impulse)| [body.momenta(), *impulse]));
    }

    /// Keeps the part `kept` (0 to 1) of the impulses since [`RigidSide::save`].
    pub(super) fn shorten(&mut self, bodies: &mut [RigidBody], kept: f64) {
        for ((body, impulse), [momenta, before]) in bodies.iter_mut().zip(&mut self.impulse).zip(&self.before)
        {
            body.return_to(*momenta, kept);
            for (impulse, before) in impulse.iter_mut().zip(before) {
                *impulse = before + (*impulse - before) * kept;
            }
        }
    }

    /// Work of the bodies on the liquid in this substep [J]: the impulses times the velocities of the bodies.
    pub(super) fn work(&self, bodies: &[RigidBody]) -> f64 {
        let works = bodies.iter().zip(&self.impulse);
        works
            .map(|(body, [linear, angular])| {
                -linear.dot(&body.velocity()) - angular.dot(&body.angular_velocity())
            })
            .sum()
    }

    /// Adds the reactions to the sums of `levers` of each body at its centre of mass; `scale` is the mass of a particle over Δt.
    fn react(&mut self, bodies: &mut [RigidBody], levers: &[Lever], scale: f64) {
        self.push(bodies, levers, -scale);
    }

    /// Adds `scale` times impulses and angular impulses to the bodies.
    pub(super) fn push(&mut self, bodies: &mut [RigidBody], impulses: &[Lever], scale: f64) {
        for ((body, lever), impulse) in bodies.iter_mut().zip(impulses).zip(&mut self.impulse) {
            let [a, b, c, d, e, f] = lever.map(|part| part * scale);
            let (linear, angular) = (Vector3::new(a, b, c), Vector3::new(d, e, f));
            body.apply(linear, angular);
            impulse[0] += linear;
            impulse[1] += angular;
        }
    }

    /// Adds the reactions to the displacement of the particle of each pair by its body, which acts at a point; the lever is their product.
    pub(super) fn react_to_pairs(
        &mut self,
        bodies: &mut [RigidBody],
        scale: f64,
        displacement: impl Fn(&RigidPair, &PairSample) -> Option<(Vec3, Vec3)> + Sync,
    ) {
        let (pairs, samples, all) = (&self.pairs, &self.samples, &*bodies);
        let add = |k: usize, sums: &mut [Lever]| {
            let body = pairs[k].body as usize;
            if let Some((x, displacement)) = displacement(&pairs[k], &samples[k]) {
                add_lever(&mut sums[body], &lever(&all[body], x, displacement));
            }
        };
        let levers = sum_by_body(pairs.len(), all.len(), &[0.0; 6], add, add_lever);
        self.react(bodies, &levers, scale);
    }

    /// Adds the reactions to what bodies did to particles in contact to the bodies. Bodies yield to it, which makes it smaller: `correct`
    /// gets each particle and the change. `scale` is the mass of a particle [kg] over the Δt of displacements [s], or over 1 for velocities.
    pub(super) fn exchange(
        &mut self,
        contacts: &[RigidContact],
        bodies: &mut [RigidBody],
        [mass, scale]: [f64; 2],
        mut correct: impl FnMut(usize, Vec3),
    ) {
        if contacts.is_empty() {
            return;
        }
        let mut rows: Vec<Vec<(Lever, f64)>> = vec![Vec::new(); bodies.len()];
        for contact in contacts {
            let body = contact.body as usize;
            let along = f64::from(contact.normal.dot(&contact.push));
            rows[body].push((lever(&bodies[body], contact.x, contact.normal), along));
        }
        let yielded: Vec<Lever> =
            rows.iter().zip(&*bodies).map(|(rows, body)| yield_to(rows, body, mass)).collect();
        let mut levers = vec![[0.0; 6]; bodies.len()];
        for &RigidContact { particle, body, x, normal, push } in contacts {
            let body = body as usize;
            let along = normal.dot(&push);
            let gives = dot(&lever(&bodies[body], x, normal), &yielded[body]) as f32;
            let less = normal * ((along - gives).max(0.0) - along);
            correct(particle as usize, less);
            add_lever(&mut levers[body], &lever(&bodies[body], x, push + less));
        }
        self.react(bodies, &levers, scale);
    }

    /// Adds forces of bodies on particles, as displacements of particles over the substep, to the bodies with the opposite sign.
    /// `force` gives that of particle i by all solids, where their gradient is `gradient`.
    pub(super) fn add_reactions(
        &mut self,
        walls: &Walls,
        bodies: &mut [RigidBody],
        scale: f64,
        force: impl Fn(usize) -> Option<(Vec3, Vec3, Vec3)> + Sync,
    ) {
        self.react_to_pairs(bodies, scale, |&RigidPair { particle, body, .. }, _| {
            let (x, gradient, displacement) = force(particle as usize)?;
            let own = walls.rigid_gradient(body as usize, x);
            Some((x, displacement * (own.dot(&gradient) / gradient.norm_squared())))
        });
    }

    /// Adds the reactions to [`Self::projection`] to the bodies.
    pub(super) fn exchange_projections(
        &mut self,
        walls: &Walls,
        [p, wall_push]: [&mut [Vec3]; 2],
        bodies: &mut [RigidBody],
        units: [f64; 2],
    ) {
        let (pairs, pushes, at) = (&self.pairs, &self.projection, &*p);
        let found = par::map_chunks(pairs.len(), par::CHUNK, |range| {
            let contact = |k: usize| {
                let particle = pairs[k].particle;
                let push = pushes.get(particle as usize).copied().unwrap_or_default();
                let x = at[particle as usize];
                if !is_pushed(x, push) || k > 0 && pairs[k - 1].particle == particle {
                    return None;
                }
                let (body, normal) = walls.rigid_contact(x, push)?;
                Some(RigidContact { particle, body: body as u32, x, normal, push })
            };
            range.filter_map(contact).collect::<Vec<_>>()
        });
        let contacts = found.concat();
        self.exchange(&contacts, bodies, units, |i, less| {
            p[i] += less;
            if let Some(push) = wall_push.get_mut(i) {
                *push += less;
            }
        });
    }
}
