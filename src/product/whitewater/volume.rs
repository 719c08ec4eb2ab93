//! The OpenVDB file of a frame: volume fractions of spray, foam and bubbles.
//!
//! *Method*: each particle adds its volume to the eight nodes around it with trilinear weights; over the volume of a voxel that is the
//! part of space which particles fill. The sum over all nodes is the volume of all particles.

use super::folder::WhitewaterPoints;
use crate::{
    cache::WrittenFile,
    export::{
        ExportError,
        vdb::{self, Class, Compression, Grid, Precision, VolumeParams},
    },
    frame::{FrameIndex, Stream},
    grid::{BRICK, BRICK_NODES, Bricks, NodeMask, SparseGrid, masks_of, offset},
    job::{OutputFiles, batch::ProductFolder},
    math::Vec3,
    sim::whitewater::Kind,
};
use std::{f32::consts::PI, path::Path};

/// Memory of a brick: values, mask, and its bytes in a file [bytes].
const BRICK_BYTES: f64 = 6500.0;

/// Memory of the cell of a particle and the bricks around it [bytes].
const CELL_BYTES: f64 = 150.0;

/// Largest coordinate of a node.
const MAX_NODE: f64 = (1 << 30) as f64;

/// The volume fractions of a frame.
pub(super) struct Fractions {
    voxel: f32,
    grids: Vec<(Kind, SparseGrid)>,
    /// Particles that no grid can hold, left out.
    pub(super) too_far: u64,
}

impl Fractions {
    /// The volume fractions of a stream of whitewater, if `allows` agrees to the memory that they take [bytes].
    ///
    /// # Errors
    /// What `allows` returns.
    pub(super) fn new<E>(
        stream: &Stream,
        voxel: f32,
        allows: impl FnOnce(u64) -> Result<(), E>,
    ) -> Result<Self, E> {
        let (Some(positions), Some(radii), Some(kinds)) =
            (stream.vec3("position"), stream.f32("radius"), stream.u32("kind"))
        else {
            unreachable!("whitewater has places, radii and kinds")
        };
        let cells: Vec<Option<([i32; 3], Vec3)>> = positions.iter().map(|&x| cell(x, voxel)).collect();
        let too_far = cells.iter().filter(|cell| cell.is_none()).count() as u64;
        let of_kind = |kind: Kind| {
            let numbers = (0..kinds.len()).filter(move |&i| kinds[i] == kind as u32);
            numbers.filter_map(|i| Some((i, cells[i]?)))
        };
        let bricks = Kind::ALL.map(|kind| {
            let corners = of_kind(kind).flat_map(|(_, (node, _))| [node, node.map(|n| n + 1)]);
            let mut coords: Vec<[i32; 3]> = Vec::new();
            // Duplicates are dropped each time that so many more may be there: in time proportional to the particles.
            let mut limit = 1 << 16;
            let mut corners = corners.map(|node| node.map(|n| n.div_euclid(BRICK as i32)));
            while let (Some(low), Some(high)) = (corners.next(), corners.next()) {
                let all =
                    (0..8).map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { high } else { low }[axis]));
                coords.extend(all);
                if coords.len() >= limit {
                    coords.sort_unstable();
                    coords.dedup();
                    limit = (2 * coords.len()).max(1 << 16);
                }
            }
            coords.sort_unstable();
            coords.dedup();
            Bricks::new(coords)
        });
        let count: usize = bricks.iter().map(Bricks::len).sum();
        allows((count as f64 * BRICK_BYTES + kinds.len() as f64 * CELL_BYTES) as u64)?;
        let mut grids = Vec::new();
        for (kind, bricks) in Kind::ALL.into_iter().zip(bricks) {
            let mut grid = SparseGrid::new(voxel, bricks, 0.0);
            for (i, (node, part)) in of_kind(kind) {
                let volume = 4.0 / 3.0 * PI * (radii[i] / voxel).powi(3);
                for corner in 0..8 {
                    let upper = [0, 1, 2].map(|axis| corner >> axis & 1 == 1);
                    let weight: f32 =
                        (0..3).map(|axis| if upper[axis] { part[axis] } else { 1.0 - part[axis] }).product();
                    let at: [i32; 3] = std::array::from_fn(|axis| node[axis] + i32::from(upper[axis]));
                    *node_mut(&mut grid, at) += volume * weight;
                }
            }
            grids.push((kind, grid));
        }
        Ok(Self { voxel, grids, too_far })
    }

    /// Writes the grids to `path` with a key.
    ///
    /// # Errors
    /// As [`vdb::write`].
    pub(super) fn write(
        &self,
        path: &Path,
        compression: Compression,
        key: u64,
    ) -> Result<WrittenFile, ExportError> {
        let masks: Vec<Vec<NodeMask>> =
            self.grids.iter().map(|(_, grid)| masks_of(&grid.values, |&v| v > 0.0)).collect();
        let grids: Vec<Grid> = self
            .grids
            .iter()
            .zip(&masks)
            .map(|((kind, grid), active)| Grid {
                name: kind.name(),
                class: Class::FogVolume(&grid.values),
                voxel: self.voxel,
                bricks: &grid.bricks,
                active,
            })
            .collect();
        // Half precision ends at 6e-8, which fine spray in a coarse grid is below.
        vdb::write(&grids, path, &VolumeParams { precision: Precision::Float, compression }, key)
    }
}

/// The output of the volumes, with one frame.
pub(super) fn output(name: &str, index: FrameIndex) -> OutputFiles {
    let grids = Kind::ALL.iter().map(|kind| kind.name().to_owned()).collect();
    OutputFiles { grids, ..OutputFiles::of("volume", WhitewaterPoints.name(), name, "vdb", index) }
}

/// The node below a place on each axis, and the distance from it [voxels]; `None` if no grid holds it.
fn cell(x: Vec3, voxel: f32) -> Option<([i32; 3], Vec3)> {
    let at = x.map(|c| f64::from(c) / f64::from(voxel));
    let low = at.map(f64::floor);
    // False for a NaN.
    let is_near = low.iter().all(|c| c.abs() < MAX_NODE);
    is_near.then(|| ([0, 1, 2].map(|axis| low[axis] as i32), (at - low).cast()))
}

/// The value of a node in one of the grid's bricks.
fn node_mut(grid: &mut SparseGrid, node: [i32; 3]) -> &mut f32 {
    let brick = grid.bricks.find(node.map(|n| n.div_euclid(BRICK as i32))).expect("bricks hold all nodes");
    let place = offset(node.map(|n| n.rem_euclid(BRICK as i32) as usize));
    &mut grid.values[brick * BRICK_NODES + place]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::StreamKind;

    fn stream(particles: &[(Vec3, f32, Kind)]) -> Stream {
        Stream::new("whitewater", StreamKind::Unknown, particles.len())
            .with("position", particles.iter().map(|p| p.0).collect::<Vec<_>>())
            .with("radius", particles.iter().map(|p| p.1).collect::<Vec<_>>())
            .with("kind", particles.iter().map(|p| p.2 as u32).collect::<Vec<_>>())
    }

    #[test]
    fn the_sum_of_the_fractions_is_the_volume_of_the_particles() {
        let particles = [
            (Vec3::new(0.31, -0.27, 1.0), 0.02, Kind::Foam),
            (Vec3::new(0.799, 0.1, 1.01), 0.03, Kind::Foam),
            (Vec3::new(-5.0, 2.0, 3.0), 0.01, Kind::Spray),
            (Vec3::new(1e12, 0.0, 0.0), 0.01, Kind::Bubble),
        ];
        let voxel = 0.1;
        let found = Fractions::new(&stream(&particles), voxel, |_| Ok::<_, ()>(())).unwrap();
        assert_eq!(found.too_far, 1);
        for (kind, expected) in
            [(Kind::Foam, 0.02_f32.powi(3) + 0.03_f32.powi(3)), (Kind::Spray, 1e-6), (Kind::Bubble, 0.0)]
        {
            let (_, grid) = found.grids.iter().find(|(of, _)| *of == kind).unwrap();
            let sum: f32 = grid.values.iter().sum::<f32>() * voxel.powi(3);
            assert!((sum - 4.0 / 3.0 * PI * expected).abs() < 1e-9, "{kind:?}: {sum}");
        }
        // The node nearest to a particle has most of it.
        let (_, spray) = &found.grids[0];
        assert!((spray.value([-50, 20, 30]) / (4.0 / 3.0 * PI * 1e-3) - 1.0).abs() < 1e-3);
        let refused =
            Fractions::new(
                &stream(&particles),
                voxel,
                |bytes| if bytes > 1000 { Err(bytes) } else { Ok(()) },
            );
        assert!(refused.is_err());
    }
}
