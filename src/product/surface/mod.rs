//! The surface mesh: of particles, and of level sets that other programs wrote.

mod bricks;
mod folder;
mod level_set;
mod log;
mod memory;
mod writer;

pub(crate) use bricks::bricks_around;
use folder::SurfaceFolder;
pub use level_set::mesh_level_sets;
pub use log::{Jump, MeshRecord};
pub(crate) use log::{jumps as mesh_jumps, read as read_mesh_log};
pub(crate) use memory::{max_surface_memory, stream_memory, surface_memory};
pub use writer::{SurfaceSettings, surface};
