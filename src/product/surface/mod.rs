//! The surface mesh: of particles, and of level sets that other programs wrote.

mod bricks;
mod folder;
mod level_set;
mod log;
mod memory;
mod product;
mod writer;

pub(crate) use bricks::bricks_around;
pub(super) use folder::SurfaceMesh;
pub(crate) use memory::{max_surface_memory, stream_memory, surface_memory};
