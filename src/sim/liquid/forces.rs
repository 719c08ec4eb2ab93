//! Forces between the prediction and the density solve of a substep: viscosity, surface tension and artificial pressure.

use super::{
    Clock, CoupledBodies, Directions, Diverged, Liquid, LiquidRecord, Partners, Solver, Stop, ViscousStep,
    Watch, lanes, setup,
};

impl Liquid {
    /// Viscosity over `dt` [s], between two density solves. The first balances gravity with pressure: otherwise walls
    /// and viscosity would hold the weight of liquid at rest, and positions advance with velocities that lack viscosity.
    /// The second removes what compression the viscous velocities have.
    pub(super) fn apply_viscosity(
        &mut self,
        dt: f32,
        partners: &mut Partners<'_>,
        clock: &mut Clock,
        record: &mut LiquidRecord,
        watch: &mut dyn Watch,
    ) -> Result<(), Stop> {
        let unconverged = record.unconverged;
        let target = self.pressure_target(dt);
        let mut alone = partners.bodies_alone();
        clock.around("solve", |clock| self.solve(dt, target, &mut alone, clock, record, watch))?;
        // The second solve decides about the density, this one about the pressure that viscosity acts with.
        record.pressure_unconverged += record.unconverged - unconverged;
        record.unconverged = unconverged;
        clock.time("velocity", || self.update_velocities(dt));
        let Some(viscosity) = &mut self.viscosity else { return Ok(()) };
        self.momentum.keep(&self.solver, &mut viscosity.pressures);
        let solve = clock.time("viscosity", || {
            let reach = setup(&self.params, &self.rest, &self.walls).boundary_reach();
            let Solver { nodes, lists, p, clearance, rigid, .. } = &mut self.solver;
            lanes::publish_positions(nodes, &self.x, self.rest.inv_support);
            let (rest, walls, mass) = (&self.rest, &self.walls, self.mass);
            let (source, pairs) = (self.source.as_slice(), rigid.pairs.as_slice());
            let bodies = partners.bodies.as_deref().map_or(&[][..], CoupledBodies::bodies);
            let step =
                ViscousStep { rest, walls, lists, p, clearance, reach, dt, source, bodies, pairs, mass };
            viscosity.apply(step, nodes, &mut self.v)
        });
        if let Some(bodies) = &mut partners.bodies {
            self.solver.rigid.push(bodies.bodies_mut(), &viscosity.impulses(), self.mass);
        }
        self.move_bodies(partners, clock);
        record.viscosity_iterations += solve.iterations;
        record.viscosity_unconverged += u32::from(!solve.converged);
        record.viscosity_residual = record.viscosity_residual.max(solve.residual);
        let work = self.mass * solve.work;
        self.first_energy += work;
        record.solid_work += work;
        let pushed = self.solver.work;
        clock.time("predict", || self.predict_positions(dt));
        self.exchange_prediction(partners, dt, clock);
        self.solver.work += pushed;
        if self.v_before.is_some() {
            self.add_predicted_push(dt);
        }
        self.solver.check_skin(&self.rest);
        Ok(())
    }

    /// Moves the predicted positions by the surface tension over `dt` [s]. Returns the number of shortened displacements.
    pub(super) fn apply_tension(&mut self, dt: f32, partners: &mut Partners<'_>) -> u64 {
        let directions = Directions { theta: self.params.first_theta(), x: &self.x };
        let Some(tension) = &mut self.tension else { return 0 };
        // Solids are where the particles are: a common velocity changes nothing.
        tension.move_to(self.walls.now() - f64::from((1.0 - directions.theta) * dt));
        if let Some(bodies) = &partners.bodies {
            tension.place_bodies(bodies.bodies(), directions.theta);
        }
        let Solver { p, lists, wall_push, rigid, .. } = &mut self.solver;
        let has_reactions = self.v_before.is_some() || partners.bodies.is_some();
        let shortened = tension.apply(lists, p, directions, dt, has_reactions);
        if self.v_before.is_some() {
            tension.add_wall_push(wall_push, dt);
        }
        if let Some(bodies) = &mut partners.bodies {
            let scale = self.mass / f64::from(dt);
            tension.push_bodies(rigid, bodies.bodies_mut(), scale, dt);
        }
        self.solver.restore_pins();
        self.solver.check_skin(&self.rest);
        shortened
    }

    /// Applies the artificial pressure, if the preset names it.
    pub(super) fn apply_artificial_pressure(
        &mut self,
        dt: f32,
        clock: &mut Clock,
        record: &mut LiquidRecord,
    ) -> Result<(), Diverged> {
        if self.repulsion.is_some() {
            // The tension may have moved particles beyond the skin.
            let lists = clock
                .time("search", || self.solver.ensure_lists(&setup(&self.params, &self.rest, &self.walls)));
            lists.map_err(|cell| self.overcrowded(record.substeps, cell))?;
        }
        if let Some(repulsion) = &mut self.repulsion {
            record.clamps.corrections += clock.time("artificial_pressure", || {
                self.solver.publish_positions(self.rest.inv_support);
                let Solver { p, lists, nodes, .. } = &mut self.solver;
                let shortened = repulsion.apply(&self.rest, lists, nodes, p, dt);
                self.solver.restore_pins();
                self.solver.check_skin(&self.rest);
                shortened
            });
        }
        Ok(())
    }
}
