//! Parameters of the density of particles.

use serde::{Deserialize, Serialize};

/// Parameters of the density of particles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityParams {
    /// Distance between particles at rest [m].
    pub spacing: f32,
    /// Support h of the kernel [spacings], 1 to 8.
    pub kernel_radius: f32,
    /// Distance between nodes [spacings].
    pub voxel: f32,
    /// Shape of anisotropic kernels; `None`: isotropic kernels.
    pub anisotropy: Option<Anisotropy>,
    /// Whether filled bricks are computed as well, as a fog volume requires; a surface is the same without
    /// them.
    pub whole: bool,
}

/// Anisotropic kernels, shaped by the neighbourhoods of particles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Anisotropy {
    /// How far kernels move from their particle to the mean of its neighbours: 0 not at all, 1 completely.
    /// More is smoother, and makes edges rounder. Range: 0 to 1.
    pub smoothing: f32,
    /// Ratio of the longest to the shortest axis of a kernel. More makes flat sheets flatter. Range: 1 to 16.
    pub ratio: f32,
}

impl Default for Anisotropy {
    fn default() -> Self {
        Self { smoothing: 0.9, ratio: 4.0 }
    }
}
