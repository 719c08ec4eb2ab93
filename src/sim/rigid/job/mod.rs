//! What jobs need to know of the rigid bodies.

mod check;
mod report;

use super::{BodyParams, NAME};
use crate::{
    frame::StreamKind,
    job::{RunError, Total},
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        forecast::{ForecastJob, SystemForecast},
        scene::Scene,
        system::{CachedFrame, PlottedFigure, System, mesh_files},
    },
    solid::Shape,
};

/// The rigid bodies, as jobs see them.
pub(crate) struct Bodies;

impl System for Bodies {
    fn name(&self) -> &'static str {
        NAME
    }

    fn preset_table(&self) -> Option<(&'static str, &'static str)> {
        Some(("[[body]]", "a `shape` and a `density`"))
    }

    fn is_present(&self, scene: &Scene) -> bool {
        !scene.body.is_empty()
    }

    fn feels_forces(&self) -> bool {
        true
    }

    fn fixed_at_branches(&self) -> &'static [&'static str] {
        &["body.*.shape", "body.*.position", "body.*.rotation", "body.*.velocity", "body.*.angular_velocity"]
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::RigidBodies]
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check(scene, places, findings);
    }

    fn mesh_files<'a>(&self, scene: &'a Scene) -> Vec<(String, &'a str)> {
        let shapes = scene.body.iter().enumerate();
        shapes.flat_map(|(i, body)| mesh_files((format!("body.{i}.shape"), &body.shape))).collect()
    }

    fn shapes_mut<'a>(&self, scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        scene.body.iter_mut().map(|body: &mut BodyParams| &mut body.shape).collect()
    }

    fn forecast(&self, _: &ForecastJob) -> Result<Option<SystemForecast>, RunError> {
        // With a liquid they are part of its calibration. Alone they cost little, unless they are hundreds.
        Ok(None)
    }

    fn seeding_warnings(&self, seeds: &SeedReport) -> Vec<String> {
        seeds.bodies.as_ref().map(report::seeding_warnings).unwrap_or_default()
    }

    fn progress(&self, record: &FrameRecord) -> Option<String> {
        record.bodies.as_ref().map(report::progress)
    }

    fn warnings(&self, record: &FrameRecord) -> Vec<String> {
        let warnings = |bodies| report::warnings(bodies, record.liquid.is_some());
        record.bodies.as_ref().map(warnings).unwrap_or_default()
    }

    fn plotted(&self, record: &FrameRecord) -> Vec<PlottedFigure> {
        let Some(bodies) = &record.bodies else { return Vec::new() };
        let energies = [("kinetic", bodies.kinetic_energy), ("potential", bodies.potential_energy)];
        PlottedFigure::of("Energy of the bodies", "J", energies).into()
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        [report::totals(frames), report::force_totals(frames)].into_iter().flatten().collect()
    }
}
