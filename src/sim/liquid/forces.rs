//! Forces between the prediction and the density solve of a substep: viscosity and surface tension.

use super::{Clock, Directions, Liquid, LiquidRecord, Solver, Stop, ViscousStep, Watch, lanes, setup};

impl Liquid {
    /// Viscosity over `dt` [s], between two density solves. The first balances gravity with pressure: otherwise walls
    /// and viscosity would hold the weight of liquid at rest, and positions advance with velocities that lack viscosity.
    /// The second removes what compression the viscous velocities have.
    pub(super) fn apply_viscosity(
        &mut self,
        dt: f32,
        clock: &mut Clock,
        record: &mut LiquidRecord,
        watch: &mut dyn Watch,
    ) -> Result<(), Stop> {
        let unconverged = record.unconverged;
        let target = self.pressure_target(dt);
        clock.around("solve", |clock| self.solve(dt, target, &mut None, clock, record, watch))?;
        // The second solve decides about the density, this one about the pressure that viscosity acts with.
        record.pressure_unconverged += record.unconverged - unconverged;
        record.unconverged = unconverged;
        clock.time("velocity", || self.update_velocities(dt));
        let Some(viscosity) = &mut self.viscosity else { return Ok(()) };
        self.momentum.keep(&self.solver, &mut viscosity.pressures);
        let solve = clock.time("viscosity", || {
            let reach = setup(&self.params, &self.rest, &self.walls).boundary_reach();
            let Solver { nodes, lists, p, clearance, .. } = &mut self.solver;
            lanes::publish_positions(nodes, &self.x, self.rest.inv_support);
            let (rest, walls) = (&self.rest, &self.walls);
            viscosity.apply(ViscousStep { rest, walls, lists, p, clearance, reach, dt }, nodes, &mut self.v)
        });
        record.viscosity_iterations += solve.iterations;
        record.viscosity_unconverged += u32::from(!solve.converged);
        record.viscosity_residual = record.viscosity_residual.max(solve.residual);
        let work = self.mass * solve.work;
        self.first_energy += work;
        record.solid_work += work;
        let pushed = self.solver.work;
        clock.time("predict", || self.predict_positions(dt));
        self.solver.work += pushed;
        if self.v_before.is_some() {
            self.add_predicted_push(dt);
        }
        self.solver.check_skin(&self.rest);
        Ok(())
    }

    /// Moves the predicted positions by the surface tension over `dt` [s]. Returns the number of shortened displacements.
    pub(super) fn apply_tension(&mut self, dt: f32) -> u64 {
        let directions = Directions { theta: self.params.first_theta(), x: &self.x };
        let Some(tension) = &mut self.tension else { return 0 };
        // Solids are where the particles are: a common velocity changes nothing.
        tension.move_to(self.walls.now() - f64::from((1.0 - directions.theta) * dt));
        let Solver { p, lists, wall_push, .. } = &mut self.solver;
        let shortened = tension.apply(lists, p, directions, dt);
        if self.v_before.is_some() {
            tension.add_wall_push(wall_push, dt);
        }
        self.solver.restore_pins();
        self.solver.check_skin(&self.rest);
        shortened
    }
}
