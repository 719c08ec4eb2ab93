//! Meshes and volumes as files that other tools open.
//!
//! A file appears under its name whole or not at all (see `src/cache/atomic.rs`); an older file of
//! that name stays until then.

mod error;
mod format;
mod key;
#[cfg(feature = "npz")]
pub(crate) mod npz;
pub mod obj;
pub mod pc2;
pub mod ply;
pub mod usd;
pub mod vdb;

pub use error::ExportError;
pub use format::{MeshFormat, SheetFormat};
