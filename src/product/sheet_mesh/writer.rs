//! Mesh files of sheets, one a frame.

use super::mesh::{MISSING_PARTS, SHEET_VERSION, sheet_mesh};
use crate::{
    export::{MeshFormat, SheetFormat},
    frame::{Stream, StreamKind},
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameFiles, FrameOutcome, ProductFolder, Source,
            StreamHeader, StreamInput, StreamWriter, Written, process_streams,
        },
        memory::BASE_MEMORY,
    },
    product::{
        interface::Product,
        mesh_files::{MeshFiles, mesh_summary},
        request::{ProductRequest, ProductSettings},
    },
    sim::scene::Output,
};
use xxhash_rust::xxh3::xxh3_64;

/// Memory of writing the mesh of a sheet [bytes/point]: 360 to 410 were measured with the simulation's own on grids of
/// 160 000 and a million points.
pub(in crate::product) const POINT_BYTES: f64 = 410.0;

/// Writes the sheets of the frames of `source` to `out`, a mesh a frame in each of the formats.
///
/// # Errors
/// As [`Product::make`].
fn sheet_meshes(
    source: Source,
    out: &ShotFolder,
    formats: &[MeshFormat],
    thickness: Option<f32>,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let files = MeshFiles { out, folder: SheetMesh.name(), formats, points: false };
    process_streams(source, out, &SheetMeshWriter { files, thickness }, request, control)
}

/// Sheets as meshes, as jobs see them.
pub(in crate::product) struct SheetMesh;

impl ProductFolder for SheetMesh {
    fn name(&self) -> &'static str {
        "sheet"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        mesh_summary(batch)
    }
}

impl Product for SheetMesh {
    fn verb(&self) -> &'static str {
        "export"
    }

    fn input(&self) -> &'static str {
        "sheets"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::MeshPoints
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.output.sheet.iter().any(|format| format.of_frames().is_some())
    }

    fn arguments(&self, settings: &ProductSettings) -> Vec<String> {
        export_arguments(&settings.output, |format| format.of_frames().is_some())
    }

    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        Some(("output.sheet", "sheet = [\"ply\"]"))
    }

    fn max_memory(&self, _: &ProductSettings, _: StreamKind, points: usize) -> f64 {
        BASE_MEMORY + points as f64 * POINT_BYTES
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let Output { sheet, thickness, .. } = &request.settings.output;
        let formats: Vec<MeshFormat> = sheet.iter().filter_map(|format| format.of_frames()).collect();
        sheet_meshes(request.frames()?, request.out, &formats, *thickness, request.batch, control)
    }
}

/// Arguments of `export` for the formats of an output that are `chosen`.
pub(in crate::product) fn export_arguments(
    output: &Output,
    chosen: impl Fn(SheetFormat) -> bool,
) -> Vec<String> {
    let formats = output.sheet.iter().filter(|format| chosen(**format)).map(|format| format.name());
    let thickness = output.thickness.iter().flat_map(|metres| ["--thickness".to_owned(), metres.to_string()]);
    ["--format".to_owned(), formats.collect::<Vec<_>>().join(",")].into_iter().chain(thickness).collect()
}

/// Writes the meshes of sheets.
struct SheetMeshWriter<'a> {
    files: MeshFiles<'a>,
    /// Thickness of the sheets [m]; `None`: surfaces without a thickness.
    thickness: Option<f32>,
}

impl StreamWriter for SheetMeshWriter<'_> {
    fn folder(&self) -> &dyn ProductFolder {
        &SheetMesh
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::MeshPoints
    }

    fn key(&self, stream: &StreamHeader, _: f32) -> u64 {
        let state = stream.state;
        xxh3_64(format!("sheet {SHEET_VERSION} {state:016x} {:?}", self.thickness).as_bytes())
    }

    fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles> {
        self.files.up_to_date(target)
    }

    fn max_memory(&self, points: usize) -> u64 {
        if points == 0 { 0 } else { (BASE_MEMORY + points as f64 * POINT_BYTES) as u64 }
    }

    fn memory(&self, stream: &Stream, _: f32, _: u64) -> u64 {
        self.max_memory(stream.len())
    }

    fn write(
        &self,
        input: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        _: Control,
    ) -> Result<(), RunError> {
        let Some(mesh) = sheet_mesh(input.stream, input.streams, self.thickness) else {
            outcome.fail(MISSING_PARTS.into(), Failure::Other);
            return Ok(());
        };
        let figures = format!("frame {}  {}  {} triangles", target.index, target.name, mesh.triangles.len());
        let written = Written { figures, ..Written::of(target) };
        outcome.files.push(self.files.write(&mesh, None, target, written)?);
        Ok(())
    }
}
