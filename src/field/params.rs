//! What decides how particles become a density.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How particles become a density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityParams {
    /// Distance between particles at rest [m].
    pub spacing: f32,
    /// Support h of the kernel [spacings], 1 to 8.
    pub kernel_radius: f32,
    /// Distance between nodes [spacings].
    pub voxel: f32,
    /// How kernels follow their neighbourhoods; none: they are balls.
    pub anisotropy: Option<Anisotropy>,
    /// Whether filled bricks are computed as well, as a fog volume needs; a surface is the same without them.
    pub whole: bool,
}

/// How kernels follow their neighbourhoods.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Anisotropy {
    /// How far kernels move from their particle to the mean of its neighbours: 0 not at all, 1 all the way. More is
    /// smoother, and rounds edges.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub smoothing: f32,
    /// The longest axis of a kernel over its shortest. More makes flat sheets flatter.
    #[schemars(range(min = 1.0, max = 16.0))]
    pub ratio: f32,
}

impl Default for Anisotropy {
    fn default() -> Self {
        Self { smoothing: 0.9, ratio: 4.0 }
    }
}
