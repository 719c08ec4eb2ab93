//! From the meshes that a scene names to shapes with distances: read, sampled, kept on disk.

use super::{Reporter, RunError, ShotFolder};
use crate::{
    cache::{self, CacheError},
    control::{printable, printable_path},
    import::{self, ImportError},
    math::Vec3,
    preset::assets,
    product,
    scene::{Asset, Scene},
    sdf::{self, SAMPLED_VERSION, Sampled, Soundness},
    sim::{deforming::deformation, registry},
    solid::{MeshShape, Shape},
};
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
    sync::Arc,
};

/// The scene with all its meshes filled. Samples are looked for in the shot's folder, if one is given, and left
/// there.
///
/// # Errors
/// If a mesh is no closed surface, or is broken, or the samples cannot be written; if a system refuses what it gets.
pub(super) fn fill(
    scene: &Scene,
    folder: Option<&ShotFolder>,
    reporter: &dyn Reporter,
) -> Result<Scene, RunError> {
    let (unfilled, mut scene) = (scene, scene.clone());
    // Later jobs of a shot do not repeat what was reported.
    let is_first = folder.is_some_and(|folder| !folder.preset().exists());
    let assets = &unfilled.assets;
    let mut sampled = BTreeMap::<(String, u32), Arc<Sampled>>::new();
    let mut fill_shapes = |shapes: Vec<&mut Shape>| -> Result<(), RunError> {
        for shape in shapes {
            let Shape::Mesh(mesh) = shape else { continue };
            if let Some(deformation) = deformation(mesh, unfilled)? {
                if is_first && let Some(found) = Soundness::of(&deformation.first_mesh()).report() {
                    reporter.note(&format!("{}: found {found}", printable(&mesh.file)));
                }
                mesh.fill_deforming(Arc::new(deformation));
                if mesh.volume() == Some(0.0) {
                    return Err(RunError::Request(format!(
                        "{}: found no node inside at resolution {}, expected parts thicker than a voxel; raise `resolution`",
                        printable(&mesh.file),
                        mesh.resolution
                    )));
                }
                continue;
            }
            let name = (mesh.file.clone(), mesh.resolution);
            if !sampled.contains_key(&name) {
                let field = field(mesh, &assets[&mesh.file], folder, reporter)?;
                sampled.insert(name.clone(), Arc::new(field));
            }
            mesh.fill(sampled[&name].clone());
        }
        Ok(())
    };
    fill_shapes(scene.world.collider.iter_mut().map(|collider| &mut collider.shape).collect())?;
    fill_shapes(scene.force.iter_mut().filter_map(|force| force.shape.as_mut()).collect())?;
    for system in registry::ALL {
        fill_shapes(system.shapes_mut(&mut scene))?;
    }
    for system in registry::ALL {
        system.finish_meshes(&mut scene)?;
    }
    if is_first {
        report_sizes(&mut scene, reporter);
    }
    Ok(scene)
}

/// A mesh this many times as large as everything else, or ten times this as small, is in another unit.
const SUSPICIOUS_SIZE: f32 = 100.0;

/// Reports meshes whose size does not fit that of the other shapes of the scene: files in millimetres, or in another unit.
fn report_sizes(scene: &mut Scene, reporter: &dyn Reporter) {
    let size = |shape: &Shape| match shape {
        Shape::Plane { .. } => None,
        Shape::Tank { min, max } => Some((Vec3::from(*max) - Vec3::from(*min)).amax()),
        bounded => bounded.bounds().map(|(low, high)| (high - low).amax()),
    };
    let file = |shape: &Shape| if let Shape::Mesh(mesh) = shape { Some(mesh.file.clone()) } else { None };
    let mut found = Vec::new();
    let mut add = |shape: &Shape| found.extend(size(shape).map(|size| (file(shape), size)));
    for collider in &scene.world.collider {
        let scale = collider.keyframes.iter().map(|key| key.scale).reduce(f32::max).unwrap_or(1.0);
        add(&collider.shape.scaled(scale));
    }
    registry::ALL.iter().for_each(|system| system.shapes_mut(scene).into_iter().for_each(|shape| add(shape)));
    let mut reported = BTreeSet::new();
    for (place, (file, size)) in found.iter().enumerate() {
        let Some(file) = file.as_ref().filter(|file| !reported.contains(*file)) else { continue };
        let others =
            found.iter().enumerate().filter(|&(other, _)| other != place).map(|(_, &(_, size))| size);
        let Some(largest) = others.reduce(f32::max) else { continue };
        let hint = match size / largest {
            ratio if ratio > SUSPICIOUS_SIZE => {
                "scale = 0.001 takes its unit for millimetres, 0.01 for centimetres"
            }
            ratio if ratio < 0.1 / SUSPICIOUS_SIZE => {
                "a larger `scale` enlarges it: 0.01 takes its unit for centimetres, 1 for metres"
            }
            _ => continue,
        };
        reported.insert(file);
        let file = printable(file);
        reporter
            .note(&format!("{file}: found a mesh of {size:.3} m next to shapes of {largest:.3} m; {hint}"));
    }
}

/// The folders of a shot that hold no files of the user.
fn reserved_folders() -> impl Iterator<Item = &'static str> {
    ["cache", "sdf"].into_iter().chain(product::ALL.into_iter().map(|product| product.name()))
}

/// Refuses files whose copies in the shot folder would lie among those that jobs write, or replace a file of the user: in a folder
/// without the record of a job, no file is a copy.
///
/// # Errors
/// If there is one.
pub(super) fn refuse_assets(scene: &Scene, shot: &ShotFolder) -> Result<(), RunError> {
    let foreign = assets::foreign(&registry::mesh_files(scene), &scene.assets, shot.root());
    if let Some(first) = foreign.first() {
        return Err(RunError::Request(format!(
            "{}: found {} files that a sequence of the preset would take for frames, and which its folder lacks; remove them, or name another \
             folder with -o",
            printable_path(&shot.root().join(first)),
            foreign.len()
        )));
    }
    let is_new = !shot.preset().exists();
    for (name, asset) in &scene.assets {
        let copy = shot.root().join(name);
        let is_same = || cache::checksum(&copy).is_ok_and(|found| found.checksum == asset.hash);
        if is_new && copy.exists() && !is_same() {
            return Err(RunError::Request(format!(
                "{}: found another file where the shot keeps its copy of {name}; name another folder with -o, or rename the file",
                printable_path(&copy)
            )));
        }
        let folder = name.split(['/', '\\']).next().unwrap_or_default();
        if reserved_folders().any(|reserved| folder.eq_ignore_ascii_case(reserved)) && folder != name {
            return Err(RunError::Request(format!(
                "{name}: found a file in the folder `{folder}`, in which a shot keeps files of its own; move the file to a folder \
                 of another name and change the preset"
            )));
        }
    }
    Ok(())
}

/// Copies the files that the scene names next to the preset as run, so that it can be run again from there.
///
/// # Errors
/// If one cannot be written.
pub(super) fn keep_assets(scene: &Scene, folder: &ShotFolder) -> Result<(), RunError> {
    for (name, asset) in &scene.assets {
        let path = folder.root().join(name);
        if cache::checksum(&path).is_ok_and(|found| found.checksum == asset.hash) {
            continue;
        }
        // Each folder on the way: any may be a link.
        let parents: Vec<&Path> = Path::new(name).ancestors().skip(1).collect();
        for parent in parents.into_iter().rev().filter(|parent| !parent.as_os_str().is_empty()) {
            ShotFolder::create(&folder.root().join(parent))?;
        }
        cache::write_atomically(&path, |out| out.write_all(&asset.bytes)).map_err(|source| {
            let next = "check that the folder can be written and the disk has free space";
            RunError::File { path, source, next }
        })?;
    }
    Ok(())
}

/// The samples of one mesh, from the disk or made now.
fn field(
    mesh: &MeshShape,
    asset: &Asset,
    folder: Option<&ShotFolder>,
    reporter: &dyn Reporter,
) -> Result<Sampled, RunError> {
    // OBJ and PLY of the same bytes do not exist, so the format needs no place in the key.
    let decisive = [asset.hash, u64::from(mesh.resolution), u64::from(SAMPLED_VERSION)];
    let bytes: Vec<u8> = decisive.iter().flat_map(|word| word.to_le_bytes()).collect();
    let key = xxhash_rust::xxh3::xxh3_64(&bytes);
    let path = Path::new(&mesh.file);
    let (triangles, counts) = import::parse_faces(path, &asset.bytes)?;
    if let Some((folder, grid)) = folder.zip(sdf::sampled_grid(&triangles, mesh.resolution)) {
        match cache::read_samples(&folder.samples(), key, &grid) {
            Ok(field) => return Ok(field),
            Err(CacheError::NotFound { .. }) => {}
            // Also what cannot be read, as a pipe of that name: what is written takes its place.
            Err(damage) => {
                let place = printable_path(&cache::samples_path(&folder.samples(), key));
                let why = match damage {
                    CacheError::Corrupt { place: part, found, expected, .. } => {
                        format!("{part}: found {found}, expected {expected}")
                    }
                    CacheError::Io { source, .. } => source.to_string(),
                    other => other.to_string(),
                };
                reporter.note(&format!(
                    "{} is sampled again, as {place} does not hold its samples: {why}",
                    printable(&mesh.file)
                ));
            }
        }
    }
    let fault = |found: String| {
        let expected = format!("a surface that encloses a voxel, 1/{} of its longest side", mesh.resolution);
        let (path, place) = (path.to_path_buf(), "the whole mesh".to_owned());
        ImportError::Malformed { path, place, found, expected }
    };
    let made = sdf::from_triangles(&triangles, mesh.resolution)
        .ok_or_else(|| fault("faces without an extent".to_owned()))?;
    if made.inside == 0 {
        return Err(fault("a surface that encloses nothing".to_owned()).into());
    }
    let found: Vec<String> = counts.report().into_iter().chain(Soundness::of(&triangles).report()).collect();
    if !found.is_empty() {
        reporter.note(&format!("{}: found {}", printable(&mesh.file), found.join("; ")));
    }
    if let Some(folder) = folder {
        ShotFolder::create(&folder.samples())?;
        cache::write_samples(&folder.samples(), key, &made.field)?;
    }
    Ok(made.field)
}
