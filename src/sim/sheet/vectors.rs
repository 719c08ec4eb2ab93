//! Vectors of all points, eight at a time.

use crate::{
    math::Vec3,
    par,
    simd::{F32x8, LANES},
};
use std::ops::Range;

/// Number of eights of a task and of a partial sum. With 256 at all sizes, ten thousand points were five
/// tasks, and two threads were 1.6 times as fast as one. Below 32, the tasks of some forces begin to cost as
/// much as their work; beyond 64 chunks nothing is gained.
pub(super) fn chunk_len(eights: usize) -> usize {
    (eights / 64).clamp(32, 256)
}

/// Up to this number of eights one thread is used: a pass over 4096 points takes 5 to 60 µs, and waking
/// another thread takes some 10 µs (`cargo bench --bench sheet -- threads`).
const PARALLEL_THRESHOLD: usize = 512;

/// Cuts slices of equal length into chunks, calls `f(number of the first eight, a chunk of each)` and returns
/// the results in order. The chunks do not depend on the threads.
pub(super) fn in_chunks<T: Send, const N: usize>(
    slices: [&mut [F32x8]; N],
    f: impl Fn(usize, [&mut [F32x8]; N]) -> T + Sync,
) -> Vec<T> {
    let len = slices[0].len();
    assert!(slices.iter().all(|slice| slice.len() == len), "all are cut in the same places");
    let chunk = chunk_len(len);
    if len > PARALLEL_THRESHOLD {
        return par::map_chunks_mut(slices, chunk, f);
    }
    let mut chunks = slices.map(|slice| slice.chunks_mut(chunk));
    (0..len.div_ceil(chunk))
        .map(|k| f(k * chunk, std::array::from_fn(|s| chunks[s].next().expect("all have as many chunks"))))
        .collect()
}

/// Calls `f` on ranges of eights, cut as by [`in_chunks`], and returns the results in order.
pub(super) fn map_chunks<T: Send>(eights: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let chunk = chunk_len(eights);
    if eights > PARALLEL_THRESHOLD {
        return par::map_chunks(eights, chunk, f);
    }
    (0..eights.div_ceil(chunk)).map(|k| f(k * chunk..((k + 1) * chunk).min(eights))).collect()
}

/// Σ a · b over eights in double precision, in their order.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Dot([f64; LANES]);

impl Dot {
    #[inline(always)]
    pub(super) fn add(&mut self, a: &Eight, b: &Eight) {
        for axis in 0..3 {
            for lane in 0..LANES {
                self.0[lane] += f64::from(a[axis][lane]) * f64::from(b[axis][lane]);
            }
        }
    }

    #[inline(always)]
    pub(super) fn total(self) -> f64 {
        self.0.iter().sum()
    }
}

/// x, y and z of eight points.
pub(super) type Eight = [F32x8; 3];

/// x, y and z of all points, point by point.
pub(super) type Flat<'a> = [&'a [f32]; 3];

/// Vectors by eights of points; the padding of the last eight is zero.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Vectors {
    len: usize,
    /// Each axis by eights.
    pub(super) axes: [Vec<F32x8>; 3],
}

impl Clone for Vectors {
    fn clone(&self) -> Self {
        Self { len: self.len, axes: self.axes.each_ref().map(|axis| par::copied(axis)) }
    }
}

impl Vectors {
    /// `len` zeros.
    pub(super) fn zeros(len: usize) -> Self {
        Self { len, axes: std::array::from_fn(|_| par::repeated([0.0; LANES], len.div_ceil(LANES))) }
    }

    /// Sets all vectors to zero.
    pub(super) fn clear(&mut self) {
        self.update(|_, axes| axes.into_iter().for_each(|axis| *axis = [0.0; LANES]));
    }

    /// Copies these vectors.
    pub(super) fn of(values: &[Vec3]) -> Self {
        let mut out = Self::zeros(values.len());
        for (i, v) in values.iter().enumerate() {
            out.set(i, *v);
        }
        out
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    #[inline]
    pub(super) fn get(&self, i: usize) -> Vec3 {
        let [x, y, z] = &self.axes;
        Vec3::new(x[i / LANES][i % LANES], y[i / LANES][i % LANES], z[i / LANES][i % LANES])
    }

    #[inline]
    pub(super) fn set(&mut self, i: usize, v: Vec3) {
        for (axis, value) in self.axes.iter_mut().zip(v.iter()) {
            axis[i / LANES][i % LANES] = *value;
        }
    }

    #[inline]
    pub(super) fn add(&mut self, i: usize, v: Vec3) {
        self.set(i, self.get(i) + v);
    }

    /// The vectors of eight points.
    #[inline(always)]
    pub(super) fn eight(&self, at: usize) -> Eight {
        [self.axes[0][at], self.axes[1][at], self.axes[2][at]]
    }

    /// The axes as slices, padding included.
    #[inline(always)]
    pub(super) fn flat(&self) -> Flat<'_> {
        [self.axes[0].as_flattened(), self.axes[1].as_flattened(), self.axes[2].as_flattened()]
    }

    /// The vectors as a list.
    pub(super) fn to_vec(&self) -> Vec<Vec3> {
        (0..self.len).map(|i| self.get(i)).collect()
    }

    /// Calls `f(number of the eight, its vectors)` for each eight.
    pub(super) fn update(&mut self, f: impl Fn(usize, [&mut F32x8; 3]) + Sync) {
        let [x, y, z] = &mut self.axes;
        in_chunks([x, y, z], |start, [x, y, z]: [&mut [F32x8]; 3]| {
            for (k, ((x, y), z)) in x.iter_mut().zip(y).zip(z).enumerate() {
                f(start + k, [x, y, z]);
            }
        });
    }

    /// Σ over points of `self` · `other`, in double precision and a fixed order.
    pub(super) fn dot(&self, other: &Self) -> f64 {
        let len = self.axes[0].len();
        let part = |range: Range<usize>| {
            let mut sum = Dot::default();
            range.for_each(|at| sum.add(&self.eight(at), &other.eight(at)));
            sum.total()
        };
        map_chunks(len, part).into_iter().sum()
    }
}
