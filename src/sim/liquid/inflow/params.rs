//! Parameters of inflow and outflow in a preset.

use crate::solid::{Interpolation, Keyframe, Shape};
use serde::{Deserialize, Serialize};

/// A nozzle from which liquid flows while the shot runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LiquidEmitter {
    /// The nozzle: any shape but `plane` and `tank`. Its cross-section is its outline as seen against the direction of the flow, and
    /// liquid leaves it on the side that the flow points to. It is no collider.
    pub shape: Shape,
    /// Velocity of the liquid, in addition to that of the nozzle, in the coordinates that `shape` is written in [m/s]. Excludes
    /// `rate`, `rate_keyframes` and `direction`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f32; 3]>,
    /// Volume flow rate ("2 L/s") [m³/s]. The speed follows from it and from the area of the cross-section, so that the volume is
    /// exact. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate: Option<f32>,
    /// Volume flow rate over time, in place of `rate`: linear between keyframes, constant before the first and after the last.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rate_keyframes: Vec<RateKeyframe>,
    /// Direction of a flow that `rate` or `rate_keyframes` gives, in the coordinates that `shape` is written in; any length but
    /// zero. Absent: the normal of a disc.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub direction: Option<[f32; 3]>,
    /// Dynamic viscosity of its liquid, as for sources [Pa·s]; absent: `liquid.viscosity.dynamic`. Range: above 0, at most 1e8.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub viscosity: Option<f32>,
    /// Colour of its liquid, as for sources: linear red, green and blue [1]. Range: 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub color: Option<[f32; 3]>,
    /// The ranges of frames in which it is on, in ascending order; empty: it is always on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub on: Vec<FrameRange>,
    /// Where the nozzle is over time, as for colliders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How it moves from keyframe to keyframe.
    #[serde(default)]
    pub interpolation: Interpolation,
}

/// Volume flow rate at a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct RateKeyframe {
    /// The frame, as `frames` counts. Keyframes ascend.
    pub frame: u32,
    /// Volume flow rate at that frame [m³/s]. Range: at least 0.
    pub rate: f32,
}

/// A range of frames.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct FrameRange {
    /// The frame at which it begins, which the next one shows; absent: the shot's first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<u32>,
    /// The frame at which it ends; absent: the shot's last.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<u32>,
}

/// A volume that removes liquid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LiquidOutflow {
    /// The volume, at least a spacing thick. Behind a `plane` and outside of a `tank` everything is removed.
    pub shape: Shape,
    /// The ranges of frames in which it is on, in ascending order; empty: it is always on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub on: Vec<FrameRange>,
    /// Where the volume is over time, as for colliders.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How it moves from keyframe to keyframe.
    #[serde(default)]
    pub interpolation: Interpolation,
}

/// The box in which the liquid is simulated. It is no collider: particles outside of it are removed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LiquidDomain {
    /// Lower corner [m].
    pub min: [f32; 3],
    /// Upper corner [m], above `min` on every axis.
    pub max: [f32; 3],
    /// The sides through which liquid may leave; absent: all. Particles that leave through another one have left by accident, as
    /// through a gap between colliders: they are removed too, and every frame warns of them.
    #[serde(default = "all_sides")]
    pub open: Vec<Side>,
}

/// A side of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The side of the smallest x.
    XMin,
    /// The side of the largest x.
    XMax,
    /// The side of the smallest y.
    YMin,
    /// The side of the largest y.
    YMax,
    /// The side of the smallest z, the floor.
    ZMin,
    /// The side of the largest z.
    ZMax,
}

impl Side {
    /// All sides, in the order of [`Side::index`].
    pub const ALL: [Self; 6] = [Self::XMin, Self::XMax, Self::YMin, Self::YMax, Self::ZMin, Self::ZMax];

    /// Its number: twice the axis, and one more for the upper side.
    pub fn index(self) -> usize {
        self as usize
    }

    /// Name of the side in presets.
    pub fn name(self) -> &'static str {
        ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max"][self.index()]
    }
}

fn all_sides() -> Vec<Side> {
    Side::ALL.to_vec()
}

impl LiquidEmitter {
    /// Direction of the flow in the emitter's own axes, of any length; `None` if the preset gives none.
    pub(in crate::sim) fn flow_direction(&self) -> Option<[f32; 3]> {
        let normal = || match self.shape {
            Shape::Disc { normal, .. } => Some(normal),
            _ => None,
        };
        self.velocity.or(self.direction).or_else(normal)
    }
}
