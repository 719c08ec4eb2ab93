//! The systems of a shot, advanced together.

use super::{
    FrameRecord, SeedReport, Stop, Watch,
    coupling::{self, Blown, Bound, Coupling, CouplingRecord, Outside, Resolved, There, Together, Wind},
    liquid::{self, Liquid, LiquidParams},
    record::{Clock, Seconds},
    setup::{SetupError, World},
    sheet::{self, SheetRecord, Sheets},
    smoke::{self, Smoke},
    substep::advance_frame,
};
use crate::frame::{Frame, FrameIndex};

/// What is simulated; `None` = absent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Systems {
    /// The liquid.
    pub liquid: Option<LiquidParams>,
    /// The smoke.
    pub smoke: Option<Smoke>,
    /// The sheets.
    pub sheets: Option<sheet::Shot>,
    /// Which of them feel each other.
    pub couplings: Vec<Coupling>,
}

impl From<Option<LiquidParams>> for Systems {
    fn from(liquid: Option<LiquidParams>) -> Self {
        Self { liquid, ..Self::default() }
    }
}

/// The systems of a shot and their state at one instant.
#[derive(Debug)]
pub struct Simulation {
    liquid: Option<Liquid>,
    smoke: Option<smoke::System>,
    sheets: Option<Sheets>,
    /// The liquid with sheets.
    wet: Option<Bound>,
    /// Sheets in the smoke.
    blown: Option<Blown>,
    time: f64,
}

impl Simulation {
    /// Seeds every system that is present.
    ///
    /// # Errors
    /// If there is no system, or the sources of one hold no particle or too many.
    pub fn new(world: World, systems: impl Into<Systems>) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets, couplings } = present(systems.into())?;
        let density = liquid.as_ref().map(|liquid| [liquid.spacing, liquid.density]);
        let liquid = liquid.map(|params| Liquid::seed(params, &world)).transpose()?;
        let smoke = smoke.map(|smoke| smoke::System::seed(smoke, &world)).transpose()?;
        let sheets = sheets.map(|sheets| Sheets::new(sheets, &world)).transpose()?;
        Self { liquid, smoke, sheets, wet: None, blown: None, time: 0.0 }.coupled(&couplings, density)
    }

    /// Takes the state from a frame that [`Simulation::frame`] gave. What follows has the same bits as in the
    /// run that gave it.
    ///
    /// # Errors
    /// If there is no system, or the frame lacks its state.
    pub fn restore(world: World, systems: impl Into<Systems>, frame: &Frame) -> Result<Self, SetupError> {
        let Systems { liquid, smoke, sheets, couplings } = present(systems.into())?;
        let density = liquid.as_ref().map(|liquid| [liquid.spacing, liquid.density]);
        let liquid = liquid.map(|params| {
            let missing = SetupError::Missing { stream: liquid::NAME, what: "particles" };
            let stream = frame.stream(liquid::NAME).ok_or(missing)?;
            Liquid::restore(params, &world, stream, frame.time)
        });
        let smoke = smoke.map(|smoke| smoke::System::restore(smoke, &world, &frame.streams));
        let sheets = sheets.map(|sheets| Sheets::restore(sheets, &world, &frame.streams, frame.time));
        let (liquid, smoke, sheets) = (liquid.transpose()?, smoke.transpose()?, sheets.transpose()?);
        Self { liquid, smoke, sheets, wet: None, blown: None, time: frame.time }.coupled(&couplings, density)
    }

    /// With couplings, of a liquid of this spacing and density.
    fn coupled(mut self, couplings: &[Coupling], density: Option<[f32; 2]>) -> Result<Self, SetupError> {
        let names = self.sheets.as_ref().map(Sheets::names).unwrap_or_default();
        let there = There { liquid: self.liquid.is_some(), smoke: self.smoke.is_some(), sheets: names };
        let Resolved { liquid, smoke } = coupling::resolve(couplings, &there)?;
        if let (Some([spacing, density]), Some(sheets), false) = (density, &self.sheets, liquid.is_empty()) {
            self.wet = Some(Bound::new(sheets, &liquid, spacing, density));
        }
        if let (Some(sheets), false) = (&self.sheets, smoke.is_empty()) {
            self.blown = Some(Blown::new(sheets, &smoke));
        }
        Ok(self)
    }

    /// What seeding did.
    pub fn seeded(&self) -> SeedReport {
        let smoke = self.smoke.as_ref().map(smoke::System::seeded);
        let points = self.sheets.as_ref().map_or(0, |sheets| sheets.len() as u32);
        let crossings = self.sheets.as_ref().map_or(0, Sheets::crossings);
        SeedReport {
            smoke,
            points,
            crossings,
            ..self.liquid.as_ref().map(Liquid::seeded).unwrap_or_default()
        }
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
        let systems = [self.liquid.is_some(), self.smoke.is_some(), self.sheets.is_some()];
        let share = 1.0 / systems.into_iter().filter(|&is_there| is_there).count() as f64;
        let span = [self.time, frame_seconds];
        let mut from = 0.0;
        let mut part = |share: f64| {
            from += share;
            (from - share, share)
        };

        // Smoke feels nothing of the others, and goes ahead: they may ask for its air.
        let mut airs = self.blown.as_ref().map(|_| Vec::new());
        let mut smoky = None;
        if let Some(smoke) = &mut self.smoke {
            let (from, share) = part(share);
            let mut part = Part { watch: &mut *watch, from, share };
            smoky = Some(smoke.advance(self.time, frame_seconds, airs.as_mut(), &mut part)?);
        }
        let mut wind = self.blown.as_ref().zip(airs).map(|(blown, airs)| Wind::new(blown, airs));
        let outside = wind.as_mut().map(|wind| wind as &mut dyn Outside);

        // The liquid and the sheets, together if they are coupled.
        let (mut record, mut dry) = (FrameRecord::default(), None);
        match (&mut self.liquid, &mut self.sheets, &self.wet) {
            (Some(liquid), Some(sheets), Some(bound)) => {
                let (from, share) = part(2.0 * share);
                record = wet(liquid, sheets, bound, outside, span, &mut Part { watch, from, share })?;
            }
            (liquid, sheets, _) => {
                if let Some(liquid) = liquid {
                    let (from, share) = part(share);
                    let mut part = Part { watch: &mut *watch, from, share };
                    record = liquid.advance(self.time, frame_seconds, &mut part)?;
                }
                if let Some(sheets) = sheets {
                    let (from, share) = part(share);
                    let mut part = Part { watch, from, share };
                    dry = Some(match outside {
                        Some(outside) => blown(sheets, outside, span, &mut part)?,
                        None => sheets.advance(self.time, frame_seconds, &mut part)?,
                    });
                }
            }
        }

        // The account, in order of the passes.
        if let Some((told, seconds)) = smoky {
            record.smoke = Some(told);
            record.seconds.extend(seconds);
        }
        if let Some((told, seconds)) = dry {
            record.sheets = Some(told);
            record.seconds.extend(seconds);
        }
        if let Some(wind) = wind {
            record.coupling.get_or_insert_default().smoke = Some(wind.told);
        }
        self.time += frame_seconds;
        Ok(record)
    }

    /// The passes that run, in order: only what the preset names.
    pub fn passes(&self) -> Vec<&'static str> {
        let liquid = self.liquid.as_ref().map(Liquid::passes).unwrap_or_default();
        let smoke = self.smoke.as_ref().map(smoke::System::passes).unwrap_or_default();
        let sheets = self.sheets.as_ref().map(Sheets::passes).unwrap_or_default();
        let between = between(self.wet.is_some(), self.blown.is_some());
        liquid.into_iter().chain(smoke).chain(sheets).chain(between).collect()
    }
}

/// The passes of couplings between sheets and what is around them.
fn between(wet: bool, blown: bool) -> Vec<&'static str> {
    let wet = if wet { &coupling::PASSES[..] } else { &[] };
    blown.then_some(coupling::AIR).into_iter().chain(wet.iter().copied()).collect()
}

/// A frame of a liquid and sheets that share their substeps: the start and the length [s].
fn wet<'a>(
    liquid: &mut Liquid,
    sheets: &'a mut Sheets,
    bound: &'a Bound,
    outside: Option<&'a mut (dyn Outside + 'a)>,
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
) -> Result<FrameRecord, Stop> {
    let passes = [liquid.passes(), sheets.passes(), between(true, outside.is_some())].concat();
    let mut clock = Clock::new(&passes);
    let mut both = Together::new(bound, sheets, outside);
    let mut record = liquid.advance_with(Some(&mut both), [start, seconds], &mut clock, watch)?;
    let Together { sheets, record: mut told, told: coupled, .. } = both;
    clock.time("sheet_account", || sheets.end_frame(start + seconds, &mut told));
    record.sheets = Some(told);
    record.coupling = Some(CouplingRecord { liquid: Some(coupled), smoke: None });
    record.seconds = clock.into_totals();
    Ok(record)
}

/// A frame of sheets on which something acts from outside.
fn blown(
    sheets: &mut Sheets,
    outside: &mut dyn Outside,
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
) -> Result<(SheetRecord, Seconds), Stop> {
    let mut clock = Clock::new(&[sheets.passes(), between(false, true)].concat());
    let mut record = sheets.begin_frame();
    advance_frame([start, seconds], watch, |progress, _| {
        let (now, left) = (progress.now(), progress.left);
        let dt = left / f64::from(sheets.substeps_left(now, left, seconds, record.substeps)?);
        outside.act(sheets, now, dt, &mut clock)?;
        sheets.advance_substep(now, dt, &mut clock, &mut record)?;
        Ok(dt)
    })?;
    clock.time("sheet_account", || sheets.end_frame(start + seconds, &mut record));
    Ok((record, clock.into_totals()))
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
