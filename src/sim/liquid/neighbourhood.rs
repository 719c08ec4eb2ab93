//! Neighbour sums of the terms that act on velocities.

use super::{
    calibration::RestState,
    lanes::{self, Node},
};
use crate::{
    simd::{IndexRow, Lanes},
    space::Neighbours,
};

/// Positions, densities, velocities and their neighbour lists.
#[derive(Clone, Copy)]
pub(super) struct Neighbourhood<'a> {
    pub(super) rest: &'a RestState,
    /// Positions over h and ρ/ρ₀.
    pub(super) nodes: &'a [Node],
    /// Velocities [m/s].
    pub(super) motion: &'a [Node],
    pub(super) lists: &'a Neighbours,
}

/// A particle with eight of its neighbours. Padding repeats the particle itself, at distance zero and with the same velocity.
pub(super) struct NeighbourPairs<L> {
    /// (x_i − x_j)/h.
    pub(super) d: [L; 3],
    pub(super) q2: L,
    pub(super) q: L,
    /// 2/(ρ_i + ρ_j) in units of 1/ρ₀.
    pub(super) weight: L,
}

impl Neighbourhood<'_> {
    /// Particle `i` with the neighbours at `index`.
    #[inline(always)]
    pub(super) fn pairs<L: Lanes>(&self, i: usize, index: IndexRow<'_>) -> NeighbourPairs<L> {
        let (own, other) = (lanes::spread::<L>(self.nodes[i]), lanes::gather::<L>(self.nodes, index));
        let (d, q2) = lanes::offset(own, other);
        NeighbourPairs { d, q2, q: q2.sqrt(), weight: L::splat(2.0) / (own[3] + other[3]) }
    }
}
