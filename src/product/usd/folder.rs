//! The folder of a stage, and what its files are made with.

use crate::{
    export::usd::{LayerSettings, StageParams},
    job::{
        RunError, ShotFolder,
        batch::{BatchRequest, BatchSummary, ProductFolder},
        file_records::FileRecords,
    },
};
use std::collections::BTreeMap;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same source another one.
const USD_VERSION: u32 = 1;

/// Stages, as jobs see them.
pub(in crate::product) struct UsdStage;

impl ProductFolder for UsdStage {
    fn name(&self) -> &'static str {
        "usd"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} layers written ({mib:.1} MiB), {kept} up to date")
    }
}

/// What the files of a stage are made with.
#[derive(Clone, Copy)]
pub(super) struct StageJob<'a> {
    /// The shot folder with the files that the stage is made of.
    pub(super) shot: &'a ShotFolder,
    /// The shot folder that gets the stage.
    pub(super) out: &'a ShotFolder,
    pub(super) params: StageParams,
    pub(super) settings: LayerSettings,
    pub(super) request: &'a BatchRequest,
    /// Records of the files in `shot`, by their folder.
    pub(super) records: &'a SourceRecords,
}

impl StageJob<'_> {
    /// The key of a file that is made of others, of which the records have checksums; `None` if one has no record.
    ///
    /// `path` is the prim that the file describes, which is part of it.
    pub(super) fn key(&self, files: &[&str], path: (&str, &str)) -> Option<u64> {
        let sums = files.iter().map(|file| Some(self.records.of(file)?.1.xxh3.as_str()));
        let sums: Vec<&str> = sums.collect::<Option<_>>()?;
        let settings = serde_json::to_string(&(self.params, self.settings)).expect("settings are plain data");
        Some(xxh3_64(format!("usd {USD_VERSION} {settings} {path:?} {}", sums.join(" ")).as_bytes()))
    }
}

/// Records of the files of a shot folder, by the sub-folders in which they are.
pub(super) struct SourceRecords(BTreeMap<String, FileRecords>);

impl SourceRecords {
    /// Reads the records of the files in these sub-folders.
    ///
    /// # Errors
    /// If they are there and cannot be read.
    pub(super) fn read(shot: &ShotFolder, folders: impl Iterator<Item = String>) -> Result<Self, RunError> {
        let read = |folder: String| FileRecords::read(shot, &folder).map(|records| (folder, records));
        Ok(Self(folders.map(read).collect::<Result<_, _>>()?))
    }

    /// The record of a file.
    pub(super) fn of(
        &self,
        file: &str,
    ) -> Option<(&crate::job::file_records::FileRecord, &crate::job::file_records::RecordedFile)> {
        self.in_folder_of(file)?.of(file)
    }

    /// The records of the folder that a file is in.
    pub(super) fn in_folder_of(&self, file: &str) -> Option<&FileRecords> {
        self.0.get(file.split('/').next()?)
    }
}
