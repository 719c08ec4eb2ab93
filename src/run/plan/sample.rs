//! The shot's start at its own spacing: its first frame, its first surface, and how busy it keeps the machine.

use super::pilot;
use crate::{
    cache,
    export::MeshFormat,
    frame::FrameIndex,
    par,
    run::{Control, RunError, scratch::Scratch, usage::Meter},
    scene::Scene,
    sim::{Simulation, Stop, Watch},
};

/// Substeps measured at least, beside the first.
const FEWEST: u32 = 3;

/// Shorter than this [s], and steps of 10 ms do not tell how busy the processors were.
const TELLING: f64 = 0.1;

/// What the start took.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// Processor time over wall-clock time, at most the number of threads; `None` where the system does not tell, or the
    /// start was too short to see.
    pub(super) busy: Option<f64>,
    /// Work of writing the first frame [s].
    pub(super) writing: f64,
    /// Bytes of the first frame: a lattice, which packs better than what follows.
    pub(super) first_bytes: u64,
    /// The first frame's surface, if it was made.
    pub(super) surface: Option<pilot::PilotSurface>,
}

/// Runs the shot's start for about `seconds` [s], and makes the first surface unless that would take longer than
/// as much again, going by `guess` [s].
///
/// # Errors
/// If interrupted, if nothing can be written, or if the shot diverges within its first substeps.
pub(super) fn run(
    scene: &Scene,
    mut simulation: Simulation,
    formats: &[MeshFormat],
    seconds: f64,
    guess: f64,
    control: Control,
) -> Result<Sample, RunError> {
    let scratch = Scratch::new()?;
    let first = scene.frames.first();
    let frame = simulation.frame(first);
    let meter = Meter::new();
    let first_bytes = cache::write_frame(scratch.path(), &frame, 0)?;
    let writing = meter.work();
    let spacing = scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing);
    let surface = match frame.streams.first().filter(|_| !formats.is_empty() && guess < seconds) {
        Some(stream) => Some(pilot::surface(scene, stream, spacing, formats, &scratch, control)?),
        None => None,
    };
    drop(frame);

    // Frame after frame, until time is up.
    let mut stopwatch = Stopwatch { control, until: seconds, meter: Meter::new(), substeps: 0 };
    for index in first.0 + 1..=first.0 + 3 {
        match simulation.advance(1.0 / f64::from(scene.fps), &mut stopwatch) {
            Ok(_) => {}
            Err(Stop::Interrupted) if (control.interrupted)() => return Err(RunError::Interrupted),
            Err(Stop::Interrupted) => break,
            Err(Stop::Diverged(diverged)) => {
                return Err(RunError::Diverged { frame: FrameIndex(index), diverged });
            }
        }
    }
    let meter = stopwatch.meter;
    let (wall, most) = (meter.wall(), par::threads() as f64);
    let busy = meter.cpu().filter(|_| wall >= TELLING).map(|cpu| (cpu / wall).min(most));
    Ok(Sample { busy, writing, first_bytes, surface })
}

/// Stops when there is enough to see.
struct Stopwatch<'a> {
    control: Control<'a>,
    until: f64,
    meter: Meter,
    substeps: u32,
}

impl Watch for Stopwatch<'_> {
    fn keep_going(&mut self) -> bool {
        let enough = self.substeps > FEWEST && self.meter.wall() > self.until;
        !enough && !(self.control.interrupted)()
    }

    fn substep(&mut self, _done: f64) {
        // The first substep also takes the memory that the others work in, so the clock starts after it.
        if self.substeps == 0 {
            self.meter = Meter::new();
        }
        self.substeps += 1;
    }
}
