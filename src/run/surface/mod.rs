//! The job that turns cached frames into meshes.

mod ledger;

pub(super) use ledger::Ledger;

use super::{
    Control, FailedFrame, Failure, Jump, Manifest, MeshRecord, RunError, ShotFolder, batch,
    plan::{Product, refuse_memory, stream_memory},
    remarks,
};
use crate::{
    cache,
    export::{self, MeshFormat},
    frame::{FrameIndex, Stream},
    mesh::{self, Mesh, MeshCheck, Surface, SurfaceError, SurfaceParams, SurfaceStats},
    par,
    scene::Frames,
};
use std::path::{Path, PathBuf};
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

impl Surfaced {
    /// What was done, a line each.
    pub fn lines(&self) -> Vec<String> {
        let done = format!(
            "{}: {} frames meshed ({} triangles, {:.1} MiB), {} were there",
            self.folder.display(),
            self.meshed,
            self.triangles,
            self.bytes as f64 / f64::from(1 << 20),
            self.kept
        );
        [done].into_iter().chain(self.jumps.iter().map(|jump| format!("jump: {jump}"))).collect()
    }
}

/// What a surfacing job is to do, whatever its source.
#[derive(Clone, Debug)]
pub struct SurfaceJob {
    /// How particles become a surface.
    pub params: SurfaceParams,
    /// The files to write of every frame.
    pub formats: Vec<MeshFormat>,
    /// The frames to mesh; `None`: all that are there.
    pub selection: Option<Frames>,
    /// Mesh again what is there already.
    pub force: bool,
    /// What frames under way share, and none may exceed by itself, as far as it can be estimated [bytes].
    pub max_memory: Option<u64>,
    /// Whether several frames may be under way at once. The memory that a plan of a shot tells is that of one.
    pub side_by_side: bool,
}

impl SurfaceJob {
    /// The memory that frames under way share [bytes]; 0: one frame at a time.
    pub(super) fn budget(&self) -> u64 {
        if self.side_by_side { self.max_memory.unwrap_or(batch::TOGETHER) } else { 0 }
    }
}

/// Meshes the frames of `source`'s cache into `out`, several at once where memory allows.
///
/// A frame whose files were made from the same state with the same settings is kept, unless the job forces it.
///
/// # Errors
/// Frames that cannot be read or meshed are left out and named together at the end
/// ([`RunError::SomeFailed`]); a folder or disk that refuses to be written ends the job at once.
pub fn surface_cache(
    source: &ShotFolder,
    out: &ShotFolder,
    job: &SurfaceJob,
    control: Control,
) -> Result<Surfaced, RunError> {
    let present = cache::list(&source.cache())?;
    let wanted = choose(&present, job.selection.as_ref())?;
    let known = match Manifest::read(source)? {
        Some(known) => Some(known),
        None => Manifest::read(out)?,
    };
    let mut ledger = Ledger::new(out)?;
    let writer = Writer::new(out, job);
    let all: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    if job.selection.is_none() {
        remarks::of_gaps(&all).iter().for_each(|gaps| control.reporter.note(gaps));
    }
    let costs = costs(&wanted, &job.params);
    let outcome = batch::each(
        "mesh",
        &costs,
        job.budget(),
        control,
        |place, alone| {
            let (index, path) = &wanted[place];
            surface_frame(*index, path.as_deref(), (!alone).then_some(costs[place]), &writer, control)
        },
        |made| ledger.take(made, control),
    );
    let (title, fps) = known.map_or(("Untitled".into(), DEFAULT_FPS), |known| (known.title, known.fps));
    ledger.finish(job, &title, fps, &all, outcome, control)
}

/// Frames a second of a cache that does not say.
pub(super) const DEFAULT_FPS: f64 = 24.0;

/// The memory that each frame will need [bytes], by the particles of its largest stream; none for one that cannot be read.
fn costs(wanted: &[(FrameIndex, Option<PathBuf>)], params: &SurfaceParams) -> Vec<u64> {
    let particles = |path: &PathBuf| {
        let streams = cache::read_header(path).map_or_else(|_| Vec::new(), |info| info.streams);
        streams.iter().map(|stream| stream.len as usize).max().unwrap_or(0)
    };
    let cost = |path: &Option<PathBuf>| path.as_ref().map_or(0, |path| batch::cost(particles(path), params));
    wanted.iter().map(|(_, path)| cost(path)).collect()
}

/// Meshes every stream of a frame; `None` if that needs more memory than `allowance`.
fn surface_frame(
    index: FrameIndex,
    path: Option<&Path>,
    allowance: Option<u64>,
    writer: &Writer,
    control: Control,
) -> Option<Result<Made, RunError>> {
    let mut made = Made::new(index);
    let name = format!("frame {index}");
    let Some(path) = path else {
        made.fail(name, "not in the cache; simulate it first".into(), Failure::Other);
        return Some(Ok(made));
    };
    let (frame, info) = match cache::read_frame(path) {
        Ok(read) => read,
        Err(damage) => {
            made.fail(name, damage.to_string(), Failure::of(&damage));
            return Some(Ok(made));
        }
    };
    // What every stream needs is known before the first is made: a second try makes all of them.
    let mut ready = Vec::new();
    for stream in &frame.streams {
        let Some(spacing) = stream.scalar("spacing").map(|s| s as f32).filter(|&s| s > 0.0) else {
            let why = format!("the stream {} does not say its spacing; simulate it again", stream.name);
            made.fail(name.clone(), why, Failure::Other);
            continue;
        };
        let key = writer.key(state_key(info.key, index, &stream.name), spacing);
        let missing = writer.missing(&stream.name, index, key);
        if missing.is_empty() {
            made.keep(&stream.name);
            continue;
        }
        match writer.fits(stream, spacing, allowance) {
            Ok(Fit::Yes) => ready.push((stream, StreamState { spacing, key }, missing)),
            Ok(Fit::No) => return None,
            Err(why) => made.fail(name.clone(), why.to_string(), Failure::Memory),
        }
    }
    for (stream, state, missing) in ready {
        if let Err(why) = writer.mesh(stream, state, missing, &mut made, control) {
            return Some(Err(why));
        }
    }
    Some(Ok(made))
}

/// The asked-for frames and where they are; all that are present if nothing was asked. `present` ascend.
///
/// # Errors
/// [`RunError::Request`] if more are asked for than any shot has: each that is not there would be told.
pub(super) fn choose(
    present: &[(FrameIndex, PathBuf)],
    selection: Option<&Frames>,
) -> Result<Vec<(FrameIndex, Option<PathBuf>)>, RunError> {
    let Some(selection) = selection else {
        return Ok(present.iter().map(|(index, path)| (*index, Some(path.clone()))).collect());
    };
    if selection.count() > MOST_FRAMES {
        return Err(RunError::Request(format!(
            "--frames {selection}: found {} frames, expected at most {MOST_FRAMES}; name those that are there, or leave \
             --frames out for all of them",
            selection.count()
        )));
    }
    let found = |wanted: FrameIndex| {
        let place = present.binary_search_by_key(&wanted, |(index, _)| *index);
        place.ok().map(|place| present[place].1.clone())
    };
    Ok(selection.iter().map(|wanted| (wanted, found(wanted))).collect())
}

/// Frames that a job may be asked for: eleven hours at 24 a second.
const MOST_FRAMES: u64 = 1_000_000;

/// Identifies the simulated state that a mesh or volume was made from.
pub(super) fn state_key(simulation: u64, index: FrameIndex, stream: &str) -> u64 {
    xxh3_64(format!("{simulation:016x} {index} {stream}").as_bytes())
}

/// What became of one frame.
pub(super) struct Made {
    index: FrameIndex,
    /// What the user should know of it.
    pub(super) notes: Vec<String>,
    streams: Vec<MadeStream>,
    failed: Vec<FailedFrame>,
}

/// Distance of coordinates, over the voxel, from which triangles without area are put down to rounding. Smaller, and a
/// fault of the surfacer near the origin is taken for it; larger, and sound meshes of wide scenes count as failed: spray
/// 10 km wide at voxel 0.05 m, 0.024, has 89 such triangles in a thousand drops.
const COARSE: f32 = 1e-3;

/// A stream of the frame whose files are there now.
struct MadeStream {
    name: String,
    /// Which file properties hold which attribute, as far as its particles were read.
    attributes: Vec<(String, Vec<String>)>,
    /// `None`: they were there.
    meshed: Option<Meshed>,
    /// Outputs that this job does not write and whose file of the frame shows another surface, by name and format.
    stale: Vec<(String, MeshFormat)>,
}

struct Meshed {
    triangles: u64,
    bytes: u64,
    figures: String,
    /// What the log says of it.
    record: Option<(MeshRecord, SurfaceStats)>,
}

impl Made {
    /// Nothing yet.
    pub(super) fn new(index: FrameIndex) -> Self {
        Self { index, notes: Vec::new(), streams: Vec::new(), failed: Vec::new() }
    }

    /// Remembers a stream whose files were there.
    pub(super) fn keep(&mut self, stream: &str) {
        self.streams.push(MadeStream {
            name: stream.into(),
            attributes: Vec::new(),
            meshed: None,
            stale: Vec::new(),
        });
    }

    /// Remembers that something could not be made; the job goes on.
    pub(super) fn fail(&mut self, name: String, why: String, kind: Failure) {
        self.failed.push(FailedFrame { name, why, kind });
    }

    /// Remembers a mesh of cells of `voxel` [m] that is not what it should be; it is written all the same.
    ///
    /// Far from the origin, vertices that differ round to the same single-precision numbers. That is told, and is no fault
    /// of the mesh.
    pub(super) fn complain(&mut self, mesh: &Mesh, check: &MeshCheck, voxel: f32) {
        let reach = par::max(mesh.positions.len(), |vertex| mesh.positions[vertex].amax())
            .map_or(0.0, |(_, reach)| reach);
        let apart = reach * f32::EPSILON;
        let degenerate = check.degenerate_triangles;
        if apart > COARSE * voxel && (MeshCheck { degenerate_triangles: 0, ..*check }).is_sound() {
            if degenerate > 0 {
                self.notes.push(format!(
                    "frame {}: {degenerate} triangles have no area: {reach:.0} m from the origin, coordinates are {apart:.1e} m \
                     apart; move the particles nearer to it",
                    self.index
                ));
            }
            return;
        }
        if let Some(fault) = check.first_fault {
            let why = format!(
                "the mesh is written, but it has {} at {:?} (vertex {}); expected a closed, manifold, oriented mesh: \
                 please report this with the frame",
                fault.what, fault.at, fault.vertex
            );
            self.fail(format!("frame {}", self.index), why, Failure::Other);
        }
    }
}

/// Writes the meshes of single frames, several at once.
pub(super) struct Writer<'a> {
    out: &'a ShotFolder,
    job: &'a SurfaceJob,
    settings: String,
}

/// What is known of a stream before it is meshed.
#[derive(Clone, Copy)]
pub(super) struct StreamState {
    /// Distance between its particles at rest [m].
    pub(super) spacing: f32,
    /// The key of its mesh.
    pub(super) key: u64,
}

/// Whether a frame was made within the memory that was set aside for it.
pub(super) enum Fit {
    Yes,
    No,
}

/// Files to write.
pub(super) struct Missing {
    meshes: Vec<(MeshFormat, PathBuf)>,
    /// That of small pieces.
    points: Option<PathBuf>,
}

impl Missing {
    /// Whether all are there.
    pub(super) fn is_empty(&self) -> bool {
        self.meshes.is_empty() && self.points.is_none()
    }
}

impl<'a> Writer<'a> {
    pub(super) fn new(out: &'a ShotFolder, job: &'a SurfaceJob) -> Self {
        let settings = serde_json::to_string(&job.params).expect("settings are plain data");
        Self { out, job, settings }
    }

    /// Identifies the mesh that is made of a state.
    pub(super) fn key(&self, state: u64, spacing: f32) -> u64 {
        let version = mesh::SURFACE_VERSION;
        xxh3_64(format!("{version} {state:016x} {spacing} {}", self.settings).as_bytes())
    }

    /// Where the file of a frame is.
    fn target(&self, name: &str, index: FrameIndex, format: MeshFormat) -> PathBuf {
        self.out.meshes().join(format!("{name}_{index}.{}", format.extension()))
    }

    /// The outputs that this job does not write and whose file of the frame was made of something else.
    fn stale(&self, stream: &str, index: FrameIndex, key: u64) -> Vec<(String, MeshFormat)> {
        let others = MeshFormat::ALL.into_iter().filter(|format| !self.job.formats.contains(format));
        let points =
            self.job.params.components.is_none().then(|| (format!("{stream}{POINTS}"), MeshFormat::Ply));
        let outputs = others.map(|format| (stream.to_owned(), format)).chain(points);
        let is_stale = |name: &str, format: MeshFormat| {
            let path = self.target(name, index, format);
            path.exists() && format.key_in(&path) != Some(key)
        };
        outputs.filter(|(name, format)| is_stale(name, *format)).collect()
    }

    /// The files of a stream that have to be written.
    pub(super) fn missing(&self, stream: &str, index: FrameIndex, key: u64) -> Missing {
        let target = |name: &str, format: MeshFormat| self.target(name, index, format);
        let is_missing = |format: MeshFormat, path: &Path| self.job.force || format.key_in(path) != Some(key);
        let files = self.job.formats.iter().map(|&format| (format, target(stream, format)));
        let meshes = files.filter(|(format, path)| is_missing(*format, path)).collect();
        let points =
            self.job.params.components.map(|_| target(&format!("{stream}{POINTS}"), MeshFormat::Ply));
        Missing { meshes, points: points.filter(|path| is_missing(MeshFormat::Ply, path)) }
    }

    /// Whether meshing a stream fits in the `allowance` of memory that was set aside for it [bytes].
    ///
    /// # Errors
    /// [`RunError::OverMemory`] if it needs more than the job allows.
    pub(super) fn fits(
        &self,
        stream: &Stream,
        spacing: f32,
        allowance: Option<u64>,
    ) -> Result<Fit, RunError> {
        let limit = self.job.max_memory;
        if limit.is_none() && allowance.is_none() {
            return Ok(Fit::Yes);
        }
        let needed = stream_memory(Product::Meshes, stream, spacing, &self.job.params);
        limit.map_or(Ok(()), |limit| refuse_memory(needed, limit))?;
        Ok(if allowance.is_some_and(|allowance| needed > allowance) { Fit::No } else { Fit::Yes })
    }

    /// Meshes a stream and writes the files that are `missing`.
    ///
    /// # Errors
    /// What a folder or disk refuses; [`RunError::Interrupted`].
    pub(super) fn mesh(
        &self,
        stream: &Stream,
        state: StreamState,
        missing: Missing,
        made: &mut Made,
        control: Control,
    ) -> Result<(), RunError> {
        let StreamState { spacing, key } = state;
        let name = format!("frame {}", made.index);
        let keep_going = || !(control.interrupted)();
        let surface = match mesh::reconstruct(stream, spacing, &self.job.params, &keep_going) {
            Ok(surface) => surface,
            Err(SurfaceError::Interrupted) => return Err(RunError::Interrupted),
            Err(why) => {
                made.fail(name, why.to_string(), Failure::Other);
                return Ok(());
            }
        };
        let mut bytes = 0;
        if let (Some(path), Some(points)) = (&missing.points, &surface.points) {
            bytes += export::ply::write_points(points, path, key)?;
        }
        let record = MeshRecord::of(&stream.name, made.index, key, &surface);
        let figures = figures(made.index, &surface);
        let properties = mesh::carried(stream, self.job.params.attributes.as_deref())
            .into_iter()
            .map(|(name, is_vector)| (name.clone(), export::property_names(&name, is_vector)));
        let attributes = properties.collect();
        let Surface { mesh, distance, check, stats, .. } = surface;
        drop(distance);
        let meshed = Meshed { triangles: 0, bytes, figures, record: Some((record, stats)) };
        let meshed = Some(self.write(&mesh, missing, key, meshed)?);
        let stale = self.stale(&stream.name, made.index, key);
        made.streams.push(MadeStream { name: stream.name.clone(), attributes, meshed, stale });
        made.complain(&mesh, &check, self.job.params.voxel * spacing);
        Ok(())
    }

    /// Writes a mesh that came from elsewhere in every format.
    pub(super) fn put(
        &self,
        name: &str,
        mesh: &Mesh,
        figures: String,
        made: &mut Made,
    ) -> Result<(), RunError> {
        let missing = self.missing(name, made.index, 0);
        let meshed = Meshed { triangles: 0, bytes: 0, figures, record: None };
        let meshed = Some(self.write(mesh, missing, 0, meshed)?);
        made.streams.push(MadeStream {
            name: name.into(),
            attributes: Vec::new(),
            meshed,
            stale: Vec::new(),
        });
        Ok(())
    }

    /// Writes the missing files of a mesh; returns it with their size added.
    fn write(&self, mesh: &Mesh, missing: Missing, key: u64, mut meshed: Meshed) -> Result<Meshed, RunError> {
        for (format, path) in missing.meshes {
            meshed.bytes += format.write(mesh, &path, key)?;
        }
        meshed.triangles = mesh.triangles.len() as u64;
        Ok(meshed)
    }
}

/// What the name of the file of small pieces has behind the stream's.
const POINTS: &str = "_points";

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
