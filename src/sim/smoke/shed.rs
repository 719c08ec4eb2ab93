//! Shedding: vorticity released from the layer in which air slips along solids.
//!
//! *Method*: air that moves along a surface with the relative slip velocity s is a vortex sheet of strength γ = n × s a square
//! metre ([koumoutsakos95], after Lighthill). In a step the part 1 − e^(−Δt|s|/δ) of it, which the slip advects through a layer of
//! thickness δ, is released in the layer's middle. The same part of vortons' cores that is inside the solid is absorbed: on a panel
//! it counts as slip. Released vorticity reduces the slip, so shedding ends by itself. The total vorticity does not change
//! ([`closed`]). A solid that turns has vorticity 2Ω itself (`air.rs`) and sheds the opposite when it begins to.
//!
//! Symbols: δ → `layer` [m], γ → `sheet` [m/s], s → `slip` [m/s], Ω → `spin` [1/s].
//! *Departs from the paper*: a part is released and not all; the solid counts as a half-space for cores that reach inside; air that
//! sticks is not stretched along the wall (`air.rs`).
//! Limits: of solids thinner than a core more is absorbed than is inside. Vortons in a layer do not turn with the solid. The layer
//! is as thick as the vortons' spacing requires, not as viscosity does.

use super::{
    Instant, SmokeRecord, System,
    body::Placed,
    walls::{Spun, Turning, Walls},
};
use crate::math::elementary::exp_m1;
use crate::{
    math::Vec3,
    par,
    sim::vortex::{OutOfRange, Vortons, fraction_beyond_plane},
    space::CellGrid,
};
use nalgebra::Matrix3;

/// Distance from surfaces that vortons and tracers are kept at, in spacings.
const GAP: f32 = 0.05;

/// Height above a solid, in cores, from which a core does not reach into it: with the default kernel 0.2 % of it would, with
/// Rosenhead and Moore's 2.6 %. Larger, and more of the wake is searched for nothing.
const REACH: f32 = 3.0;

/// Largest condition number of the panels' Σ A n × (Ω × r), which for a closed surface is 2V Ω, at which it is inverted: that of an
/// even surface is 3. On needles thinner than half a spacing it reaches 64; little would be cancelled by large sheets of opposite
/// signs.
const MAX_CONDITION: f32 = 10.0;

impl System {
    /// Projects vortons and tracers out of solids at `then` [s].
    pub(super) fn project_out(&mut self, then: f64, record: &mut SmokeRecord) {
        if let Some(walls) = &self.air.walls {
            let gap = GAP * self.params.spacing;
            record.returned_vortons += walls.project_out(&mut self.flow.vortons.position, gap, then);
            record.returned_tracers += walls.project_out(&mut self.tracers.position, gap, then);
        }
    }

    /// Projects tracers out of solids at `time` [s]; returns how many were inside.
    pub(super) fn project_tracers_out(&self, tracers: &mut [Vec3], time: f64) -> u64 {
        let gap = GAP * self.params.spacing;
        self.air.walls.as_ref().map_or(0, |walls| walls.project_out(tracers, gap, time))
    }

    /// Releases the slip along solids in a step from `now` to `then` [s], with their poses at its end.
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
            // A change of the angular velocity is shed below. Of the solid's own vorticity half is blurred away at the panel.
            let solid = velocity - (spin - before).cross(arm);
            let slip = air + before.cross(arm) * 0.5 - solid;
            slip - panel.normal * panel.normal.dot(&slip)
        };
        let slips: Vec<Vec3> = panels().zip(air).map(slip).collect();
        let strength = self.params.shedding.as_ref().map_or(0.0, |shedding| shedding.strength);
        let dt = (then - now) as f32;
        let part = |slip: &Vec3| strength * -exp_m1(-dt * slip.norm() / layer);
        let parts: Vec<f32> = slips.iter().map(part).collect();
        let of =
            solids.iter().enumerate().flat_map(|(number, solid)| solid.panels.iter().map(move |_| number));
        let widest = panels().map(|(_, placed)| placed.panel.width).fold(walls.widest(), f32::max);
        let shedding = ShedPanels { at: &at, of: of.collect(), parts: &parts, widest };
        let gained = gained(walls, &solids, now, 0.5 * layer);
        let absorbed = self.absorb(&shedding, then);

        let mut released = Vec::with_capacity(at.len());
        let mut first = 0;
        for (solid, gained) in solids.iter().zip(gained) {
            let own = first..first + solid.panels.len();
            let slips = slips[own.clone()].iter().zip(&parts[own.clone()]).map(|(slip, part)| slip * *part);
            let replaced = absorbed[own].iter().sum::<Vec3>() - gained;
            released.extend(closed(solid, slips, replaced, 0.5 * layer));
            first += solid.panels.len();
        }
        released.retain(|(_, strength)| *strength != Vec3::zeros());
        self.add_strengths(&released, record);
        Ok(())
    }

    /// Absorbs what of the vortons' cores is inside solids at `then` [s], in the part that the nearest panel releases; returns the absorbed
    /// strength by panel [m³/s].
    fn absorb(&mut self, shedding: &ShedPanels<'_>, then: f64) -> Vec<Vec3> {
        let ShedPanels { at, of, parts, widest } = shedding;
        let mut absorbed = vec![Vec3::zeros(); at.len()];
        let Some(walls) = &self.air.walls else { return absorbed };
        let kernel = self.params.flow.kernel;
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

/// Panels of the solids that shed.
struct ShedPanels<'a> {
    /// Positions [m].
    at: &'a [Vec3],
    /// Index of each panel's solid.
    of: Vec<usize>,
    /// Part of the slip that each panel releases.
    parts: &'a [f32],
    /// Width of the widest [m].
    widest: f32,
}

/// Increase of each solid's own vorticity since `now` [s] by its change of shape or size, at the angular velocity of then [m³/s].
fn gained(walls: &Walls, solids: &[Turning], now: f64, height: f32) -> Vec<Vec3> {
    let is_changed = |solid: &Turning| solid.before != Vec3::zeros() && walls.is_deforming(solid.body);
    if !solids.iter().any(is_changed) {
        return vec![Vec3::zeros(); solids.len()];
    }
    let earlier = walls.turning(now, Spun::at(now), height);
    let own = |solid: &Turning| own_vorticity(&solid.panels, solid.before);
    let gain = |solid: &Turning| {
        let was = earlier.iter().find(|earlier| earlier.body == solid.body).map_or(Vec3::zeros(), own);
        if is_changed(solid) { own(solid) - was } else { Vec3::zeros() }
    };
    solids.iter().map(gain).collect()
}

/// Vorticity of a solid that turns with `omega` [1/s], over its surface [m³/s].
fn own_vorticity(panels: &[Placed], omega: Vec3) -> Vec3 {
    panels.iter().map(|placed| sheet((placed, omega.cross(&placed.arm)))).sum()
}

/// The vortex sheet of a slip on a panel [m³/s].
fn sheet((placed, slip): (&Placed, Vec3)) -> Vec3 {
    placed.panel.normal.cross(&slip) * placed.panel.area // n × s, [koumoutsakos95]
}

/// What a solid releases of the `slips` [m/s] on its panels, `height` [m] above them. The total vorticity does not change: what is
/// shed, less what it `replaced` [m³/s] (what was absorbed less what the solid [`gained`]), and the change of the solid's own vorticity by its
/// spin sum to zero. If the mirror cuts through the solid, only their component along its normal does, as images cancel the rest.
fn closed(
    solid: &Turning,
    slips: impl Iterator<Item = Vec3>,
    replaced: Vec3,
    height: f32,
) -> Vec<(Vec3, Vec3)> {
    let Turning { panels, cut, before, spin, .. } = solid;
    let turn = |omega: Vec3| panels.iter().map(move |placed| (placed, omega.cross(&placed.arm))).map(sheet);
    let shed: Vec<Vec3> = panels.iter().zip(slips).map(sheet).collect();
    let excess = shed.iter().sum::<Vec3>() - replaced;
    let excess = cut.map_or(excess, |n| n * n.dot(&excess));
    // Σ A n × (Ω × r) = 2V Ω of a closed surface; of a cut one, or where panels are as wide as the solid, the excess is distributed by area.
    let twice = Matrix3::from_columns(&[0, 1, 2].map(|axis| own_vorticity(panels, Vec3::ith(axis, 1.0))));
    let inverse =
        twice.try_inverse().filter(|inverse| cut.is_none() && twice.norm() * inverse.norm() < MAX_CONDITION);
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
    fn released_and_absorbed_and_own_vorticity_sum_to_zero() {
        // A box without a panel on one face, which is not symmetric; and a needle, whose panels are all on one side.
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
            let mut solid = Turning { body: 0, panels, cut: None, before, spin };
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
            // Mirror images across z cancel what is not along z: only that component has a zero sum.
            solid.cut = Some(Vec3::z());
            let left = sum(&solid) - absorbed + turned;
            assert!(left.z.abs() < 1e-5 && left.norm() > 0.1, "{left}");
        }
    }
}
