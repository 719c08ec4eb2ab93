//! What solids give to the air: vorticity from the layer that slips along them.
//!
//! *Method*: air that moves along a surface with the slip s, relative to it, is a vortex sheet of strength γ = n × s a square metre
//! ([koumoutsakos95], after Lighthill). The part 1 − e^(−Δt|s|/δ) of it, as much as the slip carries through a layer of thickness δ
//! in a step, is released in the layer's middle, and the same part of what of vortons' cores is inside the solid is taken from
//! them: on a panel they count as slip. What was released takes from the slip that is left, so it ends by itself. No vorticity arises on the whole
//! ([`closed`]). A solid that turns has vorticity 2Ω itself (`air.rs`) and sheds the opposite when it begins to.
//!
//! Symbols: δ → `layer` [m], γ → `sheet` [m/s], s → `slip` [m/s], Ω → `spin` [1/s].
//! *Departs from the paper*: a part is released and not all, cores that reach inside are taken for half-spaces deep, and air that sticks is not
//! stretched along the wall (`air.rs`).
//! Limits: of solids thinner than a core less is inside than is taken; what stands in a layer does not turn with its solid; the layer is as thick as the vortons allow, not as the air's viscosity has it.

use super::{
    Instant, SmokeRecord, System,
    walls::{Placed, Spun, Turning},
};
use crate::{
    math::Vec3,
    par,
    sim::vortex::{OutOfRange, Vortons, fraction_beyond_plane},
    space::CellGrid,
};
use nalgebra::Matrix3;

/// Vortons and tracers are kept this far from surfaces, in spacings.
const GAP: f32 = 0.05;

/// Cores this many of their sizes above a solid do not count as reaching into it: of the default kernel 0.2 % would, of Rosenhead and Moore's
/// 2.6 %. Larger, and more of the wake is looked at for nothing.
const REACH: f32 = 3.0;

/// How far the panels' Σ A n × (Ω × r) may be from 2V Ω to be undone: the norm of the matrix times that of its inverse, 3 of an even surface. On
/// needles thinner than half a spacing it goes to 64, and little would be undone by strong sheets of opposite signs.
const SKEW: f32 = 10.0;

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
    pub(super) fn shed(&mut self, now: f64, then: f64, record: &mut SmokeRecord) -> Result<(), OutOfRange> {
        let (Some(walls), Some(layer)) = (&self.air.walls, self.air.layer) else { return Ok(()) };
        let solids = walls.turning(then, Spun::at(now), 0.5 * layer);
        let panels =
            || solids.iter().flat_map(|solid| solid.panels.iter().map(move |placed| (solid, placed)));
        let at: Vec<Vec3> = panels().map(|(_, placed)| placed.panel.x).collect();
        let sources = self.air.sources(&self.flow.vortons, then, Spun::at(now))?;
        let air = self.air.velocity(Instant { vortons: &self.flow.vortons, sources: &sources }, &at)?;
        let slip = |((Turning { before, spin, .. }, placed), air): ((&Turning, &Placed), Vec3)| {
            let Placed { panel, velocity, arm } = placed;
            // What turns faster is shed below. Of the solid's own vorticity half of what it does is blurred away here.
            let solid = velocity - (spin - before).cross(arm);
            let slip = air + before.cross(arm) * 0.5 - solid;
            slip - panel.normal * panel.normal.dot(&slip)
        };
        let slips: Vec<Vec3> = panels().zip(air).map(slip).collect();
        let strength = self.params.shedding.as_ref().map_or(0.0, |shedding| shedding.strength);
        let dt = (then - now) as f32;
        let part = |slip: &Vec3| strength * -(-dt * slip.norm() / layer).exp_m1();
        let parts: Vec<f32> = slips.iter().map(part).collect();
        let of =
            solids.iter().enumerate().flat_map(|(number, solid)| solid.panels.iter().map(move |_| number));
        let beside = Beside { at: &at, of: of.collect(), parts: &parts };
        let absorbed = self.absorb(&beside, then);

        let mut released = Vec::with_capacity(at.len());
        let mut first = 0;
        for solid in &solids {
            let own = first..first + solid.panels.len();
            let slips = slips[own.clone()].iter().zip(&parts[own.clone()]).map(|(slip, part)| slip * *part);
            released.extend(closed(solid, slips, absorbed[own].iter().sum(), 0.5 * layer));
            first += solid.panels.len();
        }
        released.retain(|(_, strength)| *strength != Vec3::zeros());
        self.hand_over(&released, record);
        Ok(())
    }

    /// Takes from vortons what of their cores is inside solids at `then` [s], in the part that is released of the slip on the panel
    /// beside them; returns how much, by panel [m³/s].
    fn absorb(&mut self, beside: &Beside<'_>, then: f64) -> Vec<Vec3> {
        let Beside { at, of, parts } = beside;
        let mut absorbed = vec![Vec3::zeros(); at.len()];
        let Some(walls) = &self.air.walls else { return absorbed };
        let (kernel, widest) = (self.params.flow.kernel, walls.widest());
        let Vortons { position, strength, core } = &mut self.flow.vortons;
        let reach = REACH * core.iter().copied().fold(0.0, f32::max) + widest;
        let heights = walls.heights(position, reach, then);
        let cells = CellGrid::new(at, reach);
        let taken = par::map(position.len(), |i| {
            let (height, solid) = heights[i];
            if height >= REACH * core[i] {
                return None;
            }
            let nearest = cells.nearest_within(at, position[i], reach, |j| of[j] == solid);
            nearest.map(|j| (j, parts[j] * fraction_beyond_plane(kernel, height.max(0.0) / core[i])))
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

/// Panels beside vortons.
struct Beside<'a> {
    /// Where they are [m].
    at: &'a [Vec3],
    /// The number of the solid of each.
    of: Vec<usize>,
    /// Which part of the slip each releases.
    parts: &'a [f32],
}

/// What a solid releases of the `slips` [m/s] on its panels, `height` [m] above them. No vorticity arises on the whole: what it sheds,
/// less what it `absorbed` [m³/s], and what it holds by turning faster have the sum zero; along the mirror's normal if that cuts
/// through it, as the mirror reverses the rest.
fn closed(
    solid: &Turning,
    slips: impl Iterator<Item = Vec3>,
    absorbed: Vec3,
    height: f32,
) -> Vec<(Vec3, Vec3)> {
    let Turning { panels, cut, before, spin } = solid;
    let sheet = |(placed, slip): (&Placed, Vec3)| placed.panel.normal.cross(&slip) * placed.panel.area; // n × s, [koumoutsakos95]
    let turn = |omega: Vec3| panels.iter().map(move |placed| (placed, omega.cross(&placed.arm))).map(sheet);
    let shed: Vec<Vec3> = panels.iter().zip(slips).map(sheet).collect();
    let excess = shed.iter().sum::<Vec3>() - absorbed;
    let excess = cut.map_or(excess, |n| n * n.dot(&excess));
    // Σ A n × (Ω × r) = 2V Ω of a whole surface; of a cut one, or where panels are as wide as the solid, the excess is shared out by area.
    let twice = Matrix3::from_columns(&[0, 1, 2].map(|axis| turn(Vec3::ith(axis, 1.0)).sum::<Vec3>()));
    let inverse = twice.try_inverse().filter(|inverse| cut.is_none() && twice.norm() * inverse.norm() < SKEW);
    let by_turn = inverse.map_or(Vec3::zeros(), |inverse| inverse * excess);
    let area: f32 = panels.iter().map(|placed| placed.panel.area).sum();
    let by_area = if inverse.is_some() { Vec3::zeros() } else { excess / area };
    let left = shed.iter().zip(turn(by_turn + spin - before)).map(|(shed, turn)| shed - turn);
    let released = panels.iter().zip(left).map(|(placed, left)| {
        (placed.panel.x + placed.panel.normal * height, left - by_area * placed.panel.area)
    });
    released.collect()
}

#[cfg(test)]
mod tests {
    use super::super::panels::Panel;
    use super::*;

    #[test]
    fn what_is_released_and_absorbed_and_turns_has_no_sum() {
        // A box of which one face has no panel, so that nothing is even; and a needle, whose panels are all on one side.
        let cube: Vec<Vec3> = (0..5).map(|n| Vec3::ith(n % 3, if n < 3 { 1.0 } else { -1.0 })).collect();
        for (normals, skew) in [(cube, 0.1), (vec![Vec3::x()], 0.0)] {
            let placed = |(n, normal): (usize, &Vec3)| {
                let arm = normal * (0.5 + skew * n as f32) + Vec3::new(0.1, -0.2, 0.05) * skew;
                let panel =
                    Panel { x: arm, normal: *normal, area: 1.0 + skew * n as f32, width: 1.0, source: None };
                Placed { panel, velocity: Vec3::zeros(), arm }
            };
            let panels: Vec<Placed> = normals.iter().enumerate().map(placed).collect();
            let (before, spin, absorbed) = (Vec3::x(), Vec3::new(1.0, 2.0, -0.5), Vec3::new(0.3, 0.1, -0.2));
            let slips: Vec<Vec3> = (0..panels.len()).map(|n| Vec3::new(0.4, n as f32, -1.0)).collect();
            let mut solid = Turning { panels, cut: None, before, spin };
            let sum = |solid: &Turning| -> Vec3 {
                closed(solid, slips.iter().copied(), absorbed, 0.1).iter().map(|(_, strength)| strength).sum()
            };
            let turned: Vec3 = solid
                .panels
                .iter()
                .map(|placed| {
                    placed.panel.normal.cross(&(spin - before).cross(&placed.arm)) * placed.panel.area
                })
                .sum();
            let left = sum(&solid) - absorbed + turned;
            assert!(left.norm() < 1e-5, "{left}");
            // A mirror across z reverses what is not along z: only that has no sum.
            solid.cut = Some(Vec3::z());
            let left = sum(&solid) - absorbed + turned;
            assert!(left.z.abs() < 1e-5 && left.norm() > 0.1, "{left}");
        }
    }
}
