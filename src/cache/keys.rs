//! Which key each frame of a cache has to have: that of its simulation, or of the one that it branched from.

use super::{CacheError, FrameInfo};
use crate::frame::FrameIndex;
use std::path::Path;

/// The keys of a cache's frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameKeys {
    own: u64,
    /// First frames of branches, ascending, and the keys of the frames before each.
    inherited: Vec<(FrameIndex, u64)>,
}

impl FrameKeys {
    /// Keys of frames of a simulation with the key `own`; for each `(first, key)` of `inherited`, which ascend, frames before `first` are
    /// of the simulation `key`.
    pub fn new(own: u64, inherited: Vec<(FrameIndex, u64)>) -> Self {
        Self { own, inherited }
    }

    /// The key of the simulation itself.
    pub fn own(&self) -> u64 {
        self.own
    }

    /// The key that a frame has to have.
    pub fn of(&self, index: FrameIndex) -> u64 {
        let before = self.inherited.partition_point(|(first, _)| *first <= index);
        self.inherited.get(before).map_or(self.own, |(_, key)| *key)
    }

    /// Refuses a frame of other settings.
    ///
    /// # Errors
    /// [`CacheError::Stale`], in which `path` is named.
    pub fn expect(&self, info: &FrameInfo, path: &Path) -> Result<(), CacheError> {
        info.expect_key(path, self.of(info.index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_before_a_branch_have_the_key_of_what_it_branched_from() {
        let keys = FrameKeys::new(3, vec![(FrameIndex(10), 1), (FrameIndex(20), 2)]);
        let found = [1, 9, 10, 19, 20, 500].map(|index| keys.of(FrameIndex(index)));
        assert_eq!((found, keys.own()), ([1, 1, 2, 2, 3, 3], 3));
        assert_eq!(FrameKeys::new(7, Vec::new()).of(FrameIndex(1)), 7);
    }
}
