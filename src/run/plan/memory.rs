//! How much memory a shot needs: every constant of the model, in one place.
//!
//! *Method*: peaks of resident memory of whole runs, by particles and bricks. `tests/cli/plan.rs` compares the model
//! with the peak of real runs and fails when a solver outgrows it or leaves it far above.

use crate::{
    grid::{BRICK, Bricks},
    math::Vec3,
    mesh::SurfaceParams,
    par,
};
use std::ops::Range;

/// The program and its threads: 6 to 7 MiB were measured.
const BASE: f64 = 8e6;

/// Memory of the simulation, a particle, at `kernel_radius` 2 and the densest state of a shot. Less would let a farm
/// kill the job, more refuses a shot that would have run.
const PARTICLE: f64 = 460.0;

/// The part of it that the neighbour lists take: it grows with the volume of the kernel.
const LISTS: f64 = 230.0;

/// Memory of surfacing, a brick of the density: the nodes of density and distance, and the triangles.
const BRICK_BYTES: f64 = 10000.0;

/// The part of the simulation's peak that the process still holds while it makes surfaces: the allocator keeps freed memory.
/// Over three presets it was 0.4 to 0.8.
pub(super) const KEPT: f64 = 0.6;

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
    (BASE + particles as f64 * SURFACED + bricks * BRICK_BYTES) as u64
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

/// The bricks of the density of particles at `positions` [m], at most: every brick that the box around a kernel meets.
pub(super) fn bricks_around(positions: &[Vec3], spacing: f32, params: &SurfaceParams) -> usize {
    let voxel = params.voxel * spacing;
    let reach = params.kernel_radius * spacing;
    // The first and the last node of each axis that a kernel reaches, and their bricks.
    let first = |v: f32| ((v - reach) / voxel).ceil() as i32;
    let last = |v: f32| ((v + reach) / voxel).floor() as i32;
    let brick = |node: i32| node.div_euclid(BRICK as i32);
    let of_chunk = |range: Range<usize>| {
        let bounds = positions[range]
            .iter()
            .map(|x| [0, 1, 2].map(|axis| (brick(first(x[axis])), brick(last(x[axis])))));
        let mut bounds: Vec<[(i32, i32); 3]> = bounds.collect();
        bounds.sort_unstable();
        bounds.dedup();
        let mut bricks = Vec::new();
        for [x, y, z] in bounds {
            for k in z.0..=z.1 {
                for j in y.0..=y.1 {
                    bricks.extend((x.0..=x.1).map(|i| [i, j, k]));
                }
            }
        }
        bricks.sort_unstable();
        bricks.dedup();
        bricks
    };
    Bricks::new(par::map_chunks(positions.len(), CHUNK, of_chunk).concat()).len()
}

/// Particles whose bricks are sought together. Larger, and the widest kernels of so many particles take hundreds of
/// MiB; smaller, and a brick is found by more chunks.
const CHUNK: usize = 4096;

/// Bricks a particle at a voxel of one spacing. The power 2.3 lies between that of a surface and that of a volume:
/// bricks follow the surface, the samples in them the volume.
const SPREAD: f64 = 0.013;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{DensityParams, density};

    #[test]
    fn bricks_are_counted_before_they_are_made() {
        let spacing = 0.1;
        let lattice = |n: i32, apart: f32| -> Vec<Vec3> {
            let point = |i: i32| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * apart;
            (0..n * n * n).map(point).collect()
        };
        for (positions, voxel) in
            [(lattice(20, 0.1), 0.5), (lattice(20, 0.1), 0.2), (lattice(12, 1.37), 0.5), (Vec::new(), 0.5)]
        {
            let params = SurfaceParams { voxel, ..SurfaceParams::default() };
            let kernel_radius = params.kernel_radius;
            let made = density(
                &positions,
                &DensityParams { spacing, kernel_radius, voxel, anisotropy: None, whole: true },
            )
            .grid
            .bricks
            .len();
            let counted = bricks_around(&positions, spacing, &params);
            assert!(made <= counted && counted <= made * 5 / 4, "{counted} counted, {made} made");
        }
    }
}
