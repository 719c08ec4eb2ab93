//! What every job shares: errors, the shot folder, reports of progress, measured cost.

pub mod batch;
mod error;
mod folder;
pub(crate) mod log;
mod manifest;
pub(crate) mod memory;
mod report;
pub(crate) mod scratch;
mod summary;
pub(crate) mod tradeoff;
pub(crate) mod usage;

pub use error::{FailedFrame, Failure, RunError};
pub use folder::ShotFolder;
pub use manifest::{FrameSpan, Manifest, OutputFiles};
pub use report::{Control, Reporter, Silent};
pub(crate) use report::{Progress, nonzero};
pub use summary::Total;
