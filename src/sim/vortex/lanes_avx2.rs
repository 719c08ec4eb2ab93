//! The AVX2 twin of the reference [`Lanes`]. No fused operations, and sums in the reference's order.
#![allow(unsafe_code)] // Vector instructions, and the call into code for processors that have AVX2.

use super::lanes::{LANES, Lanes, Pass};
use std::{
    arch::x86_64::*,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub},
};

/// Whether the processor runs the twin.
#[inline]
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx2")
}

/// Does `pass` with AVX2.
pub(super) fn run<W: Pass>(pass: W) -> W::Out {
    assert!(available(), "asked for where it does not run");
    // SAFETY: the feature was found.
    unsafe { with_avx2(pass) }
}

#[target_feature(enable = "avx2")]
fn with_avx2<W: Pass>(pass: W) -> W::Out {
    pass.run::<Avx2>()
}

/// Eight numbers in a register. Only [`with_avx2`] makes one, so every use runs where AVX2 was found.
#[derive(Clone, Copy)]
struct Avx2(__m256);

macro_rules! operator {
    ($trait:ident, $method:ident, $instruction:ident) => {
        impl $trait for Avx2 {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: see `Avx2`.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);

impl AddAssign for Avx2 {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(row: &[f32; LANES]) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_loadu_ps(row.as_ptr()) })
    }

    #[inline(always)]
    fn row(self) -> [f32; LANES] {
        let mut row = [0.0; LANES];
        // SAFETY: see `Avx2`.
        unsafe { _mm256_storeu_ps(row.as_mut_ptr(), self.0) };
        row
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn below(self, bound: Self, yes: Self, no: Self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, bound.0)) })
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe {
            let shifted = _mm256_slli_epi32::<23>(_mm256_castps_si256(self.0));
            _mm256_castsi256_ps(_mm256_add_epi32(shifted, _mm256_set1_epi32(0x3f80_0000)))
        })
    }

    #[inline(always)]
    fn columns(rows: [&[f32; LANES]; LANES]) -> [Self; LANES] {
        // Halves of rows 0 to 3 beside those of rows 4 to 7, then two 4×4 transpositions side by side.
        // SAFETY: see `Avx2`.
        unsafe {
            let mut out = [Self(_mm256_setzero_ps()); LANES];
            for half in 0..2 {
                let load = |k: usize| {
                    let low = _mm_loadu_ps(rows[k].as_ptr().add(4 * half));
                    let high = _mm_loadu_ps(rows[k + 4].as_ptr().add(4 * half));
                    _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(low), high)
                };
                let (a, b, c, d) = (load(0), load(1), load(2), load(3));
                let (ab, ab2) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let (cd, cd2) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
                out[4 * half] = Self(_mm256_shuffle_ps::<0b01_00_01_00>(ab, cd));
                out[4 * half + 1] = Self(_mm256_shuffle_ps::<0b11_10_11_10>(ab, cd));
                out[4 * half + 2] = Self(_mm256_shuffle_ps::<0b01_00_01_00>(ab2, cd2));
                out[4 * half + 3] = Self(_mm256_shuffle_ps::<0b11_10_11_10>(ab2, cd2));
            }
            out
        }
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: see `Avx2`.
        unsafe {
            let halves = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let quarters = _mm_add_ps(halves, _mm_movehl_ps(halves, halves));
            _mm_cvtss_f32(_mm_add_ss(quarters, _mm_movehdup_ps(quarters)))
        }
    }
}
