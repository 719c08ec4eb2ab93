//! The scene that a shot folder holds.

use crate::{
    cache::leads_out,
    control::printable_path,
    job::{RunError, ShotFolder},
    scene::{self, Overrides, Scene},
};

/// The scene of the preset that a job left in `folder`, with some keys changed; `None` if there is no preset.
///
/// # Errors
/// If it cannot be read, or is a link that leads out of the folder: a stranger's may lead to any file of the user.
pub(crate) fn recorded_scene(folder: &ShotFolder, set: &[String]) -> Result<Option<Scene>, RunError> {
    let preset = folder.preset();
    if !preset.exists() {
        return Ok(None);
    }
    if leads_out(folder.root(), &preset) {
        return Err(RunError::Request(format!(
            "{}: found a symbolic link that leads out of the shot's folder, expected its preset; replace it by a copy",
            printable_path(&preset)
        )));
    }
    let preset = scene::load(&preset.to_string_lossy())?;
    Ok(Some(Scene::from_preset(&preset, &Overrides { quality: None, set: set.to_vec() })?))
}
