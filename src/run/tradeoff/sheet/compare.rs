//! How far two runs of the sheets of one shot are apart.

use super::row::{Row, Seen, sampled};
use crate::{
    frame::Frame,
    run::{RunError, tradeoff::runs::Place},
    sim::sheet::SheetRecord,
};
use serde::Serialize;

/// Distances between two runs; `None` where they cannot be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Apart {
    /// Between the same points of the cloth: RMS over points and frames [m].
    pub distance: Option<f64>,
    /// The largest of them [m].
    pub farthest: Option<f64>,
    /// Energy of motion, springs, plates and height: RMS over the frames, as a part of the largest that the reference has in motion and springs.
    pub energy: Option<f64>,
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

/// Energy of `row` against `reference`, over the frames that both have and `wanted` holds.
pub(super) fn energy(row: &Row, reference: &Row, wanted: &dyn Fn(u32) -> bool) -> Option<f64> {
    let inner = |line: &SheetRecord| line.kinetic_energy + line.elastic_energy;
    let whole = |line: &SheetRecord| inner(line) + line.potential_energy;
    let most = reference.found.frames.iter().filter_map(|seen| seen.logged.as_ref()).map(inner);
    let most = most.fold(0.0, f64::max);
    let (mut sum, mut count) = (0.0, 0_usize);
    for (a, b) in pairs(row, reference, wanted) {
        let (Some(a), Some(b)) = (&a.logged, &b.logged) else { continue };
        (sum, count) = (sum + (whole(a) - whole(b)).powi(2), count + 1);
    }
    (count > 0 && most > 0.0).then(|| (sum / count as f64).sqrt() / most)
}

/// Distances of points of `a` from those of `b` [m], root mean square and largest, over the frames that both have and `wanted` holds.
///
/// # Errors
/// If a kept sample cannot be read.
pub(super) fn places(
    a: (&Place<'_>, &Row),
    b: (&Place<'_>, &Row),
    wanted: &dyn Fn(u32) -> bool,
) -> Result<[Option<f64>; 2], RunError> {
    let (mut sum, mut count, mut most) = (0.0, 0_usize, 0.0_f64);
    for (seen, _) in pairs(a.1, b.1, wanted) {
        let (Some(a), Some(b)) = (sampled(a.0, seen.frame)?, sampled(b.0, seen.frame)?) else { continue };
        let Some(squares) = squares(&a, &b) else { return Ok([None; 2]) };
        sum += squares.iter().sum::<f64>();
        count += squares.len();
        most = squares.iter().copied().fold(most, f64::max);
    }
    let found = |square: f64| (count > 0).then(|| square.sqrt());
    Ok([found(sum / count.max(1) as f64), found(most)])
}

/// Squares of the distances between the same points [m²]; `None` if they are not the same.
pub(super) fn squares(a: &Frame, b: &Frame) -> Option<Vec<f64>> {
    let mut out = Vec::new();
    if a.streams.len() != b.streams.len() {
        return None;
    }
    for (a, b) in a.streams.iter().zip(&b.streams) {
        let (x, y) = (a.vec3("position")?, b.vec3("position")?);
        if a.name != b.name || x.len() != y.len() {
            return None;
        }
        out.extend(x.iter().zip(y).map(|(x, y)| (x.cast::<f64>() - y.cast()).norm_squared()));
    }
    Some(out)
}
