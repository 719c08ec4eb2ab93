//! `meniscus volume`.

use super::{
    args::VolumeArgs,
    mesh::{self, is_folder},
};
use crate::{
    export::vdb::VolumeGrid,
    import,
    run::{self, BatchRequest, BatchSummary, Control, Retime, RunError, ShotFolder, Source, VolumeSettings},
    scene::{self, Overrides, Scene},
};
use std::path::Path;

/// Makes volumes of a cache, or of particle files of any solver.
pub(super) fn volume(args: &VolumeArgs, control: Control) -> Result<(), RunError> {
    let done = match &args.inputs[..] {
        [folder] if is_folder(folder) => cache(args, Path::new(folder), control)?,
        _ => files(args, control)?,
    };
    mesh::summary(&done)
}

fn cache(args: &VolumeArgs, folder: &Path, control: Control) -> Result<BatchSummary, RunError> {
    let for_files = [("--spacing", args.spacing.is_some()), ("--fps", args.fps.is_some())];
    if let Some((flag, _)) = for_files.iter().find(|(_, given)| *given) {
        return Err(RunError::Request(format!(
            "{flag} is for particle files; a cache knows its own. Leave it out"
        )));
    }
    let tables = ["surface", "volume", TRACERS];
    let ours = |argument: &str| tables.iter().any(|table| argument.starts_with(table));
    if let Some(argument) = args.set.iter().find(|argument| !ours(argument.trim_start())) {
        return Err(RunError::Request(format!(
            "--set {argument}: found a key that does not change a volume, expected surface.…, volume.… or smoke.tracers; the frames \
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
        settings.smoke = run::surroundings(&scene, &source, control)?;
        if !args.grids.is_empty() || settings.grids.is_empty() {
            settings.grids = grids(&args.grids);
        }
        settings
    } else {
        alone(args)?
    };
    let reseed = args.set.iter().any(|argument| argument.trim_start().starts_with(TRACERS));
    if args.retime.is_none() && !reseed {
        return run::volume(Source::Cache(&source), &out, &settings, &job(args)?, control);
    }
    let factor = args.retime.unwrap_or(1.0);
    if !(factor.is_finite() && (1e-3..=1e3).contains(&factor)) {
        return Err(RunError::Request(format!("--retime {factor}: expected a number from 0.001 to 1000")));
    }
    let same = |a: &Path, b: &Path| {
        a == b || a.canonicalize().ok().zip(b.canonicalize().ok()).is_some_and(|(a, b)| a == b)
    };
    if same(out.root(), source.root()) {
        return Err(RunError::Request(
            "smoke that is played again has other frames than the shot: name a folder for them with -o"
                .into(),
        ));
    }
    run::retime(&source, &out, &settings, Retime { factor, reseed }, &job(args)?, control)
}

/// The only key of smoke that changes volumes alone.
const TRACERS: &str = "smoke.tracers";

fn files(args: &VolumeArgs, control: Control) -> Result<BatchSummary, RunError> {
    if args.retime.is_some() {
        return Err(RunError::Request("--retime is for the cache of a shot of smoke. Leave it out".into()));
    }
    let sequence = import::expand(&args.inputs)?;
    let spacing = mesh::spacing(args.spacing)?;
    let Some(output) = &args.output else {
        return Err(RunError::Request("where should the volumes go? Add -o DIR".into()));
    };
    let source = Source::Files { sequence: &sequence, spacing };
    run::volume(source, &ShotFolder::new(output), &alone(args)?, &job(args)?, control)
}

fn job(args: &VolumeArgs) -> Result<BatchRequest, RunError> {
    Ok(BatchRequest {
        selection: args.frames.clone(),
        force: args.force,
        max_memory: args.max_memory,
        concurrent: true,
        fps: mesh::fps(args.fps)?,
    })
}

/// What a preset says about volumes; no grids if it names none.
pub(super) fn of_scene(scene: &Scene) -> VolumeSettings {
    let mut grids = scene.output.volume.clone();
    grids.sort_unstable();
    grids.dedup();
    VolumeSettings { surface: scene.surface.clone(), volume: scene.volume.clone(), grids, smoke: None }
}

/// The settings given on the command line, for a source without a preset.
fn alone(args: &VolumeArgs) -> Result<VolumeSettings, RunError> {
    let (surface, volume) = scene::volume_alone(&keys(args))?;
    Ok(VolumeSettings { surface, volume, grids: grids(&args.grids), smoke: None })
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
