//! The job that turns level sets of other programs into meshes.

use super::{Control, Failure, RunError, ShotFolder, Surfaced, surface::Writer, surface_files::numbers};
use crate::{
    export::MeshFormat,
    frame::FrameIndex,
    import::{self, LevelSet},
    mesh::{self, Mesh, SurfaceParams},
    par,
};
use std::path::PathBuf;

/// The name of the meshes.
const NAME: &str = "surface";

/// Meshes the level set of every OpenVDB file of `files` into `out`, in every format; `fps` are the frames a second of
/// the sequence. Files keep their numbers, as particle files do, and are always meshed anew.
///
/// # Errors
/// A file that cannot be read is left out and named at the end ([`RunError::SomeFailed`]), or is the job's error
/// if it is the only one; a folder or disk that refuses to be written ends the job at once.
pub fn mesh_level_sets(
    files: &[PathBuf],
    out: &ShotFolder,
    fps: f64,
    formats: &[MeshFormat],
    control: Control,
) -> Result<Surfaced, RunError> {
    let numbers = numbers(files);
    let params = SurfaceParams::default(); // no particle becomes a surface here
    let mut writer = Writer::new(out, &params, formats, true)?;
    let outcome = mesh_each(files, &numbers, &mut writer, control);
    writer.finish("Level set", fps, &numbers, outcome)
}

/// Meshes one file after the other.
fn mesh_each(
    files: &[PathBuf],
    numbers: &[u32],
    writer: &mut Writer,
    control: Control,
) -> Result<(), RunError> {
    control.reporter.begin("mesh", files.len());
    for (place, (file, &number)) in files.iter().zip(numbers).enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        let index = FrameIndex(number);
        match import::read_level_set(file) {
            Ok(level_set) => {
                let (mesh, cut) = contour(&level_set);
                let check = mesh::check(&mesh);
                writer.put(NAME, index, &mesh)?;
                let figures = format!(
                    "frame {index}  {} triangles  volume {:.4} m³  {} pieces  of the grid {}",
                    mesh.triangles.len(),
                    check.volume,
                    check.components,
                    level_set.name
                );
                control.reporter.frame(&figures);
                if cut > 0 {
                    let why = format!(
                        "the mesh is written, but it is open: {cut} cells of the level set cross its surface and lack \
                         nodes; save it with a band of at least two voxels"
                    );
                    writer.fail(file.display().to_string(), why, Failure::Other);
                } else {
                    writer.complain(index, &check);
                }
            }
            Err(why) if files.len() == 1 => return Err(why.into()),
            Err(why) => writer.fail(file.display().to_string(), why.to_string(), Failure::Other),
        }
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// The surface of a level set with its normals, and how many of its cells lack a node.
fn contour(level_set: &LevelSet) -> (Mesh, usize) {
    let (mut mesh, stats) = mesh::marching_cubes(&level_set.grid);
    mesh.normals = mesh::normals_from_distance(&mesh, &level_set.grid).0;
    par::update(&mut mesh.positions, |_, x| *x += level_set.origin);
    (mesh, stats.cut_cells)
}
