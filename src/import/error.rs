//! What can be wrong with a file from elsewhere.

use crate::control::{printable, printable_path};
use std::io;
use std::path::{Path, PathBuf};

/// Characters of a place, finding or expectation that a message shows.
const MAX_FOUND: usize = 200;

/// Why particles could not be imported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// No file is there, or none matches the pattern.
    #[error("{path}: {found}, expected {expected}; check the path and the frames that the solver wrote", path = printable_path(path))]
    NotFound {
        /// The file or pattern, as given.
        path: PathBuf,
        /// What was found instead.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The kind of file, or something in it, is not read.
    #[error(
        "{path}: found {found}, expected {expected}; export the particles as PLY, XYZ, CSV, VTK, NPZ or classic BGEO",
        path = printable_path(path)
    )]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What is supported.
        expected: String,
    },
    /// A volume file has no level set that is read.
    #[error(
        "{path}: found {found}, expected {expected}; save the surface as a level set of floats, not half floats, or \
         mesh the particles",
        path = printable_path(path)
    )]
    NoLevelSet {
        /// The file.
        path: PathBuf,
        /// The grids of the file.
        found: String,
        /// What is supported.
        expected: String,
    },
    /// The file breaks the rules of its format, or is cut short.
    #[error(
        "{path}: {place}: found {found}, expected {expected}; write the file again, or look at this place in it",
        path = printable_path(path)
    )]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line or byte, and particle where there is one.
        place: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A position or velocity is not finite.
    #[error(
        "{path}: particle {particle}: found {found} as {channel}, expected finite numbers; \
         remove this particle, or look at the step of the solver that made it",
        path = printable_path(path)
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// `position` or `velocity`.
        channel: &'static str,
        /// The particle, counted from 0.
        particle: usize,
        /// The value.
        found: String,
    },
    /// The file has no bytes: its writer was stopped, or the disk was full.
    #[error(
        "{path}: found an empty file, expected particles or at least a header; write the file again, or leave it out",
        path = printable_path(path)
    )]
    EmptyFile {
        /// The file.
        path: PathBuf,
    },
    /// The only file is sound but holds no particle. In a sequence that is an empty frame.
    #[error(
        "{path}: found no particles, expected at least one; name the file that has them, or the whole sequence",
        path = printable_path(path)
    )]
    NoParticles {
        /// The file.
        path: PathBuf,
    },
    /// More memory would be needed than allowed.
    #[error(
        "{path}: needs about {needed} MiB of memory, expected at most the {allowed} MiB that are allowed; allow more, or write \
         fewer particles or attributes to a file",
        path = printable_path(path), needed = needed >> 20, allowed = allowed >> 20
    )]
    OverMemory {
        /// The file.
        path: PathBuf,
        /// What the file is known to need, which may not be all of it [bytes].
        needed: u64,
        /// The limit [bytes].
        allowed: u64,
    },
    /// The system refused an operation.
    #[error(
        "{path}: could not {doing}: {source}; expected a file that this user may read: check its permissions",
        path = printable_path(path)
    )]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// What the system reported.
        source: io::Error,
    },
}

impl ImportError {
    pub(super) fn from_io(path: &Path, doing: &'static str, source: io::Error) -> Self {
        let path = path.to_path_buf();
        if source.kind() == io::ErrorKind::NotFound {
            return Self::NotFound {
                path,
                found: "nothing there".into(),
                expected: "a particle file".into(),
            };
        }
        Self::Io { path, doing, source }
    }

    pub(super) fn unsupported(path: &Path, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Unsupported { path: path.to_path_buf(), found: excerpt(found), expected: excerpt(expected) }
    }

    pub(super) fn no_level_set(path: &Path, found: String, expected: &str) -> Self {
        Self::NoLevelSet { path: path.to_path_buf(), found: excerpt(found), expected: expected.into() }
    }

    pub(super) fn malformed(
        path: &Path,
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        let (place, found, expected) = (excerpt(place), excerpt(found), excerpt(expected));
        Self::Malformed { path: path.to_path_buf(), place, found, expected }
    }
}

/// The beginning of a text that may hold anything that a file does, in one line. A binary file read as text can have a "word" of
/// any length.
pub(super) fn excerpt(text: impl Into<String>) -> String {
    let mut text: String = text.into();
    if let Some((end, _)) = text.char_indices().nth(MAX_FOUND) {
        text.truncate(end);
        text.push('…');
    }
    printable(&text).into_owned()
}
