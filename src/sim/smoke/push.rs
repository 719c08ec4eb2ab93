//! Impulses that act on the air: the weight of smoke, and smoke emitted with a velocity.

use super::{
    Buoyancy, Instant, SmokeRecord, System,
    emit::Emitted,
    kick::{self, Grid},
    tracers::Tracers,
    walls::Spun,
};
use crate::math::elementary::{exp_m1, ln_1p};
use crate::{
    math::Vec3,
    sim::vortex::{OutOfRange, Vortons},
};

/// Smallest T/T₀: tracers below absolute zero would have no density.
const MIN_RELATIVE_TEMPERATURE: f32 = 0.01;

/// Largest heat over the air's temperature: sums in single precision may overflow; its logarithm is 69.
const MAX_RELATIVE_HEAT: f32 = 1e30;

impl System {
    /// Whether anything acts on the air.
    pub(super) fn pushes(&self) -> bool {
        self.buoyancy().is_some() || self.params.emitter.iter().any(|emitter| emitter.velocity.is_some())
    }

    /// Parameters of buoyancy, if there is gravity.
    fn buoyancy(&self) -> Option<&Buoyancy> {
        self.params.buoyancy.as_ref().filter(|_| self.gravity != Vec3::zeros())
    }

    /// Turns what acts on the air over a step of `dt` that ends at `now` [s] into vorticity.
    pub(super) fn push(
        &mut self,
        emitted: &Emitted,
        now: f64,
        dt: f32,
        record: &mut SmokeRecord,
    ) -> Result<(), OutOfRange> {
        let volume = self.params.tracer_spacing().powi(3);
        let velocity = emitted.velocity.iter().zip(&emitted.seeds.position);
        let (at, velocity): (Vec<Vec3>, Vec<Vec3>) = velocity.filter_map(|(v, &x)| Some((x, (*v)?))).unzip();
        let present = if at.is_empty() {
            Vec::new()
        } else {
            let sources = self.air.sources(&self.flow.vortons, now, Spun::at(self.air.span[0]))?;
            self.air.velocity(Instant { vortons: &self.flow.vortons, sources: &sources }, &at)?
        };
        let missing: Vec<Vec3> = velocity.iter().zip(&present).map(|(v, u)| v - u).collect();

        let Tracers { position, density, temperature, .. } = &self.tracers;
        let weighed = if self.buoyancy().is_some() { &position[..] } else { &[] };
        let mut grid = Grid::around(&[weighed, &at], self.params.spacing);
        if let Some(buoyancy) = self.buoyancy() {
            let smoke = density.iter().zip(temperature).map(|(&d, &t)| Vec3::new(d, t, 0.0));
            grid.deposit(weighed, &smoke.collect::<Vec<_>>(), volume);
            let g = self.gravity * dt;
            grid.map(|smoke| g * log_density(buoyancy, smoke.x, smoke.y));
        }
        // A cell filled several times in a step gets the whole velocity once: 1 − e^(−fill) of what the air lacks.
        let mut fill = Grid::around(&[&at], self.params.spacing);
        fill.deposit(&at, &vec![Vec3::x(); at.len()], volume);
        let taken = |(missing, &x): (&Vec3, &Vec3)| missing * fill_weight(fill.nearest(x).x);
        grid.deposit(&at, &missing.iter().zip(&at).map(taken).collect::<Vec<_>>(), volume);
        self.add_strengths(&grid.curl(), record);
        Ok(())
    }

    /// Adds strengths at points to the vortons there, or makes new ones.
    pub(super) fn add_strengths(&mut self, sources: &[(Vec3, Vec3)], record: &mut SmokeRecord) {
        let assigned = kick::assign(sources, &self.flow.vortons.position, self.params.spacing);
        for (i, strength) in assigned.added {
            self.flow.vortons.strength[i as usize] += strength;
        }
        record.made += assigned.new.len() as u64;
        let (position, strength): (Vec<Vec3>, Vec<Vec3>) = assigned.new.into_iter().unzip();
        let core = vec![self.params.core(); position.len()];
        self.add(Vortons { position, strength, core });
    }
}

/// (1 − e^(−f))/f: the weight of each of f fillings.
fn fill_weight(fill: f32) -> f32 {
    if fill < 1e-3 { 1.0 } else { -exp_m1(-fill) / fill }
}

/// ln(ρ/ρ₀) of air with smoke of a density [–] and a temperature above the air's [K].
fn log_density(buoyancy: &Buoyancy, density: f32, temperature: f32) -> f32 {
    let heat = (temperature / buoyancy.ambient).clamp(MIN_RELATIVE_TEMPERATURE - 1.0, MAX_RELATIVE_HEAT);
    ln_1p(buoyancy.weight * density) - ln_1p(heat)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_filled_repeatedly_gets_the_velocity_once() {
        for (fill, whole) in [(1e-4, 1e-4), (1.0, 0.632_12), (8.0, 0.999_66), (1e6, 1.0)] {
            assert!((fill * fill_weight(fill) - whole).abs() < 1e-4, "{fill}");
        }
    }

    #[test]
    fn hot_air_is_light_and_smoke_heavy_and_log_densities_are_finite() {
        let buoyancy = Buoyancy { ambient: 300.0, weight: 0.5 };
        assert!((log_density(&buoyancy, 0.0, 300.0) - 0.5_f32.ln()).abs() < 1e-6);
        assert!((log_density(&buoyancy, 2.0, 0.0) - 2.0_f32.ln()).abs() < 1e-6);
        assert_eq!(log_density(&buoyancy, 0.0, 0.0), 0.0);
        for temperature in [-1e30, -300.0, -299.0, 1e30, 3e38] {
            let log = log_density(&buoyancy, 0.0, temperature);
            assert!(log.is_finite() && log.abs() < 90.0, "{temperature}: {log}");
        }
    }
}
