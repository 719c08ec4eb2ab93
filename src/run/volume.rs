//! The job that turns cached frames, or particle files, into volume files.

use super::{
    Control, FailedFrame, Failure, FileSettings, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder,
    plan::{Product, refuse_memory, stream_memory},
    remarks,
    surface::{DEFAULT_FPS, choose, state_key},
    surface_files::{NO_FILE, numbered},
    volume_grids::VolumeGrids,
};
use crate::{
    cache::{self, Lock},
    export::{
        ExportError,
        vdb::{self, VolumeGrid, VolumeParams},
    },
    frame::{FrameIndex, Stream},
    import::{self, ImportError, ParticleFile, Sequence},
    mesh::{self, SurfaceError, SurfaceParams},
    scene::Frames,
};
use serde::Serialize;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Instant,
};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a volume holds gives the same particles and settings another file. Changes of the
/// surface raise [`mesh::SURFACE_VERSION`].
const VOLUME_VERSION: u32 = 1;

/// What is made of every frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct VolumeSettings {
    /// How particles become a density.
    pub surface: SurfaceParams,
    /// How grids are stored.
    pub volume: VolumeParams,
    /// Which grids a file has; at least one.
    pub grids: Vec<VolumeGrid>,
}

/// What a job is to do that makes volumes, whatever its source.
#[derive(Clone, Debug)]
pub struct VolumeJob {
    /// What is made of every frame.
    pub settings: VolumeSettings,
    /// The frames to use; `None`: all that are there.
    pub selection: Option<Frames>,
    /// Make again what is there already.
    pub force: bool,
    /// What no frame may exceed, as far as it can be estimated [bytes].
    pub max_memory: Option<u64>,
}

/// What a job did that makes volumes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Volumes {
    /// Frames whose files were there already, made from the same state with the same settings.
    pub kept: usize,
    /// Frames made.
    pub made: usize,
    /// Bytes written.
    pub bytes: u64,
    /// Where the files are.
    pub folder: PathBuf,
}

impl Volumes {
    /// What was done, in one line.
    pub fn line(&self) -> String {
        format!(
            "{}: {} volumes written ({:.1} MiB), {} were there",
            self.folder.display(),
            self.made,
            self.bytes as f64 / f64::from(1 << 20),
            self.kept
        )
    }
}

/// Makes volumes of the frames of `source`'s cache in `out`.
///
/// A frame whose file was made from the same state with the same settings is kept, unless the job forces it.
///
/// # Errors
/// Frames that cannot be read or made are left out and named together at the end ([`RunError::SomeFailed`]); a folder
/// or disk that refuses to be written ends the job at once.
pub fn volume_cache(
    source: &ShotFolder,
    out: &ShotFolder,
    job: &VolumeJob,
    control: Control,
) -> Result<Volumes, RunError> {
    let wanted = choose(&cache::list(&source.cache())?, job.selection.as_ref())?;
    let known = match Manifest::read(source)? {
        Some(known) => Some(known),
        None => Manifest::read(out)?,
    };
    let mut writer = Writer::new(out, job)?;
    let all = writer.numbers(&wanted, control);
    let outcome = writer.each(&wanted, control, |writer, index, path| writer.frame(index, path, control));
    let (title, fps) = known.map_or(("Untitled".into(), DEFAULT_FPS), |known| (known.title, known.fps));
    writer.finish(&title, fps, &all, outcome, control)
}

/// Makes a volume of every file of a sequence in `out`.
///
/// Files of a sequence keep their numbers, as for meshes. One whose volume was made from the same bytes with the same
/// settings is kept, unless the job forces it.
///
/// # Errors
/// A file without particles gives a file with empty grids: a sequence may start before its liquid does. If it is the
/// only one, that is [`ImportError::NoParticles`].
///
/// A file that cannot be read, or needs more memory than the job allows, is left out and named at the end
/// ([`RunError::SomeFailed`]); one that cannot be read is the job's error if it is the only one. A folder or disk that
/// refuses to be written ends the job at once.
pub fn volume_files(
    sequence: &Sequence,
    out: &ShotFolder,
    files: FileSettings,
    job: &VolumeJob,
    control: Control,
) -> Result<Volumes, RunError> {
    let wanted = choose(&numbered(sequence), job.selection.as_ref())?;
    let mut writer = Writer::new(out, job)?;
    let all = writer.numbers(&wanted, control);
    let alone = wanted.len() == 1;
    let outcome = writer.each(&wanted, control, |writer, index, path| {
        let Some(path) = path else {
            writer.fail(format!("frame {index}"), NO_FILE.into(), Failure::Other);
            return Ok(());
        };
        match writer.file(index, path, files.spacing, alone, control) {
            Err(RunError::Import(why)) if !alone => {
                writer.fail(format!("frame {index}"), why.to_string(), Failure::Other);
                Ok(())
            }
            done => done,
        }
    });
    let title = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
    writer.finish(&title.to_string_lossy(), files.fps, &all, outcome, control)
}

/// Writes volumes into a shot folder and remembers what failed.
struct Writer<'a> {
    out: &'a ShotFolder,
    job: &'a VolumeJob,
    done: Volumes,
    /// Frames whose files are there, and the grids in them, by stream.
    written: BTreeMap<String, (Vec<u32>, Vec<VolumeGrid>)>,
    failed: Vec<FailedFrame>,
    /// Nobody else may write the volumes, or remove what looks like the temporary of a crashed run.
    _lock: Lock,
}

impl<'a> Writer<'a> {
    fn new(out: &'a ShotFolder, job: &'a VolumeJob) -> Result<Self, RunError> {
        let folder = out.volumes();
        ShotFolder::create(&folder)?;
        let lock = Lock::acquire(&folder)?;
        cache::remove_temporaries(&folder).map_err(|source| RunError::File {
            path: folder.clone(),
            source,
            next: "check that the folder can be read and written",
        })?;
        let done = Volumes { folder, ..Volumes::default() };
        let (written, failed) = (BTreeMap::new(), Vec::new());
        Ok(Self { out, job, done, written, failed, _lock: lock })
    }

    /// Remembers a frame that could not be made; the job goes on.
    fn fail(&mut self, name: String, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name, why, kind });
    }

    /// The numbers of the frames; tells those that are missing between them if nobody asked for some of them.
    fn numbers(&self, wanted: &[(FrameIndex, Option<PathBuf>)], control: Control) -> Vec<u32> {
        let all: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
        if self.job.selection.is_none() {
            remarks::of_gaps(&all).iter().for_each(|gaps| control.reporter.note(gaps));
        }
        all
    }

    /// Does `work` for one frame after the other.
    fn each(
        &mut self,
        wanted: &[(FrameIndex, Option<PathBuf>)],
        control: Control,
        work: impl Fn(&mut Self, FrameIndex, Option<&Path>) -> Result<(), RunError>,
    ) -> Result<(), RunError> {
        control.reporter.begin("volume", wanted.len());
        for (place, (index, path)) in wanted.iter().enumerate() {
            if (control.interrupted)() {
                return Err(RunError::Interrupted);
            }
            work(self, *index, path.as_deref())?;
            control.reporter.progress((place + 1) as f64);
        }
        control.reporter.end();
        Ok(())
    }

    /// Makes a volume of every stream of a frame of the cache.
    fn frame(&mut self, index: FrameIndex, path: Option<&Path>, control: Control) -> Result<(), RunError> {
        let name = format!("frame {index}");
        let (frame, info) = match path.map(cache::read_frame) {
            None => {
                self.fail(name, "not in the cache; simulate it first".into(), Failure::Other);
                return Ok(());
            }
            Some(Err(damage)) => {
                self.fail(name, damage.to_string(), Failure::of(&damage));
                return Ok(());
            }
            Some(Ok(read)) => read,
        };
        for stream in &frame.streams {
            let Some(spacing) = stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0) else {
                let why = format!("the stream {} does not say its spacing; simulate it again", stream.name);
                self.fail(name.clone(), why, Failure::Other);
                continue;
            };
            let key = self.key(state_key(info.key, index, &stream.name), spacing);
            if self.is_there(&stream.name, index, key) {
                self.keep(&stream.name, index, self.obtainable(stream));
            } else {
                self.make(stream, spacing, index, key, control)?;
            }
        }
        Ok(())
    }

    /// Makes a volume of a file; `alone` if it is the only one.
    fn file(
        &mut self,
        index: FrameIndex,
        path: &Path,
        spacing: f32,
        alone: bool,
        control: Control,
    ) -> Result<(), RunError> {
        let file = ParticleFile::open(path)?;
        let key = self.key(file.content_key(), spacing);
        if self.is_there(STREAM, index, key)
            && let Ok(names) = import::volume_grids(&self.target(STREAM, index))
        {
            let grids = names.iter().filter_map(|name| VolumeGrid::from_name(name)).collect();
            self.keep(STREAM, index, grids);
            return Ok(());
        }
        let imported = file.particles()?;
        drop(file);
        let note = |text: &str| control.reporter.note(&format!("{}: {text}", path.display()));
        if imported.stream.is_empty() {
            if alone {
                return Err(ImportError::NoParticles { path: path.into() }.into());
            }
            note("no particles, so its grids are empty");
        }
        imported.ignored.iter().for_each(|line| note(line));
        self.make(&imported.stream, spacing, index, key, control)
    }

    /// Where the volume of a stream is.
    fn target(&self, stream: &str, index: FrameIndex) -> PathBuf {
        self.done.folder.join(format!("{stream}_{index}.vdb"))
    }

    /// Whether that has the key already and may stay.
    fn is_there(&self, stream: &str, index: FrameIndex, key: u64) -> bool {
        !self.job.force && vdb::key_in(&self.target(stream, index)) == Some(key)
    }

    /// Remembers a volume that was there, with its grids.
    fn keep(&mut self, stream: &str, index: FrameIndex, grids: Vec<VolumeGrid>) {
        self.done.kept += 1;
        self.remember(stream, index, grids);
    }

    /// Makes the volume of one stream of one frame.
    fn make(
        &mut self,
        stream: &Stream,
        spacing: f32,
        index: FrameIndex,
        key: u64,
        control: Control,
    ) -> Result<(), RunError> {
        let path = self.target(&stream.name, index);
        if let Some(allowed) = self.job.max_memory {
            let needed = stream_memory(Product::Volumes, stream, spacing, &self.job.settings.surface);
            if let Err(why) = refuse_memory(needed, allowed) {
                self.fail(format!("frame {index}"), why.to_string(), Failure::Memory);
                return Ok(());
            }
        }
        let start = Instant::now();
        let keep_going = || !(control.interrupted)();
        let VolumeSettings { surface, volume, grids } = &self.job.settings;
        let grids = match VolumeGrids::new(stream, spacing, surface, grids, &keep_going) {
            Ok(found) if found.names().is_empty() => {
                let why = "the particles have no velocities, and no other grid is asked for";
                self.fail(format!("frame {index}"), why.into(), Failure::Other);
                return Ok(());
            }
            Ok(found) => found,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                self.fail(format!("frame {index}"), why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let bytes = match grids.write(&path, volume, key) {
            Ok(bytes) => bytes,
            Err(why @ ExportError::Volume { .. }) => {
                self.fail(format!("frame {index}"), why.to_string(), Failure::Other);
                return Ok(());
            }
            Err(why) => return Err(why.into()),
        };
        self.remember(&stream.name, index, grids.names());
        self.done.made += 1;
        self.done.bytes += bytes;
        control.reporter.frame(&self.figures(index, &grids, bytes, start.elapsed().as_secs_f64()));
        Ok(())
    }

    /// The key of a volume made from a state.
    fn key(&self, state: u64, spacing: f32) -> u64 {
        let settings = serde_json::to_string(&self.job.settings).expect("settings are plain data");
        let versions = [VOLUME_VERSION, mesh::SURFACE_VERSION];
        xxh3_64(format!("{versions:?} {state:016x} {spacing} {settings}").as_bytes())
    }

    /// The grids that a stream gives.
    fn obtainable(&self, stream: &Stream) -> Vec<VolumeGrid> {
        let moves = stream.vec3("velocity").is_some();
        let wanted = self.job.settings.grids.iter().copied();
        wanted.filter(|&grid| moves || grid != VolumeGrid::Velocity).collect()
    }

    /// Remembers that the frame has its file.
    fn remember(&mut self, stream: &str, index: FrameIndex, grids: Vec<VolumeGrid>) {
        let (frames, named) = self.written.entry(stream.into()).or_default();
        frames.push(index.0);
        named.extend(grids);
        named.sort_unstable();
        named.dedup();
    }

    /// One line about a frame.
    fn figures(&self, index: FrameIndex, grids: &VolumeGrids, bytes: u64, seconds: f64) -> String {
        let names: Vec<&str> = grids.names().into_iter().map(VolumeGrid::name).collect();
        let mib = bytes as f64 / f64::from(1 << 20);
        let bricks = grids.stats.bricks;
        let mut line =
            format!("frame {index}  {}  {bricks} bricks  {mib:.2} MiB  {seconds:.2} s", names.join(", "));
        if names.len() < self.job.settings.grids.len() {
            line += "  the particles have no velocities";
        }
        for remark in remarks::of_volume(&grids.stats) {
            line += &format!("  {remark}");
        }
        line
    }

    /// Names in the manifest what was written, however the job ended, and says how it went. `frames` ascend.
    fn finish(
        self,
        title: &str,
        fps: f64,
        frames: &[u32],
        outcome: Result<(), RunError>,
        control: Control,
    ) -> Result<Volumes, RunError> {
        let named = self.name_outputs(title, fps, frames);
        // What ended the job comes before what went wrong because of it.
        outcome?;
        named?;
        match self.failed {
            failed if failed.is_empty() => Ok(self.done),
            failed => {
                // The frames that were made are told as well.
                control.reporter.note(&self.done.line());
                Err(RunError::SomeFailed { failed, asked: frames.len() })
            }
        }
    }

    /// Adds what was written to the folder's manifest.
    fn name_outputs(&self, title: &str, fps: f64, frames: &[u32]) -> Result<(), RunError> {
        let Some(all) = FrameSpan::of(frames).filter(|_| !self.written.is_empty()) else { return Ok(()) };
        let _lock = Manifest::lock(self.out)?;
        let mut manifest = match Manifest::read(self.out)? {
            Some(old) => Manifest { title: title.into(), fps, frames: old.frames.union(all), ..old },
            None => Manifest::new(title, fps, all),
        };
        for (name, (numbers, grids)) in &self.written {
            let Some(frames) = FrameSpan::of(numbers) else { continue };
            let output = OutputFiles {
                kind: "volume".into(),
                name: name.clone(),
                format: "vdb".into(),
                pattern: format!("volume/{name}_{{:04}}.vdb"),
                frames,
                attributes: BTreeMap::new(),
                grids: grids.iter().map(|grid| grid.name().into()).collect(),
            };
            manifest.put(output, numbers, self.out);
        }
        manifest.write(self.out)
    }
}

/// The stream that files are read as.
const STREAM: &str = "particles";
