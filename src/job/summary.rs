//! Sums over the frames of a shot.

use serde_json::Value;

/// Sums and extremes of a system, or of a coupling, over the frames of a shot.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Total {
    /// Key in JSON.
    pub key: &'static str,
    /// The numbers as JSON.
    pub value: Value,
    /// The first word of its line.
    pub heading: &'static str,
    /// The rest of the line.
    pub text: String,
}
