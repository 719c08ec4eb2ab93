//! Discrete sine transforms of sixteen lines at a time.
//!
//! *Method*: S_k = Σ f_j sin(πjk/n) over 0 < j < n. With y_j = sin(πj/n)(f_j + f_(n−j)) + ½(f_j − f_(n−j))
//! and its Fourier transform R + iI, S_2k = I_k and S_(2k+1) = S_(2k−1) + R_k [cooley70]. Two real lines are
//! transformed as one complex line, by Stockham's FFT of radices 4, 2, 3 and 5 [vanloan92].
//!
//! *Limits*: single precision. The cumulative sum of odd coefficients adds about √n roundings of the largest.

use crate::math::elementary::{cos, sin};
use crate::simd::{Lanes, splat};
use std::f64::consts::PI;

/// Two lines of eight, as real and imaginary part.
pub(super) type Complex<L> = [L; 2];

/// The sine transform of one length.
#[derive(Clone, Debug)]
pub(super) struct SineTransform {
    n: usize,
    radices: Vec<usize>,
    /// e^(2πik/n).
    roots: Vec<[f32; 2]>,
    /// sin(πj/n).
    sines: Vec<f32>,
}

/// The factors 4, 2, 3 and 5 of a number; `None` if it has others.
fn factors(mut n: usize) -> Option<Vec<usize>> {
    let mut found = Vec::new();
    for radix in [4, 2, 3, 5] {
        while n.is_multiple_of(radix) {
            found.push(radix);
            n /= radix;
        }
    }
    (n == 1).then_some(found)
}

/// Whether lines of `n` cells can be transformed: 2ᵃ 3ᵇ 5ᶜ, at least 2.
pub(super) fn is_supported(n: usize) -> bool {
    n > 1 && factors(n).is_some()
}

impl SineTransform {
    /// The transform of lines of `n` cells.
    ///
    /// # Panics
    /// If [`is_supported`] is false for `n`.
    pub(super) fn new(n: usize) -> Self {
        let radices = factors(n).filter(|_| n > 1).expect("a length of factors 2, 3 and 5");
        let angle = |k: usize| 2.0 * PI * k as f64 / n as f64;
        Self {
            n,
            radices,
            roots: (0..n).map(|k| [cos(angle(k)) as f32, sin(angle(k)) as f32]).collect(),
            sines: (0..n).map(|j| sin(angle(j) / 2.0) as f32).collect(),
        }
    }

    /// Cells of a line.
    pub(super) fn cells(&self) -> usize {
        self.n
    }

    /// sin(πk/n).
    pub(super) fn sine(&self, k: usize) -> f32 {
        self.sines[k]
    }

    /// Replaces f_j by S_j; `line` and `work` are `n` long. The first number of the line is assumed to be 0.
    #[inline(always)]
    pub(super) fn run<L: Lanes>(&self, line: &mut [Complex<L>], work: &mut [Complex<L>]) {
        let n = self.n;
        let half = splat::<L>(0.5);
        let (line, work) = (&mut line[..n], &mut work[..n]);
        let odd_passes = self.radices.len() % 2 == 1;

        // The line y whose Fourier transform contains the sine transform, in the array from which the passes
        // end in `work`.
        work[0] = [splat(0.0); 2];
        line[0] = [splat(0.0); 2];
        for j in 1..=n / 2 {
            let sine = splat::<L>(self.sines[j]);
            let (a, b) = (line[j], line[n - j]);
            let (mut first, mut last) = (a, b);
            for c in 0..2 {
                let (even, odd) = (sine * (a[c] + b[c]), half * (a[c] - b[c]));
                (first[c], last[c]) = (even + odd, even - odd);
            }
            let to = if odd_passes { &mut *line } else { &mut *work };
            (to[n - j], to[j]) = (last, first);
        }

        let (mut from, mut to) = if odd_passes { (&mut *line, &mut *work) } else { (&mut *work, &mut *line) };
        let mut stride = 1;
        for &radix in &self.radices {
            match radix {
                2 => self.pass::<L, 2>(stride, from, to),
                3 => self.pass::<L, 3>(stride, from, to),
                4 => self.pass::<L, 4>(stride, from, to),
                _ => self.pass::<L, 5>(stride, from, to),
            }
            stride *= radix;
            (from, to) = (to, from);
        }

        // The Fourier transforms of both lines, and the sine transform from them.
        let mut sum = [splat::<L>(0.0); 2];
        for k in 0..=(n - 1) / 2 {
            let (z, w) = (work[k], work[if k == 0 { 0 } else { n - k }]);
            let real = [half * (z[0] + w[0]), half * (z[1] + w[1])];
            for c in 0..2 {
                sum[c] = if k == 0 { half * real[c] } else { sum[c] + real[c] };
            }
            line[2 * k] = [half * (z[1] - w[1]), half * (w[0] - z[0])];
            if 2 * k + 1 < n {
                line[2 * k + 1] = sum;
            }
        }
    }

    /// One pass of radix `R` over sequences with a distance of `stride` between numbers.
    #[inline(always)]
    fn pass<L: Lanes, const R: usize>(&self, stride: usize, from: &[Complex<L>], to: &mut [Complex<L>]) {
        let parts = self.n / (stride * R);
        for p in 0..parts {
            let mut twiddles = [[splat::<L>(1.0), splat::<L>(0.0)]; R];
            for (k, twiddle) in twiddles.iter_mut().enumerate().skip(1) {
                *twiddle = self.roots[p * k * stride].map(splat);
            }
            for q in 0..stride {
                let mut a = [[splat::<L>(0.0); 2]; R];
                for j in 0..R {
                    a[j] = from[q + stride * (p + parts * j)];
                }
                let b = butterfly::<L, R>(a);
                let to = &mut to[stride * R * p + q..];
                to[0] = b[0];
                for k in 1..R {
                    to[stride * k] = times(b[k], twiddles[k]);
                }
            }
        }
    }
}

#[inline(always)]
fn plus<L: Lanes>(a: Complex<L>, b: Complex<L>) -> Complex<L> {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
fn minus<L: Lanes>(a: Complex<L>, b: Complex<L>) -> Complex<L> {
    [a[0] - b[0], a[1] - b[1]]
}

#[inline(always)]
fn times<L: Lanes>(a: Complex<L>, b: Complex<L>) -> Complex<L> {
    [a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]]
}

/// i a.
#[inline(always)]
fn times_i<L: Lanes>(a: Complex<L>) -> Complex<L> {
    [-a[1], a[0]]
}

#[inline(always)]
fn scaled<L: Lanes>(a: Complex<L>, by: f64) -> Complex<L> {
    [a[0] * splat(by as f32), a[1] * splat(by as f32)]
}

/// Cosines and sines of 72° and 144°.
const COS: [f64; 2] = [0.309_016_994_374_947_4, -0.809_016_994_374_947_4];
const SIN: [f64; 2] = [0.951_056_516_295_153_6, 0.587_785_252_292_473_1];

/// Σ_j a_j e^(2πijk/R) of every k.
#[inline(always)]
fn butterfly<L: Lanes, const R: usize>(a: [Complex<L>; R]) -> [Complex<L>; R] {
    let mut b = a;
    match R {
        2 => (b[0], b[1]) = (plus(a[0], a[1]), minus(a[0], a[1])),
        3 => {
            let sum = plus(a[1], a[2]);
            let middle = minus(a[0], scaled(sum, 0.5));
            let side = times_i(scaled(minus(a[1], a[2]), 0.75_f64.sqrt()));
            (b[0], b[1], b[2]) = (plus(a[0], sum), plus(middle, side), minus(middle, side));
        }
        4 => {
            let (even, odd) = (plus(a[0], a[2]), minus(a[0], a[2]));
            let (sum, side) = (plus(a[1], a[3]), times_i(minus(a[1], a[3])));
            (b[0], b[1], b[2], b[3]) = (plus(even, sum), plus(odd, side), minus(even, sum), minus(odd, side));
        }
        _ => {
            let (sum1, sum2) = (plus(a[1], a[4]), plus(a[2], a[3]));
            let (side1, side2) = (minus(a[1], a[4]), minus(a[2], a[3]));
            let even1 = plus(a[0], plus(scaled(sum1, COS[0]), scaled(sum2, COS[1])));
            let even2 = plus(a[0], plus(scaled(sum1, COS[1]), scaled(sum2, COS[0])));
            let odd1 = times_i(plus(scaled(side1, SIN[0]), scaled(side2, SIN[1])));
            let odd2 = times_i(minus(scaled(side1, SIN[1]), scaled(side2, SIN[0])));
            b[0] = plus(a[0], plus(sum1, sum2));
            (b[1], b[4]) = (plus(even1, odd1), minus(even1, odd1));
            (b[2], b[3]) = (plus(even2, odd2), minus(even2, odd2));
        }
    }
    b
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{self, LANES, Pass};

    /// Transforms sixteen lines of noise.
    struct NoiseLines(usize);

    fn noise(i: usize) -> f32 {
        ((i * 7919 + 13) % 10_007) as f32 / 10_007.0 - 0.5
    }

    impl Pass for NoiseLines {
        type Out = Vec<[[f32; LANES]; 2]>;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let transform = SineTransform::new(self.0);
            let mut work = vec![[splat::<L>(0.0); 2]; self.0];
            let mut line = work.clone();
            for (j, both) in line.iter_mut().enumerate() {
                for (c, eight) in both.iter_mut().enumerate() {
                    *eight = L::load(&std::array::from_fn(|lane| noise(16 * j + 8 * c + lane)));
                }
            }
            transform.run(&mut line, &mut work);
            line.iter().map(|both| both.map(L::to_array)).collect()
        }
    }

    #[test]
    fn sixteen_lines_at_once_are_sixteen_sums_of_sines() {
        for n in [2, 3, 4, 5, 6, 8, 9, 10, 12, 15, 16, 25, 27, 30, 32, 60, 64, 90, 128, 135, 240] {
            let found = simd::dispatch(NoiseLines(n));
            for k in 1..n {
                for (c, lane) in [(0, 0), (0, 5), (1, 3), (1, 7)] {
                    let exact: f64 = (1..n)
                        .map(|j| {
                            f64::from(noise(16 * j + 8 * c + lane)) * (PI * (j * k) as f64 / n as f64).sin()
                        })
                        .sum();
                    let found = f64::from(found[k][c][lane]);
                    assert!((found - exact).abs() < 2e-6 * n as f64, "{n} {k}: {found} {exact}");
                }
            }
        }
        assert!(!is_supported(1) && !is_supported(7) && !is_supported(22));
    }
}
