//! The systems of a shot, advanced together.

use super::{
    FrameRecord, SeedReport, Stop, Watch,
    liquid::{self, Liquid, LiquidParams},
    sheet::{self, SheetError, Sheets},
    smoke::{self, Smoke},
    vortex::Unfit,
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

/// What is simulated; `None` = absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Systems {
    /// The liquid.
    pub liquid: Option<LiquidParams>,
    /// The smoke.
    pub smoke: Option<Smoke>,
    /// The sheets.
    pub sheets: Option<sheet::Shot>,
}

impl From<Option<LiquidParams>> for Systems {
    fn from(liquid: Option<LiquidParams>) -> Self {
        Self { liquid, ..Self::default() }
    }
}

/// Why a simulation cannot start.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
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
    /// There is neither a vorton nor a tracer, and nothing that would give off any.
    #[error(
        "no smoke: rings, tubes, turbulence and sources are empty or inside solids, and there is no emitter; enlarge one or \
         lower smoke.spacing"
    )]
    NoSmoke,
    /// Rings, sources and emitters ask for more vortons and tracers than can be counted.
    #[error(
        "the smoke would have about {asked:.1e} tracers and vortons, more than 2³¹; raise smoke.spacing or smoke.tracers, or \
         make the meshes smaller"
    )]
    TooMuchSmoke {
        /// Vortons and tracers at the end of the shot.
        asked: f64,
    },
    /// Vortons at the start are outside what can be computed.
    #[error("the smoke cannot start: {0}; check the rings, tubes and the turbulence")]
    Unfit(#[from] Unfit),
    /// The sheets cannot be what the preset says.
    #[error(transparent)]
    Sheets(#[from] SheetError),
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
    smoke: Option<smoke::System>,
    sheets: Option<Sheets>,
    time: f64,
}

impl Simulation {
    /// Seeds every system that is present.
    ///
    /// # Errors
    /// If there is no system, or the sources of one hold no particle or too many.
    pub fn new(world: World, systems: impl Into<Systems>) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets } = present(systems.into())?;
        Ok(Self {
            liquid: liquid.map(|params| Liquid::seed(params, &world)).transpose()?,
            smoke: smoke.map(|smoke| smoke::System::seed(smoke, &world)).transpose()?,
            sheets: sheets.map(|sheets| Sheets::new(sheets, &world)).transpose()?,
            time: 0.0,
        })
    }

    /// Takes the state from a frame that [`Simulation::frame`] gave. What follows has the same bits as in the
    /// run that gave it.
    ///
    /// # Errors
    /// If there is no system, or the frame lacks its state.
    pub fn restore(world: World, systems: impl Into<Systems>, frame: &Frame) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets } = present(systems.into())?;
        let liquid = liquid.map(|params| {
            let missing = SetupError::Missing { stream: liquid::NAME, what: "particles" };
            let stream = frame.stream(liquid::NAME).ok_or(missing)?;
            Liquid::restore(params, &world, stream, frame.time)
        });
        let smoke = smoke.map(|smoke| smoke::System::restore(smoke, &world, &frame.streams));
        let sheets = sheets.map(|sheets| Sheets::restore(sheets, &world, &frame.streams, frame.time));
        Ok(Self {
            liquid: liquid.transpose()?,
            smoke: smoke.transpose()?,
            sheets: sheets.transpose()?,
            time: frame.time,
        })
    }

    /// What seeding did.
    pub fn seeded(&self) -> SeedReport {
        let smoke = self.smoke.as_ref().map(smoke::System::seeded);
        let points = self.sheets.as_ref().map_or(0, |sheets| sheets.len() as u32);
        SeedReport { smoke, points, ..self.liquid.as_ref().map(Liquid::seeded).unwrap_or_default() }
    }

    /// The solids of the world, by number, that are too small for the smoke's spacing to keep air out.
    pub fn sourceless(&self) -> Vec<usize> {
        self.smoke.as_ref().map_or_else(Vec::new, smoke::System::sourceless)
    }

    /// The state as a frame, in memory order: stream "liquid" with `position` [m], `velocity` [m/s], `id` and the channels that the
    /// preset names; streams "smoke" with the vortons' `position` [m], `strength` [m³/s], `core` [m], `volume` [m³] and `id`, and
    /// "smoke_tracers" with `position` [m], `density`, `temperature` [K] and `id`; of every sheet a stream "sheet.NAME" with `position`
    /// [m] and `velocity` [m/s], and "sheet.NAME.faces" with the corners `a`, `b`, `c`, `d` of its faces.
    pub fn frame(&self, index: FrameIndex) -> Frame {
        let liquid = self.liquid.iter().map(|liquid| liquid.stream(self.time));
        let smoke = self.smoke.iter().flat_map(smoke::System::streams);
        let sheets = self.sheets.iter().flat_map(Sheets::streams);
        Frame { index, time: self.time, streams: liquid.chain(smoke).chain(sheets).collect() }
    }

    /// Advances by `frame_seconds` [s] (> 0) and tells what happened.
    ///
    /// # Errors
    /// [`Stop`]; the state is then somewhere inside the frame and good only to look at.
    pub fn advance(&mut self, frame_seconds: f64, watch: &mut dyn Watch) -> Result<FrameRecord, Stop> {
        let mut record = FrameRecord::default();
        let systems = [self.liquid.is_some(), self.smoke.is_some(), self.sheets.is_some()];
        let share = 1.0 / systems.into_iter().filter(|&is_there| is_there).count() as f64;
        let mut from = 0.0;
        if let Some(liquid) = &mut self.liquid {
            let mut part = Part { watch: &mut *watch, from, share };
            record = liquid.advance(self.time, frame_seconds, &mut part)?;
            from += share;
        }
        if let Some(smoke) = &mut self.smoke {
            let mut part = Part { watch: &mut *watch, from, share };
            let (told, seconds) = smoke.advance(self.time, frame_seconds, &mut part)?;
            record.smoke = Some(told);
            record.seconds.extend(seconds);
            from += share;
        }
        if let Some(sheets) = &mut self.sheets {
            let mut part = Part { watch, from, share };
            let (told, seconds) = sheets.advance(self.time, frame_seconds, &mut part)?;
            record.sheets = Some(told);
            record.seconds.extend(seconds);
        }
        self.time += frame_seconds;
        Ok(record)
    }

    /// The passes that run, in order: only what the preset names.
    pub fn passes(&self) -> Vec<&'static str> {
        let liquid = self.liquid.as_ref().map(Liquid::passes).unwrap_or_default();
        let smoke = self.smoke.as_ref().map(smoke::System::passes).unwrap_or_default();
        let sheets = self.sheets.as_ref().map(Sheets::passes).unwrap_or_default();
        liquid.into_iter().chain(smoke).chain(sheets).collect()
    }
}

/// The systems, if there is one.
fn present(systems: Systems) -> Result<Systems, SetupError> {
    if systems == Systems::default() { Err(SetupError::NoSystem) } else { Ok(systems) }
}

/// One system's part of a frame.
struct Part<'a> {
    watch: &'a mut dyn Watch,
    from: f64,
    share: f64,
}

impl Watch for Part<'_> {
    fn keep_going(&mut self) -> bool {
        self.watch.keep_going()
    }

    fn substep(&mut self, done: f64) {
        self.watch.substep(self.from + self.share * done);
    }
}
