//! What solids give to the air: vorticity from the layer that slips along them.
//!
//! *Method*: air that moves along a surface with the slip s, relative to it, is a vortex sheet of strength γ = n × s a square metre
//! ([koumoutsakos95], after Lighthill). The part 1 − e^(−Δt|s|/δ) of it, as much as the slip carries through a layer of thickness δ
//! in a step, is released in the layer's middle, and the same part of what of vortons' cores is inside the solid is taken from
//! them: on a panel they count as slip. What was released takes from the slip that is left, so it ends by itself. No vorticity arises on the whole
//! ([`closed`]). A solid that turns has vorticity 2Ω itself (`air.rs`) and sheds the opposite when it begins to.
//!
//! Symbols: δ → `layer` [m], γ → `sheet` [m/s], s → `slip` [m/s], Ω → `spin` [1/s].
//! Limits: the layer is as thick as the vortons allow, not as the air's viscosity has it.

use super::{Instant, SmokeRecord, System, walls::Placed};
use crate::{
    math::Vec3,
    par,
    sim::vortex::{Unfit, Vortons, beyond},
    space::CellGrid,
};
use nalgebra::Matrix3;

/// Vortons and tracers are kept this far from surfaces, in spacings.
const GAP: f32 = 0.05;

/// Cores this many of their sizes above a solid do not reach into it.
const REACH: f32 = 3.0;

impl System {
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

    /// Releases what slips along solids in a step from `now` to `then` [s], where they are at its end.
    pub(super) fn shed(&mut self, now: f64, then: f64, record: &mut SmokeRecord) -> Result<(), Unfit> {
        let (Some(walls), Some(layer)) = (&self.air.walls, self.air.layer) else { return Ok(()) };
        let solids = walls.turning(then, [now, then]);
        let panels = || solids.iter().flat_map(|(panels, _)| panels);
        let spins = solids.iter().flat_map(|(panels, [_, spin])| panels.iter().map(move |_| spin));
        let at: Vec<Vec3> = panels().map(|placed| placed.panel.x).collect();
        let sources = self.air.sources(&self.flow.vortons, then)?;
        let air = self.air.velocity(Instant { vortons: &self.flow.vortons, sources: &sources }, &at)?;
        let slip = |((placed, spin), air): ((&Placed, &Vec3), Vec3)| {
            let Placed { panel, velocity, arm } = placed;
            // Half of what the solid's own vorticity does is blurred into it.
            let slip = air + spin.cross(arm) * 0.5 - velocity;
            slip - panel.normal * panel.normal.dot(&slip)
        };
        let slips: Vec<Vec3> = panels().zip(spins).zip(air).map(slip).collect();
        let strength = self.params.shedding.as_ref().map_or(0.0, |shedding| shedding.strength);
        let dt = (then - now) as f32;
        let part = |slip: &Vec3| strength * -(-dt * slip.norm() / layer).exp_m1();
        let parts: Vec<f32> = slips.iter().map(part).collect();
        let absorbed = self.absorb(&at, &parts, then);

        let mut released = Vec::with_capacity(at.len());
        let mut first = 0;
        for (panels, [before, spin]) in &solids {
            let own = first..first + panels.len();
            let slips = slips[own.clone()].iter().zip(&parts[own.clone()]).map(|(slip, part)| slip * *part);
            // Before the shot nothing turned.
            let spun = if now == 0.0 { *spin } else { spin - before };
            released.extend(closed(panels, slips, absorbed[own].iter().sum(), spun, 0.5 * layer));
            first += panels.len();
        }
        released.retain(|(_, strength)| *strength != Vec3::zeros());
        self.hand_over(&released, record);
        Ok(())
    }

    /// Takes from vortons what of their cores is inside solids at `then` [s], in the `parts` that are released of the slip at the
    /// panels `at` [m] beside them; returns how much, by panel [m³/s].
    fn absorb(&mut self, at: &[Vec3], parts: &[f32], then: f64) -> Vec<Vec3> {
        let mut absorbed = vec![Vec3::zeros(); at.len()];
        let Some(walls) = &self.air.walls else { return absorbed };
        let (kernel, widest) = (self.params.flow.kernel, walls.widest());
        let Vortons { position, strength, core } = &mut self.flow.vortons;
        let reach = REACH * core.iter().copied().fold(0.0, f32::max) + widest;
        let heights = walls.heights(position, reach, then);
        let cells = CellGrid::new(at, reach);
        let taken = par::map(position.len(), |i| {
            if heights[i] >= REACH * core[i] {
                return None;
            }
            let mut nearest: Option<(f32, usize)> = None;
            cells.for_each_within(at, position[i], reach, |j, r2| {
                if nearest.is_none_or(|nearest| (r2, j) < nearest) {
                    nearest = Some((r2, j));
                }
            });
            nearest.map(|(_, j)| (j, parts[j] * beyond(kernel, heights[i].max(0.0) / core[i])))
        });
        for (strength, (j, part)) in
            strength.iter_mut().zip(taken).filter_map(|(strength, taken)| Some((strength, taken?)))
        {
            absorbed[j] += *strength * part;
            *strength *= 1.0 - part;
        }
        absorbed
    }
}

/// What a solid releases of the `slips` [m/s] on its panels, `height` [m] above them. No vorticity arises on the whole: what it sheds,
/// less what it `absorbed` [m³/s], and what it holds by turning faster by `spun` [1/s] have the sum zero.
fn closed(
    panels: &[Placed],
    slips: impl Iterator<Item = Vec3>,
    absorbed: Vec3,
    spun: Vec3,
    height: f32,
) -> Vec<(Vec3, Vec3)> {
    let sheet = |(placed, slip): (&Placed, Vec3)| placed.panel.normal.cross(&slip) * placed.panel.area; // n × s, [koumoutsakos95]
    let turn = |omega: Vec3| panels.iter().map(move |placed| (placed, omega.cross(&placed.arm))).map(sheet);
    let shed: Vec<Vec3> = panels.iter().zip(slips).map(sheet).collect();
    // Σ A n × (Ω × r) = 2V Ω.
    let twice = Matrix3::from_columns(&[0, 1, 2].map(|axis| turn(Vec3::ith(axis, 1.0)).sum::<Vec3>()));
    let excess = shed.iter().sum::<Vec3>() - absorbed;
    let excess = twice.try_inverse().map_or(Vec3::zeros(), |inverse| inverse * excess);
    let released = shed.iter().zip(turn(excess + spun)).map(|(shed, turn)| shed - turn);
    panels.iter().map(|placed| placed.panel.x + placed.panel.normal * height).zip(released).collect()
}
