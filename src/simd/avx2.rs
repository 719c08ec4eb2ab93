//! The AVX2 form of [`Lanes`].
//!
//! *Method*: one register holds eight numbers. No fused operations, and sums in the reference's order, so the
//! bits are those of `scalar.rs`.
#![allow(unsafe_code)] // Vector instructions, and the call into code for processors that have AVX2.

use super::{F32x8, IndexRow, LANES, Lanes, Pass};
use std::{
    arch::x86_64::*,
    ops::{Add, AddAssign, Div, Mul, Neg, Sub},
};

/// Runs a pass with AVX2; returns it where the processor has no AVX2.
#[inline]
pub(super) fn run<P: Pass>(pass: P) -> Result<P::Out, P> {
    if is_supported() {
        // SAFETY: both features were detected.
        Ok(unsafe { with_avx2(pass) })
    } else {
        Err(pass)
    }
}

/// Whether the processor has what [`with_avx2`] needs.
#[inline]
pub(super) fn is_supported() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("popcnt")
}

#[target_feature(enable = "avx2,popcnt")]
fn with_avx2<P: Pass>(pass: P) -> P::Out {
    pass.run::<Avx2Lanes>()
}

/// Eight numbers in a register. Only passes under [`with_avx2`] can name this type, as their parameter `L`,
/// so every use runs on a processor that has AVX2.
#[derive(Clone, Copy)]
struct Avx2Lanes(__m256);

macro_rules! operator {
    ($trait:ident, $method:ident, $instruction:ident) => {
        impl $trait for Avx2Lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: see `Avx2Lanes`.
                Self(unsafe { $instruction(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);

impl AddAssign for Avx2Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Neg for Avx2Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_xor_ps(self.0, _mm256_set1_ps(-0.0)) })
    }
}

impl Lanes for Avx2Lanes {
    type Mask = Avx2Mask;

    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(row: &F32x8) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_loadu_ps(row.as_ptr()) })
    }

    #[inline(always)]
    fn to_array(self) -> F32x8 {
        let mut row = [0.0; LANES];
        // SAFETY: see `Avx2Lanes`.
        unsafe { _mm256_storeu_ps(row.as_mut_ptr(), self.0) };
        row
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn abs(self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0) })
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn positive_part(self) -> Self {
        // The instruction returns its second operand where one is NaN. SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_max_ps(_mm256_setzero_ps(), self.0) })
    }

    #[inline(always)]
    fn zero_indicator(self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe {
            let equal = _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, _mm256_setzero_ps());
            _mm256_and_ps(equal, _mm256_set1_ps(1.0))
        })
    }

    #[inline(always)]
    fn power_of_two(self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe {
            let shifted = _mm256_slli_epi32::<23>(_mm256_castps_si256(self.0));
            _mm256_castsi256_ps(_mm256_add_epi32(shifted, _mm256_set1_epi32(0x3f80_0000)))
        })
    }

    #[inline(always)]
    fn less(self, other: Self) -> Avx2Mask {
        // SAFETY: see `Avx2Lanes`.
        Avx2Mask(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn equal(row: &[u32; LANES], index: u32) -> Avx2Mask {
        // SAFETY: see `Avx2Lanes`.
        Avx2Mask(unsafe {
            let row = _mm256_loadu_si256(row.as_ptr().cast());
            _mm256_castsi256_ps(_mm256_cmpeq_epi32(row, _mm256_set1_epi32(index as i32)))
        })
    }

    #[inline(always)]
    fn and(a: Avx2Mask, b: Avx2Mask) -> Avx2Mask {
        // SAFETY: see `Avx2Lanes`.
        Avx2Mask(unsafe { _mm256_and_ps(a.0, b.0) })
    }

    #[inline(always)]
    fn and_not(a: Avx2Mask, b: Avx2Mask) -> Avx2Mask {
        // SAFETY: see `Avx2Lanes`.
        Avx2Mask(unsafe { _mm256_andnot_ps(b.0, a.0) })
    }

    #[inline(always)]
    fn bits(mask: Avx2Mask) -> u8 {
        // SAFETY: see `Avx2Lanes`.
        unsafe { _mm256_movemask_ps(mask.0) as u8 }
    }

    #[inline(always)]
    fn select(mask: Avx2Mask, yes: Self, no: Self) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }

    #[inline(always)]
    fn shifted_up(self, first: f32) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe {
            let up = _mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6);
            _mm256_blend_ps::<1>(_mm256_permutevar8x32_ps(self.0, up), _mm256_set1_ps(first))
        })
    }

    #[inline(always)]
    fn shifted_down(self, last: f32) -> Self {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe {
            let down = _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7);
            _mm256_blend_ps::<128>(_mm256_permutevar8x32_ps(self.0, down), _mm256_set1_ps(last))
        })
    }

    #[inline(always)]
    fn transpose(rows: [&F32x8; LANES]) -> [Self; LANES] {
        // SAFETY: see `Avx2Lanes`; a row holds four numbers from 0 and four from 4 on.
        unsafe {
            let mut out = [Self(_mm256_setzero_ps()); LANES];
            for half in 0..2 {
                // Halves of rows 0 to 3 side by side with those of rows 4 to 7.
                let load = |k: usize| {
                    let low = _mm_loadu_ps(rows[k].as_ptr().add(4 * half));
                    let high = _mm_loadu_ps(rows[k + 4].as_ptr().add(4 * half));
                    _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(low), high)
                };
                [out[4 * half], out[4 * half + 1], out[4 * half + 2], out[4 * half + 3]] =
                    transpose_4x4(load(0), load(1), load(2), load(3));
            }
            out
        }
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: see `Avx2Lanes`.
        unsafe {
            let halves = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let quarters = _mm_add_ps(halves, _mm_movehl_ps(halves, halves));
            _mm_cvtss_f32(_mm_add_ss(quarters, _mm_movehdup_ps(quarters)))
        }
    }

    #[inline(always)]
    fn sums(each: &[Self; LANES]) -> F32x8 {
        // SAFETY: see `Avx2Lanes`.
        Self(unsafe {
            let (a, b) = (quarter_sums(each, 0), quarter_sums(each, 2));
            let even = _mm256_shuffle_ps::<0b10_00_10_00>(a, b);
            _mm256_add_ps(even, _mm256_shuffle_ps::<0b11_01_11_01>(a, b))
        })
        .to_array()
    }

    #[inline(always)]
    fn gather(table: &[[f32; 4]], index: IndexRow<'_>) -> [Self; 4] {
        let index = index.within(table.len());
        // SAFETY: see `Avx2Lanes`; `within` has checked that every index is below the table's length.
        unsafe {
            let (a, b) = (pair(table, index, 0), pair(table, index, 1));
            let (c, d) = (pair(table, index, 2), pair(table, index, 3));
            transpose_4x4(a, b, c, d)
        }
    }

    #[inline(always)]
    fn padded(list: &[u32], fill: u32) -> [u32; LANES] {
        let mut padded = [fill; LANES];
        // SAFETY: see `Avx2Lanes`; only the lanes below the list's length are read.
        unsafe {
            let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let listed = _mm256_cmpgt_epi32(_mm256_set1_epi32(list.len() as i32), lane);
            let read = _mm256_maskload_epi32(list.as_ptr().cast(), listed);
            let all = _mm256_blendv_epi8(_mm256_set1_epi32(fill as i32), read, listed);
            _mm256_storeu_si256(padded.as_mut_ptr().cast(), all);
        }
        padded
    }

    #[inline(always)]
    fn compress(mask: Avx2Mask, row: &[u32; LANES], out: &mut [u32; LANES]) -> usize {
        let bits = Self::bits(mask);
        // SAFETY: see `Avx2Lanes`; a row of the table holds eight numbers.
        unsafe {
            let lanes = _mm256_loadu_si256(SET_LANES[bits as usize].as_ptr().cast());
            let packed = _mm256_permutevar8x32_epi32(_mm256_loadu_si256(row.as_ptr().cast()), lanes);
            _mm256_storeu_si256(out.as_mut_ptr().cast(), packed);
        }
        bits.count_ones() as usize
    }
}

/// A truth value for each lane: all bits of the lane, or none.
#[derive(Clone, Copy)]
struct Avx2Mask(__m256);

/// For every pattern of a mask, the lanes that are set, in ascending order.
static SET_LANES: [[u32; LANES]; 256] = set_lanes();

const fn set_lanes() -> [[u32; LANES]; 256] {
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

/// Two 4×4 transpositions side by side, of the lower and the upper halves.
#[inline(always)]
unsafe fn transpose_4x4(a: __m256, b: __m256, c: __m256, d: __m256) -> [Avx2Lanes; 4] {
    // SAFETY: the caller has AVX2.
    unsafe {
        let (xy_ab, zw_ab) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
        let (xy_cd, zw_cd) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
        [
            Avx2Lanes(_mm256_shuffle_ps::<0b01_00_01_00>(xy_ab, xy_cd)),
            Avx2Lanes(_mm256_shuffle_ps::<0b11_10_11_10>(xy_ab, xy_cd)),
            Avx2Lanes(_mm256_shuffle_ps::<0b01_00_01_00>(zw_ab, zw_cd)),
            Avx2Lanes(_mm256_shuffle_ps::<0b11_10_11_10>(zw_ab, zw_cd)),
        ]
    }
}

/// Entries `low` and `low + 4` of the eight, side by side.
#[inline(always)]
unsafe fn pair(table: &[[f32; 4]], index: &[u32; LANES], low: usize) -> __m256 {
    // SAFETY: the caller has AVX2 and has checked every index.
    unsafe {
        let first = _mm_loadu_ps(table.as_ptr().add(index[low] as usize).cast());
        let second = _mm_loadu_ps(table.as_ptr().add(index[low + 4] as usize).cast());
        _mm256_insertf128_ps::<1>(_mm256_castps128_ps256(first), second)
    }
}

/// The sums of the lanes' halves, of vectors `k` and `k + 4`.
#[inline(always)]
unsafe fn half_sums(each: &[Avx2Lanes; LANES], k: usize) -> __m256 {
    let (a, b) = (each[k].0, each[k + 4].0);
    // SAFETY: the caller has AVX2.
    unsafe { _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b)) }
}

/// The sums of the lanes' quarters, of vectors `k`, `k + 1` and those four further.
#[inline(always)]
unsafe fn quarter_sums(each: &[Avx2Lanes; LANES], k: usize) -> __m256 {
    // SAFETY: the caller has AVX2.
    unsafe {
        let (a, b) = (_mm256_castps_pd(half_sums(each, k)), _mm256_castps_pd(half_sums(each, k + 1)));
        let (low, high) = (_mm256_unpacklo_pd(a, b), _mm256_unpackhi_pd(a, b));
        _mm256_add_ps(_mm256_castpd_ps(low), _mm256_castpd_ps(high))
    }
}
