//! Whether everything in a shot folder is as it was made.

use super::{FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder};
use crate::{
    cache::{self, CacheError, FrameInfo},
    control::printable_path,
    frame::FrameIndex,
    job::{
        batch::state_key,
        file_records::{FileRecords, FileState, hex},
    },
    product,
};
use serde::Serialize;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

/// What was found in a shot folder.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Verification {
    /// The shot's name.
    pub title: String,
    /// The cache, and every output of the manifest.
    pub stages: Vec<Stage>,
}

/// The files of the cache, or of one output.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Stage {
    /// "cache", or the output's kind, such as "mesh".
    pub stage: String,
    /// The files, with the frame number as `{:04}`.
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
    fn failure(self) -> Failure {
        match self {
            Self::Missing => Failure::Missing,
            Self::Corrupt => Failure::Corrupt,
            Self::Stale | Self::Foreign => Failure::Foreign,
        }
    }
}

/// Missing files of a stage that the message of an error names one by one.
const MAX_NAMED_MISSING: u64 = 3;

/// Missing files that are listed.
const MAX_LISTED_MISSING: usize = 1000;

/// Reads every file of the folder that the manifest names, and every cached frame, to the last byte.
///
/// # Errors
/// If there is neither a cache nor a manifest, or a list of files cannot be read. What is wrong with files is the result.
pub(crate) fn verify(folder: &ShotFolder) -> Result<Verification, RunError> {
    let manifest = Manifest::read(folder)?;
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) if manifest.is_some() => Vec::new(),
        listed => listed?,
    };
    let title =
        manifest.as_ref().map_or_else(|| "Cache without shot.json".into(), |known| known.title.clone());
    let simulation = Manifest::simulation(folder)?;
    let (mut stages, mut states) = (Vec::new(), BTreeMap::new());
    if !present.is_empty() || simulation.is_some() {
        let span = manifest.as_ref().map(|manifest| manifest.frames);
        let (stage, frames) = cached(folder, &present, span, simulation);
        stages.push(stage);
        states = frames.into_iter().map(|info| (info.index, stream_states(&info))).collect();
    }
    for output in manifest.iter().flat_map(|manifest| &manifest.outputs) {
        stages.push(made(folder, output, &states)?);
    }
    Ok(Verification { title, stages })
}

impl Verification {
    /// The error that the faults are; `None` if there are none.
    pub(crate) fn failed(&self) -> Option<RunError> {
        let fault = |fault: &Fault| {
            let Fault { file, state, why, .. } = fault;
            let detail = if why.is_empty() { String::new() } else { format!(": {why}") };
            FailedFrame {
                name: file.clone(),
                why: format!("{}{detail}", state.name()),
                kind: state.failure(),
            }
        };
        // Of many missing files one line is enough.
        let lines = |stage: &Stage| -> Vec<FailedFrame> {
            let many = (stage.missing > MAX_NAMED_MISSING).then(|| FailedFrame {
                name: stage.pattern.clone(),
                why: format!("{} missing", stage.missing),
                kind: Failure::Missing,
            });
            let others = stage.faults.iter();
            let others =
                others.filter(|fault| many.is_none() || fault.state != Condition::Missing).map(fault);
            others.chain(many.clone()).collect()
        };
        let failed: Vec<FailedFrame> = self.stages.iter().flat_map(lines).collect();
        let files = |stage: &Stage| {
            let others = stage.faults.iter().filter(|fault| fault.state != Condition::Missing).count();
            stage.valid + stage.missing + others as u64
        };
        let (all, valid) =
            (self.stages.iter().map(files).sum::<u64>(), self.stages.iter().map(|stage| stage.valid).sum());
        let repairs: BTreeSet<&str> = self
            .stages
            .iter()
            .filter(|stage| !stage.faults.is_empty())
            .map(|stage| stage.repair.as_str())
            .collect();
        let repair = repairs.into_iter().collect::<Vec<_>>().join("\n");
        (!failed.is_empty()).then_some(RunError::NotValid { failed, all, valid, repair })
    }
}

/// Verifies the cached frames, and returns what is known of those that are valid.
fn cached(
    folder: &ShotFolder,
    present: &[(FrameIndex, PathBuf)],
    span: Option<FrameSpan>,
    simulation: Option<u64>,
) -> (Stage, Vec<FrameInfo>) {
    let root = folder.root().display();
    let mut stage = Stage {
        stage: "cache".into(),
        pattern: "cache/frame_{:04}.mcf".into(),
        valid: 0,
        faults: Vec::new(),
        missing: 0,
        repair: format!("simulate again: meniscus simulate {root}/preset.toml -o {root}"),
    };
    let mut valid = Vec::new();
    for (index, path) in present {
        let verified = cache::verify_frame(path)
            .and_then(|info| simulation.map_or(Ok(()), |key| info.expect_key(path, key)).map(|()| info));
        match verified {
            Ok(info) => {
                stage.valid += 1;
                valid.push(info);
            }
            Err(why) => stage.faults.push(Fault {
                frame: index.0,
                file: format!("cache/frame_{index}.mcf"),
                state: condition(&why),
                why: reason(&why, path),
            }),
        }
    }
    let numbers: BTreeSet<u32> = present.iter().map(|(index, _)| index.0).collect();
    if let Some(span) = span {
        stage.add_missing(span, &numbers, |frame| format!("cache/frame_{}.mcf", FrameIndex(frame)));
    }
    (stage, valid)
}

fn condition(why: &CacheError) -> Condition {
    match why {
        CacheError::Stale { .. } | CacheError::Misplaced { .. } => Condition::Foreign,
        CacheError::Version { .. } => Condition::Stale,
        CacheError::NotFound { .. } => Condition::Missing,
        _ => Condition::Corrupt,
    }
}

/// Why, without the path, which the fault names.
fn reason(why: &CacheError, path: &Path) -> String {
    let text = why.to_string();
    let prefix = format!("{}: ", printable_path(path));
    text.strip_prefix(&prefix).map_or_else(|| text.clone(), str::to_owned)
}

/// The states that products can be made from.
fn stream_states(info: &FrameInfo) -> BTreeSet<String> {
    info.streams.iter().map(|stream| hex(state_key(info.key, info.index, &stream.name))).collect()
}

/// Verifies the files of an output. `states` are those of the valid cached frames.
fn made(
    folder: &ShotFolder,
    output: &OutputFiles,
    states: &BTreeMap<FrameIndex, BTreeSet<String>>,
) -> Result<Stage, RunError> {
    let subfolder = output.pattern.split('/').next().unwrap_or_default();
    let product = product::ALL.into_iter().find(|product| product.name() == subfolder);
    let root = folder.root().display();
    let repair = match product {
        Some(product) if !states.is_empty() => format!("make again: meniscus {} {root}", product.verb()),
        _ => "make again: the command that made these files".into(),
    };
    let mut stage = Stage {
        stage: output.kind.clone(),
        pattern: output.pattern.clone(),
        valid: 0,
        faults: Vec::new(),
        missing: 0,
        repair,
    };
    let records = FileRecords::read(folder, subfolder)?;
    let compare = |stage: &mut Stage, frame: u32, file: String| {
        let (state, why) = match records.state(folder, &file) {
            FileState::Valid => match stale(&records, &file, states) {
                None => {
                    stage.valid += 1;
                    return;
                }
                Some(why) => (Condition::Stale, why),
            },
            FileState::Missing => (Condition::Missing, String::new()),
            FileState::Damaged(why) => (Condition::Corrupt, why),
            FileState::Foreign(why) => (Condition::Foreign, why),
        };
        stage.missing += u64::from(state == Condition::Missing);
        stage.faults.push(Fault { frame, file, state, why });
    };
    match &output.rest {
        None => {
            let numbers: BTreeSet<u32> = output.present(folder).into_iter().collect();
            for &frame in &numbers {
                compare(&mut stage, frame, output.file_name(frame));
            }
            stage.add_missing(output.frames, &numbers, |frame| output.file_name(frame));
        }
        // One pair of files has all frames.
        Some(rest) => {
            for file in [&output.pattern, rest] {
                compare(&mut stage, output.frames.first, file.clone());
            }
        }
    }
    Ok(stage)
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

impl Stage {
    /// Adds the frames of `span` that are not `present`.
    fn add_missing(&mut self, span: FrameSpan, present: &BTreeSet<u32>, file: impl Fn(u32) -> String) {
        let there = present.iter().filter(|&&frame| span.contains(frame)).count() as u64;
        self.missing += span.count().saturating_sub(there);
        // A span may have a frame for each of 2³² numbers.
        let missing = span.numbers().filter(|frame| !present.contains(frame)).take(MAX_LISTED_MISSING);
        self.faults.extend(missing.map(|frame| Fault {
            frame,
            file: file(frame),
            state: Condition::Missing,
            why: String::new(),
        }));
        self.faults.sort_by_key(|fault| fault.frame);
    }
}
