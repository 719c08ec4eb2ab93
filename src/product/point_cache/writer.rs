//! Point caches of sheets: a mesh and a PC2 file of its points in all frames.
//!
//! A point cache has a sample for every frame from the first to the last, at equal distances. Where a frame is missing or damaged the
//! one before stands in its place, which is reported.

use crate::{
    cache,
    export::{
        MeshFormat, SheetFormat,
        pc2::{self, Head, Pc2Error},
    },
    frame::{FrameIndex, StreamKind},
    job::{
        Control, FailedFrame, Failure, FrameSpan, OutputFiles, RunError, ShotFolder,
        batch::{BatchRequest, BatchSummary, Ledger, ProductFolder, Source},
        file_records::{FileRecord, FileRecords},
        is_file_name,
        memory::BASE_MEMORY,
    },
    math::Vec3,
    mesh::Mesh,
    product::{
        interface::Product,
        request::{ProductRequest, ProductSettings},
        sheet_mesh::{MISSING_PARTS, POINT_BYTES, SHEET_VERSION, export_arguments, sheet_mesh},
    },
};
use std::{collections::BTreeMap, path::PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Why nothing is made of a cache without sheets.
const NO_SHEETS: &str = "no sheets in this cache";

/// Point caches of sheets, as jobs see them.
pub(in crate::product) struct PointCache;

impl ProductFolder for PointCache {
    fn name(&self) -> &'static str {
        "sheet"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, frames, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} sheets of {frames} frames written ({mib:.1} MiB), {kept} up to date")
    }
}

impl Product for PointCache {
    fn verb(&self) -> &'static str {
        "export"
    }

    fn input(&self) -> &'static str {
        "sheets"
    }

    fn accepts(&self, kind: StreamKind) -> bool {
        kind == StreamKind::MeshPoints
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.output.sheet.contains(&SheetFormat::Pc2)
    }

    fn arguments(&self, settings: &ProductSettings) -> Vec<String> {
        export_arguments(&settings.output, |format| format == SheetFormat::Pc2)
    }

    /// The frames of a point cache are one file.
    fn is_per_frame(&self) -> bool {
        false
    }

    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        Some(("output.sheet", "sheet = [\"pc2\"]"))
    }

    fn max_memory(&self, _: &ProductSettings, _: StreamKind, points: usize) -> f64 {
        BASE_MEMORY + points as f64 * POINT_BYTES
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let Source::Cache(cache) = request.frames()? else {
            return Err(RunError::Request("point caches are made of the cache of a shot alone".into()));
        };
        point_caches(cache, request.out, request.settings.output.thickness, request.batch, control)
    }
}

/// Writes the point caches of all sheets in the cache of `shot` to `out`.
///
/// Files that were made of the same frames with the same settings are kept, unless the request forces them.
///
/// # Errors
/// [`RunError::Request`] if the cache has no sheets. Frames that are missing or damaged are reported together at the end
/// ([`RunError::SomeFailed`]); a folder or disk that refuses ends the batch at once.
fn point_caches(
    shot: &ShotFolder,
    out: &ShotFolder,
    thickness: Option<f32>,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let source = Source::Cache(shot);
    let (frames, failed) = SheetFrames::find(&source, shot, request)?;
    let (title, fps) = source.title(out, request.fps)?;
    let numbers: Vec<u32> = frames.span.numbers().collect();
    let mut ledger = Ledger::new(out, &PointCache, control)?;
    let ended = write_caches(&frames, &numbers, out, thickness, request, &mut ledger, control);
    failed.into_iter().for_each(|failed| ledger.add_failed(failed));
    ledger.finish(&title, fps, &numbers, ended, control)
}

/// The cached frames of sheets.
struct SheetFrames {
    /// All frames that the point caches have a sample of.
    span: FrameSpan,
    /// The file of each that can be read, and the key of its simulation.
    files: BTreeMap<u32, (PathBuf, u64)>,
    /// The streams of the sheets' points.
    streams: Vec<String>,
    /// The memory that the columns of a frame may take [bytes].
    max_memory: Option<u64>,
}

impl SheetFrames {
    /// The frames of a request, and those of them that cannot be read.
    fn find(
        source: &Source<'_>,
        shot: &ShotFolder,
        request: &BatchRequest,
    ) -> Result<(Self, Vec<FailedFrame>), RunError> {
        let requested = source.frames(request.selection.as_ref())?;
        let numbers: Vec<u32> = requested.iter().map(|(index, _)| index.0).collect();
        let Some(span) = FrameSpan::of(&numbers) else { return Err(RunError::Request(NO_SHEETS.into())) };
        // Frames between the requested ones have a sample too.
        let present: BTreeMap<u32, PathBuf> =
            cache::list(&shot.cache())?.into_iter().map(|(index, path)| (index.0, path)).collect();
        let (mut files, mut failed) = (BTreeMap::new(), Vec::new());
        let keys = source.keys()?;
        let verified = |path: &PathBuf| {
            let info = cache::verify_frame(path)?;
            keys.as_ref().map_or(Ok(()), |keys| keys.expect(&info, path))?;
            info.expect_memory(path, request.max_memory).map(|()| info)
        };
        for frame in span.numbers() {
            let (why, kind) = match present.get(&frame).map(|path| (path, verified(path))) {
                Some((path, Ok(info))) => {
                    files.insert(frame, (path.clone(), info.key));
                    continue;
                }
                Some((_, Err(why))) => (why.to_string(), Failure::of(&why)),
                None => (source.absent().into(), Failure::Other),
            };
            let why = format!("{why}; the nearest frame before it stands in its place");
            failed.push(FailedFrame { name: format!("frame {}", FrameIndex(frame)), why, kind });
        }
        let first = files.values().next();
        let streams = first.and_then(|(path, _)| source.streams(path)).unwrap_or_default();
        let points = streams.into_iter().filter(|&(_, kind)| kind == StreamKind::MeshPoints);
        let streams: Vec<String> = points.map(|(name, _)| name).collect();
        if let Some(odd) = streams.iter().find(|stream| !is_file_name(sheet_of(stream))) {
            return Err(RunError::Request(format!(
                "found a stream {odd:?}, expected a name of which files can be called; the frames are damaged or crafted: \
                 simulate the shot again"
            )));
        }
        match (files.is_empty(), streams.is_empty()) {
            (true, _) => Err(RunError::SomeFailed { requested: failed.len(), failed }),
            (_, true) => Err(RunError::Request(NO_SHEETS.into())),
            _ => Ok((Self { span, files, streams, max_memory: request.max_memory }, failed)),
        }
    }

    /// The file whose sample a frame gets: its own, that of the last frame before that can be read, or of the first after.
    fn nearest(&self, frame: u32) -> &PathBuf {
        let before = self.files.range(..=frame).next_back();
        let (_, (path, _)) = before.or(self.files.first_key_value()).expect("some frame can be read");
        path
    }

    /// Identifies the content of the point caches.
    fn key(&self, thickness: Option<f32>) -> u64 {
        let states: Vec<String> =
            self.files.iter().map(|(frame, (_, key))| format!("{frame} {key:016x}")).collect();
        xxh3_64(format!("pc2 {SHEET_VERSION} {:?} {thickness:?} {}", self.span, states.join(" ")).as_bytes())
    }

    /// The mesh of a sheet in a frame.
    fn mesh(&self, stream: &str, frame: u32, thickness: Option<f32>) -> Result<Mesh, RunError> {
        let (found, _) = cache::read_frame_within(self.nearest(frame), self.max_memory)?;
        let mesh = found.stream(stream).and_then(|stream| sheet_mesh(stream, &found.streams, thickness));
        mesh.ok_or_else(|| RunError::Request(format!("frame {}: {MISSING_PARTS}", FrameIndex(frame))))
    }
}

fn write_caches(
    frames: &SheetFrames,
    numbers: &[u32],
    out: &ShotFolder,
    thickness: Option<f32>,
    request: &BatchRequest,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<(), RunError> {
    let key = frames.key(thickness);
    let records = FileRecords::read(out, PointCache.name())?;
    control.reporter.begin(PointCache.name(), frames.streams.len() * numbers.len());
    for (place, stream) in frames.streams.iter().enumerate() {
        let CacheFiles { output, points, rest } = CacheFiles::new(stream, frames.span, out);
        let first = frames.mesh(stream, frames.span.first, thickness)?;
        let head = Head {
            points: first.positions.len(),
            start: frames.span.first as f32,
            step: frames.span.step as f32,
            samples: numbers.len(),
        };
        let files = [&output.pattern, output.rest.as_ref().expect("it has a mesh")].map(String::clone);
        if !request.force && records.confirm(out, &files, key) {
            ledger.add_sequence(output, numbers, None, control)?;
            continue;
        }
        let sample = |number: usize| -> Result<Vec<Vec3>, RunError> {
            if control.cancel.is_cancelled() {
                return Err(RunError::Interrupted);
            }
            let mesh = frames.mesh(stream, numbers[number], thickness)?;
            control.reporter.progress((place * numbers.len() + number + 1) as f64);
            Ok(mesh.positions)
        };
        let written = pc2::write(&points, head, sample).map_err(|error| match error {
            Pc2Error::Sample(error) => error,
            Pc2Error::Export(error) => error.into(),
        })?;
        let mesh = MeshFormat::Ply.write(&Mesh { attributes: Vec::new(), ..first }, &rest, key)?;
        let mut record = FileRecord::new(FrameIndex(frames.span.first), &output.name, key, None);
        for (file, written) in files.into_iter().zip([written, mesh]) {
            record.add(file, written);
        }
        ledger.add_sequence(output, numbers, Some(&record), control)?;
    }
    control.reporter.end();
    Ok(())
}

/// The sheet whose points are in the stream of this name.
fn sheet_of(stream: &str) -> &str {
    stream.rsplit_once('.').map_or(stream, |(_, sheet)| sheet)
}

/// The files of a sheet.
struct CacheFiles {
    output: OutputFiles,
    /// The point cache.
    points: PathBuf,
    /// The mesh whose points it moves.
    rest: PathBuf,
}

impl CacheFiles {
    /// The files of the sheet whose points are in the stream of this name.
    fn new(stream: &str, frames: FrameSpan, out: &ShotFolder) -> Self {
        let sheet = sheet_of(stream);
        let folder = PointCache.name();
        let (pattern, rest) = (format!("{folder}/{sheet}.pc2"), format!("{folder}/{sheet}.ply"));
        let (points, mesh) = (out.root().join(&pattern), out.root().join(&rest));
        let frame = FrameIndex(frames.first);
        let output = OutputFiles {
            pattern,
            rest: Some(rest),
            frames,
            ..OutputFiles::of("sheet", folder, sheet, "pc2", frame)
        };
        Self { output, points, rest: mesh }
    }
}
