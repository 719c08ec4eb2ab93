//! The surface mesh: of particles, and of level sets that other programs wrote.

mod bounds;
mod bricks;
mod folder;
mod level_set;
mod log;
pub(super) mod memory;
mod product;
mod solids;
mod spacing;
mod tradeoff;
mod writer;

pub(crate) use bounds::{GridBounds, SurfaceBounds, surface_bounds};
pub(crate) use bricks::bricks_around;
pub(super) use folder::SurfaceMesh;
pub use memory::stream_memory;

#[cfg(test)]
pub(crate) use memory::surface_memory;
