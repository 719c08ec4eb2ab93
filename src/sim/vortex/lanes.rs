//! Eight numbers at a time: the arithmetic that loops over vortons are written in.
//!
//! A [`Pass`] is generic over [`Lanes`]. [`Eight`] is the readable reference; the AVX2 twin beside it rounds alike (no
//! fused operations, the same order of sums), so both give the same bits.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Numbers handled at once.
pub(super) const LANES: usize = 8;

/// Work written once for every form.
pub(super) trait Pass {
    /// What it finds.
    type Out;
    /// Does the work. To be inlined always, with all that it calls.
    fn run<L: Lanes>(self) -> Self::Out;
}

/// Does the work in the fastest form that the processor runs.
pub(super) fn run<W: Pass>(pass: W) -> W::Out {
    #[cfg(test)]
    if tests::REFERENCE_ONLY.get() {
        return pass.run::<Eight>();
    }
    #[cfg(target_arch = "x86_64")]
    if super::lanes_avx2::available() {
        return super::lanes_avx2::run(pass);
    }
    pass.run::<Eight>()
}

/// Eight numbers.
pub(super) trait Lanes:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
    /// The same number in every lane.
    fn splat(value: f32) -> Self;
    /// Eight numbers in a row.
    fn load(row: &[f32; LANES]) -> Self;
    /// The numbers as a row.
    fn row(self) -> [f32; LANES];
    fn sqrt(self) -> Self;
    /// `yes` where `self` < `bound`, else `no`.
    fn below(self, bound: Self, yes: Self, no: Self) -> Self;
    /// 2ⁿ of lanes that hold 1.5 · 2²³ + n, n in -126..=127.
    fn power_of_two(self) -> Self;
    /// Eight rows as columns.
    fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES];
    /// Σ over lanes: halves, quarters, pairs.
    fn sum(self) -> f32;

    /// 1/√.
    #[inline(always)]
    fn inverse_root(self) -> Self {
        Self::splat(1.0) / self.sqrt()
    }

    /// eˣ of x ≤ 0 to 2 in the last place; 0 below -87.
    #[inline(always)]
    fn exp(self) -> Self {
        let lowest = Self::splat(-87.0);
        let x = self.below(lowest, lowest, self);
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
        self.below(lowest, Self::splat(0.0), e)
    }
}

/// The same number in every lane.
#[inline(always)]
pub(super) fn splat<L: Lanes>(value: f32) -> L {
    L::splat(value)
}

/// The reference form.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Eight([f32; LANES]);

impl Eight {
    #[inline(always)]
    fn with(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|lane| f(self.0[lane], other.0[lane])))
    }
}

macro_rules! operator {
    ($trait:ident, $method:ident, $sign:tt) => {
        impl $trait for Eight {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.with(other, |a, b| a $sign b)
            }
        }
    };
}

operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl AddAssign for Eight {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for Eight {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(self.0.map(|a| -a))
    }
}

impl Lanes for Eight {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    #[inline(always)]
    fn load(row: &[f32; LANES]) -> Self {
        Self(*row)
    }

    #[inline(always)]
    fn row(self) -> [f32; LANES] {
        self.0
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.map(f32::sqrt))
    }

    #[inline(always)]
    fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|k| if self.0[k] < bound.0[k] { yes.0[k] } else { no.0[k] }))
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        Self(self.0.map(|a| f32::from_bits((a.to_bits() << 23).wrapping_add(0x3f80_0000))))
    }

    #[inline(always)]
    fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES] {
        std::array::from_fn(|column| Self(rows.map(|row| row[column])))
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        let a = self.0;
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::cell::Cell;

    thread_local! {
        /// Whether passes on this thread take the reference form.
        pub(in crate::sim::vortex) static REFERENCE_ONLY: Cell<bool> = const { Cell::new(false) };
    }

    /// Every operation on awkward numbers, as bits.
    struct Everything;

    impl Pass for Everything {
        type Out = Vec<[u32; LANES]>;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let mut x = 0.37_f32;
            let mut rows = [[0.0; LANES]; LANES];
            for value in rows.iter_mut().flatten() {
                x = (x * 79.1 + 0.013) % 7.3;
                *value = x - 3.1;
            }
            rows[3] = [0.0, -0.0, 1e-40, 3e38, f32::NAN, f32::INFINITY, 1.0, -1e-20];
            let columns = L::columns(std::array::from_fn(|k| &rows[k]));
            let mut bits = Vec::new();
            for k in 0..LANES {
                let (a, b) = (L::load(&rows[k]), columns[k]);
                let squared = a * a;
                let mut added = a;
                added += b;
                let cold = -squared * squared * squared;
                for result in [
                    added,
                    a - b,
                    a * b,
                    a / b,
                    -a,
                    squared.sqrt(),
                    squared.inverse_root(),
                    a.below(b, b, squared),
                    L::splat(squared.sum()),
                    cold.exp(),
                    (L::splat(12_582_912.0) + L::splat(k as f32 - 4.0)).power_of_two(),
                ] {
                    bits.push(result.row().map(|v| if v.is_nan() { 0 } else { v.to_bits() }));
                }
            }
            bits
        }
    }

    #[test]
    fn both_forms_round_alike() {
        let reference = Everything.run::<Eight>();
        assert_eq!(run(Everything), reference);
        assert_eq!(reference[10][0], 2.0_f32.powi(-4).to_bits());
    }

    #[test]
    fn the_exponential_is_good_to_two_in_the_last_place() {
        for k in 0..1970 {
            let x = -0.044 * k as f32;
            let (found, exact) = (f64::from(Eight::splat(x).exp().row()[0]), f64::from(x).exp());
            assert!((found / exact - 1.0).abs() < 2.0 * f64::from(f32::EPSILON), "{x}: {found} {exact}");
        }
        assert_eq!(Eight::splat(-87.1).exp().row()[0], 0.0);
    }
}
