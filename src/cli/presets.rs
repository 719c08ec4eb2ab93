//! `meniscus presets`.

use super::{
    args::{PresetsArgs, PresetsVerb},
    output::print,
};
use crate::{
    run::RunError,
    scene::{self, Home, Overrides, Preset, Scene},
};
use std::{
    fs::OpenOptions,
    io::Write,
    path::{Path, PathBuf},
};

/// Lists, shows or copies the built-in presets.
pub(super) fn presets(args: &PresetsArgs) -> Result<(), RunError> {
    match &args.verb {
        None | Some(PresetsVerb::List) => list(),
        Some(PresetsVerb::Show { name }) => {
            print(&builtin(name)?.text);
            Ok(())
        }
        Some(PresetsVerb::Copy { name, file }) => copy(name, file.clone()),
    }
}

fn list() -> Result<(), RunError> {
    for (name, _) in scene::builtin::all() {
        let scene = Scene::from_preset(&builtin(name)?, &Overrides::default())?;
        print(&format!("{name:<18} {} ({} frames)", scene.title, scene.frames.count()));
    }
    Ok(())
}

/// A built-in preset, even where a file has its name.
fn builtin(name: &str) -> Result<Preset, RunError> {
    match scene::builtin::get(name) {
        Some(text) => Ok(Preset { name: name.into(), text: text.into(), home: Home::BuiltIn }),
        None => Ok(scene::load(name)?),
    }
}

fn copy(name: &str, file: Option<PathBuf>) -> Result<(), RunError> {
    let preset = builtin(name)?;
    let path = file.unwrap_or_else(|| PathBuf::from(format!("{name}.toml")));
    let fail = |source| RunError::File {
        path: path.clone(),
        source,
        next: "name a file that does not exist yet, in a folder that can be written",
    };
    let mut file = OpenOptions::new().write(true).create_new(true).open(&path).map_err(fail)?;
    file.write_all(preset.text.as_bytes()).map_err(|source| {
        // Half a preset would be refused as an existing file the next time; the error is reported.
        let _ = std::fs::remove_file(&path);
        fail(source)
    })?;
    print(&path.display().to_string());
    copy_assets(&preset, &path)
}

/// Copies the files that a built-in preset names next to its copy; existing files stay.
fn copy_assets(preset: &Preset, target: &Path) -> Result<(), RunError> {
    let scene = Scene::from_preset(preset, &Overrides::default())?;
    for (name, asset) in &scene.assets {
        let path = target.with_file_name(name);
        let fail = |source| RunError::File {
            path: path.clone(),
            source,
            next: "copy to a folder that can be written and has no other file of this name",
        };
        if std::fs::read(&path).is_ok_and(|bytes| bytes == **asset.bytes) {
            continue;
        }
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(fail)?;
        }
        let mut file = OpenOptions::new().write(true).create_new(true).open(&path).map_err(fail)?;
        file.write_all(&asset.bytes).map_err(fail)?;
        print(&path.display().to_string());
    }
    Ok(())
}
