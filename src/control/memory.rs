//! What memory is being used for: the frames under way, and allocations that may fail.

use std::{
    cell::Cell,
    sync::atomic::{AtomicU64, Ordering},
};

/// Maximum number of frames at once: as many as there may be threads.
const MAX_UNDER_WAY: usize = 1024;

/// Frames that are being computed or made, each as its number plus one; zero is a free place.
static UNDER_WAY: [AtomicU64; MAX_UNDER_WAY] = [const { AtomicU64::new(0) }; MAX_UNDER_WAY];

/// A frame that is under way until this is dropped.
#[derive(Debug)]
pub(crate) struct UnderWay {
    place: Option<usize>,
}

impl UnderWay {
    /// Notes that the frame of this number is being computed or made.
    pub(crate) fn new(frame: u32) -> Self {
        let entry = u64::from(frame) + 1;
        let is_taken = |place: &AtomicU64| {
            place.compare_exchange(0, entry, Ordering::Relaxed, Ordering::Relaxed).is_ok()
        };
        Self { place: UNDER_WAY.iter().position(is_taken) }
    }
}

impl Drop for UnderWay {
    fn drop(&mut self) {
        if let Some(place) = self.place {
            UNDER_WAY[place].store(0, Ordering::Relaxed);
        }
    }
}

/// The numbers of the frames that are being computed or made, in no order. Allocates nothing.
pub(crate) fn frames_under_way() -> impl Iterator<Item = u64> {
    UNDER_WAY.iter().filter_map(|place| place.load(Ordering::Relaxed).checked_sub(1))
}

thread_local! {
    static MAY_FAIL: Cell<bool> = const { Cell::new(false) };
}

/// Runs `allocate`, which deals with memory that is refused. Anywhere else the program ends when memory is refused.
pub(crate) fn fallible<T>(allocate: impl FnOnce() -> T) -> T {
    /// Also where `allocate` panics.
    struct Restore(bool);
    impl Drop for Restore {
        fn drop(&mut self) {
            MAY_FAIL.set(self.0);
        }
    }
    let _restore = Restore(MAY_FAIL.replace(true));
    allocate()
}

/// Whether this thread is in [`fallible`].
pub(crate) fn may_fail() -> bool {
    MAY_FAIL.get()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_under_way_until_they_are_done() {
        // Numbers that no other test of this process has.
        let is_named = |number: u64| frames_under_way().any(|frame| frame == number);
        let (first, second) = (UnderWay::new(u32::MAX), UnderWay::new(u32::MAX - 1));
        assert!(is_named(u64::from(u32::MAX)) && is_named(u64::from(u32::MAX) - 1));
        drop(first);
        assert!(!is_named(u64::from(u32::MAX)) && is_named(u64::from(u32::MAX) - 1));
        drop(second);
        assert!(!is_named(u64::from(u32::MAX) - 1));
    }

    #[test]
    fn only_what_runs_inside_may_fail() {
        assert!(!may_fail());
        assert!(fallible(|| fallible(may_fail) && may_fail()));
        assert!(!may_fail());
        assert!(std::panic::catch_unwind(|| fallible(|| panic!("planted"))).is_err());
        assert!(!may_fail());
    }
}
