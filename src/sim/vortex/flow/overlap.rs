//! Whether cores still overlap.
//!
//! *Method*: the number of vortons a volume around each, by a Gaussian of its core, is that of a lattice of spacing n^(-⅓); σ over
//! that is the overlap. On the edge of a body half the neighbours are missing, so a fifth of the overlap; a vorton alone has 0.4.

use super::{
    Flow, Remesh,
    near::{Near, Weight},
};
use crate::par;

impl Flow {
    /// Cores per spacing around every vorton.
    pub fn overlap(&self) -> Vec<f32> {
        let near = Near::new(&self.vortons);
        let sums = near.sums(Weight::Density, |_| [1.0, 0.0, 0.0, 0.0]);
        let mut overlap = vec![0.0; sums.len()];
        par::fill(&mut overlap, |i| self.vortons.core[i] * sums[i][0].cbrt());
        overlap
    }

    /// The share of Σ|Γ| that vortons outside the overlap wanted hold, 0..1.
    pub(super) fn astray(&self, wanted: &Remesh) -> f64 {
        let overlap = self.overlap();
        let size = |i: usize| f64::from(self.vortons.strength[i].norm());
        let wished = wanted.least * wanted.core..=wanted.most * wanted.core;
        let outside = |i: usize| !wanted.is_wide(self.vortons.core[i]) && !wished.contains(&overlap[i]);
        let whole = par::sum(overlap.len(), size);
        let astray = par::sum(overlap.len(), |i| if outside(i) { size(i) } else { 0.0 });
        if whole > 0.0 { astray / whole } else { 0.0 }
    }
}
