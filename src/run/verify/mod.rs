//! Whether everything in a shot folder is as it was made.

mod lost;
mod stage;

use super::{FailedFrame, Failure, Manifest, OutputFiles, RunError, ShotFolder, info::frame_ranges};
use crate::{
    cache::{self, CacheError, FrameInfo, FrameKeys},
    control::{printable_path, shell_path},
    frame::FrameIndex,
    job::{
        batch::{MAX_FRAMES, state_key},
        file_records::{FileRecords, hex},
    },
    product,
};
use lost::{Lost, recorded};
use serde::Serialize;
pub(crate) use stage::Stage;
use stage::{CacheStates, Condition, Fault, unreadable};
use std::{
    collections::{BTreeMap, BTreeSet, btree_map::Entry},
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

/// Missing files of a stage that the message of an error names one by one.
const MAX_NAMED_MISSING: u64 = 3;

/// Reads every file of the folder that the manifest names, and every cached frame, to the last byte.
///
/// # Errors
/// If there is neither a cache, a manifest nor what a shot leaves next to them. What is wrong with files is the result, also that the
/// manifest of a shot is missing.
pub(crate) fn verify(folder: &ShotFolder) -> Result<Verification, RunError> {
    let manifest = Manifest::read(folder)?;
    let mut stages = Vec::new();
    // Products of a lost manifest would write one that names no simulation.
    let lost = match manifest.as_ref().and_then(Manifest::simulation_key) {
        Some(_) => None,
        None => Lost::of(folder, &mut stages),
    };
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) if manifest.is_some() || lost.is_some() => Vec::new(),
        listed => listed?,
    };
    let title =
        manifest.as_ref().map_or_else(|| "Cache without shot.json".into(), |known| known.title.clone());
    let keys = manifest.as_ref().and_then(Manifest::frame_keys);
    let mut requested = manifest.as_ref().map_or_else(BTreeSet::new, requested_frames);
    if let Some(lost) = &lost {
        let present: BTreeSet<u32> = present.iter().map(|(index, _)| index.0).collect();
        stages.push(lost.stage(folder, &present));
        requested.extend(&lost.frames);
    }
    let mut states = BTreeMap::new();
    let is_simulated = lost.is_some() || !present.is_empty() || keys.is_some();
    if is_simulated {
        let (stage, frames) = cached(folder, &present, &requested, keys.as_ref());
        stages.push(stage);
        states = frames.into_iter().map(|info| (info.index, stream_states(&info))).collect();
    }
    let cache = CacheStates { requested: if is_simulated { requested } else { BTreeSet::new() }, states };
    let mut records: BTreeMap<&str, Option<FileRecords>> = BTreeMap::new();
    for output in manifest.iter().flat_map(|manifest| &manifest.outputs) {
        let subfolder = output.pattern.split('/').next().unwrap_or_default();
        let records = match records.entry(subfolder) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(records_of(folder, subfolder, &mut stages)),
        };
        if let Some(records) = records {
            stages.push(made(folder, output, subfolder, records, &cache));
        }
    }
    for product in
        product::ALL.into_iter().filter(|product| lost.is_some() && !records.contains_key(product.name()))
    {
        let records = records_of(folder, product.name(), &mut stages);
        stages.extend(
            records.and_then(|records| recorded(folder, (product.name(), product.verb()), &records, &cache)),
        );
    }
    for stage in &mut stages {
        stage.faults.sort_by_key(|fault| fault.frame);
    }
    Ok(Verification { title, stages })
}

/// The frames that were requested, a million at most.
pub(super) fn requested_frames(manifest: &Manifest) -> BTreeSet<u32> {
    let ranges = match &manifest.requested[..] {
        [] => std::slice::from_ref(&manifest.frames),
        ranges => ranges,
    };
    ranges.iter().flat_map(|range| range.numbers()).take(MAX_FRAMES as usize).collect()
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
        // What is made of the cache is made after it.
        let mut repairs: Vec<&str> = Vec::new();
        for stage in self.stages.iter().filter(|stage| !stage.faults.is_empty()) {
            if !repairs.contains(&stage.repair.as_str()) {
                repairs.push(&stage.repair);
            }
        }
        let repair = repairs.join("\n");
        (!failed.is_empty()).then_some(RunError::NotValid { failed, all, valid, repair })
    }
}

/// Verifies the cached frames, and returns what is known of those that are valid.
fn cached(
    folder: &ShotFolder,
    present: &[(FrameIndex, PathBuf)],
    requested: &BTreeSet<u32>,
    keys: Option<&FrameKeys>,
) -> (Stage, Vec<FrameInfo>) {
    let file = |frame: u32| format!("cache/frame_{}.mcf", FrameIndex(frame));
    let mut stage = Stage::new("cache", "cache/frame_{:04}.mcf", String::new());
    let mut valid = Vec::new();
    for (index, path) in present {
        let verified = cache::verify_frame(path)
            .and_then(|info| keys.map_or(Ok(()), |keys| keys.expect(&info, path)).map(|()| info));
        match verified {
            Ok(info) => {
                stage.valid += 1;
                valid.push(info);
            }
            Err(why) => stage.faults.push(Fault {
                frame: index.0,
                file: file(index.0),
                state: condition(&why),
                why: reason(&why, path),
            }),
        }
    }
    let numbers: BTreeSet<u32> = present.iter().map(|(index, _)| index.0).collect();
    stage.add_missing(requested.difference(&numbers).map(|&frame| (frame, file(frame))));
    let (root, preset) = (shell_path(folder.root()), shell_path(&folder.preset()));
    let lost: BTreeSet<u32> = stage.faults.iter().map(|fault| fault.frame).collect();
    let frames = frame_ranges(&lost.into_iter().collect::<Vec<_>>());
    let foreign = stage.faults.iter().filter(|fault| fault.state == Condition::Foreign).count();
    let is_folder = present.iter().any(|(_, path)| path.is_dir());
    let first = match (foreign > 0, is_folder) {
        (true, _) => "delete the foreign frames, then ",
        (false, true) => "remove the folders that are named like frames, then ",
        (false, false) => "",
    };
    stage.repair = format!("{first}simulate again: meniscus simulate {preset} -o {root} --frames {frames}");
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

/// Verifies the files of an output in the sub-folder of a product.
fn made(
    folder: &ShotFolder,
    output: &OutputFiles,
    subfolder: &str,
    records: &FileRecords,
    cache: &CacheStates,
) -> Stage {
    let product = product::ALL.into_iter().find(|product| product.name() == subfolder);
    let repair = match product {
        Some(product) if !cache.states.is_empty() => {
            format!("make again: meniscus {} {}", product.verb(), shell_path(folder.root()))
        }
        _ => "make again: the command that made these files".into(),
    };
    let mut stage = Stage::new(&output.kind, &output.pattern, repair);
    let compare = |stage: &mut Stage, frame: u32, file: String| {
        stage.compare(folder, records, &cache.states, (frame, file));
    };
    match output.is_per_frame() {
        true => {
            let present: BTreeSet<u32> = output.present(folder).into_iter().collect();
            for &frame in &present {
                compare(&mut stage, frame, output.file_name(frame));
            }
            // The span covers gaps too: what was made once, and what was requested of the simulation.
            let is_of_selected = product.is_some_and(|product| product.is_of_selected_frames());
            let recorded = records.frames_with(|frame| output.file_name(frame));
            let requested = cache.requested.iter().copied().filter(|_| !is_of_selected);
            let expected: BTreeSet<u32> = requested.chain(recorded).collect();
            let missing = expected.difference(&present).filter(|&&frame| output.frames.contains(frame));
            stage.add_missing(missing.map(|&frame| (frame, output.file_name(frame))));
        }
        // A few files have all frames.
        false => {
            for file in output.paths() {
                compare(&mut stage, output.frames.first, file.to_owned());
            }
        }
    }
    stage
}

/// The records of a product's files; `None`, and a stage with that fault, if they cannot be read.
fn records_of(folder: &ShotFolder, product: &str, stages: &mut Vec<Stage>) -> Option<FileRecords> {
    let read = FileRecords::read(folder, product);
    let next = "then make its files again";
    read.map_err(|why| stages.push(unreadable(folder, &format!("{product}.jsonl"), why, next))).ok()
}
