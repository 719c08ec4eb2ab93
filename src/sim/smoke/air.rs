//! What moves the air beside the vortons: the wind.

use super::params::SmokeParams;
use crate::{
    math::Vec3,
    par,
    sim::vortex::{
        Unfit,
        flow::{Flow, Moment, Outside, Rates},
    },
};

/// What moves the air beside the vortons.
#[derive(Debug)]
pub(super) struct Air {
    wind: Vec3,
    /// The longest step in which the wind carries nothing past a vorton [s].
    longest: f64,
}

impl Air {
    pub(super) fn new(params: &SmokeParams) -> Self {
        let wind = params.wind.map_or(Vec3::zeros(), Vec3::from);
        Self { wind, longest: f64::from(params.core()) / f64::from(wind.norm()) }
    }

    /// The velocity at points, with what the vortons of `flow` induce [m/s].
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub(super) fn velocity(&self, flow: &Flow, points: &[Vec3]) -> Result<Vec<Vec3>, Unfit> {
        let mut velocity = flow.velocity_at(points)?;
        self.blow(&mut velocity);
        Ok(velocity)
    }

    fn blow(&self, velocity: &mut [Vec3]) {
        let wind = self.wind;
        if wind != Vec3::zeros() {
            par::update(velocity, |_, v| *v += wind);
        }
    }
}

impl Outside for Air {
    fn act(&mut self, _: Moment<'_>, rates: &mut Rates) -> Result<(), Unfit> {
        self.blow(&mut rates.velocity);
        self.blow(&mut rates.passengers);
        Ok(())
    }

    fn longest(&self) -> f64 {
        self.longest
    }
}
