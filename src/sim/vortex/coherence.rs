//! The coherence of an induced velocity: where the contributions of all vortons add up, the same settings
//! have a smaller relative error.
//!
//! *Method*: at some of the vortons, c² = |Σ u_q|²/Σ |u_q|² over the contributions u_q of the others. It is 1
//! if they are random, and their number if all are equal. The errors of expansions and grids are nearly
//! random, so compared with the velocity they are smaller by about c. Cores are balls here for every kernel:
//! they matter only nearby, where no contribution is approximated.

use super::{
    ERRORS, Vortons,
    index::MAX_ORDER,
    kernels::{Ball, Derivatives, RadialKernel},
    pairs::{self, Source},
};
use crate::math::elementary::powf;
use crate::{
    math::Vec3,
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};

/// Vortons at which coherence is sampled, at most.
const MAX_SAMPLES: usize = 64;

/// Vortons whose contributions are summed at each sample, at most. The time is proportional to the product of
/// both.
const MAX_SOURCES: usize = 8192;

/// The fraction of c by which the error may be increased. c is 0.9 on a cube of strengths of all directions,
/// 5 on a sheet and 8 on a ring. With the same settings their errors are 0.8, 0.2 and 0.06 of the one that
/// the settings are for, with 8000 vortons as with 300 000 (`cargo bench --bench vortex -- kept`). Vortons of a shot
/// lie in order, and their errors partly add up: with a fraction of 0.8 up to 1.65 of the requested error was
/// sampled on rings.
const USED_FRACTION: f32 = 0.4;

/// The largest factor by which the error may be increased.
const MAX_FACTOR: f32 = 8.0;

/// The error of the settings, made for c = 1, with which the error of these vortons is at most `error`.
///
/// # Panics
/// If the error is outside [`ERRORS`].
pub(super) fn eased(vortons: &Vortons, error: f32) -> f32 {
    assert!(ERRORS.contains(&error), "the accepted errors are {ERRORS:?}, not {error}");
    let factor = USED_FRACTION * coherence(vortons);
    // NaN or infinity, as where all contributions underflow, changes nothing.
    let factor = if factor > 1.0 && factor.is_finite() { factor.min(MAX_FACTOR) } else { 1.0 };
    (error * factor).min(*ERRORS.end())
}

/// c of a set of vortons; NaN if all velocities are zero.
fn coherence(vortons: &Vortons) -> f32 {
    let count = vortons.len();
    let sources = sampled_sources(vortons);
    let samples = MAX_SAMPLES.min(count);
    let sums = par::map_chunks(samples, LANES, |range| {
        let points = range.map(|k| vortons.position[k * count / samples]).collect();
        simd::dispatch(Contributions { points, sources: &sources })
    });
    let [whole, single] = sums.iter().fold([0.0_f64; 2], |sum, more| [sum[0] + more[0], sum[1] + more[1]]);
    (whole / single).sqrt() as f32
}

/// All vortons, or a sample of them. A sample is distributed evenly but incommensurably over the indices. Its
/// cores are wider in proportion to the spacing of the sample, so that c does not grow with the number of
/// vortons. The error of expansions does not decrease with the number either.
fn sampled_sources(vortons: &Vortons) -> Vec<Source> {
    let count = vortons.len();
    if count <= MAX_SOURCES {
        return (0..count).map(|i| Source::new(vortons, i)).collect();
    }
    let widening = powf(count as f32 / MAX_SOURCES as f32, 2.0 / 3.0); // of σ²
    let source = |k: usize| {
        let along = (k as f64 * GOLDEN_FRACTION).fract();
        let Source(mut q) = Source::new(vortons, (along * count as f64) as usize);
        q[6] *= widening;
        Source(q)
    };
    (0..MAX_SOURCES).map(source).collect()
}

/// The fraction of the golden ratio. Any number of its multiples are distributed evenly.
const GOLDEN_FRACTION: f64 = 0.618_033_988_749_895;

/// Σ |Σ u_q|² and ΣΣ |u_q|² at up to eight points.
struct Contributions<'a> {
    points: Vec<Vec3>,
    sources: &'a [Source],
}

impl Pass for Contributions<'_> {
    type Out = [f64; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f64; 2] {
        let last = self.points.len() - 1;
        let x = pairs::columns::<L>(|lane| self.points[lane.min(last)]);
        let mut velocity = [splat::<L>(0.0); 3];
        let mut squares = splat::<L>(0.0);
        for Source(q) in self.sources {
            let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let g: [L; 3] = [splat(q[3]), splat(q[4]), splat(q[5])];
            let mut derivatives: Derivatives<L> = [splat(0.0); MAX_ORDER + 1];
            Ball::derivatives(r2, splat(q[6]), 1, &mut derivatives);
            let c = [g[1] * d[2] - g[2] * d[1], g[2] * d[0] - g[0] * d[2], g[0] * d[1] - g[1] * d[0]];
            for k in 0..3 {
                let contribution = derivatives[1] * c[k];
                velocity[k] += contribution;
                squares += contribution * contribution;
            }
        }
        let (velocity, squares) = (velocity.map(L::to_array), squares.to_array());
        (0..=last).fold([0.0; 2], |[whole, single], lane| {
            let square: f64 = velocity.iter().map(|row| f64::from(row[lane]).powi(2)).sum();
            [whole + square, single + f64::from(squares[lane])]
        })
    }
}
