//! Force fields in the liquid's substep, and their work.
//!
//! *Method*: forces act where gravity does, on the predicted velocities. The liquid's energy may rise by their work, which what pressure
//! balances does not add to. Particles in nozzles, whose motion is
//! prescribed, feel no force.

use super::{Liquid, force_field::ForceField};
use crate::{
    math::Vec3,
    sim::{clock::Clock, force::Forces},
};

impl Liquid {
    /// Sets the forces that act from now on.
    pub(in crate::sim) fn set_forces(&mut self, forces: Option<Forces>) {
        self.forces = forces.map(|forces| Box::new(ForceField::new(forces)));
    }

    /// Samples the forces at the particles at `now` [s].
    pub(super) fn sample_forces(&mut self, now: f64, clock: &mut Clock) {
        if let Some(forces) = &mut self.forces {
            clock.time("forces", || forces.sample(&self.x, now, self.gravity));
        }
    }

    /// Samples the forces at the particles that entered at `now` [s].
    pub(super) fn sample_entered(&mut self, now: f64, clock: &mut Clock) {
        if let Some(forces) = &mut self.forces {
            clock.time("forces", || forces.sample_entered(&self.x, now));
        }
    }

    /// Gravity and the forces that are the same everywhere [m/s²].
    pub(super) fn steady_acceleration(&self) -> Vec3 {
        self.forces.as_ref().map_or(self.gravity, |forces| self.gravity + forces.uniform())
    }

    /// Magnitude of gravity, or with forces the RMS of the acceleration of the particles [m/s²].
    pub(super) fn body_acceleration(&self) -> f32 {
        self.forces.as_ref().map_or_else(|| self.gravity.norm(), |forces| forces.magnitude())
    }

    /// Largest displacement in a substep by the CFL rule [m].
    pub(super) fn cfl_length(&self) -> f64 {
        f64::from(self.params.cfl) * f64::from(self.params.spacing)
    }

    /// Changes velocities by the forces over `dt` [s].
    pub(super) fn apply_forces(&mut self, dt: f32) {
        let longest = self.cfl_length() as f32;
        let Some(forces) = &mut self.forces else { return };
        forces.kick(&self.x, &mut self.v, self.gravity, [dt, longest]);
        for pin in &self.solver.pins {
            forces.change[pin.particle as usize] = Vec3::zeros();
        }
        forces.keep_velocities(&self.v);
    }

    /// Adds the work of the forces in a substep of `dt` [s] to the energy that the liquid may have.
    pub(super) fn add_force_work(&mut self, dt: f32) {
        if let Some(forces) = &mut self.forces {
            self.first_energy += forces.add_work(&self.x, &self.solver.p, self.mass, dt);
        }
    }
}
