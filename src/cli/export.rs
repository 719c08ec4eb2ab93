//! `meniscus export`.

use super::{args::ExportArgs, mesh};
use crate::{
    cache,
    export::{MeshFormat, SheetFormat},
    frame::StreamKind,
    run::{self, BatchRequest, Control, RunError, ShotFolder, Source},
    scene::{self, Overrides, Scene},
};

/// Writes the tracers of a cache as points, or its sheets.
pub(super) fn export(args: &ExportArgs, control: Control) -> Result<(), RunError> {
    let source = ShotFolder::around(&args.cache);
    let out = args.output.as_ref().map_or_else(|| source.clone(), ShotFolder::new);
    let preset = source.preset();
    let scene = if preset.exists() {
        let preset = scene::load(&preset.to_string_lossy())?;
        Some(Scene::from_preset(&preset, &Overrides::default())?)
    } else {
        None
    };
    let request = BatchRequest {
        selection: args.frames.clone(),
        force: args.force,
        max_memory: None,
        concurrent: true,
        fps: mesh::fps(None)?,
    };
    let has_sheets = has_sheets(&source)?;
    let wants_sheets = !args.format.is_empty() || args.thickness.is_some();
    if has_sheets || wants_sheets {
        let formats = if args.format.is_empty() { vec![SheetFormat::Pc2] } else { args.format.clone() };
        sheets(&source, &out, &formats, args.thickness, &request, control)?;
        // Tracers beside them, if nothing was asked for by name.
        if wants_sheets || scene.as_ref().is_none_or(|scene| scene.smoke.is_none()) {
            return Ok(());
        }
    }
    let smoke = match &scene {
        Some(scene) => run::surroundings(scene, &source, control)?,
        None => None,
    };
    let done = run::points(Source::Cache(&source), &out, smoke.as_ref(), &request, control)?;
    mesh::summary(&done)
}

/// Whether the first cached frame that can be read has sheets.
fn has_sheets(shot: &ShotFolder) -> Result<bool, RunError> {
    let source = Source::Cache(shot);
    let streams = cache::list(&shot.cache())?.iter().find_map(|(_, path)| source.streams(path));
    Ok(streams.is_some_and(|streams| streams.iter().any(|&(_, kind)| kind == StreamKind::MeshPoints)))
}

/// Writes sheets in every format, meshes first. Frames that fail as meshes do not keep the point caches from being written.
pub(super) fn sheets(
    shot: &ShotFolder,
    out: &ShotFolder,
    formats: &[SheetFormat],
    thickness: Option<f32>,
    request: &BatchRequest,
    control: Control,
) -> Result<(), RunError> {
    let mut failed = None;
    let meshes: Vec<MeshFormat> = formats.iter().filter_map(|format| format.of_frames()).collect();
    if !meshes.is_empty() {
        match run::sheet_meshes(Source::Cache(shot), out, &meshes, thickness, request, control) {
            Ok(done) => mesh::summary(&done)?,
            Err(why @ RunError::SomeFailed { .. }) => failed = Some(why),
            Err(why) => return Err(why),
        }
    }
    if formats.contains(&SheetFormat::Pc2) {
        mesh::summary(&run::point_caches(shot, out, thickness, request, control)?)?;
    }
    failed.map_or(Ok(()), Err)
}
