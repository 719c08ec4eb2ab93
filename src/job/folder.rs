//! Where things are in a shot folder.

use super::RunError;
use crate::cache::{self, CacheError, write_atomically};
use std::{
    io,
    path::{Path, PathBuf},
};

/// Whether files can be called by `name` on every system, and in Blender: frames call their streams as they like, and a name that
/// is a path would lead out of the folder.
pub(crate) fn is_file_name(name: &str) -> bool {
    let is_of_name = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    (1..=63).contains(&name.len()) && name.chars().all(is_of_name)
}

/// A shot folder: `shot.json`, `preset.toml`, `log.jsonl`, `cache/`, and a folder for every product that was made.
#[derive(Clone, Debug)]
pub(crate) struct ShotFolder {
    root: PathBuf,
}

impl ShotFolder {
    /// The folder at `root`, which need not exist yet.
    pub(crate) fn new(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// The shot folder that `path` means: itself, or its parent if it is a shot's `cache`.
    pub(crate) fn around(path: &Path) -> Self {
        let is_cache = path.file_name().is_some_and(|name| name == "cache");
        match path.parent() {
            Some(parent) if is_cache && parent.as_os_str().is_empty() => Self::new("."),
            Some(parent) if is_cache => Self::new(parent),
            _ => Self::new(path),
        }
    }

    /// The folder itself.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// The folder of the cached frames.
    pub(crate) fn cache(&self) -> PathBuf {
        self.root.join("cache")
    }

    /// The folder of the files of a product.
    pub(crate) fn subfolder(&self, product: &str) -> PathBuf {
        self.root.join(product)
    }

    /// The folder of the sampled meshes.
    pub(crate) fn samples(&self) -> PathBuf {
        self.root.join("sdf")
    }

    /// The manifest that other tools read.
    pub(crate) fn manifest(&self) -> PathBuf {
        self.root.join("shot.json")
    }

    /// The preset as it was run, with every default.
    pub(crate) fn preset(&self) -> PathBuf {
        self.root.join("preset.toml")
    }

    /// One line a simulated frame.
    pub(crate) fn log(&self) -> PathBuf {
        self.root.join("log.jsonl")
    }

    /// Replaces the text file at `path`, whole or not at all.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn write(path: PathBuf, text: &str) -> Result<(), RunError> {
        match write_atomically(&path, |out| out.write_all(text.as_bytes())) {
            Ok(_) => Ok(()),
            Err(source) => Err(Self::not_written(&path, source)),
        }
    }

    /// The error of writing `path`, a file that is made if it does not exist: nothing there is a folder that went away.
    pub(super) fn not_written(path: &Path, source: io::Error) -> RunError {
        let path = path.into();
        if source.kind() == io::ErrorKind::NotFound {
            let expected = "the folder in which the job began, which must not be moved while it runs";
            return CacheError::NotFound { path, found: "nothing there", expected }.into();
        }
        let next = "check that the folder can be written and the disk has free space";
        RunError::File { path, source, next }
    }

    /// Makes sure that the folder `path` exists. A symbolic link is refused: it may lead anywhere.
    ///
    /// # Errors
    /// If it cannot be made, or is a link.
    pub(crate) fn create(path: &Path) -> Result<(), RunError> {
        cache::create_own_folder(path).map_err(|source| RunError::File {
            path: path.into(),
            source,
            next: "check that the folder can be written and is no link, or name another with -o",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::file_records::append_line;

    #[test]
    fn writing_into_a_folder_that_went_away_is_an_error_of_that_folder() {
        let desk = tempfile::tempdir().unwrap();
        let path = desk.path().join("moved/log.jsonl");
        for written in [ShotFolder::write(path.clone(), "text"), append_line(&path, "text")] {
            assert!(matches!(written, Err(RunError::Cache(CacheError::NotFound { .. }))), "{written:?}");
        }
    }

    #[test]
    fn paths_are_no_file_names() {
        for name in ["liquid", "cloth-2", "Flag_b"] {
            assert!(is_file_name(name), "{name}");
        }
        let long = "x".repeat(64);
        for name in
            ["", ".", "..", "../evil", "a/b", "a\\b", "C:evil", "a\nb", "\u{1b}[31m", ".hidden", "a b", &long]
        {
            assert!(!is_file_name(name), "{name:?}");
        }
    }
}
