//! The accuracy of the tree: orders and acceptance angles for a requested error.
//!
//! *Method*: the acceptance criterion of an expansion between cells of radii r_A and r_B at distance R is a
//! largest angle θ = (r_A + r_B)/R. The relative error of the velocity at order q is about τ =
//! (EFFECTIVE_OFFSET · θ)^q. So one τ gives the largest angle of every order. [`ACCURACY_TABLE`] has the
//! highest order and its angle for every error.

use super::index::MAX_ORDER;
use crate::math::elementary::{ln, powf};
use std::ops::RangeInclusive;

/// The relative L2 errors of the velocity that the tree accepts. Smaller ones exceed single precision; larger
/// ones would save hardly any time.
pub const ERRORS: RangeInclusive<f32> = 1e-5..=0.1;

/// The ratio of the offset in a cell that determines the error to the radius of the cell. Measured on a cube
/// of vortons of random directions, where one order more at θ = ½ reduces the error to 0.41.
const EFFECTIVE_OFFSET: f32 = 0.82;

/// From the largest error to the smallest: the range of errors, the order, and its largest angle at both ends
/// of the range. Measured on the worst of the four clouds of `benches/vortex.rs`, and set so that no step to
/// a higher order increases the error. Larger angles exceed the requested error, smaller ones cost time.
/// Within the range the angle is a power of the error.
const ACCURACY_TABLE: [([f32; 2], usize, [f32; 2]); 4] = [
    ([1e-1, 1e-2], 4, [0.80, 0.55]),
    ([1e-2, 2e-3], 4, [0.55, 0.37]),
    ([2e-3, 3e-4], 6, [0.55, 0.40]),
    ([3e-4, 1e-5], 8, [0.52, 0.36]),
];

/// Vortons per leaf at most. On 100 000 vortons in a cube, 32 cost a tenth more and 128 the same.
const MAX_LEAF_POINTS: usize = 64;

/// The settings of the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct TreeSettings {
    /// The requested error.
    pub(super) error: f32,
    /// The highest order of expansions.
    pub(super) order: usize,
    /// The squared acceptance angle of each order; 0 for orders that are not used.
    pub(super) squared_angles: [f32; MAX_ORDER + 1],
    /// Pairs that cost as much as an expansion of each order.
    pub(super) break_even_pairs: [usize; MAX_ORDER + 1],
    /// Points per leaf at most.
    pub(super) max_leaf_points: usize,
}

/// The settings for an error.
///
/// # Panics
/// If the error is outside [`ERRORS`].
pub(super) fn tree_settings(error: f32) -> TreeSettings {
    assert!(ERRORS.contains(&error), "the tree accepts errors {ERRORS:?}, not {error}");
    let ([high, low], order, [wide, narrow]) =
        *ACCURACY_TABLE.iter().find(|row| row.0[1] <= error).expect("the last row ends where errors do");
    let along = ln(high / error) / ln(high / low);
    with_order(error, order, wide * powf(narrow / wide, along))
}

/// The settings with expansions up to `order` and the largest `angle` of that order.
fn with_order(error: f32, order: usize, angle: f32) -> TreeSettings {
    let tau = (EFFECTIVE_OFFSET * angle).powi(order as i32);
    let mut settings = TreeSettings {
        error,
        order,
        squared_angles: [0.0; MAX_ORDER + 1],
        break_even_pairs: [0; MAX_ORDER + 1],
        max_leaf_points: MAX_LEAF_POINTS,
    };
    for q in 2..=order {
        settings.squared_angles[q] = (powf(tau, 1.0 / q as f32) / EFFECTIVE_OFFSET).powi(2);
        // Pairs take 1.75 cycles each, an expansion 100 and 0.4 for each of its (q + 6 over 6) products of
        // three.
        let products = (1..=6).fold(1, |product, k| product * (q + k) / k);
        settings.break_even_pairs[q] = 60 + products * 23 / 100;
    }
    settings
}
