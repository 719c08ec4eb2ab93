//! Signed distance to an isosurface of a field (a level set), or to a triangle mesh.
//!
//! [`from_triangles`] samples the distance to a mesh on a dense grid, [`Sampled`]; what follows is about
//! fields.
//!
//! *Method* [gourlay17], [zhao05]: a threshold turns the field into an indicator (inside or outside). Where
//! two neighbouring nodes differ, the field's values give the place along the edge where the surface crosses.
//! From the crossings the nodes next to the surface get their distance at once and are pinned. The Eikonal
//! equation |∇u| = 1 extends the distance from there, by fast sweeping: Gauss–Seidel sweeps in eight orders,
//! which run as a wavefront over bricks.
//!
//! *Departs from the paper*: pinned values use the plane through up to three crossings ([`SeedRule`]). The
//! sweeps are repeated until nothing changes, and stop at a narrow band. Converged bricks are skipped, which
//! changes no bit. Differences of second order ([`Order`]) may follow. On dense grids the
//! first-order sweeps are in [`dense`].
//!
//! Symbols: φ field, t threshold, u distance [voxels, then m].
//!
//! Limits: the order of accuracy in the voxel is the chosen one away from edges of the surface, and the first
//! behind them. A feature thinner than a voxel between two nodes of the same side is not resolved.

mod brick_blocks;
mod bvh;
mod crossings;
pub mod dense;
mod from_triangles;
mod godunov;
mod linked;
mod sampled;
mod second;
mod seed;
mod soundness;
mod sweep;
mod triangles;

pub(crate) use bvh::{TriangleBvh, closest_point};
pub(crate) use from_triangles::{MARGIN_NODES, SAMPLED_VERSION, on_grid, sampled_grid};
pub use from_triangles::{Solidified, from_triangles};
pub use sampled::Sampled;
pub(crate) use sampled::SampledGrid;
pub(crate) use soundness::Soundness;
pub use triangles::Triangles;
pub(crate) use triangles::{bounds, volume_below};

pub use second::{Nodes, Order, refine};
pub use seed::{SeedRule, Seeds, seeds};
pub use sweep::{Swept, sweep, sweep_in_order};

use crate::grid::{BRICK_NODES, SparseGrid, is_set};
use crate::par;
use linked::LinkedBricks;

/// How distance is found from a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SdfParams {
    /// How nodes next to the surface get their distance.
    pub seed: SeedRule,
    /// How far from the surface distances are found [voxels], from 1 to 10⁷. Infinite: at every node of the
    /// field's bricks. Cost and memory grow with it.
    pub band: f32,
    /// The order of the differences.
    pub order: Order,
    /// Bricks along the edge of the blocks that threads take at a time, at least 1. Changes the time, never
    /// the result.
    pub block: usize,
}

impl Default for SdfParams {
    fn default() -> Self {
        Self { seed: SeedRule::Plane, band: 3.0, order: Order::First, block: 1 }
    }
}

/// Signed distance on bricks: negative inside, positive outside, never zero and never NaN.
///
/// Invariants:
/// - A node is inside (negative) exactly if the field there is at or above the threshold.
/// - Every grid cell with nodes on both sides has all eight nodes in existing bricks. Bricks that the band
///   does not reach are left out, so a missing brick means that no surface crosses there.
/// - Nodes that the band does not reach hold ±`band`; they are counted in `unreached`.
#[derive(Clone, Debug)]
pub struct SignedDistance {
    /// The distances [m].
    pub grid: SparseGrid,
    /// The largest magnitude in `grid` [m]; infinite after a full solve.
    pub band: f32,
    /// Nodes whose distance comes directly from crossings.
    pub pinned: usize,
    /// Pinned nodes nearer than 10⁻⁶ voxel to the surface, among them all exactly on it: set to that
    /// distance.
    pub on_surface: usize,
    /// Nodes without a distance of their own: they hold ±`band`, which is ±∞ after a full solve.
    pub unreached: usize,
    /// Sweeps run until nothing changed.
    pub sweeps: usize,
}

/// The signed distance to the surface where `field` crosses `threshold` from below (outside) to above
/// (inside). Where it has no brick it is zero; no edge between two bricks without values crosses the surface.
///
/// # Panics
/// If `threshold` is not above zero, or not below 1 while bricks are filled, if the band is out of its range
/// or a block has no brick.
pub fn from_density(field: &SparseGrid, threshold: f32, params: &SdfParams) -> SignedDistance {
    assert!(threshold > 0.0, "a missing brick is outside, so the threshold is above zero");
    assert!(
        threshold < 1.0 || field.filled.is_empty(),
        "a filled brick is inside, so the threshold is below one"
    );
    let reach = params.order.reach(params.band);
    let seeds = seeds(field, threshold, &SdfParams { band: reach, ..*params });
    let mut swept = sweep(&seeds.bricks, &seeds.distance, reach, params.block);
    if params.order == Order::Second {
        let inside = |slot: usize| is_set(&seeds.inside[slot / BRICK_NODES], slot % BRICK_NODES);
        swept = refine(&LinkedBricks::new(&seeds.bricks), swept, params.band, inside);
    }
    let mut grid = SparseGrid::of(field.voxel, seeds.bricks, swept.distance);

    // The indicator gives the sign, the band the largest magnitude.
    let band = params.band * field.voxel;
    par::for_chunks(&mut grid.values, BRICK_NODES, |start, values| {
        let inside = &seeds.inside[start / BRICK_NODES];
        for (place, value) in values.iter_mut().enumerate() {
            let distance = (value.abs() * field.voxel).min(band);
            *value = if is_set(inside, place) { -distance } else { distance };
        }
    });
    SignedDistance {
        grid,
        band,
        pinned: seeds.pinned,
        on_surface: seeds.on_surface,
        unreached: swept.unreached,
        sweeps: swept.sweeps,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Bricks, node_of};
    use crate::math::Vec3;

    /// Small whole numbers, a third of them exactly at the threshold 2, on bricks that do not all touch.
    fn steps() -> SparseGrid {
        let bricks = Bricks::new(vec![[0, 0, 0], [1, 0, 0], [0, 1, 1], [-3, 0, 0], [0, 0, -1], [4, 4, 4]]);
        let mut grid = SparseGrid::new(0.5, bricks, 0.0);
        for (i, value) in grid.values.iter_mut().enumerate() {
            *value = ((i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 60) as f32 / 4.0;
            *value = value.floor();
        }
        grid
    }

    fn field_at(field: &SparseGrid, node: [i32; 3]) -> f32 {
        field.get(node).unwrap_or(0.0)
    }

    #[test]
    fn every_cell_on_the_surface_has_its_eight_nodes() {
        for band in [1.0, 2.5, 9.0, f32::INFINITY] {
            let field = steps();
            let sdf = from_density(&field, 2.0, &SdfParams { band, ..SdfParams::default() });
            let mut cells = 0;
            for &coord in field.bricks.coords() {
                for place in 0..BRICK_NODES {
                    // The eight cells that a node of the field belongs to.
                    let node = node_of(coord, place);
                    for cell in 0..8 {
                        let corner: [i32; 3] = std::array::from_fn(|axis| node[axis] - (cell >> axis & 1));
                        let nodes: [[i32; 3]; 8] = std::array::from_fn(|i| {
                            std::array::from_fn(|axis| corner[axis] + (i as i32 >> axis & 1))
                        });
                        let inside = nodes.map(|node| field_at(&field, node) >= 2.0);
                        if inside.iter().any(|&v| v != inside[0]) {
                            cells += 1;
                            for (node, inside) in nodes.iter().zip(inside) {
                                let value = sdf.grid.get(*node).expect("the node's brick exists");
                                assert!(inside == (value < 0.0) && value != 0.0 && value.is_finite());
                            }
                        }
                    }
                }
            }
            assert!(cells > 1000);
        }
    }

    #[test]
    fn the_sign_is_that_of_the_indicator_and_the_magnitude_within_the_band() {
        let field = steps();
        let sdf = from_density(&field, 2.0, &SdfParams { band: 2.5, ..SdfParams::default() });
        let mut counts = [0; 2];
        for (i, &value) in sdf.grid.values.iter().enumerate() {
            let node = node_of(sdf.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
            assert_eq!(field_at(&field, node) >= 2.0, value < 0.0);
            assert!(value != 0.0 && value.abs() <= sdf.band);
            counts[0] += usize::from(value.abs() == sdf.band);
            counts[1] += usize::from(field_at(&field, node) == 2.0);
        }
        assert_eq!(sdf.unreached, counts[0]);
        assert!(counts[1] > 500 && sdf.on_surface > 500 && sdf.on_surface <= counts[1]);
    }

    #[test]
    fn fields_without_a_surface_give_no_bricks() {
        let params = SdfParams::default();
        let nothing = from_density(&SparseGrid::new(0.1, Bricks::default(), 0.0), 0.5, &params);
        assert!(nothing.grid.values.is_empty() && nothing.sweeps == 0);
        let thin = SparseGrid::new(0.1, Bricks::new(vec![[0, 0, 0]]), 0.4);
        assert!(from_density(&thin, 0.5, &params).grid.bricks.is_empty());

        // A full solve keeps the field's bricks, and counts that no node has a distance.
        let full = from_density(&thin, 0.5, &SdfParams { band: f32::INFINITY, ..SdfParams::default() });
        assert_eq!(full.unreached, BRICK_NODES);
        assert!(full.grid.values.iter().all(|&v| v == f32::INFINITY));

        // A brick that is full has its surface where missing bricks begin.
        let solid = from_density(&SparseGrid::new(0.1, Bricks::new(vec![[0, 0, 0]]), 1.0), 0.5, &params);
        assert_eq!(solid.grid.bricks.len(), 27);
        assert!((solid.grid.get([0, 4, 4]).unwrap() + 0.05).abs() < 1e-6);
        assert!((solid.grid.get([-1, 4, 4]).unwrap() - 0.05).abs() < 1e-6);
    }

    #[test]
    fn no_field_gives_a_distance_that_is_nan() {
        let wild = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 2.0, 0.0, 1e-40];
        for seed in [SeedRule::Plane, SeedRule::NearestEdge, SeedRule::DensityRatio] {
            let mut field = steps();
            for (i, value) in field.values.iter_mut().enumerate().filter(|(i, _)| i % 3 == 0) {
                *value = wild[i * 7919 / 16 % wild.len()];
            }
            let sdf = from_density(&field, 2.0, &SdfParams { seed, ..SdfParams::default() });
            for (i, &value) in sdf.grid.values.iter().enumerate() {
                let node = node_of(sdf.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
                assert!(value != 0.0 && value.abs() <= sdf.band, "{value}"); // a NaN is in no range
                assert_eq!(field_at(&field, node) >= 2.0, value < 0.0);
            }
        }
    }

    #[test]
    fn the_plane_rule_is_closer_than_the_nearest_edge() {
        let center = Vec3::new(0.31, -0.17, 0.05);
        let exact = |x: Vec3| (x - center).norm() - 10.3;
        let field =
            SparseGrid::sample(1.0, Vec3::repeat(-16.0), Vec3::repeat(15.0), |x| 1.0 - exact(x) / 16.0);
        let error = |seed: SeedRule| {
            let found = seeds(&field, 1.0, &SdfParams { seed, ..SdfParams::default() });
            let (mut sum, mut worst, mut count) = (0.0, 0.0_f32, 0.0);
            for (i, &value) in found.distance.iter().enumerate().filter(|(_, d)| **d < 0.0) {
                let node = node_of(found.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
                let error = (-value - exact(field.position(node)).abs()).abs();
                sum += error;
                worst = worst.max(error);
                count += 1.0;
            }
            (sum / count, worst)
        };
        let (plane, edge) = (error(SeedRule::Plane), error(SeedRule::NearestEdge));
        println!("mean and worst error [voxels]: plane {plane:?}, nearest edge {edge:?}");
        assert!(plane.0 < 0.3 * edge.0 && plane.1 < 0.6 * edge.1);
        assert!(plane.0 < 0.05 && plane.1 < 0.25);
    }
}
