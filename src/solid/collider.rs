//! Colliders of a preset, and solids in the form of the systems.

use super::{Interpolation, Keyframe, Motion, Shape};
use serde::{Deserialize, Serialize};

/// One collider of the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Collider {
    /// The shape that keeps everything out (or, for a tank, in).
    pub shape: Shape,
    /// Where the shape is over time, by the frame; without any it stays where it is written. Its own origin, about
    /// which it turns, is the origin of the coordinates that `shape` is written in. Before the first keyframe and
    /// after the last it stands still.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
    /// How it moves from keyframe to keyframe.
    #[serde(default, skip_serializing_if = "is_linear")]
    pub interpolation: Interpolation,
}

fn is_linear(interpolation: &Interpolation) -> bool {
    *interpolation == Interpolation::Linear
}

/// A collider with its motion in seconds.
#[derive(Clone, Debug, PartialEq)]
pub struct Solid {
    /// Shape about the collider's own origin.
    pub shape: Shape,
    /// Motion; `None`: the collider's origin is the world's.
    pub motion: Option<Motion>,
}

impl Collider {
    /// The collider in a shot of `fps` frames a second, whose frame `first` is at time 0.
    pub fn solid(&self, fps: f64, first: u32) -> Solid {
        let motion = Motion::new(&self.keyframes, self.interpolation, fps, first);
        Solid { shape: self.shape.clone(), motion }
    }
}

impl Solid {
    /// A shape that stands still.
    pub fn fixed(shape: Shape) -> Self {
        Self { shape, motion: None }
    }
}
