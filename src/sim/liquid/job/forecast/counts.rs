//! Numbers of particles over a shot.

use crate::{
    frame::StreamKind,
    sim::{
        SeedReport,
        forecast::ElementCount,
        liquid::{LiquidParams, inflow::emitted_particles},
        scene::Scene,
    },
};

/// The particles of a seeded liquid at the shot's start and at its end, if nothing leaves.
pub(in crate::sim::liquid::job) fn counts(
    scene: &Scene,
    liquid: Option<&LiquidParams>,
    seeds: &SeedReport,
) -> Vec<ElementCount> {
    let emitted = |liquid: &LiquidParams| emitted_particles(liquid, scene.timeline(), scene.seconds());
    let emitted = liquid.map_or(0.0, emitted);
    let count = |start: f64| ElementCount {
        end: start + emitted,
        ..ElementCount::constant("particles", StreamKind::Particles, start)
    };
    seeds.liquid.iter().map(|seeds| count(seeds.particles.into())).collect()
}
