//! The folder of surface meshes.

use super::log::{self, MESH_FOLDER, MeshRecord};
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

/// Reports, of each stream, a spacing that does not fit the particles of at least half of the frames. Records are sorted by
/// stream.
fn spacing_warnings(records: &[MeshRecord]) -> Vec<String> {
    let warning = |series: &[MeshRecord]| {
        let known = || series.iter().filter_map(|record| Some((record, record.neighbours?)));
        let off = || known().filter_map(|(record, neighbours)| Some((record, neighbours.finding()?)));
        let (first, finding) = off().next()?;
        let (count, all) = (off().count(), known().count());
        (2 * count >= all).then(|| {
            format!(
                "spacing: in frame {} of {}, {finding} ({count} of {all} frames)",
                first.frame, first.name
            )
        })
    };
    records.chunk_by(|a, b| a.name == b.name).filter_map(warning).collect()
}
