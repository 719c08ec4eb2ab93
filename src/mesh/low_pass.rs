//! Low-pass filter for smoothing, as a polynomial.
//!
//! *Method* [taubin96]: the coefficients c_k of an ideal low pass in θ = arccos(eigenvalue of M) under a
//! window, for P(M) = Σ c_k T_k(M) with Chebyshev polynomials T_k.
//! *Departs from the paper*: the window is that of [kaiser74], which needs three fifths of the degree of the
//! paper's for the same cutoff. The coefficients are divided by their sum, so that constants pass exactly.
//! The result is R = (P − 1)/(M − 1), of which R(M)(M − 1) x is the displacement by the filter. It acts on
//! small vectors, so that a mesh far from the origin loses no digits.
//!
//! Symbols: Λ → `wavelength` [m]; ℓ → root mean square edge [m]; θ₀ → `cutoff` [rad]; r_k → coefficients of
//! R.

use crate::math::elementary::{acos, sin};
use std::f64::consts::PI;

/// Degree of the filter times θ₀. If it is smaller, the cutoff is so gradual that long waves shrink and short
/// ones remain; larger only makes it sharper, for more time. A Hamming window needs 5 for the same.
const DEGREE: f64 = 3.0;

/// Shape β of the window. If it is smaller, more than a thirtieth of the shortest waves passes; larger makes
/// the cutoff more gradual.
const WINDOW_SHAPE: f64 = 2.6;

/// Cutoff θ₀ of waves of length `wavelength` on edges of length `edge`: on a regular mesh the umbrella
/// operator has the eigenvalue 1 − (π ℓ/Λ)² there, up to fourth order.
pub(super) fn cutoff(edge: f64, wavelength: f64) -> f64 {
    acos((1.0 - (PI * edge / wavelength).powi(2)).clamp(-1.0, 1.0))
}

/// Coefficients r_k of the filter that removes waves above θ₀; their number is even, and is the degree of the
/// filter.
pub(super) fn response(cutoff: f64) -> Vec<f32> {
    let coefficients = low_pass(cutoff);
    let degree = coefficients.len() - 1;
    // (T_k − 1)/(M − 1) = k + 2 Σ_{0<j<k} (k − j) T_j
    let r = |j: usize| {
        let sum: f64 = (j + 1..=degree).map(|k| (k - j) as f64 * coefficients[k]).sum();
        if j == 0 { sum } else { 2.0 * sum }
    };
    (0..degree).map(|j| r(j) as f32).collect()
}

/// Smallest θ₀ [rad]: on a mesh with even shorter edges relative to the wavelength the filter has some
/// thousand terms, and smooths less than requested.
const MIN_CUTOFF: f64 = 1e-3;

/// Coefficients c_k of the low pass up to θ₀, with sum 1; an odd number, at least three.
fn low_pass(cutoff: f64) -> Vec<f64> {
    let degree = (DEGREE / cutoff.max(MIN_CUTOFF)).ceil() as usize;
    let degree = degree + degree % 2;
    let raw: Vec<f64> = (0..=degree)
        .map(|k| {
            let angle = k as f64 * PI;
            let part = k as f64 / (degree + 1) as f64;
            let window = bessel(WINDOW_SHAPE * (1.0 - part * part).sqrt()) / bessel(WINDOW_SHAPE);
            if k == 0 { cutoff / PI } else { window * 2.0 * sin(k as f64 * cutoff) / angle }
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|c| c / sum).collect()
}

/// Modified Bessel function of the first kind of order 0, for small arguments.
fn bessel(x: f64) -> f64 {
    let mut term = 1.0;
    (1..20).fold(1.0, |sum, k| {
        term *= (0.5 * x / f64::from(k)).powi(2);
        sum + term
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The filter's response to a wave with eigenvalue cos θ.
    fn response_at(coefficients: &[f64], theta: f64) -> f64 {
        (0..).zip(coefficients).map(|(k, &c)| c * (f64::from(k) * theta).cos()).sum()
    }

    #[test]
    fn the_low_pass_keeps_long_waves_and_removes_short_ones() {
        for cutoff in [0.02, 0.1, 0.3, 0.8] {
            let coefficients = low_pass(cutoff);
            assert!((response_at(&coefficients, 0.0) - 1.0).abs() < 1e-12);
            assert!(response_at(&coefficients, 0.1 * cutoff) > 0.99);
            assert!(
                (response_at(&coefficients, cutoff) - 0.5).abs() < 0.1,
                "half at the requested wavelength"
            );
            for i in 0..=50 {
                let theta = 2.0 * cutoff + (PI - 2.0 * cutoff) * f64::from(i) / 50.0;
                let left = response_at(&coefficients, theta);
                assert!(left.abs() < 0.03, "{cutoff}: {left}");
            }
        }
    }

    #[test]
    fn the_response_is_the_low_pass_less_one_over_the_operator_less_one() {
        for cutoff in [0.05, 0.3, 1.0, PI] {
            let (coefficients, response) = (low_pass(cutoff), response(cutoff));
            assert!(response.len().is_multiple_of(2) && response.len() + 1 == coefficients.len());
            for theta in [0.1, 0.5, 1.1, 2.0, 3.1] {
                let found: f64 =
                    (0..).zip(&response).map(|(k, &r)| f64::from(r) * (f64::from(k) * theta).cos()).sum();
                let expected = (response_at(&coefficients, theta) - 1.0) / (theta.cos() - 1.0);
                assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{cutoff}, {theta}");
            }
        }
    }

    #[test]
    fn waves_that_the_mesh_cannot_resolve_pass_unchanged() {
        assert_eq!(cutoff(1.0, 1.0), PI);
        assert!(low_pass(PI).len() >= 2);
        assert!((cutoff(0.1, 10.0) - 2_f64.sqrt() * PI * 0.01).abs() < 1e-5);
    }
}
