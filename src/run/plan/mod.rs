//! What a shot will need, before it starts.
//!
//! Particles and passes are exact, by seeding. Memory follows a model (`memory`). Time, files and the surface grid
//! come from calibration: two coarse pilots of all frames (`pilot`), the shot's own start (`sample`),
//! and what they say together (`forecast`). Nothing rests on figures of another machine.

mod deadline;
mod forecast;
mod memory;
mod pilot;
mod sample;
mod sheets;
mod smoke;

use super::{Control, RunError, simulate, solids, usage::Meter};
use crate::{
    export::MeshFormat,
    job::memory::{Grids, refuse_memory},
    math::Vec3,
    par,
    scene::{Frames, Scene},
    sim::{SetupError, Simulation, registry, smoke::SmokeSeeds},
};
use forecast::{Forecast, Job, forecast};
use memory::{Known, Solids};
use pilot::{near_factor, pilot_at};
use serde::Serialize;
use sheets::SheetsPlan;
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
    /// The same of the sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheets: Option<SheetsPlan>,
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
    /// Points of sheets.
    pub points: u32,
    /// The passes that will run.
    pub passes: Vec<String>,
    /// A bound of the memory by the particles and the samples of meshes [bytes]: more than any built-in preset took in any
    /// tier. [`plan`] is closer.
    pub memory: u64,
    /// What the sources had to leave out.
    pub remarks: Vec<String>,
}

/// Longest time for the shot's own start [s].
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
    let seeds = simulation.seeded();
    let particles = seeds.liquid.map_or(0, |liquid| liquid.particles as usize);
    let points = seeds.sheets.map_or(0, |sheets| sheets.points);
    Ok(Outline {
        particles,
        smoke: seeds.smoke.as_ref().map(|seeds| [seeds.vortons, seeds.tracers]),
        points,
        passes: passes(&simulation, scene, with_outputs),
        memory: peak_memory(scene, particles, None, with_outputs)
            + smoke_bound(scene, seeds.smoke.as_ref())
            + memory::sheets(points as usize, sheets::terms(scene)),
        remarks: registry::seeding_warnings(&seeds),
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
    // Grids are built of a few numbers: what would not fit is refused before it is.
    refuse_memory(sheets::least(scene), allowed)?;
    if outline(scene, with_outputs, control)?.memory <= allowed {
        return Ok(());
    }
    let needed = plan_within(scene, selection, with_outputs, Some(allowed), control)?.memory;
    debug_assert!(needed <= allowed, "what needs more was refused");
    Ok(())
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
    allowed.map_or(Ok(()), |allowed| refuse_memory(sheets::least(scene), allowed))?;
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
    let mut beside = Beside {
        smoke: smoke::plan(scene, selection, with_outputs, control)?,
        sheets: sheets::plan(scene, selection, with_outputs, control)?,
    };
    if scene.liquid.is_none() {
        let plan = dry(scene, selection, beside, passes, clock.wall());
        control.reporter.end();
        return allowed.map_or(Ok(()), |allowed| refuse_memory(plan.memory, allowed)).map(|()| plan);
    }
    // What follows is of the liquid alone, or of it and the sheets that it is coupled with.
    let systems = pilot::of_liquid(scene);
    if systems.sheets.is_some() {
        beside.leave_sheets_to_pilots();
    }
    let simulation = Simulation::new(simulate::world(scene), systems)?;
    let particles = simulation.seeded().liquid.map_or(0, |liquid| liquid.particles as usize);
    let formats = formats(scene, with_outputs);
    let mut told = registry::seeding_warnings(&simulation.seeded());

    // Two coarse pilots of all frames; then it is known whether the memory suffices.
    let near = pilot_at(scene, selection, formats, near_factor(particles), control)?;
    control.reporter.progress(1.0);
    let far = pilot_at(scene, selection, formats, near.factor * pilot::RATIO, control)?;
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
    let memory = peak_memory(scene, particles, Some(early.grids), with_outputs) + beside.memory();
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
        cache: found.cache + beside.cache(),
        meshes: found.meshes,
        seconds: work / pace + beside.seconds(),
        surface_seconds: found.surfacing / pace,
        cpu_seconds: sample.busy.map(|_| work),
        uncertainty: uncertainty(&found, &check),
        threads: par::threads(),
        calibration_seconds: clock.wall(),
        smoke: beside.smoke,
        sheets: beside.sheets,
        remarks: told,
    })
}

/// What a shot has but for a liquid.
struct Beside {
    smoke: Option<SmokePlan>,
    sheets: Option<SheetsPlan>,
}

impl Beside {
    /// Takes out what pilots see of sheets that run with the liquid.
    fn leave_sheets_to_pilots(&mut self) {
        if let Some(sheets) = &mut self.sheets {
            (sheets.seconds, sheets.cache) = (0.0, 0.0);
        }
    }

    /// Peak memory, of which each system's own holds the program too [bytes].
    fn memory(&self) -> u64 {
        let smoke = self.smoke.as_ref().map_or(0, |smoke| smoke.memory[0].max(smoke.memory[1]));
        let sheets = self.sheets.as_ref().map_or(0, |sheets| sheets.memory);
        smoke + sheets
    }

    /// The cached frames [bytes].
    fn cache(&self) -> f64 {
        let smoke = self.smoke.as_ref().map_or(0.0, |smoke| smoke.cache);
        smoke + self.sheets.as_ref().map_or(0.0, |sheets| sheets.cache)
    }

    /// Wall-clock time [s].
    fn seconds(&self) -> f64 {
        let smoke = self.smoke.as_ref().map_or(0.0, |smoke| smoke.seconds.iter().sum());
        smoke + self.sheets.as_ref().map_or(0.0, |sheets| sheets.seconds)
    }
}

/// The plan of a shot without a liquid.
fn dry(scene: &Scene, selection: &Frames, beside: Beside, passes: Vec<String>, calibration: f64) -> Plan {
    let (memory, cache, seconds) = (beside.memory(), beside.cache(), beside.seconds());
    let Beside { smoke, sheets } = beside;
    let (smoky, clothy) = (smoke.clone().unwrap_or_default(), sheets.clone().unwrap_or_default());
    let is_named = |table: &String| {
        (smoke.is_some() && table.starts_with("smoke")) || (sheets.is_some() && table.starts_with("sheets"))
    };
    Plan {
        title: scene.title.clone(),
        frames: selection.clone(),
        frames_simulated: u64::from(selection.last().0 - scene.frames.first().0),
        frames_stored: selection.count(),
        particles: 0,
        passes,
        absent: scene.absent_tables().into_iter().filter(is_named).collect(),
        substeps: smoky.substeps.max(clothy.substeps),
        iterations: clothy.iterations,
        voxel: None,
        bricks: 0.0,
        memory,
        cache,
        meshes: 0.0,
        seconds,
        surface_seconds: 0.0,
        cpu_seconds: None,
        uncertainty: SMOKE_UNCERTAINTY,
        threads: par::threads(),
        calibration_seconds: calibration,
        remarks: [smoky.remarks, clothy.remarks].concat(),
        smoke,
        sheets,
    }
}

/// By how much the time of smoke may be off.
const SMOKE_UNCERTAINTY: f64 = 0.5;

/// A guess, on the safe side, of what smoke takes beside the rest, by what it begins with and what emitters add [bytes].
fn smoke_bound(scene: &Scene, seeds: Option<&SmokeSeeds>) -> u64 {
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
