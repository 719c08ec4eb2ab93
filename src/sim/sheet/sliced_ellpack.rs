//! Neighbours of every point in sliced ELLPACK format, eight points at a time.
//!
//! *Method*: compressed rows, cut into slices of eight rows whose entries are stored column by column
//! [kreutzer14]. A slot holds one neighbour of each of eight consecutive points. Neighbours of a row are in
//! ascending order. Where eight points have neighbours at the same distances in memory, as on a grid, a slot
//! takes those at one distance. It then holds eight consecutive neighbours, which one wide load fetches.
//! Slots store relative indices, and eights with equal slots share them. Nearly all eights of a grid do, so
//! its table stays in the fastest cache. Without sharing it was two thirds of all data that a substep of a
//! million points read.

use crate::{
    par,
    simd::{F32x8, LANES},
};
use std::collections::HashMap;
use xxhash_rust::xxh3::Xxh3Default;

/// A spring or plate term of one point with another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Entry {
    /// The point.
    pub(super) of: u32,
    /// The neighbour of the point.
    pub(super) to: u32,
    /// Stiffness [N/m].
    pub(super) stiffness: f32,
    /// Rest length [m].
    pub(super) rest: f32,
    /// Damping [N·s/m].
    pub(super) damping: f32,
}

/// The entries of all points.
#[derive(Clone, Debug, Default)]
pub(super) struct SlicedEllpack {
    /// Range in `slots` of the points 8e to 8e + 7. Several eights may share a range.
    ranges: Vec<[u32; 2]>,
    slots: Vec<Slot>,
    /// Damping of each slot; empty if there is none.
    damping: Vec<F32x8>,
}

/// One neighbour of each of eight points; without a neighbour the stiffness is zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slot {
    /// Indices of the neighbours relative to the first of the eight points.
    away: [i32; LANES],
    pub(super) stiffness: F32x8,
    pub(super) rest: F32x8,
    /// Whether the neighbours are eight consecutive points.
    pub(super) in_row: bool,
}

impl Slot {
    /// The neighbour of the point in a lane of the eight with number `eight`.
    #[inline(always)]
    pub(super) fn to(&self, eight: usize, lane: usize) -> usize {
        (eight * LANES).wrapping_add_signed(self.away[lane] as isize)
    }
}

impl SlicedEllpack {
    /// The table of `count` points. Several entries with the same two points all count.
    pub(super) fn new(count: usize, mut entries: Vec<Entry>) -> Self {
        par::sort_by_key(&mut entries, |e| {
            (e.of, e.to, e.rest.to_bits(), e.stiffness.to_bits(), e.damping.to_bits())
        });
        let damped = entries.iter().any(|e| e.damping != 0.0);
        let (mut table, mut rest) = (Self::default(), &entries[..]);
        let padded = count.next_multiple_of(LANES) as u32;
        let mut seen = HashMap::new();
        for eight in 0..count.div_ceil(LANES) as u32 {
            let first = eight * LANES as u32;
            let (own, after) = rest.split_at(rest.partition_point(|e| e.of < first + LANES as u32));
            rest = after;
            let (slots, mut damping): (Vec<Slot>, Vec<F32x8>) = slots(first, own, padded).into_iter().unzip();
            if !damped {
                damping.clear();
            }
            let range = table.place(slots, damping, &mut seen);
            table.ranges.push(range);
        }
        table
    }

    /// Range of the slots of an eight: that of an earlier one with the same slots, if any. `seen` has the
    /// first range with a hash.
    fn place(
        &mut self,
        slots: Vec<Slot>,
        damping: Vec<F32x8>,
        seen: &mut HashMap<u64, [u32; 2]>,
    ) -> [u32; 2] {
        let start = self.slots.len() as u32;
        let new = [start, start + slots.len() as u32];
        let first = *seen.entry(hash(&slots, &damping)).or_insert(new);
        let [from, to] = first.map(|end| end as usize);
        // Different slots may have one hash: the second set then gets its own range, and so does every
        // further one.
        if first != new
            && self.slots[from..to] == slots
            && (damping.is_empty() || self.damping[from..to] == damping)
        {
            return first;
        }
        self.slots.extend(slots);
        self.damping.extend(damping);
        new
    }

    /// The slots of an eight, and their damping.
    #[inline(always)]
    pub(super) fn of(&self, eight: usize) -> (&[Slot], &[F32x8]) {
        let [from, to] = self.ranges[eight];
        let range = from as usize..to as usize;
        (&self.slots[range.clone()], if self.damping.is_empty() { &[] } else { &self.damping[range] })
    }

    pub(super) fn is_damped(&self) -> bool {
        !self.damping.is_empty()
    }
}

/// Σ |stiffness|, Σ stiffness and Σ damping of every point.
pub(super) fn row_sums(table: &SlicedEllpack, count: usize) -> Vec<[f64; 3]> {
    let mut sums = vec![[0.0; 3]; count];
    par::fill(&mut sums, |i| {
        let (slots, damping) = table.of(i / LANES);
        let mut sum = [0.0; 3];
        for (k, slot) in slots.iter().enumerate() {
            let stiffness = f64::from(slot.stiffness[i % LANES]);
            sum[0] += stiffness.abs();
            sum[1] += stiffness;
            sum[2] += damping.get(k).map_or(0.0, |d| f64::from(d[i % LANES]).abs());
        }
        sum
    });
    sums
}

/// Hash of slots and damping.
fn hash(slots: &[Slot], damping: &[F32x8]) -> u64 {
    let mut hasher = Xxh3Default::new();
    for slot in slots {
        hasher.update(bytemuck::bytes_of(&slot.away));
        hasher.update(bytemuck::bytes_of(&slot.stiffness));
        hasher.update(bytemuck::bytes_of(&slot.rest));
    }
    hasher.update(bytemuck::cast_slice(damping));
    hasher.digest()
}

/// The entries of eight points from `first` on, as slots.
fn slots(first: u32, entries: &[Entry], padded: u32) -> Vec<(Slot, F32x8)> {
    // Distance of the neighbour, and the rank of the entry among those of the same two points.
    let mut away: Vec<(i64, usize)> = Vec::new();
    let mut lane_counts = [0; LANES];
    let key = |k: usize| {
        let e = &entries[k];
        let before = entries[..k].iter().rev().take_while(|b| (b.of, b.to) == (e.of, e.to)).count();
        (i64::from(e.to) - i64::from(e.of), before)
    };
    for (k, entry) in entries.iter().enumerate() {
        away.push(key(k));
        lane_counts[(entry.of - first) as usize] += 1;
    }
    let mut places = away.clone();
    places.sort_unstable();
    places.dedup();
    let longest = lane_counts.into_iter().max().unwrap_or(0);
    let fits = |&(offset, _): &(i64, usize)| {
        let low = i64::from(first) + offset;
        low >= 0 && low + LANES as i64 <= i64::from(padded)
    };
    let in_rows = places.len() <= longest + 2 && places.iter().all(fits);

    let own: [i32; LANES] = std::array::from_fn(|lane| lane as i32);
    let empty =
        |away| (Slot { away, stiffness: [0.0; LANES], rest: [0.0; LANES], in_row: in_rows }, [0.0; LANES]);
    let mut out: Vec<(Slot, F32x8)> = if in_rows {
        places.iter().map(|&(offset, _)| empty(own.map(|lane| lane + offset as i32))).collect()
    } else {
        vec![empty(own); longest]
    };
    let mut filled = [0; LANES];
    for (entry, away) in entries.iter().zip(&away) {
        let lane = (entry.of - first) as usize;
        let place = if in_rows { places.binary_search(away).unwrap_or(0) } else { filled[lane] };
        filled[lane] += 1;
        let (slot, damping) = &mut out[place];
        slot.away[lane] = (i64::from(entry.to) - i64::from(first)) as i32;
        (slot.stiffness[lane], slot.rest[lane], damping[lane]) = (entry.stiffness, entry.rest, entry.damping);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Springs of a grid of `n` × `n` points; those at `soft` are half as stiff.
    fn grid(n: u32, soft: Option<u32>) -> Vec<Entry> {
        let all = (0..n * n).flat_map(|i| [(i, i + 1, i % n + 1 < n), (i, i + n, i + n < n * n)]);
        let both = |(a, b, _): (u32, u32, bool)| {
            let stiffness = if soft == Some(a) { 1.0 } else { 2.0 };
            let entry = |of, to| Entry { of, to, stiffness, rest: 0.5, damping: 0.1 * stiffness };
            [entry(a, b), entry(b, a)]
        };
        all.filter(|&(.., exists)| exists).flat_map(both).collect()
    }

    /// All entries of a table, in its order.
    fn entries_of(table: &SlicedEllpack, count: usize) -> Vec<Entry> {
        let of = |i: usize| {
            let (slots, damping) = table.of(i / LANES);
            let lane = i % LANES;
            slots.iter().zip(damping).filter(move |(slot, _)| slot.stiffness[lane] != 0.0).map(
                move |(slot, d)| Entry {
                    of: i as u32,
                    to: slot.to(i / LANES, lane) as u32,
                    stiffness: slot.stiffness[lane],
                    rest: slot.rest[lane],
                    damping: d[lane],
                },
            )
        };
        (0..count).flat_map(of).collect()
    }

    #[test]
    fn eights_with_the_same_neighbours_share_their_slots_and_no_others_do() {
        for (n, soft) in [(64, None), (64, Some(1000)), (61, None), (7, Some(3)), (1, None)] {
            let count = (n * n) as usize;
            let table = SlicedEllpack::new(count, grid(n, soft));
            let mut expected = grid(n, soft);
            expected.sort_by_key(|e| (e.of, e.to));
            assert_eq!(entries_of(&table, count), expected, "{n}");
            // Eights within a row have three kinds of neighbours: at the two borders and between. Eights
            // across rows have more.
            let max_slots = if n == 64 { 9 * 5 + if soft.is_some() { 3 * 5 } else { 0 } } else { usize::MAX };
            assert!(table.slots.len() <= max_slots, "{} slots", table.slots.len());
        }
        // With equal hashes, ranges are still separate if the neighbours differ, or only the damping.
        let of = |soft| -> (Vec<Slot>, Vec<F32x8>) { slots(0, &grid(8, soft)[..3], 64).into_iter().unzip() };
        let ((a, damping), (b, other)) = (of(None), of(Some(0)));
        for [(a, da), (b, db)] in [
            [(&a, vec![]), (&b, vec![])],
            [(&a, damping.clone()), (&a, other)],
            [(&a, damping.clone()), (&b, damping)],
        ] {
            let (mut table, mut seen) = (SlicedEllpack::default(), HashMap::new());
            let first = table.place(a.clone(), da.clone(), &mut seen);
            seen.insert(hash(b, &db), first);
            let second = table.place(b.clone(), db, &mut seen);
            assert_ne!(first, second);
            assert_eq!(table.place(a.clone(), da, &mut seen), first);
            assert_eq!(table.slots[second[0] as usize..second[1] as usize], *b);
        }
    }
}
