//! The account of a batch: what was made, which files the manifest names, and what failed.

use super::target::FileTarget;
use crate::{
    cache::{self, CacheError, Lock, WrittenFile},
    frame::FrameIndex,
    job::{
        Control, FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder,
        file_records::{self, FileRecord, FileRecords},
    },
};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// The sub-folder of a shot folder that holds a product's files, and what is reported about them.
pub(crate) trait ProductFolder: Sync {
    /// The product's name in reports, which is also the sub-folder's.
    fn name(&self) -> &'static str;

    /// What a batch did, in one line.
    fn summary(&self, batch: &BatchSummary) -> String;

    /// Completes the folder after a batch, and returns what the user should know of its files.
    ///
    /// # Errors
    /// What a folder or disk refuses.
    fn finish(&self, _out: &ShotFolder) -> Result<Vec<String>, RunError> {
        Ok(Vec::new())
    }
}

/// What a batch did.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct BatchSummary {
    /// Files that were up to date: made from the same particles with the same settings.
    pub kept: usize,
    /// Files made.
    pub made: usize,
    /// Frames of the batch.
    pub frames: usize,
    /// Triangles written.
    pub triangles: u64,
    /// Bytes written.
    pub bytes: u64,
    /// Where the files are.
    pub folder: PathBuf,
    /// These figures as text, a line each, with notes on the files.
    pub lines: Vec<String>,
}

impl BatchSummary {
    /// Bytes written [MiB].
    pub(crate) fn mebibytes(&self) -> f64 {
        self.bytes as f64 / f64::from(1 << 20)
    }
}

/// Result of one frame.
pub(crate) struct FrameOutcome {
    pub(crate) index: FrameIndex,
    /// Notes on the frame for the user.
    pub(crate) notes: Vec<String>,
    /// The files that are present now.
    pub(crate) files: Vec<FrameFiles>,
    failed: Vec<FailedFrame>,
}

/// The files of one stream of a frame.
pub(crate) struct FrameFiles {
    /// The outputs that they belong to, with this frame alone.
    pub(crate) outputs: Vec<OutputFiles>,
    /// What was written; `None`: the files were up to date.
    pub(crate) written: Option<Written>,
    /// Outputs that this batch does not write and whose file of the frame shows something else, with this frame alone.
    pub(crate) stale: Vec<OutputFiles>,
}

impl FrameFiles {
    /// Whether the files are as they were written for this target.
    pub(crate) fn are_recorded(&self, out: &ShotFolder, records: &FileRecords, target: &FileTarget) -> bool {
        let files: Vec<String> =
            self.outputs.iter().map(|output| output.file_name(output.frames.first)).collect();
        records.confirm(out, &files, target.key)
    }
}

/// The account of the files written for one stream of a frame.
pub(crate) struct Written {
    /// The files.
    pub(crate) record: FileRecord,
    /// The product's own figures in the line of the record.
    pub(crate) record_figures: Map<String, Value>,
    pub(crate) triangles: u64,
    /// One line about the frame.
    pub(crate) figures: String,
}

impl Written {
    /// The account of files of a target, none of which is written yet.
    pub(crate) fn of(target: &FileTarget) -> Self {
        let record = FileRecord::new(target.index, &target.name, target.key, target.state);
        Self { record, record_figures: Map::new(), triangles: 0, figures: String::new() }
    }

    /// Adds the file of an output, which has one frame.
    pub(crate) fn add(&mut self, output: &OutputFiles, file: WrittenFile) {
        self.record.add(output.file_name(output.frames.first), file);
    }
}

impl FrameOutcome {
    /// A frame of which nothing is made yet.
    pub(crate) fn new(index: FrameIndex) -> Self {
        Self { index, notes: Vec::new(), files: Vec::new(), failed: Vec::new() }
    }

    /// Adds the lines of the files that were written to the product's records.
    ///
    /// # Errors
    /// If they cannot be written.
    pub(crate) fn record(&self, out: &ShotFolder, product: &str, control: Control) -> Result<(), RunError> {
        for Written { record, record_figures, .. } in
            self.files.iter().filter_map(|files| files.written.as_ref())
        {
            file_records::append(out, product, record, record_figures, control)?;
        }
        Ok(())
    }

    /// Whether something of the frame could not be made.
    pub(crate) fn has_failed(&self) -> bool {
        !self.failed.is_empty()
    }

    /// Records that something could not be made; the batch continues.
    pub(crate) fn fail(&mut self, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name: format!("frame {}", self.index), why, kind });
    }
}

/// The account of a batch that writes to a shot folder.
pub(crate) struct Ledger<'a> {
    out: &'a ShotFolder,
    product: &'a dyn ProductFolder,
    summary: BatchSummary,
    /// The outputs whose files are present, and of which frames.
    written: Vec<(OutputFiles, Vec<u32>)>,
    failed: Vec<FailedFrame>,
    /// Outputs to be removed from the manifest.
    stale: Vec<OutputFiles>,
    /// Whether outputs of the product's folder that this batch does not write are removed from the manifest.
    replaces_outputs: bool,
    /// No other process may remove what looks like the temporary of a crashed run; others may write other frames.
    lock: Lock,
}

impl<'a> Ledger<'a> {
    /// Prepares the product's folder for writing. Several processes may write its files: each is written whole.
    ///
    /// # Errors
    /// If it cannot be written, or another process clears it.
    pub(crate) fn new(
        out: &'a ShotFolder,
        product: &'a dyn ProductFolder,
        control: Control,
    ) -> Result<Self, RunError> {
        let folder = out.subfolder(product.name());
        ShotFolder::create(&folder)?;
        Manifest::clean_root(out, control)?;
        if !clean_if_alone(&folder)? {
            control.reporter.note(&no_locks(&folder));
        }
        let lock = Lock::share(&folder, &control)?;
        let summary = BatchSummary { folder, ..BatchSummary::default() };
        let (written, failed, stale) = (Vec::new(), Vec::new(), Vec::new());
        Ok(Self { out, product, summary, written, failed, stale, replaces_outputs: false, lock })
    }

    /// Records and reports what became of a frame. Frames come in ascending order.
    pub(crate) fn add_frame(&mut self, outcome: FrameOutcome, control: Control) {
        outcome.notes.iter().for_each(|note| control.reporter.note(note));
        for FrameFiles { outputs, written, stale } in outcome.files {
            self.stale.extend(stale);
            outputs.into_iter().for_each(|output| self.add_output(output));
            let Some(written) = written else {
                self.summary.kept += 1;
                continue;
            };
            self.summary.made += 1;
            self.summary.bytes += written.record.bytes();
            self.summary.triangles += written.triangles;
            control.reporter.frame(&written.figures);
        }
        self.failed.extend(outcome.failed);
    }

    /// Adds an output that has one frame.
    fn add_output(&mut self, output: OutputFiles) {
        let frame = output.frames.first;
        match self.written.iter_mut().find(|(known, _)| known.is_same(&output)) {
            None => self.written.push((output, vec![frame])),
            Some((known, frames)) => {
                frames.push(frame);
                known.attributes.extend(output.attributes);
                let grids = output.grids.into_iter();
                let new: Vec<String> = grids.filter(|grid| !known.grids.contains(grid)).collect();
                known.grids.extend(new);
            }
        }
    }

    /// Adds an output that has the frames `frames`, all in the files of one record; `None`: they were up to date.
    ///
    /// # Errors
    /// If the record cannot be written.
    pub(crate) fn add_sequence(
        &mut self,
        output: OutputFiles,
        frames: &[u32],
        written: Option<&FileRecord>,
        control: Control,
    ) -> Result<(), RunError> {
        self.written.push((output, frames.to_vec()));
        match written {
            Some(record) => {
                self.summary.made += 1;
                self.summary.bytes += record.bytes();
                let (product, figures) = (self.product.name(), Map::new());
                file_records::append(self.out, product, record, &figures, control)?;
            }
            None => self.summary.kept += 1,
        }
        Ok(())
    }

    /// Adds an output of which the files of these frames are there, made by this batch or before.
    pub(crate) fn add_present(&mut self, output: OutputFiles, frames: &[u32]) {
        self.written.push((output, frames.to_vec()));
    }

    /// Adds the figures of an earlier batch of the same product.
    pub(crate) fn add_figures(&mut self, earlier: &BatchSummary) {
        self.summary.kept += earlier.kept;
        self.summary.made += earlier.made;
        self.summary.bytes += earlier.bytes;
        self.summary.triangles += earlier.triangles;
    }

    /// Removes outputs of the product's folder from the manifest that this batch does not write.
    pub(crate) fn replace_outputs(&mut self) {
        self.replaces_outputs = true;
    }

    /// Records a frame that failed.
    pub(crate) fn add_failed(&mut self, failed: FailedFrame) {
        self.failed.push(failed);
    }

    /// Names the written files in the manifest, however the batch ended, and sums it up. `frames` ascend.
    ///
    /// # Errors
    /// What ended the batch; else what could not be written; else the frames that failed.
    pub(crate) fn finish(
        mut self,
        title: &str,
        fps: f64,
        frames: &[u32],
        outcome: Result<(), RunError>,
        control: Control,
    ) -> Result<BatchSummary, RunError> {
        let named = self.update_manifest(title, fps, control);
        // What ended the batch comes before what went wrong because of it.
        outcome?;
        named?;
        file_records::compact(self.out, self.product.name(), control)?;
        let notes = self.product.finish(self.out)?;
        // What was killed while others wrote left its temporary: the last one to end removes it.
        drop(self.lock);
        clean_if_alone(&self.summary.folder)?;
        self.summary.frames = frames.len();
        self.summary.lines = [self.product.summary(&self.summary)].into_iter().chain(notes).collect();
        match self.failed {
            failed if failed.is_empty() => Ok(self.summary),
            failed => {
                // The frames that were made are reported as well.
                self.summary.lines.iter().for_each(|line| control.reporter.note(line));
                Err(RunError::SomeFailed { failed, requested: frames.len() })
            }
        }
    }

    /// Adds the written outputs to the folder's manifest.
    fn update_manifest(&mut self, title: &str, fps: f64, control: Control) -> Result<(), RunError> {
        let mut made: Vec<u32> = self.written.iter().flat_map(|(_, frames)| frames).copied().collect();
        made.sort_unstable();
        made.dedup();
        let all = FrameSpan::of(&made);
        if all.is_none() && !self.replaces_outputs {
            return Ok(());
        }
        let _lock = Manifest::lock(self.out, control)?;
        let mut manifest = match (Manifest::read(self.out)?, all) {
            // The frames of a simulation are those that were requested of it.
            (Some(old), Some(all)) if old.simulation.is_none() => {
                Manifest { title: title.into(), fps, frames: old.frames.union(all), ..old }
            }
            (Some(old), _) => Manifest { title: title.into(), fps, ..old },
            (None, Some(all)) => Manifest::new(title, fps, all),
            (None, None) => return Ok(()),
        };
        manifest.outputs.retain(|output| !self.stale.iter().any(|stale| stale.is_same(output)));
        if self.replaces_outputs {
            let folder = format!("{}/", self.product.name());
            manifest.outputs.retain(|output| !output.pattern.starts_with(&folder));
        }
        for (mut output, numbers) in std::mem::take(&mut self.written) {
            output.frames = FrameSpan::of(&numbers).expect("an output has a frame");
            manifest.put(output, &numbers, self.out);
        }
        manifest.write(self.out)
    }
}

/// Removes the temporaries of crashed processes from a product's folder, unless another process writes there. Returns whether the
/// file system has locks.
///
/// # Errors
/// If the folder cannot be locked, listed or written.
fn clean_if_alone(folder: &Path) -> Result<bool, RunError> {
    match Lock::acquire(folder) {
        Ok(lock) if lock.is_held() => {
            let cleaned = cache::remove_temporaries(folder);
            cleaned.map(|_| true).map_err(|source| RunError::File {
                path: folder.into(),
                source,
                next: "check that the folder can be read and written",
            })
        }
        Ok(_) => Ok(false),
        Err(CacheError::Locked { .. }) => Ok(true),
        Err(why) => Err(why.into()),
    }
}

/// What the user should know where the file system has no locks.
pub(crate) fn no_locks(folder: &Path) -> String {
    format!(
        "{}: the file system has no locks, so other processes are not kept from writing this folder; make sure that none does",
        folder.display()
    )
}
