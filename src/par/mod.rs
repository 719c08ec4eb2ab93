//! The only module that knows threads.
//!
//! Everything here gives the same bytes for any number of threads: work is cut into chunks of a constant
//! length, every output slot is written by exactly one chunk, and sums fold the chunks' partial results in
//! chunk order.
//!
//! Loops over chunks, parts and tasks call `run`, which is not generic: rayon's splitting and joining is then compiled once and
//! not for every loop of the crate (`docs/decisions/014-one-folder-per-system.md`). Sorts, copies and the wavefront call rayon themselves.

mod forest;
mod groups;
mod radix;
mod slots;
mod wavefront;

pub(crate) use forest::Forest;
pub(crate) use groups::Groups;
pub(crate) use radix::{Inverse, Radix};
pub use wavefront::wavefront;

use rayon::prelude::*;
use slots::Slots;
use std::{
    ops::Range,
    sync::{Mutex, PoisonError, mpsc},
};

/// Elements a chunk holds where the caller has no reason to choose otherwise.
///
/// Smaller chunks cost scheduling (at 64, a one-flop loop over 1e6 elements takes 3× longer); larger ones
/// leave threads idle at the end of short loops.
pub const CHUNK: usize = 1024;

/// Runs `job` on a pool of `threads` threads (0: one per core) and returns its result.
///
/// # Panics
/// If the operating system refuses to start the threads.
pub fn with_threads<R: Send>(threads: usize, job: impl FnOnce() -> R + Send) -> R {
    try_with_threads(threads, job).expect("the operating system starts the worker threads")
}

/// The operating system refused to start threads.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
pub struct ThreadsRefused(rayon::ThreadPoolBuildError);

/// As [`with_threads`].
///
/// # Errors
/// If the operating system refuses to start the threads, as under a limit of processes.
pub fn try_with_threads<R: Send>(
    threads: usize,
    job: impl FnOnce() -> R + Send,
) -> Result<R, ThreadsRefused> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(ThreadsRefused)?;
    Ok(pool.install(job))
}

/// Calls `f` once on every thread of the current pool, and returns when all have.
pub fn on_every_thread(f: impl Fn() + Sync) {
    rayon::broadcast(|_| f());
}

/// The number of threads that the current pool runs.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Calls `task(i)` for every `i` in `0..count`, in any order. Rayon splits them into runs of at most `max_len`;
/// `usize::MAX` leaves the splitting to it.
fn run(count: usize, max_len: usize, task: &(dyn Fn(usize) + Sync)) {
    match count {
        0 => {}
        1 => task(0),
        _ => (0..count).into_par_iter().with_max_len(max_len).for_each(task),
    }
}

/// Collects `f(i)` for `i` in `0..count`; see [`run`] for `max_len`.
fn collect<T: Send>(count: usize, max_len: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let results = Slots::empty(count);
    run(count, max_len, &|i| results.put(i, f(i)));
    results.into_values()
}

/// Calls `f(number of the input, input)` for every input and returns the results in their order.
fn map_each<A: Send, T: Send>(
    inputs: impl IntoIterator<Item = A>,
    f: impl Fn(usize, A) -> T + Sync,
) -> Vec<T> {
    let inputs = Slots::of(inputs);
    collect(inputs.len(), usize::MAX, |i| f(i, inputs.take(i)))
}

/// `count` times `value`, written by all threads. `vec![value; count]` is written by one thread, or by none if it is all zeros. Then
/// the first read of an entry before it is written stops all threads while the system maps its page a second time.
pub fn repeated<T: Copy + Send + Sync>(value: T, count: usize) -> Vec<T> {
    (0..count).into_par_iter().with_min_len(CHUNK).map(|_| value).collect()
}

/// What `values` has, copied by all threads, for the same reason.
pub fn copied<T: Copy + Send + Sync>(values: &[T]) -> Vec<T> {
    values.par_iter().with_min_len(CHUNK).copied().collect()
}

/// Writes `f(i)` into every `out[i]`.
pub fn fill<T: Send>(out: &mut [T], f: impl Fn(usize) -> T + Sync) {
    for_chunks(out, CHUNK, |start, chunk| {
        for (offset, slot) in chunk.iter_mut().enumerate() {
            *slot = f(start + offset);
        }
    });
}

/// Calls `f(i, &mut out[i])` for every element.
pub fn update<T: Send>(out: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    for_chunks(out, CHUNK, |start, chunk| {
        for (offset, slot) in chunk.iter_mut().enumerate() {
            f(start + offset, slot);
        }
    });
}

/// Cuts `out` into chunks of `len` elements and calls `f(index of the chunk's first element, chunk)`.
pub fn for_chunks<T: Send>(out: &mut [T], len: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    let chunks = Slots::of(out.chunks_mut(len));
    run(chunks.len(), usize::MAX, &|i| f(i * len, chunks.take(i)));
}

/// Does what [`for_chunks`] does with a scratch space at hand: `f(scratch, first index, chunk)`. A chunk may find
/// there what others left, so `f` must not depend on its content.
pub fn for_chunks_with<T: Send, S: Send>(
    out: &mut [T],
    len: usize,
    scratch: impl Fn() -> S + Sync,
    f: impl Fn(&mut S, usize, &mut [T]) + Sync,
) {
    let pool = Mutex::new(Vec::new());
    let lock = || pool.lock().unwrap_or_else(PoisonError::into_inner);
    for_chunks(out, len, |start, chunk| {
        // A statement of its own: the lock is released before `scratch` runs, which may be a parallel loop.
        let last = lock().pop();
        let mut scratch = last.unwrap_or_else(&scratch);
        f(&mut scratch, start, chunk);
        lock().push(scratch);
    });
}

/// Calls `f` on every range of `len` indices of `0..count` and returns the results in order of the ranges.
pub fn map_chunks<T: Send>(count: usize, len: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    collect(count.div_ceil(len), usize::MAX, |i| f(i * len..((i + 1) * len).min(count)))
}

/// Cuts slices of equal length into chunks of `len` elements, calls `f(index of the chunks' first elements, a chunk of
/// each)` and returns the results in order of the chunks.
pub fn map_chunks_mut<A: Send, T: Send, const N: usize>(
    slices: [&mut [A]; N],
    len: usize,
    f: impl Fn(usize, [&mut [A]; N]) -> T + Sync,
) -> Vec<T> {
    let count = slices.first().map_or(0, |slice| slice.len());
    assert!(slices.iter().all(|slice| slice.len() == count), "all are cut in the same places");
    let mut rest = slices.map(|slice| slice.chunks_mut(len));
    let chunks = (0..count.div_ceil(len))
        .map(|_| std::array::from_fn(|k| rest[k].next().expect("all have as many chunks")));
    map_each(chunks, |index, chunks| f(index * len, chunks))
}

/// Cuts `out` into parts that end at `ends`, which ascend to its length, and calls `f(number of the part, part)`, `len`
/// parts a task.
pub fn for_parts<T: Send>(out: &mut [T], ends: &[usize], len: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    map_parts(out, ends, len, f);
}

/// Does what [`for_parts`] does, and returns the results in order of the parts.
pub fn map_parts<T: Send, R: Send>(
    out: &mut [T],
    ends: &[usize],
    len: usize,
    f: impl Fn(usize, &mut [T]) -> R + Sync,
) -> Vec<R> {
    assert_eq!(ends.last().copied().unwrap_or(0), out.len(), "the parts are the whole");
    let (mut rest, mut start) = (out, 0);
    let mut tasks = Vec::with_capacity(ends.len().div_ceil(len));
    for ends in ends.chunks(len) {
        let end = ends.last().copied().unwrap_or(start);
        let (part, after) = rest.split_at_mut(end - start);
        tasks.push((start, ends, part));
        (rest, start) = (after, end);
    }
    let task = |task: usize, (mut start, ends, mut rest): (usize, &[usize], &mut [T])| {
        let mut results = Vec::with_capacity(ends.len());
        for (part, &end) in (task * len..).zip(ends) {
            let (now, after) = std::mem::take(&mut rest).split_at_mut(end - start);
            results.push(f(part, now));
            (rest, start) = (after, end);
        }
        results
    };
    map_each(tasks, task).into_iter().flatten().collect()
}

/// Sorts `keys`. Equal keys are interchangeable, so the result does not depend on the threads.
pub fn sort(keys: &mut [u128]) {
    keys.par_sort_unstable();
}

/// Collects `f(i)` for `i` in `0..count`, one task an index: for few, large tasks.
pub fn map<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    collect(count, 1, f)
}

/// Σ f(i) over `0..count` in double precision, folded in a fixed order.
pub fn sum(count: usize, f: impl Fn(usize) -> f64 + Sync) -> f64 {
    map_chunks(count, CHUNK, |range| range.map(&f).sum::<f64>()).into_iter().sum()
}

/// The largest f(i) over `0..count` and the lowest index that reaches it; `None` if `count` is 0.
///
/// A NaN counts as larger than any number, so that a maximum never hides one.
pub fn max(count: usize, f: impl Fn(usize) -> f32 + Sync) -> Option<(usize, f32)> {
    let larger = |best: (usize, f32), next: (usize, f32)| {
        if next.1 > best.1 || (next.1.is_nan() && !best.1.is_nan()) { next } else { best }
    };
    map_chunks(count, CHUNK, |range| range.map(|i| (i, f(i))).reduce(larger).expect("chunks are not empty"))
        .into_iter()
        .reduce(larger)
}

/// Sorts by a key. Elements of equal key may change places, so give those that differ different keys.
pub fn sort_by_key<T: Send, K: Ord>(values: &mut [T], key: impl Fn(&T) -> K + Sync) {
    values.par_sort_unstable_by_key(key);
}

/// Runs two jobs, on two threads where there are two.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Runs `work`; when this calls what it is given, `job` runs on a thread of its own that is no worker, at the same time: for a job that waits
/// for the system more than it computes. A call while another waits is the same call. Without a further thread, or after a failure,
/// calls do nothing.
///
/// Returns what `work` gave and, once the last job has ended, whether one failed.
pub fn aside<R, E: Send>(
    job: impl Fn() -> Result<(), E> + Sync,
    work: impl FnOnce(&mut (dyn FnMut() + Send)) -> R,
) -> (R, Result<(), E>) {
    let job = &job;
    std::thread::scope(|scope| {
        let (mut calls, mut thread) = (None, None);
        let mut call = || {
            let calls = calls.get_or_insert_with(|| {
                let (calls, called) = mpsc::sync_channel(1);
                let run = move || called.into_iter().try_for_each(|()| job());
                thread = std::thread::Builder::new().spawn_scoped(scope, run).ok();
                calls
            });
            // It fails if a call is already waiting, or if there is no receiver: both are documented above.
            let _ = calls.try_send(());
        };
        let result = work(&mut call);
        drop(calls);
        let ended = thread
            .map_or(Ok(()), |thread| thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        (result, ended)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::Ordering::Relaxed;

    #[test]
    fn a_job_aside_ends_with_the_work_and_reports_its_failure() {
        let done = std::sync::atomic::AtomicUsize::new(0);
        let count = |limit: usize| {
            let job = || if done.fetch_add(1, Relaxed) < limit { Ok(()) } else { Err("too many") };
            aside(job, |call| (0..500).for_each(|_| call()))
        };
        assert_eq!(count(usize::MAX), ((), Ok(())));
        assert!((1..=500).contains(&done.load(Relaxed)), "calls that wait are one");
        assert_eq!(count(0), ((), Err("too many")));
        let before = done.load(Relaxed);
        assert_eq!(aside(|| Err(done.fetch_add(1, Relaxed)), |_| 7), (7, Ok(())), "no call");
        assert_eq!(done.load(Relaxed), before);
    }

    #[test]
    fn sums_have_the_same_bits_on_any_number_of_threads() {
        let value = |i: usize| 1.0 / (i as f64 + 0.1);
        let one = with_threads(1, || sum(100_003, value));
        for threads in [2, 3, 8] {
            assert_eq!(one.to_bits(), with_threads(threads, || sum(100_003, value)).to_bits());
        }
    }

    #[test]
    fn max_reports_the_first_of_equals_and_never_hides_a_nan() {
        let values = [1.0, 7.0, 7.0, 3.0];
        assert_eq!(max(4, |i| values[i]), Some((1, 7.0)));
        assert_eq!(max(0, |_| 0.0), None);
        let (index, value) = max(5000, |i| if i == 4321 { f32::NAN } else { i as f32 }).unwrap();
        assert!(index == 4321 && value.is_nan());
    }

    #[test]
    fn slices_are_cut_in_the_same_places_and_results_keep_their_order() {
        let (mut a, mut b) = (vec![0_usize; 2500], vec![0_usize; 2500]);
        let firsts = map_chunks_mut([&mut a, &mut b], 1000, |start, [a, b]| {
            for (offset, (a, b)) in a.iter_mut().zip(b).enumerate() {
                (*a, *b) = (start + offset, 2 * (start + offset));
            }
            start
        });
        assert_eq!(firsts, [0, 1000, 2000]);
        assert!((0..2500).all(|i| a[i] == i && b[i] == 2 * i));
    }

    #[test]
    fn parts_of_any_length_are_called_once() {
        let ends = [3, 3, 10, 11, 40, 40, 100];
        for len in [1, 2, 5, 100] {
            let mut out = vec![0; 100];
            let parts = map_parts(&mut out, &ends, len, |part, slots| {
                slots.iter_mut().for_each(|slot| *slot += part + 1);
                part
            });
            assert_eq!(parts, [0, 1, 2, 3, 4, 5, 6]);
            assert!((0..100).all(|i| out[i] == ends.iter().position(|&end| i < end).unwrap() + 1), "{len}");
        }
        for_parts(&mut [0_u8; 0], &[], 4, |_, _| unreachable!("no parts"));
    }

    #[test]
    fn loops_nest_and_keep_the_order_of_their_results() {
        for threads in [1, 3] {
            let sums = with_threads(threads, || {
                map(20, |k| {
                    let mut out = vec![0; 100];
                    // A scratch space may hold what another chunk has left there.
                    let scratch = || map(3, |_| usize::MAX);
                    for_chunks_with(&mut out, 7, scratch, |scratch, start, chunk| {
                        scratch.fill(k);
                        chunk.iter_mut().enumerate().for_each(|(i, slot)| *slot = scratch[0] * (start + i));
                    });
                    out.into_iter().sum::<usize>()
                })
            });
            assert!(sums.iter().enumerate().all(|(k, &sum)| sum == k * 4950), "{threads} threads: {sums:?}");
        }
    }

    #[test]
    fn a_panic_in_a_task_reaches_the_caller() {
        for threads in [1, 3] {
            let run = || with_threads(threads, || map(50, |i| assert!(i != 33, "task {i}")));
            let panic = std::panic::catch_unwind(run).expect_err("task 33 panics");
            assert_eq!(panic.downcast_ref::<String>().map(String::as_str), Some("task 33"));
        }
    }

    #[test]
    fn sort_sorts() {
        let mut keys: Vec<u128> = (0..5000).map(|i| (i * 7919) % 5000).collect();
        sort(&mut keys);
        assert!(keys.iter().enumerate().all(|(i, &key)| key == i as u128));
    }

    #[test]
    fn fill_and_update_touch_every_element_once() {
        let mut out = vec![0_usize; 5000];
        fill(&mut out, |i| i);
        update(&mut out, |i, slot| *slot += i);
        assert!(out.iter().enumerate().all(|(i, &value)| value == 2 * i));
    }
}
