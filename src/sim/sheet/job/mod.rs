//! What jobs need to know of the sheets.

pub(crate) mod check;
mod report;

use super::SheetShape;
use crate::{
    frame::StreamKind,
    job::Total,
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        scene::Scene,
        system::{CachedFrame, System, mesh_file},
    },
};

/// The sheets, as jobs see them.
pub(crate) struct Sheets;

impl System for Sheets {
    fn is_present(&self, scene: &Scene) -> bool {
        !scene.sheet.is_empty()
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::MeshPoints, StreamKind::MeshFaces]
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check_sheets(scene, places, findings);
    }

    fn mesh_files<'a>(&self, scene: &'a Scene) -> Vec<(String, &'a str)> {
        let sheets = scene.sheet.iter().enumerate().filter_map(|(i, sheet)| match &sheet.shape {
            SheetShape::Mesh(mesh) => Some((format!("sheet.{i}.shape.mesh"), mesh.file.as_str())),
            SheetShape::Grid { .. } => None,
        });
        check::shapes(scene).filter_map(mesh_file).chain(sheets).collect()
    }

    fn seeding_warnings(&self, seeds: &SeedReport) -> Vec<String> {
        seeds.sheets.as_ref().map(report::seeding_warnings).unwrap_or_default()
    }

    fn progress(&self, record: &FrameRecord) -> Option<String> {
        record.sheets.as_ref().map(report::progress)
    }

    fn warnings(&self, record: &FrameRecord) -> Vec<String> {
        record.sheets.as_ref().map(report::warnings).unwrap_or_default()
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        report::totals(frames).into_iter().collect()
    }
}
