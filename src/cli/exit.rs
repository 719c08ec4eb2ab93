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
    ExitCode::from(number(error))
}

/// Whether a job ended because the disk is full.
pub(super) fn is_disk_full(error: &RunError) -> bool {
    number(error) == DISK_FULL
}

/// Codes of shots that failed, by severity: data that cannot be trusted, then what stops every job, then the rest.
const BY_SEVERITY: [u8; 11] =
    [12, 13, OTHER_SETTINGS, DISK_FULL, OVER_MEMORY, 20, 10, 11, 1, SOME_FAILED, USAGE];

fn number(error: &RunError) -> u8 {
    match error {
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
            failed.iter().map(|frame| frame.kind).min().map_or(SOME_FAILED, of_failure)
        }
        RunError::OtherSettings { .. } => OTHER_SETTINGS,
        RunError::Diverged { .. } => 20,
        RunError::OverMemory { .. } => OVER_MEMORY,
        RunError::Interrupted => INTERRUPTED,
        RunError::File { source, .. } => of_io(source),
        RunError::NotFollowed { .. } => SOME_FAILED,
        RunError::Export(export) if export.is_disk_full() => DISK_FULL,
        RunError::Export(_) | RunError::Import(_) | RunError::NoSetting { .. } => 1,
        RunError::ShotsFailed { failed, .. } => {
            let codes: Vec<u8> = failed.iter().map(|(_, why)| number(why)).collect();
            BY_SEVERITY.into_iter().find(|code| codes.contains(code)).unwrap_or(1)
        }
    }
}

/// The code of frames or files of which this is the gravest failure.
fn of_failure(kind: Failure) -> u8 {
    match kind {
        Failure::Corrupt => 12,
        Failure::Version => 13,
        Failure::Foreign => OTHER_SETTINGS,
        Failure::Memory => OVER_MEMORY,
        Failure::Missing => 10,
        Failure::Other => SOME_FAILED,
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::FailedFrame;

    #[test]
    fn several_shots_have_the_code_of_the_worst() {
        let memory = || RunError::OverMemory { needed: 2, allowed: 1 };
        let request = || RunError::Request("no".into());
        let several = |errors: Vec<RunError>| {
            let failed = errors.into_iter().map(|why| ("shot".into(), why)).collect();
            number(&RunError::ShotsFailed { failed, all: 9 })
        };
        assert_eq!(several(vec![request()]), USAGE);
        assert_eq!(several(vec![request(), memory(), request()]), OVER_MEMORY);
        let corrupt = FailedFrame { name: "frame 1".into(), why: "damaged".into(), kind: Failure::Corrupt };
        let some = RunError::SomeFailed { failed: vec![corrupt], requested: 3 };
        assert_eq!(several(vec![memory(), some]), 12);
        assert_eq!(several(vec![request(), RunError::Interrupted]), USAGE);
        let full = || RunError::File {
            path: "a".into(),
            source: io::Error::from(io::ErrorKind::StorageFull),
            next: "free some",
        };
        assert!(is_disk_full(&full()) && !is_disk_full(&memory()));
        assert_eq!(several(vec![memory(), full()]), DISK_FULL);
    }
}
