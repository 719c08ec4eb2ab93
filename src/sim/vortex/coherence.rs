//! How far the parts of a velocity add up: the same setting misses less of a velocity that all vortons push the same way.
//!
//! *Method*: at some of the vortons, c² = |Σ u_q|²/Σ |u_q|² over the parts u_q of others: 1 if they have no order, their
//! number if all are alike. What expansions, and lattices, leave out has little order, so it is smaller against the whole by about c.
//! Cores are balls here whatever the kernel: they matter to what is near, of which nothing is left out.

use super::{
    ERRORS, Vortons,
    chain::{Ball, Chain, Chained},
    index::MAX_ORDER,
    lanes::{self, LANES, Lanes, Pass, splat},
    pairs::{self, Source},
};
use crate::{math::Vec3, par};

/// Vortons at which it is sampled, and how many at most whose parts of the velocity there are summed. It costs their product.
const SAMPLES: usize = 64;
const PARTS: usize = 8192;

/// The share of c that the setting may rely on, and the most that it may ease by. c is 0.9 on a cube of strengths of all directions, 5 on
/// a sheet and 8 on a ring, and at one setting they miss 0.8, 0.2 and 0.06 of the error that it is for, with 8000 vortons as with
/// 300 000 (`cargo bench --bench vortex -- kept`).
const SHARE: f32 = 0.8;
const MOST: f32 = 8.0;

/// The error to set for these vortons to miss `error` at most, if settings are made for c = 1.
///
/// # Panics
/// If the error is outside [`ERRORS`].
pub(super) fn eased(vortons: &Vortons, error: f32) -> f32 {
    assert!(ERRORS.contains(&error), "an error of {error} cannot be asked for");
    let ease = SHARE * coherence(vortons);
    // No number, or one without an end, as where single precision has lost all parts, eases nothing.
    let ease = if ease > 1.0 && ease.is_finite() { ease.min(MOST) } else { 1.0 };
    (error * ease).min(*ERRORS.end())
}

/// c of a set of vortons; no number if nothing moves.
fn coherence(vortons: &Vortons) -> f32 {
    let count = vortons.len();
    let sources = parts(vortons);
    let sums = par::map_chunks(SAMPLES.min(count), LANES, |part| {
        lanes::run(Sampled {
            samples: part.map(|k| vortons.position[k * count / SAMPLES.min(count)]).collect(),
            sources: &sources,
        })
    });
    let [whole, parts] = sums.iter().fold([0.0_f64; 2], |sum, more| [sum[0] + more[0], sum[1] + more[1]]);
    (whole / parts).sqrt() as f32
}

/// All vortons, or so many of them that stand for all: spread evenly over their numbers but in no step with them, with cores as much
/// wider as there are fewer, so that c does not grow with their number. What expansions leave out does not fall with it either.
fn parts(vortons: &Vortons) -> Vec<Source> {
    let count = vortons.len();
    if count <= PARTS {
        return (0..count).map(|i| Source::new(vortons, i)).collect();
    }
    let wider = (count as f32 / PARTS as f32).powf(2.0 / 3.0); // of σ²
    let part = |k: usize| {
        let along = (k as f64 * GOLDEN).fract();
        let Source(mut q) = Source::new(vortons, (along * count as f64) as usize);
        q[6] *= wider;
        Source(q)
    };
    (0..PARTS).map(part).collect()
}

/// The golden ratio's fraction: its multiples are spread evenly however many they are.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Σ |Σ u_q|² and ΣΣ |u_q|² at up to eight vortons.
struct Sampled<'a> {
    samples: Vec<Vec3>,
    sources: &'a [Source],
}

impl Pass for Sampled<'_> {
    type Out = [f64; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f64; 2] {
        let last = self.samples.len() - 1;
        let x = pairs::columns::<L>(|lane| self.samples[lane.min(last)]);
        let mut velocity = [splat::<L>(0.0); 3];
        let mut squares = splat::<L>(0.0);
        for Source(q) in self.sources {
            let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let g: [L; 3] = [splat(q[3]), splat(q[4]), splat(q[5])];
            let mut chain: Chained<L> = [splat(0.0); MAX_ORDER + 1];
            Ball::chain(r2, splat(q[6]), 1, &mut chain);
            let c = [g[1] * d[2] - g[2] * d[1], g[2] * d[0] - g[0] * d[2], g[0] * d[1] - g[1] * d[0]];
            for k in 0..3 {
                let part = chain[1] * c[k];
                velocity[k] += part;
                squares += part * part;
            }
        }
        let (velocity, squares) = (velocity.map(L::row), squares.row());
        (0..=last).fold([0.0; 2], |[whole, parts], lane| {
            let square: f64 = velocity.iter().map(|row| f64::from(row[lane]).powi(2)).sum();
            [whole + square, parts + f64::from(squares[lane])]
        })
    }
}
