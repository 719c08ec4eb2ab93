//! What presets of any system have in common: text to a tree with places, the schema, units, diagnostics.
//!
//! Preset text becomes a tree in which every value knows its place (`tree.rs`). The tree is checked against the
//! schema that parameter structs generate (`model.rs`, `check.rs`), so that every mistake is found at once and
//! reported where it is; plain SI values remain. Nothing here names a system: what presets contain is composed in
//! [`Scene`](crate::scene::Scene).

pub(crate) mod assets;
mod branch;
pub mod builtin;
mod camera;
pub(crate) mod check;
mod frames;
pub(crate) mod model;
pub(crate) mod problem;
pub(crate) mod shapes;
pub(crate) mod tree;
pub(crate) mod units;

pub use assets::{Asset, Assets, Home};
pub(crate) use branch::{Branch, frame_keys};
pub(crate) use camera::Camera;
pub use frames::{Frames, FramesError};
pub use problem::{Problem, SceneError};
