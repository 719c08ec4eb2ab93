//! How far two runs of the smoke of one shot are apart.

use super::row::{Node, Row, Seen, sampled};
use crate::{
    run::{RunError, tradeoff::runs::Place},
    sim::vortex::Invariants,
};
use serde::Serialize;

/// Distances between two runs, as fractions; `None` where they cannot be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Apart {
    /// The share of the smoke that is elsewhere, mean of the frames: Σ|ρ − ρ'| / Σ(ρ + ρ') on the coarse lattice; 1 where they have
    /// no place in common.
    pub density: Option<f64>,
    /// Between the centres of the smoke, over the size of the reference's: RMS over the frames.
    pub center: Option<f64>,
    /// The size of the smoke over that of the reference's, less one: RMS over the frames.
    pub extent: Option<f64>,
    /// Kinetic energy of the air: RMS over the frames, as a part of the reference's largest.
    pub energy: Option<f64>,
    /// Impulse of the air: RMS over the frames, as a part of what the reference's would be if all its vortons pushed one way.
    pub impulse: Option<f64>,
}

/// How far what motion keeps came from where it was, from the first frame with a record to the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Drift {
    /// The energy at the end over that at the start, less one.
    pub energy: Option<f64>,
    /// The impulse's change, as a part of what it would be if all vortons pushed one way.
    pub impulse: Option<f64>,
}

/// The drift of a run itself.
pub(super) fn drift(row: &Row) -> Drift {
    let told = |seen: &&Seen| seen.logged.is_some();
    let (first, last) = (row.found.frames.iter().find(told), row.found.frames.iter().rev().find(told));
    let Some((first, last)) = first.zip(last) else { return Drift::default() };
    let ends = invariants(first).zip(invariants(last));
    let Some((start, end)) = ends else { return Drift::default() };
    Drift {
        energy: (start.energy > 0.0).then(|| end.energy / start.energy - 1.0),
        impulse: (first.push > 0.0).then(|| between(start.impulse, end.impulse) / first.push),
    }
}

fn invariants(seen: &Seen) -> Option<&Invariants> {
    seen.logged.as_ref().map(|logged| &logged.account.invariants)
}

fn between(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

/// Frame by frame, `row` against `reference`, over the frames that both have and `wanted` holds: all but the density.
pub(super) fn curves(row: &Row, reference: &Row, wanted: &dyn Fn(u32) -> bool) -> Apart {
    let pairs: Vec<(&Seen, &Seen)> = pairs(row, reference, wanted).collect();
    let bodies = || pairs.iter().filter_map(|(a, b)| Some((a.body?, b.body.filter(|b| b.size > 0.0)?)));
    let both = || pairs.iter().filter_map(|(a, b)| Some((invariants(a)?, invariants(b)?)));
    let most = |of: &dyn Fn(&Seen) -> f64| reference.found.frames.iter().map(of).fold(0.0, f64::max);
    let energy = most(&|seen| invariants(seen).map_or(0.0, |found| found.energy));
    let push = most(&|seen| seen.push);
    let part = |value: Option<f64>, of: f64| value.filter(|_| of > 0.0).map(|value| value / of);
    Apart {
        density: None,
        center: rms(bodies().map(|(a, b)| between(a.center, b.center) / b.size)),
        extent: rms(bodies().map(|(a, b)| a.size / b.size - 1.0)),
        energy: part(rms(both().map(|(a, b)| a.energy - b.energy)), energy),
        impulse: part(rms(both().map(|(a, b)| between(a.impulse, b.impulse))), push),
    }
}

fn pairs<'a>(
    row: &'a Row,
    reference: &'a Row,
    wanted: &'a dyn Fn(u32) -> bool,
) -> impl Iterator<Item = (&'a Seen, &'a Seen)> {
    let frames = row.found.frames.iter().filter(|seen| wanted(seen.frame));
    frames.filter_map(|seen| {
        Some((seen, reference.found.frames.iter().find(|other| other.frame == seen.frame)?))
    })
}

/// The root of the mean square; `None` of nothing.
fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value * value, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// The share of the smoke that is elsewhere, mean of the frames.
///
/// # Errors
/// If a kept sample cannot be read.
pub(super) fn density(
    a: (&Place<'_>, &Row),
    b: (&Place<'_>, &Row),
    wanted: &dyn Fn(u32) -> bool,
) -> Result<Option<f64>, RunError> {
    let (mut sum, mut count) = (0.0, 0_usize);
    for (seen, _) in pairs(a.1, b.1, wanted) {
        let (Some(a), Some(b)) = (sampled(a.0, seen.frame)?, sampled(b.0, seen.frame)?) else { continue };
        if let Some(share) = elsewhere(&a, &b) {
            (sum, count) = (sum + share, count + 1);
        }
    }
    Ok((count > 0).then(|| sum / count as f64))
}

/// Σ|ρ − ρ'| / Σ(ρ + ρ') of densities at nodes, each in order of the nodes; `None` if there is no smoke in either.
pub(super) fn elsewhere(a: &[Node], b: &[Node]) -> Option<f64> {
    let (mut i, mut j, mut off, mut whole) = (0, 0, 0.0, 0.0);
    while i < a.len() || j < b.len() {
        let next = [a.get(i), b.get(j)].into_iter().flatten().map(|(node, _)| *node).min();
        let take = |list: &[Node], at: &mut usize| match list.get(*at) {
            Some((node, value)) if Some(*node) == next => {
                *at += 1;
                f64::from(*value)
            }
            _ => 0.0,
        };
        let (x, y) = (take(a, &mut i), take(b, &mut j));
        off += (x - y).abs();
        whole += x + y;
    }
    (whole > 0.0).then(|| off / whole)
}
