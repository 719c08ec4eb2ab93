//! The volume file, as jobs see it.

use super::{
    file::names,
    folder::VolumeFile,
    memory::{max_volume_memory, stream_memory},
    retime::retime,
    settings::VolumeSettings,
    writer::volume,
};
use crate::{
    export::vdb::VolumeGrid,
    frame::{Stream, StreamKind},
    job::{
        Control, RunError,
        batch::{BatchSummary, Source},
    },
    preset::{check::Places, problem::Finding},
    product::{
        interface::Product,
        request::{ProductRequest, ProductSettings},
    },
};

impl Product for VolumeFile {
    fn verb(&self) -> &'static str {
        "volume"
    }

    fn input(&self) -> &'static str {
        "particles or tracers"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        matches!(kind, StreamKind::Particles | StreamKind::Tracers)
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        !settings.output.volume.is_empty()
    }

    fn arguments(&self, settings: &ProductSettings) -> Vec<String> {
        vec!["--grid".into(), names(&settings.output.volume).replace(", ", ",")]
    }

    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        Some(("output.volume", "volume = [\"density\", \"velocity\"]"))
    }

    fn check(
        &self,
        settings: &ProductSettings,
        kinds: &[StreamKind],
        places: &Places,
        findings: &mut Vec<Finding>,
    ) {
        let grids = |kind: &StreamKind| match kind {
            StreamKind::Particles => &VolumeGrid::OF_PARTICLES[..],
            StreamKind::Tracers => &VolumeGrid::OF_TRACERS[..],
            _ => &[],
        };
        let mut available: Vec<VolumeGrid> = kinds.iter().flat_map(grids).copied().collect();
        available.sort_unstable();
        available.dedup();
        let requested = &settings.output.volume;
        if requested.iter().any(|grid| !available.contains(grid)) {
            let quoted = |grids: &[VolumeGrid]| format!("`{}`", names(grids).replace(", ", "`, `"));
            let label = format!("found {}, expected some of {}", quoted(requested), quoted(&available));
            let message = "the systems of the preset have no such grid";
            let help = "name one of those, or leave `volume` out";
            findings.push(
                Finding::new(places.of("output.volume"), "output.volume", message, label).with_help(help),
            );
        }
    }

    fn max_memory(&self, settings: &ProductSettings, kind: StreamKind, entries: usize) -> f64 {
        max_volume_memory(kind, entries, &settings.surface, &settings.output.volume) as f64
    }

    fn stream_memory(&self, settings: &ProductSettings, stream: &Stream, _: u64) -> f64 {
        let ProductSettings { surface, output, .. } = settings;
        stream.spacing().map_or(0.0, |spacing| stream_memory(stream, spacing, surface, &output.volume) as f64)
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let source = request.frames()?;
        let ProductRequest { out, batch, .. } = *request;
        let settings = VolumeSettings::new(request.settings, request.scene);
        match (request.retime, source) {
            (Some(retimed), Source::Cache(cache)) => retime(cache, out, &settings, retimed, batch, control),
            _ => volume(source, out, &settings, batch, control),
        }
    }
}
