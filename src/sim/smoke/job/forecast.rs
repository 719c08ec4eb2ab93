//! Forecast of the smoke: the shot's own first frames, and a coarser pilot of the others.
//!
//! *Method*: the shot's own first frames are run, as many as time allows. If these are not all, a pilot with [`COARSER`] times
//! the spacing runs on. Over the later half of the frames that both have, the ratios of all quantities are found; the
//! forecast is the shot's own frames, and the pilot's later ones times those ratios.
//! Limits: what only the fine smoke does after its own frames, more vortices and shorter substeps, is not seen; the time of a
//! shot that ends in turbulence is forecast too short.

use crate::{
    frame::StreamKind,
    job::{RunError, memory::BASE_MEMORY, scratch::Scratch},
    math::Vec3,
    sim::{
        SeedReport, Simulation, Systems,
        forecast::{
            CalibrationLimits, ElementCount, ForecastJob, ProductForecast, ProductSample, SystemForecast,
            calibrate, failures,
        },
        scene::Scene,
        smoke::SmokeParams,
        vortex::{flow::Sum, max_multigrid_bytes},
    },
    solid::Shape,
};

/// The pilot's spacing over the shot's: an eighth of all elements.
const COARSER: f32 = 2.0;

/// Longest time for the pilot, and for the shot's own first frames [s].
const SECONDS: f64 = 10.0;

/// Frames between those of which products are made: products change slowly.
const FRAMES_PER_SAMPLE: usize = 8;

/// Relative error that the time may have [–].
const UNCERTAINTY: f64 = 0.5;

/// Vortons at the end over those of the start and of emitters: vortices spread beyond them.
const GROWTH: f64 = 4.0;

/// Memory of simulating [bytes/vorton]: columns, rates and the tree that sums them …
const VORTON_BYTES: f64 = 900.0;

/// … and [bytes/tracer].
const TRACER_BYTES: f64 = 230.0;

/// Shapes of a mesh that deforms which its panels hold at a time: those of the stages of a step.
const STAGES: f64 = 4.0;

/// Memory of each [bytes/node of the distance field], …
const NODE_BYTES: f64 = 4.0;

/// … [bytes/triangle], in a tree and by corners (with its vertices 90 measured, 108 counted, of a mesh of 600 000), …
const TRIANGLE_BYTES: f64 = 96.0;

/// … and [bytes/vertex], positions and velocities.
const VERTEX_BYTES: f64 = 24.0;

/// Memory of so many vortons and tracers, and of meshes that deform among them [bytes].
pub(super) fn memory(scene: &Scene, counts: &[ElementCount]) -> f64 {
    let Some(smoke) = &scene.smoke else { return 0.0 };
    let has_grid = smoke.flow.sum == Sum::Multigrid;
    let bytes = |count: &ElementCount| match count.kind {
        StreamKind::Vortons if has_grid => {
            count.max() * VORTON_BYTES + max_multigrid_bytes(count.max() as usize)
        }
        StreamKind::Vortons => count.max() * VORTON_BYTES,
        _ => count.max() * TRACER_BYTES,
    };
    let meshes = scene.world.collider.iter().filter_map(|collider| match &collider.shape {
        Shape::Mesh(mesh) => mesh.deformation(),
        _ => None,
    });
    let stage = meshes.map(|mesh| {
        let (nodes, triangles) = (mesh.max_nodes() as f64, mesh.triangles().len() as f64);
        NODE_BYTES * nodes + TRIANGLE_BYTES * triangles + VERTEX_BYTES * mesh.vertices() as f64
    });
    counts.iter().map(bytes).sum::<f64>() + STAGES * stage.sum::<f64>()
}

/// The vortons and tracers of seeded smoke, with a bound of those at the end by what emitters add.
pub(super) fn counts(scene: &Scene, smoke: &SmokeParams, seeds: &SeedReport) -> Vec<ElementCount> {
    let Some(seeds) = &seeds.smoke else { return Vec::new() };
    let emitted = smoke.emitter.iter().map(|emitter| {
        let sides = emitter.shape.bounds().map_or(Vec3::zeros(), |(low, high)| high - low);
        f64::from(emitter.rate) * f64::from(sides.x * sides.y * sides.z) * scene.seconds()
    });
    let volume: f64 = emitted.sum();
    let added = |spacing: f32| volume / f64::from(spacing).powi(3);
    let (vortons, tracers) = (f64::from(seeds.vortons), f64::from(seeds.tracers));
    counts_of(
        [vortons, GROWTH * (vortons + added(smoke.spacing))],
        [tracers, tracers + added(smoke.tracer_spacing())],
    )
}

fn counts_of(vortons: [f64; 2], tracers: [f64; 2]) -> Vec<ElementCount> {
    let count = |name, kind, [start, end]: [f64; 2]| ElementCount { name, kind, start, end };
    vec![count("vortons", StreamKind::Vortons, vortons), count("tracers", StreamKind::Tracers, tracers)]
}

/// Measured quantities of a frame.
#[derive(Clone, Debug, Default)]
struct FrameCosts {
    vortons: f64,
    tracers: f64,
    substeps: f64,
    seconds: f64,
    bytes: f64,
    products: Vec<ProductSample>,
}

impl FrameCosts {
    /// A quantity of a product; 0 if it was not made.
    fn product(&self, place: usize, of: impl Fn(&ProductSample) -> f64) -> f64 {
        self.products.get(place).map_or(0.0, of)
    }
}

/// Forecasts the smoke of a scene.
///
/// # Errors
/// As [`System::forecast`](crate::sim::system::System::forecast).
pub(super) fn forecast(job: &ForecastJob) -> Result<SystemForecast, RunError> {
    let frames = job.simulated();
    let Run { start: own_start, course: own, diverged } = run(job)?;
    let (start, pilot) = if own.len() < frames {
        let pilot = run(&ForecastJob { scene: &coarser(job.scene), ..*job })?;
        (pilot.start, pilot.course)
    } else {
        (own_start.clone(), Vec::new())
    };
    let mut remarks = Vec::new();
    if let Some(why) = diverged {
        remarks.push(format!("the shot itself diverged in the calibration of the smoke: {why}"));
    }
    if own.len() < frames && pilot.len() < frames {
        let last = pilot.len().max(own.len()) + 1;
        remarks.push(format!(
            "the calibration of the smoke reached {last} frames; growth after them is assumed to go on as before"
        ));
    }
    if own.is_empty() && frames > 0 {
        remarks.push(
            "the first frame takes longer than the calibration; the time of the smoke is a guess".into(),
        );
    }
    remarks.extend(failures(own_start.products.iter().chain(own.iter().flat_map(|costs| &costs.products))));
    let course = Course { own, pilot, start, frames };
    let ended = |of: &dyn Fn(&FrameCosts) -> f64| course.ended(of);
    let sum = |of: &dyn Fn(&FrameCosts) -> f64| course.total(of);
    // The first frame is stored too, and has products.
    let stored = job.stored() as f64 / (frames as f64 + 1.0);
    let all = |of: &dyn Fn(&FrameCosts) -> f64| (of(&own_start) + sum(of)) * stored;
    let product = |(place, sample): (usize, &ProductSample)| ProductForecast {
        name: sample.name,
        bytes: all(&|costs| costs.product(place, |sample| sample.bytes)),
        seconds: all(&|costs| costs.product(place, |sample| sample.seconds)),
        memory: BASE_MEMORY + ended(&|costs| costs.product(place, |sample| sample.memory - BASE_MEMORY)),
    };
    Ok(SystemForecast {
        name: "smoke",
        counts: counts_of(
            [own_start.vortons, ended(&|costs| costs.vortons)],
            [own_start.tracers, ended(&|costs| costs.tracers)],
        ),
        substeps: sum(&|costs| costs.substeps),
        iterations: 0.0,
        cache: all(&|costs| costs.bytes),
        seconds: sum(&|costs| costs.seconds),
        uncertainty: UNCERTAINTY,
        products: own_start.products.iter().enumerate().map(product).collect(),
        totals: Vec::new(),
        remarks,
    })
}

/// A scene with coarser smoke.
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

/// A run of the smoke of a scene.
struct Run {
    start: FrameCosts,
    /// The frames after it that were reached.
    course: Vec<FrameCosts>,
    /// Why it diverged, if it did.
    diverged: Option<String>,
}

/// Runs the smoke of a scene alone; the costs of its start and of the frames that were reached.
fn run(job: &ForecastJob) -> Result<Run, RunError> {
    let systems = Systems { smoke: job.scene.systems().smoke, ..Systems::default() };
    let mut simulation = Simulation::new(job.scene.surroundings(), systems)?;
    let seeds = simulation.seeded().smoke.unwrap_or_default();
    let mut start =
        FrameCosts { vortons: seeds.vortons.into(), tracers: seeds.tracers.into(), ..FrameCosts::default() };
    let mut course: Vec<FrameCosts> = Vec::new();
    let limits = CalibrationLimits { seconds: SECONDS, min_frames: 0, keeps_frames: false };
    let scratch = Scratch::new()?;
    let shot = scratch.shot()?;
    let ended = calibrate(job, &mut simulation, &shot, limits, &mut |frame| {
        if frame.number == 0 {
            start.bytes = frame.bytes;
            start.products = job.products.sample(job.scene, &shot, &frame.selection(), job.control)?;
            return Ok(());
        }
        let products = match course.last() {
            Some(last) if frame.number % FRAMES_PER_SAMPLE != 0 => last.products.clone(),
            _ => job.products.sample(job.scene, &shot, &frame.selection(), job.control)?,
        };
        let record = frame.record.smoke.unwrap_or_default();
        course.push(FrameCosts {
            vortons: record.vortons as f64,
            tracers: record.tracers as f64,
            substeps: f64::from(record.flow.substeps),
            seconds: frame.seconds,
            bytes: frame.bytes,
            products,
        });
        Ok(())
    })?;
    Ok(Run { start, course, diverged: ended.and_then(|ended| ended.diverged) })
}

/// Costs of the frames of a shot.
struct Course {
    /// First frames of the shot itself.
    own: Vec<FrameCosts>,
    /// Frames of the pilot; empty if the shot ran to its end.
    pilot: Vec<FrameCosts>,
    /// The pilot's start.
    start: FrameCosts,
    /// How many frames the shot has.
    frames: usize,
}

impl Course {
    /// The shot's quantity over the pilot's.
    fn ratio(&self, of: &dyn Fn(&FrameCosts) -> f64) -> f64 {
        let common = self.own.len().min(self.pilot.len());
        let late = |course: &[FrameCosts]| course[common / 2..common].iter().map(of).sum::<f64>();
        let ratio = late(&self.own) / late(&self.pilot);
        if ratio.is_finite() && ratio > 0.0 { ratio } else { f64::from(COARSER).powi(3) }
    }

    /// A quantity in the last frame.
    fn ended(&self, of: &dyn Fn(&FrameCosts) -> f64) -> f64 {
        match self.own.last() {
            None if self.frames == 0 => of(&self.start),
            Some(last) if self.own.len() == self.frames => of(last),
            _ => self.ratio(of) * ended(&self.pilot, &self.start, self.frames, of),
        }
    }

    /// A quantity summed over all frames.
    fn total(&self, of: &dyn Fn(&FrameCosts) -> f64) -> f64 {
        let reached = self.own.len();
        let own: f64 = self.own.iter().map(of).sum();
        if reached == self.frames {
            return own;
        }
        let before: f64 = self.pilot.iter().take(reached).map(of).sum();
        own + self.ratio(of) * (total(&self.pilot, &self.start, self.frames, of) - before).max(0.0)
    }
}

/// A quantity in the last of `frames` frames: beyond the pilot's, with the slope of its second half.
fn ended(pilot: &[FrameCosts], start: &FrameCosts, frames: usize, of: &dyn Fn(&FrameCosts) -> f64) -> f64 {
    let Some(last) = pilot.last() else { return of(start) };
    let half = &pilot[pilot.len() / 2];
    let slope = (of(last) - of(half)) / (pilot.len() - pilot.len() / 2).max(1) as f64;
    (of(last) + slope * (frames - pilot.len().min(frames)) as f64).max(0.0)
}

/// Sum of a quantity over `frames` frames, extrapolated beyond the pilot.
fn total(pilot: &[FrameCosts], start: &FrameCosts, frames: usize, of: &dyn Fn(&FrameCosts) -> f64) -> f64 {
    let reached: f64 = pilot.iter().map(of).sum();
    let left = frames - pilot.len().min(frames);
    let last = pilot.last().map_or(0.0, of);
    reached + left as f64 * 0.5 * (last + ended(pilot, start, frames, of))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_after_the_pilot_grow_as_its_second_half() {
        let course: Vec<FrameCosts> =
            (1..=8).map(|n| FrameCosts { tracers: f64::from(n), ..FrameCosts::default() }).collect();
        let start = FrameCosts::default();
        let tracers = |costs: &FrameCosts| costs.tracers;
        assert_eq!(ended(&course, &start, 8, &tracers), 8.0);
        assert!((ended(&course, &start, 16, &tracers) - 14.0).abs() < 1e-9);
        assert_eq!(total(&course, &start, 8, &tracers), 36.0);
        assert!((total(&course, &start, 16, &tracers) - 36.0 - 8.0 * 11.0).abs() < 1e-9);
        assert_eq!(ended(&[], &start, 5, &tracers), 0.0);
    }

    #[test]
    fn the_shots_own_frames_are_summed_and_later_ones_follow_the_pilot() {
        let costs = |seconds: f64| FrameCosts { seconds, ..FrameCosts::default() };
        let seconds = |costs: &FrameCosts| costs.seconds;
        // The pilot slows from 1 to 2 s; the shot takes ten times as long in its first frame and four times from then on.
        let pilot: Vec<FrameCosts> = (1..=8).map(|n| costs(if n < 5 { 1.0 } else { 2.0 })).collect();
        let own = vec![costs(10.0), costs(4.0), costs(4.0), costs(4.0)];
        let course = Course { own: own.clone(), pilot, start: FrameCosts::default(), frames: 8 };
        assert_eq!((course.total(&seconds), course.ended(&seconds)), (22.0 + 4.0 * 8.0, 8.0));
        let whole = Course { own, pilot: Vec::new(), start: FrameCosts::default(), frames: 4 };
        assert_eq!((whole.total(&seconds), whole.ended(&seconds)), (22.0, 4.0));
        // Of a shot whose first frame takes too long only the pilot is known.
        let pilot = vec![costs(1.0); 3];
        // A shot of its first frame alone ends as it starts.
        let alone = Course { own: Vec::new(), pilot: Vec::new(), start: costs(3.0), frames: 0 };
        assert_eq!((alone.total(&seconds), alone.ended(&seconds)), (0.0, 3.0));
        let unknown = Course { own: Vec::new(), pilot, start: FrameCosts::default(), frames: 3 };
        assert_eq!(unknown.total(&seconds), 8.0 * 3.0);
    }
}
