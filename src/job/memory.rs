//! The parts of the memory model that systems and products share.
//!
//! *Method*: peaks of resident memory of whole runs, by particles, bricks and vertices. The constants of each system and each product
//! are in its own folder.

use super::RunError;
use crate::grid::BRICK;
use crate::math::elementary::powf;

/// The program, its threads and the frame being packed [bytes]: 6 to 7 MiB before there is a particle, 9 MiB with them.
pub(crate) const BASE_MEMORY: f64 = 10e6;

/// Vertices a brick before any are counted: dam breaks have 45 to 63, liquid poured over a figure 103.
const VERTICES_PER_BRICK: f64 = 100.0;

/// Bricks at a voxel of one spacing over particles^0.8: larger shots have less surface a particle. The power of the voxel, 2.3,
/// lies between that of a surface and that of a volume. Smaller, and a splash takes more than its bound; larger, and more
/// shots calibrate before they start, and fewer frames are meshed at once.
const MAX_BRICK_DENSITY: f64 = 0.122;

/// The size of the grids that a surface or a volume is made on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Grids {
    /// Bricks of the density.
    pub(crate) bricks: f64,
    /// Vertices of the mesh.
    pub(crate) vertices: f64,
    /// Bricks of the coarse nodes that are sampled before; 0 if they are few.
    pub(crate) coarse_bricks: f64,
    /// Bricks of the signed distance, if it is computed.
    pub(crate) distance_bricks: f64,
}

impl Grids {
    /// Grids of so many bricks, with vertices in the usual proportion.
    pub(crate) fn of_bricks(bricks: f64) -> Self {
        Self { bricks, vertices: bricks * VERTICES_PER_BRICK, coarse_bricks: 0.0, distance_bricks: bricks }
    }

    /// The largest grids that so many particles cover at a voxel of `voxel` [spacings], wherever they lie: what
    /// `double-dam-break` has when it is most spread, 0.095 bricks a particle with 10 000 at voxel 0.5 and 0.058 with
    /// 117 000. The other presets have 0.56 to 0.82 times as many.
    pub(crate) fn at_most(particles: usize, voxel: f32) -> Self {
        Self::of_bricks(MAX_BRICK_DENSITY * powf(particles as f64, 0.8) / powf(f64::from(voxel), 2.3))
    }

    /// These grids with the bricks inside the liquid, which volumes have too.
    pub(crate) fn with_inside(self, particles: usize, voxel: f32) -> Self {
        let inside = particles as f64 / (BRICK as f64 * f64::from(voxel)).powi(3);
        Self { bricks: self.bricks + inside, ..self }
    }
}

/// Refuses what needs more than `allowed` bytes.
///
/// # Errors
/// [`RunError::OverMemory`].
pub(crate) fn refuse_memory(needed: u64, allowed: u64) -> Result<(), RunError> {
    if needed > allowed { Err(RunError::OverMemory { needed, allowed }) } else { Ok(()) }
}
