//! What jobs need to know of the smoke.

pub(crate) mod check;
mod forecast;
mod remeshing;
mod report;
mod tradeoff;

use crate::{
    frame::{FrameIndex, StreamKind},
    job::RunError,
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        forecast::{ElementCount, ForecastJob, SystemForecast},
        scene::Scene,
        system::{PlottedFigure, System, mesh_files},
        tradeoff::Subject,
    },
    solid::Shape,
};

/// The smoke, as jobs see it.
pub(crate) struct Smoke;

impl System for Smoke {
    fn name(&self) -> &'static str {
        "smoke"
    }

    fn preset_table(&self) -> Option<(&'static str, &'static str)> {
        Some(("[smoke]", "a `spacing` and a `[[smoke.ring]]`"))
    }

    fn is_present(&self, scene: &Scene) -> bool {
        scene.smoke.is_some()
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::Vortons, StreamKind::Tracers]
    }

    fn fixed_at_branches(&self) -> &'static [&'static str] {
        &["smoke.spacing", "smoke.tracers", "smoke.ring", "smoke.tube", "smoke.source", "smoke.turbulence"]
    }

    fn tradeoff(&self) -> Option<&'static Subject> {
        Some(&tradeoff::SUBJECT)
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        if let Some(smoke) = &scene.smoke {
            check::check_smoke(scene, smoke, places, findings);
        }
    }

    fn complete(&self, scene: &mut Scene) {
        if let Some(smoke) = &mut scene.smoke {
            smoke.settle();
        }
    }

    fn mesh_files<'a>(&self, scene: &'a Scene) -> Vec<(String, &'a str)> {
        let shapes = scene.smoke.iter().flat_map(|smoke| smoke.shapes());
        shapes.map(|(path, shape)| (format!("smoke.{path}.shape"), shape)).flat_map(mesh_files).collect()
    }

    fn shapes_mut<'a>(&self, scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        scene.smoke.iter_mut().flat_map(|smoke| smoke.shapes_mut()).collect()
    }

    fn finish_meshes(&self, scene: &mut Scene) -> Result<(), RunError> {
        Ok(scene.refuse_too_much_smoke()?)
    }

    fn counts(&self, scene: &Scene, seeds: &SeedReport) -> Vec<ElementCount> {
        scene.smoke.as_ref().map(|smoke| forecast::counts(scene, smoke, seeds)).unwrap_or_default()
    }

    fn memory(&self, scene: &Scene, counts: &[ElementCount]) -> f64 {
        forecast::memory(scene, counts)
    }

    fn forecast(&self, job: &ForecastJob) -> Result<Option<SystemForecast>, RunError> {
        job.scene.smoke.as_ref().map(|_| forecast::forecast(job)).transpose()
    }

    fn seeding_warnings(&self, seeds: &SeedReport) -> Vec<String> {
        seeds.smoke.as_ref().map(report::seeding_warnings).unwrap_or_default()
    }

    fn progress(&self, record: &FrameRecord) -> Option<String> {
        record.smoke.as_ref().map(report::progress)
    }

    fn warnings(&self, record: &FrameRecord) -> Vec<String> {
        record.smoke.as_ref().map(report::warnings).unwrap_or_default()
    }

    fn plotted(&self, record: &FrameRecord) -> Vec<PlottedFigure> {
        let Some(smoke) = &record.smoke else { return Vec::new() };
        let counts = [("vortons", smoke.vortons as f64), ("tracers", smoke.tracers as f64)];
        let through = smoke.through_flow.map(|part| [("through-flow", 100.0 * part)]);
        let counts = PlottedFigure::of("Elements of the smoke", "number", counts).into_iter();
        let through = through.map(|part| PlottedFigure::of("Leakage of solids in the smoke", "%", part));
        counts.chain(through.into_iter().flatten()).collect()
    }

    fn shot_warnings(&self, _: &Scene, frames: &[(FrameIndex, FrameRecord)]) -> Vec<String> {
        remeshing::warnings(frames.iter().filter_map(|(_, record)| record.smoke.as_ref()))
    }
}
