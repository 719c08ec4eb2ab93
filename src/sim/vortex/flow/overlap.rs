//! The overlap of cores.
//!
//! *Method*: the number density n of vortons around each, weighted by a Gaussian of its core, is that of a
//! grid of spacing n^(-⅓). The overlap is σ over that spacing. On the edge of a body half the neighbours are
//! missing, which reduces it by a fifth; an isolated vorton has 0.4.

use super::{
    Flow, Remesh,
    gaussian_sums::{NeighbourSums, Weight},
};
use crate::math::elementary::cbrt;
use crate::par;

impl Flow {
    /// The overlap around every vorton: its core over the local spacing.
    pub fn overlap(&self) -> Vec<f32> {
        let neighbours = NeighbourSums::new(&self.vortons);
        let sums = neighbours.sums(Weight::Density, |_| [1.0, 0.0, 0.0, 0.0]);
        let mut overlap = vec![0.0; sums.len()];
        par::fill(&mut overlap, |i| self.vortons.core[i] * cbrt(sums[i][0]));
        overlap
    }

    /// The fraction of Σ|Γ| in vortons whose overlap is outside the limits of `remesh`, 0..1.
    pub(super) fn fraction_outside_overlap(&self, remesh: &Remesh) -> f64 {
        let overlap = self.overlap();
        let size = |i: usize| f64::from(self.vortons.strength[i].norm());
        let limits = remesh.least * remesh.core..=remesh.most * remesh.core;
        let is_outside = |i: usize| !remesh.is_wide(self.vortons.core[i]) && !limits.contains(&overlap[i]);
        let whole = par::sum(overlap.len(), size);
        let outside = par::sum(overlap.len(), |i| if is_outside(i) { size(i) } else { 0.0 });
        if whole > 0.0 { outside / whole } else { 0.0 }
    }
}
