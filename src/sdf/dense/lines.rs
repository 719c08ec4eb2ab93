//! Eight rows of a block, one after the other or skewed: row j at step x + 1 + j in lane j.
//!
//! *Method*: each row is shifted by one more place than the row before it. Columns of the eight shifted rows are then the skewed
//! vectors, so both directions are transpositions of 8 × 8 numbers. Single stores into skewed vectors took half of a solve's time.

use crate::simd::{self, F32x8, LANES, Lanes, Pass};
use std::ops::Range;

/// Eight rows of the same number of nodes, shifted against each other.
pub(super) struct Lines {
    /// Nodes of a row.
    nodes: usize,
    /// Vectors of a shifted row.
    width: usize,
    /// The shifted rows, one after the other; −∞ where there is no node.
    shifted: Vec<F32x8>,
}

impl Lines {
    pub(super) fn new(nodes: usize) -> Self {
        let width = (nodes + LANES + 1).div_ceil(LANES);
        Self { nodes, width, shifted: vec![[f32::NEG_INFINITY; LANES]; width * LANES] }
    }

    /// Copies rows `ys`, at most eight, in ascending (`direction` > 0) or descending order of their nodes. `row(y)` is a row and
    /// the magnitudes beyond its ends, before and behind it in that order.
    #[inline]
    pub(super) fn fill<'a>(
        &mut self,
        ys: Range<usize>,
        direction: i32,
        row: impl Fn(usize) -> (&'a [f32], [f32; 2]),
    ) {
        let count = ys.len();
        for (lane, y) in ys.enumerate() {
            let (from, [before, behind]) = row(y);
            let to = &mut self.shifted[lane * self.width..(lane + 1) * self.width].as_flattened_mut()[lane..];
            to[0] = -before;
            to[self.nodes + 1] = -behind;
            let to = &mut to[1..=self.nodes];
            if direction > 0 {
                to.copy_from_slice(from);
            } else {
                to.iter_mut().zip(from.iter().rev()).for_each(|(to, from)| *to = *from);
            }
        }
        self.shifted[count * self.width..].fill([f32::NEG_INFINITY; LANES]);
    }

    /// Makes every distance negative, so that a pass does not change it.
    pub(super) fn pin(&mut self) {
        self.shifted.as_flattened_mut().iter_mut().for_each(|value| *value = -value.abs());
    }

    /// Writes the skewed vectors of the rows.
    pub(super) fn skew(&self, cells: &mut [F32x8]) {
        simd::dispatch(Skew { shifted: &self.shifted, width: self.width, cells });
    }

    /// The inverse of [`Lines::skew`].
    pub(super) fn unskew(&mut self, cells: &[F32x8]) {
        simd::dispatch(Unskew { shifted: &mut self.shifted, width: self.width, cells });
    }

    /// Copies the nodes of a lane's row to `row`; returns whether any number there changed.
    #[inline]
    pub(super) fn copy_to(&self, row: &mut [f32], lane: usize, direction: i32) -> bool {
        let from = &self.shifted[lane * self.width..(lane + 1) * self.width].as_flattened()[lane + 1..];
        let mut changed = false;
        let put = |(to, from): (&mut f32, &f32)| {
            changed |= *to != *from;
            *to = *from;
        };
        if direction > 0 {
            row.iter_mut().zip(&from[..self.nodes]).for_each(put);
        } else {
            row.iter_mut().zip(from[..self.nodes].iter().rev()).for_each(put);
        }
        changed
    }
}

/// Transposes shifted rows to skewed vectors.
struct Skew<'a> {
    shifted: &'a [F32x8],
    width: usize,
    cells: &'a mut [F32x8],
}

impl Pass for Skew<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (k, cells) in self.cells.chunks_mut(LANES).enumerate() {
            let columns =
                L::transpose([0, 1, 2, 3, 4, 5, 6, 7].map(|lane| &self.shifted[lane * self.width + k]));
            for (cell, column) in cells.iter_mut().zip(columns) {
                *cell = column.to_array();
            }
        }
    }
}

/// Transposes skewed vectors to shifted rows.
struct Unskew<'a> {
    shifted: &'a mut [F32x8],
    width: usize,
    cells: &'a [F32x8],
}

impl Pass for Unskew<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let none = [f32::NEG_INFINITY; LANES];
        for (k, cells) in self.cells.chunks(LANES).enumerate() {
            let rows = L::transpose([0, 1, 2, 3, 4, 5, 6, 7].map(|step| cells.get(step).unwrap_or(&none)));
            for (lane, row) in rows.into_iter().enumerate() {
                self.shifted[lane * self.width + k] = row.to_array();
            }
        }
    }
}
