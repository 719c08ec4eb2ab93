//! Signed distance on a dense grid, each stage a function of its own.
//!
//! *Method* [gourlay17], [zhao05]: the indicator ([`indicator`]) says where the surface crosses; nodes beside it get
//! immediate distances and are pinned ([`pin_surface`]; [`pin_band`] takes a band that is known already); sweeps in
//! eight orders carry them on ([`sweep`]), as a wavefront over blocks of any size; [`Order::Second`] then gives every
//! node a distance of second order. [`from_density`] is the whole way.
//!
//! Limits: memory follows the box, not the surface: beside field and pins (9 bytes a node) 8 bytes a node at first
//! order, 10 at second. Where the surface fills a small part of a box, the bricks of [`super::from_density`] are the
//! better grid.

mod first;
mod layout;
mod pin;
mod second;
mod skewed;
#[cfg(target_arch = "x86_64")]
mod skewed_avx2;

pub use first::{sweep, sweep_in_order};
pub use pin::{Pins, indicator, pin_band, pin_surface};

use super::{Order, SeedRule, Swept, second::refine};
use crate::{grid::DenseGrid, par};
use layout::Layout;

/// The size of blocks that was fastest (see `docs/eikonal.md`): in smaller ones copying the layers of neighbours costs
/// more than the sweep, with larger ones more is swept that is at rest, and threads wait.
pub const BLOCK: [usize; 3] = [64, 16, 16];

/// How distance is found on a dense grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DenseParams {
    /// How nodes beside the surface get their distance.
    pub seed: SeedRule,
    /// The order of the differences.
    pub order: Order,
    /// How far from the surface distances are found [voxels], above 0. Infinite: at every node.
    pub band: f32,
    /// Nodes of a block along each axis, at least 1. Changes the time, never the result.
    pub block: [usize; 3],
}

impl Default for DenseParams {
    fn default() -> Self {
        Self { seed: SeedRule::Plane, order: Order::First, band: f32::INFINITY, block: BLOCK }
    }
}

/// Signed distance on a dense grid: negative inside, positive outside, never zero and never NaN.
#[derive(Clone, Debug)]
pub struct DenseDistance {
    /// The distances [m]; ±`band` where no front came.
    pub grid: DenseGrid,
    /// The largest magnitude in `grid` [m]; infinite after a full solve.
    pub band: f32,
    /// Nodes that were pinned.
    pub pinned: usize,
    /// Pinned nodes nearer than 10⁻⁶ voxel to the surface: set to that distance.
    pub on_surface: usize,
    /// Nodes without a distance of their own: they hold ±`band`.
    pub unreached: usize,
    /// Sweeps run, over both orders.
    pub sweeps: usize,
}

/// The signed distance to the surface where `field` crosses `threshold` from below (outside) to above (inside).
///
/// # Panics
/// If the band is not above zero or a block has no node.
pub fn from_density(field: &DenseGrid, threshold: f32, params: &DenseParams) -> DenseDistance {
    from_pins(field.voxel, field.first, field.nodes, &pin_surface(field, threshold, params.seed), params)
}

/// The signed distance on a grid some of whose nodes have theirs; `params.seed` is not asked.
///
/// # Panics
/// If `pins` has another number of nodes, the band is not above zero or a block has no node.
pub fn from_pins(
    voxel: f32,
    first: [i32; 3],
    nodes: [usize; 3],
    pins: &Pins,
    params: &DenseParams,
) -> DenseDistance {
    let swept = solve(nodes, pins, params);
    let mut values = swept.distance;
    let band = params.band * voxel;
    // The indicator gives the sign, the band the largest magnitude.
    par::update(&mut values, |i, value| {
        let distance = (value.abs() * voxel).min(band);
        *value = if pins.inside[i] { -distance } else { distance };
    });
    DenseDistance {
        grid: DenseGrid { voxel, first, nodes, values },
        band,
        pinned: pins.pinned,
        on_surface: pins.on_surface,
        unreached: swept.unreached,
        sweeps: swept.sweeps,
    }
}

/// Carries the pinned distances on: all that lies between the pins and the signs.
///
/// # Panics
/// As [`from_pins`].
pub fn solve(nodes: [usize; 3], pins: &Pins, params: &DenseParams) -> Swept {
    let DenseParams { order, band, block, .. } = *params;
    assert!(band > 0.0, "the band holds nodes");
    match order {
        Order::First => sweep(nodes, &pins.distance, band, block),
        Order::Second => {
            let swept = sweep(nodes, &pins.distance, order.reach(band), block);
            refine(&Layout::new(nodes, block), swept, band, |i| pins.inside[i])
        }
    }
}

/// A box of nodes as one block.
#[cfg(test)]
pub(super) fn one_block(nodes: [usize; 3]) -> impl super::second::Nodes {
    Layout::new(nodes, nodes)
}
