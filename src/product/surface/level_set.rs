//! Meshes of level sets that other programs wrote.

use super::{SurfaceMesh, memory::level_set_memory, writer::report_faults};
use crate::{
    export::MeshFormat,
    import::{LevelSet, LevelSetFile, Sequence},
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameBatch, MemoryCheck, NO_FILE, ProductFolder, Written,
            choose, file_size, numbered_files, process_frames, within_reserve,
        },
        file_records::FileRecords,
        tradeoff::readable_volume,
    },
    mesh::{self, Mesh},
    par,
    product::mesh_files::MeshFiles,
};
use std::path::Path;

/// The name of the meshes.
const NAME: &str = "surface";

/// Raised whenever a change cuts another mesh from the same level set.
const CUT_VERSION: u64 = 1;

/// Bytes of a leaf in a file, from which the number of leaves is estimated: a leaf whose values are packed well. Larger, and
/// level sets are read twice, the second time alone, as they hold more than was estimated; smaller, and fewer are meshed at
/// once.
const MIN_LEAF_BYTES: u64 = 256;

/// Meshes the level set of every OpenVDB file of a sequence into `out`, in every format, several at once where memory
/// allows. Files keep their numbers, and meshes of the same bytes are kept, as for particle files.
///
/// # Errors
/// As [`surface`](super::writer::surface) of particle files; a level set whose band is too narrow is meshed and reported.
pub(super) fn mesh_level_sets(
    sequence: &Sequence,
    out: &ShotFolder,
    formats: &[MeshFormat],
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let frames = choose(&numbered_files(sequence), request.selection.as_ref())?;
    let is_single_file = frames.len() == 1;
    let (title, fps) = ("Level set", request.fps);
    let batch = FrameBatch { frames: &frames, followed: None, absent: NO_FILE, is_single_file, title, fps };
    let files = MeshFiles { out, folder: SurfaceMesh.name(), formats, points: false };
    let estimate = |path: &Path| level_set_memory((file_size(path) / MIN_LEAF_BYTES) as usize);
    let records = FileRecords::read(out, SurfaceMesh.name())?;
    process_frames(&SurfaceMesh, out, &batch, request, control, estimate, |path, reserved, outcome| {
        let opened = LevelSetFile::open(path, reserved.or(request.max_memory));
        let Some(file) = within_reserve(reserved, opened)? else { return Ok(MemoryCheck::NeedsMore) };
        let key = file.content_key(CUT_VERSION);
        let mut target = FileTarget { index: outcome.index, name: NAME.into(), key, state: None };
        let kept = files.up_to_date(&target).filter(|files| files.are_recorded(out, &records, &target));
        if let Some(files) = kept.filter(|_| !request.force) {
            outcome.files.push(files);
            return Ok(MemoryCheck::Fits);
        }
        let Some(level_set) = within_reserve(reserved, file.level_set())? else {
            return Ok(MemoryCheck::NeedsMore);
        };
        drop(file);
        let needed = |_| level_set_memory(level_set.grid.bricks.len());
        if request.check_memory(reserved, needed)? == MemoryCheck::NeedsMore {
            return Ok(MemoryCheck::NeedsMore);
        }
        let (mesh, cut_cells) = contour(&level_set);
        let check = mesh::check(&mesh);
        let figures = format!(
            "frame {}  {} triangles  volume {}  {} components  of the grid {}",
            outcome.index,
            mesh.triangles.len(),
            readable_volume(check.volume, 4),
            check.components,
            level_set.name
        );
        if cut_cells > 0 {
            // Without a key the file is never up to date, so that the frame is reported again.
            target.key = 0;
            let why = format!(
                "{}: the mesh is written, but it is open: {cut_cells} cells of the level set cross its surface and lack nodes; \
                 save it with a band of at least two voxels",
                path.display()
            );
            outcome.fail(why, Failure::Other);
        } else {
            report_faults(outcome, &mesh, &check, level_set.grid.voxel);
        }
        let written = Written { figures, ..Written::of(&target) };
        outcome.files.push(files.write(&mesh, None, &target, written)?);
        Ok(MemoryCheck::Fits)
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
    fn a_mesh_is_where_its_level_set_is() {
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
