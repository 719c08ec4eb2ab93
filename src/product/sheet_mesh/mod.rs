//! Sheet meshes: sheets as meshes, one a frame.

mod mesh;
mod writer;

pub(in crate::product) use mesh::{MISSING_PARTS, SHEET_VERSION, sheet_mesh};
pub(super) use writer::SheetMesh;
pub(in crate::product) use writer::{POINT_BYTES, export_arguments};
