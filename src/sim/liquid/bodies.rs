//! Rigid bodies in the passes of a substep; see `rigid.rs` for the coupling.

use super::{
    Clock, Diverged, Liquid, LiquidRecord, Partners, SolverKind,
    rigid::{RigidContact, is_pushed},
    rigid_pressure::YieldStep,
    setup,
    solve::Directions,
};
use crate::{par, solid::RigidBody};

impl Liquid {
    /// Rebuilds the neighbour lists if they are stale, for an iteration of the density solve.
    pub(super) fn ensure_lists(&mut self, record: &LiquidRecord) -> Result<(), Diverged> {
        let setup = setup(&self.params, &self.rest, &self.walls);
        self.solver.ensure_lists(&setup).map_err(|cell| self.overcrowded(record.substeps, cell))?;
        self.solver.sample_rigid_pairs(&setup);
        Ok(())
    }

    /// Sets the poses of the rigid bodies among the solids.
    pub(in crate::sim) fn place_bodies(&mut self, bodies: &[RigidBody]) {
        self.walls.set_rigid_bodies(bodies.iter().map(|body| [body.start_pose(), body.pose()]));
        if let Some(tension) = &mut self.tension {
            tension.place_bodies(bodies, 1.0);
        }
    }

    /// Starts the substep of the bodies from `now` [s] of `dt` [s].
    pub(super) fn start_bodies(&mut self, partners: &mut Partners<'_>, now: f64, dt: f64, clock: &mut Clock) {
        if let Some(bodies) = &mut partners.bodies {
            clock.time("bodies", || bodies.start_substep(now, dt));
            self.solver.rigid.start_substep(bodies.bodies().len());
            self.place_bodies(bodies.bodies());
        }
    }

    /// Adds the work of the bodies in this substep to the energy that the liquid may have.
    pub(super) fn add_body_work(&mut self, partners: &Partners<'_>, record: &mut LiquidRecord) {
        if let Some(bodies) = &partners.bodies {
            let work = self.solver.rigid.work(bodies.bodies());
            self.first_energy += work;
            record.solid_work += work;
        }
    }

    /// Resolves contacts of the bodies after impulses, and moves the solids with them.
    pub(super) fn move_bodies(&mut self, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(bodies) = &mut partners.bodies else { return };
        clock.time("bodies", || bodies.resolve_contacts());
        self.walls.set_rigid_bodies(bodies.bodies().iter().map(|body| [body.start_pose(), body.pose()]));
        self.solver.check_rigid_skin(&setup(&self.params, &self.rest, &self.walls));
    }

    /// Mass of a particle [kg], and the same over `dt` [s].
    pub(super) fn units(&self, dt: f32) -> [f64; 2] {
        [self.mass, self.mass / f64::from(dt)]
    }

    /// Adds the reactions to the collisions of the predicted positions over `dt` [s] to the bodies.
    pub(super) fn exchange_prediction(&mut self, partners: &mut Partners<'_>, dt: f32, clock: &mut Clock) {
        let Some(bodies) = &mut partners.bodies else { return };
        let (x, v, p, walls) = (&self.x, &self.v, &self.solver.p, &self.walls);
        let found = par::map_chunks(x.len(), par::CHUNK, |range| {
            let contact = |i: usize| {
                let push = p[i] - (x[i] + v[i] * dt);
                let (body, normal) =
                    is_pushed(p[i], push).then(|| walls.rigid_contact(p[i], push)).flatten()?;
                Some(RigidContact { particle: i as u32, body: body as u32, x: p[i], normal, push })
            };
            range.filter_map(contact).collect::<Vec<_>>()
        });
        let units = self.units(dt);
        let super::solve::Solver { rigid, p, .. } = &mut self.solver;
        rigid.exchange(&found.concat(), bodies.bodies_mut(), units, |i, less| p[i] += less);
        self.move_bodies(partners, clock);
    }

    /// Starts a density solve over `dt` [s] from the last pressures.
    pub(super) fn start_pressures(
        &mut self,
        dt: f32,
        theta: f32,
        partners: &mut Partners<'_>,
        clock: &mut Clock,
    ) {
        let setup = setup(&self.params, &self.rest, &self.walls);
        let directions = Directions { theta, x: &self.x };
        if self.momentum.start(&mut self.solver, &setup, dt, directions) {
            self.push_bodies(dt, partners, clock);
        }
    }

    /// Reduces the changes of pressure by what the bodies yield.
    pub(super) fn yield_to_bodies(&mut self, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(bodies) = &mut partners.bodies else { return };
        let Self { solver, momentum, params, walls, rest, .. } = self;
        clock.time("bodies", || {
            let is_accelerated = params.solver == SolverKind::Accelerated;
            let step = YieldStep {
                relaxation: if is_accelerated { momentum.relaxation() } else { 1.0 },
                smallest: setup(params, rest, walls).lower_bound(),
                tension: if is_accelerated { momentum.tension() } else { 0.0 },
                is_accumulating: is_accelerated,
            };
            solver.yield_to_rigid_bodies(bodies.bodies(), self.mass, &step);
        });
    }

    /// Adds the reactions to the last correction over `dt` [s] to the bodies.
    pub(super) fn push_bodies(&mut self, dt: f32, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(bodies) = &mut partners.bodies else { return };
        let units = self.units(dt);
        let Self { solver, walls, .. } = self;
        clock.time("bodies", || solver.push_rigid_bodies(walls, bodies.bodies_mut(), units));
        self.move_bodies(partners, clock);
    }

    /// Keeps the velocities of the bodies before a correction.
    pub(super) fn save_bodies(&mut self, partners: &mut Partners<'_>) {
        if let Some(bodies) = &mut partners.bodies {
            bodies.save_contacts();
            self.solver.rigid.save(bodies.bodies());
        }
    }

    /// Keeps the part `kept` of the last correction, of particles and bodies.
    pub(super) fn shorten_correction(
        &mut self,
        kept: f64,
        dt: f32,
        partners: &mut Partners<'_>,
        clock: &mut Clock,
    ) {
        if let Some(bodies) = &mut partners.bodies {
            self.solver.rigid.discard_samples();
            bodies.shorten_contacts(kept);
            self.solver.rigid.shorten(bodies.bodies_mut(), kept);
            self.move_bodies(partners, clock);
        }
        self.solver.shorten_correction(kept, &setup(&self.params, &self.rest, &self.walls));
        if let Some(bodies) = &mut partners.bodies {
            let units = self.units(dt);
            let Self { solver, walls, .. } = self;
            let super::solve::Solver { rigid, p, wall_push, .. } = solver;
            rigid.exchange_projections(walls, [p, wall_push], bodies.bodies_mut(), units);
            self.move_bodies(partners, clock);
        }
    }
}
