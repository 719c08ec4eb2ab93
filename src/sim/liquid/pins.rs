//! Particles whose motion is prescribed: those in the nozzles of emitters.
//!
//! *Method*: a pinned particle counts in the densities of its neighbours, which therefore are pushed away from it, and is returned to its place
//! after each correction. Its own constraint is not solved: nothing could satisfy it where a nozzle lies at a wall, and its pressure
//! would grow with every iteration. The impulse that returns it does work, as that of a moving solid: impulse times velocity.

use super::{
    Constraint, Liquid, LiquidRecord,
    density::Multiplier,
    solve::{Pin, Solver},
};
use crate::math::Vec3;

/// Part of the constraint of a pinned particle that is not corrected: all that it can have.
const EXEMPT: f32 = 1e6;

impl Solver {
    /// Exempts pinned particles from the density solve, after sorting.
    pub(super) fn exempt_pins(&mut self, constraint: Constraint) {
        if self.pins.is_empty() || constraint == Constraint::Equality {
            return;
        }
        self.retained.resize(self.p.len(), 0.0);
        for pin in &self.pins {
            self.retained[pin.particle as usize] = EXEMPT;
        }
    }

    /// Keeps solids from acting on pinned particles, which may be in the opening of one.
    pub(super) fn free_pins_of_solids(&mut self) {
        for pin in &self.pins {
            self.clearance[pin.particle as usize] = f32::INFINITY;
        }
    }

    /// Takes the pressures of pinned particles away.
    pub(super) fn clear_pin_pressures(&mut self) {
        let Multiplier { lambda, applied, last, .. } = &mut self.multipliers.0;
        for pin in &self.pins {
            let i = pin.particle as usize;
            (lambda[i], applied[i], last[i]) = (0.0, 0.0, 0.0);
        }
    }

    /// Puts pinned particles back after a displacement by anything but a correction of the density.
    pub(super) fn restore_pins(&mut self) {
        for &Pin { particle, target } in &self.pins {
            let i = particle as usize;
            self.p[i] = target;
            if let Some(push) = self.wall_push.get_mut(i) {
                *push = Vec3::zeros();
            }
        }
    }

    /// Puts pinned particles back after a correction of the density and adds the work of that; `x` are the positions at the start of
    /// the substep.
    pub(super) fn restore_pins_with_work(&mut self, x: &[Vec3]) {
        for &Pin { particle, target } in &self.pins {
            let i = particle as usize;
            self.pin_work += f64::from((target - self.p[i]).dot(&(target - x[i])));
        }
        self.restore_pins();
    }

    /// Finds the pinned particles again after sorting; `nozzle` is zero for all others, and predicted positions are their targets.
    pub(super) fn renumber_pins(&mut self, nozzle: &[u32]) {
        let Self { pins, p, .. } = self;
        pins.clear();
        let pinned = (0_u32..).zip(nozzle).zip(p.iter()).filter(|((_, nozzle), _)| **nozzle != 0);
        pins.extend(pinned.map(|((particle, _), &target)| Pin { particle, target }));
    }
}

impl Liquid {
    /// Adds the work of the nozzles in this substep to the energy that the liquid may have.
    pub(super) fn add_nozzle_work(&mut self, dt: f32, record: &mut LiquidRecord) {
        let work = self.mass * self.solver.pin_work / f64::from(dt).powi(2);
        self.solver.pin_work = 0.0;
        self.first_energy += work;
        if let Some(flow) = &mut record.flow {
            flow.nozzle_work += work;
        }
    }

    /// Gives pinned particles the velocities of their nozzles after a substep of `dt` [s].
    pub(super) fn restore_pinned_velocities(&mut self, dt: f32) {
        for &Pin { particle, target } in &self.solver.pins {
            let i = particle as usize;
            self.v[i] = (target - self.x[i]) / dt;
        }
    }
}
