//! The air of a cached frame, without simulating.

use super::{NAME, Smoke, air::Air, state};
use crate::{
    frame::Stream,
    math::Vec3,
    sim::{
        SetupError, World,
        vortex::{Unfit, Vortons, flow::Flow},
    },
};

/// The air of a frame: its velocity anywhere.
#[derive(Debug)]
pub struct FrameAir {
    flow: Flow,
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
        let _ = (world, time);
        let volume = vec![smoke.params.spacing.powi(3); vortons.len()];
        let mut flow = Flow::new(smoke.params.flow.clone());
        flow.add(&vortons, &volume);
        Ok(Self { flow, air: Air::new(&smoke.params) })
    }

    /// The velocity at points [m/s].
    ///
    /// # Errors
    /// If a vorton or a point is outside what the sums can hold.
    pub fn velocity(&self, points: &[Vec3]) -> Result<Vec<Vec3>, Unfit> {
        self.air.velocity(&self.flow, points)
    }
}
