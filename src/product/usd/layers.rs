//! Sheets and colliders: one binary layer with all frames.

use super::{
    folder::{StageJob, UsdStage},
    frames::KIND,
    sources::Source,
};
use crate::{
    cache,
    control::printable,
    export::{
        ExportError,
        usd::{AnimatedMesh, PointSamples, Poses},
    },
    frame::FrameIndex,
    import::{PointCacheFile, parse_geometry},
    job::{
        Control, FailedFrame, Failure, MAX_POSES, OutputFiles, RunError,
        batch::{Ledger, ProductFolder, file_size},
        file_records::{FileRecord, FileRecords, FileState},
    },
    mesh::Mesh,
    solid::Look,
};
use serde::Deserialize;
use std::io;

/// The largest file of a motion [bytes], as readers of shots limit it.
const MAX_MOTION: u64 = 32 << 20;

/// Memory of making a layer over the size of the PLY file of its mesh: the file, its arrays, the faces around each vertex, and the
/// normals of corners. It is counted, not measured: 440 bytes a vertex with two triangles, of which the smallest file has 38.
const MEMORY_PER_BYTE: u64 = 12;

/// Memory of a layer that does not depend on the size of its mesh [bytes].
const LAYER_MEMORY: u64 = 8 << 20;

/// The largest coordinate of a pose [m].
const MAX_PLACE: f32 = 1e9;

/// The file of a collider's motion: `docs/formats/shot.md`.
#[derive(Deserialize)]
struct MotionFile {
    format: String,
    version: u32,
    look: Look,
    first: u32,
    poses: Vec<[f32; 7]>,
    #[serde(default)]
    scales: Option<Vec<f32>>,
}

/// A layer that is there.
pub(super) struct MadeLayer {
    /// Output of the layer.
    pub(super) output: OutputFiles,
    /// Whether pictures do not show it.
    pub(super) is_hidden: bool,
}

/// Writes the layer of a source unless it is up to date; `None` if it fails, which the ledger then has.
///
/// # Errors
/// What a folder or disk refuses.
pub(super) fn write_layer(
    job: StageJob,
    source: &Source,
    records: &FileRecords,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<Option<MadeLayer>, RunError> {
    match layer(job, source, records, ledger, control) {
        Err(LayerError::Job(error)) => Err(error),
        Err(LayerError::Source(file, why, kind)) => {
            ledger.add_failed(FailedFrame { name: file, why, kind });
            Ok(None)
        }
        Ok(made) => Ok(Some(made)),
    }
}

/// Why a layer is not made.
enum LayerError {
    /// The job ends.
    Job(RunError),
    /// A file of the source is not as it should be: the file, why, and how exit codes distinguish it.
    Source(String, String, Failure),
}

impl<E: Into<RunError>> From<E> for LayerError {
    fn from(error: E) -> Self {
        Self::Job(error.into())
    }
}

fn layer(
    job: StageJob,
    source: &Source,
    records: &FileRecords,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<MadeLayer, LayerError> {
    let files: Vec<&str> = source.output.paths().collect();
    for file in &files {
        expect_valid(job, file)?;
    }
    let fault = |file: &str, why: String| LayerError::Source(file.to_owned(), why, Failure::Corrupt);
    let [main, rest, point_cache @ ..] = &files[..] else {
        return Err(fault(&source.output.pattern, "found no mesh, expected one".into()));
    };
    let motion = (source.output.format == "json").then(|| motion(job, main)).transpose()?;
    let path = (source.group.as_str(), source.name.as_str());
    let key = job.key(&files, path).expect("files that are valid have a record");
    let output = OutputFiles {
        pattern: format!("{}/{}.usdc", UsdStage.name(), source.stem),
        frames: source.output.frames,
        ..OutputFiles::of(KIND, UsdStage.name(), &source.stem, "usdc", FrameIndex(source.output.frames.first))
    };
    let is_hidden = motion.as_ref().is_some_and(|motion| motion.look == Look::Hidden);
    let count = output.frames.count();
    if !(1..=MAX_POSES).contains(&count) {
        let why =
            format!("found {count} frames of it in the manifest, expected 1 to {MAX_POSES}; make it again");
        return Err(fault(main, why));
    }
    let frames: Vec<u32> = output.frames.numbers().collect();
    if !job.request.force && records.confirm(job.out, std::slice::from_ref(&output.pattern), key) {
        ledger.add_sequence(output.clone(), &frames, None, control)?;
        return Ok(MadeLayer { output, is_hidden });
    }
    let mesh = mesh(job, rest, control)?;
    let is_smooth = motion.is_none();
    let samples = if is_smooth { Some(*main) } else { point_cache.first().copied() };
    let open = |file: &str| PointCacheFile::open(&job.shot.root().join(file), mesh.positions.len());
    let opened =
        samples.map(|file| open(file).map_err(|error| fault(file, error.to_string()))).transpose()?;
    let count = opened.as_ref().map_or(0, |file| file.samples);
    if count as u64 > MAX_POSES {
        let why =
            format!("found {count} samples, expected at most {MAX_POSES}; make it again with fewer frames");
        return Err(fault(samples.unwrap_or_default(), why));
    }
    let points =
        opened.as_ref().map(|file| PointSamples { first: file.start, step: file.step, count, is_smooth });
    let poses =
        motion.map(|motion| Poses { first: motion.first, poses: motion.poses, scales: motion.scales });
    let animated = AnimatedMesh { path, mesh: &mesh, points, poses: poses.as_ref() };
    let mut opened = opened;
    let (place, mut failed) = (job.out.root().join(&output.pattern), None);
    let written = animated.write(&job.settings, &place, |number| {
        if control.cancel.is_cancelled() {
            failed = Some(LayerError::Job(RunError::Interrupted));
            return Err(io::ErrorKind::Interrupted.into());
        }
        let file = opened.as_mut().expect("only a point cache has samples");
        file.sample(number).map_err(|error| {
            failed = Some(fault(samples.unwrap_or_default(), error.to_string()));
            io::ErrorKind::InvalidData.into()
        })
    });
    let written = match (written, failed) {
        (_, Some(failed)) => return Err(failed),
        (Err(error), None) if error.kind() == io::ErrorKind::InvalidData => {
            return Err(fault(samples.unwrap_or(rest), error.to_string()));
        }
        (Err(error), None) => return Err(ExportError::Write { path: place, source: error }.into()),
        (Ok(written), None) => written,
    };
    let mut record = FileRecord::new(FrameIndex(output.frames.first), &source.stem, key, None);
    record.add(output.pattern.clone(), written);
    ledger.add_sequence(output.clone(), &frames, Some(&record), control)?;
    Ok(MadeLayer { output, is_hidden })
}

/// Reads the mesh of a sheet or collider, of which a stage has positions and triangles.
fn mesh(job: StageJob, file: &str, control: Control) -> Result<Mesh, LayerError> {
    let fault = |why: String| LayerError::Source(file.to_owned(), why, Failure::Corrupt);
    let path = job.shot.root().join(file);
    let size = file_size(&path);
    let needed = size.saturating_mul(MEMORY_PER_BYTE).saturating_add(LAYER_MEMORY);
    job.request.check_memory(None, |_| needed)?;
    let bytes = cache::read_regular(&path).map_err(|error| fault(error.to_string()))?;
    let geometry = parse_geometry(&path, &bytes).map_err(|error| fault(error.to_string()))?;
    let Some(triangles) = geometry.triangles else {
        return Err(fault("found points, expected a mesh; make it again".into()));
    };
    if geometry.positions.iter().flatten().any(|c| !c.is_finite()) {
        return Err(fault("found a vertex that is not at a finite place".into()));
    }
    if geometry.is_rounded {
        let count = geometry.positions.len();
        control.reporter.note(&format!("{file}: {count} vertices were rounded to single precision"));
    }
    if !geometry.attributes.is_empty() {
        let names: Vec<String> =
            geometry.attributes.iter().map(|channel| printable(&channel.name).into_owned()).collect();
        control.reporter.note(&format!("{file}: not in the stage: the attributes {}", names.join(", ")));
    }
    Ok(Mesh { positions: geometry.positions, triangles, ..Mesh::default() })
}

/// Refuses a file that is not as it was written.
fn expect_valid(job: StageJob, file: &str) -> Result<(), LayerError> {
    let state = match job.records.in_folder_of(file) {
        Some(records) => records.state(job.shot, file),
        None => FileState::Missing,
    };
    let (why, kind) = match state {
        FileState::Valid => return Ok(()),
        FileState::Missing => ("missing".to_owned(), Failure::Missing),
        FileState::Damaged(why) => (why, Failure::Corrupt),
        FileState::Foreign(why) => (why, Failure::Foreign),
    };
    Err(LayerError::Source(file.to_owned(), format!("{why}; make it again"), kind))
}

/// Reads the motion of a collider.
fn motion(job: StageJob, file: &str) -> Result<MotionFile, LayerError> {
    let fault = |why: String| LayerError::Source(file.to_owned(), why, Failure::Corrupt);
    let text = cache::read_text_within(&job.shot.root().join(file), MAX_MOTION);
    let text = text.map_err(|error| fault(error.to_string()))?;
    let motion: MotionFile = serde_json::from_str(&text).map_err(|error| fault(error.to_string()))?;
    let is_own = motion.format == "meniscus-motion" && motion.version == 1;
    let is_pose = |pose: &[f32; 7]| {
        let length: f32 = pose[3..].iter().map(|part| part * part).sum();
        pose[..3].iter().all(|c| c.abs() <= MAX_PLACE) && (length - 1.0).abs() < 1e-3
    };
    let is_scaled = motion.scales.as_ref().is_none_or(|scales| {
        scales.len() == motion.poses.len() && scales.iter().all(|scale| (1e-6..=1e6).contains(scale))
    });
    let has_poses =
        (1..=MAX_POSES).contains(&(motion.poses.len() as u64)) && motion.poses.iter().all(is_pose);
    if is_own && has_poses && is_scaled {
        return Ok(motion);
    }
    Err(fault("found other numbers or fields than a motion has (docs/formats/shot.md); make it again".into()))
}
