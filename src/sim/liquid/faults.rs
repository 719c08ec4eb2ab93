//! States that the liquid refuses, as errors that name the particle and what to try next.

use super::{Liquid, NAME, solve::OvercrowdedCell};
use crate::{math::Vec3, par, sim::Diverged, space::CellGrid};

/// Largest valid coordinate [m] or speed [m/s]; beyond it the state has diverged, since positions there resolve 8 m.
const MAX_MAGNITUDE: f32 = 1e8;

impl Liquid {
    /// Refuses a state with NaN or with values beyond [`MAX_MAGNITUDE`].
    pub(super) fn check_state(&self, substep: u32) -> Result<(), Diverged> {
        let spin = self.microrotation.as_ref().map_or(&[][..], |microrotation| &microrotation.spin);
        let columns =
            [(&*self.x, "position", "m"), (&*self.v, "velocity", "m/s"), (spin, "microrotation", "1/s")];
        let found =
            columns.into_iter().map(|(values, what, unit)| (invalid_value(values), what, unit)).find_map(
                |(found, what, unit)| found.map(|(i, value)| (i, format!("has a {what} of {value} {unit}"))),
            );
        match found {
            None => Ok(()),
            Some((i, what)) => Err(self.diverged(substep, i, what)),
        }
    }

    /// The error for an overcrowded cell; if a particle is beyond all bounds, the error names it instead.
    pub(super) fn overcrowded(
        &self,
        substep: u32,
        OvercrowdedCell { particle, count }: OvercrowdedCell,
    ) -> Diverged {
        if let Some((i, value)) = invalid_value(&self.solver.p) {
            return self.diverged(substep, i, format!("has a position of {value} m"));
        }
        let usual = CellGrid::particles_per_cell(self.solver.grid.cell(), self.rest.spacing);
        let what = format!(
            "has {} others within {:.1} spacings, where about {usual:.0} are expected",
            count - 1,
            self.solver.grid.cell() / self.rest.spacing * 3.0_f32.sqrt(),
        );
        let try_next =
            "a larger liquid.max_substeps, a larger liquid.spacing or more space between the colliders";
        Diverged { try_next, ..self.diverged(substep, particle, what) }
    }

    /// The error for a particle whose constraint is not finite.
    pub(super) fn undefined_constraint(&self, substep: u32) -> Diverged {
        let (ratio, lambda) = (&self.solver.ratio, &self.solver.multipliers.0.lambda);
        let first = |values: &[f32]| {
            let worst = par::max(values.len(), |i| if values[i].is_finite() { 0.0 } else { f32::NAN });
            worst.filter(|(_, worst)| worst.is_nan()).map(|(i, _)| i)
        };
        let (i, what) = match (first(ratio), first(lambda)) {
            (None, Some(i)) => (i, format!("has a pressure of {} m²", lambda[i])),
            (found, _) => {
                let i = found.unwrap_or(0);
                (i, format!("has a density of {} times rest", ratio[i]))
            }
        };
        self.diverged(substep, i, what)
    }

    fn diverged(&self, substep: u32, i: usize, what: String) -> Diverged {
        let try_next = if substep == 0 {
            "finite values near the origin as the start state"
        } else {
            "a smaller liquid.cfl, a larger liquid.max_substeps or a larger liquid.softening"
        };
        Diverged { system: NAME, substep, particle: self.id[i], what, try_next }
    }
}

/// The first NaN, or the largest value if it is beyond [`MAX_MAGNITUDE`].
fn invalid_value(values: &[Vec3]) -> Option<(usize, f32)> {
    let size = |v: Vec3| if v.iter().any(|c| c.is_nan()) { f32::NAN } else { v.amax() };
    par::max(values.len(), |i| size(values[i])).filter(|(_, value)| value.is_nan() || *value > MAX_MAGNITUDE)
}
