//! What a surface of particles would take, without making it.

use super::{
    bricks::bricks_around,
    memory::{MemoryEstimate, estimated_memory},
    spacing,
};
use crate::{
    frame::Stream,
    grid::BRICK_NODES,
    math::Vec3,
    mesh::{RadiusScales, SurfaceError, SurfaceParams, positions},
};

/// Part of a voxel by which a box may be too long because coordinates are rounded.
const ROUNDING: f64 = 1e-3;

/// Box, spacing, grid and memory of the particles of a frame.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SurfaceBounds {
    pub(crate) particles: usize,
    /// Corners of the box around the particles [m]; `None` without particles.
    pub(crate) corners: Option<[Vec3; 2]>,
    /// Spacing by the distances between neighbours [m]; `None` if too few differ.
    pub(crate) estimated_spacing: Option<f32>,
    /// What the grid takes with the given spacing, or else the estimated one; `None` without either.
    pub(crate) grid: Option<GridBounds>,
}

/// What the grid of a surface takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct GridBounds {
    /// Edge of a voxel [m].
    pub(crate) voxel: f32,
    /// Voxels along the box with the kernels around it.
    pub(crate) size: [u64; 3],
    /// Voxels within the kernels of particles, at most.
    pub(crate) voxels: u64,
    /// Memory of making the surface.
    pub(crate) memory: MemoryEstimate,
    /// Whether the spacing is the estimated one.
    pub(crate) is_spacing_estimated: bool,
}

/// The bounds of the surface of `particles` that are `spacing` [m] apart at rest, if that is known. Coarse nodes that take more
/// than `affordable` [bytes] are not sampled for the estimate of memory.
///
/// # Errors
/// If positions, or radii that are requested, are missing, or positions are not finite.
pub(crate) fn surface_bounds(
    particles: &Stream,
    spacing: Option<f32>,
    params: &SurfaceParams,
    affordable: u64,
) -> Result<SurfaceBounds, SurfaceError> {
    let positions = positions(particles)?;
    let corners = positions.first().map(|&first| {
        let grow = |[low, high]: [Vec3; 2], x: &Vec3| [low.inf(x), high.sup(x)];
        positions.iter().fold([first; 2], grow)
    });
    let estimated_spacing = spacing::estimated_spacing(positions);
    let grid_of = |given: f32, [low, high]: [Vec3; 2]| -> Result<GridBounds, SurfaceError> {
        let radii = RadiusScales::of(particles, given, params)?;
        let largest = radii.as_ref().map_or(1.0, RadiusScales::largest);
        let scales = radii.as_ref().map(|radii| &*radii.values);
        let (voxel, reach) = (params.voxel * given, f64::from(params.kernel_radius * largest * given));
        let along =
            |axis: usize| (f64::from(high[axis]) - f64::from(low[axis]) + 2.0 * reach) / f64::from(voxel);
        Ok(GridBounds {
            voxel,
            size: [0, 1, 2].map(|axis| (along(axis) - ROUNDING).ceil() as u64),
            voxels: (bricks_around(positions, scales, given, params) * BRICK_NODES) as u64,
            memory: estimated_memory(particles, given, params, affordable),
            is_spacing_estimated: spacing.is_none(),
        })
    };
    let grid = match spacing.or(estimated_spacing).zip(corners) {
        Some((given, corners)) => Some(grid_of(given, corners)?),
        None => None,
    };
    Ok(SurfaceBounds { particles: particles.len(), corners, estimated_spacing, grid })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::StreamKind;

    fn stream(positions: Vec<Vec3>) -> Stream {
        Stream::new("particles", StreamKind::Particles, positions.len()).with("position", positions)
    }

    fn seeding_lattice(n: [i32; 3], spacing: f32) -> Vec<Vec3> {
        let index = |i: i32| [i % n[0], i / n[0] % n[1], i / (n[0] * n[1])];
        (0..n.iter().product()).map(|i| Vec3::from(index(i).map(|v| v as f32)) * spacing).collect()
    }

    #[test]
    fn box_and_grid_are_those_of_the_particles() {
        let params = SurfaceParams::default();
        let particles = stream(seeding_lattice([21, 11, 5], 0.1));
        let found = surface_bounds(&particles, Some(0.1), &params, 1 << 30).unwrap();
        let [low, high] = found.corners.unwrap();
        assert!(low == Vec3::zeros() && (high - Vec3::new(2.0, 1.0, 0.4)).norm() < 1e-5);
        let grid = found.grid.unwrap();
        // Two spacings of kernel on each side, at a voxel of half a spacing.
        assert_eq!(grid.size.map(|count| count / 2), [24, 14, 8]);
        assert!(grid.voxels >= grid.size.iter().product() && grid.memory.bytes > 0, "{grid:?}");
        let coarse = SurfaceParams { voxel: 1.0, ..params.clone() };
        let coarse = surface_bounds(&particles, Some(0.1), &coarse, 1 << 30).unwrap().grid.unwrap();
        assert!(coarse.voxels < grid.voxels && coarse.memory.bytes < grid.memory.bytes);
        let none = surface_bounds(&stream(Vec::new()), Some(0.1), &params, 1 << 30).unwrap();
        assert_eq!((none.corners, none.grid, none.particles), (None, None, 0));
    }
}
