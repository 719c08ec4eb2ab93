//! The particles close to those of a few cells, eight candidates at a time.
//!
//! *Method*: the candidates of a group of cells are packed side by side, so that each of its particles tests
//! them in whole vectors; the indices of the hits are moved to the front and stored, and the next store
//! begins behind them.

use crate::{
    math::Vec3,
    par,
    simd::{LANES, Lanes, Pass},
};
use std::ops::Range;

/// The coordinates of particles in cell order, one array an axis.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) z: Vec<f32>,
}

impl Sorted {
    /// Fills in `positions` in their `order`.
    pub(super) fn rebuild(&mut self, order: &[u32], positions: &[Vec3]) {
        for (axis, values) in [&mut self.x, &mut self.y, &mut self.z].into_iter().enumerate() {
            values.resize(order.len(), 0.0);
            par::fill(values, |place| positions[order[place] as usize][axis]);
        }
    }
}

/// What a thread works in.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    /// The lists found so far are the first `found` of `hits`.
    pub(super) hits: Vec<u32>,
    pub(super) found: usize,
    /// The candidates of one group of cells.
    candidates: Candidates,
}

/// Candidates side by side: coordinates and indices.
#[derive(Debug, Default)]
struct Candidates {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
    index: Vec<u32>,
}

impl Scratch {
    /// Grows the capacity by `more` hits.
    #[inline]
    fn reserve(&mut self, more: usize) {
        let needed = self.found + more;
        if self.hits.len() < needed {
            self.hits.resize(needed.next_power_of_two(), 0);
        }
    }

    /// The end of the last list, as it is stored.
    #[inline]
    fn end(&self) -> u32 {
        u32::try_from(self.found).expect("fewer than 2³² neighbours a chunk")
    }
}

/// Appends, for each particle at `places` of the order, all others closer than √`radius2` in the nine
/// `stretches` to `scratch.hits`, and writes where its list ends to `ends`.
pub(super) struct Gather<'a> {
    pub(super) sorted: &'a Sorted,
    pub(super) order: &'a [u32],
    pub(super) stretches: &'a [[u32; 2]; 9],
    pub(super) places: Range<usize>,
    pub(super) radius2: f32,
    pub(super) scratch: &'a mut Scratch,
    pub(super) ends: &'a mut [u32],
}

impl Pass for Gather<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { sorted, order, stretches, places, radius2, scratch, ends } = self;
        let count = pack(sorted, order, stretches, &mut scratch.candidates);
        let blocks = count.div_ceil(LANES);
        let radius2 = L::splat(radius2);
        for (own, end) in places.zip(ends) {
            let (x, y, z) = (L::splat(sorted.x[own]), L::splat(sorted.y[own]), L::splat(sorted.z[own]));
            let own = order[own];
            scratch.reserve(count + LANES);
            let Scratch { hits, found, candidates } = &mut *scratch;
            let hits = &mut hits[*found..][..count + LANES];
            let (xs, ys) = (candidates.x.as_chunks().0, candidates.y.as_chunks().0);
            let (zs, indices) = (candidates.z.as_chunks().0, candidates.index.as_chunks().0);
            let mut stored = 0;
            for (((px, py), pz), index) in
                xs[..blocks].iter().zip(&ys[..blocks]).zip(&zs[..blocks]).zip(&indices[..blocks])
            {
                let (dx, dy, dz) = (L::load(px) - x, L::load(py) - y, L::load(pz) - z);
                let r2 = dx * dx + dy * dy + dz * dz;
                let others = L::and_not(r2.less(radius2), L::equal(index, own));
                // Before block b, counted from 0, at most 8 b hits are stored, and 8 (b + 1) < count + 8.
                let out = hits[stored..].first_chunk_mut().expect("there is capacity for eight more");
                stored += L::compress(others, index, out);
            }
            *found += stored;
            *end = scratch.end();
        }
    }
}

/// Packs the particles in `stretches` side by side and returns how many they are. Behind the last come seven
/// or more that are infinitely far.
#[inline(always)]
fn pack(sorted: &Sorted, order: &[u32], stretches: &[[u32; 2]; 9], candidates: &mut Candidates) -> usize {
    let count: usize = stretches.iter().map(|[first, last]| (last - first) as usize).sum();
    let Candidates { x, y, z, index } = candidates;
    let needed = count + 2 * LANES;
    if x.len() < needed {
        let capacity = needed.next_power_of_two();
        for axis in [&mut *x, &mut *y, &mut *z] {
            axis.resize(capacity, 0.0);
        }
        index.resize(capacity, 0);
    }
    let mut at = 0;
    for &[first, last] in stretches {
        let range = first as usize..last as usize;
        copy(&sorted.x, range.clone(), &mut x[at..]);
        copy(&sorted.y, range.clone(), &mut y[at..]);
        copy(&sorted.z, range.clone(), &mut z[at..]);
        copy(order, range.clone(), &mut index[at..]);
        at += range.len();
    }
    x[count..count + LANES].fill(f32::INFINITY);
    count
}

/// Copies `range` of `from` to the front of `to`, which holds eight more: in steps of eight, which for a few
/// dozen numbers cost a tenth of a call.
#[inline(always)]
fn copy<T: Copy>(from: &[T], range: Range<usize>, to: &mut [T]) {
    let steps = range.len().div_ceil(LANES);
    let (eights, _) = from[range.start..].as_chunks::<LANES>();
    if steps > eights.len() {
        to[..range.len()].copy_from_slice(&from[range]);
        return;
    }
    for (to, from) in to.as_chunks_mut::<LANES>().0[..steps].iter_mut().zip(&eights[..steps]) {
        *to = *from;
    }
}
