//! The folder of whitewater.

use crate::job::batch::{BatchSummary, ProductFolder};

/// Points of spray, foam and bubbles, as jobs see them.
pub(in crate::product) struct WhitewaterPoints;

impl ProductFolder for WhitewaterPoints {
    fn name(&self) -> &'static str {
        "whitewater"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} frames of whitewater written ({mib:.1} MiB), {kept} up to date")
    }
}
