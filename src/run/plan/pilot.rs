//! A coarse shot, run to see how the fine one will go: the same preset with a larger `liquid.spacing`, and
//! fewer substeps in proportion.

use crate::{
    cache,
    export::MeshFormat,
    frame::{Frame, FrameIndex, Stream},
    mesh,
    run::{Control, RunError, scratch::Scratch, simulate::world, usage::Meter},
    scene::{Frames, Scene},
    sim::{FrameRecord, SetupError, Simulation, Stop, Systems, Watch, liquid::NAME},
};

/// Frames of which surfaces are made.
const SURFACES: usize = 6;

/// Particles of the finer pilot. With 8000 its splashes were too coarse: on dam-break the meshes came out a third too
/// large, on drop-in-pool with 4000 a quarter too small.
const PARTICLES: f64 = 24000.0;

/// A shot of fewer particles is its own pilot.
const SMALL: usize = 2000;

/// The finer pilot has at most this part of the shot's particles, so that it takes a seventh of its time.
const PART: f64 = 0.25;

/// The coarser pilot's spacing over the finer's: far enough for the power laws, and cheap.
pub(super) const RATIO: f64 = 1.5;

/// Longest time for a pilot [s].
const SECONDS: f64 = 30.0;

/// A coarse shot that was run.
#[derive(Clone, Debug)]
pub(super) struct Pilot {
    /// Its spacing over the shot's.
    pub(super) factor: f64,
    /// The fewest and the most substeps a frame that it was allowed.
    pub(super) limits: [u32; 2],
    /// Its particles.
    pub(super) particles: usize,
    /// Every simulated frame, in order; fewer than asked for if time ran out or the pilot diverged.
    pub(super) frames: Vec<PilotFrame>,
    /// A few surfaces, spread over those frames; none if the shot makes none.
    pub(super) surfaces: Vec<PilotSurface>,
    /// What should be known of it, in words: why it ended early, or was made finer.
    pub(super) remarks: Vec<String>,
}

/// One simulated frame of a pilot.
#[derive(Clone, Debug)]
pub(super) struct PilotFrame {
    /// Work of all passes [s], see [`Meter`].
    pub(super) seconds: f64,
    /// Wall-clock time of all passes [s]: for work too short for the steps in which it is told.
    pub(super) clock: f64,
    /// The part of it that grows with the iterations [s].
    pub(super) solving: f64,
    /// Substeps.
    pub(super) substeps: u32,
    /// Iterations over all substeps.
    pub(super) iterations: u32,
    /// The fastest particle at the frame's end [m/s].
    pub(super) fastest: f64,
    /// Bytes in the cache.
    pub(super) bytes: u64,
}

/// One surface of a pilot.
#[derive(Clone, Copy, Debug)]
pub(super) struct PilotSurface {
    /// Work of making and writing it [s].
    pub(super) seconds: f64,
    /// Bricks of its density.
    pub(super) bricks: usize,
    /// Vertices of its mesh.
    pub(super) vertices: usize,
    /// Bytes of its files, all formats together.
    pub(super) bytes: u64,
}

/// Runs the shot at `factor` times its spacing for at most about `seconds` [s].
///
/// # Errors
/// If it cannot start, is interrupted, or diverges before its first frame is done.
pub(super) fn run(
    scene: &Scene,
    selection: &Frames,
    formats: &[MeshFormat],
    factor: f64,
    seconds: f64,
    control: Control,
) -> Result<Pilot, RunError> {
    let mut systems = of_liquid(scene);
    let liquid = &mut systems.liquid;
    let fewer = |steps: u32| ((f64::from(steps) / factor).round() as u32).max(1);
    if let Some(liquid) = &mut *liquid {
        liquid.spacing = (f64::from(liquid.spacing) * factor) as f32;
        // Substeps as long as the shot's, in spacings: then one takes about as many iterations.
        (liquid.min_substeps, liquid.max_substeps) = (fewer(liquid.min_substeps), fewer(liquid.max_substeps));
    }
    let limits = liquid.as_ref().map_or([0, u32::MAX], |liquid| [liquid.min_substeps, liquid.max_substeps]);
    let spacing = liquid.as_ref().map_or(0.0, |liquid| liquid.spacing);
    let mut simulation = Simulation::new(world(scene), systems)?;
    let scratch = Scratch::new()?;
    let clock = Meter::new();
    let (first, last) = (scene.frames.first().0, selection.last().0);
    let every = ((last - first) as usize).div_ceil(SURFACES).max(1) as u32;
    let particles = simulation.seeded().liquid.unwrap_or_default().particles as usize;
    let (frames, surfaces) = (Vec::new(), Vec::new());
    let mut pilot = Pilot { factor, limits, particles, frames, surfaces, remarks: Vec::new() };
    for index in first..=last {
        if index > first {
            let meter = Meter::new();
            match simulation.advance(1.0 / f64::from(scene.fps), &mut Attentive(control)) {
                Ok(record) => {
                    let work = meter.work();
                    let frame = simulation.frame(FrameIndex(index));
                    let bytes = cache::write_frame(scratch.path(), &frame, 0)?;
                    // Only its size was wanted.
                    let _ = std::fs::remove_file(cache::frame_path(scratch.path(), frame.index));
                    pilot.frames.push(entry(&record, work, &frame, bytes));
                }
                Err(Stop::Interrupted) => return Err(RunError::Interrupted),
                Err(Stop::Diverged(diverged)) if pilot.frames.is_empty() => {
                    return Err(RunError::Diverged { frame: FrameIndex(index), diverged });
                }
                Err(Stop::Diverged(diverged)) => {
                    pilot.remarks.push(format!(
                        "the calibration, at {factor:.1} times the spacing, ended in frame {index}: {diverged}"
                    ));
                    break;
                }
            }
        }
        let sampled = (index - first) % every == 0 || index == last;
        if !formats.is_empty() && sampled {
            let frame = simulation.frame(FrameIndex(index));
            for stream in frame.streams.iter().filter(|stream| stream.name == NAME) {
                pilot.surfaces.push(surface(scene, stream, spacing, formats, &scratch, control)?);
            }
        }
        if clock.wall() > seconds && index < last && index > first {
            pilot.remarks.push(format!(
                "the calibration saw the frames up to {index}; those after it are taken to be like the last of them"
            ));
            break;
        }
    }
    Ok(pilot)
}

fn entry(record: &FrameRecord, work: f64, frame: &Frame, bytes: u64) -> PilotFrame {
    let total = record.total_seconds();
    let liquid = record.liquid.as_ref();
    let solving: f64 = record.seconds.iter().filter(|(name, _)| *name == "solve").map(|(_, s)| s).sum();
    let velocities = frame.streams.iter().filter_map(|stream| stream.vec3("velocity")).flatten();
    PilotFrame {
        seconds: work,
        clock: total,
        solving: if total > 0.0 { work * solving / total } else { 0.0 },
        substeps: liquid.map_or(0, |liquid| liquid.substeps),
        iterations: liquid.map_or(0, |liquid| liquid.iterations),
        fastest: velocities.map(|v| f64::from(v.norm())).fold(0.0, f64::max),
        bytes,
    }
}

/// Makes the surface of `stream` as the shot would and tells what it took.
pub(super) fn surface(
    scene: &Scene,
    stream: &Stream,
    spacing: f32,
    formats: &[MeshFormat],
    scratch: &Scratch,
    control: Control,
) -> Result<PilotSurface, RunError> {
    let meter = Meter::new();
    let surface = mesh::reconstruct(stream, spacing, &scene.surface, &|| !(control.interrupted)())?;
    let mut bytes = 0;
    for format in formats {
        let path = scratch.path().join(format!("surface.{}", format.extension()));
        bytes += format.write(&surface.mesh, &path, 0)?;
    }
    let (bricks, vertices) = (surface.stats.bricks[0], surface.stats.vertices);
    Ok(PilotSurface { seconds: meter.work(), bricks, vertices, bytes })
}

/// The liquid, and the sheets that share its substeps if they are coupled.
pub(super) fn of_liquid(scene: &Scene) -> Systems {
    let Systems { liquid, sheets, mut couplings, .. } = scene.systems();
    couplings.retain(|coupling| coupling.between.iter().any(|side| side == NAME));
    let sheets = sheets.filter(|_| !couplings.is_empty());
    Systems { liquid, smoke: None, sheets, couplings }
}

/// Goes on until the user stops the job.
struct Attentive<'a>(Control<'a>);

impl Watch for Attentive<'_> {
    fn keep_going(&mut self) -> bool {
        !(self.0.interrupted)()
    }
}

/// The finer pilot's spacing over the shot's.
pub(super) fn near_factor(particles: usize) -> f64 {
    let count = particles as f64;
    if particles < SMALL { 1.0 } else { (count / PARTICLES.min(PART * count)).cbrt() }
}

/// A pilot at `factor` times the spacing, or nearer where the shot cannot be so coarse.
pub(super) fn pilot_at(
    scene: &Scene,
    selection: &Frames,
    formats: &[MeshFormat],
    factor: f64,
    control: Control,
) -> Result<Pilot, RunError> {
    at_or_nearer(factor, |factor| run(scene, selection, formats, factor, SECONDS, control))
}

/// What `run` gives at `factor` times the spacing, or nearer where the sources are too thin for that or the pilot diverges
/// at once: what does not fit between solids so coarsely may fit as the shot is.
fn at_or_nearer(mut factor: f64, run: impl Fn(f64) -> Result<Pilot, RunError>) -> Result<Pilot, RunError> {
    let mut remarks = Vec::new();
    loop {
        match run(factor) {
            Err(RunError::Setup(why))
                if factor > 1.0 && matches!(why.downcast_ref(), Some(SetupError::NoParticles)) => {}
            Err(RunError::Diverged { frame, diverged }) if factor > 1.0 => remarks.push(format!(
                "the calibration was made nearer to the shot: at {factor:.1} times the spacing it ended in frame {frame}: \
                 {diverged}"
            )),
            done => {
                return done.map(|mut pilot| {
                    pilot.remarks.append(&mut remarks);
                    pilot
                });
            }
        }
        factor = (factor / RATIO).max(1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::Diverged;
    use std::cell::RefCell;

    /// A pilot that diverges in its first frame at more than `most` times the spacing.
    fn pilot_up_to(most: f64) -> impl Fn(f64) -> Result<Pilot, RunError> {
        move |factor| {
            if factor > most {
                let what = "has no room".into();
                let diverged =
                    Diverged { system: "liquid", substep: 1, particle: 7, what, try_next: "spacing" };
                return Err(RunError::Diverged { frame: FrameIndex(2), diverged });
            }
            let (frames, surfaces, remarks) = (Vec::new(), Vec::new(), vec!["of its own".into()]);
            Ok(Pilot { factor, limits: [1, 2], particles: 8, frames, surfaces, remarks })
        }
    }

    #[test]
    fn what_does_not_fit_coarsely_is_tried_nearer_and_said() {
        let run = pilot_up_to(2.5);
        let asked = RefCell::new(Vec::new());
        let found = at_or_nearer(3.0, |factor| {
            asked.borrow_mut().push(factor);
            run(factor)
        });
        let found = found.unwrap();
        assert_eq!(*asked.borrow(), [3.0, 2.0]);
        assert_eq!(found.factor, 2.0);
        assert_eq!(found.remarks.len(), 2, "{:?}", found.remarks);
        assert!(found.remarks[1].contains("at 3.0 times") && found.remarks[1].contains("particle 7"));
        // At its own spacing the divergence is the shot's.
        let lost = at_or_nearer(3.0, pilot_up_to(0.5)).unwrap_err();
        assert!(matches!(lost, RunError::Diverged { frame: FrameIndex(2), .. }), "{lost}");
    }
}
