//! What solids give to the air: vorticity from the layer that slips along them.
//!
//! *Method*: air that moves along a surface with the slip s, relative to it, is a vortex sheet of strength γ = n × s a square metre
//! ([koumoutsakos95], after Lighthill). The part 1 − e^(−Δt|s|/δ) of it, as much as the slip carries through a layer of thickness δ
//! in a step, is released in the layer's middle. What was released takes from the slip that is left, so it ends by itself.
//!
//! Symbols: δ → `layer` [m], γ → `sheet` [m/s], s → `slip` [m/s].
//! Limits: the layer is as thick as the vortons allow, not as the air's viscosity has it.

use super::{Instant, Shedding, SmokeRecord, System};
use crate::{math::Vec3, sim::vortex::Unfit};

/// Vortons and tracers are kept this far from surfaces, in spacings.
const GAP: f32 = 0.05;

impl System {
    /// Whether solids give vorticity to the air.
    pub(super) fn sheds(&self) -> Option<&Shedding> {
        self.params.shedding.as_ref().filter(|_| self.air.walls.is_some())
    }

    /// Puts out what slipped into solids, where they are at `then` [s].
    pub(super) fn put_out(&mut self, then: f64, record: &mut SmokeRecord) {
        if let Some(walls) = &self.air.walls {
            let gap = GAP * self.params.spacing;
            record.returned_vortons += walls.put_out(&mut self.flow.vortons.position, gap, then);
            record.returned_tracers += walls.put_out(&mut self.tracers.position, gap, then);
        }
    }

    /// Puts tracers out of solids where they are at `time` [s]; returns how many were inside.
    pub(super) fn put_tracers_out(&self, tracers: &mut [Vec3], time: f64) -> u64 {
        let gap = GAP * self.params.spacing;
        self.air.walls.as_ref().map_or(0, |walls| walls.put_out(tracers, gap, time))
    }

    /// Releases what slips along solids, where they are at `then` [s], over a step of `dt` [s].
    pub(super) fn shed(&mut self, then: f64, dt: f32, record: &mut SmokeRecord) -> Result<(), Unfit> {
        let (Some(&Shedding { strength, layer }), Some(walls)) = (self.sheds(), &self.air.walls) else {
            return Ok(());
        };
        let layer = layer * self.params.spacing;
        let panels = walls.placed(then);
        let at: Vec<Vec3> = panels.iter().map(|placed| placed.panel.x).collect();
        let sources = self.air.sources(&self.flow.vortons, then)?;
        let air = self.air.velocity(Instant { vortons: &self.flow.vortons, sources: &sources }, &at)?;
        let released = panels.iter().zip(&air).map(|(placed, air)| {
            let normal = placed.panel.normal;
            let slip = air - placed.velocity;
            let slip = slip - normal * normal.dot(&slip);
            let sheet = normal.cross(&slip);
            let part = strength * -(-dt * slip.norm() / layer).exp_m1();
            (placed.panel.x + normal * (0.5 * layer), sheet * (part * placed.panel.area))
        });
        let released: Vec<(Vec3, Vec3)> = released.collect();
        self.hand_over(&released, record);
        Ok(())
    }
}
