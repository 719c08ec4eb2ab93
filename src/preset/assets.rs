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

/// Most files of a sequence.
const MAX_SEQUENCE: usize = 100_000;

/// Findings on the names of a scene's files, each with its dotted key. The files are not read.
pub(crate) fn check(files: &[(String, &str)], home: &Home, places: &Places) -> Vec<Finding> {
    files
        .iter()
        .filter_map(|&(ref key, file)| {
            fault(key, file, home).map(|(message, label, help)| {
                Finding::new(places.of(key), key, message, label).with_help(help)
            })
        })
        .collect()
}

/// Whether a file's dotted key is that of a point cache.
fn is_point_cache(key: &str) -> bool {
    key.ends_with(".point_cache")
}

/// The parts of a pattern before and after its one run of `#`, and the length of the run; `None` without one.
fn pattern(file: &str) -> Option<(&str, &str, usize)> {
    let start = file.find('#')?;
    let end = file.rfind('#')? + 1;
    file[start..end].bytes().all(|byte| byte == b'#').then(|| (&file[..start], &file[end..], end - start))
}

/// The number of the frame that a file has in a sequence; `None` if it is no file of it.
fn frame_number(name: &str, (start, end, width): (&str, &str, usize)) -> Option<u32> {
    let digits = name.strip_prefix(start)?.strip_suffix(end)?;
    let plain = digits.len() == width || digits.len() > width && !digits.starts_with('0');
    (plain && digits.bytes().all(|byte| byte.is_ascii_digit())).then(|| digits.parse().ok())?
}

/// The files among `assets` that a pattern such as "walk/####.obj" stands for, with their frames, ascending.
pub(crate) fn sequence<'a>(file: &str, assets: &'a Assets) -> Vec<(u32, &'a str, &'a Asset)> {
    let Some(pattern) = pattern(file) else { return Vec::new() };
    let frame =
        |(name, asset): (&'a String, &'a Asset)| Some((frame_number(name, pattern)?, name.as_str(), asset));
    let mut found: Vec<_> = assets.iter().filter_map(frame).collect();
    found.sort_by_key(|&(frame, ..)| frame);
    found
}

/// A hash of the contents of files, by their names in a preset; 0 without files.
pub(crate) fn hash<'a>(files: impl Iterator<Item = &'a str>, assets: &Assets) -> u64 {
    let of = |file: &str| -> Vec<u64> {
        match pattern(file) {
            Some(_) => {
                let frames = sequence(file, assets).into_iter();
                frames.flat_map(|(frame, _, asset)| [u64::from(frame), asset.hash]).collect()
            }
            None => assets.get(file).map(|asset| asset.hash).into_iter().collect(),
        }
    };
    let all: Vec<u64> = files.flat_map(of).collect();
    match all[..] {
        [] => 0,
        [one] => one,
        _ => xxhash_rust::xxh3::xxh3_64(&all.iter().flat_map(|hash| hash.to_le_bytes()).collect::<Vec<u8>>()),
    }
}

/// Files of a folder that the patterns of a scene stand for and that are not among its `assets`.
pub(crate) fn foreign(files: &[(String, &str)], assets: &Assets, folder: &Path) -> Vec<String> {
    let home = Home::Folder(folder.to_owned());
    let there = files.iter().flat_map(|(_, file)| sequence_names(file, &home));
    there.filter(|name| !assets.contains_key(name)).collect()
}

/// The names of the files that a pattern stands for, ascending by their frames, at most [`MAX_SEQUENCE`] and one more.
fn sequence_names(file: &str, home: &Home) -> Vec<String> {
    let Some(pattern) = pattern(file) else { return Vec::new() };
    let mut found: Vec<(u32, String)> = match home {
        Home::BuiltIn => builtin::assets()
            .iter()
            .filter_map(|(name, _)| Some((frame_number(name, pattern)?, (*name).to_owned())))
            .collect(),
        Home::Folder(folder) => {
            let inner = file.rsplit_once('/').map_or("", |(inner, _)| inner);
            let entries = std::fs::read_dir(folder.join(inner)).into_iter().flatten().flatten();
            let name = |entry: std::fs::DirEntry| {
                let name = entry.file_name().into_string().ok()?;
                let name = if inner.is_empty() { name } else { format!("{inner}/{name}") };
                Some((frame_number(&name, pattern)?, name))
            };
            entries.filter_map(name).take(MAX_SEQUENCE + 1).collect()
        }
    };
    found.sort();
    found.into_iter().map(|(_, name)| name).collect()
}

/// What is wrong with the name of a file: in one sentence, in place, and what to do.
fn fault(key: &str, file: &str, home: &Home) -> Option<(String, String, String)> {
    let path = Path::new(file);
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    if is_point_cache(key) && extension.as_deref() != Some("pc2") {
        return Some((
            format!("`{file}` is no point cache that can be read"),
            format!("found {file:?}, expected a name that ends in .pc2"),
            "export the animated mesh with a PC2 point cache, or name a sequence of meshes as `file`"
                .to_owned(),
        ));
    }
    if !is_point_cache(key) && !matches!(extension.as_deref(), Some("ply" | "obj")) {
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
    if file.contains('#') {
        return sequence_fault(file, home);
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

/// What is wrong with the name of a sequence.
fn sequence_fault(file: &str, home: &Home) -> Option<(String, String, String)> {
    let in_name = file.rsplit_once('/').is_none_or(|(folder, _)| !folder.contains('#'));
    if pattern(file).is_none() || !in_name {
        return Some((
            format!("`{file}` does not stand for the files of a sequence"),
            format!("found {file:?}, expected one run of `#` in the name of the file"),
            "write the number of the frame as `####`: \"walk/step_####.obj\"".to_owned(),
        ));
    }
    if let Home::Folder(folder) = home
        && leads_out(folder, &folder.join(file))
    {
        return Some((
            format!("the folder of `{file}` leads out of the preset's folder"),
            "found a symbolic link".to_owned(),
            "copy the meshes into the preset's folder: a preset from elsewhere could read any file through a link"
                .to_owned(),
        ));
    }
    let found = sequence_names(file, home);
    let wrong = |label: String, help: &str| {
        Some((format!("the sequence `{file}` cannot be read"), label, help.to_owned()))
    };
    if found.is_empty() {
        let label = "found no file whose name has a number in place of the `#`".to_owned();
        return wrong(label, "paths count from the preset's folder; `####` stands for four digits or more");
    }
    if found.len() > MAX_SEQUENCE {
        return wrong(
            format!("found more than {MAX_SEQUENCE} files"),
            "name a folder with the frames of the shot alone",
        );
    }
    let Home::Folder(folder) = home else { return None };
    let out = found.iter().find(|name| leads_out(folder, &folder.join(name)))?;
    wrong(
        format!("found {out}, a symbolic link out of the preset's folder"),
        "copy the meshes into the preset's folder: a preset from elsewhere could read any file through a link",
    )
}

fn shown(folder: &Path) -> String {
    if folder.as_os_str().is_empty() { "the current one".to_owned() } else { folder.display().to_string() }
}

/// Reads the files that a checked scene names, each with its dotted key; one that cannot be read is a finding without a place of its
/// own.
pub(crate) fn read(files: &[(String, &str)], home: &Home) -> Result<Assets, Box<Finding>> {
    let mut assets = Assets::new();
    for &(ref key, file) in files {
        let names = if file.contains('#') { sequence_names(file, home) } else { vec![file.to_owned()] };
        for name in names {
            if assets.contains_key(&name) {
                continue;
            }
            let bytes = match home {
                Home::BuiltIn => builtin::asset(&name).map(Cow::Borrowed).unwrap_or_default(),
                Home::Folder(folder) => match read_regular(&folder.join(&name)) {
                    Ok(bytes) => Cow::Owned(bytes),
                    Err(error) => {
                        let span = Span { source: 0, start: 0, end: 0 };
                        let message = format!("the mesh `{name}` cannot be read: {error}");
                        let found = folder.join(&name).display().to_string();
                        let finding = Finding::new(span, key, message, found);
                        return Err(finding.with_help("check that this user may read it").into());
                    }
                },
            };
            let hash = xxhash_rust::xxh3::xxh3_64(&bytes);
            assets.insert(name, Asset { bytes: Arc::new(bytes), hash });
        }
    }
    Ok(assets)
}
