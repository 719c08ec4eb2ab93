//! Deviations at which density solves stop, and what a substep retains of the deviation that it starts with.
//!
//! *Method*: docs/decisions/022. Deep liquid is calm only if its mean deviation hardly changes from substep to substep, and if none of it
//! is corrected at once.

use super::{
    Clock, CoupledSystem, Diverged, Liquid, accelerated::MIN_SIGNIFICANT_ERROR, setup, solve::Target,
};

/// Growth of the deviation at which the iteration stops in each of the first substeps of a shot, over the one at which it stops later.
/// A column that starts at rest, without any deviation, would otherwise fall freely until it has that deviation, and be stopped within a
/// substep: at 1 %, one of 100 layers is thrown up.
const INITIAL_TARGET_GROWTH: f64 = 0.05;

/// Largest part of the deviation at the start of a substep that the substep retains. Deep liquid is compressed a little in every layer; if
/// one substep corrected all of that, the top of 64 layers of 2 cm would be thrown up at 0.25 m/s by a deviation of 0.1 %. At 0.7
/// liquid at rest is as calm, and takes 1.3 times the iterations.
const MAX_RETAINED_PART: f64 = 0.5;

/// [`LiquidParams::density_dev`] over the retained part, up to the largest part. With half at 0.1 %, too, the dam break takes 1.3 times the
/// iterations, and rests no better.
const DEVIATION_PER_RETAINED_PART: f64 = 0.01;

/// Average deviation at which the first density solve of a viscous substep stops, as a fraction of the distance, in
/// spacings, by which gravity moves a particle in the substep. Short substeps deviate by less than `density_dev` without
/// any pressure; walls then hold the weight by viscosity, and a slumping column is 3 % too high after 0.65 ms substeps. At 0.003
/// the solve takes 2.2 times the iterations for a picture that hardly differs.
const PRESSURE_TOLERANCE: f64 = 0.03;

impl Liquid {
    /// Where the density solve of a substep of `dt` [s] stops; `None`: after a fixed number of iterations.
    pub(super) fn target(&self, dt: f32, coupled: Option<&dyn CoupledSystem>) -> Option<Target> {
        // The time since the shot's start, which a restored frame has as well.
        let grown = INITIAL_TARGET_GROWTH * self.walls.now() / f64::from(dt);
        let eased = if self.is_calmed(coupled) { grown.min(1.0) } else { 1.0 };
        let stop = |limit: f64| (eased * limit).max(MIN_SIGNIFICANT_ERROR).min(limit);
        self.final_target().map(|limit| Target { stop: stop(limit), limit })
    }

    /// Where the first density solve of a viscous substep of `dt` [s] stops.
    pub(super) fn pressure_target(&self, dt: f32) -> Option<Target> {
        let fall = f64::from(self.body_acceleration() * dt * dt / self.rest.spacing);
        let limit = (PRESSURE_TOLERANCE * fall).max(MIN_SIGNIFICANT_ERROR);
        self.final_target().map(|target| target.min(limit)).map(|limit| Target { stop: limit, limit })
    }

    /// Part of the deviation at the start of a substep that the substep retains. Without gravity there is no depth, and slow corrections
    /// keep threads from breaking up.
    fn retained_part(&self) -> f64 {
        let is_gradual = self.params.is_calibrated() && self.body_acceleration() > 0.0;
        match self.params.target() {
            Some(target) if is_gradual => (target / DEVIATION_PER_RETAINED_PART).min(MAX_RETAINED_PART),
            _ => 0.0,
        }
    }

    /// Average deviation, less what is retained, at which the iteration stops after the first substeps; `None`: a fixed number of
    /// iterations.
    fn final_target(&self) -> Option<f64> {
        self.params.target().map(|target| (1.0 - self.retained_part()) * target)
    }

    /// Retains a part of the deviations for the next substep.
    pub(super) fn retain(&mut self) {
        let part = self.retained_part();
        if part > 0.0 {
            self.solver.retain(part as f32);
        } else {
            // Otherwise particles would stay exempt after they have left a nozzle.
            self.solver.retained.clear();
        }
    }

    /// Evaluates what the first substep of a frame retains, from positions alone. The evaluation at the end of the frame before is not
    /// used: its lists are in another order, and a restored frame has none.
    pub(super) fn retain_from_frame(&mut self, clock: &mut Clock) -> Result<(), Diverged> {
        if self.retained_part() == 0.0 || self.x.is_empty() {
            return Ok(());
        }
        self.list_positions(clock)?;
        let setup = setup(&self.params, &self.rest, &self.walls);
        clock.time("solve", || self.solver.measure(&setup));
        self.retain();
        Ok(())
    }

    /// Whether the density solve keeps the deviation from jumping. Without gravity nothing can come to rest, and the noise of the solve is
    /// what lets drops and threads leave the seeding lattice; sheets move with the corrections of the particles.
    pub(super) fn is_calmed(&self, coupled: Option<&dyn CoupledSystem>) -> bool {
        coupled.is_none() && self.body_acceleration() > 0.0
    }
}
