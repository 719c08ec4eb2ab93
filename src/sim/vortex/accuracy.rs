//! How exact the tree is: from the error that is wanted to orders and angles, and the error that was reached.
//!
//! *Method*: the velocity of an expansion of order q over an angle θ = (r_A + r_B)/R misses about (SHRINK · θ)^q of itself, so
//! one number τ = (SHRINK · θ)^q gives every order its largest angle. [`TABLE`] has the highest order and its angle for every
//! error.

use super::{Kernel, Method, OutOfRange, Quantity, Targets, Vortons, index::MAX_ORDER, induced};
use crate::math::Vec3;
use std::ops::RangeInclusive;

/// The relative L2 errors of the velocity that can be asked for. Single precision ends below; above it, the text's own rule would do.
pub const ERRORS: RangeInclusive<f32> = 1e-5..=0.1;

/// How much smaller than the largest the offsets in cells are, as far as the error goes: measured on a cube of vortons of random
/// directions, where at θ = ½ each order more leaves 0.41 of the error.
const SHRINK: f32 = 0.82;

/// From the largest error to the smallest: an order, and its largest angle at both ends of the errors that it serves. Measured on
/// the worst of the four clouds of `benches/vortex.rs`, and set so that no step to a higher order raises the error;
/// larger angles miss what is asked for, smaller ones cost time. Between the ends the angle follows the error's power.
const TABLE: [([f32; 2], usize, [f32; 2]); 4] = [
    ([1e-1, 1e-2], 4, [0.80, 0.55]),
    ([1e-2, 2e-3], 4, [0.55, 0.37]),
    ([2e-3, 3e-4], 6, [0.55, 0.40]),
    ([3e-4, 1e-5], 8, [0.52, 0.36]),
];

/// Vortons of a leaf at most. On 100 000 vortons in a cube, 32 cost a tenth more and 128 the same.
const LEAF: usize = 64;

/// How the tree sums.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    /// The error wanted.
    pub(super) error: f32,
    /// The highest order of expansions.
    pub(super) order: usize,
    /// The squares of the largest angles of each order; 0 where it is not used.
    pub(super) squared_angles: [f32; MAX_ORDER + 1],
    /// Pairs that cost as much as an expansion of each order.
    pub(super) few: [usize; MAX_ORDER + 1],
    /// Points of a leaf at most.
    pub(super) leaf: usize,
}

/// The setting for an error.
///
/// # Panics
/// If the error is outside [`ERRORS`].
pub(super) fn setting(error: f32) -> Setting {
    assert!(ERRORS.contains(&error), "an error of {error} cannot be asked for");
    let ([high, low], order, [wide, narrow]) =
        *TABLE.iter().find(|row| row.0[1] <= error).expect("the last row ends where errors do");
    let along = (high / error).ln() / (high / low).ln();
    with(error, order, wide * (narrow / wide).powf(along))
}

/// The setting with expansions up to `order`, of the highest of which `angle` is the largest.
fn with(error: f32, order: usize, angle: f32) -> Setting {
    let tau = (SHRINK * angle).powi(order as i32);
    let mut setting =
        Setting { error, order, squared_angles: [0.0; MAX_ORDER + 1], few: [0; MAX_ORDER + 1], leaf: LEAF };
    for q in 2..=order {
        setting.squared_angles[q] = (tau.powf(1.0 / q as f32) / SHRINK).powi(2);
        // Pairs take 1.75 cycles each, an expansion 100 and 0.4 for each of its (q + 6 over 6) products of three.
        let products = (1..=6).fold(1, |product, k| product * (q + k) / k);
        setting.few[q] = 60 + products * 23 / 100;
    }
    setting
}

/// The relative L2 error of the velocities `found` at `targets`, sampled at up to `samples` of them and taken against the sum over
/// all pairs; 0 where nothing moves. Costs `samples` times the number of vortons.
///
/// # Errors
/// [`OutOfRange`] as of [`induced`].
///
/// # Panics
/// If there are not as many velocities as targets.
pub fn sampled_error(
    vortons: &Vortons,
    targets: Targets<'_>,
    kernel: Kernel,
    found: &[Vec3],
    samples: usize,
) -> Result<f64, OutOfRange> {
    let points = targets.positions(vortons);
    assert_eq!(points.len(), found.len(), "a velocity for every target");
    // Evenly through the targets.
    let samples = samples.min(points.len());
    let chosen: Vec<usize> = (0..samples).map(|k| k * points.len() / samples).collect();
    let at: Vec<Vec3> = chosen.iter().map(|&i| points[i]).collect();
    let exact = induced(vortons, Targets::Points(&at), Quantity::Velocity, kernel, Method::Direct)?.velocity;
    let (mut missed, mut whole) = (0.0, 0.0);
    for (&i, exact) in chosen.iter().zip(&exact) {
        missed += f64::from((found[i] - exact).norm()).powi(2);
        whole += f64::from(exact.norm()).powi(2);
    }
    Ok(if missed > 0.0 { (missed / whole).sqrt() } else { 0.0 })
}
