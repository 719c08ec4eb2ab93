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

#[inline]
#[target_feature(enable = "avx2")]
fn store(row: &mut [f32; LANES], value: __m256) {
    // SAFETY: the array holds eight numbers.
    unsafe { _mm256_storeu_ps(row.as_mut_ptr(), value) }
}

/// One ascending pass over a group of rows in two layers.
#[target_feature(enable = "avx2")]
fn relax(rows: Rows<'_>, band: f32) -> bool {
    let Rows { before, own: [lower, upper], behind, low, high } = rows;
    let steps = before.len();
    assert!([lower.len(), upper.len(), behind.len()] == [steps; 3], "layers are alike");
    assert!(low.iter().chain(&high).all(|row| row.len() == steps), "rows are alike");
    let sign = _mm256_set1_ps(-0.0);
    let mut changed = false;
    // Of each layer the sizes of the step before, and the step that is next.
    let mut previous = [_mm256_andnot_ps(sign, load(&lower[0])), _mm256_andnot_ps(sign, load(&upper[0]))];
    let mut here = [load(&lower[1]), load(&upper[1])];
    for step in 1..steps {
        let mut new = here[0];
        if step + 1 < steps {
            let next = load(&lower[step + 1]);
            let z = least(load(&before[step]), load(&upper[step]));
            let nearest = nearest(previous[0], next, low[0][step], high[0][step], z);
            if let Some(lowered) = update(here[0], nearest, band) {
                store(&mut lower[step], lowered);
                (new, changed) = (lowered, true);
            }
            here[0] = next;
        }
        // The upper layer is a step behind: `previous` is what the lower one holds there.
        if step > 1 {
            let step = step - 1;
            let next = load(&upper[step + 1]);
            let z = least(previous[0], load(&behind[step]));
            let nearest = nearest(previous[1], next, low[1][step], high[1][step], z);
            let mut new = here[1];
            if let Some(lowered) = update(here[1], nearest, band) {
                store(&mut upper[step], lowered);
                (new, changed) = (lowered, true);
            }
            previous[1] = _mm256_andnot_ps(sign, new);
            here[1] = next;
        }
        previous[0] = _mm256_andnot_ps(sign, new);
    }
    changed
}

/// The smaller size of two numbers.
#[inline]
#[target_feature(enable = "avx2")]
fn least(a: __m256, b: __m256) -> __m256 {
    let sign = _mm256_set1_ps(-0.0);
    _mm256_min_ps(_mm256_andnot_ps(sign, a), _mm256_andnot_ps(sign, b))
}

/// The smaller neighbour of each axis: `previous` holds sizes, `low` and `high` what the outer lanes read.
#[inline]
#[target_feature(enable = "avx2")]
fn nearest(previous: __m256, next: __m256, low: f32, high: f32, z: __m256) -> [__m256; 3] {
    let (up, down) = (_mm256_setr_epi32(0, 0, 1, 2, 3, 4, 5, 6), _mm256_setr_epi32(1, 2, 3, 4, 5, 6, 7, 7));
    let next = _mm256_andnot_ps(_mm256_set1_ps(-0.0), next);
    let y_low = _mm256_blend_ps::<1>(_mm256_permutevar8x32_ps(previous, up), _mm256_set1_ps(low));
    let y_high = _mm256_blend_ps::<128>(_mm256_permutevar8x32_ps(next, down), _mm256_set1_ps(high));
    [_mm256_min_ps(previous, next), _mm256_min_ps(y_low, y_high), z]
}

/// `godunov::update` for eight nodes: their numbers if that lowers any.
#[inline]
#[target_feature(enable = "avx2")]
fn update(own: __m256, [x, y, z]: [__m256; 3], band: f32) -> Option<__m256> {
    // `godunov::lowered`
    let (zero, one) = (_mm256_setzero_ps(), _mm256_set1_ps(1.0));
    let most = _mm256_min_ps(own, _mm256_set1_ps(if band < 1e18 { band } else { 1e18 }));
    let slope_x = _mm256_max_ps(_mm256_sub_ps(most, x), zero);
    let slope_y = _mm256_max_ps(_mm256_sub_ps(most, y), zero);
    let slope_z = _mm256_max_ps(_mm256_sub_ps(most, z), zero);
    let xy = _mm256_add_ps(_mm256_mul_ps(slope_x, slope_x), _mm256_mul_ps(slope_y, slope_y));
    let sum = _mm256_add_ps(xy, _mm256_mul_ps(slope_z, slope_z));
    let lowered = _mm256_cmp_ps::<_CMP_GT_OQ>(sum, one);
    if _mm256_movemask_ps(lowered) == 0 {
        return None;
    }

    // `godunov::godunov`
    let (low, high) = (_mm256_min_ps(x, y), _mm256_max_ps(x, y));
    let (a, middle) = (_mm256_min_ps(low, z), _mm256_max_ps(low, z));
    let b = _mm256_sub_ps(_mm256_min_ps(middle, high), a);
    let c = _mm256_sub_ps(_mm256_max_ps(middle, high), a);
    let (half, three) = (_mm256_set1_ps(0.5), _mm256_set1_ps(3.0));
    let bb = _mm256_mul_ps(b, b);
    let root = _mm256_sqrt_ps(_mm256_sub_ps(_mm256_set1_ps(2.0), bb));
    let of_two = _mm256_mul_ps(half, _mm256_add_ps(b, root));
    let (s, q) = (_mm256_add_ps(b, c), _mm256_add_ps(bb, _mm256_mul_ps(c, c)));
    let rest = _mm256_mul_ps(three, _mm256_sub_ps(q, one));
    let under = _mm256_max_ps(_mm256_sub_ps(_mm256_mul_ps(s, s), rest), zero);
    let of_three = _mm256_div_ps(_mm256_add_ps(s, _mm256_sqrt_ps(under)), three);
    let takes_two = _mm256_cmp_ps::<_CMP_GT_OQ>(one, b);
    let u = _mm256_blendv_ps(one, of_two, takes_two);
    let takes_three = _mm256_and_ps(takes_two, _mm256_cmp_ps::<_CMP_GT_OQ>(u, c));
    let u = _mm256_add_ps(a, _mm256_blendv_ps(u, of_three, takes_three));

    let below = _mm256_and_ps(
        _mm256_cmp_ps::<_CMP_LT_OQ>(u, own),
        _mm256_cmp_ps::<_CMP_LT_OQ>(u, _mm256_set1_ps(band)),
    );
    let lowers = _mm256_and_ps(below, lowered);
    if _mm256_movemask_ps(lowers) == 0 {
        return None;
    }
    Some(_mm256_blendv_ps(own, u, lowers))
}
