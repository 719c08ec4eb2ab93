//! What slows down or stops jobs.

use serde::Serialize;

/// Something that slows down or stops jobs.
#[derive(Debug, PartialEq, Eq, Serialize)]
pub(super) struct Problem {
    /// Whether no shot can be made here.
    pub(super) stops: bool,
    pub(super) what: String,
    pub(super) next: &'static str,
}

impl Problem {
    pub(super) fn slows(what: impl Into<String>, next: &'static str) -> Self {
        Self { stops: false, what: what.into(), next }
    }

    pub(super) fn stops(what: impl Into<String>, next: &'static str) -> Self {
        Self { stops: true, what: what.into(), next }
    }
}

/// A size in bytes for people, in the units that `--max-memory` takes.
pub(super) fn sized(bytes: u64) -> String {
    const UNITS: [(&str, u32); 3] = [("TiB", 40), ("GiB", 30), ("MiB", 20)];
    let unit = UNITS.into_iter().find(|&(_, shift)| bytes >> shift > 0);
    unit.map_or_else(
        || format!("{bytes} bytes"),
        |(name, shift)| format!("{:.1} {name}", bytes as f64 / (1_u64 << shift) as f64),
    )
}
