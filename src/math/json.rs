//! Numbers that JSON cannot hold.

use serde::{Deserialize, Deserializer};

/// Reads a number; null, as which JSON stores numbers that are not finite, is NaN.
///
/// # Errors
/// If it is neither.
pub(crate) fn nan_if_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
