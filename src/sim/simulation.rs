//! The systems of a shot, advanced together.

use super::{
    FrameRecord, SeedReport, Stop, Watch,
    liquid::{self, Liquid, LiquidParams},
};
use crate::{
    frame::{Frame, FrameIndex},
    math::Vec3,
    solid::Solid,
};

/// What surrounds the systems.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Acceleration on everything [m/s²].
    pub gravity: Vec3,
    /// What keeps the systems out.
    pub solids: Vec<Solid>,
}

/// Why a simulation cannot start.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SetupError {
    /// The preset names no system.
    #[error("nothing to simulate: the preset names no system")]
    NoSystem,
    /// The sources hold no particle outside the solids.
    #[error(
        "no particles: the sources are smaller than the spacing, or inside solids; enlarge a source or lower liquid.spacing"
    )]
    NoParticles,
    /// The sources ask for more particles than can be counted.
    #[error("the sources ask for {asked:.1e} particles, more than 2³¹; raise liquid.spacing")]
    TooMany {
        /// Lattice points in all sources.
        asked: f64,
    },
    /// The frame to restore from lacks a part.
    #[error("the frame's stream '{stream}' has no '{what}'; simulate it again")]
    Missing {
        /// The stream's name.
        stream: &'static str,
        /// The channel or scalar, or "particles" if the stream itself is missing.
        what: &'static str,
    },
}

/// The systems of a shot and their state at one instant.
#[derive(Debug)]
pub struct Simulation {
    liquid: Option<Liquid>,
    time: f64,
}

impl Simulation {
    /// Seeds every system that is present; `None` = absent.
    ///
    /// # Errors
    /// If there is no system, or its sources hold no particle or too many.
    pub fn new(world: World, liquid: Option<LiquidParams>) -> Result<Self, SetupError> {
        let params = liquid.ok_or(SetupError::NoSystem)?;
        Ok(Self { liquid: Some(Liquid::seed(params, &world)?), time: 0.0 })
    }

    /// Takes the state from a frame that [`Simulation::frame`] gave. What follows has the same bits as in the
    /// run that gave it.
    ///
    /// # Errors
    /// If there is no system, or the frame lacks its state.
    pub fn restore(world: World, liquid: Option<LiquidParams>, frame: &Frame) -> Result<Self, SetupError> {
        let params = liquid.ok_or(SetupError::NoSystem)?;
        let missing = SetupError::Missing { stream: liquid::NAME, what: "particles" };
        let stream = frame.stream(liquid::NAME).ok_or(missing)?;
        Ok(Self { liquid: Some(Liquid::restore(params, &world, stream, frame.time)?), time: frame.time })
    }

    /// What seeding did.
    pub fn seeded(&self) -> SeedReport {
        self.liquid.as_ref().map(Liquid::seeded).unwrap_or_default()
    }

    /// The state as a frame: stream "liquid" with `position` [m], `velocity` [m/s], `id` and the channels that the preset
    /// names, in memory order.
    pub fn frame(&self, index: FrameIndex) -> Frame {
        Frame {
            index,
            time: self.time,
            streams: self.liquid.iter().map(|liquid| liquid.stream(self.time)).collect(),
        }
    }

    /// Advances by `frame_seconds` [s] (> 0) and tells what happened.
    ///
    /// # Errors
    /// [`Stop`]; the state is then somewhere inside the frame and good only to look at.
    pub fn advance(&mut self, frame_seconds: f64, watch: &mut dyn Watch) -> Result<FrameRecord, Stop> {
        let mut record = FrameRecord::default();
        if let Some(liquid) = &mut self.liquid {
            record = liquid.advance(self.time, frame_seconds, watch)?;
        }
        self.time += frame_seconds;
        Ok(record)
    }

    /// The passes that run, in order: only what the preset names.
    pub fn passes(&self) -> Vec<&'static str> {
        self.liquid.as_ref().map(Liquid::passes).unwrap_or_default()
    }
}
