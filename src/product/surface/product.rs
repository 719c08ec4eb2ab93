//! The surface mesh, as jobs see it.

use super::{
    folder::SurfaceMesh,
    level_set::mesh_level_sets,
    log::{DIGITS, MeshRecord, jumps, read},
    memory::{max_surface_memory, meshed_memory},
    solids::Colliders,
    tradeoff,
    writer::SurfaceWriter,
};
use crate::{
    frame::{Stream, StreamKind},
    job::{
        Control, RunError, ShotFolder,
        batch::{BatchSummary, process_streams},
        tradeoff::readable_volume,
    },
    product::{
        colors::StreamColors,
        interface::Product,
        request::{ProductInfo, ProductInput, ProductRequest, ProductSettings},
    },
    sim::tradeoff::Subject,
};
use serde_json::json;

impl Product for SurfaceMesh {
    fn verb(&self) -> &'static str {
        "mesh"
    }

    fn input(&self) -> &'static str {
        "particles"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::Particles
    }

    fn uses_solids(&self, settings: &ProductSettings) -> bool {
        settings.surface.contact.is_some()
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        !settings.output.mesh.is_empty()
    }

    fn arguments(&self, settings: &ProductSettings) -> Vec<String> {
        let formats: Vec<&str> = settings.output.mesh.iter().map(|format| format.extension()).collect();
        vec!["--format".into(), formats.join(",")]
    }

    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        Some(("output.mesh", "mesh = [\"ply\"]"))
    }

    fn max_memory(&self, settings: &ProductSettings, _: StreamKind, particles: usize) -> f64 {
        max_surface_memory(particles, &settings.surface) as f64
    }

    fn stream_memory(&self, settings: &ProductSettings, stream: &Stream, triangles: u64) -> f64 {
        let memory = |spacing| meshed_memory(stream, spacing, &settings.surface, triangles) as f64;
        stream.spacing().map_or(0.0, memory)
    }

    fn tradeoff(&self) -> Option<&'static Subject> {
        Some(&tradeoff::SUBJECT)
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let ProductRequest { input, out, settings, batch, .. } = *request;
        let formats = &settings.output.mesh;
        match input {
            ProductInput::Frames(source) => {
                let colliders = Colliders::of(request)?;
                let colors = StreamColors::of(request.scene);
                let writer = SurfaceWriter::new(out, &settings.surface, formats, &colliders, &colors);
                process_streams(source, out, &writer, batch, control)
            }
            ProductInput::LevelSets(sequence) => mesh_level_sets(sequence, out, formats, batch, control),
        }
    }

    fn info(&self, folder: &ShotFolder) -> Result<ProductInfo, RunError> {
        let meshes = read(folder)?;
        let jumps = jumps(&meshes);
        let mut lines = Vec::new();
        if !meshes.is_empty() {
            let range = |values: &mut dyn Iterator<Item = f64>| {
                values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
            };
            let [low, high] =
                range(&mut meshes.iter().map(|mesh| mesh.volume)).map(|v| readable_volume(v, DIGITS));
            let [below, above] = range(&mut meshes.iter().filter_map(MeshRecord::volume_difference));
            let particles = match below <= above {
                true => format!(", {:+.1} to {:+.1} % against their particles", 100.0 * below, 100.0 * above),
                false => String::new(),
            };
            lines.push(format!("volume     {low} to {high} of {} meshes{particles}", meshes.len()));
        }
        lines.extend(jumps.iter().map(|jump| format!("jump       {jump}")));
        let values = [("meshes", json!(meshes)), ("jumps", json!(jumps))];
        Ok(ProductInfo {
            values: values.map(|(key, value)| (key.to_owned(), value)).into_iter().collect(),
            lines,
        })
    }
}
