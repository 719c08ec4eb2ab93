//! Parameters of couplings.

use serde::{Deserialize, Serialize};

/// A coupling of two systems, which do not interact otherwise.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Coupling {
    /// The two systems: "liquid" or "smoke", and the name of a sheet, in either order. Liquid and a sheet push each other; the air of
    /// the smoke pushes a sheet, but does not feel it.
    pub between: [String; 2],
    /// Coefficient of Coulomb friction between liquid and sheet: with 0.1 the liquid runs off slowly, with 1 it drags cloth along;
    /// absent: it slides. Range: at least 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub friction: Option<f32>,
    /// Drag of the smoke's air on the sheet; absent: the same as `{}`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drag: Option<Drag>,
}

/// Drag of air on the faces of a sheet: ½ ρ A (C |u_n| u_n + C_t |u_t| u_t), where u_n and u_t are the air's velocity relative to the
/// face, across and along it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct Drag {
    /// Density of the air ρ [kg/m³]. Range: above 0.
    pub density: f32,
    /// Drag coefficient C across the face: 1.2 for a plate in the wind, 2 where no air flows around it.
    /// Range: at least 0.
    pub across: f32,
    /// Drag coefficient C_t along the face: 0.02 for cloth, 0 for none. Range: at least 0.
    pub along: f32,
}

impl Default for Drag {
    fn default() -> Self {
        Self { density: 1.2, across: 1.2, along: 0.02 }
    }
}
