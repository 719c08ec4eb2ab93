//! `meniscus mesh`.

use super::{args::MeshArgs, print};
use crate::{
    import,
    mesh::SurfaceParams,
    run::{self, Control, FileSettings, RunError, ShotFolder, Surfaced},
    scene::{self, Overrides, Scene},
};
use std::path::Path;

/// Meshes a cache, or particle files of any solver.
pub(super) fn mesh(args: &MeshArgs, control: Control) -> Result<(), RunError> {
    let surfaced = match &args.inputs[..] {
        [folder] if Path::new(folder).is_dir() => cache(args, Path::new(folder), control)?,
        _ => files(args, control)?,
    };
    summary(&surfaced);
    Ok(())
}

/// One line about what was written.
pub(super) fn summary(surfaced: &Surfaced) {
    print(&format!(
        "{}: {} frames meshed ({} triangles, {:.1} MiB), {} were there",
        surfaced.folder.display(),
        surfaced.meshed,
        surfaced.triangles,
        surfaced.bytes as f64 / f64::from(1 << 20),
        surfaced.kept
    ));
}

fn cache(args: &MeshArgs, folder: &Path, control: Control) -> Result<Surfaced, RunError> {
    if args.spacing.is_some() {
        return Err(RunError::Request(
            "--spacing is for particle files; a cache knows its own. Leave it out".into(),
        ));
    }
    let source = ShotFolder::around(folder);
    let out = args.output.as_ref().map_or_else(|| source.clone(), ShotFolder::new);
    let preset = source.preset();
    let params = if preset.exists() {
        let preset = scene::load(&preset.to_string_lossy())?;
        Scene::from_preset(&preset, &Overrides { quality: None, set: settings(args) })?.surface
    } else {
        surface_alone(args)?
    };
    run::surface_cache(&source, &out, &params, &args.format, args.frames.as_ref(), args.force, control)
}

fn files(args: &MeshArgs, control: Control) -> Result<Surfaced, RunError> {
    let files = import::expand(&args.inputs)?;
    let Some(spacing) = args.spacing else {
        return Err(RunError::Request(
            "particle files do not say how far apart particles rest: add --spacing METRES (twice the particle \
             radius; 0.05 for a radius of 0.025)"
                .into(),
        ));
    };
    if !(spacing.is_finite() && spacing > 0.0) {
        return Err(RunError::Request(format!("--spacing {spacing}: expected a length above 0, in metres")));
    }
    let Some(output) = &args.output else {
        return Err(RunError::Request("where should the meshes go? Add -o DIR".into()));
    };
    let settings = FileSettings { spacing, params: surface_alone(args)?, fps: args.fps };
    run::surface_files(&files, &ShotFolder::new(output), &settings, &args.format, control)
}

/// The settings given on the command line, for a source without a preset.
fn surface_alone(args: &MeshArgs) -> Result<SurfaceParams, RunError> {
    Ok(scene::surface_alone(&settings(args))?)
}

fn settings(args: &MeshArgs) -> Vec<String> {
    let voxel = args.voxel.iter().map(|voxel| format!("surface.voxel={voxel}"));
    args.set.iter().cloned().chain(voxel).collect()
}
