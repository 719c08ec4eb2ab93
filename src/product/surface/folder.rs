//! The folder of surface meshes.

use super::log::{self, LOG_FILE, MESH_FOLDER};
use crate::{
    job::{
        RunError, ShotFolder,
        batch::{BatchSummary, ProductFolder},
    },
    product::mesh_files::mesh_summary,
};

/// The surface mesh, as jobs see it.
pub(in crate::product) struct SurfaceMesh;

impl ProductFolder for SurfaceMesh {
    fn name(&self) -> &'static str {
        MESH_FOLDER
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        mesh_summary(batch)
    }

    fn log_file(&self) -> Option<&'static str> {
        Some(LOG_FILE)
    }

    fn finish(&self, out: &ShotFolder) -> Result<Vec<String>, RunError> {
        log::compact(out)?;
        let records = log::read(out)?;
        let jumps = log::jumps(&records).into_iter().map(|jump| format!("jump: {jump}"));
        Ok(jumps.chain(log::volume_warnings(&records)).collect())
    }
}
