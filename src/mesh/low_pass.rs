//! The low pass that smoothing uses, as a polynomial.
//!
//! *Method* [taubin96]: the coefficients c_k of an ideal low pass in θ = arccos(eigenvalue of M) under a window, for
//! P(M) = Σ c_k T_k(M) with Chebyshev polynomials T_k.
//! *Departs from the paper*: the window is that of [kaiser74], which needs three fifths of the degree of the paper's for the
//! same cut; coefficients are divided by their sum, so that a constant passes exactly; what is given is
//! R = (P − 1)/(M − 1), of which R(M)(M − 1) x is where the filter moves x: it works on small vectors, so that a mesh far
//! from the origin loses no digits.
//!
//! Symbols: Λ → `wavelength` [m]; ℓ → root mean square edge [m]; θ₀ → `pass` [rad]; r_k → coefficients of R.

use std::f64::consts::PI;

/// The degree of the filter times θ₀. Less, and the cut is so slow that long waves shrink and short ones stay; more only
/// makes it sharper, for more time. With a Hamming window 5 is needed for the same.
const DEGREE: f64 = 3.0;

/// Shape β of the window. Less lets more than a thirtieth of the shortest waves through, more makes the cut slower.
const WINDOW: f64 = 2.6;

/// θ₀ of waves of length `wavelength` on edges of length `edge`: on a regular mesh the umbrella operator has the
/// eigenvalue 1 − (π ℓ/Λ)² there, up to fourth order.
pub(super) fn pass(edge: f64, wavelength: f64) -> f64 {
    (1.0 - (PI * edge / wavelength).powi(2)).clamp(-1.0, 1.0).acos()
}

/// The coefficients r_k of the filter that stops what is above θ₀: an even number of them, as many as its degree.
pub(super) fn response(pass: f64) -> Vec<f32> {
    let coefficients = low_pass(pass);
    let degree = coefficients.len() - 1;
    // (T_k − 1)/(M − 1) = k + 2 Σ_{0<j<k} (k − j) T_j
    let r = |j: usize| {
        let sum: f64 = (j + 1..=degree).map(|k| (k - j) as f64 * coefficients[k]).sum();
        if j == 0 { sum } else { 2.0 * sum }
    };
    (0..degree).map(|j| r(j) as f32).collect()
}

/// The least θ₀ [rad]: on a mesh that much finer than its wavelength the filter has some thousand terms, and smooths less than
/// was asked for.
const LEAST_PASS: f64 = 1e-3;

/// The coefficients c_k of the low pass up to θ₀, with sum 1; an odd number, and three at least.
fn low_pass(pass: f64) -> Vec<f64> {
    let degree = (DEGREE / pass.max(LEAST_PASS)).ceil() as usize;
    let degree = degree + degree % 2;
    let raw: Vec<f64> = (0..=degree)
        .map(|k| {
            let angle = k as f64 * PI;
            let part = k as f64 / (degree + 1) as f64;
            let window = bessel(WINDOW * (1.0 - part * part).sqrt()) / bessel(WINDOW);
            if k == 0 { pass / PI } else { window * 2.0 * (k as f64 * pass).sin() / angle }
        })
        .collect();
    let sum: f64 = raw.iter().sum();
    raw.iter().map(|c| c / sum).collect()
}

/// The modified Bessel function of the first kind of order 0, for small arguments.
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

    /// The filter's answer to a wave with eigenvalue cos θ.
    fn answer(coefficients: &[f64], theta: f64) -> f64 {
        (0..).zip(coefficients).map(|(k, &c)| c * (f64::from(k) * theta).cos()).sum()
    }

    #[test]
    fn the_low_pass_keeps_long_waves_and_stops_short_ones() {
        for pass in [0.02, 0.1, 0.3, 0.8] {
            let coefficients = low_pass(pass);
            assert!((answer(&coefficients, 0.0) - 1.0).abs() < 1e-12);
            assert!(answer(&coefficients, 0.1 * pass) > 0.99);
            assert!((answer(&coefficients, pass) - 0.5).abs() < 0.1, "half at the wavelength asked for");
            for i in 0..=50 {
                let theta = 2.0 * pass + (PI - 2.0 * pass) * f64::from(i) / 50.0;
                let left = answer(&coefficients, theta);
                assert!(left.abs() < 0.03, "{pass}: {left}");
            }
        }
    }

    #[test]
    fn the_response_is_the_low_pass_less_one_over_the_operator_less_one() {
        for pass in [0.05, 0.3, 1.0, PI] {
            let (coefficients, response) = (low_pass(pass), response(pass));
            assert!(response.len().is_multiple_of(2) && response.len() + 1 == coefficients.len());
            for theta in [0.1, 0.5, 1.1, 2.0, 3.1] {
                let found: f64 =
                    (0..).zip(&response).map(|(k, &r)| f64::from(r) * (f64::from(k) * theta).cos()).sum();
                let expected = (answer(&coefficients, theta) - 1.0) / (theta.cos() - 1.0);
                assert!((found - expected).abs() < 1e-4 * expected.abs().max(1.0), "{pass}, {theta}");
            }
        }
    }

    #[test]
    fn waves_longer_than_the_mesh_can_show_pass_whole() {
        assert_eq!(pass(1.0, 1.0), PI);
        assert!(low_pass(PI).len() >= 2);
        assert!((pass(0.1, 10.0) - 2_f64.sqrt() * PI * 0.01).abs() < 1e-5);
    }
}
