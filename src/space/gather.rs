//! The particles close to those of a few cells: the scalar form, and the choice between it and its twin.

use crate::{math::Vec3, par};
use std::ops::Range;

/// Candidates tested at once: their distances vectorise, and the hits are then packed without a branch.
const BATCH: usize = 64;

/// Appends, for each particle at `places` of the order, all others closer than √`radius2` in the nine `stretches`
/// to `scratch.hits` and writes where its list ends to `ends`.
pub(super) type Gather = fn(&Sorted, &[u32], &[[u32; 2]; 9], Range<usize>, f32, &mut Scratch, &mut [u32]);

/// The fastest form that this machine runs. All give the same lists.
pub(super) fn fastest() -> Gather {
    #[cfg(target_arch = "x86_64")]
    if let Some(twin) = super::gather_avx2::available() {
        return twin;
    }
    gather
}

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
    /// The candidates of one group of cells, for the twin that packs them.
    pub(super) candidates: Candidates,
}

/// Candidates side by side: coordinates and indices.
#[derive(Debug, Default)]
pub(super) struct Candidates {
    pub(super) x: Vec<f32>,
    pub(super) y: Vec<f32>,
    pub(super) z: Vec<f32>,
    pub(super) index: Vec<u32>,
}

impl Scratch {
    /// Makes room for `more` hits.
    #[inline]
    pub(super) fn reserve(&mut self, more: usize) {
        let needed = self.found + more;
        if self.hits.len() < needed {
            self.hits.resize(needed.next_power_of_two(), 0);
        }
    }

    /// The end of the last list, as it is stored.
    #[inline]
    pub(super) fn end(&self) -> u32 {
        u32::try_from(self.found).expect("fewer than 2³² neighbours a chunk")
    }
}

/// The scalar form of [`Gather`].
pub(super) fn gather(
    sorted: &Sorted,
    order: &[u32],
    stretches: &[[u32; 2]; 9],
    places: Range<usize>,
    radius2: f32,
    scratch: &mut Scratch,
    ends: &mut [u32],
) {
    let Sorted { x, y, z } = sorted;
    let mut r2 = [0.0_f32; BATCH];
    for (own, end_of_list) in places.zip(ends) {
        let (own_x, own_y, own_z) = (x[own], y[own], z[own]);
        for &[first, last] in stretches {
            let (mut first, last) = (first as usize, last as usize);
            while first < last {
                let end = last.min(first + BATCH);
                let (xs, ys, zs) = (&x[first..end], &y[first..end], &z[first..end]);
                for (((r2, &px), &py), &pz) in r2.iter_mut().zip(xs).zip(ys).zip(zs) {
                    let d = [px - own_x, py - own_y, pz - own_z];
                    *r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
                }
                // Every candidate is written, and the next one takes its place unless it is a hit.
                scratch.reserve(BATCH + 1);
                let hits = &mut scratch.hits[scratch.found..][..BATCH + 1];
                let mut found = 0;
                for (&r2, &j) in r2.iter().zip(&order[first..end]) {
                    hits[found] = j;
                    found += usize::from((r2 < radius2) & (j != order[own]));
                }
                scratch.found += found;
                first = end;
            }
        }
        *end_of_list = scratch.end();
    }
}
