//! From pilots to the shot: how work, files and grids grow as particles get closer.
//!
//! *Method*: two pilots at larger spacings saw every frame. Substeps follow the CFL rule, so those of the shot follow
//! from the fastest particle of the pilot's frame; top speeds, bricks and mesh bytes grow by the power law that the two
//! pilots show. A substep takes as many iterations as the pilot's, which is as long in spacings: on four presets those of
//! 7 000, 25 000 and 100 000 particles differ by a tenth mostly. Seconds are the pilot's, times the particles and the work.
//! Tried: seconds scaled by what a particle costs in the shot's own first substeps. They are unlike the rest, because a
//! liquid let go from a lattice rebuilds its lists three times a substep: a dam break of 100 000 particles was told to
//! take twice its time. Between 2 000 and 100 000 particles the cost of one changes by less than a fifth.
//! Limits: spray that only the shot resolves is not seen, and neither is a cost a particle that rises only there.

use super::{
    pilot::{Pilot, PilotFrame, PilotSurface},
    sample::Sample,
};
use crate::{job::memory::Grids, sim::liquid::LiquidParams};

/// What the pilots say of the shot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Forecast {
    /// Work of simulating all frames [s].
    pub(super) simulating: f64,
    /// Work of making and writing all surfaces [s].
    pub(super) surfacing: f64,
    /// The cache [bytes].
    pub(super) cache: f64,
    /// The meshes [bytes].
    pub(super) meshes: f64,
    /// Grids and mesh of the largest frames.
    pub(super) grids: Grids,
    /// Substeps of all frames.
    pub(super) substeps: f64,
    /// Iterations of all frames.
    pub(super) iterations: f64,
}

/// What is to be done.
#[derive(Clone, Copy, Debug)]
pub(super) struct Job<'a> {
    pub(super) liquid: &'a LiquidParams,
    pub(super) particles: usize,
    /// Length of a frame [s].
    pub(super) frame: f64,
    /// Strength of gravity [m/s²].
    pub(super) gravity: f64,
    /// Frames to simulate.
    pub(super) simulated: usize,
    /// Frames to store, and to mesh if meshes are made.
    pub(super) stored: usize,
    /// Whether the first is one of them.
    pub(super) with_first: bool,
}

/// Forecasts the shot from the course of `pilot`, with the power laws that the `near` and the `far` pilot show.
pub(super) fn forecast(job: &Job<'_>, pilot: &Pilot, [near, far]: [&Pilot; 2], sample: &Sample) -> Forecast {
    let costs = Costs::of(pilot);
    let law = Law { near: near.factor, ratio: far.factor / near.factor };
    let correction = rule_correction(job, pilot);
    let seen = near.frames.len().min(far.frames.len());
    let speeds = [near, far].map(|pilot| mean_fastest(&pilot.frames[..seen]));
    let faster = pilot.factor.powf(law.exponent(speeds[0], speeds[1]));
    let cheaper =
        pilot.factor.powf(FALLS * law.exponent(Costs::of(near).iteration, Costs::of(far).iteration));
    let scale = cheaper * job.particles as f64 / pilot.particles as f64;
    let mut course = Vec::new();
    for (place, frame) in pilot.frames.iter().enumerate() {
        let speed = faster * fastest(pilot, place);
        let rule = rule(job, speed, f64::from(job.liquid.spacing)) * correction;
        let least = f64::from(job.liquid.min_substeps);
        let steps = rule.ceil().max(least).min(f64::from(job.liquid.max_substeps));
        let most = f64::from(job.liquid.iterations.unwrap_or(job.liquid.max_iterations));
        let each = (f64::from(frame.iterations) / f64::from(frame.substeps)).min(most);
        let work = scale * costs.of_frame_with(frame, steps, steps * each);
        course.push([work, steps, steps * each, frame.bytes as f64]);
    }
    let [simulating, substeps, iterations, bytes] = total(&course, job.simulated);
    let bytes = bytes / job.simulated.max(1) as f64;
    let surface = surfaces(&near.surfaces, &far.surfaces, law, sample);
    let stored = job.stored as f64;
    let moving = stored - f64::from(u8::from(job.with_first));
    let first = if job.with_first { sample.first_bytes as f64 } else { 0.0 };
    Forecast {
        simulating: simulating + sample.writing * stored,
        surfacing: surface.seconds * stored,
        cache: first + bytes * job.particles as f64 / pilot.particles as f64 * moving,
        meshes: surface.bytes * stored,
        grids: surface.grids,
        substeps,
        iterations,
    }
}

/// How much of the power law of the cost of an iteration holds beyond the pilots. Coarse pilots touch more wall a
/// particle, so an iteration gets cheaper on the way to the shot, but less and less: on wave-machine all of the law would
/// make an iteration of 135 ns one of 91; with none of it the shot was told to take a quarter more than it did.
const FALLS: f64 = 0.5;

/// Sums over `frames` frames; those that the pilot did not reach are like the last quarter of those that it did.
fn total(course: &[[f64; 4]], frames: usize) -> [f64; 4] {
    let late = &course[course.len() - course.len().div_ceil(4)..];
    let unseen = frames.saturating_sub(course.len()) as f64 / late.len().max(1) as f64;
    let sum = |part: &[[f64; 4]], column: usize| part.iter().map(|row| row[column]).sum::<f64>();
    [0, 1, 2, 3].map(|column| sum(course, column) + unseen * sum(late, column))
}

/// A quantity at two spacings, continued to a third.
#[derive(Clone, Copy, Debug)]
struct Law {
    /// The nearer pilot's spacing over the shot's.
    near: f64,
    /// The farther pilot's spacing over the nearer's.
    ratio: f64,
}

impl Law {
    /// The power of 1/spacing that the quantity grows with; 0 if it cannot be told.
    fn exponent(self, near: f64, far: f64) -> f64 {
        if near > 0.0 && far > 0.0 && self.ratio > 1.0 { (near / far).ln() / self.ratio.ln() } else { 0.0 }
    }

    /// The quantity at the shot's spacing.
    fn at_shot(self, near: f64, far: f64) -> f64 {
        near * self.near.powf(self.exponent(near, far))
    }
}

/// What a substep and an iteration cost in a pilot, a particle [s].
#[derive(Clone, Copy, Debug)]
struct Costs {
    substep: f64,
    iteration: f64,
}

impl Costs {
    fn of(pilot: &Pilot) -> Self {
        let sum = |value: &dyn Fn(&PilotFrame) -> f64| pilot.frames.iter().map(value).sum::<f64>();
        let count = pilot.particles as f64;
        let substeps = sum(&|frame| f64::from(frame.substeps)).max(1.0);
        let iterations = sum(&|frame| f64::from(frame.iterations)).max(1.0);
        let solving = sum(&|frame| frame.solving);
        Self {
            substep: (sum(&|frame| frame.seconds) - solving) / substeps / count,
            iteration: solving / iterations / count,
        }
    }

    fn work(&self, substeps: f64, iterations: f64) -> f64 {
        self.substep * substeps + self.iteration * iterations
    }

    /// What a frame of the pilot would have taken with other numbers of substeps and iterations [s].
    fn of_frame_with(&self, frame: &PilotFrame, substeps: f64, iterations: f64) -> f64 {
        let usual = self.work(f64::from(frame.substeps), f64::from(frame.iterations));
        if usual > 0.0 {
            frame.seconds * self.work(substeps, iterations) / usual
        } else {
            // The whole pilot ended within a step of the clock of work.
            frame.clock * substeps / f64::from(frame.substeps.max(1))
        }
    }
}

/// Substeps that the CFL rule asks for at a speed of `fastest` [m/s]: the positive root of (v + g dt) dt = allowed.
fn rule(job: &Job<'_>, fastest: f64, spacing: f64) -> f64 {
    let allowed = f64::from(job.liquid.cfl) * spacing;
    let root = fastest + (fastest * fastest + 4.0 * job.gravity * allowed).sqrt();
    (job.frame * root / (2.0 * allowed)).max(1.0)
}

/// The fastest particle while frame `place` was computed: at its end or at its start.
fn fastest(pilot: &Pilot, place: usize) -> f64 {
    let before = place.checked_sub(1).map_or(0.0, |before| pilot.frames[before].fastest);
    pilot.frames[place].fastest.max(before)
}

fn mean_fastest(frames: &[PilotFrame]) -> f64 {
    frames.iter().map(|frame| frame.fastest).sum::<f64>() / frames.len().max(1) as f64
}

/// Substeps that the pilot took over those of the rule, where neither of the preset's limits decided.
fn rule_correction(job: &Job<'_>, pilot: &Pilot) -> f64 {
    let spacing = f64::from(job.liquid.spacing) * pilot.factor;
    let (mut took, mut asked) = (0.0, 0.0);
    for (place, frame) in pilot.frames.iter().enumerate() {
        if frame.substeps > pilot.limits[0] && frame.substeps < pilot.limits[1] {
            took += f64::from(frame.substeps);
            asked += rule(job, fastest(pilot, place), spacing);
        }
    }
    if asked > 0.0 { took / asked } else { 1.0 }
}

/// Means a surface, and the most of grids and mesh.
struct Surfaces {
    seconds: f64,
    bytes: f64,
    grids: Grids,
}

fn surfaces(near: &[PilotSurface], far: &[PilotSurface], law: Law, sample: &Sample) -> Surfaces {
    let pairs = || near.iter().zip(far);
    let count = pairs().count().max(1) as f64;
    let mean = |value: &dyn Fn(&PilotSurface) -> f64| {
        pairs().map(|(near, far)| law.at_shot(value(near), value(far))).sum::<f64>() / count
    };
    let most = |value: &dyn Fn(&PilotSurface) -> f64| {
        pairs().map(|(near, far)| law.at_shot(value(near), value(far))).fold(0.0, f64::max)
    };
    let bricks = |surface: &PilotSurface| surface.bricks as f64;

    // Work goes with the bricks: by the shot's own first surface if that took long enough to be measured.
    let real = sample.surface.filter(|surface| surface.seconds >= MEASURABLE);
    let work: f64 = near.iter().map(|surface| surface.seconds).sum();
    let a_brick = match real {
        Some(real) => real.seconds / bricks(&real),
        None => work / near.iter().map(bricks).sum::<f64>().max(1.0),
    };
    Surfaces {
        seconds: mean(&bricks) * a_brick,
        bytes: mean(&|surface| surface.bytes as f64),
        grids: Grids { bricks: most(&bricks), vertices: most(&|surface| surface.vertices as f64) },
    }
}

/// Work below this is lost in the steps of 10 ms in which it is told [s].
const MEASURABLE: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_continued_to_the_shot() {
        // 1/x² at spacings 2 and 3 of a shot with spacing 1.
        let law = Law { near: 2.0, ratio: 1.5 };
        assert!((law.at_shot(0.25, 1.0 / 9.0) - 1.0).abs() < 1e-12);
        assert_eq!(law.at_shot(5.0, 0.0), 5.0, "what is not seen in both pilots is taken as it is");
        assert_eq!(Law { near: 1.0, ratio: 1.0 }.at_shot(5.0, 7.0), 5.0);
    }

    #[test]
    fn work_too_short_to_be_told_goes_by_the_clock() {
        let frame = PilotFrame {
            seconds: 0.0,
            clock: 0.004,
            solving: 0.0,
            substeps: 8,
            iterations: 24,
            fastest: 1.0,
            bytes: 100,
        };
        let costs = |seconds: f64| {
            let frames = vec![PilotFrame { seconds, ..frame.clone() }];
            let (surfaces, remarks) = (Vec::new(), Vec::new());
            Costs::of(&Pilot { factor: 1.0, limits: [8, 100], particles: 512, frames, surfaces, remarks })
        };
        assert_eq!(costs(0.0).of_frame_with(&frame, 16.0, 48.0), 0.008);
        let seen = PilotFrame { seconds: 0.02, ..frame.clone() };
        assert!((costs(0.02).of_frame_with(&seen, 16.0, 48.0) - 0.04).abs() < 1e-12);
    }

    #[test]
    fn frames_beyond_the_pilot_cost_as_much_as_its_last() {
        let course: Vec<[f64; 4]> = (1..=8).map(|i| [f64::from(i), 1.0, 0.0, 2.0]).collect();
        assert_eq!(total(&course, 8), [36.0, 8.0, 0.0, 16.0]);
        assert_eq!(total(&course, 10), [51.0, 10.0, 0.0, 20.0]);
        assert_eq!(total(&[], 3), [0.0; 4]);
    }
}
