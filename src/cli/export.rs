//! `meniscus export`.

use super::{args::ExportArgs, mesh};
use crate::{
    run::{self, Control, Job, RunError, ShotFolder, Source},
    scene::{self, Overrides, Scene},
};

/// Writes the tracers of a cache as points.
pub(super) fn export(args: &ExportArgs, control: Control) -> Result<(), RunError> {
    let source = ShotFolder::around(&args.cache);
    let out = args.output.as_ref().map_or_else(|| source.clone(), ShotFolder::new);
    let preset = source.preset();
    let smoke = if preset.exists() {
        let scene = Scene::from_preset(&scene::load(&preset.to_string_lossy())?, &Overrides::default())?;
        run::surroundings(&scene, &source, control)?
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
    let done = run::points(Source::Cache(&source), &out, smoke.as_ref(), &job, control)?;
    mesh::summary(&done)
}
