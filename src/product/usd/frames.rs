//! Meshes and points: a binary layer for each frame, made of the frame's PLY file.

use super::{
    folder::{StageJob, UsdStage},
    sources::Source,
};
use crate::{
    cache,
    control::printable_path,
    export::usd::GeometryLayer,
    frame::FrameIndex,
    import::{Geometry, parse_geometry},
    job::{
        Control, Failure, OutputFiles, RunError,
        batch::{
            BatchSummary, FileTarget, FrameBatch, FrameFiles, FrameOutcome, MemoryCheck, ProductFolder,
            Written, choose, file_size, process_frames,
        },
        file_records::{FileRecords, RecordedFile, hex},
    },
};
use std::{
    collections::{BTreeMap, HashMap},
    path::{Path, PathBuf},
    time::Instant,
};
use xxhash_rust::xxh3::xxh3_64;

/// The kind of the files in manifests.
pub(super) const KIND: &str = "usd";

/// Memory of making a layer over the size of its PLY file: the file, its columns, the arrays of the layer and their compression.
/// 2.3 was measured with a mesh of 332 000 vertices.
const MEMORY_PER_BYTE: u64 = 3;

/// Memory of a frame that does not depend on the size of its files [bytes].
const FRAME_MEMORY: u64 = 8 << 20;

/// Why a frame that was requested has no layer.
const ABSENT: &str = "no file of a mesh or of points has this number; make it first, or leave the frame out";

/// The output that the layer of a frame belongs to, with that frame alone.
pub(super) fn output(source: &Source, index: FrameIndex) -> OutputFiles {
    OutputFiles::of(KIND, UsdStage.name(), &source.stem, "usdc", index)
}

/// Writes the layers of all sequences, frame by frame. Frames that are up to date are kept.
///
/// # Errors
/// Frames that cannot be made are reported together at the end ([`RunError::SomeFailed`]); a folder or disk that refuses ends it.
pub(super) fn write_frames(
    job: StageJob,
    sequences: &[Source],
    title: &str,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let StageJob { shot, out, request, .. } = job;
    let mut present: BTreeMap<u32, PathBuf> = BTreeMap::new();
    // The work on a frame is known by the path of one of its files.
    let mut sizes: HashMap<PathBuf, u64> = HashMap::new();
    for source in sequences {
        for &frame in &source.frames {
            let file = source.output.file(shot, frame);
            let size = file_size(&file);
            let first = present.entry(frame).or_insert(file);
            let largest = sizes.entry(first.clone()).or_insert(0);
            *largest = size.max(*largest);
        }
    }
    let present: Vec<(FrameIndex, PathBuf)> =
        present.into_iter().map(|(frame, path)| (FrameIndex(frame), path)).collect();
    let frames = choose(&present, request.selection.as_ref())?;
    let records = FileRecords::read(out, UsdStage.name())?;
    let batch = FrameBatch {
        frames: &frames,
        followed: None,
        absent: ABSENT,
        is_single_file: false,
        title,
        fps: job.settings.fps,
    };
    let estimate = |path: &Path| memory(sizes.get(path).copied().unwrap_or(0));
    process_frames(&UsdStage, out, &batch, request, control, estimate, |path, reserved, outcome| {
        let needed = memory(sizes.get(path).copied().unwrap_or(0));
        if request.check_memory(reserved, |_| needed)? == MemoryCheck::NeedsMore {
            return Ok(MemoryCheck::NeedsMore);
        }
        let frame = outcome.index.0;
        for source in sequences.iter().filter(|source| source.frames.binary_search(&frame).is_ok()) {
            write_frame(job, source, &records, outcome)?;
        }
        Ok(MemoryCheck::Fits)
    })
}

/// The memory of making the layer of a file of so many bytes [bytes].
fn memory(file: u64) -> u64 {
    file.saturating_mul(MEMORY_PER_BYTE).saturating_add(FRAME_MEMORY)
}

/// Writes the layer of a frame of a sequence, unless it is up to date.
fn write_frame(
    job: StageJob,
    source: &Source,
    records: &FileRecords,
    outcome: &mut FrameOutcome,
) -> Result<(), RunError> {
    let start = Instant::now();
    let index = outcome.index;
    let file = source.output.file_name(index.0);
    let path = (source.group.as_str(), source.name.as_str());
    let (Some(key), Some((recorded, about))) = (job.key(&[&file], path), job.records.of(&file)) else {
        outcome.fail(format!("{file}: no record of its checksum; make it again"), Failure::Foreign);
        return Ok(());
    };
    let state = recorded.state.as_ref().and_then(|state| u64::from_str_radix(state, 16).ok());
    let target = FileTarget { index, name: source.stem.clone(), key, state };
    let output = output(source, index);
    let made = FrameFiles { outputs: vec![output.clone()], written: None, stale: Vec::new() };
    if !job.request.force && made.are_recorded(job.out, records, &target) {
        outcome.files.push(made);
        return Ok(());
    }
    let place = job.shot.root().join(&file);
    let geometry = match read(job, &place, about) {
        Ok(geometry) => geometry,
        Err((why, kind)) => {
            outcome.fail(format!("{file}: {why}"), kind);
            return Ok(());
        }
    };
    let layer = match GeometryLayer::new(&geometry, &job.settings, job.params.names, index.0, path) {
        Ok(layer) => layer,
        Err(why) => {
            outcome.fail(format!("{file}: {why}"), Failure::Other);
            return Ok(());
        }
    };
    let remarks = layer.remarks;
    let counted = [
        (remarks.not_finite, "numbers of attributes are not finite"),
        (remarks.wrapped, "integers above 2147483647 became negative, with the same bits"),
        (
            if geometry.is_rounded { geometry.positions.len() } else { 0 },
            "vertices were rounded to single precision",
        ),
    ];
    let counted = counted.iter().filter(|(count, _)| *count > 0);
    outcome.notes.extend(counted.map(|(count, what)| format!("{}: {count} {what}", printable_path(&place))));
    let mut written = Written::of(&target);
    written.triangles = geometry.triangles.as_ref().map_or(0, |triangles| triangles.len() as u64);
    let count = geometry.positions.len();
    drop(geometry);
    written.add(&output, layer.write(&output.file(job.out, index.0))?);
    let (mib, seconds) = (written.record.bytes() as f64 / f64::from(1 << 20), start.elapsed().as_secs_f64());
    written.figures = format!("frame {index}  {}  {count} points  {mib:.2} MiB  {seconds:.2} s", source.stem);
    outcome.files.push(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() });
    Ok(())
}

/// Reads a file that is as it was written.
///
/// # Errors
/// Why it is not, and how exit codes distinguish it.
fn read(job: StageJob, place: &Path, about: &RecordedFile) -> Result<Geometry, (String, Failure)> {
    if cache::leads_out(job.shot.root(), place) {
        let why = "a symbolic link leads out of the shot's folder; replace it by a copy";
        return Err((why.to_owned(), Failure::Foreign));
    }
    // Read once, so that what is parsed is what was compared.
    let bytes =
        cache::read_regular(place).map_err(|error| (format!("{error}; make it again"), Failure::Corrupt))?;
    if bytes.len() as u64 != about.bytes || hex(xxh3_64(&bytes)) != about.xxh3 {
        return Err(("found other bytes than were written; make it again".to_owned(), Failure::Corrupt));
    }
    parse_geometry(place, &bytes).map_err(|error| (error.to_string(), Failure::Corrupt))
}
