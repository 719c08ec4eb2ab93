//! `meniscus export`.

use super::{args::ExportArgs, mesh, output::print};
use crate::{
    export::SheetFormat,
    run::{self, Control, Job, RunError, SheetSettings, ShotFolder, Source},
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
    let job = Job {
        selection: args.frames.clone(),
        force: args.force,
        max_memory: None,
        side_by_side: true,
        fps: mesh::fps(None)?,
    };
    let has_sheets = run::has_sheets(&source)?;
    let wants_sheets = !args.format.is_empty() || args.thickness.is_some();
    if has_sheets || wants_sheets {
        let formats = if args.format.is_empty() { vec![SheetFormat::Pc2] } else { args.format.clone() };
        let settings = SheetSettings { formats, thickness: args.thickness };
        let done = run::sheets(&source, &out, &settings, &job, control)?;
        done.lines().iter().try_for_each(|line| print(line))?;
        // Tracers beside them, if nothing was asked for by name.
        if wants_sheets || scene.as_ref().is_none_or(|scene| scene.smoke.is_none()) {
            return Ok(());
        }
    }
    let smoke = match &scene {
        Some(scene) => run::surroundings(scene, &source, control)?,
        None => None,
    };
    let done = run::points(Source::Cache(&source), &out, smoke.as_ref(), &job, control)?;
    mesh::summary(&done)
}
