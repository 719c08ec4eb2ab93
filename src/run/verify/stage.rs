//! What was found of the files of a stage.

use crate::{
    control::shell_path,
    frame::FrameIndex,
    job::{
        Failure, RunError, ShotFolder,
        file_records::{FileRecords, FileState},
    },
};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// The files of the cache, or of one output.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Stage {
    /// "cache", the output's kind, such as "mesh", "shot" for the manifest, or "records" for a list that cannot be read.
    pub stage: String,
    /// The files, with the frame number as `{:04}`; of a product without a manifest its folder.
    pub pattern: String,
    /// Files that are as they were made.
    pub valid: u64,
    /// All others; of many that are missing the first thousand.
    pub faults: Vec<Fault>,
    /// Files that are missing.
    pub missing: u64,
    /// The command that makes again what is not valid.
    pub repair: String,
}

/// A file that is not as it was made.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Fault {
    /// The frame; of a file of all frames the first.
    pub frame: u32,
    /// The file, relative to the folder.
    pub file: String,
    /// What is wrong with it.
    pub state: Condition,
    /// What was found and expected.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub why: String,
}

/// What may be wrong with a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Condition {
    /// No file of that name is there.
    Missing,
    /// Its bytes are not those that were written.
    Corrupt,
    /// It was made from a frame that has changed since, or by another version.
    Stale,
    /// It is of another shot or frame, or of another program.
    Foreign,
}

impl Condition {
    /// The word for it in messages and JSON.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Corrupt => "corrupt",
            Self::Stale => "stale",
            Self::Foreign => "foreign",
        }
    }

    /// The kind of failure that exit codes distinguish.
    pub(super) fn failure(self) -> Failure {
        match self {
            Self::Missing => Failure::Missing,
            Self::Corrupt => Failure::Corrupt,
            Self::Stale | Self::Foreign => Failure::Foreign,
        }
    }
}

/// Missing files that are listed.
const MAX_LISTED_MISSING: u64 = 1000;

/// What is known of the cached frames.
pub(super) struct CacheStates {
    /// The frames that were requested; none if nothing was simulated into the folder.
    pub(super) requested: BTreeSet<u32>,
    /// The states of the streams of each valid frame.
    pub(super) states: BTreeMap<FrameIndex, BTreeSet<String>>,
}

impl Stage {
    /// A stage of which no file was compared.
    pub(super) fn new(stage: &str, pattern: &str, repair: String) -> Self {
        let (stage, pattern) = (stage.into(), pattern.into());
        Self { stage, pattern, valid: 0, faults: Vec::new(), missing: 0, repair }
    }

    /// Compares the file of a frame with its record and with the cached frame.
    pub(super) fn compare(
        &mut self,
        folder: &ShotFolder,
        records: &FileRecords,
        states: &BTreeMap<FrameIndex, BTreeSet<String>>,
        (frame, file): (u32, String),
    ) {
        let (state, why) = match records.state(folder, &file) {
            FileState::Valid => match stale(records, &file, states) {
                None => {
                    self.valid += 1;
                    return;
                }
                Some(why) => (Condition::Stale, why),
            },
            FileState::Missing => return self.add_missing([(frame, file)].into_iter()),
            FileState::Damaged(why) => (Condition::Corrupt, why),
            FileState::Foreign(why) => (Condition::Foreign, why),
        };
        self.faults.push(Fault { frame, file, state, why });
    }

    /// Adds files that are not there, with their frames.
    pub(super) fn add_missing(&mut self, files: impl Iterator<Item = (u32, String)>) {
        for (frame, file) in files {
            self.missing += 1;
            if self.missing <= MAX_LISTED_MISSING {
                self.faults.push(Fault { frame, file, state: Condition::Missing, why: String::new() });
            }
        }
    }
}

/// A stage with a list of files, or a log, that cannot be read.
pub(super) fn unreadable(folder: &ShotFolder, file: &str, why: RunError, next: &str) -> Stage {
    let path = shell_path(&folder.root().join(file));
    let why = match why {
        RunError::File { source, .. } => source.to_string(),
        other => other.to_string(),
    };
    let mut stage = Stage::new("records", file, format!("move {path} away, {next}"));
    stage.faults.push(Fault { frame: 0, file: file.into(), state: Condition::Corrupt, why });
    stage
}

/// Why a file shows another state than the cached frame of its number; `None` if it does not, or that is not known.
fn stale(
    records: &FileRecords,
    file: &str,
    states: &BTreeMap<FrameIndex, BTreeSet<String>>,
) -> Option<String> {
    let (record, _) = records.of(file)?;
    let state = record.state.as_ref()?;
    let of_frame = states.get(&record.frame)?;
    let is_other = !of_frame.contains(state);
    is_other.then(|| format!("made from another state of frame {} than is cached", record.frame))
}
