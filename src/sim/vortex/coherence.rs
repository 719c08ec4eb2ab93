//! How far the parts of a velocity add up: the same setting misses less of a velocity that all vortons push the same way.
//!
//! *Method*: at some of the vortons, c² = |Σ u_q|²/Σ |u_q|² over the parts u_q of all others: 1 if they have no order, their
//! number if all are alike. What expansions, and lattices, leave out has little order, so it is smaller against the whole by about c.

use super::{
    ERRORS, Vortons,
    chain::{Chain, Chained},
    index::MAX_ORDER,
    lanes::{self, LANES, Lanes, Pass, splat},
    pairs::{self, Source},
};
use crate::par;
use std::marker::PhantomData;

/// Vortons at which it is sampled. Costs as many sums over all others.
const SAMPLES: usize = 64;

/// The share of c that the setting may rely on, and the most that it may ease by. c is 1 on a cube of strengths of all directions, 6 to
/// 10 on a sheet and 9 to 20 on a ring of 8000 to 100 000 vortons; at one setting the ring misses a tenth to a thirtieth of what
/// the cube misses. With a fourth of c both keep two to seven times less than is asked for.
const SHARE: f32 = 0.25;
const MOST: f32 = 6.0;

/// The error to set for these vortons to miss `error` at most, if settings are made for c = 1.
///
/// # Panics
/// If the error is outside [`ERRORS`].
pub(super) fn eased<K: Chain>(vortons: &Vortons, error: f32) -> f32 {
    assert!(ERRORS.contains(&error), "an error of {error} cannot be asked for");
    let ease = SHARE * coherence::<K>(vortons);
    // No number, or none at all, eases nothing.
    let ease = if ease > 1.0 { ease.min(MOST) } else { 1.0 };
    (error * ease).min(*ERRORS.end())
}

/// c of a set of vortons; no number if nothing moves.
fn coherence<K: Chain>(vortons: &Vortons) -> f32 {
    let count = vortons.len();
    let sources: Vec<Source> = (0..count).map(|i| Source::new(vortons, i)).collect();
    let sums = par::map_chunks(SAMPLES.min(count), LANES, |part| {
        lanes::run(Sampled::<K> {
            samples: part.map(|k| k * count / SAMPLES.min(count)).collect(),
            sources: &sources,
            kernel: PhantomData,
        })
    });
    let [whole, parts] = sums.iter().fold([0.0_f64; 2], |sum, more| [sum[0] + more[0], sum[1] + more[1]]);
    (whole / parts).sqrt() as f32
}

/// Σ |Σ u_q|² and ΣΣ |u_q|² at up to eight vortons.
struct Sampled<'a, K> {
    samples: Vec<usize>,
    sources: &'a [Source],
    kernel: PhantomData<K>,
}

impl<K: Chain> Pass for Sampled<'_, K> {
    type Out = [f64; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f64; 2] {
        let last = self.samples.len() - 1;
        let x = pairs::columns::<L>(|lane| {
            let Source(q) = self.sources[self.samples[lane.min(last)]];
            [q[0], q[1], q[2]].into()
        });
        let mut velocity = [splat::<L>(0.0); 3];
        let mut squares = splat::<L>(0.0);
        for Source(q) in self.sources {
            let d = [x[0] - splat(q[0]), x[1] - splat(q[1]), x[2] - splat(q[2])];
            let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let g: [L; 3] = [splat(q[3]), splat(q[4]), splat(q[5])];
            let mut chain: Chained<L> = [splat(0.0); MAX_ORDER + 1];
            K::chain(r2, splat(q[6]), 1, &mut chain);
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
