//! What can be wrong with a cache.

use crate::control::{printable, printable_path};
use std::io;
use std::path::{Path, PathBuf};

/// Why a cache could not be read or written. Each variant has an exit code of its own.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CacheError {
    /// The folder or file is not there, or holds no frame.
    #[error("{path}: {found}, expected {expected}; check the path, or run `meniscus simulate` first", path = printable_path(path))]
    NotFound {
        /// The folder or file.
        path: PathBuf,
        /// What was found instead.
        found: &'static str,
        /// What was expected.
        expected: &'static str,
    },
    /// Another process writes this cache.
    #[error(
        "{path}: locked by {holder}, expected no other process to write this folder; \
         wait for that process or stop it, then run the same command again",
        path = printable_path(path)
    )]
    Locked {
        /// The lock file.
        path: PathBuf,
        /// The process that the lock file names, its host and for how long, as text.
        holder: String,
    },
    /// Bytes are not those that were written.
    #[error(
        "{path}: {place}: found {found}, expected {expected}; delete this frame and simulate again, \
         or restore it from a backup",
        path = printable_path(path)
    )]
    Corrupt {
        /// The file.
        path: PathBuf,
        /// Where in the file: header, trailer, or stream, channel, chunk and byte offset.
        place: String,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// The file is another frame than its name states.
    #[error(
        "{path}: frame {found} under the name of frame {expected}; give it its own name again, or delete it and simulate again",
        path = printable_path(path)
    )]
    Misplaced {
        /// The file.
        path: PathBuf,
        /// The frame that its header names.
        found: u32,
        /// The frame that its name states.
        expected: u32,
    },
    /// The columns take more memory than allowed.
    #[error(
        "{path}: this frame needs about {needed} MiB of memory, and --max-memory allows {allowed} MiB: raise it, or simulate \
         the shot with a larger spacing or a coarser --quality",
        path = printable_path(path), needed = needed.div_ceil(1 << 20), allowed = allowed >> 20
    )]
    OverMemory {
        /// The file.
        path: PathBuf,
        /// The memory of the columns \[bytes\].
        needed: u64,
        /// The user's limit \[bytes\].
        allowed: u64,
    },
    /// The file is of another version of the format.
    #[error(
        "{path}: format version {found}, expected {expected}; read it with the version of meniscus that \
         wrote it, or simulate again",
        path = printable_path(path)
    )]
    Version {
        /// The file.
        path: PathBuf,
        /// The version that the file names.
        found: u32,
        /// The version that this build reads and writes.
        expected: u32,
    },
    /// The frame is of another simulation: of other settings, or of another shot.
    #[error(
        "{path}: a frame of another simulation (key {found:016x}), expected key {expected:016x}; \
         delete this frame and simulate again",
        path = printable_path(path)
    )]
    Stale {
        /// The file.
        path: PathBuf,
        /// The key that the file names.
        found: u64,
        /// The key of the settings given.
        expected: u64,
    },
    /// The disk, the quota or the limit of the size of a file is full.
    #[error(
        "{path}: no space ({source}), expected space for the whole frame; no partial frame was left: \
         free some space, or raise the quota or `ulimit -f`, and run the same command again to resume",
        path = printable_path(path)
    )]
    Full {
        /// The file that was being written.
        path: PathBuf,
        /// What the system reported.
        source: io::Error,
    },
    /// The system refused an operation.
    #[error(
        "{path}: could not {doing}: {source}; expected a folder and files that this user may read and write: \
         check permissions and the disk",
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

impl CacheError {
    /// The variant for an error of the system while `doing` something with `path`.
    pub(super) fn from_io(path: &Path, doing: &'static str, source: io::Error) -> Self {
        let path = path.to_path_buf();
        match source.kind() {
            _ if is_full(&source) => Self::Full { path, source },
            io::ErrorKind::NotFound => {
                Self::NotFound { path, found: "nothing there", expected: "a cache or one of its frames" }
            }
            _ => Self::Io { path, doing, source },
        }
    }
}

/// Whether an error of the system reports that a disk, a quota, or the limit of the size of a file is full.
pub(crate) fn is_full(error: &io::Error) -> bool {
    use io::ErrorKind::{FileTooLarge, QuotaExceeded, StorageFull};
    matches!(error.kind(), StorageFull | QuotaExceeded | FileTooLarge)
}

/// A fault of some bytes, without the name of their file.
#[derive(Debug)]
pub(super) struct Damage {
    pub(super) place: String,
    pub(super) found: String,
    pub(super) expected: String,
}

impl Damage {
    pub(super) fn new(
        place: impl Into<String>,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Self {
        // They may name what a file holds.
        let [place, found, expected] =
            [place.into(), found.into(), expected.into()].map(|text: String| printable(&text).into_owned());
        Self { place, found, expected }
    }

    /// The error for the file `path`.
    pub(super) fn of(self, path: &Path) -> CacheError {
        let Self { place, found, expected } = self;
        CacheError::Corrupt { path: path.to_path_buf(), place, found, expected }
    }
}
