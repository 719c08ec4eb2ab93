//! The bricks of a density, counted before they are made.

use crate::{
    grid::{BRICK, Bricks, bricks_in_boxes},
    math::Vec3,
    mesh::SurfaceParams,
    par,
};

/// An upper bound of the bricks of the density of particles at `positions` [m], with kernels of these `scales`: every brick that
/// the box around a kernel meets.
pub(crate) fn bricks_around(
    positions: &[Vec3],
    scales: Option<&[f32]>,
    spacing: f32,
    params: &SurfaceParams,
) -> usize {
    let voxel = params.voxel * spacing;
    let radius = params.kernel_radius * spacing;
    // The first and the last node of each axis that a kernel reaches, and their bricks.
    let brick = |node: f32| (node as i32).div_euclid(BRICK as i32);
    let around = |i: usize| {
        let reach = radius * scales.map_or(1.0, |scales| scales[i]);
        let at = |axis: usize, side: f32| (positions[i][axis] + side * reach) / voxel;
        [
            [0, 1, 2].map(|axis| brick(at(axis, -1.0).ceil())),
            [0, 1, 2].map(|axis| brick(at(axis, 1.0).floor())),
        ]
    };
    let of_chunk = |range: std::ops::Range<usize>| bricks_in_boxes(range.map(around).collect());
    Bricks::new(par::map_chunks(positions.len(), PARTICLES_PER_CHUNK, of_chunk).concat()).len()
}

/// Particles whose bricks are found together. Larger, and fewer threads have work; smaller, and a brick is found by more
/// chunks.
const PARTICLES_PER_CHUNK: usize = 4096;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::{DensityParams, density};

    #[test]
    fn bricks_are_counted_before_they_are_made() {
        let spacing = 0.1;
        let grid = |n: i32, step: f32| -> Vec<Vec3> {
            let point = |i: i32| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * step;
            (0..n * n * n).map(point).collect()
        };
        for (positions, voxel) in
            [(grid(20, 0.1), 0.5), (grid(20, 0.1), 0.2), (grid(12, 1.37), 0.5), (Vec::new(), 0.5)]
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
            let counted = bricks_around(&positions, None, spacing, &params);
            assert!(made <= counted && counted <= made * 5 / 4, "{counted} counted, {made} made");
        }
    }
}
