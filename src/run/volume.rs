//! The job that turns cached frames, or particle files, into volume files.

use super::{
    Control, FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder, remarks,
    surface::{DEFAULT_FPS, choose, state_key},
    volume_grids::VolumeGrids,
};
use crate::{
    cache::{self, Lock},
    export::{
        ExportError,
        vdb::{self, VolumeGrid, VolumeParams},
    },
    frame::{FrameIndex, Stream},
    import::{self, ImportError, Sequence},
    mesh::{self, SurfaceError, SurfaceParams},
    scene::Frames,
};
use serde::Serialize;
use std::{collections::BTreeMap, path::PathBuf, time::Instant};
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

/// Makes volumes of the frames of `source`'s cache (those of `selection`, or all) in `out`.
///
/// A frame whose file was made from the same state with the same settings is kept, unless `force`.
///
/// # Errors
/// Frames that cannot be read or made are left out and named together at the end ([`RunError::SomeFailed`]); a folder
/// or disk that refuses to be written ends the job at once.
pub fn volume_cache(
    source: &ShotFolder,
    out: &ShotFolder,
    settings: &VolumeSettings,
    selection: Option<&Frames>,
    force: bool,
    control: Control,
) -> Result<Volumes, RunError> {
    let wanted = choose(&cache::list(&source.cache())?, selection);
    let known = match Manifest::read(source)? {
        Some(known) => Some(known),
        None => Manifest::read(out)?,
    };
    let mut writer = Writer::new(out, settings, force)?;
    let outcome = each_frame(&wanted, &mut writer, control);
    let all: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    let (title, fps) = known.map_or(("Untitled".into(), DEFAULT_FPS), |known| (known.title, known.fps));
    writer.finish(&title, fps, &all, outcome)
}

/// Makes a volume of every file of a sequence in `out`; `spacing` [m] is the distance of particles at rest, `fps` the
/// frames a second of the sequence.
///
/// Files of a sequence keep their numbers, as for meshes. Volumes of files are always made anew.
///
/// # Errors
/// A file without particles gives a file with empty grids: a sequence may start before its liquid does. If it is the
/// only one, that is [`ImportError::NoParticles`].
///
/// A file that cannot be read is left out and named at the end ([`RunError::SomeFailed`]), or is the job's error
/// if it is the only one; a folder or disk that refuses to be written ends the job at once.
pub fn volume_files(
    sequence: &Sequence,
    out: &ShotFolder,
    settings: &VolumeSettings,
    spacing: f32,
    fps: f64,
    control: Control,
) -> Result<Volumes, RunError> {
    let mut writer = Writer::new(out, settings, true)?;
    let outcome = each_file(sequence, spacing, &mut writer, control);
    let title = sequence.files().first().and_then(|file| file.file_stem()).unwrap_or_default();
    writer.finish(&title.to_string_lossy(), fps, sequence.numbers(), outcome)
}

/// Makes a volume of every stream of the frames.
fn each_frame(
    wanted: &[(FrameIndex, Option<PathBuf>)],
    writer: &mut Writer,
    control: Control,
) -> Result<(), RunError> {
    control.reporter.begin("volume", wanted.len());
    for (place, (index, path)) in wanted.iter().enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        match path.as_ref().map(|path| cache::read_frame(path)) {
            None => {
                let why = "not in the cache; simulate it first";
                writer.fail(format!("frame {index}"), why.into(), Failure::Other);
            }
            Some(Err(damage)) => {
                writer.fail(format!("frame {index}"), damage.to_string(), Failure::of(&damage));
            }
            Some(Ok((frame, info))) => {
                for stream in &frame.streams {
                    match stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0) {
                        Some(spacing) => {
                            let state = state_key(info.key, *index, &stream.name);
                            writer.make(stream, spacing, *index, state, control)?;
                        }
                        None => {
                            let name = &stream.name;
                            let why =
                                format!("the stream {name} does not say its spacing; simulate it again");
                            writer.fail(format!("frame {index}"), why, Failure::Other);
                        }
                    }
                }
            }
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// Makes a volume of one file after the other.
fn each_file(
    sequence: &Sequence,
    spacing: f32,
    writer: &mut Writer,
    control: Control,
) -> Result<(), RunError> {
    let files = sequence.files();
    control.reporter.begin("volume", files.len());
    for (place, (file, &number)) in files.iter().zip(sequence.numbers()).enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        let note = |text: &str| control.reporter.note(&format!("{}: {text}", file.display()));
        match import::read_particles(file) {
            Ok(imported) if imported.stream.is_empty() && files.len() == 1 => {
                return Err(ImportError::NoParticles { path: file.clone() }.into());
            }
            Ok(imported) => {
                if imported.stream.is_empty() {
                    note("no particles, so its grids are empty");
                }
                imported.ignored.iter().for_each(|line| note(line));
                writer.make(&imported.stream, spacing, FrameIndex(number), 0, control)?;
            }
            Err(why) if files.len() == 1 => return Err(why.into()),
            Err(why) => writer.fail(file.display().to_string(), why.to_string(), Failure::Other),
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// Writes volumes into a shot folder and remembers what failed.
struct Writer<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    force: bool,
    done: Volumes,
    /// Frames whose files are there, and the grids in them, by stream.
    written: BTreeMap<String, (Vec<u32>, Vec<VolumeGrid>)>,
    failed: Vec<FailedFrame>,
    /// Nobody else may write the volumes, or remove what looks like the temporary of a crashed run.
    _lock: Lock,
}

impl<'a> Writer<'a> {
    fn new(out: &'a ShotFolder, settings: &'a VolumeSettings, force: bool) -> Result<Self, RunError> {
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
        Ok(Self { out, settings, force, done, written, failed, _lock: lock })
    }

    /// Remembers a frame that could not be made; the job goes on.
    fn fail(&mut self, name: String, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name, why, kind });
    }

    /// Makes the volume of one stream of one frame.
    fn make(
        &mut self,
        stream: &Stream,
        spacing: f32,
        index: FrameIndex,
        state: u64,
        control: Control,
    ) -> Result<(), RunError> {
        let path = self.done.folder.join(format!("{}_{index}.vdb", stream.name));
        let key = self.key(state, spacing);
        if !self.force && vdb::key_in(&path) == Some(key) {
            self.done.kept += 1;
            self.remember(stream, index, self.obtainable(stream));
            return Ok(());
        }
        let start = Instant::now();
        let keep_going = || !(control.interrupted)();
        let VolumeSettings { surface, volume, grids } = self.settings;
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
        self.remember(stream, index, grids.names());
        self.done.made += 1;
        self.done.bytes += bytes;
        control.reporter.frame(&self.figures(index, &grids, bytes, start.elapsed().as_secs_f64()));
        Ok(())
    }

    /// The key of a volume made from a state.
    fn key(&self, state: u64, spacing: f32) -> u64 {
        let settings = serde_json::to_string(self.settings).expect("settings are plain data");
        let versions = [VOLUME_VERSION, mesh::SURFACE_VERSION];
        xxh3_64(format!("{versions:?} {state:016x} {spacing} {settings}").as_bytes())
    }

    /// The grids that a stream gives.
    fn obtainable(&self, stream: &Stream) -> Vec<VolumeGrid> {
        let moves = stream.vec3("velocity").is_some();
        let wanted = self.settings.grids.iter().copied();
        wanted.filter(|&grid| moves || grid != VolumeGrid::Velocity).collect()
    }

    /// Remembers that the frame has its file.
    fn remember(&mut self, stream: &Stream, index: FrameIndex, grids: Vec<VolumeGrid>) {
        let (frames, named) = self.written.entry(stream.name.clone()).or_default();
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
        if names.len() < self.settings.grids.len() {
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
    ) -> Result<Volumes, RunError> {
        let named = self.name_outputs(title, fps, frames);
        // What ended the job comes before what went wrong because of it.
        outcome?;
        named?;
        match self.failed {
            failed if failed.is_empty() => Ok(self.done),
            failed => Err(RunError::SomeFailed { failed, asked: frames.len() }),
        }
    }

    /// Adds what was written to the folder's manifest.
    fn name_outputs(&self, title: &str, fps: f64, frames: &[u32]) -> Result<(), RunError> {
        let Some(all) = FrameSpan::of(frames).filter(|_| !self.written.is_empty()) else { return Ok(()) };
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
            manifest.put(output, self.out);
        }
        manifest.write(self.out)
    }
}
