//! Frames on disk: a folder of `frame_0001.mcf` files that can be trusted.
//!
//! A frame is written to a temporary name, synced and renamed (`atomic.rs`), so a file with its final name is whole.
//! Every byte is covered by a checksum, and every length is checked before memory is taken. A reader refuses damaged bytes with a
//! [`CacheError`] that names place, finding, expectation and the next step. `docs/formats/cache.md` documents the container.
//!
//! The *key* of a frame is a hash of everything that decided its content (the preset, earlier edits); a frame
//! with another key is [`CacheError::Stale`].

mod atomic;
mod chunks;
#[cfg(any(test, feature = "fuzzing"))]
mod crafted;
mod error;
mod folder;
mod format;
mod keys;
mod lock;
mod open;
mod read;
mod samples;
mod write;

#[cfg(test)]
mod tests;

pub use atomic::WrittenFile;
pub(crate) use atomic::{remove_temporaries, write_atomically};
#[cfg(all(feature = "cli", any(test, feature = "fuzzing")))]
pub(crate) use crafted::{decode_frame, decode_samples, seal_frame, seal_samples, verify_bytes};
pub use error::CacheError;
pub(crate) use error::is_full;
pub(crate) use folder::index_of;
pub use folder::{frame_path, list};
pub use format::{ChannelInfo, ChannelKind, FORMAT_VERSION, FrameInfo, StreamInfo};
pub use keys::FrameKeys;
pub use lock::Lock;
pub(crate) use lock::{Arrival, Patience, await_file};
pub(crate) use open::{
    checksum, create_own_folder, leads_out, open_regular, open_to_append, read_bytes, read_regular,
    read_text, read_text_within,
};
pub(crate) use read::read_streams;
pub use read::{read_frame, read_frame_within, read_header, verify_frame};
pub(crate) use samples::{read_samples, samples_path, write_samples};
pub(crate) use write::prepare_frame;
pub use write::write_frame;
