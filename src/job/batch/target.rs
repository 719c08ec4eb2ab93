//! What files are made for.

use crate::frame::FrameIndex;

/// Identifies the files that are made of a stream of a frame.
pub(crate) struct FileTarget {
    pub(crate) index: FrameIndex,
    /// System or object that the files show; part of their names.
    pub(crate) name: String,
    /// Key of what the files were made from.
    pub(crate) key: u64,
    /// The simulated state that they are made from, where it is that of one frame.
    pub(crate) state: Option<u64>,
}
