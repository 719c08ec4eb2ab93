//! Batches of frames: what every product does with the frames of a cache or of a sequence of files.
//!
//! *Method*: the requested frames are chosen, gaps reported, and the memory of each is estimated ([`Source`]). Several at
//! once (`schedule`), frames are read, skipped where their files are up to date, unpacked, checked against the memory
//! limit, and written (`streams`). A frame that cannot be made is left out and reported at the end (`ledger`).

mod follow;
mod frames;
mod ledger;
mod request;
mod schedule;
mod source;
mod streams;
mod target;

pub(crate) use follow::{await_frame, await_shot_file};
pub(crate) use frames::{FrameBatch, process_frames};
pub(crate) use ledger::{BatchSummary, no_locks};
pub(crate) use ledger::{FrameFiles, FrameOutcome, Ledger, ProductFolder, Written};
pub(crate) use request::BatchRequest;
pub(crate) use request::{MemoryCheck, within_reserve};
#[cfg(test)]
pub(crate) use schedule::FRAME_MEMORY_RESERVE;
pub(crate) use source::Source;
pub(crate) use source::{
    MAX_FRAMES, NO_FILE, RequestedFrame, StreamHeader, choose, file_size, numbered_files, state_key,
};
pub(crate) use streams::{StreamInput, StreamWriter, process_streams};
pub(crate) use target::FileTarget;
