//! Things by the group they belong to.
//!
//! *Method*: two counting passes. Tasks of constant length count how many of their things fall into each of some
//! hundred runs of groups, and move them there; then every run is sorted by its groups alone, in the caches. Things of a group
//! keep their order, so any number of threads gives the same lists. On one or two threads a plain counting sort does it.
//!
//! Things are moved through relaxed atomics, which cost what plain stores do: every place is written by one thread,
//! but which one, only the counts know.

use std::{
    ops::Range,
    sync::atomic::{AtomicU32, Ordering::Relaxed},
};

/// Rows a task counts and moves. Fewer, and its counters cost more than its things; more, and small jobs are too few
/// tasks for some threads.
const TASK: usize = 1 << 13;

/// Runs of groups there are at most. More, and a task's counters leave the first-level cache; fewer, and the things of
/// a run leave the second.
const RUNS: usize = 1 << 10;

/// With fewer threads one counting pass on a single one is as fast: things that come in about the order of their groups,
/// as the corners of a surface do, stay in the caches without runs.
const MIN_THREADS: usize = 3;

/// Fewest groups in a run, as a power of two.
const MIN_RUN_BITS: u32 = 10;

/// The things of every group, one list after another.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Groups {
    start: Vec<u32>,
    list: Vec<u32>,
}

impl Groups {
    /// Sorts the things K·i + k by the groups `of(i)[k]`, for `i` in `0..rows`; those whose group is not below `groups` are
    /// left out.
    ///
    /// # Panics
    /// If there are 2³² things or more.
    pub(crate) fn new<const K: usize>(
        rows: usize,
        groups: usize,
        of: impl Fn(usize) -> [u32; K] + Sync,
    ) -> Self {
        assert!(rows < u32::MAX as usize / K, "fewer than 2³² things");
        if super::threads() < MIN_THREADS {
            return Self::counted(rows, groups, of);
        }
        let mut shift = MIN_RUN_BITS;
        while groups >> shift >= RUNS {
            shift += 1;
        }
        let runs = groups.div_ceil(1 << shift).max(1);
        let task = |number: usize| number * TASK..((number + 1) * TASK).min(rows);
        let is_in = |group: u32| (group as usize) < groups;

        // Every task counts its things by runs.
        let mut places = vec![0_u32; rows.div_ceil(TASK) * runs];
        super::for_chunks(&mut places, runs, |first, counts| {
            for group in task(first / runs).flat_map(&of).filter(|&group| is_in(group)) {
                counts[(group >> shift) as usize] += 1;
            }
        });

        // A count becomes the place of the task's first thing in the run.
        let mut ends = Vec::with_capacity(runs);
        let mut total = 0;
        for run in 0..runs {
            for place in places.iter_mut().skip(run).step_by(runs) {
                (*place, total) = (total, total + *place);
            }
            ends.push(total as usize);
        }

        // Every task moves its things.
        let mut list: Vec<AtomicU32> = Vec::new();
        list.resize_with(total as usize, AtomicU32::default);
        super::for_chunks(&mut places, runs, |first, places| {
            for i in task(first / runs) {
                for (k, group) in (0..).zip(of(i)).filter(|&(_, group)| is_in(group)) {
                    let place = &mut places[(group >> shift) as usize];
                    list[*place as usize].store((K * i) as u32 + k, Relaxed);
                    *place += 1;
                }
            }
        });
        let mut list: Vec<u32> = list.into_iter().map(AtomicU32::into_inner).collect();

        // Sort every run by its groups.
        let mut start = vec![0; groups + 1];
        start[groups] = total;
        let mut tasks = Vec::with_capacity(runs);
        let (mut list_rest, mut first) = (list.as_mut_slice(), 0);
        for (starts, &end) in start[..groups].chunks_mut(1 << shift).zip(&ends) {
            let (part, rest) = list_rest.split_at_mut(end - first);
            tasks.push((first as u32, starts, part));
            (list_rest, first) = (rest, end);
        }
        let group_of = |thing: u32| of(thing as usize / K)[thing as usize % K] as usize;
        super::for_chunks_with(&mut tasks, 1, Vec::new, |copy, run, task| {
            let [(first, starts, part)] = task else { return };
            let (lowest, first) = (run << shift, *first);
            for &thing in part.iter() {
                starts[group_of(thing) - lowest] += 1;
            }
            // Each start is first the end of its group, and goes down as the things are put in, last first.
            let mut end = first;
            for start in starts.iter_mut() {
                end += *start;
                *start = end;
            }
            copy.clear();
            copy.extend_from_slice(part);
            for &thing in copy.iter().rev() {
                let start = &mut starts[group_of(thing) - lowest];
                *start -= 1;
                part[(*start - first) as usize] = thing;
            }
        });
        Self { start, list }
    }

    /// Does what [`Groups::new`] does, by one counting pass on one thread.
    fn counted<const K: usize>(rows: usize, groups: usize, of: impl Fn(usize) -> [u32; K]) -> Self {
        let mut start = vec![0; groups + 1];
        for group in (0..rows).flat_map(&of) {
            if let Some(count) = start[..groups].get_mut(group as usize) {
                *count += 1;
            }
        }
        // Each start is first the end of its group, and goes down as the things are put in, last first.
        let mut end = 0;
        for start in &mut start {
            end += *start;
            *start = end;
        }
        let mut list = vec![0; end as usize];
        for i in (0..rows).rev() {
            for (k, group) in of(i).into_iter().enumerate().rev() {
                if let Some(start) = start[..groups].get_mut(group as usize) {
                    *start -= 1;
                    list[*start as usize] = (K * i + k) as u32;
                }
            }
        }
        Self { start, list }
    }

    /// The things of a group, in ascending order.
    #[inline]
    pub(crate) fn of(&self, group: usize) -> &[u32] {
        &self.list[self.range(group)]
    }

    /// The things of all groups, one after another.
    #[inline]
    pub(crate) fn all(&self) -> &[u32] {
        &self.list
    }

    /// Where those of a group stand among all.
    #[inline]
    pub(crate) fn range(&self, group: usize) -> Range<usize> {
        self.start[group] as usize..self.start[group + 1] as usize
    }

    /// How many things are in groups.
    pub(crate) fn len(&self) -> usize {
        self.list.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par::with_threads;

    #[test]
    fn groups_hold_their_things_in_order_on_any_number_of_threads() {
        for (rows, groups) in
            [(0, 0), (0, 7), (5, 0), (5, 1), (1000, 1024), (30_000, 50_000), (20_000, 3_000_001)]
        {
            let of = |i: usize| [i * 7919 + 5, i / 3, i * i].map(|place| (place % (groups + 2)) as u32);
            let mut expected = vec![Vec::new(); groups];
            for (thing, group) in (0..).zip((0..rows).flat_map(of)) {
                if (group as usize) < groups {
                    expected[group as usize].push(thing);
                }
            }
            for threads in [1, 2, 3] {
                let found = with_threads(threads, || Groups::new(rows, groups, of));
                assert!((0..groups).all(|group| found.of(group) == expected[group]), "{rows} in {groups}");
                assert_eq!(found.len(), expected.iter().map(Vec::len).sum::<usize>());
            }
        }
    }
}
