//! Finite differences on a grid.
//!
//! *Method*: central differences of the sixth order, (45 (f₁ − f₋₁) − 9 (f₂ − f₋₂) + (f₃ − f₋₃))/60h.

use super::uniform::VectorField;
use crate::{
    par,
    simd::{self, Lanes, Pass},
};

/// Nodes that a difference needs on each side.
pub(super) const STENCIL_REACH: usize = 3;

/// Weights of f₁ − f₋₁, f₂ − f₋₂ and f₃ − f₋₃, times h.
const WEIGHTS: [f32; STENCIL_REACH] = [0.75, -0.15, 1.0 / 60.0];

/// ∇ × A; zero within three nodes of the boundary.
pub(super) fn curl(field: &VectorField) -> VectorField {
    let mut out = VectorField::new(field.grid);
    for k in 0..3 {
        let (b, c) = ((k + 1) % 3, (k + 2) % 3);
        let terms = [(&field.values[c][..], b, 1.0), (&field.values[b][..], c, -1.0)];
        add_differences(field, &terms, &mut out.values[k]);
    }
    out
}

/// ∇u_i of every component i; zero within three nodes of the boundary.
pub(super) fn gradient(field: &VectorField) -> [VectorField; 3] {
    [0, 1, 2].map(|i| {
        let mut out = VectorField::new(field.grid);
        for j in 0..3 {
            add_differences(field, &[(&field.values[i], j, 1.0)], &mut out.values[j]);
        }
        out
    })
}

/// Adds Σ ± ∂f/∂x_axis over `terms` (f, axis, sign).
fn add_differences(field: &VectorField, terms: &[(&[f32], usize, f32)], out: &mut [f32]) {
    let grid = field.grid;
    let inner = |at: usize, axis: usize| at >= STENCIL_REACH && at + STENCIL_REACH <= grid.cells[axis];
    par::for_chunks(out, grid.plane(), |first, plane| {
        let z = first / grid.plane();
        for (y, row) in plane.chunks_exact_mut(grid.row()).enumerate() {
            if !inner(z, 2) || !inner(y, 1) || grid.cells[0] < 2 * STENCIL_REACH {
                continue;
            }
            let from = grid.index([STENCIL_REACH, y, z]);
            let row = &mut row[STENCIL_REACH..=grid.cells[0] - STENCIL_REACH];
            for &(f, axis, sign) in terms {
                let step = [1, grid.row(), grid.plane()][axis];
                let weights = WEIGHTS.map(|w| w * sign / grid.spacing);
                simd::dispatch(Differences { f, from, step, weights, row });
            }
        }
    });
}

/// Adds weighted differences to a row.
struct Differences<'a> {
    f: &'a [f32],
    from: usize,
    step: usize,
    weights: [f32; STENCIL_REACH],
    row: &'a mut [f32],
}

impl Pass for Differences<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
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
    use crate::{math::Vec3, sim::vortex::grid::uniform::UniformGrid};

    #[test]
    fn differences_are_of_sixth_order() {
        // The curl and the gradient of waves, on grids of which the second has half the spacing.
        let [coarse, fine] = [8, 16].map(|n| {
            let grid = UniformGrid {
                low: Vec3::new(0.1, -0.2, 0.3),
                spacing: 2.0 / n as f32,
                cells: [n, n + 1, n + 2],
            };
            let mut field = VectorField::new(grid);
            for z in 0..=n + 2 {
                for y in 0..=n + 1 {
                    for x in 0..=n {
                        let at = grid.node([x, y, z]).map(|c| 4.0 * c);
                        let vector = Vec3::new(at.y.sin(), (at.z + at.x).sin(), (at.y * 0.5).cos());
                        field.set([x, y, z], vector);
                    }
                }
            }
            let node = [n / 2, n / 2, n / 2];
            let at = grid.node(node).map(|c| 4.0 * c);
            let wave = 4.0 * (at.z + at.x).cos();
            let expected = Vec3::new(-2.0 * (at.y * 0.5).sin() - wave, 0.0, wave - 4.0 * at.y.cos());
            let row = gradient(&field)[1].at(node);
            (curl(&field).at(node) - expected).norm() + (row - Vec3::new(wave, 0.0, wave)).norm()
        });
        let order = (coarse / fine).log2();
        assert!(order > 5.4, "{order}");
    }
}
