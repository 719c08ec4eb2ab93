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

impl SurfaceStats {
    /// Particles and radii that the surface does not show as they are, by number; zero where all is well.
    pub fn losses(&self) -> [(u64, &'static str); 4] {
        [
            (self.too_far_particles as u64, "particles too far from the origin, left out"),
            (self.limited_radii as u64, "radii limited to an eighth of the spacing and to twice the spacing"),
            (self.unseen_particles as u64, "particles between grid nodes, without effect (surface.voxel)"),
            (
                self.clustered_particles as u64,
                "particles left out of clusters of more than 8 in a cube of half a spacing (check the spacing)",
            ),
        ]
    }

    /// Differences of the surface from the isosurface of the particles' density, by number: the [`Self::losses`] and what the passes
    /// changed.
    pub fn adjustments(&self) -> Vec<(u64, &'static str)> {
        let components = self.components.unwrap_or_default();
        let smoothing = self.smoothing.unwrap_or_default();
        let contact = self.contact.unwrap_or_default();
        let decimation = self.decimation.unwrap_or_default();
        let of_passes = [
            (self.cavities.closed as u64, "small cavities closed"),
            (self.cavities.droplets as u64, "droplets in these cavities removed"),
            (components.points as u64, "small components replaced by points"),
            (components.bubbles as u64, "small bubbles filled"),
            (
                smoothing.restored_vertices as u64,
                "vertices left unsmoothed because triangles would fold or components would shrink",
            ),
            (
                smoothing.partly_smoothed_vertices as u64,
                "vertices smoothed in part because components would shrink",
            ),
            (contact.restored as u64, "vertices not fitted to colliders because triangles would fold"),
            (contact.inside as u64, "vertices too deep inside of colliders to be fitted"),
            (decimation.unsuitable.into(), "open mesh not decimated"),
            (decimation.over_target as u64, "triangles above the target of the decimation"),
        ];
        let of_grid = [
            (self.contour.unbounded_vertices as u64, "vertices next to values that are not finite"),
            (self.contour.cut_cells as u64, "cells cut off by missing bricks, cavities stay open"),
            (self.normals_from_faces as u64, "normals from faces"),
            (self.attributes_from_nearest as u64, "attributes from the nearest particle"),
        ];
        of_passes.into_iter().chain(self.losses()).chain(of_grid).collect()
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}
