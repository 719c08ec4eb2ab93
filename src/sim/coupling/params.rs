//! What a preset can say about couplings.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Two systems that feel each other. Without it they do not.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Coupling {
    /// The two: "liquid" or "smoke", and the name of a sheet, in either order. Liquid and a sheet push each other; smoke blows a sheet about
    /// and does not feel it.
    pub between: [String; 2],
    /// Friction of a liquid on the sheet, Coulomb's coefficient: 0.1 makes it run off slowly, 1 takes cloth along; absent: it slides.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("minimum" = 0.0))]
    pub friction: Option<f32>,
    /// How smoke's air drags at the sheet; absent: as `{}`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drag: Option<Drag>,
}

/// Drag of air on the faces of a sheet: ½ ρ A (C |u_n| u_n + C_t |u_t| u_t), with u the air's speed relative to the face, across and along it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Drag {
    /// The air's density ρ [kg/m³].
    #[schemars(extend("unit" = "kg/m³", "exclusiveMinimum" = 0.0))]
    pub density: f32,
    /// C, across the face: 1.2 for a plate in the wind, 2 where no air gets round it.
    #[schemars(extend("minimum" = 0.0))]
    pub across: f32,
    /// C_t, along it: 0.02 for cloth, 0 for none.
    #[schemars(extend("minimum" = 0.0))]
    pub along: f32,
}

impl Default for Drag {
    fn default() -> Self {
        Self { density: 1.2, across: 1.2, along: 0.02 }
    }
}
