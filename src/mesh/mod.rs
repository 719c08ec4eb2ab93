//! Surfaces as triangle meshes: isosurface extraction, clean-up, attributes, checks, and the reconstruction
//! of a mesh from particles.

mod attributes;
mod cases;
mod cavities;
mod check;
mod clean;
mod components;
mod contact;
mod contour;
mod decimate;
mod displaced;
mod error;
mod half_edges;
mod local_frame;
mod low_pass;
mod marching_cubes;
mod mask;
mod node_signs;
mod normals;
mod params;
mod radii;
mod reconstruct;
mod shell;
mod smooth;
mod stats;
pub mod surface_distance;
mod umbrella;

pub use attributes::transfer;
pub use cavities::{CavityStats, close_cavities};
pub(crate) use check::degenerate_in_world_frame;
pub use check::{Fault, MeshCheck, check};
pub use components::{ComponentStats, Points, remove_small};
pub use contact::{ContactStats, PlacedSolid};
pub use contour::{Contour, Interpolation, Side};
pub use decimate::{DecimationStats, decimate};
pub use error::SurfaceError;
pub(crate) use local_frame::is_far;
pub use marching_cubes::{ContourStats, MARGIN, marching_cubes};
pub(crate) use normals::try_unit;
pub use normals::{normals_from_faces, normals_from_field};
pub use params::{
    ComponentParams, ContactParams, DecimationParams, DistanceParams, RadiusSource, SmoothingMask,
    SmoothingParams, SurfaceParams,
};
pub(crate) use radii::RadiusScales;
pub use reconstruct::{Surface, positions, reconstruct, reconstruct_at_solids};
pub use shell::shell;
pub use smooth::{SmoothingStats, smooth};
pub use stats::SurfaceStats;

use crate::{frame::Channel, math::Vec3, par};

/// Increases with every change that gives the same particles and settings a different mesh, so that old
/// meshes are made again.
pub const SURFACE_VERSION: u32 = 8;

/// An indexed triangle mesh. Faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions, relative to `origin` [m].
    pub positions: Vec<Vec3>,
    /// Origin of the positions [m]: zero, but for surfaces far from the world's origin, whose vertices single precision does
    /// not distinguish.
    pub origin: nalgebra::Vector3<f64>,
    /// Three vertices per triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Unit outward normals, one per vertex; empty if there are none.
    pub normals: Vec<Vec3>,
    /// Further attributes, one value per vertex: `velocity` [m/s] and others.
    pub attributes: Vec<Channel>,
}

impl Mesh {
    /// The mesh with its origin at zero. Far from there, vertices round to single precision.
    pub fn in_world_frame(mut self) -> Self {
        let origin = std::mem::take(&mut self.origin);
        if origin != nalgebra::Vector3::zeros() {
            par::update(&mut self.positions, |_, x| *x = (x.cast::<f64>() + origin).cast());
        }
        self
    }
}
