//! The AVX2 twin of the reference [`Lanes`].
//!
//! *Method*: eight nodes are eight loads of sixteen bytes, turned into four vectors by two 4×4 transpositions side by
//! side. No fused operations, and sums in the reference's order.
#![allow(unsafe_code)] // Vector instructions, and the call into code for processors that have AVX2.

use super::{
    lanes::{Index, LANES, Lanes, Node},
    pair::Pair,
    pass::Pass,
};
use std::{
    arch::x86_64::*,
    ops::{Add, Div, Mul, Sub},
};

/// Whether the processor runs the twin.
#[inline]
pub(super) fn available() -> bool {
    is_x86_feature_detected!("avx2")
}

/// Does `pass` with AVX2.
pub(super) fn run<W: Pass, P: Pair>(pass: W) -> W::Out {
    assert!(available(), "asked for where it does not run");
    // SAFETY: the feature was found.
    unsafe { with_avx2::<W, P>(pass) }
}

#[target_feature(enable = "avx2")]
fn with_avx2<W: Pass, P: Pair>(pass: W) -> W::Out {
    pass.run::<Avx2, P>()
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

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn positive(self) -> Self {
        // The second operand wins where one is a NaN. SAFETY: see `Avx2`.
        Self(unsafe { _mm256_max_ps(_mm256_setzero_ps(), self.0) })
    }

    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
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
    fn is_zero(self) -> Self {
        // SAFETY: see `Avx2`.
        Self(unsafe {
            let equal = _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, _mm256_setzero_ps());
            _mm256_and_ps(equal, _mm256_set1_ps(1.0))
        })
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

    #[inline(always)]
    fn sums(each: &[Self; LANES]) -> [f32; LANES] {
        // SAFETY: see `Avx2`.
        Self(unsafe {
            let (a, b) = (quarters(each, 0), quarters(each, 2));
            let even = _mm256_shuffle_ps::<0b10_00_10_00>(a, b);
            _mm256_add_ps(even, _mm256_shuffle_ps::<0b11_01_11_01>(a, b))
        })
        .row()
    }

    #[inline(always)]
    fn filled_up(list: &[u32], own: u32) -> [u32; LANES] {
        let mut filled = [own; LANES];
        // SAFETY: see `Avx2`; only the lanes below the list's length are read.
        unsafe {
            let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let listed = _mm256_cmpgt_epi32(_mm256_set1_epi32(list.len() as i32), lane);
            let read = _mm256_maskload_epi32(list.as_ptr().cast(), listed);
            let all = _mm256_blendv_epi8(_mm256_set1_epi32(own as i32), read, listed);
            _mm256_storeu_si256(filled.as_mut_ptr().cast(), all);
        }
        filled
    }

    #[inline(always)]
    fn gather(nodes: &[Node], index: Index<'_>) -> [Self; 4] {
        let index = index.within(nodes);
        // SAFETY: see `Avx2`; `by_eights` holds only places below its count, which `within` found to be that of nodes.
        unsafe {
            let (a, b) = (pair(nodes, index, 0), pair(nodes, index, 1));
            let (c, d) = (pair(nodes, index, 2), pair(nodes, index, 3));
            let (xy_ab, zw_ab) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
            let (xy_cd, zw_cd) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
            [
                Self(_mm256_shuffle_ps::<0b01_00_01_00>(xy_ab, xy_cd)),
                Self(_mm256_shuffle_ps::<0b11_10_11_10>(xy_ab, xy_cd)),
                Self(_mm256_shuffle_ps::<0b01_00_01_00>(zw_ab, zw_cd)),
                Self(_mm256_shuffle_ps::<0b11_10_11_10>(zw_ab, zw_cd)),
            ]
        }
    }
}

/// Nodes `low` and `low + 4` of the eight, side by side.
#[inline(always)]
unsafe fn pair(nodes: &[Node], index: &[u32; LANES], low: usize) -> __m256 {
    // SAFETY: the caller has AVX2 and has checked every index; nodes are aligned.
    unsafe {
        let first = _mm_load_ps(nodes.as_ptr().add(index[low] as usize).cast());
        let second = _mm_load_ps(nodes.as_ptr().add(index[low + 4] as usize).cast());
        _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(first), second)
    }
}

/// The lanes' halves added, of numbers `k` and `k + 4`.
#[inline(always)]
unsafe fn halves(each: &[Avx2; LANES], k: usize) -> __m256 {
    let (a, b) = (each[k].0, each[k + 4].0);
    // SAFETY: the caller has AVX2.
    unsafe { _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b)) }
}

/// The lanes' quarters added, of numbers `k`, `k + 1` and those four further.
#[inline(always)]
unsafe fn quarters(each: &[Avx2; LANES], k: usize) -> __m256 {
    // SAFETY: the caller has AVX2.
    unsafe {
        let (a, b) = (_mm256_castps_pd(halves(each, k)), _mm256_castps_pd(halves(each, k + 1)));
        let (low, high) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        _mm256_add_ps(_mm256_castpd_ps(low), _mm256_castpd_ps(high))
    }
}
