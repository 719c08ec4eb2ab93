//! What jobs need to know of a product.
//!
//! A product is one folder below `src/product/`. Jobs and the command line name no product; they loop over
//! [`ALL`](super::registry::ALL).

use super::request::{ProductInfo, ProductRequest, ProductSettings};
use crate::{
    frame::{Stream, StreamKind},
    job::{
        Control, RunError, ShotFolder,
        batch::{BatchSummary, ProductFolder},
    },
    preset::{check::Places, problem::Finding},
    sim::{scene::Scene, tradeoff::Subject},
};

/// A product made of frames, as jobs see it.
pub(crate) trait Product: ProductFolder {
    /// Verb of the command line that makes the product.
    fn verb(&self) -> &'static str;

    /// Input of the product, for messages ("particles").
    fn input(&self) -> &'static str;

    /// Whether it is made of streams of frames, or else of the preset alone.
    fn is_of_streams(&self) -> bool {
        true
    }

    /// Whether it is made of streams of this kind.
    fn accepts(&self, kind: StreamKind) -> bool;

    /// Whether these settings request the product.
    fn is_requested(&self, settings: &ProductSettings) -> bool;

    /// Arguments of the verb that request this product alone, as these settings do.
    fn arguments(&self, settings: &ProductSettings) -> Vec<String>;

    /// Whether every frame has files of its own, so that several processes can make different frames.
    fn is_per_frame(&self) -> bool {
        true
    }

    /// Whether only selected frames have files, so that the other requested frames lack none.
    fn is_of_selected_frames(&self) -> bool {
        false
    }

    /// Key with which a preset requests the product, and an example; `None` if presets cannot request it.
    fn preset_key(&self) -> Option<(&'static str, &'static str)> {
        None
    }

    /// Whether it depends on the colliders of the preset, whose meshes are then sampled.
    fn uses_solids(&self, _: &ProductSettings) -> bool {
        false
    }

    /// Reports settings that cannot be met with streams of these `kinds`, of which it accepts some.
    fn check(&self, _: &ProductSettings, _kinds: &[StreamKind], _: &Places, _: &mut Vec<Finding>) {}

    /// Reports contents of a preset of which it cannot be made.
    fn check_scene(&self, _: &Scene, _: &Places, _: &mut Vec<Finding>) {}

    /// Makes the product.
    ///
    /// # Errors
    /// Frames that cannot be read or made, need more memory than the request allows, or are missing, are left out and reported
    /// together at the end ([`RunError::SomeFailed`]). Errors of a single file, also that it has no particles, are the
    /// batch's error; a folder or disk that refuses to be written ends the batch at once. [`RunError::Request`] if it
    /// cannot be made of the input.
    fn make(&self, request: &ProductRequest, control: Control) -> Result<BatchSummary, RunError>;

    /// The largest memory that making it of a stream of so many entries was seen to take [bytes].
    fn max_memory(&self, settings: &ProductSettings, kind: StreamKind, entries: usize) -> f64;

    /// The memory that making it of a stream takes, from which `triangles` were made [bytes].
    fn stream_memory(&self, settings: &ProductSettings, stream: &Stream, _triangles: u64) -> f64 {
        self.max_memory(settings, stream.kind, stream.len())
    }

    /// What `tradeoff` compares of it; `None`: nothing.
    fn tradeoff(&self) -> Option<&'static Subject> {
        None
    }

    /// Figures of the product's files that are not in the manifest.
    ///
    /// # Errors
    /// If its log cannot be read.
    fn info(&self, _: &ShotFolder) -> Result<ProductInfo, RunError> {
        Ok(ProductInfo::default())
    }
}
