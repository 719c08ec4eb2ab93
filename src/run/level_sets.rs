//! The job that turns level sets of other programs into meshes.

use super::{
    Control, Failure, RunError, ShotFolder,
    job::{self, Batch, Fit, Job, Target},
    ledger::{Done, Work},
    plan::{Product, level_set_memory},
    source::{NO_FILE, choose, numbered, size},
    surface::{MeshFiles, complain},
};
use crate::{
    export::MeshFormat,
    import::{LevelSet, LevelSetFile, Sequence},
    mesh::{self, Mesh},
    par,
};
use std::path::Path;

/// The name of the meshes.
const NAME: &str = "surface";

/// Raised whenever a change cuts another mesh from the same level set.
const CUT_VERSION: u64 = 1;

/// Bytes of a leaf in a file, of which there may be as many as that: a leaf whose values are packed well. More, and level
/// sets are read twice, the second time alone, as they hold more than was guessed; less, and fewer are meshed at once.
const LEAST_LEAF: u64 = 256;

/// Meshes the level set of every OpenVDB file of a sequence into `out`, in every format, several at once where memory
/// allows. Files keep their numbers, and meshes of the same bytes are kept, as for particle files.
///
/// # Errors
/// As [`surface`](super::surface::surface) of particle files; a level set whose band is too narrow is meshed and named.
pub fn mesh_level_sets(
    sequence: &Sequence,
    out: &ShotFolder,
    formats: &[MeshFormat],
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let wanted = choose(&numbered(sequence), job.selection.as_ref())?;
    let sole = wanted.len() == 1;
    let batch = Batch { wanted: &wanted, absent: NO_FILE, sole, title: "Level set", fps: job.fps };
    let files = MeshFiles { out, folder: "mesh", formats, points: false };
    let cost = |path: &Path| level_set_memory((size(path) / LEAST_LEAF) as usize);
    job::each(Product::Meshes, out, &batch, job, control, cost, |path, allowance, made| {
        let file = LevelSetFile::open(path)?;
        let key = file.content_key(CUT_VERSION);
        let mut target = Target { index: made.index, name: NAME.into(), key };
        if let Some(piece) = files.kept(&target).filter(|_| !job.force) {
            made.pieces.push(piece);
            return Ok(Fit::Yes);
        }
        let level_set = file.level_set()?;
        drop(file);
        if job.fit(allowance, |_| level_set_memory(level_set.grid.bricks.len()))? == Fit::No {
            return Ok(Fit::No);
        }
        let (mesh, cut) = contour(&level_set);
        let check = mesh::check(&mesh);
        let figures = format!(
            "frame {}  {} triangles  volume {:.4} m³  {} pieces  of the grid {}",
            made.index,
            mesh.triangles.len(),
            check.volume,
            check.components,
            level_set.name
        );
        if cut > 0 {
            // Its file is that of nothing, so that it is named again.
            target.key = 0;
            let why = format!(
                "{}: the mesh is written, but it is open: {cut} cells of the level set cross its surface and lack nodes; \
                 save it with a band of at least two voxels",
                path.display()
            );
            made.fail(why, Failure::Other);
        } else {
            complain(made, &mesh, &check, level_set.grid.voxel);
        }
        made.pieces.push(files.write(&mesh, None, &target, Work::on(&mesh, figures, None))?);
        Ok(Fit::Yes)
    })
}

/// The surface of a level set with its normals, and how many of its cells lack a node.
fn contour(level_set: &LevelSet) -> (Mesh, usize) {
    let (mut mesh, stats) = mesh::marching_cubes(&level_set.grid);
    mesh.normals = mesh::normals_from_field(&mesh, &level_set.grid).0;
    par::update(&mut mesh.positions, |_, x| *x += level_set.origin);
    (mesh, stats.cut_cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        grid::{BRICK_NODES, Bricks, SparseGrid, node_of},
        math::Vec3,
    };

    #[test]
    fn a_mesh_stands_where_its_level_set_does() {
        let corners = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|v| v - 1)).collect();
        let mut grid = SparseGrid::new(0.5, Bricks::new(corners), 9.0);
        for brick in 0..grid.bricks.len() {
            for place in 0..BRICK_NODES {
                let node = node_of(grid.bricks.coords()[brick], place);
                grid.values[brick * BRICK_NODES + place] =
                    0.5 * Vec3::from(node.map(|v| v as f32)).norm() - 2.0;
            }
        }
        let mesh = |origin: Vec3| contour(&LevelSet { grid: grid.clone(), origin, name: "ball".into() });
        let ((here, cut), (there, _)) = (mesh(Vec3::zeros()), mesh(Vec3::new(64.0, -32.0, 16.0)));
        assert!(cut == 0 && mesh::check(&here).is_sound() && here.normals.len() == here.positions.len());
        let moved = here.positions.iter().zip(&there.positions).map(|(a, b)| b - a);
        assert!(moved.into_iter().all(|by| (by - Vec3::new(64.0, -32.0, 16.0)).amax() < 1e-5));
    }
}
