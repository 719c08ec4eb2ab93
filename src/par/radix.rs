//! Sorting numbers by their digits.
//!
//! *Method*: radix sort from the lowest digit up. A pass counts the digits of every task's numbers, turns the
//! counts into places, and moves the numbers; tasks are of constant length, and numbers of equal digits keep their
//! order, so any number of threads gives the same result. Buffers are kept for the next sort.
//!
//! Numbers are moved through relaxed atomics, which cost what plain stores do: every place is written by one
//! thread, but which one, only the counts know.

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering::Relaxed};

/// Numbers a task moves. Below it the counters cost more than the numbers; above it 100 000 numbers are too few
/// tasks for some threads.
const TASK: usize = 1 << 13;

/// The widest digit [bits]: 2¹² counters of a task stay in the first-level cache.
const WIDEST: u32 = 12;

/// Numbers sorted by some of their bits.
#[derive(Debug, Default)]
pub(crate) struct Radix {
    keys: Vec<AtomicU64>,
    spare: Vec<AtomicU64>,
    /// One task's counters after another's.
    counts: Vec<u32>,
}

impl Radix {
    /// Sorts `key(i)` of `i` in `0..count`, fewer than 2³², by their bits from `low` up, of which only `bits` are
    /// used. Where they are equal the smaller `i` comes first.
    pub(crate) fn sort(&mut self, count: usize, low: u32, bits: u32, key: impl Fn(usize) -> u64 + Sync) {
        self.keys.resize_with(count, AtomicU64::default);
        self.spare.resize_with(count, AtomicU64::default);
        super::update(&mut self.keys, |i, slot| *slot.get_mut() = key(i));
        let passes = bits.div_ceil(WIDEST);
        let width = bits.div_ceil(passes.max(1));
        for pass in 0..passes {
            self.pass(low + pass * width, width.min(bits - pass * width));
            std::mem::swap(&mut self.keys, &mut self.spare);
        }
    }

    /// The number at a place of the order.
    #[inline]
    pub(crate) fn get(&self, place: usize) -> u64 {
        self.keys[place].load(Relaxed)
    }

    /// Moves `keys` to `spare`, sorted by the digit of `width` bits at `shift`.
    fn pass(&mut self, shift: u32, width: u32) {
        let Self { keys, spare, counts } = self;
        let (keys, spare) = (&*keys, &*spare);
        let digits = 1_usize << width;
        let digit = |key: u64| (key >> shift) as usize & (digits - 1);
        let task = |number: usize| &keys[number * TASK..((number + 1) * TASK).min(keys.len())];

        // Every task counts its digits.
        counts.clear();
        counts.resize(keys.len().div_ceil(TASK) * digits, 0);
        super::for_chunks(counts, digits, |first, counts| {
            for key in task(first / digits) {
                counts[digit(key.load(Relaxed))] += 1;
            }
        });

        // A count becomes the number of equal digits in earlier tasks, and the totals the digits' first places.
        let mut first = vec![0_u32; digits];
        for counts in counts.chunks_exact_mut(digits) {
            for (count, total) in counts.iter_mut().zip(&mut first) {
                (*count, *total) = (*total, *total + *count);
            }
        }
        let mut sum = 0;
        for first in &mut first {
            (*first, sum) = (sum, sum + *first);
        }

        // Every task moves its numbers.
        super::for_chunks(counts, digits, |start, places| {
            for (place, first) in places.iter_mut().zip(&first) {
                *place += first;
            }
            for key in task(start / digits) {
                let key = key.load(Relaxed);
                let place = &mut places[digit(key)];
                spare[*place as usize].store(key, Relaxed);
                *place += 1;
            }
        });
    }
}

/// The inverse of a permutation.
#[derive(Debug, Default)]
pub(crate) struct Inverse(Vec<AtomicU32>);

impl Inverse {
    /// Inverts `order`, which holds every number of `0..order.len()` once.
    ///
    /// # Panics
    /// If a number is not below `order.len()`: the soundness of lists of neighbours rests on that.
    pub(crate) fn rebuild(&mut self, order: &[u32]) {
        self.0.resize_with(order.len(), AtomicU32::default);
        let slots = &self.0;
        super::map_chunks(order.len(), TASK, |places| {
            for place in places {
                slots[order[place] as usize].store(place as u32, Relaxed);
            }
        });
    }

    /// The place in the order at which `i` stands.
    #[inline]
    pub(crate) fn of(&self, i: usize) -> usize {
        self.0[i].load(Relaxed) as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::par::with_threads;

    fn mixed(i: usize) -> u64 {
        (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (i as u64) << 17
    }

    #[test]
    fn numbers_are_sorted_stably_by_the_requested_bits() {
        let mut radix = Radix::default();
        for (count, low, bits) in [(0, 0, 5), (1, 3, 40), (50_000, 7, 0), (50_000, 20, 44), (30_000, 9, 23)] {
            let mut expected: Vec<u64> = (0..count).map(mixed).collect();
            let part = |key: &u64| if bits == 0 { 0 } else { key >> low & (u64::MAX >> (64 - bits)) };
            expected.sort_by_key(part);
            for threads in [1, 2, 3] {
                with_threads(threads, || radix.sort(count, low, bits, mixed));
                assert!((0..count).all(|place| radix.get(place) == expected[place]));
            }
        }
    }

    #[test]
    fn an_inverse_leads_back() {
        let order: Vec<u32> = (0..30_011).map(|i| (i * 7919) % 30_011).collect();
        let mut inverse = Inverse::default();
        inverse.rebuild(&order);
        assert!(order.iter().enumerate().all(|(place, &i)| inverse.of(i as usize) == place));
    }
}
