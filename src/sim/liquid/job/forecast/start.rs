//! The shot's own start: its first frame with its products, and how busy it keeps the processors.

use crate::{
    cache,
    frame::FrameIndex,
    job::{RunError, scratch::Scratch, usage::Meter},
    par,
    preset::Frames,
    sim::{
        CancelToken, Simulation, Stop, Watch,
        forecast::{ForecastJob, ProductSample},
    },
};

/// Longest time for the start, and again for its products [s].
const SECONDS: f64 = 3.0;

/// The largest number of frames that are run.
const MAX_FRAMES: usize = 3;

/// The smallest number of substeps that is measured, after the first.
const MIN_SUBSTEPS: u32 = 3;

/// Shortest time that is measured [s]: the clock of processor time has ticks of 10 ms.
const MIN_SECONDS: f64 = 0.1;

/// What the shot's start took.
#[derive(Clone, Debug, Default)]
pub(super) struct Start {
    /// Processor time over wall-clock time, at most the number of threads; `None` if the system does not report it or the
    /// start was too short.
    pub(super) busy: Option<f64>,
    /// Processor time of writing the first frame [s].
    pub(super) writing: f64,
    /// Size of the first frame [bytes]: a seeding lattice, which is compressed better than later frames.
    pub(super) first_bytes: f64,
    /// The products of the first frame, if they were made.
    pub(super) products: Vec<ProductSample>,
}

/// Runs the shot's start, and makes the products of its first frame unless that would take too long, going by
/// `product_seconds` [s].
///
/// # Errors
/// If cancelled, if a file cannot be written, or if the shot diverges within its first substeps.
pub(super) fn run(
    job: &ForecastJob,
    mut simulation: Simulation,
    product_seconds: f64,
) -> Result<Start, RunError> {
    let scratch = Scratch::new()?;
    let shot = scratch.shot()?;
    let first = job.scene.frames.first();
    let meter = Meter::new();
    let first_bytes = cache::write_frame(&shot.cache(), &simulation.frame(first), 0)? as f64;
    let writing = meter.work();
    let products = match Frames::from_first_to_last(first, first).filter(|_| product_seconds < SECONDS) {
        Some(frames) => job.products.sample(job.scene, &shot, &frames, job.control)?,
        None => Vec::new(),
    };

    let mut stopwatch = Stopwatch { cancel: job.control.cancel.clone(), meter: Meter::new(), substeps: 0 };
    for number in 1..=job.simulated().min(MAX_FRAMES) {
        match simulation.advance(job.frame_seconds(), &mut stopwatch) {
            Ok(_) => {}
            Err(Stop::Interrupted) if job.control.cancel.is_cancelled() => return Err(RunError::Interrupted),
            Err(Stop::Interrupted) => break,
            Err(Stop::Diverged(diverged)) if number == 1 => {
                return Err(RunError::Diverged { frame: FrameIndex(first.0 + 1), diverged });
            }
            // Whether the shot comes so far is not measured here.
            Err(Stop::Diverged(_)) => break,
        }
    }
    let meter = stopwatch.meter;
    let (wall, threads) = (meter.wall(), par::threads() as f64);
    let busy = meter.cpu().filter(|_| wall >= MIN_SECONDS).map(|cpu| (cpu / wall).min(threads));
    Ok(Start { busy, writing, first_bytes, products })
}

/// Stops when enough is measured.
struct Stopwatch {
    cancel: CancelToken,
    meter: Meter,
    substeps: u32,
}

impl Watch for Stopwatch {
    fn token(&self) -> Option<&CancelToken> {
        Some(&self.cancel)
    }

    fn substep(&mut self, _done: f64) {
        // The first substep also allocates the memory of the others, so the clock starts after it.
        if self.substeps == 0 {
            self.meter = Meter::new();
        }
        self.substeps += 1;
        if self.substeps == MIN_SUBSTEPS + 1 {
            self.cancel = self.cancel.with_deadline(self.meter.after(SECONDS));
        }
    }
}
