//! What a shot will need, before it starts.

use super::{Reporter, RunError, remarks, simulate::world, solids};
use crate::{
    export::MeshFormat,
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
pub fn estimate(
    scene: &Scene,
    selection: &Frames,
    with_outputs: bool,
    reporter: &dyn Reporter,
) -> Result<Estimate, RunError> {
    let scene = &solids::fill(scene, None, reporter)?;
    let simulation = Simulation::new(world(scene), scene.liquid.clone())?;
    let particles = simulation.seeded().particles as usize;
    let meshes: &[MeshFormat] = if with_outputs { &scene.output.mesh } else { &[] };
    let count = particles as u64;
    let surface = if meshes.is_empty() { 0 } else { surface_bytes(count, scene.surface.voxel) };
    let mesh_files: u64 = meshes.iter().map(|&format| mesh_bytes(count, scene.surface.voxel, format)).sum();
    Ok(Estimate {
        particles,
        passes: simulation.passes(),
        memory: BASE_BYTES + (count * SIMULATION_BYTES).max(surface),
        disk: selection.count().saturating_mul(count * CACHE_BYTES + mesh_files),
        remarks: remarks::of_seeding(&simulation.seeded()),
    })
}

// The figures below are peaks of resident memory and sizes of files, measured on one machine with two cores for
// dam-break (8 000, 29 800 and 101 600 particles) and drop-in-pool (9 600, 35 300 and 98 900): at the start, and with
// 30 000 to 35 000 particles at frames 13, 25 and 37 too. They are set above the largest: an estimate that is too
// small lets a farm kill the job, one that is much too large refuses a shot that would have run.

/// The program and its threads: 6 to 7 MiB were measured.
const BASE_BYTES: u64 = 8 << 20;

/// Memory of the liquid, a particle: 690 to 740 were measured at the start; over 40 to 60 frames 930 and 1010 with
/// 30 000 particles, 1160 with 100 000. Most of it is neighbour lists, which are longest where the liquid piles up.
const SIMULATION_BYTES: u64 = 1200;

/// A cached frame, a particle: 15 to 22 were measured, the most once the liquid is in motion.
const CACHE_BYTES: u64 = 24;

/// Memory for surfacing, beside the frame's own. Measured a particle, when the liquid is most spread: 530 and 660 at
/// voxel 0.5, 2600 and 3300 at 0.25, so it grows with the power 2.3 of the resolution: the bricks follow the surface,
/// the samples in them the volume. A calm pool needs a third.
fn surface_bytes(particles: u64, voxel: f32) -> u64 {
    (particles as f64 * 140.0 / f64::from(voxel).powf(2.3)) as u64
}

/// Mesh files of one format: triangles grow with the square of the resolution. Measured a particle, when the liquid
/// is most spread: 140 and 167 in PLY at voxel 0.5, 535 and 650 at 0.25; 394 in OBJ at 0.5.
fn mesh_bytes(particles: u64, voxel: f32, format: MeshFormat) -> u64 {
    let in_spacings = match format {
        MeshFormat::Ply => 42.0,
        MeshFormat::Obj => 100.0,
    };
    (particles as f64 * in_spacings / f64::from(voxel).powi(2)) as u64
}
