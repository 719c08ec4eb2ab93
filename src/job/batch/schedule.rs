//! Several frames at once, as far as their estimated memory allows.
//!
//! *Method*: consecutive frames form groups, whose frames run concurrently, each with all the parallelism that it has by
//! itself. A group has at most as many frames as there are threads, and its estimated memory stays within the limit; a
//! frame that needs more than its estimate runs again alone. Results are taken in the order of the frames. How groups are
//! formed changes neither a byte nor the order of the reports.

use crate::{
    job::{Control, RunError},
    par,
};
use std::sync::Mutex;

/// Memory reserved for a frame beyond the estimate for particles that are spread as in a splash [bytes]: a few thousand
/// particles may be spread in any way. Smaller, and small frames run twice, the second time alone; larger, and fewer of
/// them run at once on many threads.
pub(crate) const FRAME_MEMORY_RESERVE: u64 = 16 << 20;

/// The frames of a batch, as they come.
pub(super) trait Queue: Sync {
    /// The number of frames.
    fn len(&self) -> usize;

    /// Waits until the frame at `place` is there, and returns how many are from there on without a gap: 1 to `max`.
    ///
    /// # Errors
    /// If it does not come.
    fn arrived(&self, place: usize, max: usize) -> Result<usize, RunError>;

    /// The memory that a frame which is there needs [bytes].
    fn estimate(&self, place: usize) -> u64;
}

/// Runs `work(place, estimate)` for every place of `queue`, and passes its results to `done` in order.
///
/// Frames in progress share `budget` [bytes]; `work` gets the estimate of a frame that is not alone, and returns `None` if it needs
/// more. If another frame or the user ends the batch, the results of finished frames are still passed.
///
/// # Errors
/// The first error of `work` and `queue`; [`RunError::Interrupted`] if the user stops the batch.
pub(super) fn run<T: Send>(
    name: &str,
    queue: &dyn Queue,
    budget: u64,
    control: Control,
    work: impl Fn(usize, Option<u64>) -> Option<Result<T, RunError>> + Sync,
    mut done: impl FnMut(T),
) -> Result<(), RunError> {
    control.reporter.begin(name, queue.len());
    let finished = Mutex::new(0.0);
    let attempt = |place: usize, reserved: Option<u64>| {
        if control.cancel.is_cancelled() {
            return Some(Err(RunError::Interrupted));
        }
        let result = work(place, reserved)?;
        if result.is_ok() {
            let mut finished = finished.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *finished += 1.0;
            control.reporter.progress(*finished);
        }
        Some(result)
    };
    let mut start = 0;
    while start < queue.len() {
        let arrived = queue.arrived(start, par::threads().min(queue.len() - start))?;
        let estimates: Vec<u64> = (start..start + arrived).map(|place| queue.estimate(place)).collect();
        let count = group_size(&estimates, budget, arrived);
        let group = |offset: usize| attempt(start + offset, (count > 1).then(|| estimates[offset]));
        let mut stopped = None;
        for (offset, result) in par::map(count, group).into_iter().enumerate() {
            let result = match result {
                None if stopped.is_some() => continue,
                None => attempt(start + offset, None).expect("alone, a frame has all the memory"),
                Some(result) => result,
            };
            match result {
                Ok(result) => done(result),
                Err(why) => stopped = stopped.or(Some(why)),
            }
        }
        if let Some(why) = stopped {
            return Err(why);
        }
        start += count;
    }
    control.reporter.end();
    Ok(())
}

/// The number of the next frames, from one to `max`, that fit in `budget` together.
fn group_size(estimates: &[u64], budget: u64, max: usize) -> usize {
    let mut sum = 0_u64;
    let fitting = estimates.iter().take(max).take_while(|&&estimate| {
        sum = sum.saturating_add(estimate);
        sum <= budget
    });
    fitting.count().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::CancelToken;
    use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

    impl Queue for Vec<u64> {
        fn len(&self) -> usize {
            Self::len(self)
        }
        fn arrived(&self, _: usize, max: usize) -> Result<usize, RunError> {
            Ok(max)
        }
        fn estimate(&self, place: usize) -> u64 {
            self[place]
        }
    }

    /// Frames of which each arrives when the one before is done, up to a last one.
    struct OneByOne {
        last: usize,
    }

    impl Queue for OneByOne {
        fn len(&self) -> usize {
            10
        }
        fn arrived(&self, place: usize, _: usize) -> Result<usize, RunError> {
            if place > self.last { Err(RunError::Request("ended".into())) } else { Ok(1) }
        }
        fn estimate(&self, place: usize) -> u64 {
            assert!(place <= self.last, "only what is there can be estimated");
            1
        }
    }

    #[test]
    fn frames_that_came_before_the_end_of_a_simulation_are_made() {
        let (reporter, cancel) = (Progress::default(), CancelToken::new());
        let control = Control::new(&reporter, &cancel);
        let mut made = Vec::new();
        let work = |place, reserved: Option<u64>| {
            assert_eq!(reserved, None, "alone");
            Some(Ok(place))
        };
        let outcome = run("test", &OneByOne { last: 6 }, 100, control, work, |place| made.push(place));
        assert!(matches!(outcome, Err(RunError::Request(why)) if why == "ended"));
        assert_eq!(made, [0, 1, 2, 3, 4, 5, 6]);
    }

    /// Keeps the progress that is reported.
    #[derive(Default)]
    struct Progress(Mutex<Vec<f64>>);

    impl crate::job::Reporter for Progress {
        fn begin(&self, _job: &str, _frames: usize) {}
        fn progress(&self, frames_done: f64) {
            self.0.lock().unwrap().push(frames_done);
        }
        fn frame(&self, _figures: &str) {}
        fn note(&self, _text: &str) {}
        fn end(&self) {}
        fn stop(&self) {}
    }

    #[test]
    fn groups_keep_within_memory_and_threads() {
        assert_eq!(group_size(&[5, 5, 5], 10, 8), 2);
        assert_eq!(group_size(&[5, 5, 5], 100, 2), 2);
        assert_eq!(group_size(&[50, 5], 10, 8), 1, "a frame above the budget runs alone");
        assert_eq!(group_size(&[u64::MAX, u64::MAX], u64::MAX - 1, 8), 1);
        assert_eq!(group_size(&[0; 9], 0, 4), 4);
    }

    #[test]
    fn memory_in_progress_stays_within_the_limit_and_results_keep_their_order() {
        // Each third frame needs twice its estimate.
        let estimates: Vec<u64> = (0..40).map(|i| 10 + i % 7).collect();
        let needed = |place: usize| estimates[place] * if place.is_multiple_of(3) { 2 } else { 1 };
        let (in_progress, peak) = (AtomicU64::new(0), AtomicU64::new(0));
        let reporter = Progress::default();
        let cancel = CancelToken::new();
        let control = Control::new(&reporter, &cancel);
        let mut order = Vec::new();
        par::with_threads(4, || {
            let work = |place: usize, reserved: Option<u64>| {
                if reserved.is_some_and(|reserved| needed(place) > reserved) {
                    return None;
                }
                peak.fetch_max(in_progress.fetch_add(needed(place), SeqCst) + needed(place), SeqCst);
                par::sum(10_000, |i| i as f64);
                in_progress.fetch_sub(needed(place), SeqCst);
                Some(Ok(place))
            };
            run("test", &estimates, 35, control, work, |place| order.push(place)).unwrap();
        });
        assert_eq!(order, (0..40).collect::<Vec<_>>());
        assert!(peak.load(SeqCst) <= 35, "{peak:?}");
        assert_eq!(*reporter.0.lock().unwrap(), (1..=40).map(f64::from).collect::<Vec<_>>());
    }

    #[test]
    fn frames_that_fit_run_at_once() {
        let (reporter, cancel) = (Progress::default(), CancelToken::new());
        let control = Control::new(&reporter, &cancel);
        let entered = AtomicU64::new(0);
        let all_entered = par::with_threads(4, || {
            // Each frame waits until all four are in progress, or a minute has passed.
            let work = |_, reserved: Option<u64>| {
                assert!(reserved.is_some(), "not alone");
                entered.fetch_add(1, SeqCst);
                let start = std::time::Instant::now();
                while start.elapsed().as_secs() < 60 {
                    if entered.load(SeqCst) == 4 {
                        return Some(Ok(true));
                    }
                    std::hint::spin_loop();
                }
                Some(Ok(false))
            };
            let mut all_entered = Vec::new();
            run("test", &vec![10; 4], 40, control, work, |all| all_entered.push(all)).unwrap();
            all_entered
        });
        assert_eq!(all_entered, [true; 4]);
    }

    #[test]
    fn frames_finished_in_the_group_of_an_error_are_kept() {
        let reporter = Progress::default();
        let cancel = CancelToken::new();
        let control = Control::new(&reporter, &cancel);
        let mut kept = Vec::new();
        let outcome = par::with_threads(4, || {
            let work = |place: usize, _| {
                Some(if place == 5 { Err(RunError::Request("full".into())) } else { Ok(place) })
            };
            run("test", &vec![1; 12], u64::MAX, control, work, |place| kept.push(place))
        });
        assert!(matches!(outcome, Err(RunError::Request(_))));
        assert_eq!(kept, [0, 1, 2, 3, 4, 6, 7], "the group ran to its end, the next one did not start");
        let cancel = CancelToken::new();
        cancel.cancel();
        let stop = Control::new(&reporter, &cancel);
        let outcome = run("test", &vec![1; 3], u64::MAX, stop, |_, _| Some(Ok(())), |()| ());
        assert!(matches!(outcome, Err(RunError::Interrupted)));
    }
}
