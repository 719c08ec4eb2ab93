//! Surfaces as triangle meshes: extraction from a signed distance, attributes, checks, and the whole way from
//! particles to a mesh.

mod attributes;
mod cases;
mod check;
mod marching_cubes;
mod params;
mod reconstruct;

pub use attributes::{interpolate_vec3, normals_from_distance};
pub use check::{Fault, MeshCheck, check};
pub use marching_cubes::{ContourStats, MARGIN, marching_cubes};
pub use params::SurfaceParams;
pub use reconstruct::{Surface, SurfaceError, SurfaceStats, positions, reconstruct};

use crate::{frame::Channel, math::Vec3};

/// Raised whenever a change gives the same particles and settings another mesh, so that old meshes are made again.
pub const SURFACE_VERSION: u32 = 1;

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
