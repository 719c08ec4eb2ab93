//! The liquid as jobs see it.

pub(crate) mod check;
mod report;
mod tradeoff;

use super::LiquidParams;
use crate::{
    cache::StreamInfo,
    frame::StreamKind,
    job::Total,
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        scene::Scene,
        system::{CachedFrame, System, mesh_file},
        tradeoff::Subject,
    },
    solid::Shape,
};

/// The liquid, as jobs see it.
pub(crate) struct Liquid;

impl System for Liquid {
    fn is_present(&self, scene: &Scene) -> bool {
        scene.liquid.is_some()
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::Particles]
    }

    fn tradeoff(&self) -> Option<&'static Subject> {
        Some(&tradeoff::SUBJECT)
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        if let Some(liquid) = &scene.liquid {
            check::check_liquid(liquid, places, findings);
        }
        check::check_attributes(scene, places, findings);
    }

    fn complete(&self, scene: &mut Scene) {
        if let Some(liquid) = &mut scene.liquid
            && liquid.iterations.is_none()
            && liquid.density_dev.is_none()
        {
            liquid.density_dev = Some(LiquidParams::DEFAULT_DENSITY_DEV);
        }
    }

    fn mesh_files<'a>(&self, scene: &'a Scene) -> Vec<(String, &'a str)> {
        let sources = scene.liquid.iter().flat_map(|liquid| liquid.source.iter().enumerate());
        let shapes = sources.map(|(i, source)| (format!("liquid.source.{i}.shape"), &source.shape));
        shapes.filter_map(mesh_file).collect()
    }

    fn shapes_mut<'a>(&self, scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        let sources = scene.liquid.iter_mut().flat_map(|liquid| &mut liquid.source);
        sources.map(|source| &mut source.shape).collect()
    }

    fn seeding_warnings(&self, seeds: &SeedReport) -> Vec<String> {
        seeds.liquid.as_ref().map(report::seeding_warnings).unwrap_or_default()
    }

    fn progress(&self, record: &FrameRecord) -> Option<String> {
        record.liquid.as_ref().map(report::progress)
    }

    fn warnings(&self, record: &FrameRecord) -> Vec<String> {
        record.liquid.as_ref().map(report::warnings).unwrap_or_default()
    }

    fn frame_figures(&self, streams: &[StreamInfo]) -> Vec<(&'static str, f64)> {
        report::frame_figures(streams)
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        report::totals(frames).into_iter().collect()
    }
}
