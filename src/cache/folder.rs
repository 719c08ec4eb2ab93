//! The folder of a cache: names, listing, which frames belong to it.

use super::{CacheError, FrameInfo};
use crate::frame::FrameIndex;
use std::path::{Path, PathBuf};

/// The path of a frame: `frame_0001.mcf` in `dir`.
pub fn frame_path(dir: &Path, index: FrameIndex) -> PathBuf {
    dir.join(format!("frame_{index}.mcf"))
}

/// The frame number in a file's name, if it is named as [`frame_path`] names.
pub(crate) fn index_of(path: &Path) -> Option<FrameIndex> {
    let name = path.file_name()?.to_str()?;
    let digits = name.strip_prefix("frame_")?.strip_suffix(".mcf")?;
    let index = FrameIndex(digits.parse().ok()?);
    (index.to_string() == digits).then_some(index)
}

/// Every frame in `dir`, sorted by number; files with other names are not frames.
///
/// # Errors
/// [`CacheError::NotFound`] if the folder is not there or holds no frame, [`CacheError::Io`] if it cannot be
/// listed.
pub fn list(dir: &Path) -> Result<Vec<(FrameIndex, PathBuf)>, CacheError> {
    let failed = |error| CacheError::from_io(dir, "list the folder", error);
    let mut frames = Vec::new();
    for entry in std::fs::read_dir(dir).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if let Some(index) = index_of(&path) {
            frames.push((index, path));
        }
    }
    if frames.is_empty() {
        let (found, expected) = ("no frame in this folder", "frame_0001.mcf or another number");
        return Err(CacheError::NotFound { path: dir.to_path_buf(), found, expected });
    }
    frames.sort();
    Ok(frames)
}

impl FrameInfo {
    /// Refuses a frame that belongs to other settings.
    ///
    /// # Errors
    /// [`CacheError::Stale`] if the frame's key is not `key`; `path` is named in it.
    pub fn expect_key(&self, path: &Path, key: u64) -> Result<(), CacheError> {
        if self.key == key {
            return Ok(());
        }
        Err(CacheError::Stale { path: path.to_path_buf(), found: self.key, expected: key })
    }

    /// Refuses a frame whose columns take more than `max_memory` \[bytes\].
    ///
    /// # Errors
    /// [`CacheError::OverMemory`], in which `path` is named.
    pub fn expect_memory(&self, path: &Path, max_memory: Option<u64>) -> Result<(), CacheError> {
        let needed = self.unpacked_bytes();
        match max_memory.filter(|&allowed| needed > allowed) {
            Some(allowed) => Err(CacheError::OverMemory { path: path.into(), needed, allowed }),
            None => Ok(()),
        }
    }
}
