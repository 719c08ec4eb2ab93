//! `meniscus volume`.

use super::{
    args::VolumeArgs,
    mesh::{self, is_folder},
    print,
};
use crate::{
    export::vdb::VolumeGrid,
    import,
    run::{self, Control, Product, RunError, ShotFolder, VolumeSettings, Volumes},
    scene::{self, Overrides, Scene},
};
use std::path::Path;

/// Makes volumes of a cache, or of particle files of any solver.
pub(super) fn volume(args: &VolumeArgs, control: Control) -> Result<(), RunError> {
    let made = match &args.inputs[..] {
        [folder] if is_folder(folder) => cache(args, Path::new(folder), control)?,
        _ => files(args, control)?,
    };
    summary(&made)
}

/// One line about what was written.
pub(super) fn summary(made: &Volumes) -> Result<(), RunError> {
    print(&format!(
        "{}: {} volumes written ({:.1} MiB), {} were there",
        made.folder.display(),
        made.made,
        made.bytes as f64 / f64::from(1 << 20),
        made.kept
    ))
}

fn cache(args: &VolumeArgs, folder: &Path, control: Control) -> Result<Volumes, RunError> {
    let for_files = [("--spacing", args.spacing.is_some()), ("--fps", args.fps.is_some())];
    if let Some((flag, _)) = for_files.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag} is for particle files; a cache knows its own. Leave it out"
        )));
    }
    let ours = |argument: &str| ["surface", "volume"].iter().any(|table| argument.starts_with(table));
    if let Some(argument) = args.set.iter().find(|argument| !ours(argument.trim_start())) {
        return Err(RunError::Request(format!(
            "--set {argument}: found a key that does not change a volume, expected surface.… or volume.…; the frames \
             are simulated already: `meniscus simulate` changes the other keys"
        )));
    }
    let source = ShotFolder::around(folder);
    let out = args.output.as_ref().map_or_else(|| source.clone(), ShotFolder::new);
    let preset = source.preset();
    let settings = if preset.exists() {
        let preset = scene::load(&preset.to_string_lossy())?;
        let scene = Scene::from_preset(&preset, &Overrides { quality: None, set: keys(args) })?;
        let mut settings = of_scene(&scene);
        if !args.grids.is_empty() || settings.grids.is_empty() {
            settings.grids = grids(&args.grids);
        }
        settings
    } else {
        alone(args)?
    };
    if let Some(allowed) = args.max_memory {
        let (frames, voxel) = (args.frames.as_ref(), settings.surface.voxel);
        run::refuse_cache_over_memory(Product::Volumes, &source, frames, voxel, allowed)?;
    }
    run::volume_cache(&source, &out, &settings, args.frames.as_ref(), args.force, control)
}

fn files(args: &VolumeArgs, control: Control) -> Result<Volumes, RunError> {
    let sequence = import::expand(&args.inputs)?;
    let spacing = mesh::spacing(args.spacing)?;
    let Some(output) = &args.output else {
        return Err(RunError::Request("where should the volumes go? Add -o DIR".into()));
    };
    if args.frames.is_some() {
        return Err(RunError::Request(
            "--frames is for caches: of particle files, name those to use (`frame_000[1-9].vtk`)".into(),
        ));
    }
    let fps = mesh::fps(args.fps)?;
    let settings = alone(args)?;
    if let Some(allowed) = args.max_memory {
        run::refuse_files_over_memory(
            Product::Volumes,
            &sequence,
            None,
            spacing,
            &settings.surface,
            allowed,
        )?;
    }
    run::volume_files(&sequence, &ShotFolder::new(output), &settings, spacing, fps, control)
}

/// What a preset says about volumes; no grids if it names none.
pub(super) fn of_scene(scene: &Scene) -> VolumeSettings {
    let mut grids = scene.output.volume.clone();
    grids.sort_unstable();
    grids.dedup();
    VolumeSettings { surface: scene.surface.clone(), volume: scene.volume.clone(), grids }
}

/// The settings given on the command line, for a source without a preset.
fn alone(args: &VolumeArgs) -> Result<VolumeSettings, RunError> {
    let (surface, volume) = scene::volume_alone(&keys(args))?;
    Ok(VolumeSettings { surface, volume, grids: grids(&args.grids) })
}

/// The grids asked for, or all, each once and in the order of a file.
fn grids(asked: &[VolumeGrid]) -> Vec<VolumeGrid> {
    let wanted = |grid: &VolumeGrid| asked.is_empty() || asked.contains(grid);
    VolumeGrid::ALL.into_iter().filter(wanted).collect()
}

/// The preset's keys that the flags set.
fn keys(args: &VolumeArgs) -> Vec<String> {
    let short = [
        ("surface.voxel", &args.voxel),
        ("volume.precision", &args.precision),
        ("volume.compression", &args.compression),
    ];
    let short = short.into_iter().filter_map(|(key, value)| Some(format!("{key}={}", value.as_ref()?)));
    args.set.iter().cloned().chain(short).collect()
}
