//! How far two runs of one shot are apart.

use super::row::{Figures, Row, Seen, sampled};
use crate::{
    run::{RunError, tradeoff::runs::Place},
    sim::Observable,
};
use serde::Serialize;

/// Distances between two runs; `None` where they cannot be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Apart {
    /// Mechanical energy: RMS over the frames, as a fraction of the reference's largest kinetic energy.
    pub energy: Option<f64>,
    /// The observable: RMS over the frames, in its unit.
    pub observable: Option<f64>,
    /// Particles of the same id: RMS over the comparable frames [m].
    pub position: Option<f64>,
}

/// Energy and observable of `row` against `reference`, over the frames that both have and `wanted` holds.
pub(super) fn curves(row: &Row, reference: &Row, what: Observable, wanted: &dyn Fn(u32) -> bool) -> Apart {
    let pairs: Vec<(&Seen, &Seen)> = row
        .found
        .frames
        .iter()
        .filter(|seen| wanted(seen.frame))
        .filter_map(|seen| {
            Some((seen, reference.found.frames.iter().find(|other| other.frame == seen.frame)?))
        })
        .collect();
    let place = Observable::ALL.iter().position(|known| *known == what).expect("every observable is listed");
    let observable =
        rms(pairs.iter().filter_map(|(a, b)| Some(a.observables.get(place)? - b.observables.get(place)?)));

    // A kilogram's energy, since runs of different spacing differ in mass by what the lattice leaves over.
    let most = reference.found.frames.iter().filter_map(|seen| kinetic(reference, seen)).fold(0.0, f64::max);
    let energy = rms(pairs.iter().filter_map(|(a, b)| Some(mechanical(row, a)? - mechanical(reference, b)?)));
    Apart { energy: energy.filter(|_| most > 0.0).map(|energy| energy / most), observable, position: None }
}

/// Energies are logged for the whole liquid; its mass is density × volume, and the density is the same in all runs
/// unless it is what they vary.
fn per_volume(row: &Row) -> f64 {
    1.0 / (row.found.particles as f64 * f64::from(row.found.spacing).powi(3))
}

fn kinetic(row: &Row, seen: &Seen) -> Option<f64> {
    Some(seen.logged.as_ref()?.kinetic_energy * per_volume(row))
}

fn mechanical(row: &Row, seen: &Seen) -> Option<f64> {
    let logged = seen.logged.as_ref()?;
    Some((logged.kinetic_energy + logged.potential_energy) * per_volume(row))
}

/// The root of the mean square; `None` of nothing.
fn rms(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_usize), |(sum, count), value| (sum + value * value, count + 1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// The last frame up to which the particles of two runs stay within a spacing of each other (RMS): beyond it, their
/// paths have parted and say nothing about accuracy. `None` if the runs do not have the same particles.
///
/// # Errors
/// If a kept sample cannot be read.
pub(super) fn horizon(a: (&Place<'_>, &Row), b: (&Place<'_>, &Row)) -> Result<Option<u32>, RunError> {
    let mut last = None;
    for seen in &a.1.found.frames {
        match distance(a, b, seen.frame)? {
            Some(rms) if rms <= f64::from(a.1.found.spacing) => last = Some(seen.frame),
            _ => break,
        }
    }
    Ok(last)
}

/// RMS distance of the particles over the frames up to `horizon` [m].
///
/// # Errors
/// If a kept sample cannot be read.
pub(super) fn position(
    a: (&Place<'_>, &Row),
    b: (&Place<'_>, &Row),
    horizon: Option<u32>,
) -> Result<Option<f64>, RunError> {
    let Some(horizon) = horizon else { return Ok(None) };
    let mut distances = Vec::new();
    for seen in b.1.found.frames.iter().filter(|seen| seen.frame <= horizon) {
        match distance(a, b, seen.frame)? {
            Some(distance) => distances.push(distance),
            None => return Ok(None),
        }
    }
    Ok(rms(distances.into_iter()))
}

/// RMS distance of the particles in one frame [m]; `None` if they are not the same ones.
fn distance(a: (&Place<'_>, &Row), b: (&Place<'_>, &Row), frame: u32) -> Result<Option<f64>, RunError> {
    let is_alike =
        |a: &Figures, b: &Figures| a.particles == b.particles && a.spacing.to_bits() == b.spacing.to_bits();
    if !is_alike(&a.1.found, &b.1.found) {
        return Ok(None);
    }
    let (Some(a), Some(b)) = (sampled(a.0, frame)?, sampled(b.0, frame)?) else { return Ok(None) };
    let (Some(x), Some(y)) = (a.vec3("position"), b.vec3("position")) else { return Ok(None) };
    if a.u32("id") != b.u32("id") {
        return Ok(None);
    }
    Ok(rms(x.iter().zip(y).map(|(x, y)| f64::from((x - y).norm()))))
}
