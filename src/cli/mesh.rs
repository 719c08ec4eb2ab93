//! `meniscus mesh`.

use super::{args::MeshArgs, output::print};
use crate::{
    import::{self, Sequence},
    mesh::SurfaceParams,
    run::{self, BatchRequest, BatchSummary, Control, RunError, ShotFolder, Source, SurfaceSettings},
    scene::{self, Overrides, Scene},
};
use std::path::Path;

/// Meshes a cache, or particle files of any solver.
pub(super) fn mesh(args: &MeshArgs, control: Control) -> Result<(), RunError> {
    let done = match &args.inputs[..] {
        [folder] if is_folder(folder) => cache(args, Path::new(folder), control)?,
        _ => files(args, control)?,
    };
    summary(&done)
}

/// Whether an input is a folder, or means one that is not there: particle files have an extension.
pub(super) fn is_folder(input: &str) -> bool {
    let path = Path::new(input);
    path.is_dir() || !path.exists() && path.extension().is_none() && !input.contains(['*', '#', '?', '['])
}

/// What was written.
pub(super) fn summary(done: &BatchSummary) -> Result<(), RunError> {
    done.lines.iter().try_for_each(|line| print(line))
}

fn cache(args: &MeshArgs, folder: &Path, control: Control) -> Result<BatchSummary, RunError> {
    let for_files = [("--spacing", args.spacing.is_some()), ("--fps", args.fps.is_some())];
    if let Some((flag, _)) = for_files.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag} is for particle files; a cache knows its own. Leave it out"
        )));
    }
    if let Some(argument) = args.set.iter().find(|argument| !argument.trim_start().starts_with("surface")) {
        return Err(RunError::Request(format!(
            "--set {argument}: found a key that does not change a mesh, expected surface.…; the frames are \
             simulated already: `meniscus simulate` changes the other keys"
        )));
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
    run::surface(Source::Cache(&source), &out, &made(args, params), &job(args)?, control)
}

fn files(args: &MeshArgs, control: Control) -> Result<BatchSummary, RunError> {
    let sequence = import::expand(&args.inputs)?;
    if sequence.files().iter().any(|file| is_volume(file)) {
        return level_sets(args, &sequence, control);
    }
    let spacing = spacing(args.spacing)?;
    let Some(output) = &args.output else {
        return Err(RunError::Request("where should the meshes go? Add -o DIR".into()));
    };
    let source = Source::Files { sequence: &sequence, spacing };
    let settings = made(args, surface_alone(args)?);
    run::surface(source, &ShotFolder::new(output), &settings, &job(args)?, control)
}

fn made(args: &MeshArgs, params: SurfaceParams) -> SurfaceSettings {
    SurfaceSettings { params, formats: args.format.clone() }
}

fn job(args: &MeshArgs) -> Result<BatchRequest, RunError> {
    Ok(BatchRequest {
        selection: args.frames.clone(),
        force: args.force,
        max_memory: args.max_memory,
        concurrent: true,
        fps: fps(args.fps)?,
    })
}

/// Whether a file is an OpenVDB volume, by its name.
fn is_volume(file: &Path) -> bool {
    file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb"))
}

/// Meshes level sets, which are surfaces already.
fn level_sets(args: &MeshArgs, sequence: &Sequence, control: Control) -> Result<BatchSummary, RunError> {
    if let Some(other) = sequence.files().iter().find(|file| !is_volume(file)) {
        return Err(RunError::Request(format!(
            "{}: found particles among volumes, expected one kind of file; mesh them one after the other",
            other.display()
        )));
    }
    let for_particles = [
        ("--spacing", args.spacing.is_some()),
        ("--voxel", args.voxel.is_some()),
        ("--set", !args.set.is_empty()),
    ];
    if let Some((flag, _)) = for_particles.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag} is for particles; a level set has its grid. Leave it out"
        )));
    }
    let Some(output) = &args.output else {
        return Err(RunError::Request("where should the meshes go? Add -o DIR".into()));
    };
    run::mesh_level_sets(sequence, &ShotFolder::new(output), &args.format, &job(args)?, control)
}

/// The spacing of particles at rest [m], which their files do not say.
pub(super) fn spacing(given: Option<f32>) -> Result<f32, RunError> {
    match given {
        Some(spacing) if spacing.is_finite() && spacing > 0.0 => Ok(spacing),
        Some(spacing) => {
            Err(RunError::Request(format!("--spacing {spacing}: expected a length above 0, in metres")))
        }
        None => Err(RunError::Request(
            "particle files do not say how far apart particles rest: add --spacing METRES (twice the particle \
             radius; 0.05 for a radius of 0.025)"
                .into(),
        )),
    }
}

/// The frames a second of a sequence of files.
pub(super) fn fps(given: Option<f64>) -> Result<f64, RunError> {
    match given.unwrap_or(DEFAULT_FPS) {
        fps if fps.is_finite() && fps > 0.0 => Ok(fps),
        fps => Err(RunError::Request(format!("--fps {fps}: expected a number above 0, such as 24"))),
    }
}

/// Frames a second, if nothing is said.
pub(super) const DEFAULT_FPS: f64 = 24.0;

/// The settings given on the command line, for a source without a preset.
fn surface_alone(args: &MeshArgs) -> Result<SurfaceParams, RunError> {
    Ok(scene::surface_alone(&settings(args))?)
}

fn settings(args: &MeshArgs) -> Vec<String> {
    let voxel = args.voxel.iter().map(|voxel| format!("surface.voxel={voxel}"));
    args.set.iter().cloned().chain(voxel).collect()
}
