//! Particles → density on sparse bricks.
//!
//! *Method* the weighted sum of [mcg03] with each particle's own volume: V_j = m/ρ_j, ρ_j = m Σ_k W(x_j − x_k, h)
//! with k = j included, φ(x) = Σ_j V_j W(x − x_j, h). The particle mass cancels. Filled space has φ ≈ 1; a
//! droplet that has no neighbour has V = 1/W(0), thus φ = 1 at its centre, and does not vanish.
//! Kernel: the cubic spline of [monaghan92], written as 2(1−q)₊³ − 8(½−q)₊³, which is the same polynomial without
//! a branch.
//! *Departs from the paper*: none.
//!
//! Every brick gathers the particles around it in a fixed order, so the bytes do not depend on threads.
//!
//! Symbols: q = r/h [–], K(q) = W(r, h)/W(0, h) [–], w_j = 1/Σ_k K(q_jk) = V_j W(0, h) [–].
//!
//! Limits: cost grows with the particles inside one kernel, so many particles in one place (not a liquid) are slow.

use super::bins::{Bins, Local};
use super::threshold::surface_threshold;
use crate::grid::{BRICK, BRICK_NODES, SparseGrid, node_of};
use crate::space::CellGrid;
use crate::{math::Vec3, par};

/// How particles become a density.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DensityParams {
    /// Distance between particles at rest [m].
    pub spacing: f32,
    /// Support h of the kernel [spacings], 1 to 8.
    pub kernel_radius: f32,
    /// Distance between nodes [spacings].
    pub voxel: f32,
}

/// A density of particles on bricks.
#[derive(Clone, Debug)]
pub struct Density {
    /// φ [–]: 0 outside, about 1 inside. A missing brick is 0 everywhere.
    pub grid: SparseGrid,
    /// The φ of the surface: see [`surface_threshold`].
    pub threshold: f32,
    /// Particles further than 2³⁰ voxels from the origin along an axis, which no brick can hold: left out.
    pub too_far: usize,
    /// Particles that show in no node: all eight around them are below the threshold. None at voxels up to half a
    /// spacing; above that droplets may fall between the nodes.
    pub unseen: usize,
}

/// The density of particles at `positions` [m], which are finite and fewer than 2³².
///
/// # Panics
/// If a parameter is not above zero and finite.
pub fn density(positions: &[Vec3], params: &DensityParams) -> Density {
    let valid = |v: f32| v > 0.0 && v.is_finite();
    assert!(valid(params.spacing) && valid(params.kernel_radius) && valid(params.voxel), "valid {params:?}");
    let voxel = params.voxel * params.spacing;
    let reach = params.kernel_radius / params.voxel;

    let weights = weights(positions, params.kernel_radius * params.spacing);
    let bins = Bins::new(positions, voxel);
    let mut grid = SparseGrid::new(voxel, bins.within(reach), 0.0);
    let bricks = &grid.bricks;
    par::for_chunks(&mut grid.values, BRICK_NODES, |start, values| {
        gather(&bins, &weights, bricks.coords()[start / BRICK_NODES], reach, values);
    });
    let threshold = surface_threshold(params.kernel_radius);
    let unseen = unseen(&bins, &grid, threshold);
    Density { grid, threshold, too_far: bins.too_far, unseen }
}

/// K(q) = W(r, h)/W(0, h) of the cubic spline.
#[inline]
pub(super) fn kernel(q: f32) -> f32 {
    let a = (1.0 - q).max(0.0);
    let b = (0.5 - q).max(0.0);
    2.0 * a * a * a - 8.0 * b * b * b
}

/// w_j = V_j W(0, h) = 1/Σ_k K(q_jk) for every particle.
fn weights(positions: &[Vec3], h: f32) -> Vec<f32> {
    let cells = CellGrid::new(positions, h);
    let mut weights = vec![0.0; positions.len()];
    par::fill(&mut weights, |j| {
        let mut sum = 0.0;
        cells.for_each_within(positions, positions[j], h, |_, r2| sum += kernel(r2.sqrt() / h));
        1.0 / sum
    });
    weights
}

/// How many particles have no node at or above the threshold among the eight around them.
fn unseen(bins: &Bins, grid: &SparseGrid, threshold: f32) -> usize {
    let counts = par::map_chunks(bins.bricks.len(), 64, |range| {
        let shows = |bin: usize, particle: &Local| {
            let first = node_of(bins.bricks.coords()[bin], 0);
            (0..8).any(|corner| {
                let node = [0, 1, 2].map(|d| first[d] + particle.position[d] as i32 + (corner >> d & 1));
                grid.get(node).is_some_and(|value| value >= threshold)
            })
        };
        range.map(|bin| bins.particles(bin).iter().filter(|p| !shows(bin, p)).count()).sum::<usize>()
    });
    counts.into_iter().sum()
}

/// Adds to the nodes of the brick at `coord` what the particles within `reach` [voxels] give.
fn gather(bins: &Bins, weights: &[f32], coord: [i32; 3], reach: f32, values: &mut [f32]) {
    let values: &mut [f32; BRICK_NODES] = values.try_into().expect("one brick");
    let away = (reach / BRICK as f32).ceil() as i32;
    for z in -away..=away {
        for y in -away..=away {
            for x in -away..=away {
                let Some(bin) = bins.bricks.find([coord[0] + x, coord[1] + y, coord[2] + z]) else {
                    continue;
                };
                for particle in bins.particles(bin) {
                    let shift = [x, y, z].map(|v| (v * BRICK as i32) as f32);
                    let p = [0, 1, 2].map(|axis| particle.position[axis] + shift[axis]);
                    splat(p, weights[particle.index as usize], reach, values);
                }
            }
        }
    }
}

/// Adds one particle at `p` [voxels from the brick's first node] with weight `w`.
#[inline]
fn splat(p: [f32; 3], w: f32, reach: f32, values: &mut [f32; BRICK_NODES]) {
    // A particle whose sphere misses the brick's box of nodes gives nothing.
    let far = p.map(|v| v - v.clamp(0.0, (BRICK - 1) as f32));
    let reach2 = reach * reach;
    if far[0] * far[0] + far[1] * far[1] + far[2] * far[2] >= reach2 {
        return;
    }

    // Rows that the sphere meets are done whole: eight nodes without a branch cost less than testing each.
    let inverse = 1.0 / reach;
    let dx2: [f32; BRICK] = std::array::from_fn(|x| (x as f32 - p[0]).powi(2));
    let (first_z, last_z) = rows(p[2], reach);
    let (first_y, last_y) = rows(p[1], reach);
    for z in first_z..last_z {
        let dz2 = (z as f32 - p[2]).powi(2);
        for y in first_y..last_y {
            let row2 = dz2 + (y as f32 - p[1]).powi(2);
            if row2 + far[0] * far[0] >= reach2 {
                continue;
            }
            let start = BRICK * (y + BRICK * z);
            for (value, d2) in values[start..start + BRICK].iter_mut().zip(dx2) {
                *value += w * kernel((d2 + row2).sqrt() * inverse); // φ += V_j W
            }
        }
    }
}

/// The range of rows 0..8 closer than `reach` to `p`.
#[inline]
pub(super) fn rows(p: f32, reach: f32) -> (usize, usize) {
    let first = (p - reach).ceil().max(0.0) as usize;
    let last = (p + reach).floor().clamp(-1.0, (BRICK - 1) as f32) as i32;
    (first, (last + 1) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::kernel::CubicSpline;

    const PARAMS: DensityParams = DensityParams { spacing: 0.1, kernel_radius: 2.0, voxel: 0.5 };

    /// Particles on a lattice, each moved by up to `jitter` spacings along each axis.
    fn lattice(n: [i32; 3], jitter: f32) -> Vec<Vec3> {
        let mut state = 1_u64;
        let mut random = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1 << 23) as f32 - 1.0
        };
        let mut positions = Vec::new();
        for z in 0..n[2] {
            for y in 0..n[1] {
                for x in 0..n[0] {
                    let at = [x, y, z].map(|v| (v as f32 + 0.5 + jitter * random()) * PARAMS.spacing);
                    positions.push(Vec3::from(at));
                }
            }
        }
        positions
    }

    #[test]
    fn the_kernel_is_the_cubic_spline() {
        let spline = CubicSpline::new(1.0);
        for i in 0..=120 {
            let q = i as f32 / 100.0;
            assert!((kernel(q) - spline.value(q) / spline.value(0.0)).abs() < 1e-6, "q {q}");
        }
    }

    #[test]
    fn every_node_holds_the_sum_over_all_particles() {
        let h = PARAMS.kernel_radius * PARAMS.spacing;
        let spline = CubicSpline::new(h);
        let positions: Vec<Vec3> =
            lattice([6, 5, 4], 0.4).into_iter().map(|x| x - Vec3::new(0.23, 0.31, 0.17)).collect();
        let volumes: Vec<f32> = positions
            .iter()
            .map(|x| 1.0 / positions.iter().map(|y| spline.value((x - y).norm())).sum::<f32>())
            .collect();
        for voxel in [0.3, 0.5, 1.0, 3.0] {
            let found = density(&positions, &DensityParams { voxel, ..PARAMS });
            let n = (1.2 / (voxel * PARAMS.spacing)) as i32;
            let mut above = 0;
            for i in 0..(2 * n + 1).pow(3) {
                let node = [0, 1, 2].map(|axis| i / (2 * n + 1).pow(axis) % (2 * n + 1) - n);
                let x = found.grid.position(node);
                let exact: f32 =
                    positions.iter().zip(&volumes).map(|(y, v)| v * spline.value((x - y).norm())).sum();
                let value = found.grid.get(node).unwrap_or(0.0);
                assert!((value - exact).abs() < 2e-5, "{node:?}: {value} for {exact}");
                above += usize::from(exact > 0.5);
            }
            assert!(above > 0);
        }
    }

    #[test]
    fn a_lone_droplet_does_not_vanish() {
        let found = density(&[Vec3::new(0.1, -0.2, 0.3)], &PARAMS);
        assert!((found.grid.get([2, -4, 6]).unwrap() - 1.0).abs() < 1e-5);
        assert!(found.threshold < 0.9);
        assert!(found.grid.values.iter().all(|v| v.is_finite()));
        let none = density(&[], &PARAMS);
        assert!(none.grid.bricks.is_empty() && none.threshold == found.threshold);
    }

    #[test]
    fn a_flat_surface_lies_half_a_spacing_beyond_the_last_layer() {
        for kernel_radius in [1.0, 1.5, 2.0, 3.0] {
            // One node column an eighth of a spacing, over the middle of a wide slab.
            let params = DensityParams { kernel_radius, voxel: 0.125, spacing: 0.1 };
            let found = density(&lattice([9, 9, 9], 0.0), &params);
            let column = |i: i32, j: i32| {
                let at = |k: i32| found.grid.get([32 + i, 32 + j, k]).unwrap_or(0.0);
                let above = (60..100).rev().find(|&k| at(k) >= found.threshold);
                above.map(|k| {
                    let (a, b) = (at(k), at(k + 1));
                    (k as f32 + (a - found.threshold) / (a - b)) / 8.0
                })
            };
            let heights: Vec<f32> = (0..64).filter_map(|i| column(i % 8, i / 8)).collect();
            let mean = heights.iter().sum::<f32>() / heights.len() as f32;
            println!(
                "kernel {kernel_radius}: surface at {:.4} spacings, {} columns",
                mean - 8.5,
                heights.len()
            );
            let bound = if kernel_radius < 1.5 { 0.15 } else { 0.01 };
            assert!((mean - 9.0).abs() < bound && heights.len() == 64, "kernel {kernel_radius}: {mean}");
        }
    }

    #[test]
    fn particles_between_coarse_nodes_are_counted() {
        // Drops ten spacings apart, everywhere between the nodes.
        let drops: Vec<Vec3> = (0..1000)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| v as f32 * 1.037))
            .map(Vec3::from)
            .collect();
        let unseen =
            |positions: &[Vec3], voxel: f32| density(positions, &DensityParams { voxel, ..PARAMS }).unseen;
        let drops_lost = [0.25, 0.5, 1.0, 2.0, 5.0].map(|voxel| unseen(&drops, voxel));
        let filled_lost = [0.5, 1.0, 2.0].map(|voxel| unseen(&lattice([9, 9, 9], 0.3), voxel));
        println!("unseen: {drops_lost:?} of 1000 drops, {filled_lost:?} of 729 in a block");
        assert_eq!(drops_lost[..2], [0, 0]);
        assert!(drops_lost[3] > 500 && drops_lost[4] > 900);
        assert_eq!(filled_lost[..2], [0, 0]);
    }

    #[test]
    fn memory_follows_the_particles() {
        // Spray over 10 km, drops at 1000 km, and one that no brick can hold.
        let mut positions: Vec<Vec3> = (0..500)
            .map(|i| {
                Vec3::new((i * 7919 % 10_007) as f32, (i * 104_729 % 10_007) as f32, (i * 31 % 997) as f32)
            })
            .collect();
        positions.extend((0..20).map(|i| Vec3::new(1e6 + i as f32 * 1.0625, -1e6, 1e6)));
        positions.push(Vec3::new(1e30, 0.0, 0.0));
        let found = density(&positions, &PARAMS);
        assert!(found.grid.bricks.len() <= 27 * positions.len());
        assert_eq!(found.too_far, 1);

        // Every drop is alone and stands where it was put, to the digits of its own position.
        let voxel = f64::from(found.grid.voxel);
        for x in &positions[..520] {
            let nodes = [0, 1, 2].map(|axis| f64::from(x[axis]) / voxel);
            let node = nodes.map(|v| v.round());
            let off = nodes.iter().zip(node).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            let value = found.grid.get(node.map(|v| v as i32)).unwrap();
            assert!(
                (value - kernel((off * voxel / 0.2) as f32)).abs() < 1e-4 && value > found.threshold,
                "{x:?}"
            );
        }
        assert!(found.grid.values.iter().all(|v| v.is_finite()));
    }

    #[test]
    fn bytes_do_not_depend_on_threads() {
        let positions = lattice([17, 16, 15], 0.45);
        let run = |threads: usize| par::with_threads(threads, || density(&positions, &PARAMS));
        let one = run(1);
        let bits = |found: &Density| found.grid.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        for threads in [2, 3, 8] {
            let other = run(threads);
            assert_eq!(one.grid.bricks.coords(), other.grid.bricks.coords());
            assert!(bits(&one) == bits(&other), "{threads} threads");
        }
    }
}
