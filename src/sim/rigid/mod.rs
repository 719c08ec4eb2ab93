//! Rigid bodies: they fall, collide and float.
//!
//! *Method*: mass, inertia and motion in `solid/rigid_body.rs`; contacts by sequential impulses in `contact.rs`; pressure, surface tension and friction
//! of a liquid, whose substeps the bodies share, in `liquid/rigid.rs`; contact with sheets, too, in `coupling/`. See docs/decisions/034.
//! Limits: first order in time. Smoke does not act on bodies, nor bodies on smoke.

mod contact;
mod deforming;
mod forced;
#[cfg(feature = "presets")]
pub(crate) mod job;
mod obstacle;
mod params;
mod patch;
mod record;
mod samples;

pub use params::BodyParams;
pub use record::{BodyRecord, BodySeeds};

use super::{
    Diverged, SetupError, Stop, Watch, World,
    clock::{Clock, Seconds},
    force::{ForceRecord, Forces},
    liquid::CoupledBodies,
    substep::advance_frame,
};
use crate::{
    frame::{Stream, StreamKind},
    math::{Vec3, rotation::from_euler_angles},
    solid::{BodyState, BodySurface, MassProperties, RigidBody, Solid},
};
use contact::{Contact, ITERATION_SWEEPS, START_SWEEPS, find, rebound, resolve, separate};
use forced::BodyForces;
use nalgebra::Vector3;
use obstacle::{Obstacle, Placed};
use patch::keep_rim;

/// Name of the system and of its stream.
pub const NAME: &str = "bodies";

/// The pass of bodies without a liquid.
const PASS: &str = "bodies";

/// Longest substep without a liquid [s].
const LONGEST_SUBSTEP: f64 = 1.0 / 240.0;

/// Most substeps of a frame without a liquid.
const MAX_SUBSTEPS: u32 = 2000;

/// Depth at the start of the shot above which bodies overlap, over the inner radius.
const MAX_STARTING_DEPTH: f64 = 0.1;

/// Largest deviation of the length of a quaternion in a frame from 1.
const QUATERNION_TOLERANCE: f32 = 1e-3;

/// The rigid bodies of a shot and their current state.
#[derive(Debug)]
pub(super) struct RigidBodies {
    bodies: Vec<RigidBody>,
    solids: Vec<Solid>,
    obstacles: Vec<Obstacle>,
    colliders: Vec<Obstacle>,
    gravity: Vector3<f64>,
    contacts: Vec<Contact>,
    /// The contacts before the last correction of the liquid.
    contacts_before: Vec<Contact>,
    /// Force fields; `None`: there are none.
    forces: Option<Box<BodyForces>>,
    /// The states at the last frame, as its stream has them.
    states: Vec<BodyState>,
    /// Length of the current substep [s].
    dt: f64,
    record: BodyRecord,
}

impl RigidBodies {
    /// The bodies at their start.
    ///
    /// # Errors
    /// [`SetupError::Body`] if one has no mass.
    pub(super) fn new(params: &[BodyParams], world: &World) -> Result<Self, SetupError> {
        Self::with_states(params, world, |_, params| {
            let turn = from_euler_angles(Vector3::from(params.rotation.map(|a| f64::from(a).to_radians())));
            let q = turn.coords;
            BodyState {
                position: params.position.into(),
                rotation: (Vec3::new(q.x as f32, q.y as f32, q.z as f32), q.w as f32),
                velocity: params.velocity.into(),
                angular_velocity: Vec3::from(params.angular_velocity.map(f32::to_radians)),
            }
        })
    }

    /// Restores the bodies from the streams of a frame.
    ///
    /// # Errors
    /// [`SetupError`] if the frame lacks their state.
    pub(super) fn restore(
        params: &[BodyParams],
        world: &World,
        streams: &[Stream],
    ) -> Result<Self, SetupError> {
        let missing = |what| SetupError::Missing { stream: NAME, what };
        let stream = streams.iter().find(|stream| stream.name == NAME).ok_or(missing("bodies"))?;
        if stream.len() != params.len() {
            return Err(missing("bodies"));
        }
        let vectors = |name| stream.vec3(name).ok_or(missing(name));
        let (positions, rotations) = (vectors("position")?, vectors("rotation")?);
        let (velocities, spins) = (vectors("velocity")?, vectors("angular_velocity")?);
        let real = stream.f32("rotation_w").ok_or(missing("rotation_w"))?;
        let is_unit =
            |(q, w): (&Vec3, &f32)| ((q.norm_squared() + w * w).sqrt() - 1.0).abs() < QUATERNION_TOLERANCE;
        let vectors = [positions, velocities, spins];
        let is_finite =
            vectors.iter().flat_map(|column| column.iter().flat_map(|v| v.iter())).all(|c| c.is_finite());
        if !is_finite || !rotations.iter().zip(real).all(is_unit) {
            return Err(missing("finite states with unit quaternions"));
        }
        Self::with_states(params, world, |k, _| BodyState {
            position: positions[k],
            rotation: (rotations[k], real[k]),
            velocity: velocities[k],
            angular_velocity: spins[k],
        })
    }

    fn with_states(
        params: &[BodyParams],
        world: &World,
        state: impl Fn(usize, &BodyParams) -> BodyState,
    ) -> Result<Self, SetupError> {
        let states: Vec<BodyState> = params.iter().enumerate().map(|(k, params)| state(k, params)).collect();
        let body = |(index, (params, state)): (usize, (&BodyParams, &BodyState))| {
            let none = SetupError::Body { index };
            let properties =
                MassProperties::new(&params.shape, f64::from(params.density)).ok_or(none.clone())?;
            RigidBody::new(properties, state).ok_or(none)
        };
        let bodies = params.iter().zip(&states).enumerate().map(body).collect::<Result<Vec<_>, _>>()?;
        let obstacle = |body: &BodyParams| Obstacle::new(&body.shape, body.friction, body.restitution);
        Ok(Self {
            bodies,
            solids: params.iter().map(BodyParams::solid).collect(),
            obstacles: params.iter().map(obstacle).collect(),
            colliders: world.solids.iter().flat_map(Obstacle::collider).collect(),
            gravity: world.gravity.cast(),
            contacts: Vec::new(),
            contacts_before: Vec::new(),
            forces: None,
            states,
            dt: 0.0,
            record: BodyRecord::default(),
        })
    }

    /// Report of the start.
    pub(super) fn seeded(&self) -> BodySeeds {
        let copy = self.with_substep(0.0, 1e-6);
        let overlapping = copy.deepest().iter().filter(|depth| **depth > MAX_STARTING_DEPTH).count() as u64;
        BodySeeds { bodies: self.bodies.len() as u32, overlapping }
    }

    /// The bodies as solids of a liquid, and their states.
    pub(super) fn as_solids(&self) -> (&[Solid], &[RigidBody]) {
        (&self.solids, &self.bodies)
    }

    /// The passes of bodies without a liquid.
    pub(super) fn passes() -> Vec<&'static str> {
        vec![PASS]
    }

    /// The state of the last frame as named columns, with everything that [`RigidBodies::restore`] needs.
    pub(super) fn stream(&self) -> Stream {
        let states = &self.states;
        let column = |value: fn(&BodyState) -> Vec3| states.iter().map(value).collect::<Vec<_>>();
        let real: Vec<f32> = states.iter().map(|state| state.rotation.1).collect();
        Stream::new(NAME, StreamKind::RigidBodies, states.len())
            .with("position", column(|state| state.position))
            .with("rotation", column(|state| state.rotation.0))
            .with("rotation_w", real)
            .with("velocity", column(|state| state.velocity))
            .with("angular_velocity", column(|state| state.angular_velocity))
    }

    /// Starts a frame.
    pub(super) fn begin_frame(&mut self) {
        self.record = BodyRecord { bodies: self.bodies.len() as u32, ..BodyRecord::default() };
        if let Some(forces) = &mut self.forces {
            forces.record = ForceRecord::default();
        }
    }

    /// Ends a frame at `now` [s] with the state in single precision that its stream has.
    ///
    /// # Errors
    /// [`Diverged`] if a state is not finite.
    pub(super) fn end_frame(&mut self, now: f64) -> Result<BodyRecord, Diverged> {
        for (index, (body, state)) in self.bodies.iter_mut().zip(&mut self.states).enumerate() {
            *state = body.round();
            let vectors = [state.position, state.velocity, state.angular_velocity];
            if !vectors.iter().flat_map(|v| v.iter()).all(|c| c.is_finite()) {
                return Err(Diverged {
                    system: NAME,
                    substep: self.record.substeps,
                    particle: index as u32,
                    what: "a position or velocity that is not finite".into(),
                    try_next: "body.velocity",
                });
            }
        }
        let mut record = std::mem::take(&mut self.record);
        record.forces = self.forces.as_ref().map(|forces| forces.record);
        record.kinetic_energy = self.bodies.iter().map(RigidBody::kinetic_energy).sum();
        record.potential_energy =
            self.bodies.iter().map(|body| -body.mass() * self.gravity.dot(&body.position())).sum();
        record.max_speed = self.bodies.iter().map(|body| body.velocity().norm()).fold(0.0, f64::max);
        record.penetration = self.with_substep(now, 1e-6).deepest().into_iter().fold(0.0, f64::max);
        Ok(record)
    }

    /// Advances bodies without a liquid from `start` [s] by a frame of `seconds`.
    ///
    /// # Errors
    /// [`Stop`].
    pub(super) fn advance(
        &mut self,
        [start, seconds]: [f64; 2],
        watch: &mut dyn Watch,
    ) -> Result<(BodyRecord, Seconds), Stop> {
        let mut clock = Clock::new(&[PASS]);
        advance_frame([start, seconds], watch, |progress, _| {
            let dt = progress.left / f64::from(self.substeps_left([progress.now(), progress.left], (0.0, 1)));
            clock.time(PASS, || {
                self.start_substep(progress.now(), dt);
                self.end_substep();
            });
            Ok(dt)
        })?;
        let record = clock.time(PASS, || self.end_frame(start + seconds))?;
        Ok((record, clock.into_totals()))
    }

    /// Substeps a second without a liquid.
    fn substep_rate(&self) -> f64 {
        let length = self.largest_motion();
        (1.0 / LONGEST_SUBSTEP).max(self.max_speed() / length)
    }

    /// Number of equal substeps of the `left` [s] of a frame from `now` [s] on in which neither bodies nor what
    /// moves at most at `speed` [m/s] go too far; at least those that `others` need.
    pub(super) fn substeps_left(&mut self, [now, left]: [f64; 2], (speed, others): (f64, u32)) -> u32 {
        let length = self.largest_motion();
        let rate = |forces: &BodyForces| forces.rate(now, (&self.bodies, &self.obstacles), &self.gravity);
        let forced = self.forces.as_deref().map_or(0.0, rate);
        let wanted = (left * self.substep_rate().max(speed / length).max(forced)).ceil().max(1.0);
        let allowed = MAX_SUBSTEPS.saturating_sub(self.record.substeps).max(1).max(others);
        self.record.capped += u32::from(wanted > f64::from(allowed));
        wanted.min(f64::from(allowed)).max(f64::from(others)) as u32
    }

    /// Largest motion of all in a substep [m].
    fn largest_motion(&self) -> f64 {
        self.obstacles.iter().map(Obstacle::largest_motion).fold(f64::INFINITY, f64::min)
    }

    /// Sets the forces that act from now on.
    pub(super) fn set_forces(&mut self, forces: Option<Forces>) {
        self.forces = forces.map(|forces| Box::new(BodyForces::new(forces, &self.obstacles)));
    }

    /// A copy in a substep of `dt` [s] from `now` [s], with its contacts.
    fn with_substep(&self, now: f64, dt: f64) -> Self {
        let mut copy = Self {
            bodies: self.bodies.clone(),
            solids: Vec::new(),
            obstacles: self.obstacles.clone(),
            colliders: self.colliders.clone(),
            contacts: Vec::new(),
            contacts_before: Vec::new(),
            forces: None,
            states: Vec::new(),
            record: BodyRecord::default(),
            ..*self
        };
        for body in &mut copy.bodies {
            body.start_substep(dt, Vector3::zeros());
        }
        copy.find_contacts(now, dt);
        copy
    }

    /// Depth of each body in others and in colliders, over the smaller inner radius.
    fn deepest(&self) -> Vec<f64> {
        let mut depths = vec![0.0_f64; self.bodies.len()];
        for contact in &self.contacts {
            let (bodies, depth) = contact.depth();
            for body in bodies.into_iter().flatten() {
                depths[body] = depths[body].max(depth);
            }
        }
        depths
    }

    /// Finds the contacts of the substep from `now` [s] of `dt` [s].
    fn find_contacts(&mut self, now: f64, dt: f64) {
        let mut found = std::mem::take(&mut self.contacts);
        found.clear();
        let bodies: Vec<Placed<'_>> = self
            .bodies
            .iter()
            .zip(&self.obstacles)
            .map(|(body, obstacle)| Placed::body(obstacle, body))
            .collect();
        let colliders: Vec<Placed<'_>> =
            self.colliders.iter().map(|collider| collider.place(now, dt, &bodies)).collect();
        for (a, body) in bodies.iter().enumerate() {
            let colliders = colliders.iter().map(|other| (None, other));
            let others = bodies.iter().enumerate().skip(a + 1).map(|(b, other)| (Some(b), other));
            for other in colliders.chain(others) {
                let first = found.len();
                find((a, body), other, dt, &mut found);
                keep_rim(&mut found, first);
            }
        }
        self.contacts = found;
    }

    /// Resolves the contacts with friction, and moves the bodies.
    fn resolve(&mut self, sweeps: u32) {
        let scale = self.gravity.norm() * self.dt;
        resolve(&mut self.contacts, &mut self.bodies, (self.dt, scale), (sweeps, true));
        self.bodies.iter_mut().for_each(RigidBody::advance);
    }
}

impl CoupledBodies for RigidBodies {
    fn bodies(&self) -> &[RigidBody] {
        &self.bodies
    }

    fn surfaces(&self) -> (Vec<BodySurface<'_>>, &[RigidBody]) {
        let surface = |obstacle| {
            let obstacle: &Obstacle = obstacle;
            let Obstacle { shape, center, reach, inner_radius, friction, .. } = obstacle;
            let [inner_radius, friction] = [*inner_radius as f32, *friction as f32];
            BodySurface { shape, center: *center, reach: *reach, inner_radius, friction }
        };
        (self.obstacles.iter().map(surface).collect(), &self.bodies)
    }

    fn bodies_mut(&mut self) -> &mut [RigidBody] {
        &mut self.bodies
    }

    fn max_speed(&self) -> f64 {
        let speed = |(body, obstacle): (&RigidBody, &Obstacle)| {
            let reach = body.distance_from_center(obstacle.center) + f64::from(obstacle.reach);
            body.velocity().norm() + body.angular_velocity().norm() * reach
        };
        self.bodies.iter().zip(&self.obstacles).map(speed).fold(0.0, f64::max)
    }

    fn start_substep(&mut self, now: f64, dt: f64) {
        self.dt = dt;
        let Self { forces, bodies, obstacles, gravity, .. } = self;
        let forced =
            forces.as_deref_mut().map(|forces| forces.impulses([now, dt], (bodies, obstacles), gravity));
        for body in &mut *bodies {
            body.start_substep(dt, *gravity);
        }
        if let (Some(forces), Some(impulses)) = (forces, forced) {
            forces.apply(&impulses, bodies);
        }
        self.find_contacts(now, dt);
        separate(&mut self.contacts, &mut self.bodies);
        let scale = self.gravity.norm() * dt;
        resolve(&mut self.contacts, &mut self.bodies, (dt, scale), (START_SWEEPS, false));
        self.resolve(START_SWEEPS);
        self.record.substeps += 1;
    }

    fn resolve_contacts(&mut self) {
        self.resolve(ITERATION_SWEEPS);
    }

    fn save_contacts(&mut self) {
        self.contacts_before.clone_from(&self.contacts);
    }

    fn shorten_contacts(&mut self, kept: f64) {
        let contacts = self.contacts.iter_mut().zip(&self.contacts_before);
        contacts.for_each(|(contact, before)| contact.shorten(before, kept));
    }

    fn end_substep(&mut self) {
        let touching = self.contacts.iter().filter(|contact| contact.normal_impulse > 0.0).count();
        self.record.contacts = self.record.contacts.max(touching as u64);
        rebound(&mut self.contacts, &mut self.bodies, self.gravity.norm() * self.dt);
    }
}
