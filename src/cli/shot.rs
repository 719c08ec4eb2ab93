//! `meniscus shot` and `meniscus simulate`.

use super::{
    args::{ShotArgs, Tier},
    print,
};
use crate::{
    run::{self, Control, Outline, RunError, ShotFolder, SurfaceJob},
    scene::{self, Frames, Overrides, Preset, Quality, Scene},
};
use std::path::{Path, PathBuf};

/// Simulates, then writes every output the preset names.
pub(super) fn shot(args: &ShotArgs, control: Control) -> Result<(), RunError> {
    let Some((scene, folder, selection)) = simulated(args, control, true)? else { return Ok(()) };
    if scene.output.mesh.is_empty() {
        print(
            "no output is named: add `mesh = [\"ply\"]` under [output], or run `meniscus mesh` on the folder",
        )?;
        return Ok(());
    }
    let job = SurfaceJob {
        params: scene.surface,
        formats: scene.output.mesh,
        selection: Some(selection),
        force: args.force,
        max_memory: args.max_memory,
        side_by_side: false,
    };
    let surfaced = run::surface_cache(&folder, &folder, &job, control)?;
    super::mesh::summary(&surfaced)?;
    print(&format!("open {} in Blender: File > Import > Meniscus Shot", folder.manifest().display()))
}

/// Fills the cache.
pub(super) fn simulate(args: &ShotArgs, control: Control) -> Result<(), RunError> {
    simulated(args, control, false).map(|_| ())
}

/// The common part; `None` if it was a dry run.
fn simulated(
    args: &ShotArgs,
    control: Control,
    with_outputs: bool,
) -> Result<Option<(Scene, ShotFolder, Frames)>, RunError> {
    let preset = scene::load(&args.preset)?;
    let overrides = Overrides { quality: args.quality.map(quality), set: args.set.clone() };
    let scene = Scene::from_preset(&preset, &overrides)?;
    let selection = args.frames.clone().unwrap_or_else(|| scene.frames.clone());
    if let Some(allowed) = args.max_memory {
        run::refuse_over_memory(&scene, &selection, with_outputs, allowed, control)?;
    }
    if args.dry_run {
        describe(&scene, &selection, &run::outline(&scene, with_outputs, control)?)?;
        return Ok(None);
    }
    let folder = ShotFolder::new(args.output.clone().unwrap_or_else(|| default_folder(&preset)));
    let done = run::simulate(&scene, &folder, &selection, args.force, control)?;
    print(&format!(
        "{}: {} frames simulated ({:.1} MiB), {} were there",
        folder.cache().display(),
        done.computed,
        done.bytes as f64 / f64::from(1 << 20),
        done.kept
    ))?;
    Ok(Some((scene, folder, selection)))
}

/// The preset's name, in the current folder.
fn default_folder(preset: &Preset) -> PathBuf {
    Path::new(&preset.name).file_stem().map_or_else(|| PathBuf::from("shot"), PathBuf::from)
}

/// The preset's tier that the command line names.
pub(super) fn quality(tier: Tier) -> Quality {
    match tier {
        Tier::Draft => Quality::Draft,
        Tier::Preview => Quality::Preview,
        Tier::Final => Quality::Final,
    }
}

fn describe(scene: &Scene, selection: &Frames, outline: &Outline) -> Result<(), RunError> {
    print(&format!(
        "{}\nframes     {selection} at {} fps\nparticles  {}\npasses     {}\nmemory     at most about {:.0} MiB\n\
         time       `meniscus plan` tells it, and the disk",
        scene.title,
        scene.fps,
        outline.particles,
        outline.passes.join(", "),
        outline.memory as f64 / f64::from(1 << 20),
    ))?;
    outline.remarks.iter().try_for_each(|remark| print(&format!("note       {remark}")))
}
