//! Sums over the frames of a shot.

use serde::Serializer;
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

impl Total {
    /// The line that people read.
    pub(crate) fn line(&self) -> String {
        format!("{:<10} {}", self.heading, self.text)
    }
}

/// Totals as a map by their keys.
pub(crate) fn totals_by_key<S: Serializer>(totals: &[Total], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(totals.iter().map(|total| (total.key, &total.value)))
}
