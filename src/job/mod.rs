//! What every job shares: errors, the shot folder, reports of progress, measured cost.

pub(crate) mod batch;
mod error;
pub(crate) mod file_records;
mod folder;
pub(crate) mod log;
mod manifest;
pub(crate) mod memory;
mod report;
pub(crate) mod scratch;
mod summary;
pub(crate) mod tradeoff;
pub(crate) mod usage;

pub(crate) use error::{FailedFrame, Failure, RunError};
pub(crate) use folder::{ShotFolder, is_file_name};
pub(crate) use manifest::{FrameSpan, MAX_POSES, Manifest, OutputFiles, is_own_path};
pub(crate) use report::{Control, Reporter, Silent};
pub(crate) use report::{Progress, nonzero};
pub(crate) use summary::{Total, totals_by_key};
