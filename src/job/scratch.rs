//! A folder for what a job writes only to see how large it is.

use super::{RunError, ShotFolder};
use std::{
    path::PathBuf,
    sync::atomic::{AtomicU32, Ordering},
};

/// A folder in the system's place for temporary files, removed when dropped.
#[derive(Debug)]
pub(crate) struct Scratch {
    path: PathBuf,
}

impl Scratch {
    /// Makes a scratch folder that no other process uses.
    ///
    /// # Errors
    /// If it cannot be made.
    pub(crate) fn new() -> Result<Self, RunError> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("meniscus-{}-{number}", std::process::id()));
        ShotFolder::create(&path)?;
        Ok(Self { path })
    }

    /// A shot folder in it, with an empty cache.
    ///
    /// # Errors
    /// If the cache cannot be made.
    pub(crate) fn shot(&self) -> Result<ShotFolder, RunError> {
        let shot = ShotFolder::new(&self.path);
        ShotFolder::create(&shot.cache())?;
        Ok(shot)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // What cannot be removed is left to the system, which clears its temporary files.
        let _ = std::fs::remove_dir_all(&self.path);
    }
}
