//! What the sheets of a shot will need.
//!
//! *Method*: the shot's own first frames are run, as many as time allows; sheets have as many points in every frame, so those after are
//! taken to cost what the later half of these did.
//! Limits: substeps that become shorter where a sheet meets fast solids late in the shot are not seen.

use super::{Control, RunError, deadline::Deadline, memory};
use crate::{
    cache,
    export::SheetFormat,
    frame::FrameIndex,
    run::{scratch::Scratch, simulate::world, usage::Meter},
    scene::{Frames, Scene},
    sim::{Simulation, Stop, Systems},
};
use serde::Serialize;

/// Longest time for the first frames [s].
const SECONDS: f64 = 10.0;

/// Bytes of a point in a PC2 cache.
const SAMPLE: f64 = 12.0;

/// Bytes of a point in a mesh, with its two triangles.
const MESHED: f64 = 62.0;

/// What sheets will need.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SheetsPlan {
    /// Points of all sheets.
    pub points: f64,
    /// Substeps of all frames.
    pub substeps: f64,
    /// Rounds of the conjugate gradients of all frames.
    pub iterations: f64,
    /// Peak memory [bytes].
    pub memory: u64,
    /// The cached frames [bytes].
    pub cache: f64,
    /// The point caches [bytes]; 0 if none are written.
    pub files: f64,
    /// Wall-clock time of simulating [s].
    pub seconds: f64,
    /// What should be known beside the figures.
    pub remarks: Vec<String>,
}

/// What was seen of a frame: substeps, rounds, seconds, bytes.
type Seen = [f64; 4];

/// Tells what the sheets of `scene`, whose meshes are filled, will need; `None` without any.
///
/// # Errors
/// If they cannot start, diverge in the first frame or the user stops.
pub(super) fn plan(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    control: Control,
) -> Result<Option<SheetsPlan>, RunError> {
    if scene.sheet.is_empty() {
        return Ok(None);
    }
    let frames = (selection.last().0 - scene.frames.first().0) as usize;
    let systems = Systems { sheets: scene.systems().sheets, ..Systems::default() };
    let mut simulation = Simulation::new(world(scene), systems)?;
    let points = f64::from(simulation.seeded().sheets.unwrap_or_default().points);
    let scratch = Scratch::new()?;
    let clock = Meter::new();
    let mut seen: Vec<Seen> = Vec::new();
    for number in 1..=frames {
        let index = FrameIndex(scene.frames.first().0 + number as u32);
        let meter = Meter::new();
        let mut watch = Deadline { control, clock, seconds: SECONDS };
        let record = match simulation.advance(1.0 / f64::from(scene.fps), &mut watch) {
            Ok(record) => record.sheets.unwrap_or_default(),
            Err(Stop::Interrupted) if (control.interrupted)() => return Err(RunError::Interrupted),
            Err(Stop::Interrupted) => break,
            Err(Stop::Diverged(diverged)) if seen.is_empty() => {
                return Err(RunError::Diverged { frame: index, diverged });
            }
            Err(Stop::Diverged(_)) => break,
        };
        let seconds = meter.wall();
        let bytes = cache::write_frame(scratch.path(), &simulation.frame(index), 0)? as f64;
        // Only its size was wanted.
        let _ = std::fs::remove_file(cache::frame_path(scratch.path(), index));
        seen.push([f64::from(record.substeps), f64::from(record.iterations), seconds, bytes]);
    }
    let mut remarks = Vec::new();
    if seen.is_empty() && frames > 0 {
        remarks.push("the first frame takes longer than the calibration waits; the time and disk of the sheets are not known".into());
    } else if seen.len() < frames {
        remarks.push(format!(
            "the calibration of the sheets saw {} of {frames} frames; those after are taken to be like them",
            seen.len()
        ));
    }
    let stored = selection.count() as f64;
    // Two sides of a body, and a mesh a frame where meshes are asked for.
    let sides = if scene.output.thickness.is_some() { 2.0 } else { 1.0 };
    let bytes_of = |format: &SheetFormat| if *format == SheetFormat::Pc2 { SAMPLE } else { MESHED };
    let written: f64 = scene.output.sheet.iter().filter(|_| with_outputs).map(bytes_of).sum();
    let [substeps, iterations, seconds, bytes] = [0, 1, 2, 3].map(|k| total(&seen, frames, k));
    Ok(Some(SheetsPlan {
        points,
        substeps,
        iterations,
        memory: memory::sheets(points as usize, terms(scene)),
        cache: bytes / frames.max(1) as f64 * stored,
        files: sides * written * points * stored,
        seconds,
        remarks,
    }))
}

/// Peak memory of simulating sheets [bytes], without building them; 0 without any.
pub(super) fn least(scene: &Scene) -> u64 {
    memory::sheets(scene.sheet.iter().map(|sheet| sheet.shape.points()).sum::<f64>() as usize, terms(scene))
}

/// Whether sheets resist bending, and whether they meet.
pub(super) fn terms(scene: &Scene) -> [bool; 2] {
    let meet = scene.sheets.as_ref().is_some_and(|common| common.contact.is_some());
    [scene.sheet.iter().any(|sheet| sheet.bending.is_some()), meet]
}

/// A quantity of all frames.
fn total(seen: &[Seen], frames: usize, k: usize) -> f64 {
    let own: f64 = seen.iter().map(|seen| seen[k]).sum();
    let late = &seen[seen.len() / 2..];
    let mean = late.iter().map(|seen| seen[k]).sum::<f64>() / late.len().max(1) as f64;
    own + mean * frames.saturating_sub(seen.len()) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_were_not_seen_are_like_the_later_half_of_the_others() {
        let seen = [[9.0, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [4.0, 0.0, 0.0, 0.0]];
        assert_eq!(total(&seen, 4, 0), 18.0);
        assert_eq!(total(&seen, 10, 0), 18.0 + 6.0 * 3.0);
        assert_eq!(total(&[], 10, 0), 0.0);
    }
}
