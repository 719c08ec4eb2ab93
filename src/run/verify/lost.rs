//! A shot that lost its manifest: its log and the records of its products have what was there.

use super::stage::{CacheStates, Condition, Fault, Stage, unreadable};
use crate::{
    control::shell_path,
    job::{ShotFolder, file_records::FileRecords, is_own_path, log},
    run::{frame_ranges, simulate::is_record},
};
use std::collections::BTreeSet;

/// What is left of a shot whose manifest is missing, or names no simulation.
pub(super) struct Lost {
    /// The frames with a line in the log, which has none about the first.
    pub(super) frames: BTreeSet<u32>,
}

impl Lost {
    /// `None` if there is neither the preset that jobs keep nor a log, as in the folder of a cache that another program wrote.
    pub(super) fn of(folder: &ShotFolder, stages: &mut Vec<Stage>) -> Option<Self> {
        let frames = log::frames(folder).unwrap_or_else(|why| {
            let next = "which loses what it reports of each frame";
            stages.push(unreadable(folder, "log.jsonl", why, next));
            BTreeSet::new()
        });
        (!frames.is_empty() || is_record(folder)).then_some(Self { frames })
    }

    /// The fault of the manifest, of a shot with these frames.
    pub(super) fn stage(&self, folder: &ShotFolder, present: &BTreeSet<u32>) -> Stage {
        let frames: Vec<u32> = self.frames.union(present).copied().collect();
        let repair = match is_record(folder) {
            true => {
                let (root, preset) = (shell_path(folder.root()), shell_path(&folder.preset()));
                let frames = match frames.is_empty() {
                    true => String::new(),
                    false => format!(" --frames {}", frame_ranges(&frames)),
                };
                format!(
                    "simulate again, which keeps valid frames: meniscus simulate {preset} -o {root}{frames}"
                )
            }
            false => "simulate again: the command that made these frames".into(),
        };
        let mut stage = Stage::new("shot", "shot.json", repair);
        stage.missing = 1;
        let file = "shot.json".to_owned();
        let why = match folder.manifest().exists() {
            true => "what is there names no simulation: a product wrote it after the shot's own was lost",
            false if frames.is_empty() => "not simulated yet",
            false => "",
        };
        let why = why.to_owned();
        stage.faults.push(Fault { frame: 0, file, state: Condition::Missing, why });
        stage
    }
}

/// Compares the files that a product recorded; `None` if it recorded none.
pub(super) fn recorded(
    folder: &ShotFolder,
    (product, verb): (&str, &str),
    records: &FileRecords,
    cache: &CacheStates,
) -> Option<Stage> {
    let repair = format!("make again: meniscus {verb} {}", shell_path(folder.root()));
    let mut stage = Stage::new(product, &format!("{product}/"), repair);
    for (frame, file) in records.files() {
        // Other names are of no product.
        if is_own_path(file) && file.split_once('/').is_some_and(|(folder, _)| folder == product) {
            stage.compare(folder, records, &cache.states, (frame.0, file.to_owned()));
        }
    }
    (stage.valid > 0 || !stage.faults.is_empty()).then_some(stage)
}
