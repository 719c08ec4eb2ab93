//! Several frames at once, as far as their estimated memory allows.
//!
//! *Method*: frames in a row form groups, whose frames run beside each other on the threads that there are, each with all
//! the parallelism it has by itself. A group has at most as many frames as there are threads, and its estimated memory
//! stays within the limit; a frame that needs more than was guessed runs again alone. Results are taken in the order of
//! the frames. How groups are cut changes neither a byte nor the order of what is said.

use super::{
    Control, RunError,
    plan::{Product, most_memory},
};
use crate::{mesh::SurfaceParams, par};
use std::sync::Mutex;

/// Memory that frames under way together may take where the user sets no limit [bytes].
///
/// Many small frames leave threads idle when meshed one by one; a large one does not, and two of them would only take
/// twice the memory. Larger, and a machine with 8 GiB swaps at voxel 0.25 with a million particles a frame; smaller, and
/// frames of 200 000 particles at voxel 0.5 go one by one, though reading and writing them runs on one thread.
pub(super) const TOGETHER: u64 = 1 << 30;

/// Set aside for a frame beyond what its particles are known to take where they lie as in a splash [bytes]: a few thousand
/// particles lie as they like. Smaller, and small frames run twice, the second time alone; larger, and fewer of them run
/// at once on many threads.
const SLACK: u64 = 16 << 20;

/// A guess of the memory that making `product` of `particles` takes [bytes].
pub(super) fn cost(product: Product, particles: usize, params: &SurfaceParams) -> u64 {
    most_memory(product, particles, params).saturating_add(SLACK)
}

/// Runs `work(place, alone)` for every place of `costs`, and hands what it made to `done` in order.
///
/// `costs` are guesses of the memory each frame needs, `budget` is what frames under way share [bytes]; `work` returns `None` if one is too low and the frame is
/// not `alone`. Frames that are finished when another one ends the job, or the user does, are handed over too.
///
/// # Errors
/// The first error of `work`; [`RunError::Interrupted`] if the user stops the job.
pub(super) fn each<T: Send>(
    name: &str,
    costs: &[u64],
    budget: u64,
    control: Control,
    work: impl Fn(usize, bool) -> Option<Result<T, RunError>> + Sync,
    mut done: impl FnMut(T),
) -> Result<(), RunError> {
    control.reporter.begin(name, costs.len());
    let finished = Mutex::new(0.0);
    let run = |place: usize, alone: bool| {
        if (control.interrupted)() {
            return Some(Err(RunError::Interrupted));
        }
        let made = work(place, alone)?;
        if made.is_ok() {
            let mut finished = finished.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
            *finished += 1.0;
            control.reporter.progress(*finished);
        }
        Some(made)
    };
    let mut start = 0;
    while start < costs.len() {
        let count = group(&costs[start..], budget, par::threads());
        let mut stopped = None;
        for (offset, made) in
            par::map(count, |offset| run(start + offset, count == 1)).into_iter().enumerate()
        {
            let made = match made {
                None if stopped.is_some() => continue,
                None => run(start + offset, true).expect("alone, a frame takes what it needs"),
                Some(made) => made,
            };
            match made {
                Ok(made) => done(made),
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

/// How many of the next frames, at least one and at most `most`, fit in `budget`.
fn group(costs: &[u64], budget: u64, most: usize) -> usize {
    let mut sum = 0_u64;
    let fit = costs.iter().take(most).take_while(|&&cost| {
        sum = sum.saturating_add(cost);
        sum <= budget
    });
    fit.count().max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

    /// Remembers the progress that is told.
    #[derive(Default)]
    struct Told(Mutex<Vec<f64>>);

    impl crate::run::Reporter for Told {
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
        assert_eq!(group(&[5, 5, 5], 10, 8), 2);
        assert_eq!(group(&[5, 5, 5], 100, 2), 2);
        assert_eq!(group(&[50, 5], 10, 8), 1, "what fits nowhere runs alone");
        assert_eq!(group(&[u64::MAX, u64::MAX], u64::MAX - 1, 8), 1);
        assert_eq!(group(&[0; 9], 0, 4), 4);
    }

    #[test]
    fn memory_under_way_stays_within_the_limit_and_results_keep_their_order() {
        // Each third frame needs twice what was guessed.
        let costs: Vec<u64> = (0..40).map(|i| 10 + i % 7).collect();
        let real = |place: usize| costs[place] * if place.is_multiple_of(3) { 2 } else { 1 };
        let (under_way, most) = (AtomicU64::new(0), AtomicU64::new(0));
        let told = Told::default();
        let control = Control { reporter: &told, interrupted: &|| false };
        let mut order = Vec::new();
        par::with_threads(4, || {
            let work = |place: usize, alone: bool| {
                if !alone && real(place) > costs[place] {
                    return None;
                }
                most.fetch_max(under_way.fetch_add(real(place), SeqCst) + real(place), SeqCst);
                par::sum(10_000, |i| i as f64);
                under_way.fetch_sub(real(place), SeqCst);
                Some(Ok(place))
            };
            each("test", &costs, 35, control, work, |place| order.push(place)).unwrap();
        });
        assert_eq!(order, (0..40).collect::<Vec<_>>());
        assert!(most.load(SeqCst) <= 35, "{most:?}");
        assert_eq!(*told.0.lock().unwrap(), (1..=40).map(f64::from).collect::<Vec<_>>());
    }

    #[test]
    fn frames_that_fit_run_at_once() {
        let control = Control { reporter: &Told::default(), interrupted: &|| false };
        let entered = AtomicU64::new(0);
        let met = par::with_threads(4, || {
            // Each frame waits until all four are under way, or a minute has passed.
            let work = |_, alone: bool| {
                assert!(!alone);
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
            let mut met = Vec::new();
            each("test", &[10; 4], 40, control, work, |all| met.push(all)).unwrap();
            met
        });
        assert_eq!(met, [true; 4]);
    }

    #[test]
    fn what_was_finished_beside_the_end_is_kept() {
        let told = Told::default();
        let control = Control { reporter: &told, interrupted: &|| false };
        let mut kept = Vec::new();
        let outcome = par::with_threads(4, || {
            let work = |place: usize, _| {
                Some(if place == 5 { Err(RunError::Request("full".into())) } else { Ok(place) })
            };
            each("test", &[1; 12], TOGETHER, control, work, |place| kept.push(place))
        });
        assert!(matches!(outcome, Err(RunError::Request(_))));
        assert_eq!(kept, [0, 1, 2, 3, 4, 6, 7], "the group ran to its end, the next one did not start");
        let stop = Control { reporter: &told, interrupted: &|| true };
        let outcome = each("test", &[1; 3], TOGETHER, stop, |_, _| Some(Ok(())), |()| ());
        assert!(matches!(outcome, Err(RunError::Interrupted)));
    }
}
