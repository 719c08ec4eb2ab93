//! What a shot will need, before it starts.
//!
//! Particles and passes are exact, by seeding. Memory follows a model (`memory`). Time, files and the surface grid
//! come from calibration: two coarse pilots of all frames (`pilot`), the shot's own start (`sample`),
//! and what they say together (`forecast`). Nothing rests on figures of another machine.

mod forecast;
mod memory;
mod pilot;
mod sample;
mod smoke;

use super::{Control, RunError, remarks, simulate, solids, usage::Meter};
use crate::{
    export::MeshFormat,
    field::{DensityParams, bricks_near_surface, coarse_step},
    frame::Stream,
    grid::BRICK_NODES,
    math::Vec3,
    mesh::{DistanceParams, SurfaceParams},
    par,
    scene::{Frames, Scene},
    sim::{SetupError, Simulation, SmokeSeeds},
};
use forecast::{Forecast, Job, forecast};
use memory::{Grids, Known, Solids};
use pilot::Pilot;
use serde::Serialize;
use smoke::SmokePlan;

/// What a shot will need.
#[derive(Clone, Debug, Serialize)]
pub struct Plan {
    /// The shot's name.
    pub title: String,
    /// The frames to store.
    pub frames: Frames,
    /// How many frames are simulated, stored or not; the first is the start and costs nothing.
    pub frames_simulated: u64,
    /// How many frames are stored.
    pub frames_stored: u64,
    /// Particles at the start.
    pub particles: usize,
    /// The passes that will run.
    pub passes: Vec<String>,
    /// The optional tables that the preset does not have, whose passes will not run.
    pub absent: Vec<String>,
    /// Substeps of all frames.
    pub substeps: f64,
    /// Iterations of all frames.
    pub iterations: f64,
    /// Grid cell of the surface [m]; `None`: no surface is made.
    pub voxel: Option<f64>,
    /// Bricks of 8³ nodes of the surface's density, in the frame that has most.
    pub bricks: f64,
    /// Peak memory [bytes].
    pub memory: u64,
    /// The cache [bytes].
    pub cache: f64,
    /// The meshes [bytes].
    pub meshes: f64,
    /// Wall-clock time [s].
    pub seconds: f64,
    /// The part of it that makes surfaces [s].
    pub surface_seconds: f64,
    /// Processor time of all threads [s], where the system tells.
    pub cpu_seconds: Option<f64>,
    /// By how much the time may be off, as a fraction.
    pub uncertainty: f64,
    /// Threads that the time is for.
    pub threads: usize,
    /// How long the calibration took [s].
    pub calibration_seconds: f64,
    /// What the smoke needs, if there is any. It is part of `memory`, `cache` and `seconds`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokePlan>,
    /// What should be known beside the figures.
    pub remarks: Vec<String>,
}

/// What can be told at once, without calibration.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Particles at the start.
    pub particles: usize,
    /// Vortons and tracers at the start, if there is smoke.
    pub smoke: Option<[u32; 2]>,
    /// The passes that will run.
    pub passes: Vec<String>,
    /// A bound of the memory by the particles and the samples of meshes [bytes]: more than any built-in preset took in any
    /// tier. [`plan`] is closer.
    pub memory: u64,
    /// What the sources had to leave out.
    pub remarks: Vec<String>,
}

/// Particles of the finer pilot. With 8000 its splashes were too coarse: on dam-break the meshes came out a third too
/// large, on drop-in-pool with 4000 a quarter too small.
const PILOT_PARTICLES: f64 = 24000.0;

/// A shot of fewer particles is its own pilot.
const SMALL: usize = 2000;

/// The finer pilot has at most this part of the shot's particles, so that it takes a seventh of its time.
const PILOT_PART: f64 = 0.25;

/// The coarser pilot's spacing over the finer's: far enough for the power laws, and cheap.
const PILOT_RATIO: f64 = 1.5;

/// Longest time for a pilot, and for the shot's own start [s].
const PILOT_SECONDS: f64 = 30.0;
const SAMPLE_SECONDS: f64 = 3.0;

/// The least uncertainty that is admitted: see the figures in docs/plan.md.
const LEAST_UNCERTAINTY: f64 = 0.25;

/// Tells what can be told by seeding alone.
///
/// # Errors
/// If the systems cannot start as the preset says.
pub fn outline(scene: &Scene, with_outputs: bool, control: Control) -> Result<Outline, RunError> {
    let scene = &solids::fill(scene, None, control.reporter)?;
    let simulation = Simulation::new(simulate::world(scene), scene.systems())?;
    let particles = simulation.seeded().particles as usize;
    let seeds = simulation.seeded().smoke;
    Ok(Outline {
        particles,
        smoke: seeds.map(|seeds| [seeds.vortons, seeds.tracers]),
        passes: passes(&simulation, scene, with_outputs),
        memory: peak_memory(scene, particles, None, with_outputs) + smoke_bound(scene, seeds),
        remarks: remarks::of_seeding(&simulation.seeded()),
    })
}

/// Refuses a shot that needs more than `allowed` bytes. Calibrates only if the outline alone cannot tell.
///
/// # Errors
/// [`RunError::OverMemory`], and whatever keeps the shot from starting.
pub fn refuse_over_memory(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    allowed: u64,
    control: Control,
) -> Result<(), RunError> {
    if outline(scene, with_outputs, control)?.memory <= allowed {
        return Ok(());
    }
    let needed = plan_within(scene, selection, with_outputs, Some(allowed), control)?.memory;
    debug_assert!(needed <= allowed, "what needs more was refused");
    Ok(())
}

/// What is made of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Product {
    /// Surface meshes.
    Meshes,
    /// Volume files.
    Volumes,
    /// Tracers as points.
    Points,
}

impl Product {
    /// What it is called where jobs are told.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Meshes => "mesh",
            Self::Volumes => "volume",
            Self::Points => "points",
        }
    }

    /// The memory that making it of `particles` takes [bytes].
    fn memory(self, particles: usize, grids: Grids, params: &SurfaceParams) -> u64 {
        match self {
            Self::Meshes => memory::surface(particles, grids, params),
            Self::Volumes => memory::volume(particles, grids),
            Self::Points => memory::smoke(0.0, particles as f64),
        }
    }
}

/// The memory that making `product` of a stream will need, by where its particles are [bytes]: a bound if that is not above
/// `enough`, else an estimate that takes longer.
pub(super) fn stream_memory(
    product: Product,
    stream: &Stream,
    spacing: f32,
    params: &SurfaceParams,
    enough: u64,
) -> u64 {
    if product == Product::Points {
        return product.memory(stream.len(), Grids::default(), params);
    }
    let positions = stream.vec3("position").unwrap_or_default();
    let bricks = memory::bricks_around(positions, spacing, params);
    let bound = product.memory(stream.len(), Grids::of_bricks(bricks as f64), params);
    if bound <= enough || product == Product::Volumes {
        return bound;
    }
    let SurfaceParams { voxel, kernel_radius, .. } = *params;
    let density = DensityParams { spacing, kernel_radius, voxel, anisotropy: None, whole: false };
    // Surfacing samples the density on coarse bricks first: without room for those there is none for the rest.
    let coarse = SurfaceParams { voxel: voxel * coarse_step(&density) as f32, ..params.clone() };
    let coarse = memory::bricks_around(positions, spacing, &coarse) * BRICK_NODES * size_of::<f32>();
    if coarse as u64 > enough {
        return bound;
    }
    let bricks = bricks as f64;
    let near = bricks_near_surface(positions, &density).map_or(bricks, |near| near as f64 * OPENED);
    product.memory(stream.len(), Grids::of_bricks(near.min(bricks)), params)
}

/// Bricks that are computed over those that were taken to be near the surface at first: 1.00 to 1.05 on splashes and sprays.
const OPENED: f64 = 1.05;

/// The most memory that making `product` of `particles` was seen to take [bytes].
pub(super) fn most_memory(product: Product, particles: usize, params: &SurfaceParams) -> u64 {
    let near = Grids::at_most(particles, params.voxel);
    let grids = match product {
        Product::Meshes | Product::Points => near,
        Product::Volumes => near.with_inside(particles, params.voxel),
    };
    product.memory(particles, grids, params)
}

/// The memory that reading and meshing a level set of so many bricks takes, at most [bytes]: that of a surface by distances,
/// whose density and distance take what the file and its tree do.
pub(super) fn level_set_memory(bricks: usize) -> u64 {
    let params = SurfaceParams { distance: Some(DistanceParams::default()), ..SurfaceParams::default() };
    memory::surface(0, Grids::of_bricks(bricks as f64), &params)
}

/// Refuses what needs more than `allowed` bytes.
pub(super) fn refuse_memory(needed: u64, allowed: u64) -> Result<(), RunError> {
    if needed > allowed { Err(RunError::OverMemory { needed, allowed }) } else { Ok(()) }
}

/// Calibrates and tells what `shot` will need for `selection`; refuses first if it is more memory than `allowed`.
///
/// # Errors
/// If the shot cannot start, needs too much memory, diverges at once, or is interrupted.
pub fn plan(
    scene: &Scene,
    selection: &Frames,
    allowed: Option<u64>,
    control: Control,
) -> Result<Plan, RunError> {
    plan_within(scene, selection, true, allowed, control)
}

fn plan_within(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    allowed: Option<u64>,
    control: Control,
) -> Result<Plan, RunError> {
    simulate::check_selection(scene, selection)?;
    let scene = &solids::fill(scene, None, control.reporter)?;
    let clock = Meter::new();
    control.reporter.begin("calibrate", 3);
    let simulation = Simulation::new(simulate::world(scene), scene.systems())?;
    let passes = passes(&simulation, scene, with_outputs);
    let smoke = smoke::plan(scene, selection, with_outputs, control)?;
    if scene.liquid.is_none() {
        let plan = dry(scene, selection, smoke.unwrap_or_default(), passes, clock.wall());
        control.reporter.end();
        return allowed.map_or(Ok(()), |allowed| refuse_memory(plan.memory, allowed)).map(|()| plan);
    }
    // What follows is of the liquid alone.
    let simulation = Simulation::new(simulate::world(scene), scene.liquid.clone())?;
    let particles = simulation.seeded().particles as usize;
    let formats = formats(scene, with_outputs);
    let mut told = remarks::of_seeding(&simulation.seeded());

    // Two coarse pilots of all frames; then it is known whether the memory suffices.
    let near = pilot_at(scene, selection, formats, near_factor(particles), control)?;
    control.reporter.progress(1.0);
    let far = pilot_at(scene, selection, formats, near.factor * PILOT_RATIO, control)?;
    control.reporter.progress(2.0);
    told.extend(near.remarks.iter().chain(&far.remarks).cloned());
    if with_volumes(scene, with_outputs) {
        told.push("time and disk are without the volumes, which come on top; their memory is counted".into());
    }
    let job = Job {
        liquid: scene.liquid.as_ref().ok_or(SetupError::NoSystem)?,
        particles,
        frame: 1.0 / f64::from(scene.fps),
        gravity: scene.world.gravity.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt(),
        simulated: (selection.last().0 - scene.frames.first().0) as usize,
        stored: selection.count() as usize,
        with_first: selection.contains(scene.frames.first()),
    };
    let early = forecast(&job, &near, [&near, &far], &sample::Sample::default());
    let [smoky, smoking] = smoke.as_ref().map_or([0, 0], |smoke| smoke.memory);
    let memory = peak_memory(scene, particles, Some(early.grids), with_outputs) + smoky.max(smoking);
    if let Some(allowed) = allowed.filter(|&allowed| memory > allowed) {
        return Err(RunError::OverMemory { needed: memory, allowed });
    }

    // The shot's own start.
    let guess = early.surfacing / job.stored as f64;
    let sample = sample::run(scene, simulation, formats, SAMPLE_SECONDS, guess, control)?;
    let found = forecast(&job, &near, [&near, &far], &sample);
    let check = forecast(&job, &far, [&near, &far], &sample);
    control.reporter.end();
    let work = found.simulating + found.surfacing;
    let pace = sample.busy.filter(|&busy| busy > 0.0).unwrap_or(1.0);
    Ok(Plan {
        title: scene.title.clone(),
        frames: selection.clone(),
        frames_simulated: job.simulated as u64,
        frames_stored: selection.count(),
        particles,
        passes,
        absent: scene.absent_tables(),
        substeps: found.substeps,
        iterations: found.iterations,
        voxel: (!formats.is_empty()).then(|| f64::from(scene.surface.voxel * job.liquid.spacing)),
        bricks: found.grids.bricks,
        memory,
        cache: found.cache + smoke.as_ref().map_or(0.0, |smoke| smoke.cache),
        meshes: found.meshes,
        seconds: work / pace + smoke.as_ref().map_or(0.0, |smoke| smoke.seconds.iter().sum()),
        surface_seconds: found.surfacing / pace,
        cpu_seconds: sample.busy.map(|_| work),
        uncertainty: uncertainty(&found, &check),
        threads: par::threads(),
        calibration_seconds: clock.wall(),
        smoke,
        remarks: told,
    })
}

/// The plan of a shot of nothing but smoke.
fn dry(scene: &Scene, selection: &Frames, smoke: SmokePlan, passes: Vec<String>, calibration: f64) -> Plan {
    Plan {
        title: scene.title.clone(),
        frames: selection.clone(),
        frames_simulated: u64::from(selection.last().0 - scene.frames.first().0),
        frames_stored: selection.count(),
        particles: 0,
        passes,
        absent: scene.absent_tables().into_iter().filter(|table| table.starts_with("smoke")).collect(),
        substeps: smoke.substeps,
        iterations: 0.0,
        voxel: None,
        bricks: 0.0,
        memory: smoke.memory[0].max(smoke.memory[1]),
        cache: smoke.cache,
        meshes: 0.0,
        seconds: smoke.seconds.iter().sum(),
        surface_seconds: 0.0,
        cpu_seconds: None,
        uncertainty: SMOKE_UNCERTAINTY,
        threads: par::threads(),
        calibration_seconds: calibration,
        remarks: smoke.remarks.clone(),
        smoke: Some(smoke),
    }
}

/// By how much the time of smoke may be off.
const SMOKE_UNCERTAINTY: f64 = 0.5;

/// A guess, on the safe side, of what smoke takes beside the rest, by what it begins with and what emitters add [bytes].
fn smoke_bound(scene: &Scene, seeds: Option<SmokeSeeds>) -> u64 {
    let (Some(seeds), Some(smoke)) = (seeds, &scene.smoke) else { return 0 };
    let seconds = f64::from(scene.frames.last().0 - scene.frames.first().0) / f64::from(scene.fps);
    let given = smoke.emitter.iter().map(|emitter| {
        let sides = emitter.shape.bounds().map_or(Vec3::zeros(), |(low, high)| high - low);
        f64::from(emitter.rate) * f64::from(sides.x * sides.y * sides.z) * seconds
    });
    let volume: f64 = given.sum();
    let tracers = f64::from(seeds.tracers) + volume / f64::from(smoke.tracer_spacing()).powi(3);
    let vortons = f64::from(seeds.vortons) + volume / f64::from(smoke.spacing).powi(3);
    memory::smoke(GROWTH * vortons, tracers)
}

/// Vortons at the end over those that smoke begins with and is given: swirls spread beyond it.
const GROWTH: f64 = 4.0;

/// The finer pilot's spacing over the shot's.
fn near_factor(particles: usize) -> f64 {
    let count = particles as f64;
    if particles < SMALL { 1.0 } else { (count / PILOT_PARTICLES.min(PILOT_PART * count)).cbrt() }
}

/// A pilot at `factor` times the spacing, or nearer where the shot cannot be so coarse.
fn pilot_at(
    scene: &Scene,
    selection: &Frames,
    formats: &[MeshFormat],
    factor: f64,
    control: Control,
) -> Result<Pilot, RunError> {
    at_or_nearer(factor, |factor| pilot::run(scene, selection, formats, factor, PILOT_SECONDS, control))
}

/// What `run` gives at `factor` times the spacing, or nearer where the sources are too thin for that or the pilot diverges
/// at once: what does not fit between solids so coarsely may fit as the shot is.
fn at_or_nearer(mut factor: f64, run: impl Fn(f64) -> Result<Pilot, RunError>) -> Result<Pilot, RunError> {
    let mut remarks = Vec::new();
    loop {
        match run(factor) {
            Err(RunError::Setup(SetupError::NoParticles)) if factor > 1.0 => {}
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
        factor = (factor / PILOT_RATIO).max(1.0);
    }
}

/// The model's peak of simulating `scene`, whose meshes are filled, and, after it, meshing and making volumes; a bound if
/// its grids are not known.
fn peak_memory(scene: &Scene, particles: usize, grids: Option<Grids>, with_outputs: bool) -> u64 {
    if scene.liquid.is_none() {
        return 0;
    }
    let kernel_radius = scene.liquid.as_ref().map_or(0.0, |liquid| liquid.kernel_radius);
    let known = Known { particles, kernel_radius, solids: Solids::of(scene), grids, surface: &scene.surface };
    let mut peak = known.simulation();
    if !formats(scene, with_outputs).is_empty() {
        peak = peak.max(known.surfaces());
    }
    if with_volumes(scene, with_outputs) {
        peak = peak.max(known.volumes());
    }
    peak
}

/// What is written beside the cache.
fn formats(scene: &Scene, with_outputs: bool) -> &[MeshFormat] {
    if with_outputs { &scene.output.mesh } else { &[] }
}

/// Whether volumes are written beside the cache.
fn with_volumes(scene: &Scene, with_outputs: bool) -> bool {
    with_outputs && !scene.output.volume.is_empty()
}

fn passes(simulation: &Simulation, scene: &Scene, with_outputs: bool) -> Vec<String> {
    let surface = (!formats(scene, with_outputs).is_empty()).then_some("surface");
    let volume = with_volumes(scene, with_outputs).then_some("volume");
    simulation.passes().into_iter().chain(surface).chain(volume).map(String::from).collect()
}

/// How far the forecasts of the two pilots are apart, and at least [`LEAST_UNCERTAINTY`].
fn uncertainty(near: &Forecast, far: &Forecast) -> f64 {
    (near.simulating / far.simulating).ln().abs().max(LEAST_UNCERTAINTY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::FrameIndex, sim::Diverged};
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
