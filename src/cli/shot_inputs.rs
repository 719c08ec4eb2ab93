//! The shots that a verb is run for: folders, patterns of folders, and cached frames.

use crate::{
    cache,
    control::printable_path,
    import::{self, ImportError},
    run::{Control, RunError, ShotFolder},
    scene::Frames,
};
use std::{
    collections::{BTreeSet, HashMap},
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

/// Shots in the order in which they are named, each once however its path is written.
#[derive(Default)]
struct Shots {
    shots: Vec<ShotInput>,
    /// The place of each shot, by its canonical folder.
    places: HashMap<PathBuf, usize>,
}

impl Shots {
    /// Adds a shot, or frames to it. A whole shot has all frames.
    fn add(&mut self, added: ShotInput) {
        let root = ShotFolder::around(&added.folder).root().to_owned();
        let place = *self.places.entry(root.canonicalize().unwrap_or(root)).or_insert(self.shots.len());
        match self.shots.get_mut(place) {
            None => self.shots.push(added),
            Some(known) => {
                known.frames = known.frames.take().zip(added.frames).map(|(known, added)| &known | &added);
            }
        }
    }
}

/// The shots that the inputs name, as folders or by cached frames; none if they are other files.
///
/// # Errors
/// [`RunError::Request`] if shots and files are mixed, or cached frames are in no shot.
pub(super) fn shots(inputs: &[String], control: Control) -> Result<Vec<ShotInput>, RunError> {
    let (mut shots, mut file) = (Shots::default(), None);
    for input in inputs {
        if is_folder(input) {
            shots.add(ShotInput::whole(input));
            continue;
        }
        if has_extension(Path::new(input), "mcf") {
            add_cached_frames(input, &mut shots, control)?;
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
        found.into_iter().for_each(|folder| shots.add(ShotInput::whole(folder)));
    }
    match file {
        Some(file) if !shots.shots.is_empty() => Err(RunError::Request(format!(
            "{file}: found no shot folder among shot folders; name shots or particle files, or run the command twice"
        ))),
        _ => Ok(shots.shots),
    }
}

/// Adds the shots whose cached frames match a pattern, with these frames.
fn add_cached_frames(pattern: &str, shots: &mut Shots, control: Control) -> Result<(), RunError> {
    let path = Path::new(pattern);
    let name = path.file_name().unwrap_or_default();
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folders = import::folders(&parent.to_string_lossy())?;
    let (mut frames, mut others) = (0, 0);
    for folder in folders {
        // Patterns of several shots need not match in each.
        let files = match import::expand(&[folder.join(name).to_string_lossy().into_owned()]) {
            Ok(files) => files,
            Err(ImportError::NotFound { .. }) => continue,
            Err(error) => return Err(error.into()),
        };
        // The folder in which the command runs may be the cache, and has no name here.
        let named_folder = match folder.file_name() {
            Some(_) => folder,
            None => folder.canonicalize().unwrap_or(folder),
        };
        let shot = ShotFolder::around(&named_folder);
        if shot.root() == named_folder || !shot.preset().is_file() {
            return Err(RunError::Request(format!(
                "{}: found cached frames outside of a shot, expected them in the folder `cache` of one, whose preset.toml has their \
                 surface; copy the shot's folder, or name the folder of the frames to mesh them with the defaults",
                printable_path(&named_folder)
            )));
        }
        let indices = files.files().iter().filter_map(|file| cache::index_of(file));
        let named: BTreeSet<u32> = indices.map(|index| index.0).collect();
        others += files.files().len() - named.len();
        frames += named.len();
        if !named.is_empty() {
            shots.add(ShotInput { folder: shot.root().to_owned(), frames: Some(named) });
        }
    }
    if frames == 0 {
        return Err(RunError::Request(format!(
            "{pattern}: found no cached frame, expected frame_0001.mcf or another number; look into the folder `cache` of the shot"
        )));
    }
    if others > 0 {
        control.reporter.note(&format!(
            "{pattern}: {others} files are left out, which are not named as cached frames (frame_0001.mcf)"
        ));
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
