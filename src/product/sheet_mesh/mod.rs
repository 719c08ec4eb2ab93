//! Sheet meshes: sheets as meshes, one a frame.

mod mesh;
mod writer;

pub(in crate::product) use mesh::{MISSING_PARTS, NO_SHEETS, SHEET_VERSION, sheet_mesh};
pub use writer::sheet_meshes;
