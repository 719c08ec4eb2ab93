//! Exit codes: the result of a command for a farm wrapper that does not read the log.

use crate::{
    cache::{CacheError, is_full},
    run::{Failure, RunError},
};
use std::{io, process::ExitCode};

/// The preset, or the command line, is not right.
pub(super) const USAGE: u8 = 2;

/// The code of an error.
pub(super) fn code(error: &RunError) -> ExitCode {
    ExitCode::from(match error {
        RunError::Scene(_) | RunError::Request(_) | RunError::Setup(_) => USAGE,
        RunError::Cache(cache) => match cache {
            CacheError::NotFound { .. } => 10,
            CacheError::Locked { .. } => 11,
            CacheError::Corrupt { .. } => 12,
            CacheError::Version { .. } => 13,
            CacheError::Stale { .. } | CacheError::Misplaced { .. } => OTHER_SETTINGS,
            CacheError::Full { .. } => DISK_FULL,
            CacheError::OverMemory { .. } => OVER_MEMORY,
            CacheError::Io { .. } => 1,
        },
        RunError::SomeFailed { failed, .. }
        | RunError::NotValid { failed, .. }
        | RunError::WedgesFailed { failed, .. } => {
            // The gravest first.
            let codes = [
                (Failure::Corrupt, 12),
                (Failure::Version, 13),
                (Failure::Foreign, OTHER_SETTINGS),
                (Failure::Memory, OVER_MEMORY),
                (Failure::Missing, 10),
            ];
            let any = |kind: Failure| failed.iter().any(|frame| frame.kind == kind);
            codes.into_iter().find(|&(kind, _)| any(kind)).map_or(SOME_FAILED, |(_, code)| code)
        }
        RunError::OtherSettings { .. } => OTHER_SETTINGS,
        RunError::Diverged { .. } => 20,
        RunError::OverMemory { .. } => OVER_MEMORY,
        RunError::Interrupted => INTERRUPTED,
        RunError::File { source, .. } => of_io(source),
        RunError::NotFollowed { .. } => SOME_FAILED,
        RunError::Export(export) if export.is_disk_full() => DISK_FULL,
        RunError::Export(_) | RunError::Import(_) | RunError::NoSetting { .. } => 1,
    })
}

/// Some frames could not be made.
const SOME_FAILED: u8 = 3;

/// Cached frames or files are of other settings, of another shot, or of another frame.
const OTHER_SETTINGS: u8 = 14;

/// The disk is full.
const DISK_FULL: u8 = 28;

/// More memory would be needed than allowed.
pub(super) const OVER_MEMORY: u8 = 33;

/// The user stopped the job.
pub(super) const INTERRUPTED: u8 = 130;

fn of_io(error: &io::Error) -> u8 {
    if is_full(error) { DISK_FULL } else { 1 }
}
