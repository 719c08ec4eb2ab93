//! Derivatives on a lattice.
//!
//! *Method*: central differences of the sixth order, (45 (f₁ − f₋₁) − 9 (f₂ − f₋₂) + (f₃ − f₋₃))/60h.

use super::lattice::Field;
use crate::{
    math::wide::{self, Job},
    par,
};

/// Nodes from the boundary that a difference needs.
pub(super) const REACH: usize = 3;

/// Weights of f₁ − f₋₁, f₂ − f₋₂ and f₃ − f₋₃, times h.
const WEIGHTS: [f32; REACH] = [0.75, -0.15, 1.0 / 60.0];

/// ∇ × A; zero within three nodes of the boundary.
pub(super) fn curl(field: &Field) -> Field {
    let mut out = Field::new(field.lattice);
    for k in 0..3 {
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        let parts = [(&field.values[c][..], b, 1.0), (&field.values[b][..], c, -1.0)];
        sum(field, &parts, &mut out.values[k]);
    }
    out
}

/// ∇u_i of every component i; zero within three nodes of where the field is.
pub(super) fn gradient(field: &Field) -> [Field; 3] {
    [0, 1, 2].map(|i| {
        let mut out = Field::new(field.lattice);
        for j in 0..3 {
            sum(field, &[(&field.values[i], j, 1.0)], &mut out.values[j]);
        }
        out
    })
}

/// Writes Σ ± ∂f/∂x_axis of `parts` (f, axis, sign).
fn sum(field: &Field, parts: &[(&[f32], usize, f32)], out: &mut [f32]) {
    let lattice = field.lattice;
    let inner = |at: usize, axis: usize| at >= REACH && at + REACH <= lattice.cells[axis];
    par::for_chunks(out, lattice.plane(), |first, plane| {
        let z = first / lattice.plane();
        for (y, row) in plane.chunks_exact_mut(lattice.row()).enumerate() {
            if !inner(z, 2) || !inner(y, 1) || lattice.cells[0] < 2 * REACH {
                continue;
            }
            let from = lattice.place([REACH, y, z]);
            let row = &mut row[REACH..=lattice.cells[0] - REACH];
            for &(f, axis, sign) in parts {
                let step = [1, lattice.row(), lattice.plane()][axis];
                let weights = WEIGHTS.map(|w| w * sign / lattice.spacing);
                wide::run(Differences { f, from, step, weights, row });
            }
        }
    });
}

/// Adds weighted differences to a row.
struct Differences<'a> {
    f: &'a [f32],
    from: usize,
    step: usize,
    weights: [f32; REACH],
    row: &'a mut [f32],
}

impl Job for Differences<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Self { f, from, step, weights, row } = self;
        let count = row.len();
        for (k, weight) in weights.into_iter().enumerate() {
            let ahead = &f[from + (k + 1) * step..][..count];
            let behind = &f[from - (k + 1) * step..][..count];
            for i in 0..count {
                row[i] += weight * (ahead[i] - behind[i]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{math::Vec3, sim::vortex::grid::lattice::Lattice};

    #[test]
    fn differences_are_of_sixth_order() {
        // The curl and the gradient of waves, on lattices of half the spacing each.
        let [coarse, fine] = [8, 16].map(|n| {
            let lattice =
                Lattice { low: Vec3::new(0.1, -0.2, 0.3), spacing: 2.0 / n as f32, cells: [n, n + 1, n + 2] };
            let mut field = Field::new(lattice);
            for z in 0..=n + 2 {
                for y in 0..=n + 1 {
                    for x in 0..=n {
                        let at = lattice.node([x, y, z]).map(|c| 4.0 * c);
                        let vector = Vec3::new(at.y.sin(), (at.z + at.x).sin(), (at.y * 0.5).cos());
                        field.set([x, y, z], vector);
                    }
                }
            }
            let node = [n / 2, n / 2, n / 2];
            let at = lattice.node(node).map(|c| 4.0 * c);
            let wave = 4.0 * (at.z + at.x).cos();
            let expected = Vec3::new(-2.0 * (at.y * 0.5).sin() - wave, 0.0, wave - 4.0 * at.y.cos());
            let row = gradient(&field)[1].at(node);
            (curl(&field).at(node) - expected).norm() + (row - Vec3::new(wave, 0.0, wave)).norm()
        });
        let order = (coarse / fine).log2();
        assert!(order > 5.4, "{order}");
    }
}
