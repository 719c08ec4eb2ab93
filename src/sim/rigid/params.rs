//! Parameters of rigid bodies in presets.

use crate::solid::{Look, Shape, Solid};
use serde::{Deserialize, Serialize};

/// A rigid body: it falls, floats, tumbles, and collides with colliders and other bodies. Liquid or sheets move it, and it moves them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct BodyParams {
    /// Its shape, which must be bounded. A mesh counts as solid, without cavities.
    pub shape: Shape,
    /// Density [kg/m³]: the body floats if it is below that of the liquid; wood has 400 to 900, ice 917. With a
    /// liquid it must be at least 0.03 of the liquid's. Range: above 0.
    pub density: f32,
    /// Where the shape's own origin is at the start [m].
    #[serde(default)]
    pub position: [f32; 3],
    /// Turns of the shape at the start about the world's X, then Y, then Z axis through its own origin [deg] (Euler XYZ, as Blender).
    #[serde(default)]
    pub rotation: [f32; 3],
    /// Velocity of the centre of mass at the start [m/s].
    #[serde(default)]
    pub velocity: [f32; 3],
    /// Angular velocity at the start [deg/s], as a vector along the axis.
    #[serde(default)]
    pub angular_velocity: [f32; 3],
    /// Coulomb friction μ on colliders, and on other bodies and sheets, for which it is √(μ₁ μ₂). Range: at least 0.
    #[serde(default = "default_friction")]
    pub friction: f32,
    /// Speed after an impact on a collider or another body over that before; of two bodies the larger counts. Range: 0 to 1.
    #[serde(default)]
    pub restitution: f32,
    /// Coulomb friction μ of the liquid on the surface, as for colliders. Absent: the liquid slips freely. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub liquid_friction: Option<f32>,
    /// Contact angle of the liquid on the surface [°], as for colliders. Range: 0 to 180.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact_angle: Option<f32>,
    /// How pictures show it; it does not change the simulation. Absent: "matte".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look: Option<Look>,
}

fn default_friction() -> f32 {
    0.3
}

impl BodyParams {
    /// A body of `density` [kg/m³] at rest where its shape is.
    pub fn new(shape: Shape, density: f32) -> Self {
        Self {
            shape,
            density,
            position: [0.0; 3],
            rotation: [0.0; 3],
            velocity: [0.0; 3],
            angular_velocity: [0.0; 3],
            friction: default_friction(),
            restitution: 0.0,
            liquid_friction: None,
            contact_angle: None,
            look: None,
        }
    }

    /// The solid that the liquid sees.
    pub(super) fn solid(&self) -> Solid {
        let (friction, contact_angle) = (self.liquid_friction.unwrap_or(0.0), self.contact_angle);
        Solid { friction, contact_angle, ..Solid::fixed(self.shape.clone()) }
    }
}
