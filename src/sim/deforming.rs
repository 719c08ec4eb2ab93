//! From the files of a collider that deforms to its motion.

use super::scene::Scene;
use crate::{
    import::{self, ImportError},
    job::RunError,
    math::Vec3,
    preset::assets::sequence,
    sdf::Triangles,
    solid::{Deformation, MeshShape},
};
use std::path::Path;

/// The motion of a mesh of the scene; `None` if it does not deform.
///
/// # Errors
/// If a file is broken, has other faces than the first of its sequence, or the motion is not continuous.
pub(crate) fn deformation(mesh: &MeshShape, scene: &Scene) -> Result<Option<Deformation>, RunError> {
    let read = if mesh.is_sequence() {
        sequence_samples(mesh, scene)?
    } else if let Some(cache) = &mesh.point_cache {
        point_cache_samples(mesh, cache, scene)?
    } else {
        return Ok(None);
    };
    let seconds = |frame: f64| (frame - f64::from(scene.frames.first().0)) / f64::from(scene.fps);
    let times = read.frames.iter().map(|&frame| seconds(frame)).collect();
    let made = Deformation::new(read.triangles, read.samples, times, mesh.resolution);
    let deformation = made.map_err(|why| {
        let named = mesh.point_cache.as_ref().unwrap_or(&mesh.file);
        RunError::Request(format!(
            "{named}: {why}; samples count from 0: look at this one, or export a sample for each frame or more"
        ))
    })?;
    Ok(Some(deformation))
}

/// Vertices of a mesh over time.
struct Samples {
    triangles: Vec<[u32; 3]>,
    samples: Vec<Vec<Vec3>>,
    frames: Vec<f64>,
}

/// The positions of a point cache for the faces of the mesh's file.
fn point_cache_samples(mesh: &MeshShape, cache: &str, scene: &Scene) -> Result<Samples, RunError> {
    let Triangles { positions, triangles } =
        import::parse_triangles(Path::new(&mesh.file), &scene.assets[&mesh.file].bytes)?;
    let read = import::parse_point_cache(Path::new(cache), &scene.assets[cache].bytes, positions.len())?;
    let frames = (0..read.samples.len()).map(|sample| read.start + read.step * sample as f64).collect();
    Ok(Samples { triangles, samples: read.samples, frames })
}

/// The positions of a sequence of meshes with the same faces.
fn sequence_samples(mesh: &MeshShape, scene: &Scene) -> Result<Samples, RunError> {
    let mut out = Samples { triangles: Vec::new(), samples: Vec::new(), frames: Vec::new() };
    let (mut vertices, mut faces) = (0, 0);
    for (frame, name, asset) in sequence(&mesh.file, &scene.assets) {
        let (Triangles { positions, triangles }, counts) =
            import::parse_faces(Path::new(name), &asset.bytes)?;
        // Faces of many corners may be cut in another manner where they bend: the first file decides.
        if out.samples.is_empty() {
            (out.triangles, vertices, faces) = (triangles, positions.len(), counts.digest);
        } else if positions.len() != vertices || counts.digest != faces {
            let found = match positions.len() == vertices && triangles.len() == out.triangles.len() {
                true => "faces of other vertices".to_owned(),
                false => format!("{} vertices and {} triangles", positions.len(), triangles.len()),
            };
            let expected =
                format!("{vertices} vertices and {} triangles as in the first file", out.triangles.len());
            let (path, place) = (name.into(), "the whole mesh".to_owned());
            return Err(ImportError::Malformed { path, place, found, expected }.into());
        }
        out.samples.push(positions);
        out.frames.push(f64::from(frame));
    }
    Ok(out)
}
