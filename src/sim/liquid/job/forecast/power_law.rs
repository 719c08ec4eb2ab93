//! Power laws from pilots to the shot: how work, files and memory grow as the spacing shrinks.
//!
//! *Method*: two pilots with larger spacings ran every frame. Substeps follow the CFL rule, so the shot's follow from the
//! largest speed in the pilot's frame; top speeds, file sizes and memory follow the power law that the two pilots show. A
//! substep takes as many iterations as the pilot's, whose length in spacings is equal: on four presets those of 7 000, 25 000
//! and 100 000 particles mostly differ by a tenth. Seconds are the pilot's, times the particles and the work.
//! Tried: seconds scaled by the cost of a particle in the shot's own first substeps. These are not typical, because a liquid
//! released from a seeding lattice rebuilds its neighbour lists three times a substep: a dam break of 100 000 particles was
//! forecast to take twice its time. Between 2 000 and 100 000 particles the cost of one changes by less than a fifth.
//! Limits: neither spray that only the shot resolves nor a cost a particle that rises only there is seen.

use super::{
    pilot::{Pilot, PilotFrame},
    start::Start,
};
use crate::math::elementary::{ln, powf};
use crate::{
    job::memory::BASE_MEMORY,
    sim::{
        forecast::{ForecastJob, ProductForecast, ProductSample},
        liquid::LiquidParams,
    },
};

/// Forecast of simulating, storing and using all frames.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LiquidForecast {
    /// Processor time of simulating all frames [s].
    pub(super) work: f64,
    /// Size of the cached frames [bytes].
    pub(super) cache: f64,
    /// The products, with their processor time as seconds.
    pub(super) products: Vec<ProductForecast>,
    /// Substeps of all frames.
    pub(super) substeps: f64,
    /// Iterations of all frames.
    pub(super) iterations: f64,
}

/// The shot that is forecast.
#[derive(Clone, Copy)]
pub(super) struct Shot<'a> {
    pub(super) liquid: &'a LiquidParams,
    pub(super) particles: usize,
    /// Length of a frame [s].
    pub(super) frame: f64,
    /// Magnitude of gravity [m/s²].
    pub(super) gravity: f64,
    /// Number of frames to simulate.
    pub(super) simulated: usize,
    /// Number of frames to store.
    pub(super) stored: usize,
    /// Whether the first is one of them.
    pub(super) stores_first: bool,
}

impl<'a> Shot<'a> {
    pub(super) fn new(job: &ForecastJob<'a>, liquid: &'a LiquidParams, particles: usize) -> Self {
        let gravity = job.scene.world.gravity.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        Self {
            liquid,
            particles,
            frame: job.frame_seconds(),
            gravity,
            simulated: job.simulated(),
            stored: job.stored(),
            stores_first: job.selection.contains(job.scene.frames.first()),
        }
    }
}

/// Forecasts the shot from the frames of `pilot`, with the power laws of the `near` and the `far` pilot.
pub(super) fn forecast(
    shot: &Shot<'_>,
    pilot: &Pilot,
    [near, far]: [&Pilot; 2],
    start: &Start,
) -> LiquidForecast {
    let costs = Costs::of(pilot);
    let law = PowerLaw { near: near.factor, ratio: far.factor / near.factor };
    let correction = cfl_correction(shot, pilot);
    let common = near.frames.len().min(far.frames.len());
    let speeds = [near, far].map(|pilot| mean_max_speed(&pilot.frames[..common]));
    let speed_ratio = powf(pilot.factor, law.exponent(speeds[0], speeds[1]));
    let cost_exponent = law.exponent(Costs::of(near).iteration, Costs::of(far).iteration);
    let cost_ratio = powf(pilot.factor, COST_EXPONENT_FRACTION * cost_exponent);
    let scale = cost_ratio * shot.particles as f64 / pilot.particles as f64;
    let max_iterations = f64::from(shot.liquid.iterations.unwrap_or(shot.liquid.max_iterations));
    let limits = [shot.liquid.min_substeps, shot.liquid.max_substeps].map(f64::from);
    let frame = |(place, frame): (usize, &PilotFrame)| {
        let speed = speed_ratio * max_speed(pilot, place);
        let substeps = cfl_substeps(shot, speed, f64::from(shot.liquid.spacing)) * correction;
        let substeps = substeps.ceil().max(limits[0]).min(limits[1]);
        let each = (f64::from(frame.iterations) / f64::from(frame.substeps)).min(max_iterations);
        let work = scale * costs.of_frame_with(frame, substeps, substeps * each);
        [work, substeps, substeps * each, frame.bytes]
    };
    let frames: Vec<[f64; 4]> = pilot.frames.iter().enumerate().map(frame).collect();
    let [work, substeps, iterations, bytes] = total(&frames, shot.simulated);
    let bytes = bytes / shot.simulated.max(1) as f64;
    let stored = shot.stored as f64;
    let moving = stored - f64::from(u8::from(shot.stores_first));
    let first = if shot.stores_first { start.first_bytes } else { 0.0 };
    LiquidForecast {
        work: work + start.writing * stored,
        cache: first + bytes * shot.particles as f64 / pilot.particles as f64 * moving,
        products: products(&near.products, &far.products, law, start, stored),
        substeps,
        iterations,
    }
}

/// Fraction of the exponent of the cost of an iteration that holds beyond the pilots. Coarse pilots have more wall a particle,
/// so an iteration gets cheaper towards the shot, but less and less: on wave-machine the whole exponent would turn an
/// iteration of 135 ns into one of 91; with none of it the forecast was a quarter too long.
const COST_EXPONENT_FRACTION: f64 = 0.5;

/// Sums over `frames` frames; those that the pilot did not reach are assumed to be like the last quarter of the others.
fn total(course: &[[f64; 4]], frames: usize) -> [f64; 4] {
    let late = &course[course.len() - course.len().div_ceil(4)..];
    let missing = frames.saturating_sub(course.len()) as f64 / late.len().max(1) as f64;
    let sum = |part: &[[f64; 4]], column: usize| part.iter().map(|row| row[column]).sum::<f64>();
    [0, 1, 2, 3].map(|column| sum(course, column) + missing * sum(late, column))
}

/// A quantity at two spacings, extrapolated to a third.
#[derive(Clone, Copy, Debug)]
struct PowerLaw {
    /// Spacing of the finer pilot over the shot's.
    near: f64,
    /// Spacing of the coarser pilot over the finer's.
    ratio: f64,
}

impl PowerLaw {
    /// The power of 1/spacing by which the quantity grows; 0 if it is unknown.
    fn exponent(self, near: f64, far: f64) -> f64 {
        if near > 0.0 && far > 0.0 && self.ratio > 1.0 { ln(near / far) / ln(self.ratio) } else { 0.0 }
    }

    /// The quantity at the shot's spacing.
    fn at_shot(self, near: f64, far: f64) -> f64 {
        near * powf(self.near, self.exponent(near, far))
    }
}

/// Cost of a substep and of an iteration in a pilot [s/particle].
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
            substep: (sum(&|frame| frame.work) - solving) / substeps / count,
            iteration: solving / iterations / count,
        }
    }

    fn work(&self, substeps: f64, iterations: f64) -> f64 {
        self.substep * substeps + self.iteration * iterations
    }

    /// Processor time of a frame of the pilot with other numbers of substeps and iterations [s].
    fn of_frame_with(&self, frame: &PilotFrame, substeps: f64, iterations: f64) -> f64 {
        let usual = self.work(f64::from(frame.substeps), f64::from(frame.iterations));
        if usual > 0.0 {
            frame.work * self.work(substeps, iterations) / usual
        } else {
            // The whole pilot ended within a tick of the clock of processor time.
            frame.seconds * substeps / f64::from(frame.substeps.max(1))
        }
    }
}

/// Substeps by the CFL rule at a speed of `max_speed` [m/s], the positive root of (v + g dt) dt = allowed, and by the
/// capillary time.
fn cfl_substeps(shot: &Shot<'_>, max_speed: f64, spacing: f64) -> f64 {
    let allowed = f64::from(shot.liquid.cfl) * spacing;
    let root = max_speed + (max_speed * max_speed + 4.0 * shot.gravity * allowed).sqrt();
    let capillary = shot.frame / shot.liquid.longest_capillary_substep(spacing);
    (shot.frame * root / (2.0 * allowed)).max(capillary).max(1.0)
}

/// Largest speed of a particle while frame `place` was computed: at its end or at its start.
fn max_speed(pilot: &Pilot, place: usize) -> f64 {
    let before = place.checked_sub(1).map_or(0.0, |before| pilot.frames[before].max_speed);
    pilot.frames[place].max_speed.max(before)
}

fn mean_max_speed(frames: &[PilotFrame]) -> f64 {
    frames.iter().map(|frame| frame.max_speed).sum::<f64>() / frames.len().max(1) as f64
}

/// Substeps that the pilot took over those of the CFL rule, where neither of the preset's limits decided.
fn cfl_correction(shot: &Shot<'_>, pilot: &Pilot) -> f64 {
    let spacing = f64::from(shot.liquid.spacing) * pilot.factor;
    let (mut taken, mut expected) = (0.0, 0.0);
    for (place, frame) in pilot.frames.iter().enumerate() {
        if frame.substeps > pilot.limits[0] && frame.substeps < pilot.limits[1] {
            taken += f64::from(frame.substeps);
            expected += cfl_substeps(shot, max_speed(pilot, place), spacing);
        }
    }
    if expected > 0.0 { taken / expected } else { 1.0 }
}

/// The products of all stored frames.
fn products(
    near: &[Vec<ProductSample>],
    far: &[Vec<ProductSample>],
    law: PowerLaw,
    start: &Start,
    stored: f64,
) -> Vec<ProductForecast> {
    let Some(first) = near.first() else { return Vec::new() };
    let forecast = |(place, product): (usize, &ProductSample)| {
        let at = |samples: &[ProductSample]| samples.get(place).cloned().unwrap_or_default();
        let pairs: Vec<[ProductSample; 2]> =
            near.iter().zip(far).map(|(near, far)| [at(near), at(far)]).collect();
        let bytes = pairs.iter().map(|[near, far]| law.at_shot(near.bytes, far.bytes)).sum::<f64>();
        let bytes = bytes / pairs.len().max(1) as f64;
        let memory =
            pairs.iter().map(|[near, far]| law.at_shot(near.memory - BASE_MEMORY, far.memory - BASE_MEMORY));
        // Work grows with the size of the files: by the shot's own first product if that took long enough to be measured.
        let own = start.products.get(place).filter(|own| own.work >= MIN_WORK && own.bytes > 0.0);
        let sum =
            |of: &dyn Fn(&ProductSample) -> f64| near.iter().map(|samples| of(&at(samples))).sum::<f64>();
        let work_per_byte = match own {
            Some(own) => own.work / own.bytes,
            None => sum(&|sample| sample.work) / sum(&|sample| sample.bytes).max(1.0),
        };
        ProductForecast {
            name: product.name,
            bytes: bytes * stored,
            seconds: bytes * work_per_byte * stored,
            memory: BASE_MEMORY + memory.fold(0.0, f64::max),
        }
    };
    first.iter().enumerate().map(forecast).collect()
}

/// Shortest processor time that is measured [s]: its clock has ticks of 10 ms.
const MIN_WORK: f64 = 0.2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_power_law_is_extrapolated_to_the_shot() {
        // 1/x² at spacings 2 and 3 of a shot with spacing 1.
        let law = PowerLaw { near: 2.0, ratio: 1.5 };
        assert!((law.at_shot(0.25, 1.0 / 9.0) - 1.0).abs() < 1e-12);
        assert_eq!(law.at_shot(5.0, 0.0), 5.0, "a quantity of one pilot alone is taken as it is");
        assert_eq!(PowerLaw { near: 1.0, ratio: 1.0 }.at_shot(5.0, 7.0), 5.0);
    }

    #[test]
    fn work_shorter_than_a_tick_is_forecast_by_wall_clock_time() {
        let frame = PilotFrame {
            work: 0.0,
            seconds: 0.004,
            solving: 0.0,
            substeps: 8,
            iterations: 24,
            max_speed: 1.0,
            bytes: 100.0,
        };
        let costs = |work: f64| {
            let frames = vec![PilotFrame { work, ..frame.clone() }];
            let (records, products, remarks) = (Vec::new(), Vec::new(), Vec::new());
            Costs::of(&Pilot {
                factor: 1.0,
                limits: [8, 100],
                particles: 512,
                frames,
                records,
                products,
                remarks,
            })
        };
        assert_eq!(costs(0.0).of_frame_with(&frame, 16.0, 48.0), 0.008);
        let measured = PilotFrame { work: 0.02, ..frame.clone() };
        assert!((costs(0.02).of_frame_with(&measured, 16.0, 48.0) - 0.04).abs() < 1e-12);
    }

    #[test]
    fn frames_after_the_pilot_cost_as_much_as_its_last() {
        let course: Vec<[f64; 4]> = (1..=8).map(|i| [f64::from(i), 1.0, 0.0, 2.0]).collect();
        assert_eq!(total(&course, 8), [36.0, 8.0, 0.0, 16.0]);
        assert_eq!(total(&course, 10), [51.0, 10.0, 0.0, 20.0]);
        assert_eq!(total(&[], 3), [0.0; 4]);
    }

    #[test]
    fn products_grow_by_their_power_law_and_work_goes_with_their_size() {
        let sample = |bytes: f64| {
            vec![ProductSample {
                name: "mesh",
                work: bytes / 100.0,
                seconds: bytes / 200.0,
                bytes,
                memory: BASE_MEMORY + 2.0 * bytes,
                failed: None,
            }]
        };
        let law = PowerLaw { near: 2.0, ratio: 1.5 };
        let (near, far) = ([sample(100.0), sample(200.0)], [sample(100.0 / 2.25), sample(200.0 / 2.25)]);
        let found = products(&near, &far, law, &Start::default(), 10.0).remove(0);
        let expected = [6000.0, 60.0, 1600.0];
        for (found, expected) in [found.bytes, found.seconds, found.memory - BASE_MEMORY].iter().zip(expected)
        {
            assert!((found / expected - 1.0).abs() < 1e-9, "{found}, expected {expected}");
        }
        assert_eq!(products(&[], &[], law, &Start::default(), 10.0), []);
    }
}
