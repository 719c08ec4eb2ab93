//! The job that writes sheets: a mesh and a PC2 point cache of all frames, and meshes a frame.
//!
//! A point cache has a sample for every frame from the first to the last, at even distances. Where a frame is missing or damaged the
//! one before stands in its place, and is told.

use super::{
    Control, Done, FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder, Source,
    job::{self, Job},
    sheet_meshes::{BROKEN, NO_SHEETS, SHEET_VERSION, SheetMeshes, mesh_of},
};
use crate::{
    cache::{self, Lock},
    export::{
        MeshFormat, SheetFormat,
        pc2::{self, Head, Pc2Error},
    },
    frame::FrameIndex,
    math::Vec3,
    mesh::Mesh,
    sim::sheet::sheet_of,
};
use std::{collections::BTreeMap, path::PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// How sheets are written.
#[derive(Clone, Debug, PartialEq)]
pub struct SheetSettings {
    /// The files to write.
    pub formats: Vec<SheetFormat>,
    /// How thick sheets are [m]; `None`: surfaces without a thickness.
    pub thickness: Option<f32>,
}

/// What the job did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SheetsDone {
    /// Point caches written.
    pub made: usize,
    /// Those that were there already, of the same frames.
    pub kept: usize,
    /// Samples of each.
    pub samples: u64,
    /// Bytes written.
    pub bytes: u64,
    /// Where they are.
    pub folder: PathBuf,
    /// The meshes, if any were asked for.
    pub meshes: Option<Done>,
}

impl SheetsDone {
    /// What was done, a line each.
    pub fn lines(&self) -> Vec<String> {
        let Self { made, kept, samples, bytes, folder, meshes } = self;
        let mib = *bytes as f64 / f64::from(1 << 20);
        let caches = (made + kept > 0).then(|| {
            format!(
                "{}: {made} sheets of {samples} frames written ({mib:.1} MiB), {kept} were there",
                folder.display()
            )
        });
        caches.into_iter().chain(meshes.iter().flat_map(Done::lines)).collect()
    }
}

/// Writes the sheets of the cache of `shot` to `out`.
///
/// Files that were made of the same frames with the same settings are kept, unless the job forces them.
///
/// # Errors
/// [`RunError::Request`] if the cache has no sheets. Frames that are missing or damaged are named together at the end
/// ([`RunError::SomeFailed`]); a folder or disk that refuses ends the job at once.
pub fn sheets(
    shot: &ShotFolder,
    out: &ShotFolder,
    settings: &SheetSettings,
    job: &Job,
    control: Control,
) -> Result<SheetsDone, RunError> {
    let source = Source::Cache(shot);
    let mut done = SheetsDone { folder: out.sheets(), ..SheetsDone::default() };
    let mut failed = None;
    let formats: Vec<MeshFormat> = settings.formats.iter().filter_map(|format| format.of_frames()).collect();
    if !formats.is_empty() {
        let maker = SheetMeshes::new(out, &formats, settings.thickness);
        match job::run(source, out, &maker, job, control) {
            Ok(meshes) => done.meshes = Some(meshes),
            // Frames that fail as meshes do not keep the point caches from being written.
            Err(why @ RunError::SomeFailed { .. }) => failed = Some(why),
            Err(why) => return Err(why),
        }
    }
    if settings.formats.contains(&SheetFormat::Pc2) {
        let frames = Frames::find(&source, shot, job)?;
        write_caches(&frames, out, settings.thickness, job.force, &mut done, control)?;
        name_outputs(&frames, &source, out, job.fps)?;
        if !frames.failed.is_empty() {
            done.lines().iter().for_each(|line| control.reporter.note(line));
            let asked = frames.span.count() as usize;
            return Err(RunError::SomeFailed { failed: frames.failed, asked });
        }
    }
    failed.map_or(Ok(done), Err)
}

/// Whether the first cached frame that can be read has sheets.
///
/// # Errors
/// If the cache cannot be listed.
pub fn has_sheets(shot: &ShotFolder) -> Result<bool, RunError> {
    let source = Source::Cache(shot);
    let names = cache::list(&shot.cache())?.iter().find_map(|(_, path)| source.names(path));
    Ok(names.is_some_and(|names| names.iter().any(|name| sheet_of(name).is_some())))
}

/// The frames that are there.
struct Frames {
    /// All that the caches have a sample of.
    span: FrameSpan,
    /// The file of each that can be read, and what identifies its state.
    files: BTreeMap<u32, (PathBuf, u64)>,
    /// The sheets.
    names: Vec<String>,
    /// Why the others cannot be.
    failed: Vec<FailedFrame>,
}

impl Frames {
    fn find(source: &Source<'_>, shot: &ShotFolder, job: &Job) -> Result<Self, RunError> {
        let wanted = source.wanted(job.selection.as_ref())?;
        let numbers: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
        let Some(span) = FrameSpan::of(&numbers) else { return Err(RunError::Request(NO_SHEETS.into())) };
        // Frames between those that were asked for have a sample too.
        let there: BTreeMap<u32, PathBuf> =
            cache::list(&shot.cache())?.into_iter().map(|(index, path)| (index.0, path)).collect();
        let (mut files, mut failed) = (BTreeMap::new(), Vec::new());
        for frame in span.numbers() {
            let (why, kind) = match there.get(&frame).map(|path| (path, cache::verify_frame(path))) {
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
        let names = first.and_then(|(path, _)| source.names(path)).unwrap_or_default();
        let names: Vec<String> = names.into_iter().filter(|name| sheet_of(name).is_some()).collect();
        match (files.is_empty(), names.is_empty()) {
            (true, _) => Err(RunError::SomeFailed { asked: failed.len(), failed }),
            (_, true) => Err(RunError::Request(NO_SHEETS.into())),
            _ => Ok(Self { span, files, names, failed }),
        }
    }

    /// The frame that stands for this one: it, the last that can be read before, or the first after.
    fn nearest(&self, frame: u32) -> &PathBuf {
        let before = self.files.range(..=frame).next_back();
        let (_, (path, _)) = before.or(self.files.first_key_value()).expect("some frame can be read");
        path
    }

    /// Identifies what is written of all frames.
    fn key(&self, thickness: Option<f32>) -> u64 {
        let states: Vec<String> =
            self.files.iter().map(|(frame, (_, key))| format!("{frame} {key:016x}")).collect();
        xxh3_64(format!("pc2 {SHEET_VERSION} {:?} {thickness:?} {}", self.span, states.join(" ")).as_bytes())
    }

    /// A sheet as it is in a frame.
    fn mesh(&self, name: &str, frame: u32, thickness: Option<f32>) -> Result<Mesh, RunError> {
        let (found, _) = cache::read_frame(self.nearest(frame))?;
        let mesh = found.stream(name).and_then(|stream| mesh_of(stream, &found.streams, thickness));
        mesh.ok_or_else(|| RunError::Request(format!("frame {}: {BROKEN}", FrameIndex(frame))))
    }
}

fn write_caches(
    frames: &Frames,
    out: &ShotFolder,
    thickness: Option<f32>,
    force: bool,
    done: &mut SheetsDone,
    control: Control,
) -> Result<(), RunError> {
    let folder = out.sheets();
    ShotFolder::create(&folder)?;
    let _lock = Lock::acquire(&folder)?;
    let next = "check that the folder can be read and written";
    cache::remove_temporaries(&folder).map_err(|source| RunError::File {
        path: folder.clone(),
        source,
        next,
    })?;
    let numbers: Vec<u32> = frames.span.numbers().collect();
    let key = frames.key(thickness);
    done.samples = numbers.len() as u64;
    control.reporter.begin("sheet", frames.names.len() * numbers.len());
    for (place, name) in frames.names.iter().enumerate() {
        let output = files(frames, name);
        let (points, rest) = paths(&output, out);
        let first = frames.mesh(name, frames.span.first, thickness)?;
        let head = Head {
            points: first.positions.len(),
            start: frames.span.first as f32,
            step: frames.span.step as f32,
            samples: numbers.len(),
        };
        // The mesh is written last, so its key vouches for both.
        let whole = std::fs::metadata(&points).is_ok_and(|about| about.len() == head.size());
        if !force && whole && MeshFormat::Ply.key_in(&rest) == Some(key) {
            done.kept += 1;
            continue;
        }
        let sample = |number: usize| -> Result<Vec<Vec3>, RunError> {
            if (control.interrupted)() {
                return Err(RunError::Interrupted);
            }
            let mesh = frames.mesh(name, numbers[number], thickness)?;
            control.reporter.progress((place * numbers.len() + number + 1) as f64);
            Ok(mesh.positions)
        };
        done.bytes += pc2::write(&points, head, sample).map_err(|error| match error {
            Pc2Error::Sample(error) => error,
            Pc2Error::Export(error) => error.into(),
        })?;
        done.bytes += MeshFormat::Ply.write(&Mesh { attributes: Vec::new(), ..first }, &rest, key)?;
        done.made += 1;
    }
    control.reporter.end();
    Ok(())
}

/// The files of a sheet.
fn files(frames: &Frames, stream: &str) -> OutputFiles {
    OutputFiles::sheet("sheet", sheet_of(stream).expect("these are sheets"), frames.span)
}

/// The point cache and the mesh.
fn paths(output: &OutputFiles, out: &ShotFolder) -> (PathBuf, PathBuf) {
    let rest = output.rest.as_deref().expect("a sheet has a mesh");
    (out.root().join(&output.pattern), out.root().join(rest))
}

fn name_outputs(frames: &Frames, source: &Source<'_>, out: &ShotFolder, fps: f64) -> Result<(), RunError> {
    let (title, fps) = source.title(out, fps)?;
    let _lock = Manifest::lock(out)?;
    let mut manifest = match Manifest::read(out)? {
        Some(old) => Manifest { title, fps, frames: old.frames.union(frames.span), ..old },
        None => Manifest::new(&title, fps, frames.span),
    };
    let numbers: Vec<u32> = frames.span.numbers().collect();
    for name in &frames.names {
        manifest.put(files(frames, name), &numbers, out);
    }
    manifest.write(out)
}
