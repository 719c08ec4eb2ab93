//! Connected components, by many threads at once.
//!
//! *Method*: union-find. Every element points to itself or to a lower one. Two are joined by pointing the higher of their roots to
//! the lower, if it is still a root then; otherwise the roots are searched again. Paths are halved during the search. The root
//! of a component ends up as its lowest member in any order of the joins, so the result does not depend on the threads.
//!
//! Relaxed atomics suffice: a root is joined by an exchange that fails if it is no root any more, no element becomes a root
//! again, and halving points an element to one of its ancestors.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Things that are joined, numbered from 0.
#[derive(Debug)]
pub(crate) struct Forest(Vec<AtomicU32>);

impl Forest {
    /// `count` things, fewer than 2³², each by itself.
    pub(crate) fn new(count: usize) -> Self {
        assert!(u32::try_from(count).is_ok(), "fewer than 2³² things");
        Self((0..count as u32).map(AtomicU32::new).collect())
    }

    /// Joins what `a` and `b` belong to.
    pub(crate) fn join(&self, a: u32, b: u32) {
        let (mut a, mut b) = (self.root(a), self.root(b));
        while a != b {
            let (low, high) = (a.min(b), a.max(b));
            // The lower root stays, which keeps the paths short where things are numbered along what joins them.
            match self.0[high as usize].compare_exchange(high, low, Relaxed, Relaxed) {
                Ok(_) => return,
                Err(_) => (a, b) = (self.root(low), self.root(high)),
            }
        }
    }

    /// The lowest thing that hangs together with each.
    pub(crate) fn roots(self) -> Vec<u32> {
        super::map_chunks(self.0.len(), super::CHUNK, |range| {
            range.for_each(|i| self.0[i].store(self.root(i as u32), Relaxed));
        });
        self.0.into_iter().map(AtomicU32::into_inner).collect()
    }

    /// The root of the tree that `a` is in.
    fn root(&self, mut a: u32) -> u32 {
        loop {
            let above = self.0[a as usize].load(Relaxed);
            if above == a {
                return a;
            }
            let next = self.0[above as usize].load(Relaxed);
            if next == above {
                return above;
            }
            self.0[a as usize].store(next, Relaxed);
            a = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par::{map_chunks, with_threads};

    #[test]
    fn the_lowest_of_a_tree_is_its_root_on_any_number_of_threads() {
        let count = 60_000_usize;
        // Sevens hang together in rows of different length, joined from all sides at once.
        let tree = |i: usize| i % 7 + 7 * (i / 20_000);
        let joins: Vec<[u32; 2]> = (0..4 * count)
            .map(|k| {
                let a = (k * 7919) % count;
                let b = (a + 7 * (k % 11)) % count;
                [a, if tree(a) == tree(b) { b } else { a }].map(|i| i as u32)
            })
            .collect();
        let expected: Vec<u32> = {
            let mut lowest: Vec<u32> = (0..count as u32).collect();
            loop {
                let mut changed = false;
                for &[a, b] in &joins {
                    let low = lowest[a as usize].min(lowest[b as usize]);
                    changed |= lowest[a as usize] != low || lowest[b as usize] != low;
                    (lowest[a as usize], lowest[b as usize]) = (low, low);
                }
                if !changed {
                    break lowest;
                }
            }
        };
        for threads in [1, 2, 5] {
            let found = with_threads(threads, || {
                let forest = Forest::new(count);
                map_chunks(joins.len(), 64, |range| {
                    joins[range].iter().for_each(|&[a, b]| forest.join(a, b))
                });
                forest.roots()
            });
            assert!(found == expected, "{threads} threads");
        }
        assert!(Forest::new(0).roots().is_empty());
    }
}
