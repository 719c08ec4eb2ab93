//! What the smoke of a shot will need.
//!
//! *Method*: a pilot with everything [`COARSER`] times as far apart runs all frames, or as many as time allows; the shot's own first frame
//! tells how many times more of everything there is, and how much longer a frame takes. Both together are the shot: its counts are
//! the pilot's times that of the first frame.
//! Limits: what only fine smoke does, more swirls and shorter steps, is not seen; the time of a shot that ends in turbulence is told
//! too short.

use super::{Control, RunError, memory};
use crate::{
    cache,
    frame::FrameIndex,
    run::{
        scratch::Scratch,
        simulate::world,
        usage::Meter,
        volume::{SmokeFrame, Surroundings, VolumeSettings, write_smoke},
        {ShotFolder, job::Target, ledger::Made},
    },
    scene::{Frames, Scene},
    sim::{Simulation, Stop, Systems, Watch, smoke},
};
use serde::Serialize;

/// The pilot's spacing over the shot's: an eighth of everything.
const COARSER: f32 = 2.0;

/// Longest time for the pilot, and for the shot's own first frame [s].
const PILOT_SECONDS: f64 = 15.0;
const FIRST_SECONDS: f64 = 6.0;

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
    let mut coarse = scene.clone();
    if let Some(smoke) = &mut coarse.smoke {
        smoke.spacing *= COARSER;
        if let Some(remesh) = &mut smoke.flow.remesh {
            remesh.spacing *= COARSER;
        }
    }
    let (start, pilot) = course(&coarse, frames, PILOT_SECONDS, with_volumes, control)?;
    let (own_start, own) = course(scene, frames.min(1), FIRST_SECONDS, with_volumes, control)?;
    let mut remarks = Vec::new();
    if pilot.len() < frames {
        let seen = pilot.len() + 1;
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
    let ratio = |of: &dyn Fn(&Seen) -> f64| {
        let pair = own.first().zip(pilot.first()).map(|(own, pilot)| of(own) / of(pilot));
        pair.filter(|ratio| ratio.is_finite() && *ratio > 0.0).unwrap_or(f64::from(COARSER).powi(3))
    };
    let last = |of: &dyn Fn(&Seen) -> f64| ratio(of) * ended(&pilot, &start, frames, of);
    let sum = |of: &dyn Fn(&Seen) -> f64| ratio(of) * total(&pilot, &start, frames, of);
    let stored = selection.count() as f64 / (frames as f64 + 1.0);
    let (vortons, tracers) = (last(&|seen| seen.vortons), last(&|seen| seen.tracers));
    let bricks = last(&|seen| seen.volume[2]);
    Ok(Some(SmokePlan {
        vortons: [own_start.vortons, vortons.max(own_start.vortons)],
        tracers: [own_start.tracers, tracers.max(own_start.tracers)],
        substeps: sum(&|seen| seen.substeps),
        memory: [
            memory::smoke(vortons.max(own_start.vortons), tracers.max(own_start.tracers)),
            if with_volumes { memory::smoke_volume(tracers, bricks) } else { 0 },
        ],
        cache: sum(&|seen| seen.bytes) * stored,
        volumes: sum(&|seen| seen.volume[0]) * stored,
        seconds: [sum(&|seen| seen.seconds), sum(&|seen| seen.volume[1]) * stored],
        remarks,
    }))
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
    let systems = Systems { liquid: None, ..scene.systems() };
    let around = systems.smoke.clone().map(|smoke| Surroundings { smoke, world: world(scene) });
    let mut simulation = Simulation::new(world(scene), systems)?;
    let counts = simulation.seeded().smoke.unwrap_or_default();
    let start = Seen { vortons: counts.vortons.into(), tracers: counts.tracers.into(), ..Seen::default() };
    let scratch = Scratch::new()?;
    let settings = VolumeSettings {
        surface: scene.surface.clone(),
        volume: scene.volume.clone(),
        grids: scene.output.volume.clone(),
        smoke: around,
    };
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
    frame: &crate::frame::Frame,
    settings: &VolumeSettings,
    scratch: &Scratch,
    control: Control,
) -> Result<[f64; 3], RunError> {
    let Some((around, tracers)) = settings.smoke.as_ref().zip(frame.stream(smoke::TRACERS)) else {
        return Ok([0.0; 3]);
    };
    let meter = Meter::new();
    let air = smoke::FrameAir::of(&around.smoke, &around.world, &frame.streams, frame.time)?;
    let wanted: Vec<_> = settings
        .grids
        .iter()
        .copied()
        .filter(|grid| crate::export::vdb::VolumeGrid::SMOKE.contains(grid))
        .collect();
    let spacing = around.smoke.params.tracer_spacing();
    let shown = SmokeFrame { tracers, air: Some(&air), spacing, wanted: &wanted, slower: 1.0 };
    let out = ShotFolder::new(scratch.path());
    ShotFolder::create(&out.volumes())?;
    let target = Target { index: frame.index, name: smoke::NAME.into(), key: 0 };
    let mut made = Made::new(frame.index);
    write_smoke(&out, settings, shown, &target, &mut made, control)?;
    let bytes =
        made.pieces.iter().filter_map(|piece| piece.work.as_ref()).map(|work| work.bytes).sum::<u64>();
    let positions = tracers.vec3("position").unwrap_or_default();
    let bricks = memory::bricks_around(positions, spacing, &settings.surface) as f64;
    Ok([bytes as f64, meter.wall(), bricks])
}

/// Goes on until time is up, or the user stops the job.
struct Deadline<'a> {
    control: Control<'a>,
    clock: Meter,
    seconds: f64,
}

impl Watch for Deadline<'_> {
    fn keep_going(&mut self) -> bool {
        self.clock.wall() < self.seconds && !(self.control.interrupted)()
    }
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
}
