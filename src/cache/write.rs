//! Writing a frame.

use super::chunks::{Seal, pack, words};
use super::format::{CHUNK_ENTRIES, ChannelKind, TRAILER, head_bytes, trailer_bytes};
use super::{
    CacheError,
    atomic::{PreparedFile, prepare},
    frame_path,
};
use crate::frame::{ChannelData, Frame};
use crate::par;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Chunks packed at once: bounds the memory to 64 × 768 KiB however long the column is, and is work enough for
/// 64 threads.
const BATCH: usize = 64;

/// Writes `frame` into the folder `dir`, whole or not at all, and returns the size of the file \[bytes\].
///
/// The bytes depend on the frame, the key and the version of the tool alone, not on the number of threads.
///
/// # Errors
/// [`CacheError::Full`] if the disk is full, [`CacheError::NotFound`] if the folder is not there, else
/// [`CacheError::Io`]. No partial file is left.
///
/// # Panics
/// If two streams of the frame share a name.
pub fn write_frame(dir: &Path, frame: &Frame, key: u64) -> Result<u64, CacheError> {
    prepare_frame(dir, frame, key)?.commit()
}

/// A frame whose bytes are on the disk, under a temporary name. It is removed on drop unless it was committed.
pub(crate) struct PreparedFrame {
    path: PathBuf,
    file: PreparedFile,
}

/// Writes `frame` as [`write_frame`], but under a temporary name.
///
/// # Errors
/// As [`write_frame`].
///
/// # Panics
/// As [`write_frame`].
pub(crate) fn prepare_frame(dir: &Path, frame: &Frame, key: u64) -> Result<PreparedFrame, CacheError> {
    write_through(frame_path(dir, frame.index), |out| encode(out, frame, key))
}

/// Writes a file through `write` and sorts out what went wrong.
pub(super) fn write_through(
    path: PathBuf,
    write: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>,
) -> Result<PreparedFrame, CacheError> {
    let file = prepare(&path, write).map_err(|error| CacheError::from_io(&path, DOING, error))?;
    Ok(PreparedFrame { path, file })
}

/// What fails, in messages.
const DOING: &str = "write the frame";

impl PreparedFrame {
    /// The size of the file [bytes].
    pub(crate) fn bytes(&self) -> u64 {
        self.file.written().bytes
    }

    /// Gives the frame its name, and returns the size of the file [bytes].
    ///
    /// # Errors
    /// As [`write_frame`].
    pub(crate) fn commit(self) -> Result<u64, CacheError> {
        let written = self.file.commit();
        written.map(|written| written.bytes).map_err(|error| CacheError::from_io(&self.path, DOING, error))
    }
}

/// Writes the container.
pub(super) fn encode(out: &mut dyn Write, frame: &Frame, key: u64) -> io::Result<()> {
    let (head, checksum) = head_bytes(frame, key);
    out.write_all(&head)?;
    let mut length = head.len() as u64;
    let mut seal = Seal::new(checksum);
    for stream in &frame.streams {
        for channel in stream.channels() {
            length += encode_column(out, &channel.data, &mut seal)?;
        }
    }
    out.write_all(&trailer_bytes(length + TRAILER as u64, seal.finish()))
}

/// Writes a column chunk by chunk and returns its bytes.
fn encode_column(out: &mut dyn Write, data: &ChannelData, seal: &mut Seal) -> io::Result<u64> {
    let in_entry = ChannelKind::of(data).words();
    let chunks: Vec<&[u32]> = words(data).chunks(CHUNK_ENTRIES as usize * in_entry).collect();
    let mut length = 0;
    for batch in chunks.chunks(BATCH) {
        for packed in par::map(batch.len(), |i| pack(batch[i], in_entry)) {
            let (stored, checksum) = packed?;
            let stored_length = u32::try_from(stored.len()).expect("a packed chunk is shorter than 4 GiB");
            let head = [&stored_length.to_le_bytes()[..], &checksum.to_le_bytes()].concat();
            seal.add(&head);
            out.write_all(&head)?;
            out.write_all(&stored)?;
            length += (head.len() + stored.len()) as u64;
        }
    }
    Ok(length)
}
