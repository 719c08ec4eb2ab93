//! Every reader of what strangers may have written, as a function of bytes.
//!
//! `tools/fuzz` runs them on random bytes, and a test on the corpus that this left (`tools/fuzz/corpus/NAME`). A function returns
//! whether the bytes are good or not; it panics if a promise about hostile input is broken: in the reader itself, or because what
//! was read is not what the reader guarantees. The limits of memory are compared by the caller, which counts allocations.

#[cfg(test)]
mod tests;

use crate::{
    cache,
    cli::diagnostic,
    import,
    job::{FrameSpan, Manifest, file_records::FileRecords, log},
    math::Vec3,
    run::wedge::WedgeList,
    scene::{Frames, Home, Overrides, Preset, Scene, SceneError, decode},
    sdf::{self, SampledGrid},
    sim::FrameRecord,
};
use std::path::{Component, Path};

/// A reader and the memory that it may take.
#[derive(Clone, Copy, Debug)]
pub struct Reader {
    /// Name of the reader, of its fuzz target and of the folder of its corpus.
    pub name: &'static str,
    /// Reads bytes; panics where a guarantee is broken.
    pub read: fn(&[u8]),
    /// Memory that it may take however few the bytes are \[bytes\].
    pub fixed: u64,
    /// Memory that it may take for each byte \[bytes\].
    pub per_byte: u64,
}

impl Reader {
    /// The memory that reading `length` bytes may take \[bytes\].
    pub fn max_memory(&self, length: usize) -> u64 {
        self.fixed + self.per_byte * length as u64
    }
}

/// The `--max-memory` that readers of compressed content are given \[bytes\].
pub const MAX_MEMORY: u64 = 16 << 20;

/// Buffers of a decompressor, and messages.
const BUFFERS: u64 = 256 << 10;

/// Content and what is made of it, each within `--max-memory`.
const UNPACKED: u64 = BUFFERS + 2 * MAX_MEMORY;

/// The schema that presets are checked against.
const SCHEMA: u64 = 16 << 20;

/// All readers.
pub const READERS: [Reader; 21] = [
    row("cache", read_cache, UNPACKED, 64),
    row("samples", read_samples, BUFFERS, 64),
    row("manifest", read_manifest, BUFFERS, 64),
    row("wedges", read_wedges, BUFFERS, 64),
    row("records", read_records, BUFFERS, 256),
    row("preset", read_preset, SCHEMA, 1024),
    row("set", read_set, SCHEMA, 1024),
    row("frames", read_frames, BUFFERS, 64),
    row("ply", |bytes| read_particles("a.ply", bytes), BUFFERS, 64),
    row("ply_mesh", |bytes| read_mesh("a.ply", bytes), BUFFERS, 64),
    row("obj", |bytes| read_mesh("a.obj", bytes), BUFFERS, 64),
    row("pc2", read_point_cache, BUFFERS, 64),
    row("xyz", |bytes| read_particles("a.xyz", bytes), BUFFERS, 64),
    row("csv", |bytes| read_particles("a.csv", bytes), BUFFERS, 64),
    row("vtk", |bytes| read_particles("a.vtk", bytes), BUFFERS, 64),
    row("vtu", |bytes| read_particles("a.vtu", bytes), UNPACKED, 64),
    row("bgeo", |bytes| read_particles("a.bgeo", bytes), BUFFERS, 64),
    row("bgeo_gz", |bytes| read_particles("a.bgeo.gz", bytes), UNPACKED, 64),
    row("npy", |bytes| read_particles("a.npy", bytes), BUFFERS, 64),
    row("npz", |bytes| read_particles("a.npz", bytes), UNPACKED, 64),
    row("vdb", read_vdb, UNPACKED, 64),
];

const fn row(name: &'static str, read: fn(&[u8]), fixed: u64, per_byte: u64) -> Reader {
    Reader { name, read, fixed, per_byte }
}

/// The reader of this name.
pub fn reader(name: &str) -> Option<&'static Reader> {
    READERS.iter().find(|reader| reader.name == name)
}

/// Frames of the cache: the bytes as they are, and with checksums that are right.
fn read_cache(bytes: &[u8]) {
    let mut sealed = bytes.to_vec();
    cache::seal_frame(&mut sealed);
    for bytes in [bytes, &sealed] {
        match (cache::decode_frame(bytes, Some(MAX_MEMORY)), cache::verify_bytes(bytes)) {
            (Ok((frame, info)), Ok(verified)) => {
                assert_eq!(info.index, verified.index, "both read the same header");
                assert!(info.unpacked_bytes() <= MAX_MEMORY);
                let lengths = frame.streams.iter().map(|stream| stream.len() as u64);
                assert!(lengths.eq(verified.streams.iter().map(|stream| stream.len)));
            }
            (Ok(_), Err(why)) => panic!("a frame that is read is not verified: {why}"),
            (Err(why), verified) => {
                let _ = (why.to_string(), verified.map_err(|why| why.to_string()));
            }
        }
    }
}

/// The key of the samples in the corpus.
const SAMPLES_KEY: u64 = 7;

/// Sampled distances, of a mesh with a small grid.
fn read_samples(bytes: &[u8]) {
    let grid = SampledGrid { origin: Vec3::new(1.0, -2.0, 3.5), voxel: 0.25, nodes: [3, 4, 5] };
    let mut sealed = bytes.to_vec();
    cache::seal_samples(&mut sealed);
    for bytes in [bytes, &sealed] {
        match cache::decode_samples(bytes, SAMPLES_KEY, &grid) {
            Ok(field) => {
                assert_eq!(field.values.len(), grid.count());
                assert!(field.sample(field.end()).0.is_finite());
            }
            Err(why) => _ = why.to_string(),
        }
    }
}

/// `shot.json`.
fn read_manifest(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    match Manifest::parse("shot.json".into(), &text) {
        Ok(manifest) => {
            for output in &manifest.outputs {
                let FrameSpan { first, last, .. } = output.frames;
                for file in [output.file_name(first), output.file_name(last)].iter().chain(&output.rest) {
                    assert!(is_inside(file), "{file:?} leads out of the shot's folder");
                }
            }
            let _ = (manifest.simulation_key(), manifest.frames.count());
        }
        Err(why) => _ = why.to_string(),
    }
}

/// `wedges.json`.
fn read_wedges(bytes: &[u8]) {
    match WedgeList::parse(&String::from_utf8_lossy(bytes)) {
        Ok(list) => {
            for wedge in &list.wedges {
                assert!(is_inside(&wedge.folder), "{:?} leads out of the folder", wedge.folder);
                assert_eq!(wedge.values.len(), list.keys.len());
            }
        }
        Err(why) => drop(why),
    }
}

/// The lines of `mesh.jsonl` and the like, and of `log.jsonl`.
fn read_records(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let records = FileRecords::parse(&text);
    assert!(records.frames().count() <= bytes.len());
    assert!(log::parse::<FrameRecord>(&text).len() <= bytes.len());
}

/// Whether a path stays in the folder that it counts from.
fn is_inside(file: &str) -> bool {
    !file.contains('\\') && Path::new(file).components().all(|part| matches!(part, Component::Normal(_)))
}

/// Presets.
fn read_preset(bytes: &[u8]) {
    let preset = decode("preset.toml", bytes.to_vec(), Home::BuiltIn);
    let scene = preset.and_then(|preset| {
        let _ = preset.tiers();
        Scene::from_preset(&preset, &Overrides::default())
    });
    check_scene(scene);
}

/// The preset that `--set` changes.
const SMALL: &str = "title = \"Small\"\nframes = \"1-3\"\n[world]\n[[world.collider]]\n\
                     shape = { tank = { min = [0, 0, 0], max = [1, 1, 1] } }\n[liquid]\nspacing = 0.1\n\
                     [[liquid.source]]\nshape = { box = { min = [0, 0, 0], max = [0.5, 0.5, 0.5] } }\n[surface]\nvoxel = 0.5\n";

/// `--set` arguments, one a line.
fn read_set(bytes: &[u8]) {
    let set = String::from_utf8_lossy(bytes).lines().map(String::from).collect();
    let preset = Preset { name: "small.toml".into(), text: SMALL.into(), home: Home::BuiltIn };
    check_scene(Scene::from_preset(&preset, &Overrides { quality: None, set }));
}

fn check_scene(scene: Result<Scene, SceneError>) {
    match scene {
        Ok(scene) => {
            for file in scene.assets.keys() {
                assert!(is_inside(file), "{file:?} leads out of the preset's folder");
            }
            let text = scene.to_toml();
            let preset = Preset { name: "again.toml".into(), text, home: Home::BuiltIn };
            let again = Scene::from_preset(&preset, &Overrides::default());
            let again = again.unwrap_or_else(|why| panic!("{}\n{}", preset.text, diagnostic(&why)));
            assert_eq!(
                again.simulation_key(),
                scene.simulation_key(),
                "the record of a preset is the preset"
            );
        }
        Err(why) => _ = diagnostic(&why),
    }
}

/// Lists of frames.
fn read_frames(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    match text.parse::<Frames>() {
        Ok(frames) => {
            assert_eq!(frames.to_string().parse(), Ok(frames.clone()));
            assert!(frames.contains(frames.first()) && frames.contains(frames.last()) && frames.count() > 0);
        }
        Err(why) => _ = why.to_string(),
    }
}

/// Particle files.
fn read_particles(name: &str, bytes: &[u8]) {
    match import::parse_particles(name, bytes, Some(MAX_MEMORY)) {
        Ok(imported) => {
            let positions = imported.stream.vec3("position").expect("particles have positions");
            assert!(positions.iter().all(|x| x.iter().all(|x| x.is_finite())));
        }
        Err(why) => _ = why.to_string(),
    }
}

/// Meshes and points of this program, from which stages are made.
fn read_geometry(path: &Path, bytes: &[u8]) {
    match import::parse_geometry(path, bytes) {
        Ok(geometry) => {
            let count = geometry.positions.len();
            assert!(geometry.normals.is_none_or(|normals| normals.len() == count));
            assert!(geometry.attributes.iter().all(|channel| channel.data.len() == count));
            let corners = geometry.triangles.iter().flatten().flatten();
            assert!(corners.into_iter().all(|&corner| (corner as usize) < count));
        }
        Err(why) => _ = why.to_string(),
    }
    let _ = import::parse_geometry_header(path, bytes);
}

/// Meshes of solids and of sheets.
fn read_mesh(name: &str, bytes: &[u8]) {
    let path = Path::new(name);
    if name.ends_with(".ply") {
        read_geometry(path, bytes);
    }
    match (import::parse_triangles(path, bytes), import::parse_sheet(path, bytes)) {
        (Ok(solid), Ok(sheet)) => {
            let count = solid.positions.len();
            assert_eq!(count, sheet.positions.len());
            assert!(solid.triangles.iter().flatten().all(|&corner| (corner as usize) < count));
            assert!(sheet.faces.iter().flatten().all(|&corner| (corner as usize) < count));
            assert!(sheet.painted.iter().all(|values| values.is_empty() || values.len() == count));
            let _ = sdf::sampled_grid(&solid, 8);
        }
        (Err(why), Err(_)) => _ = why.to_string(),
        (solid, sheet) => panic!("one is read: {:?} {:?}", solid.err(), sheet.err()),
    }
}

/// Point caches of meshes that deform, for a mesh with the points of the header, and of one more.
fn read_point_cache(bytes: &[u8]) {
    let count = bytes.get(16..20).and_then(|word| word.try_into().ok()).map_or(0, i32::from_le_bytes);
    for points in [count.unsigned_abs() as usize, 1] {
        match import::parse_point_cache(Path::new("a.pc2"), bytes, points) {
            Ok(cache) => {
                assert!(!cache.samples.is_empty() && cache.start.is_finite() && cache.step > 0.0);
                assert!(cache.samples.iter().all(|sample| sample.len() == points));
            }
            Err(why) => _ = why.to_string(),
        }
    }
}

/// Level sets.
fn read_vdb(bytes: &[u8]) {
    match import::parse_level_set("a.vdb", bytes, Some(MAX_MEMORY)) {
        Ok(level_set) => assert!(level_set.grid.values.iter().all(|value| value.is_finite())),
        Err(why) => _ = why.to_string(),
    }
}
