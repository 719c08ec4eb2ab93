//! The job that turns level sets of other programs into meshes.

use super::{
    Control, Failure, RunError, ShotFolder, SurfaceJob, Surfaced, remarks,
    surface::{Ledger, Made, Writer, choose},
    surface_files::{NO_FILE, numbered},
};
use crate::{
    export::MeshFormat,
    frame::FrameIndex,
    import::{self, LevelSet, Sequence},
    mesh::{self, Mesh, SurfaceParams},
    par,
    scene::Frames,
};
use std::path::PathBuf;

/// The name of the meshes.
const NAME: &str = "surface";

/// Meshes the level set of every OpenVDB file of a sequence (those of `selection`, or all) into `out`, in every format;
/// `fps` are the frames a second of the sequence. Files keep their numbers, as particle files do, and are always meshed anew.
///
/// # Errors
/// A file that cannot be read is left out and named at the end ([`RunError::SomeFailed`]), or is the job's error
/// if it is the only one; a folder or disk that refuses to be written ends the job at once.
pub fn mesh_level_sets(
    sequence: &Sequence,
    out: &ShotFolder,
    fps: f64,
    formats: &[MeshFormat],
    selection: Option<&Frames>,
    control: Control,
) -> Result<Surfaced, RunError> {
    let wanted = choose(&numbered(sequence), selection)?;
    let numbers: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    if selection.is_none() {
        remarks::of_gaps(&numbers).iter().for_each(|gaps| control.reporter.note(gaps));
    }
    let job = SurfaceJob {
        params: SurfaceParams::default(), // no particle becomes a surface here
        formats: formats.to_vec(),
        selection: None,
        force: true,
        max_memory: None,
        side_by_side: false,
    };
    let mut ledger = Ledger::new(out)?;
    let outcome = mesh_each(&wanted, &Writer::new(out, &job), &mut ledger, control);
    ledger.finish(&job, "Level set", fps, &numbers, outcome, control)
}

/// Meshes one file after the other.
fn mesh_each(
    wanted: &[(FrameIndex, Option<PathBuf>)],
    writer: &Writer,
    ledger: &mut Ledger,
    control: Control,
) -> Result<(), RunError> {
    control.reporter.begin("mesh", wanted.len());
    for (place, (index, file)) in wanted.iter().enumerate() {
        if (control.interrupted)() {
            return Err(RunError::Interrupted);
        }
        let mut made = Made::new(*index);
        let Some(file) = file else {
            made.fail(format!("frame {index}"), NO_FILE.into(), Failure::Other);
            ledger.take(made, control);
            continue;
        };
        match import::read_level_set(file) {
            Ok(level_set) => {
                let (mesh, cut) = contour(&level_set);
                let check = mesh::check(&mesh);
                let figures = format!(
                    "frame {index}  {} triangles  volume {:.4} m³  {} pieces  of the grid {}",
                    mesh.triangles.len(),
                    check.volume,
                    check.components,
                    level_set.name
                );
                writer.put(NAME, &mesh, figures, &mut made)?;
                if cut > 0 {
                    let why = format!(
                        "the mesh is written, but it is open: {cut} cells of the level set cross its surface and lack \
                         nodes; save it with a band of at least two voxels"
                    );
                    made.fail(file.display().to_string(), why, Failure::Other);
                } else {
                    made.complain(&mesh, &check, level_set.grid.voxel);
                }
            }
            Err(why) if wanted.len() == 1 => return Err(why.into()),
            Err(why) => made.fail(file.display().to_string(), why.to_string(), Failure::Other),
        }
        ledger.take(made, control);
        control.reporter.progress((place + 1) as f64);
    }
    control.reporter.end();
    Ok(())
}

/// The surface of a level set with its normals, and how many of its cells lack a node.
fn contour(level_set: &LevelSet) -> (Mesh, usize) {
    let (mut mesh, stats) = mesh::marching_cubes(&level_set.grid);
    mesh.normals = mesh::normals_from_field(&mesh, &level_set.grid).0;
    par::update(&mut mesh.positions, |_, x| *x += level_set.origin);
    (mesh, stats.cut_cells)
}
