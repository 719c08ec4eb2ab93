//! Eight numbers at a time, as passes see them.

use super::{F32x8, IndexRow, LANES};
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// A loop that is written once and compiled for every form of lanes.
pub trait Pass {
    /// What the pass returns.
    type Out;
    /// Runs the pass. Implementations are `#[inline(always)]`, with all that they call: a closure or a
    /// function of its own is compiled without the form's instructions.
    fn run<L: Lanes>(self) -> Self::Out;
}

/// Eight numbers, and what can be computed of them in one instruction or a few.
pub trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// A truth value for each lane.
    type Mask: Copy;

    /// One number in every lane.
    fn splat(value: f32) -> Self;
    /// Reads eight numbers.
    fn load(row: &F32x8) -> Self;
    /// The numbers as an array.
    fn to_array(self) -> F32x8;

    /// √ of each lane.
    fn sqrt(self) -> Self;
    /// The magnitude of each lane.
    fn abs(self) -> Self;
    /// The smaller number of each lane; `other` where one is NaN or both are zero.
    fn min(self, other: Self) -> Self;
    /// The larger number of each lane; `other` where one is NaN or both are zero.
    fn max(self, other: Self) -> Self;
    /// max(0, ·), but NaN stays NaN so that it is detected later.
    fn positive_part(self) -> Self;
    /// 1 where a lane is zero, else 0.
    fn zero_indicator(self) -> Self;
    /// 2ⁿ of lanes that hold 1.5 · 2²³ + n, n in -126..=127.
    fn power_of_two(self) -> Self;

    /// Where `self` < `other`.
    fn less(self, other: Self) -> Self::Mask;
    /// Where eight indices equal `index`.
    fn equal(row: &[u32; LANES], index: u32) -> Self::Mask;
    /// Where both masks are set.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// Where `a` is set and `b` is not.
    fn and_not(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The mask as bits, lane 0 in the lowest.
    fn bits(mask: Self::Mask) -> u8;
    /// `yes` where the mask is set, else `no`.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    /// The numbers one lane up, with `first` in lane 0.
    fn shifted_up(self, first: f32) -> Self;
    /// The numbers one lane down, with `last` in lane 7.
    fn shifted_down(self, last: f32) -> Self;
    /// The transposed 8×8 matrix: column k of `rows` becomes vector k.
    fn transpose(rows: [&F32x8; LANES]) -> [Self; LANES];
    /// Σ over lanes, in the order of [`sum`].
    fn sum(self) -> f32;
    /// [`Lanes::sum`] of each of eight vectors.
    fn sums(each: &[Self; LANES]) -> F32x8;

    /// The four components of eight entries of `table`.
    ///
    /// # Panics
    /// If the table is shorter than the indices' bound.
    fn gather(table: &[[f32; 4]], index: IndexRow<'_>) -> [Self; 4];
    /// `list`, shorter than [`LANES`], with `fill` after its end.
    fn padded(list: &[u32], fill: u32) -> [u32; LANES];
    /// Moves those of `row` where the mask is set to the front of `out`, in their order, and returns how many
    /// there are. What follows them in `out` is unspecified.
    fn compress(mask: Self::Mask, row: &[u32; LANES], out: &mut [u32; LANES]) -> usize;

    /// 1/√ of each lane.
    #[inline(always)]
    fn inverse_sqrt(self) -> Self {
        Self::splat(1.0) / self.sqrt()
    }

    /// eˣ of x ≤ 0 to 2 units in the last place; 0 below -87.
    #[inline(always)]
    fn exp(self) -> Self {
        let lowest = Self::splat(-87.0);
        let underflows = self.less(lowest);
        let x = Self::select(underflows, lowest, self);
        // x = n ln 2 + r: the sum with 1.5 · 2²³ rounds to a whole number.
        let rounding = Self::splat(12_582_912.0);
        let shifted = x * Self::splat(std::f32::consts::LOG2_E) + rounding;
        let n = shifted - rounding;
        let r = (x - n * Self::splat(0.693_359_4)) + n * Self::splat(2.121_944_4e-4);
        let mut p = Self::splat(1.987_569_1e-4);
        for c in [1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5] {
            p = p * r + Self::splat(c);
        }
        let e = ((p * r) * r + r + Self::splat(1.0)) * shifted.power_of_two();
        Self::select(underflows, Self::splat(0.0), e)
    }
}

/// One number in every lane.
#[inline(always)]
pub fn splat<L: Lanes>(value: f32) -> L {
    L::splat(value)
}

/// Σ of eight numbers: halves, quarters, pairs.
#[inline(always)]
pub fn sum(a: F32x8) -> f32 {
    ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
}
