//! From the meshes that a scene names to shapes that can be asked: read, sampled, kept on disk.

use super::{Reporter, RunError, ShotFolder};
use crate::{
    cache::{self, CacheError},
    import::{self, ImportError},
    scene::{Asset, Scene},
    sdf::{self, SAMPLED_VERSION, Sampled},
    sim::sheet::{SheetMesh, SheetParams, SheetShape, SheetsCommon},
    solid::{MeshShape, Shape},
};
use std::{collections::BTreeMap, path::Path, sync::Arc};

/// The scene with all its meshes filled. Samples are looked for in the shot's folder, if one is given, and left
/// there.
///
/// # Errors
/// If a mesh is no closed surface, or is broken, or the samples cannot be written; if smoke from them is more than can be counted.
pub(super) fn fill(
    scene: &Scene,
    folder: Option<&ShotFolder>,
    reporter: &dyn Reporter,
) -> Result<Scene, RunError> {
    let mut scene = scene.clone();
    let mut made = BTreeMap::<(String, u32), Arc<Sampled>>::new();
    let colliders = scene.world.collider.iter_mut().filter_map(|collider| match &mut collider.shape {
        Shape::Mesh(mesh) => Some(mesh),
        _ => None,
    });
    let sources = scene.liquid.iter_mut().flat_map(|liquid| &mut liquid.source);
    let sources = sources.filter_map(|source| match &mut source.shape {
        Shape::Mesh(mesh) => Some(mesh),
        _ => None,
    });
    let smoke = scene.smoke.iter_mut().flat_map(|smoke| smoke.shapes_mut());
    let smoke = smoke.filter_map(|shape| match shape {
        Shape::Mesh(mesh) => Some(mesh),
        _ => None,
    });
    let joints = scene.sheets.iter_mut().flat_map(SheetsCommon::shapes_mut);
    let parts =
        scene.sheet.iter_mut().flat_map(SheetParams::shapes_mut).chain(joints).filter_map(
            |shape| match shape {
                Shape::Mesh(mesh) => Some(mesh),
                _ => None,
            },
        );
    for mesh in colliders.chain(sources).chain(smoke).chain(parts) {
        let name = (mesh.file.clone(), mesh.resolution);
        if !made.contains_key(&name) {
            let asset = &scene.assets[&mesh.file];
            made.insert(name.clone(), Arc::new(field(mesh, asset, folder, reporter)?));
        }
        mesh.fill(made[&name].clone());
    }
    for sheet in &mut scene.sheet {
        if let SheetShape::Mesh(mesh) = &mut sheet.shape {
            fill_sheet(mesh, &scene.assets[&mesh.file])?;
        }
    }
    scene.refuse_too_much_smoke()?;
    Ok(scene)
}

/// Puts the points and faces of a file into the mesh of a sheet.
fn fill_sheet(mesh: &mut SheetMesh, asset: &Asset) -> Result<(), RunError> {
    let found = import::parse_sheet(Path::new(&mesh.file), &asset.bytes)?;
    mesh.points = found.positions.iter().map(|&x| x.into()).collect();
    mesh.faces = found.faces;
    [mesh.stiffness, mesh.rest, mesh.damping] = found.painted;
    Ok(())
}

/// Copies the files that the scene names beside the preset as run, so that it can be run again from there.
///
/// # Errors
/// If one cannot be written.
pub(super) fn keep_assets(scene: &Scene, folder: &ShotFolder) -> Result<(), RunError> {
    for (name, asset) in &scene.assets {
        let path = folder.root().join(name);
        if std::fs::read(&path).is_ok_and(|bytes| bytes == **asset.bytes) {
            continue;
        }
        if let Some(parent) = path.parent() {
            ShotFolder::create(parent)?;
        }
        cache::write_atomically(&path, |out| out.write_all(&asset.bytes)).map_err(|source| {
            let next = "check that the folder can be written and the disk has room";
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
    if let Some(folder) = folder {
        match cache::read_samples(&folder.samples(), key) {
            Ok(field) => return Ok(field),
            Err(CacheError::NotFound { .. }) => {}
            Err(damage @ CacheError::Corrupt { .. }) => {
                reporter.note(&format!("{} is sampled again: {damage}", mesh.file));
            }
            Err(other) => return Err(other.into()),
        }
    }
    let path = Path::new(&mesh.file);
    let triangles = import::parse_triangles(path, &asset.bytes)?;
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
    if made.caps > 0 {
        reporter.note(&format!("{} has holes, which were closed", mesh.file));
    }
    if let Some(folder) = folder {
        ShotFolder::create(&folder.samples())?;
        cache::write_samples(&folder.samples(), key, &made.field)?;
    }
    Ok(made.field)
}
