//! The AVX2 twin of `gather`: eight candidates at a time.
//!
//! *Method*: the candidates of a group of cells are packed side by side, so that each of its particles tests them in
//! whole vectors; hits are moved to the front by a permutation from a table of all 256 patterns and stored, and the
//! next store begins behind them. Distances are computed as the scalar form does, without fused operations, so
//! both give the same lists.
#![allow(unsafe_code)] // Vector loads and stores, and the call into code for processors that have AVX2.

use super::gather::{Candidates, Gather, Scratch, Sorted};
use std::{arch::x86_64::*, ops::Range};

const LANES: usize = 8;

/// For every pattern of hits, the lanes that hit, first to last.
static PACKED: [[u32; LANES]; 256] = packed();

const fn packed() -> [[u32; LANES]; 256] {
    let mut table = [[0; LANES]; 256];
    let mut pattern = 0;
    while pattern < 256 {
        let (mut lane, mut found) = (0, 0);
        while lane < LANES {
            if pattern >> lane & 1 == 1 {
                table[pattern][found] = lane as u32;
                found += 1;
            }
            lane += 1;
        }
        pattern += 1;
    }
    table
}

/// The twin, where the processor runs it.
pub(super) fn available() -> Option<Gather> {
    let runs = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt");
    runs.then_some(|sorted, order, stretches, places, radius2, scratch, ends| {
        // SAFETY: this closure leaves the function only where both features were found.
        unsafe { gather(sorted, order, stretches, places, radius2, scratch, ends) }
    })
}

#[target_feature(enable = "avx2,popcnt")]
fn gather(
    sorted: &Sorted,
    order: &[u32],
    stretches: &[[u32; 2]; 9],
    places: Range<usize>,
    radius2: f32,
    scratch: &mut Scratch,
    ends: &mut [u32],
) {
    let count = pack(sorted, order, stretches, &mut scratch.candidates);
    let radius2 = _mm256_set1_ps(radius2);
    for (own, end) in places.zip(ends) {
        let x = [&sorted.x, &sorted.y, &sorted.z].map(|axis| _mm256_set1_ps(axis[own]));
        let own = _mm256_set1_epi32(order[own] as i32);
        scratch.reserve(count + LANES);
        let Scratch { hits, found, candidates } = &mut *scratch;
        let hits = &mut hits[*found..][..count + LANES];
        let mut stored = 0;
        let (xs, ys) = (candidates.x.as_chunks::<LANES>().0, candidates.y.as_chunks::<LANES>().0);
        let (zs, indices) = (candidates.z.as_chunks::<LANES>().0, candidates.index.as_chunks::<LANES>().0);
        let blocks = count.div_ceil(LANES);
        for (((px, py), pz), index) in
            xs[..blocks].iter().zip(&ys[..blocks]).zip(&zs[..blocks]).zip(&indices[..blocks])
        {
            // SAFETY: each pointer is that of an array of eight.
            let (px, py, pz, index) = unsafe {
                (
                    _mm256_loadu_ps(px.as_ptr()),
                    _mm256_loadu_ps(py.as_ptr()),
                    _mm256_loadu_ps(pz.as_ptr()),
                    _mm256_loadu_si256(index.as_ptr().cast()),
                )
            };
            let d = [_mm256_sub_ps(px, x[0]), _mm256_sub_ps(py, x[1]), _mm256_sub_ps(pz, x[2])];
            let xy = _mm256_add_ps(_mm256_mul_ps(d[0], d[0]), _mm256_mul_ps(d[1], d[1]));
            let r2 = _mm256_add_ps(xy, _mm256_mul_ps(d[2], d[2]));
            let near = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_LT_OQ>(r2, radius2));
            let others = _mm256_andnot_si256(_mm256_cmpeq_epi32(index, own), near);
            let pattern = _mm256_movemask_ps(_mm256_castsi256_ps(others)) as usize;
            // SAFETY: a row of the table holds eight numbers. Before block b, counted from 0, at most 8 b hits are
            // stored, and 8 (b + 1) is less than count + 8, the length of `hits`.
            unsafe {
                let lanes = _mm256_loadu_si256(PACKED[pattern].as_ptr().cast());
                let packed = _mm256_permutevar8x32_epi32(index, lanes);
                _mm256_storeu_si256(hits.as_mut_ptr().add(stored).cast(), packed);
            }
            stored += pattern.count_ones() as usize;
        }
        *found += stored;
        *end = scratch.end();
    }
}

/// Packs the particles in `stretches` side by side and returns how many they are. Behind the last come seven or
/// more that are infinitely far.
#[target_feature(enable = "avx2,popcnt")]
fn pack(sorted: &Sorted, order: &[u32], stretches: &[[u32; 2]; 9], candidates: &mut Candidates) -> usize {
    let count: usize = stretches.iter().map(|[first, last]| (last - first) as usize).sum();
    let Candidates { x, y, z, index } = candidates;
    let room = count + 2 * LANES;
    if x.len() < room {
        let room = room.next_power_of_two();
        for axis in [&mut *x, &mut *y, &mut *z] {
            axis.resize(room, 0.0);
        }
        index.resize(room, 0);
    }
    let mut at = 0;
    for &[first, last] in stretches {
        let (first, last) = (first as usize, last as usize);
        copy(&sorted.x, first..last, &mut x[at..]);
        copy(&sorted.y, first..last, &mut y[at..]);
        copy(&sorted.z, first..last, &mut z[at..]);
        copy(order, first..last, &mut index[at..]);
        at += last - first;
    }
    x[count..count + LANES].fill(f32::INFINITY);
    count
}

/// Copies `range` of `from` to the front of `to`, which holds eight more: in steps of eight, which for a few dozen
/// numbers cost a tenth of a call.
#[inline]
#[target_feature(enable = "avx2,popcnt")]
fn copy<T: bytemuck::Pod>(from: &[T], range: Range<usize>, to: &mut [T]) {
    const { assert!(size_of::<T>() == 4) };
    assert!(range.end <= from.len() && range.len() + LANES <= to.len());
    if range.end + LANES > from.len() {
        to[..range.len()].copy_from_slice(&from[range]);
        return;
    }
    for k in (0..range.len()).step_by(LANES) {
        // SAFETY: `k` is below the length of the range, so eight numbers from there on reach at most seven beyond
        // it, where both slices still hold some. A number has four bytes, of any pattern.
        unsafe {
            let eight = _mm256_loadu_si256(from.as_ptr().add(range.start + k).cast());
            _mm256_storeu_si256(to.as_mut_ptr().add(k).cast(), eight);
        }
    }
}
