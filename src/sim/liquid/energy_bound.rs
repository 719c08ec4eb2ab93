//! Energies of the liquid's state, and the upper bound of their sum.
//!
//! *Method*: see `energy.rs`. Symbols: the bound → [`Liquid::bound_energy`].

use super::{
    Liquid, LiquidRecord,
    energy::{energy, slack, take},
    surface_tension::Tension,
};
use crate::math::Vec3;

impl Liquid {
    /// Kinetic energy of the velocities [J].
    pub(super) fn kinetic_energy(&self) -> f64 {
        energy(&self.v, &self.x, Vec3::zeros(), self.mass)
    }

    /// Potential energy [J]; zero at the world's origin.
    pub(super) fn potential_energy(&self) -> f64 {
        energy(&[], &self.x, self.gravity, self.mass)
    }

    /// Surface energy where the substep evaluated the surface tension, before its corrections [J].
    pub(super) fn surface_energy(&self) -> f64 {
        self.tension.as_ref().map_or(0.0, Tension::energy)
    }

    /// Kinetic energy of the microrotation [J].
    pub(super) fn microrotation_energy(&self) -> f64 {
        self.microrotation.as_ref().map_or(0.0, |microrotation| microrotation.energy(self.mass))
    }

    /// Takes over the energy that the liquid of the same state may have with the settings before, and what the change of settings adds, as
    /// [`Self::restored_energy`] gives both: potential energy of another gravity, surface energy of another tension.
    pub(in crate::sim) fn take_over_energy(&mut self, [bound, energy]: [f64; 2]) {
        let change = self.restored_energy()[1] - energy;
        self.first_energy = bound + change;
    }

    /// The energy that the restored liquid may have, and that which it has [J].
    pub(in crate::sim) fn restored_energy(&mut self) -> [f64; 2] {
        if let Some(tension) = &mut self.tension {
            tension.move_to(self.walls.now());
        }
        [self.first_energy, self.state_energy()]
    }

    /// The sum of all energies that are bounded [J].
    pub(super) fn state_energy(&mut self) -> f64 {
        let surface = self.tension.as_mut().map_or(0.0, |tension| tension.energy_at(&self.x));
        self.kinetic_energy() + self.potential_energy() + surface + self.microrotation_energy()
    }

    /// Adds the work of moving solids in this substep to the energy that the liquid may have.
    pub(super) fn add_solid_work(&mut self, dt: f32, record: &mut LiquidRecord) {
        let work = self.mass * self.solver.work / f64::from(dt).powi(2);
        self.first_energy += work;
        record.solid_work += work;
    }

    /// Removes energy that the solver added.
    pub(super) fn bound_energy(&mut self, record: &mut LiquidRecord) {
        let limit = self.first_energy + slack(self.v.len(), self.mass, self.rest.spacing);
        let mechanical = energy(&self.v, &self.solver.p, self.gravity, self.mass);
        let excess = mechanical + self.surface_energy() + self.microrotation_energy() - limit;
        if excess > 0.0 {
            take(excess, &mut self.v, self.mass);
            record.clamps.energy += 1;
        }
    }
}
