//! Parameters of a force field in a preset.

use crate::solid::{Interpolation, Keyframe, Shape};
use serde::{Deserialize, Serialize};

/// A force field: an acceleration by place and time, the same for all systems on which it acts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct ForceParams {
    /// What it does. Places and directions are in the coordinates that `shape` is written in.
    pub kind: ForceKind,
    /// The volume in which it acts; absent: everywhere. It is no collider. Behind a `plane` and outside of a `tank` it acts on
    /// everything.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shape: Option<Shape>,
    /// Distance from the surface of `shape` over which the force decreases smoothly to zero [m]; absent: it ends at the
    /// surface. `turbulence` with a shape needs one. Range: above 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub falloff: Option<f32>,
    /// Factor of the strength over time: linear between keyframes, constant before the first and after the last; empty: 1.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub strength_keyframes: Vec<StrengthKeyframe>,
    /// Where the force, its shape included, is over time, as for colliders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How it moves from keyframe to keyframe.
    #[serde(default)]
    pub interpolation: Interpolation,
    /// The systems on which it acts, "liquid", "sheets" or "bodies"; empty: all that the preset has.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub systems: Vec<String>,
}

/// What a force field does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum ForceKind {
    /// The same acceleration everywhere, as gravity.
    Uniform {
        /// Acceleration [m/s²], at most 1e6 long.
        acceleration: [f32; 3],
    },
    /// Attraction to a point, or repulsion from it, with a potential: what moves in it keeps its energy.
    Point {
        /// The point [m].
        center: [f32; 3],
        /// Acceleration s of s (R/ρ)ᵖ r/ρ at the distance r, with ρ² = r² + R² [m/s²]; positive attracts, negative repels. Range: -1e6 to 1e6.
        strength: f32,
        /// Radius R of the core [m], within which the force decreases to zero at the point. Range: 1e-6 to 1e6.
        radius: f32,
        /// Exponent p with which the force decreases far from the core: 0 not at all, 2 as gravity. Range: 0 to 8.
        #[serde(default = "two")]
        power: f32,
    },
    /// Acceleration around an axis, by the right-hand rule. What moves freely in it spirals outwards.
    Vortex {
        /// A point on the axis [m].
        center: [f32; 3],
        /// Direction of the axis; any length but zero.
        axis: [f32; 3],
        /// Acceleration s of s (R/ρ)ᵖ d/ρ at the distance d from the axis, with ρ² = d² + R² [m/s²]. Range: -1e6 to 1e6.
        strength: f32,
        /// Radius R of the core [m], within which the force decreases to zero at the axis. Range: 1e-6 to 1e6.
        radius: f32,
        /// Exponent p with which the force decreases far from the core: 0 not at all, 1 as the velocity of a vortex. Range: 0 to 8.
        #[serde(default = "one")]
        power: f32,
    },
    /// Random acceleration without divergence, which neither gathers nor thins out what it moves.
    Turbulence {
        /// RMS of the acceleration [m/s²]. Range: 0 to 1e6.
        strength: f32,
        /// Wavelength [m]: wavelengths are between 0.7 and 1.4 of it. Range: 1e-6 to 1e6.
        scale: f32,
        /// Time in which the pattern changes [s]: periods are between 0.7 and 2 of it; absent: it does not change. Range: 1e-3 to 1e6.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        period: Option<f32>,
        /// Another number gives another pattern.
        #[serde(default)]
        seed: u32,
    },
    /// Drag towards a velocity, as of air that moves with it: the difference decays exponentially.
    Drag {
        /// Rate of the decay [1/s]. Range: 0 to 1e6.
        rate: f32,
        /// The velocity [m/s], at most 1e5 long. That of keyframes does not count.
        #[serde(default)]
        velocity: [f32; 3],
    },
}

/// Factor of the strength at a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct StrengthKeyframe {
    /// The frame, as `frames` counts. Keyframes ascend.
    pub frame: u32,
    /// Factor of the strength, or of the rate of a drag, at that frame. Range: 0 to 1.
    pub factor: f32,
}

impl ForceKind {
    /// Name of the kind in presets.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Uniform { .. } => "uniform",
            Self::Point { .. } => "point",
            Self::Vortex { .. } => "vortex",
            Self::Turbulence { .. } => "turbulence",
            Self::Drag { .. } => "drag",
        }
    }
}

fn one() -> f32 {
    1.0
}

fn two() -> f32 {
    2.0
}
