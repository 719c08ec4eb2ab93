//! Surfaces as triangle meshes: extraction from a field, clean-up, attributes, checks, and the whole way
//! from particles to a mesh.

pub mod apart;
mod cases;
mod check;
mod contour;
mod decimate;
mod links;
mod low_pass;
mod marching_cubes;
mod moved;
mod normals;
mod params;
mod pieces;
mod reconstruct;
mod sides;
mod smooth;
mod thicken;
mod transfer;
mod umbrella;

pub use check::{Fault, MeshCheck, check};
pub use contour::{Contour, Side};
pub use decimate::{DecimationStats, decimate};
pub use marching_cubes::{ContourStats, MARGIN, marching_cubes};
pub use normals::{normals_from_faces, normals_from_field};
pub use params::{ComponentParams, DecimationParams, DistanceParams, SmoothingParams, SurfaceParams};
pub use pieces::{ComponentStats, Points, remove_small};
pub use reconstruct::{Surface, SurfaceError, SurfaceStats, positions, reconstruct};
pub use smooth::{SmoothingStats, smooth};
pub use thicken::thicken;
pub use transfer::transfer;

use crate::{frame::Channel, math::Vec3};

/// Raised whenever a change gives the same particles and settings another mesh, so that old meshes are made again.
pub const SURFACE_VERSION: u32 = 4;

/// An indexed triangle mesh. Faces wind counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions [m].
    pub positions: Vec<Vec3>,
    /// Three vertices a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Unit outward normals, one a vertex; empty if there are none.
    pub normals: Vec<Vec3>,
    /// Further values, one a vertex: `velocity` [m/s] and others.
    pub attributes: Vec<Channel>,
}
