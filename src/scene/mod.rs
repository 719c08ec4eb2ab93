//! What a preset says (`file.rs`), what it means (`check.rs`), and the composition ([`Scene`]).

use crate::{mesh::SurfaceParams, sim::liquid::LiquidParams, solid::Collider};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A whole shot, as its preset says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// The shot's name.
    pub title: String,
    /// The frames to compute: "1-96", "1-240x2", "1,5,9-12". The first is the initial state.
    pub frames: String,
    /// Frames a second.
    #[serde(default = "default_fps")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 10000.0))]
    pub fps: f32,
    /// Gravity and colliders.
    #[serde(default)]
    pub world: World,
    /// The liquid; absent: none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub liquid: Option<LiquidParams>,
    /// How frames are meshed.
    #[serde(default)]
    pub surface: SurfaceParams,
    /// What `shot` writes besides the cache.
    #[serde(default)]
    pub output: Output,
}

/// What surrounds the systems.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct World {
    /// Acceleration on everything [m/s²].
    #[schemars(extend("unit" = "m/s²"))]
    pub gravity: [f32; 3],
    /// What keeps the systems out.
    pub collider: Vec<Collider>,
}

impl Default for World {
    fn default() -> Self {
        Self { gravity: [0.0, 0.0, -9.81], collider: Vec::new() }
    }
}

/// What `shot` writes besides the cache.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Output {
    /// Formats of the surface meshes.
    pub mesh: Vec<MeshFormat>,
}

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MeshFormat {
    /// Binary PLY, with velocities.
    Ply,
    /// Wavefront OBJ.
    Obj,
}

fn default_fps() -> f32 {
    24.0
}
