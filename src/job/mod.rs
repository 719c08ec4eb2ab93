//! What every job shares: errors, the shot folder, reports of progress, measured cost.

mod error;
mod folder;
mod report;
pub(crate) mod scratch;
pub(crate) mod usage;

pub use error::{FailedFrame, Failure, RunError};
pub use folder::ShotFolder;
pub use report::{Control, Reporter};
