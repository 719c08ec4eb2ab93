//! The folder of a cache: names, listing, where to resume.

use super::{CacheError, FrameInfo, read_frame, read_header};
use crate::frame::{Frame, FrameIndex};
use std::path::{Path, PathBuf};

/// The path of a frame: `frame_0001.mcf` in `dir`.
pub fn frame_path(dir: &Path, index: FrameIndex) -> PathBuf {
    dir.join(format!("frame_{index}.mcf"))
}

/// The frame number that a file's name says, if it is named as [`frame_path`] names.
pub(super) fn index_of(path: &Path) -> Option<FrameIndex> {
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

/// Where a simulation can resume.
#[derive(Debug)]
pub struct LastValid {
    /// The newest frame that can be trusted; `None` if there is none.
    pub frame: Option<(Frame, FrameInfo)>,
    /// Newer frames, from the newest down, that are corrupt, stale or of another version, and why.
    pub refused: Vec<(FrameIndex, CacheError)>,
}

/// The newest frame with a number up to `up_to` that verifies and has this key, already read.
///
/// A folder that is not there or holds no frame has none. Frames older than the one returned are not looked at.
///
/// # Errors
/// [`CacheError::Io`] if the system refuses: such a frame may be sound, so nothing is concluded about it.
pub fn last_valid(dir: &Path, key: u64, up_to: FrameIndex) -> Result<LastValid, CacheError> {
    let mut found = LastValid { frame: None, refused: Vec::new() };
    let frames = match list(dir) {
        Err(CacheError::NotFound { .. }) => return Ok(found),
        listed => listed?,
    };
    for (index, path) in frames.into_iter().rev().filter(|&(index, _)| index <= up_to) {
        match read_if_current(&path, key) {
            Ok(frame) => {
                found.frame = Some(frame);
                break;
            }
            Err(error @ (CacheError::Io { .. } | CacheError::Full { .. })) => return Err(error),
            Err(error) => found.refused.push((index, error)),
        }
    }
    Ok(found)
}

/// Reads a frame unless its key is another.
fn read_if_current(path: &Path, key: u64) -> Result<(Frame, FrameInfo), CacheError> {
    read_header(path)?.expect_key(path, key)?;
    read_frame(path)
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
}
