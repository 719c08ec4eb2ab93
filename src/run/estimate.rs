//! What a shot will need, before it starts.

use super::{RunError, remarks, simulate::world};
use crate::{
    scene::{Frames, Scene},
    sim::Simulation,
};

/// What a shot will need.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Particles at the start.
    pub particles: usize,
    /// The passes that will run; a term that the preset does not name has none.
    pub passes: Vec<&'static str>,
    /// Peak memory [bytes].
    pub memory: u64,
    /// Cache and meshes [bytes].
    pub disk: u64,
    /// What the sources had to leave out.
    pub remarks: Vec<String>,
}

/// Estimates memory and disk from the number of particles, by figures measured on the built-in presets.
///
/// # Errors
/// If the systems cannot start as the preset says.
pub fn estimate(scene: &Scene, selection: &Frames, with_outputs: bool) -> Result<Estimate, RunError> {
    let simulation = Simulation::new(world(scene), scene.liquid.clone())?;
    let particles = simulation.seeded().particles as usize;
    let meshes = with_outputs && !scene.output.mesh.is_empty();
    let count = particles as u64;
    let surface = if meshes { surface_bytes(count, scene.surface.voxel) } else { 0 };
    let frames = selection.count();
    Ok(Estimate {
        particles,
        passes: simulation.passes(),
        memory: BASE_BYTES + (count * SIMULATION_BYTES).max(surface),
        disk: frames * count * CACHE_BYTES
            + if meshes { frames * mesh_bytes(count, scene.surface.voxel) } else { 0 },
        remarks: remarks::of_seeding(&simulation.seeded()),
    })
}

/// The program and its threads.
const BASE_BYTES: u64 = 16 << 20;

/// Memory of the liquid, a particle.
const SIMULATION_BYTES: u64 = 450;

/// A cached frame, a particle.
const CACHE_BYTES: u64 = 24;

/// Memory for surfacing: nodes per particle grow with the cube of the resolution.
fn surface_bytes(particles: u64, voxel: f32) -> u64 {
    (particles as f64 * 100.0 / f64::from(voxel.powi(3)).max(1e-6)) as u64
}

/// Mesh files: triangles grow with the square of the resolution.
fn mesh_bytes(particles: u64, voxel: f32) -> u64 {
    (particles as f64 * 20.0 / f64::from(voxel.powi(2)).max(1e-6)) as u64
}
