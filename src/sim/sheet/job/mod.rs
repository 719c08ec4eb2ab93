//! What jobs need to know of the sheets.

pub(crate) mod check;
mod forecast;
mod report;
mod tradeoff;

use super::{SheetParams, SheetShape, SheetsCommon};
use crate::{
    frame::StreamKind,
    import,
    job::{RunError, Total},
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        forecast::{ElementCount, ForecastJob, SystemForecast},
        scene::Scene,
        system::{CachedFrame, PlottedFigure, System, mesh_files},
        tradeoff::Subject,
    },
    solid::Shape,
};
use std::path::Path;

/// The sheets, as jobs see them.
pub(crate) struct Sheets;

impl System for Sheets {
    fn name(&self) -> &'static str {
        "sheets"
    }

    fn preset_table(&self) -> Option<(&'static str, &'static str)> {
        Some(("[[sheet]]", "a `shape`"))
    }

    fn is_present(&self, scene: &Scene) -> bool {
        !scene.sheet.is_empty()
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::MeshPoints, StreamKind::MeshFaces]
    }

    fn fixed_at_branches(&self) -> &'static [&'static str] {
        // A pin or joint would take its points back to where they were at the start.
        &["sheet.*.name", "sheet.*.shape", "sheet.*.velocity", "sheet.*.grain", "sheet.*.pin", "sheets.joint"]
    }

    fn feels_forces(&self) -> bool {
        true
    }

    fn tradeoff(&self) -> Option<&'static Subject> {
        Some(&tradeoff::SUBJECT)
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check_sheets(scene, places, findings);
    }

    fn mesh_files<'a>(&self, scene: &'a Scene) -> Vec<(String, &'a str)> {
        let sheets = scene.sheet.iter().enumerate().filter_map(|(i, sheet)| match &sheet.shape {
            SheetShape::Mesh(mesh) => Some((format!("sheet.{i}.shape.mesh.file"), mesh.file.as_str())),
            SheetShape::Grid { .. } => None,
        });
        check::shapes(scene).flat_map(mesh_files).chain(sheets).collect()
    }

    fn shapes_mut<'a>(&self, scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        let joints = scene.sheets.iter_mut().flat_map(SheetsCommon::shapes_mut);
        scene.sheet.iter_mut().flat_map(SheetParams::shapes_mut).chain(joints).collect()
    }

    fn finish_meshes(&self, scene: &mut Scene) -> Result<(), RunError> {
        for sheet in &mut scene.sheet {
            if let SheetShape::Mesh(mesh) = &mut sheet.shape {
                let found = import::parse_sheet(Path::new(&mesh.file), &scene.assets[&mesh.file].bytes)?;
                mesh.points = found.positions.iter().map(|&x| x.into()).collect();
                mesh.faces = found.faces;
                [mesh.stiffness, mesh.rest, mesh.damping] = found.painted;
            }
        }
        Ok(())
    }

    fn counts(&self, _: &Scene, seeds: &SeedReport) -> Vec<ElementCount> {
        seeds.sheets.as_ref().map(|seeds| forecast::counts(seeds.points)).unwrap_or_default()
    }

    fn memory(&self, scene: &Scene, counts: &[ElementCount]) -> f64 {
        forecast::memory(scene, counts.iter().map(ElementCount::max).sum())
    }

    fn seeding_memory(&self, scene: &Scene) -> f64 {
        forecast::seeding_memory(scene)
    }

    fn forecast(&self, job: &ForecastJob) -> Result<Option<SystemForecast>, RunError> {
        // Sheets that share substeps with another system are part of its calibration.
        let is_alone = self.is_present(job.scene) && job.scene.systems_sharing_substeps().sheets.is_none();
        is_alone.then(|| forecast::forecast(job)).transpose()
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

    fn plotted(&self, record: &FrameRecord) -> Vec<PlottedFigure> {
        let Some(sheets) = &record.sheets else { return Vec::new() };
        let energies = [
            ("kinetic", sheets.kinetic_energy),
            ("elastic", sheets.elastic_energy),
            ("potential", sheets.potential_energy),
        ];
        let iterations = [("substeps", f64::from(sheets.substeps)), ("solver", f64::from(sheets.iterations))];
        let strain = [("largest", 100.0 * sheets.strain_max)];
        let plots = PlottedFigure::of("Energy of the sheets", "J", energies).into_iter();
        let plots = plots.chain(PlottedFigure::of("Strain of the sheets", "%", strain));
        plots.chain(PlottedFigure::of("Iterations of the sheets", "a frame", iterations)).collect()
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        report::totals(frames).into_iter().chain(report::force_totals(frames)).collect()
    }
}
