//! Parameters of surface reconstruction.

use crate::{
    field::Anisotropy,
    sdf::{Order, SdfParams, SeedRule},
};
use serde::{Deserialize, Serialize};

/// Reconstruction of a surface from particles.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceParams {
    /// Edge of a grid cell, in particle spacings. Half the edge gives four times the triangles and takes
    /// eight times the memory. From 1 on, single droplets fall between the nodes and flicker: a ninth of them
    /// at 1, nine tenths at 2. Range: 0.05 to 10.
    pub voxel: f32,
    /// Support radius of the density kernel, in particle spacings. Smaller shows single particles, larger
    /// makes the surface rounder. Range: 1 to 8.
    pub kernel_radius: f32,
    /// Radius of the particles, with which the kernel of each scales; absent: half the spacing, whatever the
    /// particles' attributes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<RadiusSource>,
    /// Anisotropic kernels, for flat water and thin sheets; absent: isotropic kernels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Anisotropy>,
    /// The signed distance to the density's isosurface, whose zero level set is then meshed: without
    /// smoothing, normals deviate less by a fifth. Absent: the density itself is meshed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<DistanceParams>,
    /// How far the surface is moved outwards, or inwards if negative, in particle spacings: to the level set of
    /// the signed distance at this distance, which is closed and does not intersect itself. Inwards, parts
    /// thinner than twice as much vanish; outwards, gaps close. On a ball the error is 0.02 spacings
    /// on average and 0.12 at most at voxel 0.5, and 0.007 and 0.05 at voxel 0.25.
    /// Absent: not moved. Range: -2 to 2.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub offset: Option<f32>,
    /// Vertex attributes, by the names of the particles' channels: numbers and vectors as the mean around the
    /// vertex, integers (`id`) from the nearest particle. `vorticity` [1/s] is computed from `velocity` if
    /// the particles have none; `age` and `source` exist if `liquid.channels` names them, and `color` (linear red, green
    /// and blue, the mean as well) if a source or an emitter has one. A missing channel
    /// is an error. Absent: `velocity` and `color`, if the particles have them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attributes: Option<Vec<String>>,
    /// Smallest cavity that stays open, in particle volumes (spacing³). A cavity is a closed pocket of air in
    /// the liquid. Those of less than one particle are gaps between particles, which come and go from one
    /// frame to the next; 0 keeps them, and more than 1 closes bubbles too. Volumes keep them. Range: 0 to 1000.
    pub smallest_cavity: f32,
    /// Removal of small connected components; absent: every component stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<ComponentParams>,
    /// Volume-preserving smoothing; absent: the surface of marching cubes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<SmoothingParams>,
    /// Fitting to the colliders of the shot, so that water meets glass without a gap; absent: the surface ends where its
    /// particles do. Needs a shot: particle files have no colliders.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactParams>,
    /// Decimation, which reduces the number of triangles; absent: all triangles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimation: Option<DecimationParams>,
}

impl SurfaceParams {
    /// Whether the mesh has no clean-up after marching cubes.
    pub fn has_no_cleanup(&self) -> bool {
        let is_kept = self.components.is_none() && self.smoothing.is_none() && self.contact.is_none();
        is_kept && self.decimation.is_none()
    }

    /// The signed distance that the surface needs; `None` if the density is meshed. For an offset without `distance` it is of
    /// second order, and its band reaches the offset.
    pub fn needed_distance(&self) -> Option<DistanceParams> {
        let Some(offset) = self.offset else { return self.distance };
        let params =
            self.distance.unwrap_or(DistanceParams { order: Order::Second, ..DistanceParams::default() });
        Some(DistanceParams { band: params.band.max(offset.abs() / self.voxel + 2.0), ..params })
    }
}

impl Default for SurfaceParams {
    fn default() -> Self {
        Self {
            voxel: 0.5,
            kernel_radius: 2.0,
            radius: None,
            anisotropy: None,
            distance: None,
            offset: None,
            attributes: None,
            smallest_cavity: 1.0,
            components: None,
            smoothing: None,
            contact: None,
            decimation: None,
        }
    }
}

/// Where the radius of a particle comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum RadiusSource {
    /// The particles' attribute `radius`, `pscale` or `radii`, in metres. Kernels scale with it over half the
    /// spacing, by 0.25 to 4; particles beyond are limited and counted. Without the attribute a frame fails.
    Attribute,
}

/// Computation of the signed distance.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct DistanceParams {
    /// Width of the band around the surface, in voxels: level sets extend as far. Meshes are the same from 2
    /// on; at 1 normals deviated by 0.03° more on a splash. Time and memory grow with it. Range: 1 to 64.
    pub band: f32,
    /// Order of the finite differences. It affects normals and level sets, but not the position of the
    /// surface. On a splash the second order improved normals by 0.1°, for twice the time of the distance.
    pub order: Order,
    /// How nodes next to the surface get their distance. On a ball they are off by 0.007 voxels on average with `plane`, by 0.08
    /// with `nearest_edge` and by 0.2 with `density_ratio`, the rules of Gourlay's article, which are for comparison.
    #[serde(skip_serializing_if = "is_plane")]
    pub seed: SeedRule,
    /// Edge of the blocks that a thread processes at a time, in bricks of 8³ nodes. It affects the time,
    /// never the result. Range: 1 to 8.
    pub block: u32,
}

impl Default for DistanceParams {
    fn default() -> Self {
        Self { band: 3.0, order: Order::First, seed: SeedRule::Plane, block: 1 }
    }
}

impl From<DistanceParams> for SdfParams {
    fn from(params: DistanceParams) -> Self {
        let DistanceParams { band, order, seed, block } = params;
        Self { seed, band, order, block: block as usize }
    }
}

/// Whether the seeds are the default ones, which results and their keys leave out.
fn is_plane(seed: &SeedRule) -> bool {
    *seed == SeedRule::Plane
}

/// Removal of small connected components. Their positions and radii go to a file of points next to the mesh;
/// bubbles of that size in the liquid are filled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct ComponentParams {
    /// Smallest volume that stays a mesh, in particle volumes (spacing³). Smaller keeps single droplets as
    /// meshes of a few dozen triangles each; larger turns splashes into points. Range: 0 to 1000000.
    pub smallest: f32,
}

impl Default for ComponentParams {
    fn default() -> Self {
        Self { smallest: 4.0 }
    }
}

/// Smoothing that preserves volume, edges and thin parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct SmoothingParams {
    /// Shortest wavelength of bumps that remain, in particle spacings; shorter ones vanish. Smaller shows the
    /// particles, larger removes ripples. On a ball of disordered particles normals deviate by 13.7° without
    /// smoothing, 6.0° at 4, 3.6° at 6 and 2.3° at 8. The time grows with it and with one over `voxel`.
    /// Range: 0.5 to 30.
    pub wavelength: f32,
    /// The part of the smoothing for sheets, threads and droplets of one particle. More than 0.5 wears their
    /// rims away. Range: 0 to 1.
    pub thin: f32,
    /// Edges that bend by more than this within half a wavelength after smoothing are preserved: there only
    /// bumps of a third of the wavelength vanish \[deg\]. A right angle bends by 115, and edges begin at
    /// seven tenths of this value. At a preserved edge the rows of particles show, with a moat of a tenth of a
    /// spacing behind it; below 60, more of the particles. 180 preserves none. Range: 5 to 180.
    pub crease: f32,
    /// Where the surface is smoothed, by an attribute of the particles; absent: everywhere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<SmoothingMask>,
}

/// Part of the smoothing by an attribute of the particles, such as less where the liquid is fast: at the value `none` the surface
/// is not smoothed, at `full` entirely, between the two in part. Either may be the larger.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct SmoothingMask {
    /// Name of the attribute, as in `surface.attributes`; the length of vectors, such as `velocity` or `vorticity`, counts. A frame
    /// without it fails. Where it is not a number, the surface is smoothed entirely.
    pub attribute: String,
    /// Value without smoothing, in the attribute's unit.
    #[serde(default)]
    pub none: f32,
    /// Value of entire smoothing.
    #[serde(default = "one")]
    pub full: f32,
}

fn one() -> f32 {
    1.0
}

impl Default for SmoothingParams {
    fn default() -> Self {
        Self { wavelength: 6.0, thin: 0.2, crease: 180.0, mask: None }
    }
}

/// Fitting of the surface to colliders, after smoothing. Vertices that face a collider are displaced to its surface, and those
/// inside of it out; the free surface stays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct ContactParams {
    /// Distance of the surface from the collider, in particle spacings. 0 makes both flicker in renderers (z-fighting); a
    /// negative one overlaps, as refraction in Cycles wants it of water in glass. Range: -1 to 1.
    pub gap: f32,
    /// Distance of vertices that are displaced entirely, in particle spacings; between it and twice as much, in part. Smaller
    /// leaves a groove at the edge of the water, larger draws drops to walls before they touch. Range: 0.1 to 2.
    pub reach: f32,
}

impl Default for ContactParams {
    fn default() -> Self {
        Self { gap: 0.02, reach: 0.75 }
    }
}

/// Decimation: fewer triangles, flat parts of the surface first. The mesh stays closed and manifold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct DecimationParams {
    /// The part of the triangles to keep. With 0, `error` alone decides. Range: 0 to 1.
    pub fraction: f32,
    /// Largest number of triangles to keep, if that is fewer; absent: `fraction` alone decides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub triangles: Option<u32>,
    /// Largest distance of a vertex from the faces it represents (root mean square distance from their
    /// planes), in particle spacings; absent: unbounded. 0.02 is invisible, 0.2 shows facets. Range: 0 to 10.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<f32>,
}

impl Default for DecimationParams {
    fn default() -> Self {
        Self { fraction: 0.5, triangles: None, error: None }
    }
}
