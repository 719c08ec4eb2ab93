//! The folder of surface meshes.

use super::{
    log::{self, MESH_FOLDER},
    spacing::spacing_warnings,
};
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

    fn finish(&self, out: &ShotFolder) -> Result<Vec<String>, RunError> {
        let records = log::read(out)?;
        let jumps = log::jumps(&records).into_iter().map(|jump| format!("jump: {jump}"));
        let warnings = spacing_warnings(&records).into_iter().chain(log::volume_warnings(&records));
        Ok(jumps.chain(warnings).collect())
    }
}
