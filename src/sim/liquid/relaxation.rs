//! Relaxation of the seeded positions, for liquid that nothing moves, or with displaced particles.

use super::{
    Clock, Kernel, Liquid, LiquidRecord, Stop, Watch, accelerated::MIN_SIGNIFICANT_ERROR, jacobi, setup,
};

/// Maximum number of Jacobi iterations that correct the deviations of the seeded positions. A ball on its seeding lattice takes 5 to 20 for radii of 6
/// to 15 spacings.
const MAX_ITERATIONS: u32 = 20;

/// The same for displaced particles: that ball takes 7 to 60. After 20 it would move at 2 mm/s.
const MAX_JITTER_ITERATIONS: u32 = 60;

impl Liquid {
    /// Corrects the deviations of the seeded positions without a velocity, in liquid without gravity and tension or with `jitter`. In the first
    /// substep the corrections at the steps of a ball's surface would be velocities of 4 to 9 mm/s, with which it drifts apart for
    /// ever. Under gravity they are lost in the motion, and a seeding lattice that falls onto the floor from wall to wall is better
    /// not disturbed. What is left after the last iteration is corrected by the first substep.
    pub(super) fn relax(
        &mut self,
        clock: &mut Clock,
        record: &mut LiquidRecord,
        watch: &mut dyn Watch,
    ) -> Result<(), Stop> {
        let is_of_paper = self.params.target().is_none() || self.params.kernel != Kernel::Wendland;
        if is_of_paper && !self.params.has_jitter() {
            return Ok(()); // its kernels are never at rest on the seeding lattice, either
        }
        if self.x.is_empty() {
            return Ok(());
        }
        self.walls.move_to(0.0);
        self.list_positions(clock)?;
        let setup = setup(&self.params, &self.rest, &self.walls);
        for _ in 0..if self.params.has_jitter() { MAX_JITTER_ITERATIONS } else { MAX_ITERATIONS } {
            self.solver.ensure_lists(&setup).map_err(|cell| self.overcrowded(1, cell))?;
            self.solver.sample_rigid_pairs(&setup);
            if watch.is_cancelled() {
                return Err(Stop::Interrupted);
            }
            let residual = clock.time("solve", || jacobi::evaluate(&mut self.solver, &setup));
            if !residual.average.is_finite() {
                return Err(self.undefined_constraint(1).into());
            }
            if residual.average <= MIN_SIGNIFICANT_ERROR {
                break;
            }
            clock.time("solve", || self.solver.correct(&setup));
            record.iterations += 1;
        }
        self.solver.rigid.discard_samples();
        std::mem::swap(&mut self.x, &mut self.solver.p);
        Ok(())
    }
}
