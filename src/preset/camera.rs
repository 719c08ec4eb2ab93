//! The camera of a shot, for pictures.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A camera at rest, upright. It does not change the simulation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// Where it is [m].
    pub position: [f32; 3],
    /// The point in the middle of the picture [m], another than `position`.
    pub target: [f32; 3],
    /// Focal length for a sensor that is 36 mm wide [mm]: 24 is a wide angle, 50 is as eyes see, 100 is a telephoto lens.
    /// Range: 1 to 5000.
    #[serde(default = "default_focal_length")]
    pub focal_length: f32,
}

fn default_focal_length() -> f32 {
    50.0
}
