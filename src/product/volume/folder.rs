//! The folder of volume files.

use crate::job::batch::{BatchSummary, ProductFolder};

/// The volume file, as jobs see it.
pub(in crate::product) struct VolumeFile;

impl ProductFolder for VolumeFile {
    fn name(&self) -> &'static str {
        "volume"
    }

    fn summary(&self, batch: &BatchSummary) -> String {
        let BatchSummary { folder, made, kept, .. } = batch;
        let (folder, mib) = (folder.display(), batch.mebibytes());
        format!("{folder}: {made} volumes written ({mib:.1} MiB), {kept} up to date")
    }
}
