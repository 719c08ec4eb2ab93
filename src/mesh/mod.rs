//! Surfaces as triangle meshes: isosurface extraction, clean-up, attributes, checks, and the reconstruction
//! of a mesh from particles.

mod attributes;
mod cases;
mod check;
mod components;
mod contour;
mod decimate;
mod displaced;
mod half_edges;
mod low_pass;
mod marching_cubes;
mod node_signs;
mod normals;
mod params;
mod reconstruct;
mod shell;
mod smooth;
pub mod surface_distance;
mod umbrella;

pub use attributes::transfer;
pub use check::{Fault, MeshCheck, check};
pub use components::{ComponentStats, Points, remove_small};
pub use contour::{Contour, Side};
pub use decimate::{DecimationStats, decimate};
pub use marching_cubes::{ContourStats, MARGIN, marching_cubes};
pub use normals::{normals_from_faces, normals_from_field};
pub use params::{ComponentParams, DecimationParams, DistanceParams, SmoothingParams, SurfaceParams};
pub use reconstruct::{Surface, SurfaceError, SurfaceStats, positions, reconstruct};
pub use shell::shell;
pub use smooth::{SmoothingStats, smooth};

use crate::{frame::Channel, math::Vec3};

/// Increases with every change that gives the same particles and settings a different mesh, so that old
/// meshes are made again.
pub const SURFACE_VERSION: u32 = 5;

/// An indexed triangle mesh. Faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions [m].
    pub positions: Vec<Vec3>,
    /// Three vertices per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Unit outward normals, one per vertex; empty if there are none.
    pub normals: Vec<Vec3>,
    /// Further attributes, one value per vertex: `velocity` [m/s] and others.
    pub attributes: Vec<Channel>,
}
