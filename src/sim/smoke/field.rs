//! The air of a cached frame, without simulating.

use super::{
    NAME, Smoke,
    air::{Air, Instant},
    state,
    walls::Sources,
};
use crate::{
    frame::Stream,
    math::Vec3,
    sim::{
        SetupError, World,
        vortex::{Unfit, Vortons},
    },
};

/// The air of a frame: its velocity anywhere.
#[derive(Debug)]
pub struct FrameAir {
    vortons: Vortons,
    sources: Sources,
    air: Air,
}

impl FrameAir {
    /// The air of a frame with these streams at `time` [s].
    ///
    /// # Errors
    /// If there is no stream of vortons, or it lacks a column.
    pub fn of(smoke: &Smoke, world: &World, streams: &[Stream], time: f64) -> Result<Self, SetupError> {
        let missing = SetupError::Missing { stream: NAME, what: "particles" };
        let stream = streams.iter().find(|stream| stream.name == NAME).ok_or(missing)?;
        Self::new(smoke, world, state::vortons_of(stream)?, time)
    }

    /// The air of `vortons` at `time` [s].
    ///
    /// # Errors
    /// If a vorton is outside what can be computed.
    pub fn new(smoke: &Smoke, world: &World, vortons: Vortons, time: f64) -> Result<Self, SetupError> {
        let air = Air::new(&smoke.params, world);
        let sources = air.sources(&vortons, time)?;
        Ok(Self { vortons, sources, air })
    }

    /// The velocity at points [m/s].
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub fn velocity(&self, points: &[Vec3]) -> Result<Vec<Vec3>, Unfit> {
        self.air.velocity(Instant { vortons: &self.vortons, sources: &self.sources }, points)
    }
}
