//! Forecast of the liquid: two coarser pilots of all frames, and the shot's own start.

mod counts;
mod pilot;
mod power_law;
mod start;

use super::{report::record_totals, volume};
use crate::math::elementary::ln;
use crate::{
    job::{RunError, Total, memory::refuse_memory},
    sim::{
        Simulation,
        forecast::{ForecastJob, ProductForecast, SystemForecast, failures},
        liquid::{LiquidParams, NAME},
        scene::Scene,
    },
    solid::Collider,
};
pub(super) use counts::counts;
use pilot::{Pilot, RATIO, near_factor, pilot_at};
use power_law::{Shot, forecast as extrapolate};
use start::Start;

/// Memory of simulating [bytes/particle], at `kernel_radius` 2 and the densest state of a shot. Less would let a farm
/// kill the job, more refuses a shot that would have run. Shots of 30 000 to 130 000 particles are met within 7 %; five
/// million took 380.
const PARTICLE_BYTES: f64 = 484.0;

/// The part of it that the neighbour lists take: it grows with the volume of the kernel.
const NEIGHBOR_BYTES: f64 = 230.0;

/// Buffers of the viscous solve [bytes/particle].
const VISCOSITY_BYTES: f64 = 100.0;

/// Buffers of the surface tension [bytes/particle].
const TENSION_BYTES: f64 = 60.0;

/// Displacements by solids and velocities before the density solve [bytes/particle], if a collider has friction or restitution.
const FRICTION_BYTES: f64 = 24.0;

/// Microrotation and buffers of its exchange [bytes/particle].
const MICROPOLAR_BYTES: f64 = 64.0;

/// Projections by solids, and pairs of particles and rigid bodies with what is evaluated at them and what their neighbours read; pairs exist
/// twice while they are found [bytes/particle].
const BODY_BYTES: f64 = 12.0 + 4.0 + 2.0 * 68.0 + 88.0 + 48.0 + 4.0;

/// Lists of images, 6 to 12 at each particle, which exist twice while they are found [bytes/particle]: they grow with the volume of the kernel.
const IMAGE_LIST_BYTES: f64 = 2.0 * 12.0 * 4.0;

/// Viscous drag between particles and rigid bodies, of which the list exists twice while it is assembled [bytes/particle].
const VISCOUS_BODY_BYTES: f64 = 4.0 + 2.0 * 44.0;

/// What forces do to each particle [bytes/particle].
const FORCE_BYTES: f64 = 40.0;

/// The smallest uncertainty that is stated: see the figures in docs/plan.md.
const MIN_UNCERTAINTY: f64 = 0.25;

/// Memory of so many particles [bytes].
pub(super) fn memory(scene: &Scene, liquid: &LiquidParams, particles: f64) -> f64 {
    let kernel_volume = (f64::from(liquid.kernel_radius) / 2.0).powi(3);
    let neighbors = NEIGHBOR_BYTES * kernel_volume;
    let viscosity = if liquid.viscosity.is_some() { VISCOSITY_BYTES } else { 0.0 };
    let tension = if liquid.surface_tension.is_some() { TENSION_BYTES } else { 0.0 };
    let micropolar = if liquid.micropolar.is_some() { MICROPOLAR_BYTES } else { 0.0 };
    let rough = scene.world.collider.iter().any(Collider::has_friction_or_restitution)
        || scene.body.iter().any(|body| body.liquid_friction.is_some());
    let friction = if rough { FRICTION_BYTES } else { 0.0 };
    let forces = if scene.force.is_empty() { 0.0 } else { FORCE_BYTES };
    let bodies = if scene.body.is_empty() { 0.0 } else { BODY_BYTES + IMAGE_LIST_BYTES * kernel_volume };
    let has_viscous_bodies = liquid.viscosity.is_some() && !scene.body.is_empty();
    let viscous_bodies = if has_viscous_bodies { VISCOUS_BODY_BYTES } else { 0.0 };
    let terms = viscosity + tension + micropolar + friction + forces + bodies + viscous_bodies;
    particles * (PARTICLE_BYTES - NEIGHBOR_BYTES + neighbors + terms)
}

/// Forecasts a liquid, and what is advanced together with it.
///
/// # Errors
/// As [`System::forecast`](crate::sim::system::System::forecast).
pub(super) fn forecast(job: &ForecastJob, liquid: &LiquidParams) -> Result<SystemForecast, RunError> {
    let simulation = Simulation::new(job.scene.surroundings(), job.scene.systems_sharing_substeps())?;
    let counts = counts(job.scene, Some(liquid), &simulation.seeded());
    let particles = counts.iter().map(|count| count.end as usize).sum();
    let shot = Shot::new(job, liquid, particles);

    let near = pilot_at(job, near_factor(particles))?;
    let far = pilot_at(job, near.factor * RATIO)?;
    let early = extrapolate(&shot, &near, [&near, &far], &Start::default());
    if let Some(limit) = job.max_memory {
        let products = early.products.iter().map(|product| product.memory).fold(0.0, f64::max);
        refuse_memory(memory(job.scene, liquid, particles as f64).max(products) as u64, limit)?;
    }

    let product_seconds = early.products.iter().map(|product| product.seconds).sum::<f64>();
    let start = start::run(job, simulation, product_seconds / job.stored() as f64)?;
    let found = extrapolate(&shot, &near, [&near, &far], &start);
    let check = extrapolate(&shot, &far, [&near, &far], &start);
    let busy = start.busy.filter(|&busy| busy > 0.0).unwrap_or(1.0);
    let in_wall_clock_time = |product: ProductForecast| {
        let seconds = product.seconds / busy;
        ProductForecast { seconds, ..product }
    };
    Ok(SystemForecast {
        name: NAME,
        counts,
        substeps: found.substeps,
        iterations: found.iterations,
        cache: found.cache,
        seconds: found.work / busy,
        uncertainty: ln(found.work / check.work).abs().max(MIN_UNCERTAINTY),
        products: found.products.into_iter().map(in_wall_clock_time).collect(),
        totals: totals(&near),
        remarks: [
            volume::warning(liquid, &near.records)
                .map(|why| format!("in the calibration, {why}"))
                .into_iter()
                .collect(),
            near.remarks,
            far.remarks,
            failures(near.products.iter().flatten()),
        ]
        .concat(),
    })
}

/// Compression, dilation and volume over the frames of a pilot.
fn totals(pilot: &Pilot) -> Vec<Total> {
    let place = match pilot.factor {
        1.0 => "calibration: ".into(),
        factor => format!("calibration with {factor:.1} times the spacing: "),
    };
    let named = |total: Total| Total { text: place.clone() + &total.text, ..total };
    record_totals(&pilot.records).into_iter().map(named).collect()
}
