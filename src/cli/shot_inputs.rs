//! The shots that a verb is run for: folders, patterns of folders, and cached frames.

use crate::{
    cache, import,
    run::{Control, RunError, ShotFolder},
    scene::Frames,
};
use std::{
    collections::{BTreeSet, HashSet},
    path::{Path, PathBuf},
};

/// A shot, and which of its frames are named.
#[derive(Clone, Debug)]
pub(super) struct ShotInput {
    pub(super) folder: PathBuf,
    /// Numbers of the cached frames that are named; `None`: the shot is.
    frames: Option<BTreeSet<u32>>,
}

impl ShotInput {
    /// A shot with all of its frames.
    pub(super) fn whole(folder: impl Into<PathBuf>) -> Self {
        Self { folder: folder.into(), frames: None }
    }

    /// The frames to use: the requested ones, or those that are named.
    ///
    /// # Errors
    /// [`RunError::Request`] if there are both.
    pub(super) fn selection(&self, requested: &Option<Frames>) -> Result<Option<Frames>, RunError> {
        let Some(frames) = &self.frames else { return Ok(requested.clone()) };
        if requested.is_some() {
            return Err(RunError::Request(
                "--frames: found cached frames among the inputs, which are a list of frames already; leave one of the two out".into(),
            ));
        }
        let list: Vec<String> = frames.iter().map(u32::to_string).collect();
        let list = list.join(",").parse();
        list.map(Some)
            .map_err(|error| RunError::Request(format!("frames of {}: {error}", self.folder.display())))
    }
}

/// The shots that the inputs name, as folders or by cached frames; none if they are other files.
///
/// # Errors
/// [`RunError::Request`] if shots and files are mixed, or cached frames are in no shot.
pub(super) fn shots(inputs: &[String], control: Control) -> Result<Vec<ShotInput>, RunError> {
    let (mut shots, mut file) = (Vec::new(), None);
    for input in inputs {
        if is_folder(input) {
            shots.push(ShotInput::whole(input));
            continue;
        }
        if has_extension(Path::new(input), "mcf") {
            add_cached_frames(input, &mut shots)?;
            continue;
        }
        let folders = import::folders(input)?;
        let (found, others): (Vec<_>, Vec<_>) =
            folders.into_iter().partition(|folder| has_cache_or_preset(folder));
        if found.is_empty() {
            file = Some(input);
            continue;
        }
        let files = import::expand(std::slice::from_ref(input)).map_or(0, |found| found.files().len());
        if !others.is_empty() || files > 0 {
            let others = others.len();
            control.reporter.note(&format!(
                "{input}: {others} folders without a shot and {files} files are left out; name files by another pattern"
            ));
        }
        shots.extend(found.into_iter().map(ShotInput::whole));
    }
    match file {
        Some(file) if !shots.is_empty() => Err(RunError::Request(format!(
            "{file}: found no shot folder among shot folders; name shots or particle files, or run the command twice"
        ))),
        _ => {
            let mut known = HashSet::new();
            shots.retain(|shot| {
                let root = ShotFolder::around(&shot.folder).root().to_owned();
                known.insert(root.canonicalize().unwrap_or(root))
            });
            Ok(shots)
        }
    }
}

/// Adds the shots whose cached frames match a pattern.
fn add_cached_frames(pattern: &str, shots: &mut Vec<ShotInput>) -> Result<(), RunError> {
    let path = Path::new(pattern);
    let name = path.file_name().unwrap_or_default();
    let folders = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => import::folders(&parent.to_string_lossy())?,
        _ => vec![PathBuf::from(".")],
    };
    let before = shots.len();
    for folder in &folders {
        // Patterns of several shots need not match in each.
        let pattern = folder.join(name).to_string_lossy().into_owned();
        let files = match import::expand(&[pattern]) {
            Ok(files) => files,
            Err(_) if folders.len() > 1 => continue,
            Err(error) => return Err(error.into()),
        };
        let shot = ShotFolder::around(folder);
        if shot.root() == folder || !has_cache_or_preset(shot.root()) {
            return Err(RunError::Request(format!(
                "{}: found cached frames outside of a shot, expected them in the folder `cache` of one, whose preset has their surface; \
                 copy the shot's folder",
                folder.display()
            )));
        }
        let named: BTreeSet<u32> =
            files.files().iter().filter_map(|file| cache::index_of(file)).map(|index| index.0).collect();
        match shots.iter_mut().find(|other| other.folder == shot.root()) {
            Some(ShotInput { frames: Some(frames), .. }) => frames.extend(named),
            Some(_) => {}
            None if named.is_empty() => {}
            None => shots.push(ShotInput { folder: shot.root().to_owned(), frames: Some(named) }),
        }
    }
    if shots.len() == before && !shots.iter().any(|shot| shot.frames.is_some()) {
        return Err(RunError::Request(format!(
            "{pattern}: found no cached frame, expected frame_0001.mcf or another number; look into the folder `cache` of the shot"
        )));
    }
    Ok(())
}

fn has_extension(path: &Path, wanted: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
}

/// Whether a folder is that of a shot, or of its cache.
fn has_cache_or_preset(folder: &Path) -> bool {
    let shot = ShotFolder::around(folder);
    shot.cache().is_dir() || shot.preset().is_file()
}

/// Whether an input is a folder, or names one that does not exist: particle files have an extension.
pub(super) fn is_folder(input: &str) -> bool {
    let path = Path::new(input);
    path.is_dir() || !path.exists() && path.extension().is_none() && !input.contains(['*', '#', '?', '['])
}
