//! The liquid as jobs see it.

mod capped;
pub(crate) mod check;
mod flow;
mod forecast;
mod held;
mod report;
mod tradeoff;
mod volume;

use super::{LiquidChannel, LiquidParams, NAME};
use crate::{
    cache::StreamInfo,
    frame::{FrameIndex, StreamKind},
    job::{RunError, Total},
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord, SeedReport,
        forecast::{ElementCount, ForecastJob, SystemForecast},
        scene::Scene,
        system::{CachedFrame, ChannelColors, PlottedFigure, System, mesh_files},
        tradeoff::Subject,
    },
    solid::Shape,
};

/// The liquid, as jobs see it.
pub(crate) struct Liquid;

impl System for Liquid {
    fn name(&self) -> &'static str {
        NAME
    }

    fn preset_table(&self) -> Option<(&'static str, &'static str)> {
        Some(("[liquid]", "a `spacing` and at least one `[[liquid.source]]` or `[[liquid.emitter]]`"))
    }

    fn is_present(&self, scene: &Scene) -> bool {
        scene.liquid.is_some()
    }

    fn stream_kinds(&self) -> &'static [StreamKind] {
        &[StreamKind::Particles]
    }

    fn fixed_at_branches(&self) -> &'static [&'static str] {
        &[
            "liquid.spacing",
            "liquid.channels",
            "liquid.source.*.shape",
            "liquid.source.*.velocity",
            "liquid.source.*.jitter",
            "liquid.emitter.*.shape",
            "liquid.emitter.*.velocity",
            "liquid.emitter.*.direction",
            "liquid.emitter.*.keyframes",
            "liquid.emitter.*.interpolation",
        ]
    }

    fn feels_forces(&self) -> bool {
        true
    }

    fn tradeoff(&self) -> Option<&'static Subject> {
        Some(&tradeoff::SUBJECT)
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        if let Some(liquid) = &scene.liquid {
            check::check_liquid(liquid, places, findings);
        }
        if let Some(liquid) = &scene.liquid {
            flow::check_flow(liquid, scene.seconds(), scene.timeline(), places, findings);
        }
        check::check_attributes(scene, places, findings);
        check::check_colors(scene, places, findings);
        check::check_colliders(scene, places, findings);
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
        scene.liquid.iter().flat_map(flow::shapes).flat_map(mesh_files).collect()
    }

    fn shapes_mut<'a>(&self, scene: &'a mut Scene) -> Vec<&'a mut Shape> {
        let Some(LiquidParams { source, emitter, outflow, .. }) = &mut scene.liquid else {
            return Vec::new();
        };
        let sources = source.iter_mut().map(|source| &mut source.shape);
        let emitters = emitter.iter_mut().map(|emitter| &mut emitter.shape);
        sources.chain(emitters).chain(outflow.iter_mut().map(|outflow| &mut outflow.shape)).collect()
    }

    fn counts(&self, scene: &Scene, seeds: &SeedReport) -> Vec<ElementCount> {
        forecast::counts(scene, scene.liquid.as_ref(), seeds)
    }

    fn memory(&self, scene: &Scene, counts: &[ElementCount]) -> f64 {
        let particles = counts.iter().map(ElementCount::max).sum();
        scene.liquid.as_ref().map_or(0.0, |liquid| forecast::memory(scene, liquid, particles))
    }

    fn forecast(&self, job: &ForecastJob) -> Result<Option<SystemForecast>, RunError> {
        job.scene.liquid.as_ref().map(|liquid| forecast::forecast(job, liquid)).transpose()
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

    fn shot_warnings(&self, scene: &Scene, frames: &[(FrameIndex, FrameRecord)]) -> Vec<String> {
        let Some(liquid) = &scene.liquid else { return Vec::new() };
        volume::warning(liquid, frames).into_iter().chain(held::warning(liquid, frames)).collect()
    }

    fn plotted(&self, record: &FrameRecord) -> Vec<PlottedFigure> {
        record.liquid.as_ref().map(report::plotted).unwrap_or_default()
    }

    fn colors(&self, scene: &Scene) -> Option<ChannelColors> {
        let colors = scene.liquid.as_ref()?.colors()?;
        Some(ChannelColors { stream: NAME, channel: LiquidChannel::Source.name(), colors })
    }

    fn frame_figures(&self, streams: &[StreamInfo]) -> Vec<(&'static str, f64)> {
        report::frame_figures(streams)
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        report::cached_totals(frames)
    }
}
