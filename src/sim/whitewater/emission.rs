//! Emission: which particles appear between two times.
//!
//! *Method*: every particle of the liquid emits by a Poisson process of its rate, which is interpolated in time. The process is made by
//! thinning: points of unit density in time and rate are drawn for each (id, time slot, band of rates), and those below the rate are
//! emitted at their own time. So neither frames nor steps nor threads change which points there are, and a larger amount adds some.
//! *Departs from the paper*: [ihmsen12] emits a rounded number of particles in each frame, sampled in a cylinder along the
//! path; here the times of emission spread them along the path itself.
//!
//! Symbols: u even random numbers in [0, 1).

use super::{
    liquid::{LiquidInterval, Track},
    params::WhitewaterParams,
};
use crate::{
    math::{
        Random, Vec3,
        elementary::{cos, exp, ln, sin},
    },
    par,
};
use std::f32::consts::TAU;

/// Length of a time slot [s]. Longer, and each step draws more points of other times; shorter, and more slots without a point.
const SLOT: f64 = 1.0 / 100.0;

/// Width of a band of rates [1/s]: with it, a slot of a band has one point on average.
const BAND: f64 = 1.0 / SLOT;

/// Probabilities that a Poisson variable of mean 1 is at most 0, 1, 2, …
const POISSON: [f32; 10] = [
    0.367_879_44,
    0.735_758_9,
    0.919_698_6,
    0.981_011_84,
    0.996_340_15,
    0.999_405_8,
    0.999_916_76,
    0.999_989_75,
    0.999_998_87,
    0.999_999_9,
];

/// Random numbers of a point.
const DRAWS: u64 = 8;

/// A particle that may be emitted: its kind, which decides with `mark`, is known where it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Birth {
    /// Number of the track that emits it.
    pub(super) track: u32,
    /// Part of the interval at which it appears.
    pub(super) part: f64,
    /// Place relative to that of the particle that emits it [m].
    pub(super) offset: Vec3,
    /// Direction in which spray diverges, of length at most 1.
    pub(super) divergence: Vec3,
    pub(super) radius: f32,
    pub(super) life: f32,
    /// Amount of its kind times that of all with which it appears [1].
    pub(super) mark: f32,
}

/// The particles that appear between two parts of an interval with an amount, in the order of ids and times.
pub(super) fn births(
    liquid: &LiquidInterval,
    params: &WhitewaterParams,
    amount: f32,
    from: f64,
    to: f64,
) -> Vec<Birth> {
    let chunks = par::map_chunks(liquid.tracks.len(), par::CHUNK, |range| {
        let mut born = Vec::new();
        for place in range {
            let track = &liquid.tracks[place];
            if track.max_rate() * amount > 0.0 {
                of_track(liquid, params, track, place as u32, amount, [from, to], &mut born);
            }
        }
        born
    });
    chunks.into_iter().flatten().collect()
}

/// The expected number of births of an interval with an amount; of an interval shorter than a slot, of a whole one, whose points are
/// drawn.
pub(super) fn expected(liquid: &LiquidInterval, amount: f32) -> f64 {
    let mean = |i: usize| f64::from(liquid.tracks[i].rate(0.0) + liquid.tracks[i].rate(1.0)) * 0.5;
    par::sum(liquid.tracks.len(), mean) * f64::from(amount) * liquid.seconds().max(SLOT)
}

fn of_track(
    liquid: &LiquidInterval,
    params: &WhitewaterParams,
    track: &Track,
    place: u32,
    amount: f32,
    [from, to]: [f64; 2],
    born: &mut Vec<Birth>,
) {
    let (start, seconds) = (liquid.time[0], liquid.seconds());
    let time = |part: f64| start + part * seconds;
    let first = born.len();
    let bands = (f64::from(track.max_rate() * amount) / BAND).ceil() as u32;
    let slots = (time(from) / SLOT).floor() as u32..=(time(to) / SLOT).floor() as u32;
    for slot in slots {
        for band in 0..bands {
            let random = Random::new([track.id, slot, band ^ params.seed.rotate_left(16)]);
            let u = random.at(0);
            let count = POISSON.iter().take_while(|&&below| u >= below).count() as u64;
            for point in 0..count {
                let draw = |which: u64| random.at(1 + point * DRAWS + which);
                let part = ((f64::from(slot) + f64::from(draw(0))) * SLOT - start) / seconds;
                if !(from..to).contains(&part) {
                    continue;
                }
                let height = (f64::from(band) + f64::from(draw(1))) * BAND;
                let rate = track.rate(part);
                if height >= f64::from(rate * amount) {
                    continue;
                }
                let (_, v) = track.at(part, seconds);
                let (offset, divergence) = within_cylinder(v, liquid.spacing, [draw(2), draw(3), draw(4)]);
                born.push(Birth {
                    track: place,
                    part,
                    offset,
                    divergence,
                    radius: params.radius * exp(params.radius_spread * truncated_normal(draw(5), draw(6))),
                    life: 0.5 + draw(7),
                    mark: (height / f64::from(rate)) as f32,
                });
            }
        }
    }
    born[first..].sort_by(|a, b| a.part.total_cmp(&b.part));
}

/// A place in the cylinder of a particle of the liquid along its velocity `v`, and that place across the velocity over the
/// cylinder's radius, which is a spacing ([ihmsen12] Fig. 4).
fn within_cylinder(v: Vec3, spacing: f32, u: [f32; 3]) -> (Vec3, Vec3) {
    let speed = v.norm();
    let axis = if speed > 0.0 { v / speed } else { Vec3::z() };
    let other = if axis.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let e1 = axis.cross(&other).normalize();
    let e2 = axis.cross(&e1);
    let (r, angle) = (u[0].sqrt(), TAU * u[1]);
    let across = (e1 * cos(angle) + e2 * sin(angle)) * r;
    ((across + axis * (u[2] - 0.5)) * spacing, across)
}

/// A normal variable of mean 0 and deviation 1 that is at most 3 in magnitude: Box–Muller with a radius of at most 3.
fn truncated_normal(u: f32, v: f32) -> f32 {
    // 1 − exp(−9/2)
    const WITHIN: f32 = 0.988_891;
    (-2.0 * ln(1.0 - WITHIN * u)).sqrt() * cos(TAU * v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_of_poisson_probabilities_sums_to_one() {
        let mut term = exp(-1.0_f64);
        let mut sum = 0.0;
        for (k, &entry) in POISSON.iter().enumerate() {
            if k > 0 {
                term /= k as f64;
            }
            sum += term;
            assert!((f64::from(entry) - sum).abs() < 2e-7, "{k}: {entry} {sum}");
        }
    }

    #[test]
    fn sizes_have_the_requested_spread_and_no_outliers() {
        let random = Random::new([1, 2, 3]);
        let values: Vec<f64> = (0..20_000)
            .map(|i| f64::from(truncated_normal(random.at(2 * i), random.at(2 * i + 1))))
            .collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let deviation = (values.iter().map(|x| x * x).sum::<f64>() / n).sqrt();
        assert!(mean.abs() < 0.03 && (deviation - 0.97).abs() < 0.03, "{mean} {deviation}");
        assert!(values.iter().all(|x| x.abs() <= 3.0));
    }
}
