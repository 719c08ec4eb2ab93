//! The job that turns cached frames into meshes.

use super::{
    Control, FailedFrame, Failure, FrameSpan, Jump, Manifest, MeshRecord, OutputFiles, RunError, ShotFolder,
    mesh_log, remarks,
};
use crate::{
    cache::{self, Lock},
    export::{self, MeshFormat},
    frame::{FrameIndex, Stream},
    mesh::{self, Mesh, MeshCheck, Surface, SurfaceError, SurfaceParams},
    scene::Frames,
};
use std::{collections::BTreeMap, path::PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// What a surfacing job did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfaced {
    /// Frames whose files were there already, made from the same state with the same settings.
    pub kept: usize,
    /// Frames meshed.
    pub meshed: usize,
    /// Triangles written.
    pub triangles: u64,
    /// Bytes written.
    pub bytes: u64,
    /// Where the files are.
    pub folder: PathBuf,
    /// Changes between the folder's meshes that their neighbours do not suggest.
    pub jumps: Vec<Jump>,
}

/// Meshes the frames of `source`'s cache (those of `selection`, or all) into `out`, in every format.
///
/// A frame whose files were made from the same state with the same settings is kept, unless `force`.
///
/// # Errors
/// Frames that cannot be read or meshed are left out and named together at the end
/// ([`RunError::SomeFailed`]); a folder or disk that refuses to be written ends the job at once.
pub fn surface_cache(
    source: &ShotFolder,
    out: &ShotFolder,
    params: &SurfaceParams,
    formats: &[MeshFormat],
    selection: Option<&Frames>,
    force: bool,
    control: Control,
) -> Result<Surfaced, RunError> {
    let present = cache::list(&source.cache())?;
    let wanted = choose(&present, selection);
    let known = match Manifest::read(source)? {
        Some(known) => Some(known),
        None => Manifest::read(out)?,
    };
    let mut writer = Writer::new(out, params, formats, force)?;
    let outcome = surface_frames(&wanted, &mut writer, control);
    let all: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    let (title, fps) = known.map_or(("Untitled".into(), DEFAULT_FPS), |known| (known.title, known.fps));
    writer.finish(&title, fps, &all, outcome)
}

/// Frames a second of a cache that does not say.
pub(super) const DEFAULT_FPS: f64 = 24.0;

/// Meshes every stream of the frames.
fn surface_frames(
    wanted: &[(FrameIndex, Option<PathBuf>)],
    writer: &mut Writer,
    control: Control,
) -> Result<(), RunError> {
    control.reporter.begin("mesh", wanted.len());
    for (place, (index, path)) in wanted.iter().enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        let Some(path) = path else {
            writer.fail(
                format!("frame {index}"),
                "not in the cache; simulate it first".into(),
                Failure::Other,
            );
            continue;
        };
        match cache::read_frame(path) {
            Ok((frame, info)) => {
                for stream in &frame.streams {
                    let Some(spacing) = stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0)
                    else {
                        let why =
                            format!("the stream {} does not say its spacing; simulate it again", stream.name);
                        writer.fail(format!("frame {index}"), why, Failure::Other);
                        continue;
                    };
                    let state = state_key(info.key, *index, &stream.name);
                    writer.mesh(stream, spacing, *index, state, control)?;
                }
            }
            Err(damage) => {
                writer.fail(format!("frame {index}"), damage.to_string(), Failure::of(&damage));
            }
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// The asked-for frames and where they are; all that are present if nothing was asked.
pub(super) fn choose(
    present: &[(FrameIndex, PathBuf)],
    selection: Option<&Frames>,
) -> Vec<(FrameIndex, Option<PathBuf>)> {
    match selection {
        None => present.iter().map(|(index, path)| (*index, Some(path.clone()))).collect(),
        Some(selection) => selection
            .iter()
            .map(|wanted| {
                let found = present.iter().find(|(index, _)| *index == wanted);
                (wanted, found.map(|(_, path)| path.clone()))
            })
            .collect(),
    }
}

/// Identifies the simulated state that a mesh or volume was made from.
pub(super) fn state_key(simulation: u64, index: FrameIndex, stream: &str) -> u64 {
    xxh3_64(format!("{simulation:016x} {index} {stream}").as_bytes())
}

/// Writes meshes into a shot folder and remembers what failed.
pub(super) struct Writer<'a> {
    out: &'a ShotFolder,
    params: &'a SurfaceParams,
    formats: &'a [MeshFormat],
    force: bool,
    settings: String,
    done: Surfaced,
    /// Frames whose files are there, by stream.
    written: BTreeMap<String, Vec<u32>>,
    /// Which file properties hold which attribute, by stream.
    attributes: BTreeMap<String, BTreeMap<String, Vec<String>>>,
    failed: Vec<FailedFrame>,
    /// Nobody else may write the meshes, or remove what looks like the temporary of a crashed run.
    _lock: Lock,
}

impl<'a> Writer<'a> {
    pub(super) fn new(
        out: &'a ShotFolder,
        params: &'a SurfaceParams,
        formats: &'a [MeshFormat],
        force: bool,
    ) -> Result<Self, RunError> {
        ShotFolder::create(&out.meshes())?;
        let lock = Lock::acquire(&out.meshes())?;
        cache::remove_temporaries(&out.meshes()).map_err(|source| RunError::File {
            path: out.meshes(),
            source,
            next: "check that the folder can be read and written",
        })?;
        let settings = serde_json::to_string(params).expect("settings are plain data");
        let done = Surfaced { folder: out.meshes(), ..Surfaced::default() };
        let (written, attributes, failed) = (BTreeMap::new(), BTreeMap::new(), Vec::new());
        Ok(Self { out, params, formats, force, settings, done, written, attributes, failed, _lock: lock })
    }

    /// Remembers a frame that could not be made; the job goes on.
    pub(super) fn fail(&mut self, name: String, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name, why, kind });
    }

    /// Meshes one stream of one frame and writes it in every format.
    pub(super) fn mesh(
        &mut self,
        stream: &Stream,
        spacing: f32,
        index: FrameIndex,
        state: u64,
        control: Control,
    ) -> Result<(), RunError> {
        let version = mesh::SURFACE_VERSION;
        let key = xxh3_64(format!("{version} {state:016x} {spacing} {}", self.settings).as_bytes());
        let missing = self.missing(&stream.name, index, key);
        let points = self
            .params
            .components
            .map(|_| self.out.meshes().join(format!("{}{POINTS}_{index}.ply", stream.name)))
            .filter(|path| self.force || MeshFormat::Ply.key_in(path) != Some(key));
        self.carry(stream);
        if missing.is_empty() && points.is_none() {
            self.done.kept += 1;
            self.remember(&stream.name, index);
            return Ok(());
        }
        let keep_going = || !(control.interrupted)();
        let surface = match mesh::reconstruct(stream, spacing, self.params, &keep_going) {
            Ok(surface) => surface,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                self.fail(format!("frame {index}"), why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        if let (Some(path), Some(points)) = (points, &surface.points) {
            self.done.bytes += export::ply::write_points(points, &path, key)?;
        }
        self.store(&stream.name, index, &surface.mesh, missing, key)?;
        mesh_log::append(self.out, &MeshRecord::of(&stream.name, index, key, &surface), &surface.stats)?;
        control.reporter.frame(&figures(index, &surface));
        self.complain(index, &surface.check);
        Ok(())
    }

    /// The formats and files of a frame that are not there, or were made from something else than `key`.
    fn missing(&self, name: &str, index: FrameIndex, key: u64) -> Vec<(MeshFormat, PathBuf)> {
        let target =
            |format: MeshFormat| self.out.meshes().join(format!("{name}_{index}.{}", format.extension()));
        self.formats
            .iter()
            .map(|&format| (format, target(format)))
            .filter(|(format, path)| self.force || format.key_in(path) != Some(key))
            .collect()
    }

    /// Writes the mesh of one frame that came from elsewhere in every format.
    pub(super) fn put(&mut self, name: &str, index: FrameIndex, mesh: &Mesh) -> Result<(), RunError> {
        let targets = self.missing(name, index, 0);
        self.store(name, index, mesh, targets, 0)
    }

    fn store(
        &mut self,
        name: &str,
        index: FrameIndex,
        mesh: &Mesh,
        targets: Vec<(MeshFormat, PathBuf)>,
        key: u64,
    ) -> Result<(), RunError> {
        for (format, path) in targets {
            self.done.bytes += format.write(mesh, &path, key)?;
        }
        self.remember(name, index);
        self.done.meshed += 1;
        self.done.triangles += mesh.triangles.len() as u64;
        Ok(())
    }

    /// Remembers a mesh that is not what it should be; it is written all the same.
    pub(super) fn complain(&mut self, index: FrameIndex, check: &MeshCheck) {
        if let Some(fault) = check.first_fault {
            let why = format!(
                "the mesh is written, but it has {} at {:?} (vertex {}); expected a closed, manifold, oriented mesh: \
                 please report this with the frame",
                fault.what, fault.at, fault.vertex
            );
            self.fail(format!("frame {index}"), why, Failure::Other);
        }
    }

    /// Remembers that the frame has its files.
    fn remember(&mut self, name: &str, index: FrameIndex) {
        self.written.entry(name.to_owned()).or_default().push(index.0);
    }

    /// Remembers which attributes the meshes of a stream carry.
    fn carry(&mut self, stream: &Stream) {
        let properties = mesh::carried(stream, self.params.attributes.as_deref())
            .into_iter()
            .map(|(name, is_vector)| (name.clone(), export::property_names(&name, is_vector)));
        self.attributes.entry(stream.name.clone()).or_default().extend(properties);
    }

    /// Names in the manifest what was written, however the job ended, and says how it went. `frames` ascend.
    pub(super) fn finish(
        mut self,
        title: &str,
        fps: f64,
        frames: &[u32],
        outcome: Result<(), RunError>,
    ) -> Result<Surfaced, RunError> {
        let named = self.name_outputs(title, fps, frames);
        // What ended the job comes before what went wrong because of it.
        outcome?;
        named?;
        mesh_log::tidy(self.out)?;
        self.done.jumps = mesh_log::jumps(&mesh_log::read(self.out)?);
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
        for (name, numbers) in &self.written {
            let Some(span) = FrameSpan::of(numbers) else { continue };
            let attributes = &self.attributes[name];
            for &format in self.formats {
                manifest.put(output("mesh", name, format, span, attributes), self.out);
            }
            if self.params.components.is_some() {
                let radius = [("radius".to_owned(), vec!["radius".to_owned()])];
                let attributes = attributes.clone().into_iter().chain(radius).collect();
                let name = format!("{name}{POINTS}");
                manifest.put(output("points", &name, MeshFormat::Ply, span, &attributes), self.out);
            }
        }
        manifest.write(self.out)
    }
}

/// What the name of the file of small pieces has behind the stream's.
const POINTS: &str = "_points";

fn output(
    kind: &str,
    name: &str,
    format: MeshFormat,
    frames: FrameSpan,
    attributes: &BTreeMap<String, Vec<String>>,
) -> OutputFiles {
    OutputFiles {
        kind: kind.into(),
        name: name.into(),
        format: format.extension().into(),
        pattern: format!("mesh/{name}_{{:04}}.{}", format.extension()),
        frames,
        attributes: match format {
            MeshFormat::Ply => attributes.clone(),
            MeshFormat::Obj => BTreeMap::new(),
        },
        grids: Vec::new(),
    }
}

fn figures(index: FrameIndex, surface: &Surface) -> String {
    let seconds: f64 = surface.stats.seconds.iter().map(|(_, seconds)| seconds).sum();
    let mut line = format!(
        "frame {index}  {} triangles  volume {:.4} m³  {} pieces  {seconds:.2} s",
        surface.mesh.triangles.len(),
        surface.check.volume,
        surface.check.components,
    );
    for remark in remarks::of_surface(&surface.stats) {
        line += &format!("  {remark}");
    }
    line
}
