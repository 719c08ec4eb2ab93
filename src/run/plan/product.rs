//! What jobs make of particles, and the memory that takes.

use super::{
    bricks::bricks_around,
    memory::{self, Grids},
};
use crate::{
    field::{DensityParams, bricks_near_surface, coarse_step},
    frame::Stream,
    grid::BRICK_NODES,
    mesh::{DistanceParams, SurfaceParams},
    run::RunError,
};

/// What is made of particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::run) enum Product {
    /// Surface meshes.
    Meshes,
    /// Volume files.
    Volumes,
    /// Tracers as points.
    Points,
    /// Sheets as meshes.
    Sheets,
}

impl Product {
    /// What it is called where jobs are told.
    pub(in crate::run) fn name(self) -> &'static str {
        match self {
            Self::Meshes => "mesh",
            Self::Volumes => "volume",
            Self::Points => "points",
            Self::Sheets => "sheet",
        }
    }

    /// The memory that making it of `particles` takes [bytes].
    fn memory(self, particles: usize, grids: Grids, params: &SurfaceParams) -> u64 {
        match self {
            Self::Meshes => memory::surface(particles, grids, params),
            Self::Volumes => memory::volume(particles, grids),
            Self::Points => memory::smoke(0.0, particles as f64),
            Self::Sheets => memory::sheets(particles, [false; 2]),
        }
    }
}

/// The memory that making `product` of a stream will need, by where its particles are [bytes]: a bound if that is not above
/// `enough`, else an estimate that takes longer.
pub(in crate::run) fn stream_memory(
    product: Product,
    stream: &Stream,
    spacing: f32,
    params: &SurfaceParams,
    enough: u64,
) -> u64 {
    if matches!(product, Product::Points | Product::Sheets) {
        return product.memory(stream.len(), Grids::default(), params);
    }
    let positions = stream.vec3("position").unwrap_or_default();
    let bricks = bricks_around(positions, spacing, params);
    let bound = product.memory(stream.len(), Grids::of_bricks(bricks as f64), params);
    if bound <= enough || product == Product::Volumes {
        return bound;
    }
    let SurfaceParams { voxel, kernel_radius, .. } = *params;
    let density = DensityParams { spacing, kernel_radius, voxel, anisotropy: None, whole: false };
    // Surfacing samples the density on coarse bricks first: without room for those there is none for the rest.
    let coarse = SurfaceParams { voxel: voxel * coarse_step(&density) as f32, ..params.clone() };
    let coarse = bricks_around(positions, spacing, &coarse) * BRICK_NODES * size_of::<f32>();
    if coarse as u64 > enough {
        return bound;
    }
    let bricks = bricks as f64;
    let near = bricks_near_surface(positions, &density).map_or(bricks, |near| near as f64 * OPENED);
    product.memory(stream.len(), Grids::of_bricks(near.min(bricks)), params)
}

/// Bricks that are computed over those that were taken to be near the surface at first: 1.00 to 1.05 on splashes and sprays.
const OPENED: f64 = 1.05;

/// The most memory that making `product` of `particles` was seen to take [bytes].
pub(in crate::run) fn most_memory(product: Product, particles: usize, params: &SurfaceParams) -> u64 {
    let near = Grids::at_most(particles, params.voxel);
    let grids = match product {
        Product::Meshes | Product::Points | Product::Sheets => near,
        Product::Volumes => near.with_inside(particles, params.voxel),
    };
    product.memory(particles, grids, params)
}

/// The memory that reading and meshing a level set of so many bricks takes, at most [bytes]: that of a surface by distances,
/// whose density and distance take what the file and its tree do.
pub(in crate::run) fn level_set_memory(bricks: usize) -> u64 {
    let params = SurfaceParams { distance: Some(DistanceParams::default()), ..SurfaceParams::default() };
    memory::surface(0, Grids::of_bricks(bricks as f64), &params)
}

/// Refuses what needs more than `allowed` bytes.
pub(in crate::run) fn refuse_memory(needed: u64, allowed: u64) -> Result<(), RunError> {
    if needed > allowed { Err(RunError::OverMemory { needed, allowed }) } else { Ok(()) }
}
