//! Files that a preset names: meshes in its folder, or built into the binary with it.

use super::{
    builtin,
    check::{self, Places},
    problem::{Finding, Span},
};
use crate::cache::{leads_out, read_regular};
use std::{
    borrow::Cow,
    collections::BTreeMap,
    path::{Component, Path, PathBuf},
    sync::Arc,
};

/// Where the files of a preset are.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Home {
    /// In this folder or below it.
    Folder(PathBuf),
    /// In the binary.
    BuiltIn,
}

/// A file's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asset {
    /// The whole content.
    pub bytes: Arc<Cow<'static, [u8]>>,
    /// xxh3-64 of the bytes.
    pub hash: u64,
}

/// Files that a scene names, by name.
pub type Assets = BTreeMap<String, Asset>;

/// Findings on the names of a scene's files, which are not read.
pub(crate) fn check(meshes: &[(String, &str)], home: &Home, places: &Places) -> Vec<Finding> {
    meshes
        .iter()
        .filter_map(|&(ref path, file)| {
            let key = format!("{path}.file");
            fault(file, home).map(|(message, label, help)| {
                Finding::new(places.of(&key), &key, message, label).with_help(help)
            })
        })
        .collect()
}

/// What is wrong with a file's name: in one sentence, in place, and what to do.
fn fault(file: &str, home: &Home) -> Option<(String, String, String)> {
    let path = Path::new(file);
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if !matches!(extension.as_deref(), Some("ply" | "obj")) {
        return Some((
            format!("`{file}` is no mesh that can be read"),
            format!("found {file:?}, expected a name that ends in .ply or .obj"),
            "export the mesh as PLY or OBJ".to_owned(),
        ));
    }
    let plain = path.components().all(|part| matches!(part, Component::Normal(_))) && !file.contains('\\');
    if !plain {
        return Some((
            format!("`{file}` leads out of the preset's folder"),
            format!("found {file:?}, expected a file in that folder or below it"),
            "copy the mesh next to the preset and give its name alone, with `/` between folders".to_owned(),
        ));
    }
    match home {
        Home::Folder(folder) if leads_out(folder, &folder.join(path)) => Some((
            format!("`{file}` leads out of the preset's folder"),
            format!("found a symbolic link to {}", folder.join(path).canonicalize().unwrap_or_default().display()),
            "copy the mesh into the preset's folder: a preset from elsewhere could read any file through a link".to_owned(),
        )),
        Home::Folder(folder) if folder.join(path).is_file() => None,
        Home::Folder(folder) => Some((
            format!("the mesh `{file}` is not there"),
            format!("no file {}", folder.join(path).display()),
            format!("paths count from the preset's folder, {}", shown(folder)),
        )),
        Home::BuiltIn if builtin::asset(file).is_some() => None,
        Home::BuiltIn => {
            let names: Vec<_> = builtin::assets().iter().map(|&(name, _)| name).collect();
            let nearest = check::nearest(file, names.iter().copied());
            let meant = nearest.map(|name| format!("did you mean `{name}`? ")).unwrap_or_default();
            Some((
                format!("no mesh `{file}` is built in"),
                format!("expected one of {}", names.join(", ")),
                format!("{meant}To use a file of yours, copy the preset next to it: `meniscus presets copy`"),
            ))
        }
    }
}

fn shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() { "the current one".to_owned() } else { folder.display().to_string() }
}

/// Reads the files that a checked scene names; one that cannot be read is a finding without a place of its own.
pub(crate) fn read(meshes: &[(String, &str)], home: &Home) -> Result<Assets, Box<Finding>> {
    let mut assets = Assets::new();
    for &(ref path, file) in meshes {
        if assets.contains_key(file) {
            continue;
        }
        let bytes = match home {
            Home::BuiltIn => builtin::asset(file).map(Cow::Borrowed).unwrap_or_default(),
            Home::Folder(folder) => match read_regular(&folder.join(file)) {
                Ok(bytes) => Cow::Owned(bytes),
                Err(error) => {
                    let span = Span { source: 0, start: 0, end: 0 };
                    let message = format!("the mesh `{}` cannot be read: {error}", file);
                    let found = folder.join(file).display().to_string();
                    let finding = Finding::new(span, format!("{path}.file"), message, found);
                    return Err(finding.with_help("check that this user may read it").into());
                }
            },
        };
        let hash = xxhash_rust::xxh3::xxh3_64(&bytes);
        assets.insert(file.to_owned(), Asset { bytes: Arc::new(bytes), hash });
    }
    Ok(assets)
}
