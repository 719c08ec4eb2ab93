//! Colliders of a preset, and solids in the form of the systems.

use super::{Interpolation, Keyframe, Motion, Shape};
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

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
    /// Coulomb friction μ of the liquid on the surface: 0.1 lets a puddle glide, 0.5 stops it, 1 and more nearly sticks. Sheets
    /// have their own in `sheets.friction`. Absent: the liquid slips freely. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f32>,
    /// Restitution of the liquid on the surface: the speed of a particle after an impact over that before; 0.3 lets
    /// drops patter, 1 loses nothing. Absent: none. Range: 0 to 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub restitution: Option<f32>,
    /// Contact angle of the liquid on the surface [°], which needs `liquid.surface_tension`: below 90 the liquid wets it, above
    /// it beads. Absent: the `contact_angle` of the surface tension. Range: 0 to 180.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_angle: Option<f32>,
    /// How pictures show it; it does not change the simulation. Absent: "matte", and a tank, which has no outside, is not exported.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<Look>,
}

/// How pictures show a collider.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Look {
    /// An opaque matte body.
    Matte,
    /// Clear glass, for containers; a tank has walls around it, of 0.6 % of its longest side.
    Glass,
    /// Exported, but neither shown nor rendered.
    Hidden,
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
    /// Coulomb friction of the liquid; 0: none.
    pub friction: f32,
    /// Restitution of the liquid; 0: none.
    pub restitution: f32,
    /// Contact angle of the liquid [°]; `None`: that of its surface tension.
    pub contact_angle: Option<f32>,
}

impl Collider {
    /// Whether its shape or size changes.
    #[cfg(feature = "presets")]
    pub(crate) fn is_deforming(&self) -> bool {
        let moves = matches!(&self.shape, Shape::Mesh(mesh) if mesh.names_motion());
        moves || self.keyframes.iter().any(|key| key.scale != 1.0)
    }

    /// Whether the surface does more to the liquid than to keep it out.
    #[cfg(feature = "presets")]
    pub(crate) fn has_friction_or_restitution(&self) -> bool {
        [self.friction, self.restitution].iter().flatten().any(|&coefficient| coefficient > 0.0)
    }

    /// How pictures show it; `None`: it is not exported.
    pub fn shown_look(&self) -> Option<Look> {
        let is_tank = matches!(self.shape, Shape::Tank { .. });
        self.look.or((!is_tank).then_some(Look::Matte))
    }

    /// The collider in a shot of `fps` frames a second, whose frame `first` is at time 0.
    pub fn solid(&self, fps: f64, first: u32) -> Solid {
        let motion = Motion::new(&self.keyframes, self.interpolation, fps, first);
        let (friction, restitution) = (self.friction.unwrap_or(0.0), self.restitution.unwrap_or(0.0));
        Solid { shape: self.shape.clone(), motion, friction, restitution, contact_angle: self.contact_angle }
    }
}

impl Solid {
    /// The shape in its size at `time` [s], with its vertices where they then are, in its own axes.
    pub fn shape_at(&self, time: f64) -> Cow<'_, Shape> {
        let shape = self.shape.at(time);
        match self.motion.as_ref().filter(|motion| motion.is_scaling()) {
            Some(motion) => Cow::Owned(shape.scaled(motion.scale(time))),
            None => shape,
        }
    }

    /// Whether its shape or size changes.
    pub fn is_deforming(&self) -> bool {
        self.shape.is_deforming() || self.motion.as_ref().is_some_and(Motion::is_scaling)
    }

    /// Smallest and largest size over that of the shape as written.
    pub(crate) fn scales(&self) -> [f32; 2] {
        self.motion.as_ref().map_or([1.0; 2], Motion::scales)
    }

    /// Upper bound of the speed of its surface between two times [m/s]: of its motion by keyframes and of its vertices.
    pub fn fastest(&self, from: f64, to: f64) -> f64 {
        let motion = self.motion.as_ref().map_or(0.0, |motion| motion.fastest(from, to, self.shape.reach()));
        let vertices = if let Shape::Mesh(mesh) = &self.shape { mesh.fastest(from, to) } else { 0.0 };
        motion + vertices * f64::from(self.scales()[1])
    }

    /// A smooth shape that stands still, with the contact angle of the liquid.
    pub fn fixed(shape: Shape) -> Self {
        Self { shape, motion: None, friction: 0.0, restitution: 0.0, contact_angle: None }
    }
}
