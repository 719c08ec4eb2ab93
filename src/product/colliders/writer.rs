//! Writes colliders: `collider/NAME.ply` in the collider's own axes, and `collider/NAME.json` with its poses.

use super::{
    bodies,
    check::{self, MAX_COLLIDERS},
    deforming::{self, DeformedMesh},
    motion::{MotionFile, pose_count},
    outputs::{KIND, are_listed},
    tessellate::shown_mesh,
};
use crate::{
    cache,
    export::MeshFormat,
    frame::{FrameIndex, StreamKind},
    job::{
        Control, FrameSpan, Manifest, OutputFiles, RunError, ShotFolder,
        batch::{BatchRequest, BatchSummary, Ledger, ProductFolder, RequestedFrame, Source},
        file_records::{FileRecord, FileRecords},
        memory::BASE_MEMORY,
    },
    math::Vec3,
    preset::{Asset, assets, check::Places, problem::Finding},
    product::{
        interface::Product,
        request::{ProductRequest, ProductSettings},
    },
    sim::scene::Scene,
    solid::{Collider, Look, Shape},
};
use std::{collections::BTreeSet, path::Path};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same collider another one.
pub(in crate::product) const COLLIDER_VERSION: u32 = 2;

/// Memory of reading and writing a mesh [bytes/byte of its file], as the limit of its reader.
const MESH_BYTES: f64 = 64.0;

/// Memory of meshes that deform, of which all samples are held [bytes/byte of their files].
const DEFORMING_BYTES: f64 = 2.0;

/// Memory of the text of a pose, of which two copies exist while the keys of files are computed [bytes].
const POSE_TEXT_BYTES: u64 = 200;

/// Half of the side of the square of a plane: at least so long [m], and so many times the largest extent of the other colliders.
const MIN_PLANE_REACH: f32 = 10.0;
const PLANE_EXTENTS: f32 = 10.0;

/// The longest name of a file, without the number that makes it unique.
const MAX_STEM: usize = 40;

/// Meshes and motion of colliders, as jobs see them.
pub(in crate::product) struct ColliderMeshes;

impl ProductFolder for ColliderMeshes {
    fn name(&self) -> &'static str {
        "collider"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} colliders written ({mib:.1} MiB), {kept} up to date")
    }
}

impl Product for ColliderMeshes {
    fn verb(&self) -> &'static str {
        "colliders"
    }

    fn input(&self) -> &'static str {
        "colliders"
    }

    fn is_of_streams(&self) -> bool {
        false
    }

    fn accepts(&self, _: StreamKind) -> bool {
        false
    }

    fn is_requested(&self, settings: &ProductSettings) -> bool {
        settings.colliders
    }

    fn arguments(&self, _: &ProductSettings) -> Vec<String> {
        Vec::new()
    }

    /// All frames are in one file.
    fn is_per_frame(&self) -> bool {
        false
    }

    fn max_memory(&self, _: &ProductSettings, _: StreamKind, _: usize) -> f64 {
        BASE_MEMORY
    }

    fn check_scene(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check(scene, places, findings);
    }

    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError> {
        let (Source::Cache(shot), Some(scene)) = (request.frames()?, request.scene) else {
            return Err(RunError::Request("colliders are made of the preset of a shot folder alone".into()));
        };
        colliders(scene, shot, request.out, request.batch, control)
    }
}

/// Writes the colliders of the scene of `shot` to `out`. Files that were made of the same colliders are kept, unless the request
/// forces them. Without colliders to write, those that the manifest lists are removed from it.
///
/// # Errors
/// [`RunError::Request`] if the scene has none to write and the manifest lists none, if it has too many, or is not the one that was simulated;
/// [`RunError::OverMemory`]; if a file cannot be read or written.
fn colliders(
    scene: &Scene,
    shot: &ShotFolder,
    out: &ShotFolder,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let source = Source::Cache(shot);
    let (title, fps) = source.title(out, request.fps)?;
    let manifest = Manifest::read(shot)?;
    if manifest.as_ref().and_then(Manifest::simulation_key).is_some_and(|key| key != scene.simulation_key()) {
        return Err(RunError::Request(format!(
            "{}: found other settings than those of the cached frames, expected the colliders that were simulated; restore the \
             file, or simulate the shot again",
            shot.preset().display()
        )));
    }
    let frames = source.frames(request.selection.as_ref())?;
    let numbers: Vec<u32> = frames.iter().map(|(index, _)| index.0).collect();
    let requested = FrameSpan::of(&numbers);
    let known = manifest.filter(|manifest| manifest.simulation.is_some()).map(|manifest| manifest.frames);
    let Some(span) = [requested, known].into_iter().flatten().reduce(FrameSpan::union) else {
        return Err(RunError::Request("no frames in this cache; simulate the shot first".into()));
    };
    let is_none_shown =
        scene.body.is_empty() && scene.world.collider.iter().all(|collider| collider.shown_look().is_none());
    let tasks = match is_none_shown && are_listed(out)? {
        true => Vec::new(),
        false => {
            refuse_over_memory(scene, span, request.max_memory)?;
            // The motion of bodies is in the cached frames alone, and their files hold all of it.
            let cached = if scene.body.is_empty() { Vec::new() } else { source.frames(None)? };
            tasks(scene, span, &cached)?
        }
    };
    let mut ledger = Ledger::new(out, &ColliderMeshes, control)?;
    let ended = write(&tasks, out, request.force, &mut ledger, control);
    if ended.is_ok() {
        // Colliders of an earlier run may be among the outputs that are not shown any more.
        ledger.replace_outputs();
    }
    ledger.finish(&title, fps, &numbers, ended, control)
}

/// A collider to be written.
struct Task<'a> {
    shape: &'a Shape,
    /// The file that a mesh names; empty of other shapes.
    bytes: &'a [u8],
    motion: MotionFile,
    /// The motion of the vertices of a mesh that deforms.
    deformed: Option<DeformedMesh>,
    /// Half of the side of the square of a plane [m].
    plane_reach: f32,
    output: OutputFiles,
    key: u64,
}

/// The colliders of a scene that pictures show, and its bodies with their poses in the cached `frames`.
///
/// # Errors
/// [`RunError::Request`] if there are none or too many, or one moves in too many frames.
fn tasks<'a>(
    scene: &'a Scene,
    span: FrameSpan,
    frames: &[RequestedFrame],
) -> Result<Vec<Task<'a>>, RunError> {
    let all = &scene.world.collider;
    let shown: Vec<(&Collider, Look)> =
        all.iter().filter_map(|collider| Some((collider, collider.shown_look()?))).collect();
    let count = shown.len() + scene.body.len();
    if !(1..=MAX_COLLIDERS).contains(&count) {
        return Err(RunError::Request(format!(
            "found {count} colliders and bodies that pictures show, expected 1 to {MAX_COLLIDERS}; a tank is shown if it has a `look`",
        )));
    }
    let bodies = bodies::motions(scene, frames)?;
    let shapes =
        || shown.iter().map(|(collider, _)| &collider.shape).chain(scene.body.iter().map(|body| &body.shape));
    let extents = all.iter().map(|collider| &collider.shape).chain(scene.body.iter().map(|body| &body.shape));
    let extent = extents.map(extent).fold(0.0, f32::max);
    let plane_reach = MIN_PLANE_REACH.max(PLANE_EXTENTS * extent);
    let (fps, start) = (f64::from(scene.fps), scene.frames.first().0);
    let names = names(shapes());
    let span = span.first..=span.last;
    let motion = |&(collider, look): &(&Collider, Look)| MotionFile::new(collider, look, fps, start, &span);
    let motions =
        shown.iter().map(motion).chain(bodies.into_iter().map(Ok)).collect::<Result<Vec<_>, _>>()?;
    let mut tasks = Vec::new();
    for ((shape, mut motion), name) in shapes().zip(motions).zip(names) {
        let bytes: &[u8] = mesh_file(scene, shape).map_or(&[], |asset| &asset.bytes);
        let hash = assets::hash(shape.files(), &scene.assets);
        let deformed = DeformedMesh::of(shape, scene, &span)?;
        motion.point_cache_frames = deformed.as_ref().map(DeformedMesh::frames);
        let text = serde_json::to_string(shape).expect("a shape is plain data");
        let mut text =
            format!("collider {COLLIDER_VERSION} {text} {hash:016x} {plane_reach} {}", motion.text());
        if deformed.is_some() {
            text += &format!(" {fps} {start}");
        }
        let (output, key) = (output(&name, &motion, deformed.is_some()), xxh3_64(text.as_bytes()));
        tasks.push(Task { shape, bytes, motion, deformed, plane_reach, output, key });
    }
    Ok(tasks)
}

/// Refuses what needs more memory than is allowed [bytes].
fn refuse_over_memory(scene: &Scene, span: FrameSpan, allowed: Option<u64>) -> Result<(), RunError> {
    let needed = max_memory(scene, span);
    match allowed {
        Some(allowed) if needed > allowed => Err(RunError::OverMemory { needed, allowed }),
        _ => Ok(()),
    }
}

/// A bound of the memory of writing the colliders [bytes], estimated from the sizes of files and the numbers of poses.
fn max_memory(scene: &Scene, span: FrameSpan) -> u64 {
    let shown: Vec<&Collider> =
        scene.world.collider.iter().filter(|collider| collider.shown_look().is_some()).collect();
    let shapes =
        shown.iter().map(|collider| &collider.shape).chain(scene.body.iter().map(|body| &body.shape));
    let size = |shape: &Shape| mesh_file(scene, shape).map_or(0, |asset| asset.bytes.len());
    let (sizes, held): (Vec<usize>, Vec<usize>) =
        shapes.map(|shape| (size(shape), deforming::size(shape, scene))).unzip();
    let largest = sizes.into_iter().max().unwrap_or(0);
    let held = held.into_iter().sum::<usize>() as f64 * DEFORMING_BYTES;
    let span = span.first..=span.last;
    let frames = || scene.body.iter().map(|_| u64::from(span.end() - span.start()) + 1);
    let counts = || shown.iter().map(|collider| pose_count(collider, &span)).chain(frames());
    let poses = counts().sum::<u64>() * size_of::<[f32; 7]>() as u64;
    let text = counts().max().unwrap_or(0) * POSE_TEXT_BYTES;
    (BASE_MEMORY + largest as f64 * MESH_BYTES + held) as u64 + poses + text
}

/// The file that a mesh names, of a sequence the first; `None` of other shapes.
fn mesh_file<'a>(scene: &'a Scene, shape: &Shape) -> Option<&'a Asset> {
    match shape {
        Shape::Mesh(mesh) => scene
            .assets
            .get(&mesh.file)
            .or_else(|| assets::sequence(&mesh.file, &scene.assets).first().map(|&(.., asset)| asset)),
        _ => None,
    }
}

/// Writes the files of all colliders.
fn write(
    tasks: &[Task],
    out: &ShotFolder,
    force: bool,
    ledger: &mut Ledger<'_>,
    control: Control,
) -> Result<(), RunError> {
    let records = FileRecords::read(out, ColliderMeshes.name())?;
    control.reporter.begin(ColliderMeshes.name(), tasks.len());
    for (place, task) in tasks.iter().enumerate() {
        if control.cancel.is_cancelled() {
            return Err(RunError::Interrupted);
        }
        let Task { shape, bytes, motion, deformed, plane_reach, output, key } = task;
        let frames: Vec<u32> = output.frames.numbers().collect();
        let files: Vec<String> = output.paths().map(str::to_owned).collect();
        if !force && records.confirm(out, &files, *key) {
            ledger.add_sequence(output.clone(), &frames, None, control)?;
        } else {
            let path = |file: &String| out.root().join(file);
            let poses = path(&files[0]);
            let made = match deformed {
                Some(deformed) => deformed.first(),
                None => shown_mesh(shape, motion.look, bytes, *plane_reach)?,
            };
            let mesh = MeshFormat::Ply.write(&made, &path(&files[1]), *key)?;
            let text = motion.text();
            let poses =
                cache::write_atomically(&poses, |to| to.write_all(text.as_bytes())).map_err(|source| {
                    let next = "check that the folder can be written and the disk has free space";
                    RunError::File { path: poses.clone(), source, next }
                })?;
            let mut record = FileRecord::new(FrameIndex(output.frames.first), &output.name, *key, None);
            let cache = deformed.as_ref().map(|deformed| deformed.write(&path(&files[2]))).transpose()?;
            for (file, written) in files.into_iter().zip([poses, mesh].into_iter().chain(cache)) {
                record.add(file, written);
            }
            ledger.add_sequence(output.clone(), &frames, Some(&record), control)?;
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// The output of a collider.
fn output(name: &str, motion: &MotionFile, is_deforming: bool) -> OutputFiles {
    let folder = ColliderMeshes.name();
    let last = motion.first + (motion.poses.len() - 1) as u32;
    OutputFiles {
        pattern: format!("{folder}/{name}.json"),
        rest: Some(format!("{folder}/{name}.ply")),
        point_cache: is_deforming.then(|| format!("{folder}/{name}.pc2")),
        frames: FrameSpan { first: motion.first, last, step: 1 },
        ..OutputFiles::of(KIND, folder, name, "json", FrameIndex(motion.first))
    }
}

/// The distance of the farthest point of a shape from its origin [m], roughly: the file of a mesh counts as one unit long.
fn extent(shape: &Shape) -> f32 {
    match shape {
        Shape::Plane { .. } => 0.0,
        Shape::Mesh(mesh) => Vec3::from(mesh.translate).norm() + mesh.scale,
        bounded => bounded.reach(),
    }
}

/// A name for each shape: the stem of its file or its key in presets, with a number from the second on.
fn names<'a>(shapes: impl Iterator<Item = &'a Shape>) -> Vec<String> {
    let mut used = BTreeSet::new();
    let name = |shape: &Shape| {
        let stem = match shape {
            Shape::Mesh(mesh) => Path::new(&mesh.file).file_stem().unwrap_or_default().to_string_lossy(),
            other => other.name().into(),
        };
        let plain = |c: char| if c.is_ascii_alphanumeric() || "-_".contains(c) { c } else { '_' };
        let stem: String = stem.chars().take(MAX_STEM).map(plain).collect();
        let numbered = (1_u32..).map(|number| match number {
            1 => stem.clone(),
            _ => format!("{stem}-{number}"),
        });
        // Some file systems take both cases of a letter for the same.
        let mut free = numbered.filter(|name| used.insert(name.to_ascii_lowercase()));
        free.next().expect("there are more numbers than colliders")
    };
    shapes.map(name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{job::is_file_name, solid::MeshShape};

    #[test]
    fn names_are_names_of_files_and_unique() {
        let mesh = |file: &str| Shape::Mesh(MeshShape::new(file));
        let ball = || Shape::Sphere { center: [0.0; 3], radius: 1.0 };
        let long = format!("{}.obj", "x".repeat(200));
        let shapes =
            [ball(), mesh("a/duck.ply"), mesh("b/Duck.ply"), ball(), mesh("grüne ente.obj"), mesh(&long)];
        let found = names(shapes.iter());
        assert_eq!(found[..5], ["sphere", "duck", "Duck-2", "sphere-2", "gr_ne_ente"]);
        assert!(found.iter().all(|name| is_file_name(name)), "{found:?}");
        let many: Vec<Shape> = (0..MAX_COLLIDERS).map(|_| ball()).collect();
        assert_eq!(names(many.iter()).iter().collect::<BTreeSet<_>>().len(), MAX_COLLIDERS);
    }
}
