//! What the smoke of a shot will need.
//!
//! *Method*: the shot's own first frames are run, as many as time allows. Where these are not all, a pilot with everything
//! [`COARSER`] times as far apart runs on; over the later half of the frames that both have it tells how many times more of everything there
//! is, and how much longer a frame takes. The shot is its own frames, and the pilot's later ones times that.
//! Limits: what only fine smoke does after its own frames, more swirls and shorter steps, is not seen; the time of a shot that ends
//! in turbulence is told too short.

use super::{Control, RunError, deadline::Deadline, memory};
use crate::{
    cache,
    frame::{Frame, FrameIndex},
    product::{
        surface::bricks_around,
        volume::{VolumeSettings, tracer_volume_memory, try_tracers},
    },
    run::{scratch::Scratch, simulate::world, usage::Meter},
    scene::{Frames, Scene},
    sim::{Simulation, Stop, Systems, smoke},
};
use serde::Serialize;

/// The pilot's spacing over the shot's: an eighth of everything.
const COARSER: f32 = 2.0;

/// Longest time for the pilot, and for the shot's own first frames [s].
const PILOT_SECONDS: f64 = 10.0;
const OWN_SECONDS: f64 = 10.0;

/// What smoke will need.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SmokePlan {
    /// Vortons at the start, and at the end.
    pub vortons: [f64; 2],
    /// Tracers at the start, and at the end.
    pub tracers: [f64; 2],
    /// Steps of all frames.
    pub substeps: f64,
    /// Peak memory of simulating, and of making volumes [bytes].
    pub memory: [u64; 2],
    /// The cached frames [bytes].
    pub cache: f64,
    /// The volumes [bytes]; 0 if none are made.
    pub volumes: f64,
    /// Wall-clock time of simulating, and of making volumes [s].
    pub seconds: [f64; 2],
    /// What should be known beside the figures.
    pub remarks: Vec<String>,
}

/// What was seen of a frame.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    vortons: f64,
    tracers: f64,
    substeps: f64,
    seconds: f64,
    bytes: f64,
    /// Of a volume of it: bytes, seconds, bricks.
    volume: [f64; 3],
}

/// Tells what the smoke of `scene`, whose meshes are filled, will need.
///
/// # Errors
/// If it cannot start, diverges in its first frame or is interrupted.
pub(super) fn plan(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    control: Control,
) -> Result<Option<SmokePlan>, RunError> {
    if scene.smoke.is_none() {
        return Ok(None);
    }
    let frames = (selection.last().0 - scene.frames.first().0) as usize;
    let with_volumes = with_outputs && !scene.output.volume.is_empty();
    let (own_start, own) = course(scene, frames, OWN_SECONDS, with_volumes, control)?;
    let (start, pilot) = if own.len() < frames {
        course(&coarser(scene), frames, PILOT_SECONDS, with_volumes, control)?
    } else {
        (own_start, Vec::new())
    };
    let mut remarks = Vec::new();
    if own.len() < frames && pilot.len() < frames {
        let seen = pilot.len().max(own.len()) + 1;
        remarks.push(format!(
            "the calibration of the smoke saw {seen} frames; those after are taken to grow on as the last did"
        ));
    }
    if own.is_empty() && frames > 0 {
        remarks.push(
            "the first frame takes longer than the calibration waits; the time of the smoke is a guess"
                .into(),
        );
    }
    let course = Course { own, pilot, start, frames };
    let last = |of: &dyn Fn(&Seen) -> f64| course.ended(of);
    let sum = |of: &dyn Fn(&Seen) -> f64| course.total(of);
    let stored = selection.count() as f64 / (frames as f64 + 1.0);
    let (vortons, tracers) = (last(&|seen| seen.vortons), last(&|seen| seen.tracers));
    let bricks = last(&|seen| seen.volume[2]);
    Ok(Some(SmokePlan {
        vortons: [own_start.vortons, vortons.max(own_start.vortons)],
        tracers: [own_start.tracers, tracers.max(own_start.tracers)],
        substeps: sum(&|seen| seen.substeps),
        memory: [
            memory::smoke(vortons.max(own_start.vortons), tracers.max(own_start.tracers)),
            if with_volumes { tracer_volume_memory(tracers, bricks) } else { 0 },
        ],
        cache: sum(&|seen| seen.bytes) * stored,
        volumes: sum(&|seen| seen.volume[0]) * stored,
        seconds: [sum(&|seen| seen.seconds), sum(&|seen| seen.volume[1]) * stored],
        remarks,
    }))
}

/// The smoke of a scene with everything farther apart.
fn coarser(scene: &Scene) -> Scene {
    let mut coarse = scene.clone();
    if let Some(smoke) = &mut coarse.smoke {
        smoke.spacing *= COARSER;
        if let Some(remesh) = &mut smoke.flow.remesh {
            remesh.spacing *= COARSER;
        }
    }
    coarse
}

/// What was seen of a shot.
struct Course {
    /// Its own first frames.
    own: Vec<Seen>,
    /// The pilot's, if the shot's own are not all.
    pilot: Vec<Seen>,
    /// What the pilot began with.
    start: Seen,
    /// How many frames the shot has.
    frames: usize,
}

impl Course {
    /// The shot's quantity over the pilot's.
    fn ratio(&self, of: &dyn Fn(&Seen) -> f64) -> f64 {
        let common = self.own.len().min(self.pilot.len());
        let late = |course: &[Seen]| course[common / 2..common].iter().map(of).sum::<f64>();
        let ratio = late(&self.own) / late(&self.pilot);
        if ratio.is_finite() && ratio > 0.0 { ratio } else { f64::from(COARSER).powi(3) }
    }

    /// A quantity in the last frame.
    fn ended(&self, of: &dyn Fn(&Seen) -> f64) -> f64 {
        match self.own.last() {
            Some(last) if self.own.len() == self.frames => of(last),
            _ => self.ratio(of) * ended(&self.pilot, &self.start, self.frames, of),
        }
    }

    /// The same summed over all frames.
    fn total(&self, of: &dyn Fn(&Seen) -> f64) -> f64 {
        let seen = self.own.len();
        let own: f64 = self.own.iter().map(of).sum();
        if seen == self.frames {
            return own;
        }
        let before: f64 = self.pilot.iter().take(seen).map(of).sum();
        own + self.ratio(of) * (total(&self.pilot, &self.start, self.frames, of) - before).max(0.0)
    }
}

/// A quantity in the last of `frames` frames: where the pilot did not come so far, as it grew over its second half.
fn ended(pilot: &[Seen], start: &Seen, frames: usize, of: &dyn Fn(&Seen) -> f64) -> f64 {
    let Some(last) = pilot.last() else { return of(start) };
    let half = &pilot[pilot.len() / 2];
    let slope = (of(last) - of(half)) / (pilot.len() - pilot.len() / 2).max(1) as f64;
    (of(last) + slope * (frames - pilot.len().min(frames)) as f64).max(0.0)
}

/// The same summed over `frames` frames.
fn total(pilot: &[Seen], start: &Seen, frames: usize, of: &dyn Fn(&Seen) -> f64) -> f64 {
    let seen: f64 = pilot.iter().map(of).sum();
    let left = frames - pilot.len().min(frames);
    let last = pilot.last().map_or(0.0, of);
    seen + left as f64 * 0.5 * (last + ended(pilot, start, frames, of))
}

/// The start and up to `frames` frames of the smoke of a scene, for at most about `seconds` [s].
fn course(
    scene: &Scene,
    frames: usize,
    seconds: f64,
    with_volumes: bool,
    control: Control,
) -> Result<(Seen, Vec<Seen>), RunError> {
    let systems = Systems { smoke: scene.systems().smoke, ..Systems::default() };
    let mut simulation = Simulation::new(world(scene), systems)?;
    let counts = simulation.seeded().smoke.unwrap_or_default();
    let start = Seen { vortons: counts.vortons.into(), tracers: counts.tracers.into(), ..Seen::default() };
    let scratch = Scratch::new()?;
    let settings = VolumeSettings::of(scene);
    let clock = Meter::new();
    let mut course = Vec::new();
    for number in 1..=frames {
        let index = FrameIndex(scene.frames.first().0 + number as u32);
        let meter = Meter::new();
        let mut watch = Deadline { control, clock, seconds };
        let record = match simulation.advance(1.0 / f64::from(scene.fps), &mut watch) {
            Ok(record) => record.smoke.unwrap_or_default(),
            Err(Stop::Interrupted) if (control.interrupted)() => return Err(RunError::Interrupted),
            Err(Stop::Interrupted) => break,
            Err(Stop::Diverged(diverged)) if course.is_empty() => {
                return Err(RunError::Diverged { frame: index, diverged });
            }
            Err(Stop::Diverged(_)) => break,
        };
        let simulating = meter.wall();
        let frame = simulation.frame(index);
        let bytes = cache::write_frame(scratch.path(), &frame, 0)? as f64;
        // Only its size was wanted.
        let _ = std::fs::remove_file(cache::frame_path(scratch.path(), index));
        // Volumes change slowly: one of eight frames tells of those after it.
        let volume = match course.last() {
            _ if !with_volumes => [0.0; 3],
            Some(&Seen { volume, .. }) if number % 8 != 0 => volume,
            _ => volume_of(&frame, &settings, &scratch, control)?,
        };
        course.push(Seen {
            vortons: record.vortons as f64,
            tracers: record.tracers as f64,
            substeps: f64::from(record.flow.substeps),
            seconds: simulating,
            bytes,
            volume,
        });
    }
    Ok((start, course))
}

/// Bytes, seconds and bricks of the volume of a frame.
fn volume_of(
    frame: &Frame,
    settings: &VolumeSettings,
    scratch: &Scratch,
    control: Control,
) -> Result<[f64; 3], RunError> {
    let Some(tried) = try_tracers(frame, settings, scratch.path(), control)? else { return Ok([0.0; 3]) };
    let around = settings.smoke.as_ref().expect("what was tried is of smoke");
    let tracers = frame.stream(smoke::TRACERS).and_then(|stream| stream.vec3("position")).unwrap_or_default();
    let spacing = around.smoke.params.tracer_spacing();
    let bricks = bricks_around(tracers, spacing, &settings.surface) as f64;
    Ok([tried.bytes as f64, tried.seconds, bricks])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_pilot_did_not_reach_grows_on() {
        let course: Vec<Seen> = (1..=8).map(|n| Seen { tracers: f64::from(n), ..Seen::default() }).collect();
        let start = Seen::default();
        let tracers = |seen: &Seen| seen.tracers;
        assert_eq!(ended(&course, &start, 8, &tracers), 8.0);
        assert!((ended(&course, &start, 16, &tracers) - 14.0).abs() < 1e-9);
        assert_eq!(total(&course, &start, 8, &tracers), 36.0);
        assert!((total(&course, &start, 16, &tracers) - 36.0 - 8.0 * 11.0).abs() < 1e-9);
        assert_eq!(ended(&[], &start, 5, &tracers), 0.0);
    }

    #[test]
    fn the_shots_own_frames_count_as_they_are_and_those_after_go_with_the_pilot() {
        let seen = |seconds: f64| Seen { seconds, ..Seen::default() };
        let seconds = |seen: &Seen| seen.seconds;
        // The pilot slows from 1 to 2 s; the shot takes ten times as long in its first frame and four times from then on.
        let pilot: Vec<Seen> = (1..=8).map(|n| seen(if n < 5 { 1.0 } else { 2.0 })).collect();
        let own = vec![seen(10.0), seen(4.0), seen(4.0), seen(4.0)];
        let course = Course { own: own.clone(), pilot, start: Seen::default(), frames: 8 };
        assert_eq!((course.total(&seconds), course.ended(&seconds)), (22.0 + 4.0 * 8.0, 8.0));
        let whole = Course { own, pilot: Vec::new(), start: Seen::default(), frames: 4 };
        assert_eq!((whole.total(&seconds), whole.ended(&seconds)), (22.0, 4.0));
        // Of a shot whose first frame takes too long only the pilot is known.
        let pilot = vec![seen(1.0); 3];
        let unseen = Course { own: Vec::new(), pilot, start: Seen::default(), frames: 3 };
        assert_eq!(unseen.total(&seconds), 8.0 * 3.0);
    }
}
