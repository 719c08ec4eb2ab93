//! Files made of single streams of frames: skipped if up to date, else checked against the memory limit and written.

use super::{
    frames::{FrameBatch, process_frames},
    ledger::{BatchSummary, FrameFiles, FrameOutcome, ProductFolder},
    request::{BatchRequest, MemoryCheck, within_reserve},
    schedule::FRAME_MEMORY_RESERVE,
    source::{Source, StreamHeader},
    target::FileTarget,
};
use crate::{
    cache,
    control::printable_path,
    frame::{Stream, StreamKind},
    import::ImportError,
    job::{Control, Failure, RunError, ShotFolder, file_records::FileRecords, is_file_name},
};
use std::path::Path;

/// A stream of a frame.
#[derive(Clone, Copy)]
pub(crate) struct StreamInput<'a> {
    pub(crate) stream: &'a Stream,
    /// All streams of the frame, this one among them.
    pub(crate) streams: &'a [Stream],
    /// Distance between its particles at rest [m].
    pub(crate) spacing: f32,
    /// Time since the shot's start [s]; 0 of a file.
    pub(crate) time: f64,
}

/// Writes the files of a product that is made of single streams, with the settings of one batch.
pub(crate) trait StreamWriter: Sync {
    /// Where the files go.
    fn folder(&self) -> &dyn ProductFolder;

    /// Whether files are made of streams of this kind.
    fn accepts(&self, kind: StreamKind) -> bool;

    /// Why there is nothing to write of a cache of which no stream is accepted.
    fn no_stream(&self) -> String {
        format!("no stream of this cache can become a file in `{}`", self.folder().name())
    }

    /// Identifies the files made of a stream whose particles are `spacing` apart at rest [m].
    fn key(&self, stream: &StreamHeader, spacing: f32) -> u64;

    /// The files of a target, if all are present and have its key.
    fn up_to_date(&self, target: &FileTarget) -> Option<FrameFiles>;

    /// The largest memory that writing a stream of so many entries was seen to take [bytes].
    fn max_memory(&self, entries: usize) -> u64;

    /// The memory that writing `stream` needs [bytes]: a bound if that is at most `enough`, else an estimate, which takes longer.
    fn memory(&self, stream: &Stream, spacing: f32, enough: u64) -> u64;

    /// Writes the files of a target. What cannot be made of the stream is recorded in `outcome`.
    ///
    /// # Errors
    /// What a folder or disk refuses; [`RunError::Interrupted`].
    fn write(
        &self,
        input: StreamInput<'_>,
        target: &FileTarget,
        outcome: &mut FrameOutcome,
        control: Control,
    ) -> Result<(), RunError>;
}

/// Writes to `out` what `writer` makes of the frames of `source`.
///
/// # Errors
/// As [`process_frames`]; [`RunError::Request`] if the writer accepts no stream of the cache.
pub(crate) fn process_streams(
    source: Source,
    out: &ShotFolder,
    writer: &dyn StreamWriter,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let frames = source.frames(request.selection.as_ref())?;
    let (frames, followed) = source.follow(frames, request.follow);
    // All frames of a cache have the streams of the first that can be read.
    let streams = frames.iter().find_map(|(_, path)| source.streams(path.as_deref()?));
    if streams.is_some_and(|streams| !streams.iter().any(|&(_, kind)| writer.accepts(kind))) {
        return Err(RunError::Request(writer.no_stream()));
    }
    let (title, fps) = source.title(out, request.fps)?;
    let estimate =
        |path: &Path| writer.max_memory(source.max_entries(path)).saturating_add(FRAME_MEMORY_RESERVE);
    let keys = source.keys()?;
    let records = FileRecords::read(out, writer.folder().name())?;
    let is_single_file = matches!(source, Source::Files { .. }) && frames.len() == 1;
    let batch =
        FrameBatch { frames: &frames, followed, absent: source.absent(), is_single_file, title: &title, fps };
    process_frames(writer.folder(), out, &batch, request, control, estimate, |path, reserved, outcome| {
        if let Some(keys) = &keys {
            keys.expect(&cache::read_header(path)?, path)?;
        }
        let opened = source.open(path, outcome.index, reserved.or(request.max_memory));
        let Some(opened) = within_reserve(reserved, opened)? else { return Ok(MemoryCheck::NeedsMore) };
        let mut pending = Vec::new();
        for (place, header) in opened.headers.iter().enumerate() {
            if !writer.accepts(header.kind) {
                continue;
            }
            let spacing = match &header.spacing {
                Ok(spacing) => *spacing,
                Err(why) => {
                    outcome.fail(format!("{}: {why}", printable_path(path)), Failure::Other);
                    continue;
                }
            };
            if !is_file_name(header.subject()) {
                outcome.fail(crafted_name(&header.name), Failure::Other);
                continue;
            }
            let (name, key) = (header.subject().to_owned(), writer.key(header, spacing));
            let state = matches!(source, Source::Cache(_)).then_some(header.state);
            let target = FileTarget { index: outcome.index, name, key, state };
            match writer
                .up_to_date(&target)
                .filter(|files| !request.force && files.are_recorded(out, &records, &target))
            {
                Some(files) => outcome.files.push(files),
                None => pending.push((place, spacing, target)),
            }
        }
        if pending.is_empty() {
            return Ok(MemoryCheck::Fits);
        }
        let time = opened.time;
        let Some((streams, notes)) = within_reserve(reserved, opened.unpack())? else {
            return Ok(MemoryCheck::NeedsMore);
        };
        // The memory of every stream is checked before the first is written: a second attempt writes all of them.
        for &(place, spacing, _) in &pending {
            let stream = &streams[place];
            if is_single_file && stream.is_empty() {
                return Err(ImportError::NoParticles { path: path.into() }.into());
            }
            let estimate = |enough| writer.memory(stream, spacing, enough);
            if request.check_memory(reserved, estimate)? == MemoryCheck::NeedsMore {
                return Ok(MemoryCheck::NeedsMore);
            }
        }
        for (place, spacing, target) in &pending {
            let stream = &streams[*place];
            let input = StreamInput { stream, streams: &streams, spacing: *spacing, time };
            writer.write(input, target, outcome, control)?;
            if stream.is_empty() {
                let product = writer.folder().name();
                outcome
                    .notes
                    .push(format!("{}: no particles, so its {product} is empty", printable_path(path)));
            }
        }
        outcome.notes.extend(notes.iter().map(|note| format!("{}: {note}", printable_path(path))));
        Ok(MemoryCheck::Fits)
    })
}

/// Why nothing is made of a stream whose name is none for a file.
fn crafted_name(name: &str) -> String {
    format!(
        "found a stream {name:?}, expected a name of which files can be called; the frame is damaged or crafted: simulate the shot again"
    )
}
