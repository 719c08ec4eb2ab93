//! What a shot will need, before it starts.
//!
//! Numbers of elements at the start and passes are exact, by seeding. Everything else is forecast by each system from
//! calibration runs on this machine ([`SystemForecast`]); memory follows a model (`memory`).

mod memory;

use super::{Control, RunError, simulate, solids, usage::Meter};
use crate::{
    job::memory::refuse_memory,
    par,
    preset::Frames,
    product::{ProductSettings, RequestedProducts, is_any_requested},
    sim::{
        ElementCount, ProductForecast, Simulation, SystemForecast,
        forecast::{ForecastJob, NoProducts, ProductSampler},
        registry::{self, ALL},
        scene::Scene,
    },
};
use memory::MemoryModel;
use serde::Serialize;

/// What a shot will need.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Plan {
    /// The shot's name.
    pub title: String,
    /// The frames to store.
    pub frames: Frames,
    /// The number of frames to simulate, stored or not; the first is the start and costs nothing.
    pub frames_simulated: u64,
    /// The number of frames to store.
    pub frames_stored: u64,
    /// The passes that will run.
    pub passes: Vec<String>,
    /// The optional tables that the preset does not have, whose passes will not run.
    pub absent: Vec<String>,
    /// Each system that is present.
    pub systems: Vec<SystemForecast>,
    /// Each product that the preset requests.
    pub products: Vec<ProductForecast>,
    /// Peak memory [bytes].
    pub memory: u64,
    /// Size of the cache [bytes].
    pub cache: f64,
    /// Size of all files, the cache included [bytes].
    pub disk: f64,
    /// Wall-clock time of everything [s].
    pub seconds: f64,
    /// Relative error that the time may have [–].
    pub uncertainty: f64,
    /// Number of threads that the time is for.
    pub threads: usize,
    /// Wall-clock time of the calibration [s].
    pub calibration_seconds: f64,
    /// Limits of the calibration and what seeding left out, as messages.
    pub remarks: Vec<String>,
}

/// What is known at once, without calibration.
#[derive(Clone, Debug)]
pub(crate) struct Outline {
    /// The elements of each system, with a bound of their numbers at the end.
    pub counts: Vec<(&'static str, Vec<ElementCount>)>,
    /// The passes that will run.
    pub passes: Vec<String>,
    /// A bound of the memory by the numbers of elements and the samples of meshes [bytes]: more than any built-in preset took
    /// in any tier. [`plan`] is closer.
    pub memory: u64,
    /// What seeding left out, as messages.
    pub remarks: Vec<String>,
}

/// Seeds the systems and counts their elements.
///
/// # Errors
/// If the systems cannot start as the preset defines them.
pub(crate) fn outline(scene: &Scene, with_outputs: bool, control: Control) -> Result<Outline, RunError> {
    let scene = &solids::fill(scene, None, control.reporter)?;
    let simulation = Simulation::new(scene.surroundings(), scene.systems())?;
    let seeds = simulation.seeded();
    let counts: Vec<_> = ALL.iter().map(|system| (system.name(), system.counts(scene, &seeds))).collect();
    let all: Vec<ElementCount> = counts.iter().flat_map(|(_, counts)| counts).copied().collect();
    let products = if with_outputs { RequestedProducts::max_memory(scene, &all) } else { Vec::new() };
    let systems = ALL.iter().zip(&counts).map(|(system, (_, counts))| system.memory(scene, counts)).sum();
    Ok(Outline {
        passes: passes(simulation.passes(), products.iter().map(|&(name, _)| name)),
        memory: MemoryModel::bound(scene, systems).peak(products.iter().map(|&(_, memory)| memory)),
        remarks: registry::seeding_warnings(&seeds),
        counts,
    })
}

/// Refuses a shot that needs more than `max_memory` bytes. Calibrates only if the outline alone cannot decide.
///
/// # Errors
/// [`RunError::OverMemory`], and whatever keeps the shot from starting.
pub(crate) fn refuse_over_memory(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    max_memory: u64,
    control: Control,
) -> Result<(), RunError> {
    // A few numbers define large grids: what would not fit is refused before it is built.
    refuse_memory(seeding_memory(scene), max_memory)?;
    if outline(scene, with_outputs, control)?.memory <= max_memory {
        return Ok(());
    }
    plan_within(scene, selection, with_outputs, Some(max_memory), control).map(|_| ())
}

/// Calibrates and forecasts what `shot` will need for `selection`; refuses first if it is more memory than `max_memory`.
///
/// # Errors
/// If the shot cannot start, needs too much memory or diverges at once; if cancelled.
pub(crate) fn plan(
    scene: &Scene,
    selection: &Frames,
    max_memory: Option<u64>,
    control: Control,
) -> Result<Plan, RunError> {
    max_memory.map_or(Ok(()), |limit| refuse_memory(seeding_memory(scene), limit))?;
    plan_within(scene, selection, true, max_memory, control)
}

fn plan_within(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    max_memory: Option<u64>,
    control: Control,
) -> Result<Plan, RunError> {
    simulate::check_selection(scene, selection)?;
    let scene = &solids::fill(scene, None, control.reporter)?;
    let clock = Meter::new();
    // Each system calibrates a simulation of its own: this one is not held in memory with them.
    let simulation = Simulation::new(scene.surroundings(), scene.systems())?;
    let (seeds, system_passes) = (simulation.seeded(), simulation.passes());
    drop(simulation);
    let mut remarks = registry::seeding_warnings(&seeds);
    let with_products = with_outputs && is_any_requested(&ProductSettings::of(scene));
    let samples: &dyn ProductSampler = if with_products { &RequestedProducts } else { &NoProducts };
    let job = ForecastJob { scene, selection, products: samples, max_memory, control };
    control.reporter.begin("calibrate", ALL.len());
    let (mut systems, mut memory) = (Vec::new(), 0.0);
    for (done, system) in ALL.iter().enumerate() {
        match system.forecast(&job)? {
            Some(forecast) => {
                memory += system.memory(scene, &forecast.counts);
                systems.push(forecast);
            }
            None => {
                let counts = system.counts(scene, &seeds);
                memory += system.memory(scene, &counts);
                if !counts.is_empty() {
                    systems.push(SystemForecast { name: system.name(), counts, ..SystemForecast::default() });
                }
            }
        }
        control.reporter.progress((done + 1) as f64);
    }
    control.reporter.end();
    let products = by_name(systems.iter().flat_map(|system| &system.products));
    remarks.extend(systems.iter().flat_map(|system| system.remarks.iter().cloned()));
    let memory = MemoryModel::estimate(scene, memory).peak(products.iter().map(|product| product.memory));
    max_memory.map_or(Ok(()), |limit| refuse_memory(memory, limit))?;
    let cache = systems.iter().map(|system| system.cache).sum();
    let seconds = systems.iter().map(|system| system.seconds).sum::<f64>();
    Ok(Plan {
        title: scene.title.clone(),
        frames: selection.clone(),
        frames_simulated: job.simulated() as u64,
        frames_stored: selection.count(),
        passes: passes(system_passes, products.iter().map(|product| product.name)),
        absent: scene.absent_tables(),
        memory,
        cache,
        disk: cache + products.iter().map(|product| product.bytes).sum::<f64>(),
        seconds: seconds + products.iter().map(|product| product.seconds).sum::<f64>(),
        uncertainty: systems.iter().map(|system| system.uncertainty).fold(0.0, f64::max),
        threads: par::threads(),
        calibration_seconds: clock.wall(),
        systems,
        products,
        remarks,
    })
}

/// Memory that seeding takes at least, known before it starts [bytes].
fn seeding_memory(scene: &Scene) -> u64 {
    ALL.iter().map(|system| system.seeding_memory(scene)).sum::<f64>() as u64
}

/// The passes of the simulation, then the products.
fn passes(systems: Vec<&'static str>, products: impl Iterator<Item = &'static str>) -> Vec<String> {
    let mut passes: Vec<String> = systems.into_iter().chain(products).map(String::from).collect();
    passes.dedup();
    passes
}

/// The forecasts of products with one name, added.
fn by_name<'a>(forecasts: impl Iterator<Item = &'a ProductForecast>) -> Vec<ProductForecast> {
    let mut sums: Vec<ProductForecast> = Vec::new();
    for forecast in forecasts {
        match sums.iter_mut().find(|sum| sum.name == forecast.name) {
            Some(sum) => {
                sum.bytes += forecast.bytes;
                sum.seconds += forecast.seconds;
                sum.memory = sum.memory.max(forecast.memory);
            }
            None => sums.push(forecast.clone()),
        }
    }
    sums
}
