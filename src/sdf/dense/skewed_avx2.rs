//! The AVX2 twin of `skewed::relax`: the eight rows of a step in one register.
//!
//! *Method*: both halves of the equation's cases are computed and selected from, in the order of operations of
//! `godunov.rs` and without fused ones, so the bits are the reference's. Where no lane is lowered, nothing is solved.
#![allow(unsafe_code)] // Vector loads and stores, and the call into code for processors that have AVX2.

use super::skewed::{LANES, Relax, Rows, Skewed};
use std::arch::x86_64::*;

/// The twin, where the processor runs it.
pub(super) fn available() -> Option<Relax> {
    is_x86_feature_detected!("avx2").then_some(|block: &mut Skewed, band: f32| {
        // SAFETY: this closure leaves the function only where the feature was found.
        block.for_each_group(|rows| unsafe { relax(rows, band) })
    })
}

/// Eight numbers.
#[inline]
#[target_feature(enable = "avx2")]
fn load(row: &[f32; LANES]) -> __m256 {
    // SAFETY: the array holds eight numbers.
    unsafe { _mm256_loadu_ps(row.as_ptr()) }
}

/// One ascending pass over a group of rows.
#[target_feature(enable = "avx2")]
fn relax(rows: Rows<'_>, band: f32) -> bool {
    let Rows { before, own, behind, low, high } = rows;
    let steps = own.len();
    assert!([before.len(), behind.len(), low.len(), high.len()] == [steps; 4], "rows are alike");
    let sign = _mm256_set1_ps(-0.0);
    let (up, down) = (_mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6), _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7));
    let most = _mm256_set1_ps(if band < 1e18 { band } else { 1e18 });
    let (one, band) = (_mm256_set1_ps(1.0), _mm256_set1_ps(band));
    let mut changed = false;
    let mut previous = _mm256_andnot_ps(sign, load(&own[0]));
    let mut here = load(&own[1]);
    for step in 1..steps - 1 {
        // The smaller neighbour of each axis.
        let next = load(&own[step + 1]);
        let next_size = _mm256_andnot_ps(sign, next);
        let y_low = _mm256_permutevar8x32_ps(previous, up);
        let y_low = _mm256_blend_ps::<1>(y_low, _mm256_set1_ps(low[step]));
        let y_high = _mm256_permutevar8x32_ps(next_size, down);
        let y_high = _mm256_blend_ps::<128>(y_high, _mm256_set1_ps(high[step]));
        let x = _mm256_min_ps(previous, next_size);
        let y = _mm256_min_ps(y_low, y_high);
        let z_low = _mm256_andnot_ps(sign, load(&before[step]));
        let z_high = _mm256_andnot_ps(sign, load(&behind[step]));
        let z = _mm256_min_ps(z_low, z_high);

        // `lowered`
        let zero = _mm256_setzero_ps();
        let limit = _mm256_min_ps(here, most);
        let slope_x = _mm256_max_ps(_mm256_sub_ps(limit, x), zero);
        let slope_y = _mm256_max_ps(_mm256_sub_ps(limit, y), zero);
        let slope_z = _mm256_max_ps(_mm256_sub_ps(limit, z), zero);
        let xy = _mm256_add_ps(_mm256_mul_ps(slope_x, slope_x), _mm256_mul_ps(slope_y, slope_y));
        let sum = _mm256_add_ps(xy, _mm256_mul_ps(slope_z, slope_z));
        let lowered = _mm256_cmp_ps::<_CMP_GT_OQ>(sum, one);
        let mut new = here;
        if _mm256_movemask_ps(lowered) != 0 {
            // `godunov`
            let (a, high) = (_mm256_min_ps(x, y), _mm256_max_ps(x, y));
            let (a, middle) = (_mm256_min_ps(a, z), _mm256_max_ps(a, z));
            let b = _mm256_sub_ps(_mm256_min_ps(middle, high), a);
            let c = _mm256_sub_ps(_mm256_max_ps(middle, high), a);
            let half = _mm256_set1_ps(0.5);
            let bb = _mm256_mul_ps(b, b);
            let root = _mm256_sqrt_ps(_mm256_sub_ps(_mm256_set1_ps(2.0), bb));
            let two = _mm256_mul_ps(half, _mm256_add_ps(b, root));
            let (s, q) = (_mm256_add_ps(b, c), _mm256_add_ps(bb, _mm256_mul_ps(c, c)));
            let three = _mm256_set1_ps(3.0);
            let rest = _mm256_mul_ps(three, _mm256_sub_ps(q, one));
            let under = _mm256_max_ps(_mm256_sub_ps(_mm256_mul_ps(s, s), rest), zero);
            let all = _mm256_div_ps(_mm256_add_ps(s, _mm256_sqrt_ps(under)), three);
            let takes_two = _mm256_cmp_ps::<_CMP_GT_OQ>(one, b);
            let u = _mm256_blendv_ps(one, two, takes_two);
            let takes_all = _mm256_and_ps(takes_two, _mm256_cmp_ps::<_CMP_GT_OQ>(u, c));
            let u = _mm256_add_ps(a, _mm256_blendv_ps(u, all, takes_all));

            // `update`
            let lower =
                _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(u, here), _mm256_cmp_ps::<_CMP_LT_OQ>(u, band));
            let lower = _mm256_and_ps(lower, lowered);
            new = _mm256_blendv_ps(here, u, lower);
            changed |= _mm256_movemask_ps(lower) != 0;
            // SAFETY: an array holds eight numbers.
            unsafe { _mm256_storeu_ps(own[step].as_mut_ptr(), new) };
        }
        previous = _mm256_andnot_ps(sign, new);
        here = next;
    }
    changed
}
