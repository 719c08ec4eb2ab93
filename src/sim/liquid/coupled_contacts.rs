//! Contacts with a coupled system in the passes of a substep; see `coupled.rs` for the interface.

use super::{Clock, CoupledBodies, Liquid, Partners, coupled::reborrow, solve::Solver};

impl Liquid {
    /// Finds the contacts with a coupled system.
    pub(super) fn detect_contacts(&mut self, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(coupled) = &mut partners.system else { return };
        let collide = |from, to| self.walls.collide(from, to).0;
        let bodies = partners.bodies.as_deref().map(|bodies| bodies as &dyn CoupledBodies);
        coupled.detect_contacts(&self.solver.particles(&self.x, &collide), bodies, clock);
    }

    /// Projects the contacts with a coupled system.
    pub(super) fn project_contacts(&mut self, dt: f32, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(coupled) = &mut partners.system else { return };
        let collide = |from, to| self.walls.collide(from, to).0;
        let bodies = reborrow(&mut partners.bodies);
        self.solver.rigid.start_projection();
        let pushed = coupled.project_contacts(&mut self.solver.particles(&self.x, &collide), bodies, clock);
        if pushed.particles {
            self.solver.restore_pins_with_work(&self.x);
            self.solver.check_skin(&self.rest);
        }
        if pushed.particles || pushed.bodies {
            self.exchange_contacts(dt, partners, clock);
        }
    }

    /// Ends the substep of a coupled system.
    pub(super) fn end_contacts(&mut self, dt: f32, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(coupled) = &mut partners.system else { return };
        let collide = |from, to| self.walls.collide(from, to).0;
        let bodies = reborrow(&mut partners.bodies);
        self.solver.rigid.start_projection();
        let mut particles = self.solver.particles(&self.x, &collide);
        self.first_energy += coupled.end_substep(&mut particles, bodies, &self.v, clock);
        self.solver.restore_pins_with_work(&self.x);
        self.solver.check_skin(&self.rest);
        self.exchange_contacts(dt, partners, clock);
    }

    /// Adds the reactions to the projections of contacts over `dt` [s] to the bodies, and moves these.
    fn exchange_contacts(&mut self, dt: f32, partners: &mut Partners<'_>, clock: &mut Clock) {
        let Some(bodies) = &mut partners.bodies else { return };
        let units = self.units(dt);
        let Solver { rigid, p, .. } = &mut self.solver;
        rigid.exchange_projections(&self.walls, [p, &mut []], bodies.bodies_mut(), units);
        self.move_bodies(partners, clock);
    }
}
