//! The bricks of a density, counted before they are made.

use crate::{
    grid::{BRICK, Bricks},
    math::Vec3,
    mesh::SurfaceParams,
    par,
};
use std::ops::Range;

/// An upper bound of the bricks of the density of particles at `positions` [m]: every brick that the box around a kernel meets.
pub(crate) fn bricks_around(positions: &[Vec3], spacing: f32, params: &SurfaceParams) -> usize {
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
        let (mut bricks, mut full) = (Vec::new(), LIST_CAPACITY);
        for [x, y, z] in bounds {
            for k in z.0..=z.1 {
                for j in y.0..=y.1 {
                    bricks.extend((x.0..=x.1).map(|i| [i, j, k]));
                }
            }
            // The widest kernels of particles side by side meet the same bricks.
            if bricks.len() > full {
                bricks.sort_unstable();
                bricks.dedup();
                full = bricks.len().max(LIST_CAPACITY) + LIST_CAPACITY;
            }
        }
        bricks.sort_unstable();
        bricks.dedup();
        bricks
    };
    Bricks::new(par::map_chunks(positions.len(), PARTICLES_PER_CHUNK, of_chunk).concat()).len()
}

/// Particles whose bricks are found together. Larger, and fewer threads have work; smaller, and a brick is found by more
/// chunks.
const PARTICLES_PER_CHUNK: usize = 4096;

/// Bricks that are listed before duplicates are removed. Larger, and the list takes more memory than it estimates;
/// smaller, and it is sorted more often.
const LIST_CAPACITY: usize = 1 << 20;

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
            let counted = bricks_around(&positions, spacing, &params);
            assert!(made <= counted && counted <= made * 5 / 4, "{counted} counted, {made} made");
        }
    }
}
