//! Density of particles on sparse bricks.
//!
//! *Method* the weighted sum of [mcg03] with each particle's own volume: V_j = m/ρ_j, ρ_j = m Σ_k W(x_j −
//! x_k, h) with k = j included, φ(x) = Σ_j V_j W(x − x_j, h). The particle mass cancels. Filled space has
//! φ ≈ 1. A droplet without neighbours has V = 1/W(0), thus φ = 1 at its centre, and does not vanish. With
//! [`Anisotropy`] each W is stretched along its neighbourhood ([`super::anisotropy`]); without, G = I/h.
//! Kernel: the cubic spline of [monaghan92], written as 2(1−q)₊³ − 8(½−q)₊³, which is the same polynomial
//! without a branch.
//! *Departs from the paper*: bricks that are certainly filled are not computed, and rows of nodes that are
//! deep or faint are interpolated, see [`super::active`].
//!
//! Every brick gathers the particles around it in a fixed order, so the bytes do not depend on threads.
//!
//! Symbols: q = ‖G(x − x̄_j)‖ [–], K(q) = W/W(0) [–], w_j = 1/Σ_k K(q_jk) = V_j W(0, h) [–].
//!
//! Limits: cost grows with the number of particles inside one kernel, up to 64 times that of filled space;
//! of more, the surplus is left out ([`super::dense_clusters`]).

use super::{
    DensityParams,
    active::{Active, Coarse, SurfaceSize, smallest_scale},
    anisotropy::{self, KernelShaper},
    dense_clusters::sorted_thinned,
    fill::compute,
    kernel::weights,
    particle_kernel::ParticleKernels,
    scaled::{self, Scales},
    sorted_particles::SortedParticles,
    threshold::surface_threshold,
};
use crate::{
    grid::{BRICK, Bricks, MAX_BRICK, SparseGrid},
    math::Vec3,
    par,
};

/// A density of particles on bricks.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Density {
    /// φ [–]: 0 outside, about 1 inside. Its filled bricks were not computed, since they are inside; no edge
    /// between two bricks without values crosses the surface.
    pub grid: SparseGrid,
    /// The φ of the isosurface.
    pub threshold: f32,
    /// Particles further than 2³⁰ voxels from the origin along an axis, too far for any brick, which are left
    /// out.
    pub too_far: usize,
    /// Particles without trace: all eight nodes around them are below the threshold. There are none at voxels
    /// up to half a spacing; above that droplets may fall between the nodes.
    pub unseen: usize,
    /// Particles that are left out of dense clusters: more particles in a place than any liquid has.
    pub clustered: usize,
}

/// The density of particles at `positions` [m], which are finite and fewer than 2³².
///
/// # Panics
/// If a parameter is not above zero and finite.
pub fn density(positions: &[Vec3], params: &DensityParams) -> Density {
    density_of_radii(positions, None, params)
}

/// As [`density`], of particles whose kernels are larger or smaller: `scales` are their radii over half the spacing, above zero
/// and finite, one for each position; `None`: all 1.
///
/// # Panics
/// As [`density`], and if there are fewer scales than positions.
pub fn density_of_radii(positions: &[Vec3], scales: Option<&[f32]>, params: &DensityParams) -> Density {
    let valid = |v: f32| v > 0.0 && v.is_finite();
    assert!(valid(params.spacing) && valid(params.kernel_radius) && valid(params.voxel), "valid {params:?}");
    let voxel = params.voxel * params.spacing;
    let radius = params.kernel_radius * params.spacing;
    let Prepared { particles, scales, isotropic_kernels, isotropic_threshold, coarse, too_far, clustered } =
        Prepared::new(positions, scales, params);
    let scales = scales.as_ref();
    let (coarse, mut active) = match coarse {
        Some((coarse, active)) => (Some(coarse), active),
        None => (None, Active::all_in_reach(&particles, &isotropic_kernels, voxel)),
    };
    let (threshold, mut kernels, mut shaper) = match &params.anisotropy {
        Some(anisotropy) => {
            let shaper = KernelShaper::new(&particles, anisotropy, params, scales);
            let kernels = isotropic_kernels.into_ellipsoids(&particles);
            (anisotropy::threshold(anisotropy, params.kernel_radius), kernels, Some(shaper))
        }
        None => (isotropic_threshold, isotropic_kernels, None),
    };

    // Ellipsoids reach further than the isotropic kernels that selected the bricks; with `whole` all bricks
    // in their reach are computed.
    if params.whole
        && let Some(shaper) = &mut shaper
    {
        shaper.shape(&particles, &mut kernels, &vec![true; particles.len()]);
        active = Active::all_in_reach(&particles, &kernels, voxel);
    }

    // Compute the bricks, and those whose classification they contradict, until none is left.
    let mut grid = SparseGrid::new(voxel, std::mem::take(&mut active.computed), 0.0);
    let mut due = grid.bricks.clone();
    // Ellipsoids give other values than the coarse nodes have, and are added to all rows.
    let mut coarse = coarse.filter(|_| matches!(kernels, ParticleKernels::Isotropic { .. }));
    let reach = radius * scales.map_or(1.0, |scales| scales.largest);
    while !due.is_empty() {
        if let Some(shaper) = &mut shaper {
            shaper.shape(&particles, &mut kernels, &anisotropy::near(&particles, &due, voxel, reach));
        }
        let interpolate_rows = |coord, sums: &mut _| {
            coarse.as_ref().map_or(u64::MAX, |coarse| coarse.interpolate_rows(coord, sums))
        };
        compute(&mut grid, &due, &particles, &kernels, &interpolate_rows);
        coarse = None;
        let contradicted = active.contradicted(&grid, threshold, &due);
        active.remove_filled(&contradicted);
        grid.insert(&contradicted, 0.0);
        due = Bricks::new(contradicted);
    }
    grid.filled = active.filled;
    let unseen = unseen(&particles, &grid, threshold);
    Density { grid, threshold, too_far, unseen, clustered }
}

/// Particles in the order of cells, and the density of their isotropic kernels on coarse nodes.
struct Prepared {
    particles: SortedParticles,
    scales: Option<Scales>,
    isotropic_kernels: ParticleKernels,
    isotropic_threshold: f32,
    /// The coarse nodes and what they classify; `None` if all bricks in reach are computed.
    coarse: Option<(Coarse, Active)>,
    too_far: usize,
    clustered: usize,
}

impl Prepared {
    fn new(positions: &[Vec3], scales: Option<&[f32]>, params: &DensityParams) -> Self {
        let voxel = params.voxel * params.spacing;
        let (near, too_far) = within_bricks(positions, voxel);
        let near_scales =
            scales.filter(|_| near.is_some()).map(|scales| scales_of_near(positions, scales, voxel));
        let scales = near_scales.as_deref().or(scales);
        let positions = near.as_deref().unwrap_or(positions);

        let radius = params.kernel_radius * params.spacing;
        let (particles, kept) = sorted_thinned(positions, scales, params.spacing, radius);
        let clustered = positions.len() - particles.len();
        let scales = scales.map(|scales| match &kept {
            Some(kept) => {
                Scales::new(&particles, &kept.iter().map(|&i| scales[i as usize]).collect::<Vec<_>>())
            }
            None => Scales::new(&particles, scales),
        });
        let weights = match &scales {
            Some(scales) => scaled::weights(&particles, radius, scales),
            None => weights(&particles, radius),
        };
        let isotropic_kernels = ParticleKernels::isotropic(&particles, radius, weights, scales.as_ref());
        let isotropic_threshold = surface_threshold(params.kernel_radius);
        let coarse = if params.whole {
            None
        } else {
            Coarse::new(&particles, &isotropic_kernels, isotropic_threshold, params)
        };
        let coarse = coarse.map(|coarse| {
            let small = scales.as_ref().map_or_else(Vec::new, |scales| scales.below(smallest_scale(params)));
            let active = coarse.active(&particles, &small);
            (coarse, active)
        });
        Self { particles, scales, isotropic_kernels, isotropic_threshold, coarse, too_far, clustered }
    }
}

/// Approximate size of what [`density_of_radii`] computes without `whole`, and of a distance in a band of so many
/// voxels, in a fifth of its time or less; `None` if all bricks in reach are computed. Positions and scales as there; those
/// too far away are left out.
pub(crate) fn surface_size(
    positions: &[Vec3],
    scales: Option<&[f32]>,
    params: &DensityParams,
    band: f32,
) -> Option<SurfaceSize> {
    let Prepared { isotropic_threshold, coarse, .. } = Prepared::new(positions, scales, params);
    coarse.map(|(coarse, active)| coarse.surface_size(&active, isotropic_threshold, band))
}

/// Whether bricks can hold a position.
fn is_near(x: &Vec3, voxel: f32) -> bool {
    let limit = f64::from(MAX_BRICK) * BRICK as f64 * f64::from(voxel);
    x.iter().all(|&v| f64::from(v).abs() < limit)
}

/// The scales of the positions that bricks can hold.
fn scales_of_near(positions: &[Vec3], scales: &[f32], voxel: f32) -> Vec<f32> {
    positions.iter().zip(scales).filter(|(x, _)| is_near(x, voxel)).map(|(_, &scale)| scale).collect()
}

/// The positions that bricks can hold, if some are too far, and the number of the others.
fn within_bricks(positions: &[Vec3], voxel: f32) -> (Option<Vec<Vec3>>, usize) {
    let near = |x: &Vec3| is_near(x, voxel);
    let too_far = par::sum(positions.len(), |i| f64::from(u8::from(!near(&positions[i])))) as usize;
    if too_far == 0 {
        return (None, 0);
    }
    (Some(positions.iter().copied().filter(near).collect()), too_far)
}

/// Number of particles without a node at or above the threshold among the eight around them.
fn unseen(particles: &SortedParticles, grid: &SparseGrid, threshold: f32) -> usize {
    let counts = par::map_chunks(particles.len(), par::CHUNK, |range| {
        let shows = |&place: &usize| {
            let x = particles.at(place);
            let first = [0, 1, 2].map(|axis| (f64::from(x[axis]) / f64::from(grid.voxel)).floor() as i32);
            (0..8).any(|corner| grid.value([0, 1, 2].map(|d| first[d] + (corner >> d & 1))) >= threshold)
        };
        range.filter(|place| !shows(place)).count()
    });
    counts.into_iter().sum()
}

#[cfg(test)]
mod tests {
    use super::super::{Anisotropy, kernel::kernel};
    use super::*;

    const PARAMS: DensityParams =
        DensityParams { spacing: 0.1, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: true };

    /// Particles on a seeding lattice, each displaced by up to `jitter` spacings along each axis.
    fn seeding_lattice(n: [i32; 3], jitter: f32) -> Vec<Vec3> {
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

    /// The cubic spline of [monaghan92] at the distance `r`, scaled so that its support ends at `h` [1/m³].
    fn cubic_spline(h: f32, r: f32) -> f32 {
        let q = (r / h).min(1.0);
        let w = if q > 0.5 { 2.0 * (1.0 - q).powi(3) } else { 1.0 + 6.0 * q * q * (q - 1.0) };
        8.0 / (std::f32::consts::PI * h.powi(3)) * w
    }

    #[test]
    fn the_kernel_is_the_cubic_spline() {
        for i in 0..=120 {
            let q = i as f32 / 100.0;
            assert!((kernel(q) - cubic_spline(1.0, q) / cubic_spline(1.0, 0.0)).abs() < 1e-6, "q {q}");
        }
    }

    #[test]
    fn every_node_holds_the_sum_over_all_particles() {
        let h = PARAMS.kernel_radius * PARAMS.spacing;
        let positions: Vec<Vec3> =
            seeding_lattice([6, 5, 4], 0.4).into_iter().map(|x| x - Vec3::new(0.23, 0.31, 0.17)).collect();
        let volumes: Vec<f32> = positions
            .iter()
            .map(|x| 1.0 / positions.iter().map(|y| cubic_spline(h, (x - y).norm())).sum::<f32>())
            .collect();
        for voxel in [0.3, 0.5, 1.0, 3.0] {
            let found = density(&positions, &DensityParams { voxel, ..PARAMS });
            let n = (1.2 / (voxel * PARAMS.spacing)) as i32;
            let mut above = 0;
            for i in 0..(2 * n + 1).pow(3) {
                let node = [0, 1, 2].map(|axis| i / (2 * n + 1).pow(axis) % (2 * n + 1) - n);
                let x = found.grid.position(node);
                let exact: f32 =
                    positions.iter().zip(&volumes).map(|(y, v)| v * cubic_spline(h, (x - y).norm())).sum();
                let value = found.grid.get(node).unwrap_or(0.0);
                assert!((value - exact).abs() < 2e-5, "{node:?}: {value} for {exact}");
                above += usize::from(exact > 0.5);
            }
            assert!(above > 0);
        }
    }

    /// A block with a bubble and a notch, a sheet one particle thick, a filament and drops.
    fn splash(jitter: f32) -> Vec<Vec3> {
        let mut positions = seeding_lattice([22, 20, 18], jitter);
        let s = PARAMS.spacing;
        positions.retain(|x| {
            let bubble = (x - Vec3::new(11.0, 10.0, 9.0) * s).norm() > 1.6 * s;
            bubble && !(x.x > 14.0 * s && x.z > 12.0 * s)
        });
        for i in 0..20 {
            positions.extend((0..12).map(|j| Vec3::new(-2.0 - 0.9 * i as f32, j as f32, 5.0) * s));
            positions.push(Vec3::new(5.0, 5.0, 20.0 + 0.8 * i as f32) * s);
            positions.push(Vec3::new((i * 7 % 23) as f32, (i * 5 % 19) as f32, 25.0 + (i % 4) as f32) * s);
        }
        positions
    }

    #[test]
    fn leaving_out_filled_bricks_changes_no_surface() {
        for (jitter, voxel, anisotropy) in [
            (0.0, 0.25, None),
            (0.3, 0.25, None),
            (0.45, 0.5, None),
            (0.3, 0.25, Some(Anisotropy::default())),
            (0.2, 0.1, None),
        ] {
            let positions = splash(jitter);
            let part = density(&positions, &DensityParams { voxel, whole: false, anisotropy, ..PARAMS });
            let whole = density(&positions, &DensityParams { voxel, anisotropy, ..PARAMS });
            assert_eq!(part.unseen, whole.unseen);
            let mut left_out = 0;
            for (brick, &coord) in whole.grid.bricks.coords().iter().enumerate() {
                let values = whole.grid.brick(brick);
                if let Some(at) = part.grid.bricks.find(coord) {
                    let difference = values.iter().zip(part.grid.brick(at)).map(|(a, b)| (a - b).abs());
                    let farthest = difference.fold(0.0, f32::max);
                    let agrees = values.iter().zip(part.grid.brick(at));
                    assert!(
                        agrees.into_iter().all(|(&a, &b)| (a >= whole.threshold) == (b >= part.threshold))
                    );
                    // Rows that are deep or faint are interpolated, and kernels far from the surface are
                    // isotropic.
                    assert!(farthest < 0.2, "{farthest}");
                    continue;
                }
                let is_filled = part.grid.filled.find(coord).is_some();
                left_out += usize::from(is_filled);
                let agrees = values.iter().all(|&v| (v >= part.threshold) == is_filled);
                assert!(agrees, "{coord:?} at jitter {jitter}, voxel {voxel}");
            }
            println!("jitter {jitter}, voxel {voxel}: {left_out} of {} left out", whole.grid.bricks.len());
            assert!(part.grid.filled.coords().iter().all(|&coord| part.grid.bricks.find(coord).is_none()));
            assert!(left_out > 0 || voxel == 0.5);
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

    /// A ball of the seeding lattice, and its volume by the number of inside nodes.
    #[test]
    fn a_ball_has_the_volume_that_its_particles_fill() {
        for (kernel_radius, anisotropy, bound) in [
            (1.5, None, 0.006),
            (2.0, None, 0.002),
            (3.0, None, 0.004),
            (2.0, Some(Anisotropy::default()), 0.006),
        ] {
            let mut positions = seeding_lattice([41; 3], 0.15);
            let centre = Vec3::repeat(20.5 * PARAMS.spacing);
            positions.retain(|x| (x - centre).norm() < 20.0 * PARAMS.spacing);
            let params = DensityParams { kernel_radius, voxel: 0.25, anisotropy, ..PARAMS };
            let found = density(&positions, &params);
            let inside = found.grid.values.iter().filter(|&&v| v >= found.threshold).count() as f64;
            let volume = inside * f64::from(0.25_f32).powi(3);
            let off = volume / positions.len() as f64 - 1.0;
            println!(
                "kernel {kernel_radius}, {anisotropy:?}: level {:.4}, volume off by {:.3} %",
                found.threshold,
                100.0 * off
            );
            assert!(off.abs() < bound, "kernel {kernel_radius}: {off}");
        }
    }

    #[test]
    fn particles_between_coarse_nodes_are_counted() {
        // Drops ten spacings apart, at all positions relative to the nodes.
        let drops: Vec<Vec3> = (0..1000)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| v as f32 * 1.037))
            .map(Vec3::from)
            .collect();
        let unseen =
            |positions: &[Vec3], voxel: f32| density(positions, &DensityParams { voxel, ..PARAMS }).unseen;
        let drops_lost = [0.25, 0.5, 1.0, 2.0, 5.0].map(|voxel| unseen(&drops, voxel));
        let filled_lost = [0.5, 1.0, 2.0].map(|voxel| unseen(&seeding_lattice([9, 9, 9], 0.3), voxel));
        println!("unseen: {drops_lost:?} of 1000 drops, {filled_lost:?} of 729 in a block");
        assert_eq!(drops_lost[..2], [0, 0]);
        assert!(drops_lost[3] > 500 && drops_lost[4] > 900);
        assert_eq!(filled_lost[..2], [0, 0]);
    }

    #[test]
    fn memory_is_proportional_to_the_particles() {
        // Spray over 10 km, drops at 1000 km, and one too far for any brick.
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

        // Every drop is alone and at its position, to the digits of its coordinates.
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
        let positions = seeding_lattice([17, 16, 15], 0.45);
        let run = |threads: usize| par::with_threads(threads, || density(&positions, &PARAMS));
        let one = run(1);
        let bits = |found: &Density| found.grid.values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        for threads in [2, 3, 8] {
            let other = run(threads);
            assert_eq!(one.grid.bricks.coords(), other.grid.bricks.coords());
            assert!(bits(&one) == bits(&other), "{threads} threads");
        }
    }

    /// A small particle between the coarse nodes is found, and changes nothing elsewhere.
    #[test]
    fn one_small_particle_is_found_and_opens_no_filled_brick() {
        let params = DensityParams { whole: false, ..PARAMS };
        let mut positions = seeding_lattice([24; 3], 0.0);
        let block = density(&positions, &params);
        let lone = Vec3::repeat(4.05);
        positions.extend([lone, Vec3::repeat(1.05)]);
        let mut scales = vec![1.0; positions.len()];
        scales[24 * 24 * 24..].fill(0.25);
        let found = density_of_radii(&positions, Some(&scales), &params);
        assert!(!block.grid.filled.is_empty() && found.grid.filled.coords() == block.grid.filled.coords());
        assert_eq!((found.unseen, found.clustered), (0, 0));
        assert!(found.grid.trilinear(lone) >= found.threshold);
        let size = |scales| surface_size(&positions, scales, &params, 0.0).unwrap();
        assert!(size(Some(&scales)).bricks.abs_diff(size(None).bricks) < 9);
        assert!(size(Some(&scales)).bricks.abs_diff(found.grid.bricks.len()) * 10 < found.grid.bricks.len());
    }
}
