//! What pushes the air: the weight of smoke, and smoke that is blown out.

use super::{
    Buoyancy, Instant, SmokeRecord, System,
    emit::Emitted,
    kick::{self, Lattice},
    tracers::Tracers,
    walls::Spun,
};
use crate::{
    math::Vec3,
    sim::vortex::{OutOfRange, Vortons},
};

/// The least T/T₀ that counts: tracers colder than the air's absolute zero have no weight that could be told.
const COLDEST: f32 = 0.01;

/// The most heat over the air's that counts, so that sums of single precision that overflow mean something; its logarithm is 69.
const HOTTEST: f32 = 1e30;

impl System {
    /// Whether anything pushes the air.
    pub(super) fn pushes(&self) -> bool {
        self.heavy().is_some() || self.params.emitter.iter().any(|emitter| emitter.velocity.is_some())
    }

    /// How weight acts, if it does.
    fn heavy(&self) -> Option<&Buoyancy> {
        self.params.buoyancy.as_ref().filter(|_| self.gravity != Vec3::zeros())
    }

    /// Turns what pushes the air over a step of `dt` that ends at `now` [s] into vorticity.
    pub(super) fn push(
        &mut self,
        emitted: &Emitted,
        now: f64,
        dt: f32,
        record: &mut SmokeRecord,
    ) -> Result<(), OutOfRange> {
        let volume = self.params.tracer_spacing().powi(3);
        let blown = emitted.blown.iter().zip(&emitted.seeds.position);
        let (at, blown): (Vec<Vec3>, Vec<Vec3>) = blown.filter_map(|(v, &x)| Some((x, (*v)?))).unzip();
        let there = if at.is_empty() {
            Vec::new()
        } else {
            let sources = self.air.sources(&self.flow.vortons, now, Spun::at(self.air.span[0]))?;
            self.air.velocity(Instant { vortons: &self.flow.vortons, sources: &sources }, &at)?
        };
        let lacks: Vec<Vec3> = blown.iter().zip(&there).map(|(v, u)| v - u).collect();

        let Tracers { position, density, temperature, .. } = &self.tracers;
        let weighed = if self.heavy().is_some() { &position[..] } else { &[] };
        let mut lattice = Lattice::around(&[weighed, &at], self.params.spacing);
        if let Some(buoyancy) = self.heavy() {
            let smoke = density.iter().zip(temperature).map(|(&d, &t)| Vec3::new(d, t, 0.0));
            lattice.deposit(weighed, &smoke.collect::<Vec<_>>(), volume);
            let g = self.gravity * dt;
            lattice.map(|smoke| g * log_density(buoyancy, smoke.x, smoke.y));
        }
        // What is filled several times over a step has the whole velocity and no more: 1 − e^(−fill) of what lacks.
        let mut fill = Lattice::around(&[&at], self.params.spacing);
        fill.deposit(&at, &vec![Vec3::x(); at.len()], volume);
        let taken = |(lack, &x): (&Vec3, &Vec3)| lack * part_of(fill.nearest(x).x);
        lattice.deposit(&at, &lacks.iter().zip(&at).map(taken).collect::<Vec<_>>(), volume);
        self.hand_over(&lattice.curl(), record);
        Ok(())
    }

    /// Gives strengths at points to the vortons there, or to new ones.
    pub(super) fn hand_over(&mut self, sources: &[(Vec3, Vec3)], record: &mut SmokeRecord) {
        let given = kick::give(sources, &self.flow.vortons.position, self.params.spacing);
        for (i, strength) in given.added {
            self.flow.vortons.strength[i as usize] += strength;
        }
        record.made += given.new.len() as u64;
        let (position, strength): (Vec<Vec3>, Vec<Vec3>) = given.new.into_iter().unzip();
        let core = vec![self.params.core(); position.len()];
        self.add(Vortons { position, strength, core });
    }
}

/// (1 − e^(−f))/f: which part of each of f fillings shows.
fn part_of(fill: f32) -> f32 {
    if fill < 1e-3 { 1.0 } else { -(-fill).exp_m1() / fill }
}

/// ln(ρ/ρ₀) of air with smoke of a density [–] and a temperature above the air's [K].
fn log_density(buoyancy: &Buoyancy, density: f32, temperature: f32) -> f32 {
    let heat = (temperature / buoyancy.ambient).clamp(COLDEST - 1.0, HOTTEST);
    (buoyancy.weight * density).ln_1p() - heat.ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn air_that_is_filled_over_and_over_takes_the_velocity_once() {
        for (fill, whole) in [(1e-4, 1e-4), (1.0, 0.632_12), (8.0, 0.999_66), (1e6, 1.0)] {
            assert!((fill * part_of(fill) - whole).abs() < 1e-4, "{fill}");
        }
    }

    #[test]
    fn hot_air_is_light_smoke_heavy_and_nothing_is_infinite() {
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
