//! What a preset can say about a surface.

use crate::{
    field::Anisotropy,
    sdf::{Order, SdfParams},
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How particles become a surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SurfaceParams {
    /// Edge of a grid cell, in particle spacings. Half as much gives four times the triangles and takes eight
    /// times the memory. Lone droplets fall between the nodes and flicker from 1 (a ninth of them) to 2 (nine
    /// tenths).
    #[schemars(range(min = 0.05, max = 10.0))]
    pub voxel: f32,
    /// Support of the density kernel, in particle spacings. Smaller shows single particles, larger rounds
    /// the surface.
    #[schemars(range(min = 1.0, max = 8.0))]
    pub kernel_radius: f32,
    /// Kernels that follow their neighbourhoods, for flat water and thin sheets; absent: balls.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Anisotropy>,
    /// The signed distance to the density's surface, from which the mesh is then cut: normals lean less by a fifth where
    /// nothing smooths them. Absent: the mesh is cut from the density.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<DistanceParams>,
    /// What the vertices carry, by the names of the particles' channels: numbers and vectors as the mean around
    /// the vertex, whole numbers (`id`) from the nearest particle. `vorticity` [1/s] is made from `velocity`
    /// where the particles have none; `age` and `source` are there where `liquid.channels` names them. A name that the
    /// particles lack is refused. Absent: `velocity`, if they have it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attributes: Option<Vec<String>>,
    /// Removal of small pieces; absent: every piece stays.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<ComponentParams>,
    /// Smoothing that keeps volume; absent: the surface as it was cut.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoothing: Option<SmoothingParams>,
    /// Fewer triangles; absent: all of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimation: Option<DecimationParams>,
}

impl SurfaceParams {
    /// Whether nothing is done to the mesh once it is cut.
    pub fn is_as_cut(&self) -> bool {
        self.components.is_none() && self.smoothing.is_none() && self.decimation.is_none()
    }
}

impl Default for SurfaceParams {
    fn default() -> Self {
        Self {
            voxel: 0.5,
            kernel_radius: 2.0,
            anisotropy: None,
            distance: None,
            attributes: None,
            components: None,
            smoothing: None,
            decimation: None,
        }
    }
}

/// How the signed distance is found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DistanceParams {
    /// How far from the surface, in voxels: as far as level sets reach. Meshes are the same from 2 on; at 1 normals
    /// leaned 0.03° more on a splash. Time and memory grow with it.
    #[schemars(range(min = 1.0, max = 64.0))]
    pub band: f32,
    /// The order of the differences. It shows in normals and level sets; where the surface lies does not depend on it. On
    /// a splash the second brought normals 0.1° nearer, for twice the time of the distance.
    pub order: Order,
    /// Edge of the blocks that a thread takes at a time, in bricks of 8³ nodes. It changes the time, never the result.
    #[schemars(range(min = 1, max = 8))]
    pub block: u32,
}

impl Default for DistanceParams {
    fn default() -> Self {
        Self { band: 3.0, order: Order::First, block: 1 }
    }
}

impl From<DistanceParams> for SdfParams {
    fn from(params: DistanceParams) -> Self {
        let DistanceParams { band, order, block } = params;
        Self { band, order, block: block as usize, ..Self::default() }
    }
}

/// Removal of small pieces. Their places and radii go to a file of points beside the mesh; bubbles in the liquid
/// that are as small are filled.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ComponentParams {
    /// The least volume that stays a mesh, in volumes of a particle (spacing³). Smaller keeps lone droplets as
    /// meshes of a few dozen triangles each; larger turns splashes into points.
    #[schemars(range(min = 0.0, max = 1e6))]
    pub smallest: f32,
}

impl Default for ComponentParams {
    fn default() -> Self {
        Self { smallest: 4.0 }
    }
}

/// Smoothing that keeps volume, edges, and what is thin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SmoothingParams {
    /// Bumps shorter than this vanish, longer ones stay, in particle spacings. Smaller shows the particles, larger
    /// takes ripples away. On a ball of disordered particles normals lean 13.7° without smoothing, 6.0° at 4, 3.6° at 6
    /// and 2.3° at 8. The time grows with it and with one over `voxel`.
    #[schemars(range(min = 0.5, max = 30.0))]
    pub wavelength: f32,
    /// The part of the smoothing that sheets, threads and droplets of one particle get. More than 0.5 wears their
    /// rims away.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub thin: f32,
    /// Edges that bend by more than this within half a wavelength, as smoothing would leave them, are kept: there only bumps of
    /// a third of the wavelength vanish \[deg\]. A right angle bends by 115, and edges begin at seven tenths of what is said here.
    /// Smaller keeps blunter edges, and below 60 more of the particles; 180 keeps none, and saves a seventh of the time.
    #[schemars(range(min = 5.0, max = 180.0), extend("unit" = "deg"))]
    pub crease: f32,
}

impl Default for SmoothingParams {
    fn default() -> Self {
        Self { wavelength: 6.0, thin: 0.2, crease: 90.0 }
    }
}

/// Fewer triangles, where the surface is flat first. The mesh stays closed and manifold.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DecimationParams {
    /// The part of the triangles to keep. With 0, `error` alone decides.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub fraction: f32,
    /// The most triangles to keep, if that is fewer; absent: `fraction` alone decides.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub triangles: Option<u32>,
    /// No vertex goes further than this from the faces it stands for (root mean square distance from their
    /// planes), in particle spacings; absent: as far as it takes. 0.02 is not seen, 0.2 shows facets.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub error: Option<f32>,
}

impl Default for DecimationParams {
    fn default() -> Self {
        Self { fraction: 0.5, triangles: None, error: None }
    }
}
