//! Tracers: points that the air advects, with the density and temperature that are seen.

use crate::math::elementary::exp;
use crate::{
    frame::{Stream, StreamKind},
    math::Vec3,
    par,
    sim::SetupError,
};

/// The stream of the tracers in a frame.
pub const TRACERS: &str = "smoke_tracers";

/// Tracers, one column a property.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Tracers {
    pub(super) id: Vec<u32>,
    /// Positions [m].
    pub(super) position: Vec<Vec3>,
    /// Amount of smoke, 1 where it was seeded full [–].
    pub(super) density: Vec<f32>,
    /// Temperature above that of the air [K].
    pub(super) temperature: Vec<f32>,
    /// Id of the next tracer.
    pub(super) next: u32,
}

/// Positions and values of tracers to be added.
#[derive(Clone, Debug, Default)]
pub(super) struct Seeds {
    pub(super) position: Vec<Vec3>,
    /// Density and temperature.
    pub(super) smoke: Vec<[f32; 2]>,
}

impl Seeds {
    /// Adds one at `x` [m] with `smoke`: density and temperature [K].
    pub(super) fn add(&mut self, x: Vec3, smoke: [f32; 2]) {
        self.position.push(x);
        self.smoke.push(smoke);
    }

    /// Keeps those whose positions `keep` accepts; returns how many were rejected.
    pub(super) fn retain(&mut self, keep: impl Fn(Vec3) -> bool) -> u32 {
        let before = self.position.len();
        let kept: Vec<bool> = self.position.iter().map(|&x| keep(x)).collect();
        let mut flags = kept.iter();
        self.smoke.retain(|_| *flags.next().expect("a flag each"));
        let mut flags = kept.iter();
        self.position.retain(|_| *flags.next().expect("a flag each"));
        (before - self.position.len()) as u32
    }
}

impl Tracers {
    /// How many there are.
    pub(super) fn len(&self) -> usize {
        self.position.len()
    }

    /// Whether there are none.
    pub(super) fn is_empty(&self) -> bool {
        self.position.is_empty()
    }

    /// Adds seeds as tracers with new ids.
    ///
    /// # Panics
    /// If there would be 2³² tracers or more.
    pub(super) fn add(&mut self, seeds: Seeds) {
        for (x, [density, temperature]) in seeds.position.into_iter().zip(seeds.smoke) {
            self.id.push(self.next);
            // After 2³² ids they begin again: the first tracers are long gone.
            self.next = self.next.wrapping_add(1);
            self.position.push(x);
            self.density.push(density);
            self.temperature.push(temperature);
        }
        assert!(u32::try_from(self.len()).is_ok(), "fewer than 2³² tracers");
    }

    /// Lets smoke thin out and cool down over `dt` [s] at rates [1/s]: exactly, so that no rate is too fast.
    pub(super) fn fade(&mut self, dissolve: Option<f32>, cooling: Option<f32>, dt: f64) {
        for (values, rate) in [(&mut self.density, dissolve), (&mut self.temperature, cooling)] {
            if let Some(rate) = rate {
                let left = exp(-f64::from(rate) * dt) as f32; // e^(−k dt)
                par::update(values, |_, value| *value *= left);
            }
        }
    }

    /// The columns of a frame; `spacing` is the distance at which smoke is full [m].
    pub(super) fn stream(&self, spacing: f32) -> Stream {
        let mut stream = Stream::new(TRACERS, StreamKind::Tracers, self.len())
            .with("position", self.position.clone())
            .with("density", self.density.clone())
            .with("temperature", self.temperature.clone())
            .with("id", self.id.clone());
        stream.scalars =
            vec![("spacing".into(), f64::from(spacing)), ("next_id".into(), f64::from(self.next))];
        stream
    }

    /// Reads tracers from a frame's stream.
    ///
    /// # Errors
    /// If it lacks a column.
    pub(super) fn restore(stream: &Stream) -> Result<Self, SetupError> {
        let missing = |what| SetupError::Missing { stream: TRACERS, what };
        Ok(Self {
            id: stream.u32("id").ok_or(missing("id"))?.to_vec(),
            position: stream.vec3("position").ok_or(missing("position"))?.to_vec(),
            density: stream.f32("density").ok_or(missing("density"))?.to_vec(),
            temperature: stream.f32("temperature").ok_or(missing("temperature"))?.to_vec(),
            next: stream.scalar("next_id").ok_or(missing("next_id"))? as u32,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fading_is_positive_and_independent_of_the_step() {
        let mut seeds = Seeds::default();
        seeds.add(Vec3::zeros(), [1.0, 300.0]);
        let (mut one, mut two) = (Tracers::default(), Tracers::default());
        one.add(seeds.clone());
        two.add(seeds);
        one.fade(Some(40.0), Some(3.0), 0.1);
        for _ in 0..10 {
            two.fade(Some(40.0), Some(3.0), 0.01);
        }
        assert!((one.density[0] - (-4.0_f32).exp()).abs() < 1e-7, "{}", one.density[0]);
        assert!(two.density[0] > 0.0 && (two.density[0] / one.density[0] - 1.0).abs() < 1e-5);
        assert!((two.temperature[0] / one.temperature[0] - 1.0).abs() < 1e-5);
        one.fade(Some(1e6), None, 1.0);
        assert!(one.density[0] == 0.0 && one.temperature[0] > 200.0);
    }
}
