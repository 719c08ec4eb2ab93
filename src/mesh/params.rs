//! What a preset can say about a surface.

use crate::field::Anisotropy;
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
    /// Present: kernels follow their neighbourhoods, for flat water and thin sheets.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub anisotropy: Option<Anisotropy>,
}

impl Default for SurfaceParams {
    fn default() -> Self {
        Self { voxel: 0.5, kernel_radius: 2.0, anisotropy: None }
    }
}
