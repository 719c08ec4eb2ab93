//! The outputs of colliders in the manifest of a shot.

use crate::job::{Manifest, RunError, ShotFolder};

/// What a manifest calls a collider.
pub(super) const KIND: &str = "collider";

/// Whether the manifest of a folder lists colliders.
///
/// # Errors
/// If it cannot be read.
pub(in crate::product) fn are_listed(out: &ShotFolder) -> Result<bool, RunError> {
    let manifest = Manifest::read(out)?;
    Ok(manifest.is_some_and(|manifest| manifest.outputs.iter().any(|output| output.kind == KIND)))
}
