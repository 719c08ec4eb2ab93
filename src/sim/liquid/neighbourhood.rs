//! What the terms that act on velocities read of a particle's neighbours.

use super::{
    lanes::{self, Node},
    rest::Rest,
};
use crate::{
    simd::{IndexRow, Lanes},
    space::Neighbours,
};

/// Positions, densities, velocities and the lists that belong to them.
#[derive(Clone, Copy)]
pub(super) struct Neighbourhood<'a> {
    pub(super) rest: &'a Rest,
    /// Positions over h and ρ/ρ₀.
    pub(super) nodes: &'a [Node],
    /// Velocities [m/s].
    pub(super) motion: &'a [Node],
    pub(super) lists: &'a Neighbours,
}

/// A particle and eight of its neighbours. Where fewer are left, the particle itself stands in, at no distance and with
/// no other velocity.
pub(super) struct Pairs<L> {
    /// (x_i − x_j)/h.
    pub(super) d: [L; 3],
    pub(super) q2: L,
    pub(super) q: L,
    /// 2/(ρ_i + ρ_j) in units of 1/ρ₀.
    pub(super) weight: L,
}

impl Neighbourhood<'_> {
    /// Particle `i` and those at `index`.
    #[inline(always)]
    pub(super) fn pairs<L: Lanes>(&self, i: usize, index: IndexRow<'_>) -> Pairs<L> {
        let (own, other) = (lanes::spread::<L>(self.nodes[i]), lanes::gather::<L>(self.nodes, index));
        let (d, q2) = lanes::offset(own, other);
        Pairs { d, q2, q: q2.sqrt(), weight: L::splat(2.0) / (own[3] + other[3]) }
    }
}
