//! What can stop a job.

use crate::{
    cache::CacheError,
    control::{Diverged, printable_path},
    export::ExportError,
    frame::FrameIndex,
    import::ImportError,
    mesh::SurfaceError,
    preset::SceneError,
};
use std::path::{Path, PathBuf};

/// Why a job stopped. Everything finished before is kept.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RunError {
    /// The preset, or one of the settings, is not right.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The systems of the preset cannot start.
    #[error(transparent)]
    Setup(Box<dyn std::error::Error + Send + Sync>),
    /// The cache cannot be read or written.
    #[error(transparent)]
    Cache(#[from] CacheError),
    /// A particle file cannot be read.
    #[error(transparent)]
    Import(ImportError),
    /// A mesh cannot be written.
    #[error(transparent)]
    Export(#[from] ExportError),
    /// The simulation left the numbers it can be trusted with.
    #[error("frame {frame}: {diverged}")]
    Diverged {
        /// The frame that was being computed.
        frame: FrameIndex,
        /// What happened and what to try.
        diverged: Diverged,
    },
    /// The user stopped the job.
    #[error("interrupted; finished frames are kept, the same command continues")]
    Interrupted,
    /// Some frames could not be made; the others are there.
    #[error("{} of {requested} frames failed:\n{}", failed.len(), list(failed))]
    SomeFailed {
        /// Which, and why.
        failed: Vec<FailedFrame>,
        /// Number of requested frames.
        requested: usize,
    },
    /// Some wedges of a shot could not be made; the others are there.
    #[error("{} of {all} wedges failed:\n{}", failed.len(), list(failed))]
    WedgesFailed {
        /// Which, and why.
        failed: Vec<FailedFrame>,
        /// Number of wedges.
        all: usize,
    },
    /// Some of several shots failed; the others are done.
    #[error("{} of {all} shots failed:\n{}", failed.len(), list_shots(failed))]
    ShotsFailed {
        /// Folder and error of each.
        failed: Vec<(String, Self)>,
        /// Number of shots.
        all: usize,
    },
    /// A simulation that was followed ended, or does not come to its next frame.
    #[error("{shot}: {what} is not there: {why}; what was made is kept")]
    NotFollowed {
        /// The shot folder.
        shot: String,
        /// The frame, or the file.
        what: String,
        /// Why, and what to do.
        why: String,
    },
    /// Some files of a shot are not as they were made.
    #[error("{} of {all} files are not valid:\n{}\n{repair}", all - valid, list(failed))]
    NotValid {
        /// Which, and why.
        failed: Vec<FailedFrame>,
        /// Number of files.
        all: u64,
        /// How many of them are valid.
        valid: u64,
        /// The commands that make the others again.
        repair: String,
    },
    /// The folder holds frames of other settings.
    #[error(
        "{}: the cached frames were made with other settings{}",
        printable_path(folder), explain_settings(folder, differences.as_deref())
    )]
    OtherSettings {
        /// The shot folder.
        folder: PathBuf,
        /// A line for each setting that differs; `None` if the folder does not hold the settings of its frames.
        differences: Option<Vec<String>>,
    },
    /// More memory would be needed than allowed.
    #[error(
        "this needs about {} MiB of memory, and --max-memory allows {} MiB: raise it, use a larger \
         spacing or surface.voxel, or a coarser --quality",
        needed.div_ceil(1 << 20), allowed >> 20
    )]
    OverMemory {
        /// Estimate [bytes].
        needed: u64,
        /// The user's limit [bytes].
        allowed: u64,
    },
    /// No setting that was measured is within the user's limits.
    #[error(
        "no setting of the table keeps {wanted}: allow more, add values with --vary, or use a larger liquid.spacing"
    )]
    NoSetting {
        /// The limits, in words.
        wanted: String,
    },
    /// A file next to the cache cannot be read or written.
    #[error("{}: {source}; {next}", printable_path(path))]
    File {
        /// Which.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
        /// What to do next.
        next: &'static str,
    },
    /// The request makes no sense with what is there.
    #[error("{0}")]
    Request(String),
}

impl From<ImportError> for RunError {
    fn from(why: ImportError) -> Self {
        match why {
            ImportError::OverMemory { needed, allowed, .. } => Self::OverMemory { needed, allowed },
            why => Self::Import(why),
        }
    }
}

impl From<SurfaceError> for RunError {
    fn from(why: SurfaceError) -> Self {
        match why {
            SurfaceError::Interrupted => Self::Interrupted,
            why => Self::Request(why.to_string()),
        }
    }
}

/// The shots that failed, with the lines of each error.
fn list_shots(failed: &[(String, RunError)]) -> String {
    let line =
        |(folder, why): &(String, RunError)| format!("  {folder}: {}", why.to_string().replace('\n', "\n  "));
    failed.iter().map(line).collect::<Vec<_>>().join("\n")
}

/// A frame that could not be made.
#[derive(Clone, Debug)]
pub(crate) struct FailedFrame {
    /// The frame, or the file it would have come from.
    pub name: String,
    /// Why, and what to do.
    pub why: String,
    /// What kind of failure it is.
    pub kind: Failure,
}

/// Why a frame could not be made, as exit codes distinguish it; the gravest first, of which the code is that of a whole job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Failure {
    /// The frame's bytes in the cache are damaged.
    Corrupt,
    /// The frame was cached by another version.
    Version,
    /// The file is of another simulation, frame or product, or made from frames that have changed since.
    Foreign,
    /// The frame needs more memory than allowed.
    Memory,
    /// Nothing is there.
    Missing,
    /// Anything else.
    Other,
}

impl Failure {
    /// The kind of a cache's error.
    pub(crate) fn of(error: &CacheError) -> Self {
        match error {
            CacheError::Corrupt { .. } => Self::Corrupt,
            CacheError::Version { .. } => Self::Version,
            CacheError::Stale { .. } | CacheError::Misplaced { .. } => Self::Foreign,
            CacheError::OverMemory { .. } => Self::Memory,
            _ => Self::Other,
        }
    }
}

/// Differing settings that a message lists at most.
const MAX_LISTED_DIFFERENCES: usize = 12;

/// The settings that differ, and what each remedy does.
fn explain_settings(folder: &Path, differences: Option<&[String]>) -> String {
    let folder = printable_path(folder);
    let remedies = "\n--force deletes these frames and simulates again with the settings given now\
                    \n-o DIR keeps these frames and simulates into the folder DIR";
    let Some(differences) = differences else {
        return format!(
            ", which its preset.toml does not hold: another version of meniscus made them, or preset.toml was edited{remedies}"
        );
    };
    let mut lines: Vec<_> =
        differences.iter().take(MAX_LISTED_DIFFERENCES).map(|line| format!("\n  {line}")).collect();
    if let Some(more @ 1..) = differences.len().checked_sub(MAX_LISTED_DIFFERENCES) {
        lines.push(format!("\n  and {more} more"));
    }
    format!(
        ":{}{remedies}\n`meniscus shot {folder}/preset.toml -o {folder}` continues with the folder's own settings",
        lines.concat()
    )
}

/// Failed frames that a message lists at most.
const MAX_LISTED_FAILED: usize = 100;

fn list(failed: &[FailedFrame]) -> String {
    let line = |frame: &FailedFrame| format!("  {}: {}", frame.name, frame.why);
    let mut lines: Vec<String> = failed.iter().take(MAX_LISTED_FAILED).map(line).collect();
    if let Some(more @ 1..) = failed.len().checked_sub(MAX_LISTED_FAILED) {
        lines.push(format!("  and {more} more"));
    }
    lines.join("\n")
}
