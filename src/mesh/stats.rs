//! Statistics of a reconstruction.

use super::{CavityStats, ComponentStats, ContactStats, ContourStats, DecimationStats, SmoothingStats};

/// Statistics of a reconstruction, including all adjustments.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct SurfaceStats {
    /// Number of particles.
    pub particles: usize,
    /// Particles too far from the origin for the grid, which are left out.
    pub too_far_particles: usize,
    /// Particles that fall between the nodes of a coarse grid and leave no trace.
    pub unseen_particles: usize,
    /// Particles left out because there are more in their place than any liquid has.
    pub clustered_particles: usize,
    /// Particles whose radius was limited to the range of scales.
    #[serde(skip_serializing_if = "is_zero")]
    pub limited_radii: usize,
    /// Bricks of the density and of the signed distance.
    pub bricks: [usize; 2],
    /// Nodes of the signed distance outside the band.
    pub unreached_nodes: usize,
    /// Nodes on the surface, displaced by a millionth of a voxel.
    pub nodes_on_surface: usize,
    /// Vertices of the mesh.
    pub vertices: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Adjustments of marching cubes.
    pub contour: ContourStats,
    /// Closing of small cavities.
    pub cavities: CavityStats,
    /// Removal of small components.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<ComponentStats>,
    /// Smoothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<SmoothingStats>,
    /// Fitting to solids.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactStats>,
    /// Decimation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimation: Option<DecimationStats>,
    /// Vertices with the normal of their faces, because the field has no usable gradient there; not counted
    /// on a smoothed surface.
    pub normals_from_faces: usize,
    /// Vertices and points with the attributes of the nearest particle, because none is within the kernel.
    pub attributes_from_nearest: usize,
    /// Seconds per pass, in the order of their first run; marching cubes and normals may alternate.
    pub seconds: Vec<(&'static str, f64)>,
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}
