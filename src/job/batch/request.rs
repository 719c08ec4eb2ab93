//! A request of a batch of frames, for any product.

use crate::{
    cache::CacheError,
    job::{RunError, memory::refuse_memory},
    preset::Frames,
};
use std::time::Duration;

/// Memory that frames in progress may take together where the user sets no limit [bytes].
///
/// Many small frames leave threads idle when meshed one by one; a large one does not, and two of them would only take
/// twice the memory. Larger, and a machine with 8 GiB swaps at voxel 0.25 with a million particles a frame; smaller, and
/// frames of 200 000 particles at voxel 0.5 go one by one, though reading and writing them runs on one thread.
pub(super) const DEFAULT_CONCURRENT_MEMORY: u64 = 1 << 30;

/// A request of a batch of frames, for any product.
#[derive(Clone, Debug)]
pub(crate) struct BatchRequest {
    /// The frames to use; `None`: all that are present.
    pub selection: Option<Frames>,
    /// Make files again that are up to date.
    pub force: bool,
    /// Memory that all frames in progress share, and that none may exceed by itself, as far as it can be estimated [bytes].
    pub max_memory: Option<u64>,
    /// Whether several frames may be in progress at once. The memory that a plan of a shot forecasts is that of one.
    pub concurrent: bool,
    /// How long to wait for a frame that another process is simulating; `None`: frames are there or fail.
    pub follow: Option<Duration>,
    /// Frames a second, where the source has no manifest.
    pub fps: f64,
}

impl BatchRequest {
    /// The memory that frames in progress share [bytes]; 0: one frame at a time.
    pub(super) fn concurrent_memory(&self) -> u64 {
        if self.concurrent { self.max_memory.unwrap_or(DEFAULT_CONCURRENT_MEMORY) } else { 0 }
    }

    /// Compares the memory that a frame needs with what was `reserved` for it [bytes]; `None`: the frame is alone. `estimate`
    /// gets a bound below which its result need not be exact.
    ///
    /// # Errors
    /// [`RunError::OverMemory`] if the frame needs more than the request allows.
    pub(crate) fn check_memory(
        &self,
        reserved: Option<u64>,
        estimate: impl FnOnce(u64) -> u64,
    ) -> Result<MemoryCheck, RunError> {
        let Some(bound) = reserved.or(self.max_memory) else {
            return Ok(MemoryCheck::Fits);
        };
        let needed = estimate(bound);
        // Alone it is checked again, so that what is refused does not depend on how many run at once.
        if reserved.is_some_and(|reserved| needed > reserved) {
            return Ok(MemoryCheck::NeedsMore);
        }
        self.max_memory.map_or(Ok(()), |limit| refuse_memory(needed, limit))?;
        Ok(MemoryCheck::Fits)
    }
}

/// What was read within the memory that was `reserved` for a frame; `None` if it takes more, so that the frame must run again,
/// alone.
///
/// # Errors
/// All others of the reader; also that it takes more memory than allowed, if the frame is alone.
pub(crate) fn within_reserve<T, E: Into<RunError>>(
    reserved: Option<u64>,
    read: Result<T, E>,
) -> Result<Option<T>, RunError> {
    match read.map_err(Into::into) {
        Err(RunError::OverMemory { .. } | RunError::Cache(CacheError::OverMemory { .. }))
            if reserved.is_some() =>
        {
            Ok(None)
        }
        read => read.map(Some),
    }
}

/// Whether a frame fits in the memory that was reserved for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MemoryCheck {
    /// The frame fits.
    Fits,
    /// The frame must run again, alone.
    NeedsMore,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_more_than_was_reserved_is_repeated_alone() {
        let over = || Err::<(), _>(RunError::OverMemory { needed: 2, allowed: 1 });
        assert_eq!(within_reserve(Some(1), over()).unwrap(), None);
        assert!(matches!(within_reserve(None, over()), Err(RunError::OverMemory { .. })));
        assert!(matches!(
            within_reserve(Some(1), Err::<(), _>(RunError::Interrupted)),
            Err(RunError::Interrupted)
        ));
        assert_eq!(within_reserve(Some(1), Ok::<_, RunError>(5)).unwrap(), Some(5));
    }

    #[test]
    fn a_frame_above_its_reserve_runs_alone_and_one_above_the_limit_is_refused() {
        let request = |max_memory| BatchRequest {
            selection: None,
            force: false,
            max_memory,
            concurrent: true,
            follow: None,
            fps: 24.0,
        };
        let free = request(None);
        assert_eq!(
            free.check_memory(None, |_| unreachable!("nothing limits it")).unwrap(),
            MemoryCheck::Fits
        );
        assert_eq!(free.check_memory(Some(10), |_| 10).unwrap(), MemoryCheck::Fits);
        assert_eq!(free.check_memory(Some(10), |_| 11).unwrap(), MemoryCheck::NeedsMore);
        let limited = request(Some(20));
        assert_eq!(limited.check_memory(Some(10), |_| 11).unwrap(), MemoryCheck::NeedsMore);
        assert_eq!(limited.check_memory(None, |_| 20).unwrap(), MemoryCheck::Fits);
        let refused = limited.check_memory(None, |_| 21);
        assert!(matches!(refused, Err(RunError::OverMemory { needed: 21, allowed: 20 })), "{refused:?}");
        assert_eq!((free.concurrent_memory(), limited.concurrent_memory()), (DEFAULT_CONCURRENT_MEMORY, 20));
        assert_eq!(
            BatchRequest { concurrent: false, ..limited }.concurrent_memory(),
            0,
            "as the plan of a shot forecasts it"
        );
    }
}
