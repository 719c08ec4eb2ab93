//! Force fields in the substep of sheets, and their work.

use super::{
    SheetRecord, Sheets,
    force_field::{ForceField, Points},
    vectors::Vectors,
};
use crate::sim::force::Forces;

impl Sheets {
    /// Sets the forces that act from now on.
    pub(in crate::sim) fn set_forces(&mut self, forces: Option<Forces>) {
        self.forces = forces.map(|forces| Box::new(ForceField::new(forces)));
    }

    /// The longest substep from `now` [s] that resolves the forces, but none shorter than `shortest` [s].
    pub(super) fn longest_forced_substep(&self, now: f64, shortest: f64) -> f64 {
        let Some(forces) = &self.forces else { return f64::INFINITY };
        forces.longest_substep(&self.points(), now).max(shortest)
    }

    /// Adds the forces of the substep from `now` of `dt` [s].
    pub(super) fn add_field_forces(&mut self, now: f64, dt: f64) {
        let Some(mut forces) = self.forces.take() else { return };
        forces.evaluate(&self.points(), now, dt);
        let mass = self.mass.as_flattened();
        for (i, mean) in forces.mean.iter().enumerate() {
            self.force.add(i, mean * mass[i]);
        }
        self.forces = Some(forces);
    }

    /// Adds the work of the forces over a displacement from `before` to the record.
    pub(super) fn account_forces(&mut self, before: &Vectors, record: &mut SheetRecord) {
        let Self { forces, x, mass, inverse, .. } = self;
        if let Some(forces) = forces {
            let columns = [mass.as_flattened(), inverse.as_flattened()];
            forces.account([before, x], columns, record.forces.get_or_insert_default());
        }
    }

    fn points(&self) -> Points<'_> {
        Points { x: &self.x, v: &self.v, area: &self.area, gravity: self.gravity }
    }
}
