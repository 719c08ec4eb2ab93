//! Energy of sparse liquid, which holds droplets of a few particles together.
//!
//! *Method*: a particle with less than the colour function c of an edge of the seeding lattice has the energy
//! κ σ Δx² (1 − c/c_edge)², whose gradient is a force between pairs: momentum is exact. The area of the colour function falls when such a
//! droplet dilates, by more than pairwise cohesion holds: the sum of both energies of 32 particles is a minimum at 1.2 to 1.4 times their spacing.
//! Solids count in c, so that sparse liquid sticks to them a little. Liquid that fills its edges and corners has none of this energy.
//! *Departs from the literature*: none is followed.
//! Symbols: κ → [`SPARSE_ENERGY`]; c_edge → 1/`inv_edge`; Δx → `spacing`; σ is that of `surface_tension.rs`.

use super::{Kernel, calibration::RestState};

/// κ. At 0 drops of 7 to 32 particles scatter; 4 keeps them no better together than 2 (docs/decisions/019).
const SPARSE_ENERGY: f64 = 2.0;

/// Energy and force of what particles lack of the colour function of an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sparse {
    /// c that the kernel at distance 0 stands for.
    own: f32,
    inv_edge: f32,
    /// Energy of a particle that lacks everything, over 2σV/h.
    energy: f32,
    /// Force of a particle and a neighbour that lack 1 together, over 2σV/h and the gradient of c.
    pub(super) force: f32,
}

impl Sparse {
    pub(super) fn new(rest: &RestState) -> Self {
        let radius = f64::from(rest.support / rest.spacing);
        let edge = edge_sum(radius) * f64::from(rest.density_scale);
        let energy = 0.5 * SPARSE_ENERGY * radius;
        Self {
            own: rest.density_scale,
            inv_edge: (1.0 / edge) as f32,
            energy: energy as f32,
            force: (2.0 * energy / edge) as f32,
        }
    }

    /// What c lacks of that of an edge, over that, with a sum of the kernel over the liquid and c of the solids.
    #[inline(always)]
    pub(super) fn lacks(self, sum: f32, solids: f32) -> f32 {
        (1.0 - (sum * self.own + solids) * self.inv_edge).max(0.0)
    }

    /// Energy of a particle that lacks so much, over 2σV/h.
    #[inline(always)]
    pub(super) fn energy(self, lacks: f32) -> f32 {
        self.energy * lacks * lacks
    }
}

/// Sum of the kernel on an edge of the seeding lattice, with a support of `radius` spacings.
fn edge_sum(radius: f64) -> f64 {
    let reach = radius.ceil() as i32;
    let squares = (-reach..=reach)
        .flat_map(|z| (0..=reach).flat_map(move |y| (0..=reach).map(move |x| x * x + y * y + z * z)));
    let near = squares.map(|square| f64::from(square).sqrt() / radius).filter(|&q| q < 1.0);
    near.map(|q| Kernel::Wendland.density(q)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::calibration::seeding_neighbours;

    #[test]
    fn only_what_is_sparser_than_an_edge_lacks() {
        for radius in [2.2, 2.5] {
            let rest = RestState::new(Kernel::Wendland, 0.01, radius);
            let sparse = Sparse::new(&rest);
            let sum = |keep: fn(i32) -> bool| {
                let near = seeding_neighbours(f64::from(radius)).filter(|&(z, _)| keep(z));
                near.map(|(_, q)| Kernel::Wendland.density(q)).sum::<f64>() as f32
            };
            // A flat surface, a sheet of two layers and an edge; then a pair, also where solids take the place of air.
            for filled in
                [sum(|z| z >= 0), sum(|z| z == 0 || z == 1), edge_sum(f64::from(radius)) as f32 * 1.0001]
            {
                assert_eq!(sparse.lacks(filled, 0.0), 0.0, "{radius}: {filled}");
            }
            let pair = 1.0 + Kernel::Wendland.density(1.0 / f64::from(radius)) as f32;
            let alone = sparse.lacks(1.0, 0.0);
            assert!(0.0 < sparse.lacks(pair, 0.0) && sparse.lacks(pair, 0.0) < alone && alone < 1.0);
            assert_eq!(sparse.lacks(pair, 0.5), 0.0);
            assert!(sparse.energy(alone) > sparse.energy(sparse.lacks(pair, 0.0)));
        }
    }
}
