//! Forecasts: what a system needs in a shot, measured by calibration runs before the shot starts.
//!
//! Each system has its own calibration ([`System::forecast`](super::system::System::forecast)) with the tools of this
//! file: a run of some frames, and samples of the products made of them.

use super::{FrameRecord, Simulation, Stop, scene::Scene};
use crate::{
    cache,
    frame::{Frame, FrameIndex, StreamKind},
    job::{Control, RunError, ShotFolder, Total, totals_by_key, usage::Meter},
    preset::Frames,
};
use serde::Serialize;
use std::time::{Duration, Instant};

/// The number of a kind of elements at a shot's start and end: particles, vortons, tracers, points.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct ElementCount {
    /// What is counted, in the plural.
    pub name: &'static str,
    /// The kind of the streams that they are in.
    #[serde(skip)]
    pub kind: StreamKind,
    /// At the start.
    pub start: f64,
    /// At the end, forecast.
    pub end: f64,
}

impl ElementCount {
    /// A number that does not change.
    pub(crate) fn constant(name: &'static str, kind: StreamKind, count: f64) -> Self {
        Self { name, kind, start: count, end: count }
    }

    /// The largest number over the shot.
    pub(crate) fn max(&self) -> f64 {
        self.start.max(self.end)
    }
}

/// Forecast of what a system needs in a shot.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct SystemForecast {
    /// The system's name, as in presets.
    pub name: &'static str,
    /// Its elements at the shot's start and end.
    pub counts: Vec<ElementCount>,
    /// Substeps of all frames.
    pub substeps: f64,
    /// Solver iterations of all frames; 0 if it does not iterate.
    pub iterations: f64,
    /// Size of its cached frames [bytes].
    pub cache: f64,
    /// Wall-clock time of simulating it [s].
    pub seconds: f64,
    /// Relative error that the time may have [–].
    pub uncertainty: f64,
    /// Products of the system's frames.
    #[serde(skip)]
    pub products: Vec<ProductForecast>,
    /// Sums and extremes over the frames of the calibration, as `info` has them of a shot.
    #[serde(rename = "calibration", serialize_with = "totals_by_key")]
    pub totals: Vec<Total>,
    /// Limits of the calibration, as messages.
    #[serde(skip)]
    pub remarks: Vec<String>,
}

/// Forecast of a product over all stored frames.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct ProductForecast {
    /// The product's name, which is also its folder's.
    pub name: &'static str,
    /// Size of its files [bytes].
    pub bytes: f64,
    /// Wall-clock time of making it [s].
    pub seconds: f64,
    /// Peak memory of the frame that needs most [bytes].
    pub memory: f64,
}

/// A product that was made of some frames to measure it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ProductSample {
    /// The product's name.
    pub(crate) name: &'static str,
    /// Processor time [s], see [`Meter::work`].
    pub(crate) work: f64,
    /// Wall-clock time [s].
    pub(crate) seconds: f64,
    /// Size of the files [bytes].
    pub(crate) bytes: f64,
    /// Peak memory of making the last of the frames, estimated [bytes].
    pub(crate) memory: f64,
    /// Why it was not made of some frame.
    pub(crate) failed: Option<String>,
}

/// Makes the products of a calibration's frames.
pub(crate) trait ProductSampler {
    /// Makes what `scene`, whose meshes are sampled, requests of `frames` in the cache of `shot`.
    ///
    /// # Errors
    /// If a frame cannot be read or a file cannot be written; if cancelled.
    fn sample(
        &self,
        scene: &Scene,
        shot: &ShotFolder,
        frames: &Frames,
        control: Control,
    ) -> Result<Vec<ProductSample>, RunError>;
}

/// Samples nothing: for jobs that only simulate.
pub(crate) struct NoProducts;

impl ProductSampler for NoProducts {
    fn sample(
        &self,
        _: &Scene,
        _: &ShotFolder,
        _: &Frames,
        _: Control,
    ) -> Result<Vec<ProductSample>, RunError> {
        Ok(Vec::new())
    }
}

/// Scene, frames and limits of a forecast.
#[derive(Clone, Copy)]
pub(crate) struct ForecastJob<'a> {
    /// The scene, whose meshes are sampled.
    pub(crate) scene: &'a Scene,
    /// The frames to store.
    pub(crate) selection: &'a Frames,
    /// Sampler of the job's products.
    pub(crate) products: &'a dyn ProductSampler,
    /// Memory that the shot may take [bytes].
    pub(crate) max_memory: Option<u64>,
    pub(crate) control: Control<'a>,
}

impl ForecastJob<'_> {
    /// The number of frames to simulate after the first.
    pub(crate) fn simulated(&self) -> usize {
        (self.selection.last().0 - self.scene.frames.first().0) as usize
    }

    /// The number of frames to store.
    pub(crate) fn stored(&self) -> usize {
        self.selection.count() as usize
    }

    /// Length of a frame [s].
    pub(crate) fn frame_seconds(&self) -> f64 {
        1.0 / f64::from(self.scene.fps)
    }
}

/// How long a calibration runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CalibrationLimits {
    /// Time after which it ends, also within a frame [s].
    pub(crate) seconds: f64,
    /// Frames that are completed whatever they take.
    pub(crate) min_frames: usize,
    /// Whether cached frames stay, for products of all of them.
    pub(crate) keeps_frames: bool,
}

/// A frame of a calibration.
pub(crate) struct CalibrationFrame<'a> {
    /// Its number after the first, which is 0.
    pub(crate) number: usize,
    /// The frame.
    pub(crate) frame: &'a Frame,
    /// Its record; empty for the first.
    pub(crate) record: FrameRecord,
    /// Its size in the cache [bytes].
    pub(crate) bytes: f64,
    /// Processor time of simulating it [s], see [`Meter::work`].
    pub(crate) work: f64,
    /// Wall-clock time of simulating it [s].
    pub(crate) seconds: f64,
}

impl CalibrationFrame<'_> {
    /// This frame as a selection.
    pub(crate) fn selection(&self) -> Frames {
        Frames::from_first_to_last(self.frame.index, self.frame.index).expect("a frame is not after itself")
    }
}

/// Why a calibration ended before its last frame: by time, or since the state diverged.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct EndedEarly {
    /// The frame in which it ended.
    pub(crate) frame: FrameIndex,
    /// Why, if it diverged.
    pub(crate) diverged: Option<String>,
}

/// Reports of products that could not be made of a calibration's frames, each once.
pub(crate) fn failures<'a>(samples: impl IntoIterator<Item = &'a ProductSample>) -> Vec<String> {
    let mut found: Vec<String> = Vec::new();
    for ProductSample { name, failed, .. } in samples {
        let Some(why) = failed else { continue };
        if !found.iter().any(|known| known.starts_with(&format!("{name}: "))) {
            found.push(format!(
                "{name}: not made of a frame of the calibration, so its forecast is too low: {why}"
            ));
        }
    }
    found
}

/// Runs a job's frames after the first in the cache of `shot`, and passes each to `on_frame`, the first included.
///
/// # Errors
/// If cancelled, if the first frame diverges, or whatever `on_frame` returns.
pub(crate) fn calibrate(
    job: &ForecastJob,
    simulation: &mut Simulation,
    shot: &ShotFolder,
    limits: CalibrationLimits,
    on_frame: &mut dyn FnMut(CalibrationFrame) -> Result<(), RunError>,
) -> Result<Option<EndedEarly>, RunError> {
    let first = job.scene.frames.first().0;
    let cancel = job.control.cancel;
    let limited = cancel.with_deadline(Instant::now() + Duration::from_secs_f64(limits.seconds));
    for number in 0..=job.simulated() {
        let index = FrameIndex(first + number as u32);
        let meter = Meter::new();
        let mut record = FrameRecord::default();
        if number > 0 {
            let mut watch = if number > limits.min_frames { limited.clone() } else { cancel.clone() };
            match simulation.advance(job.frame_seconds(), &mut watch) {
                Ok(found) => record = found,
                Err(Stop::Interrupted) if cancel.is_cancelled() => return Err(RunError::Interrupted),
                Err(Stop::Interrupted) => return Ok(Some(EndedEarly { frame: index, diverged: None })),
                Err(Stop::Diverged(diverged)) if number == 1 => {
                    return Err(RunError::Diverged { frame: index, diverged });
                }
                Err(Stop::Diverged(why)) => {
                    return Ok(Some(EndedEarly { frame: index, diverged: Some(why.to_string()) }));
                }
            }
        }
        let (work, seconds) = (meter.work(), meter.wall());
        let frame = &simulation.frame(index);
        let bytes = cache::write_frame(&shot.cache(), frame, 0)? as f64;
        on_frame(CalibrationFrame { number, frame, record, bytes, work, seconds })?;
        if !limits.keeps_frames {
            // It is measured. One that cannot be removed is removed with the folder.
            let _ = std::fs::remove_file(cache::frame_path(&shot.cache(), index));
        }
    }
    Ok(None)
}
