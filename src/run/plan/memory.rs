//! How much memory a shot needs: every constant of the model, in one place.
//!
//! *Method*: peaks of resident memory of whole runs, by particles and bricks. `tests/cli/plan.rs` compares the model
//! with the peak of real runs and fails when a solver outgrows it or leaves it far above.

/// The program and its threads: 6 to 7 MiB were measured.
const BASE: f64 = 8e6;

/// Memory of the simulation, a particle, at `kernel_radius` 2 and the densest state of a shot. Less would let a farm
/// kill the job, more refuses a shot that would have run.
const PARTICLE: f64 = 460.0;

/// The part of it that the neighbour lists take: it grows with the volume of the kernel.
const LISTS: f64 = 230.0;

/// Memory of surfacing, a brick of the density: the nodes of density and distance, and the triangles.
const BRICK: f64 = 9000.0;

/// Memory of surfacing, a particle: the frame, its weights and bins.
const SURFACED: f64 = 150.0;

/// Memory of making every grid of a volume, a brick of the density: nodes of density, distance and velocity, and the
/// bytes of the file. 17 800 were measured (32 768 particles at voxel 0.5, floats, not packed).
const VOLUME_BRICK: f64 = 20000.0;

/// Peak memory of simulating `particles` with kernels of `kernel_radius` [spacings], in bytes.
pub(super) fn simulation(particles: usize, kernel_radius: f32) -> u64 {
    let lists = LISTS * (f64::from(kernel_radius) / 2.0).powi(3);
    (BASE + particles as f64 * (PARTICLE - LISTS + lists)) as u64
}

/// Peak memory of surfacing `particles` on `bricks` of the density, in bytes.
pub(super) fn surface(particles: usize, bricks: f64) -> u64 {
    (BASE + particles as f64 * SURFACED + bricks * BRICK) as u64
}

/// Peak memory of making volumes of `particles` on `bricks` of the density, in bytes.
pub(super) fn volume(particles: usize, bricks: f64) -> u64 {
    (BASE + particles as f64 * SURFACED + bricks * VOLUME_BRICK) as u64
}

/// The most bricks that `particles` cover at a voxel of `voxel` [spacings], before anything is known of how they lie:
/// measured over whole shots, 0.066 a particle at voxel 0.5 when the liquid is most spread.
pub(super) fn bricks_at_most(particles: usize, voxel: f32) -> f64 {
    particles as f64 * SPREAD / f64::from(voxel).powf(2.3)
}

/// Bricks a particle at a voxel of one spacing. The power 2.3 lies between that of a surface and that of a volume:
/// bricks follow the surface, the samples in them the volume.
const SPREAD: f64 = 0.013;
