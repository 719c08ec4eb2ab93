//! The air of a cached frame, without simulating.

use super::{
    NAME, Smoke,
    air::{Air, Instant},
    sources::Sources,
    state,
    walls::Spun,
};
use crate::{
    frame::Stream,
    math::Vec3,
    sim::{
        SetupError, World,
        vortex::{OutOfRange, Vortons},
    },
};

/// Wind and solids of a shot, from which the air of every frame is made.
#[derive(Clone, Debug)]
pub(crate) struct ShotAir {
    air: Air,
}

/// Air of a frame: its velocity at any point.
#[derive(Debug)]
pub struct FrameAir {
    vortons: Vortons,
    sources: Sources,
    air: Air,
    /// Time since the shot's start [s].
    time: f64,
}

impl ShotAir {
    /// The air of a shot with this `smoke` in its `world`.
    pub(crate) fn new(smoke: &Smoke, world: &World) -> Self {
        Self { air: Air::new(&smoke.params, world) }
    }

    pub(super) fn of(air: &Air) -> Self {
        Self { air: air.clone() }
    }

    /// The air of a frame with these streams at `time` [s].
    ///
    /// # Errors
    /// If there is no stream of vortons, it lacks a column, or a vorton is outside what can be computed.
    pub(crate) fn frame(&self, streams: &[Stream], time: f64) -> Result<FrameAir, SetupError> {
        self.around(state::vortons_of(state::find(streams, NAME)?)?, time, Spun::at(time))
    }

    /// The air of `vortons` at `time` [s], which contain the opposite of the angular velocity `spun`.
    ///
    /// # Errors
    /// If a vorton is outside what can be computed.
    pub(super) fn around(&self, vortons: Vortons, time: f64, spun: Spun) -> Result<FrameAir, SetupError> {
        vortons.check()?;
        Ok(self.air.around(vortons, time, spun)?)
    }

    /// The longest step between two times [s] in which no solid passes over smoke [s].
    pub(super) fn max_step_for_solids(&self, span: [f64; 2]) -> f64 {
        self.air.max_step_for_solids(span)
    }
}

impl Air {
    /// The air of `vortons` at `time` [s], which contain the opposite of the angular velocity `spun`.
    ///
    /// # Errors
    /// If a vorton or a panel is outside what the sums can hold.
    pub(super) fn around(&self, vortons: Vortons, time: f64, spun: Spun) -> Result<FrameAir, OutOfRange> {
        let sources = self.sources(&vortons, time, spun)?;
        Ok(FrameAir { vortons, sources, air: self.clone(), time })
    }
}

impl FrameAir {
    /// The air of a frame with these streams at `time` [s].
    ///
    /// # Errors
    /// As `ShotAir::frame`.
    pub fn of(smoke: &Smoke, world: &World, streams: &[Stream], time: f64) -> Result<Self, SetupError> {
        ShotAir::new(smoke, world).frame(streams, time)
    }

    /// Time since the shot's start [s].
    pub fn time(&self) -> f64 {
        self.time
    }

    /// Velocity at points [m/s]: of the air, and inside a solid that of the solid.
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub fn velocity(&self, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        let instant = Instant { vortons: &self.vortons, sources: &self.sources };
        let mut velocity = self.air.velocity(instant, points)?;
        if let Some(walls) = &self.air.walls {
            walls.set_solid_velocity(points, &mut velocity, self.time);
        }
        Ok(velocity)
    }

    /// Vector potential at points [m²/s] of the vortons and their mirror images. Wind, and the flow around solids, have none.
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub fn vector_potential(&self, points: &[Vec3]) -> Result<Vec<Vec3>, OutOfRange> {
        let mut potential = vec![Vec3::zeros(); points.len()];
        for vortons in [&self.vortons, &self.sources.spin] {
            self.air.add_vector_potential(vortons, points, &mut potential)?;
        }
        Ok(potential)
    }
}
