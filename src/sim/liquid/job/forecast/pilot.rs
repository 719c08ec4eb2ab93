//! Pilots: the shot with a larger `liquid.spacing` and fewer substeps in proportion.

use super::counts::counts;
use crate::math::elementary::cbrt;
use crate::{
    frame::FrameIndex,
    job::{RunError, scratch::Scratch},
    sim::{
        FrameRecord, SetupError, Simulation,
        forecast::{CalibrationFrame, CalibrationLimits, ForecastJob, ProductSample, calibrate},
    },
};

/// Frames of which products are made.
const SAMPLED_FRAMES: usize = 6;

/// Particles of the finer pilot. With 8000 its splashes were too coarse: on dam-break the meshes came out a third too
/// large, on drop-in-pool with 4000 a quarter too small.
const PARTICLES: f64 = 24000.0;

/// A shot of fewer particles is its own pilot.
const MIN_PARTICLES: usize = 2000;

/// The finer pilot has at most this fraction of the shot's particles, so that it takes a seventh of its time.
const MAX_FRACTION: f64 = 0.25;

/// Spacing of the coarser pilot over the finer's: far enough for the power laws, and cheap.
pub(super) const RATIO: f64 = 1.5;

/// Longest time for a pilot [s].
const SECONDS: f64 = 30.0;

/// A pilot that was run.
#[derive(Clone, Debug)]
pub(super) struct Pilot {
    /// Spacing of the pilot over the shot's.
    pub(super) factor: f64,
    /// The smallest and the largest number of substeps a frame that it was allowed.
    pub(super) limits: [u32; 2],
    /// Number of particles.
    pub(super) particles: usize,
    /// Its simulated frames in order; fewer than the shot's if time ran out or it diverged.
    pub(super) frames: Vec<PilotFrame>,
    /// Records of these frames.
    pub(super) records: Vec<(FrameIndex, FrameRecord)>,
    /// Products of a few frames, spread over those.
    pub(super) products: Vec<Vec<ProductSample>>,
    /// Why it ended early or is finer than usual, as messages.
    pub(super) remarks: Vec<String>,
}

/// A simulated frame of a pilot.
#[derive(Clone, Debug)]
pub(super) struct PilotFrame {
    /// Processor time of all passes [s].
    pub(super) work: f64,
    /// Wall-clock time of all passes [s]: for work shorter than the clock's ticks.
    pub(super) seconds: f64,
    /// The part of the work that grows with the iterations [s].
    pub(super) solving: f64,
    /// Substeps.
    pub(super) substeps: u32,
    /// Iterations of all substeps.
    pub(super) iterations: u32,
    /// Largest speed of a particle at the frame's end [m/s].
    pub(super) max_speed: f64,
    /// Size in the cache [bytes].
    pub(super) bytes: f64,
}

impl PilotFrame {
    fn new(calibration: &CalibrationFrame) -> Self {
        let CalibrationFrame { frame, record, work, bytes, .. } = calibration;
        let seconds = record.total_seconds();
        let liquid = record.liquid.as_ref();
        let solving: f64 =
            record.seconds.iter().filter(|(name, _)| *name == "solve").map(|(_, seconds)| seconds).sum();
        let velocities = frame.streams.iter().filter_map(|stream| stream.vec3("velocity")).flatten();
        Self {
            work: *work,
            seconds,
            solving: if seconds > 0.0 { work * solving / seconds } else { 0.0 },
            substeps: liquid.map_or(0, |liquid| liquid.substeps),
            iterations: liquid.map_or(0, |liquid| liquid.iterations),
            max_speed: velocities.map(|v| f64::from(v.norm())).fold(0.0, f64::max),
            bytes: *bytes,
        }
    }
}

/// Runs the shot with `factor` times its spacing.
///
/// # Errors
/// If it cannot start, is cancelled, or diverges before its first frame is done.
fn run(job: &ForecastJob, factor: f64) -> Result<Pilot, RunError> {
    let mut systems = job.scene.systems_sharing_substeps();
    let mut limits = [0, u32::MAX];
    if let Some(liquid) = &mut systems.liquid {
        liquid.spacing = (f64::from(liquid.spacing) * factor) as f32;
        // Substeps as long as the shot's, in spacings: then one takes about as many iterations.
        let fewer = |substeps: u32| ((f64::from(substeps) / factor).round() as u32).max(1);
        limits = [fewer(liquid.min_substeps), fewer(liquid.max_substeps)];
        [liquid.min_substeps, liquid.max_substeps] = limits;
    }
    let coarse = systems.liquid.clone();
    let mut simulation = Simulation::new(job.scene.surroundings(), systems)?;
    let counts = counts(job.scene, coarse.as_ref(), &simulation.seeded());
    let particles = (counts.iter().map(|count| count.end).sum::<f64>() as usize).max(1);
    let (frames, records, products) = (Vec::new(), Vec::new(), Vec::new());
    let mut pilot = Pilot { factor, limits, particles, frames, records, products, remarks: Vec::new() };
    let every = job.simulated().div_ceil(SAMPLED_FRAMES).max(1);
    let limits = CalibrationLimits { seconds: SECONDS, min_frames: 1, keeps_frames: false };
    let scratch = Scratch::new()?;
    let shot = scratch.shot()?;
    let ended = calibrate(job, &mut simulation, &shot, limits, &mut |frame| {
        if frame.number > 0 {
            pilot.frames.push(PilotFrame::new(&frame));
            pilot.records.push((frame.frame.index, frame.record.clone()));
        }
        if frame.number.is_multiple_of(every) || frame.number == job.simulated() {
            let made = job.products.sample(job.scene, &shot, &frame.selection(), job.control)?;
            pilot.products.push(made);
        }
        Ok(())
    })?;
    if let Some(ended) = ended {
        pilot.remarks.push(match ended.diverged {
            Some(why) => format!(
                "the calibration with {factor:.1} times the spacing ended in frame {}: {why}",
                ended.frame
            ),
            None => format!(
                "the calibration reached frame {}; the frames after it are assumed to be like the last of those before",
                ended.frame
            ),
        });
    }
    Ok(pilot)
}

/// Spacing of the finer pilot over that of a shot of so many particles.
pub(super) fn near_factor(particles: usize) -> f64 {
    let count = particles as f64;
    if particles < MIN_PARTICLES { 1.0 } else { cbrt(count / PARTICLES.min(MAX_FRACTION * count)) }
}

/// A pilot with `factor` times the spacing, or nearer to the shot where that is too coarse.
///
/// # Errors
/// As the shot's own, if it cannot start or diverges at once; if cancelled.
pub(super) fn pilot_at(job: &ForecastJob, factor: f64) -> Result<Pilot, RunError> {
    at_or_nearer(factor, |factor| run(job, factor))
}

/// The result of `run` with `factor` times the spacing, or nearer to the shot where the sources are too thin for that or the
/// pilot diverges at once: what does not fit between solids so coarsely may fit at the shot's spacing.
fn at_or_nearer(mut factor: f64, run: impl Fn(f64) -> Result<Pilot, RunError>) -> Result<Pilot, RunError> {
    let mut remarks = Vec::new();
    loop {
        match run(factor) {
            Err(RunError::Setup(why))
                if factor > 1.0 && matches!(why.downcast_ref(), Some(SetupError::NoParticles)) => {}
            Err(RunError::Diverged { frame, diverged }) if factor > 1.0 => remarks.push(format!(
                "the calibration was made nearer to the shot: with {factor:.1} times the spacing it ended in frame {frame}: \
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

    /// A pilot that diverges in its first frame with more than `max_factor` times the spacing.
    fn pilot_up_to(max_factor: f64) -> impl Fn(f64) -> Result<Pilot, RunError> {
        move |factor| {
            if factor > max_factor {
                let what = "does not fit".into();
                let diverged =
                    Diverged { system: "liquid", substep: 1, particle: 7, what, try_next: "spacing" };
                return Err(RunError::Diverged { frame: FrameIndex(2), diverged });
            }
            let (frames, records, products) = (Vec::new(), Vec::new(), Vec::new());
            let remarks = vec!["its own".into()];
            Ok(Pilot { factor, limits: [1, 2], particles: 8, frames, records, products, remarks })
        }
    }

    #[test]
    fn a_pilot_that_does_not_fit_is_refined_and_reported() {
        let run = pilot_up_to(2.5);
        let factors = RefCell::new(Vec::new());
        let found = at_or_nearer(3.0, |factor| {
            factors.borrow_mut().push(factor);
            run(factor)
        });
        let found = found.unwrap();
        assert_eq!(*factors.borrow(), [3.0, 2.0]);
        assert_eq!(found.factor, 2.0);
        assert_eq!(found.remarks.len(), 2, "{:?}", found.remarks);
        assert!(found.remarks[1].contains("with 3.0 times") && found.remarks[1].contains("particle 7"));
        // With its own spacing the divergence is the shot's.
        let lost = at_or_nearer(3.0, pilot_up_to(0.5)).unwrap_err();
        assert!(matches!(lost, RunError::Diverged { frame: FrameIndex(2), .. }), "{lost}");
    }
}
