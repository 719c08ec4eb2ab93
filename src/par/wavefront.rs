//! Work whose order matters, run as soon as that order allows.
//!
//! *Method* [gourlay17]: every item counts the predecessors it still waits for; whoever finishes an item counts
//! its successors down and feeds those that reach zero to the pool. *Departs from the paper*: the thread that
//! finishes an item goes on with the first successor it freed and feeds only the others, which spares most trips
//! through the queue; items may form any graph without cycles, not only a box.

use rayon::Scope;
use std::sync::atomic::{AtomicU32, Ordering};

/// Calls `work(i)` once for each `i` in `0..count`, for every one only after it returned for all its predecessors.
///
/// `next(i)` lists the successors of `i`, `before(i)` is the number of its predecessors. What a predecessor wrote is
/// visible to its successors.
///
/// # Panics
/// If the successors form a cycle, one is not below `count`, or the numbers do not fit them.
pub fn wavefront<I: IntoIterator<Item = usize>>(
    count: usize,
    before: impl Fn(usize) -> usize + Sync,
    next: impl Fn(usize) -> I + Sync,
    work: impl Fn(usize) + Sync,
) {
    let waits = super::map_chunks(count, super::CHUNK, |range| {
        range.map(|i| AtomicU32::new(before(i) as u32)).collect::<Vec<_>>()
    });
    let waits: Vec<AtomicU32> = waits.into_iter().flatten().collect();
    let roots: Vec<usize> = (0..count).filter(|&i| waits[i].load(Ordering::Relaxed) == 0).collect();
    let front = Front { waits: &waits, next: &next, work: &work };
    let front = &front;
    rayon::scope(|scope| {
        for root in roots {
            scope.spawn(move |scope| front.run(scope, root));
        }
    });
    assert!(
        waits.iter().all(|left| left.load(Ordering::Relaxed) == 0),
        "successors form no cycle and fit their numbers"
    );
}

struct Front<'a, N, W> {
    waits: &'a [AtomicU32],
    next: &'a N,
    work: &'a W,
}

impl<I: IntoIterator<Item = usize>, N: Fn(usize) -> I + Sync, W: Fn(usize) + Sync> Front<'_, N, W> {
    /// Does `item` and then, one after another, a successor that it freed; feeds the others to the pool.
    fn run<'scope>(&'scope self, scope: &Scope<'scope>, mut item: usize) {
        loop {
            (self.work)(item);
            let mut mine = None;
            for j in (self.next)(item) {
                if self.waits[j].fetch_sub(1, Ordering::AcqRel) != 1 {
                    continue;
                }
                if mine.is_none() {
                    mine = Some(j);
                } else {
                    scope.spawn(move |scope| self.run(scope, j));
                }
            }
            match mine {
                Some(j) => item = j,
                None => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par::with_threads;

    /// The successors of cell `i` on an n × n board: the next along each axis.
    fn board(n: usize) -> impl Fn(usize) -> Vec<usize> + Sync {
        move |i| {
            let (x, y) = (i % n, i / n);
            [(x + 1 < n).then_some(i + 1), (y + 1 < n).then_some(i + n)].into_iter().flatten().collect()
        }
    }

    #[test]
    fn everything_runs_once_and_after_its_predecessors() {
        let n = 40;
        for threads in [1, 2, 8] {
            // Counting paths modulo 2³² needs both predecessors' final values.
            let paths: Vec<AtomicU32> = (0..n * n).map(|_| AtomicU32::new(0)).collect();
            let runs = AtomicU32::new(0);
            with_threads(threads, || {
                let before = |i: usize| [i % n, i / n].into_iter().filter(|&place| place > 0).count();
                wavefront(n * n, before, board(n), |i| {
                    let of = |there: bool, j: usize| if there { paths[j].load(Ordering::Relaxed) } else { 0 };
                    let (x, y) = (i % n, i / n);
                    let sum = of(x > 0, i.wrapping_sub(1)).wrapping_add(of(y > 0, i.wrapping_sub(n)));
                    paths[i].store(if i == 0 { 1 } else { sum }, Ordering::Relaxed);
                    runs.fetch_add(1, Ordering::Relaxed);
                });
            });
            let mut expected = vec![1_u32; n * n];
            for i in 0..n * n {
                if i % n > 0 && i / n > 0 {
                    expected[i] = expected[i - 1].wrapping_add(expected[i - n]);
                }
            }
            assert_eq!(runs.into_inner() as usize, n * n);
            assert_eq!(paths.into_iter().map(AtomicU32::into_inner).collect::<Vec<_>>(), expected);
        }
    }

    #[test]
    fn nothing_to_do_is_fine() {
        wavefront(0, |_| 0, |_| [], |_| panic!("no item"));
    }

    #[test]
    #[should_panic(expected = "no cycle")]
    fn a_cycle_is_refused() {
        wavefront(3, |_| 1, |i| [(i + 1) % 3], |_| {});
    }
}
