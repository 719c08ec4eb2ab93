//! How presets are loaded: text, quality tiers and `--set` overrides to a checked [`Scene`] (`file.rs`); the generated reference.

mod file;
mod quality;
pub mod reference;

#[cfg(test)]
mod tests;

pub use crate::{
    preset::{Asset, Assets, Frames, FramesError, Home, Problem, SceneError, builtin},
    product::surface::stream_memory,
    sim::scene::{Output, Scene, Tradeoff, World},
};
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) use file::decode;
pub(crate) use file::product_settings;
pub use file::{Overrides, Preset, load, surface_params};
pub use quality::{Quality, UnknownQuality};
