//! Thinning of dense clusters: more particles in a place than any liquid has.
//!
//! *Method*: a cell of the particles' order is over-dense from [`OVER_DENSE`] times the particles of filled space on. It is
//! divided into cubes of half a spacing, and the first particles of each cube remain, up to the volume of [`PER_CUBE`]. So
//! a particle has at most 64 times the neighbours of space that is filled with the smallest around it, and the
//! density takes time in proportion to the number of particles. Weights are normalised by the neighbours, so that
//! the density of the others is that of all of them.
//!
//! Limits: where a spacing is more than four times too large, all particles are one cluster.

use super::sorted_particles::SortedParticles;
use crate::{math::Vec3, par, space::CellGrid};
use std::ops::Range;

/// A cell is over-dense from this number of times the particles of filled space on. Compressed liquids have up to
/// twice as many, random positions up to eight times. If it is larger, more particles are summed without any effect.
const OVER_DENSE: f32 = 16.0;

/// The smallest number of particles of an over-dense cell.
const MIN_PER_CELL: usize = 32;

/// Volume of the particles that remain of a cube, whose edge is half a spacing [particles of scale 1]. Filled space has an eighth. If it is smaller, random
/// positions are thinned; if larger, clusters take longer.
const PER_CUBE: f32 = 8.0;

/// Particles in cells of `radius` [m], without the surplus of clusters, and which these are, ascending; `None` if all are.
/// `scales` are their radii over half of `spacing` [m].
pub(super) fn sorted_thinned(
    positions: &[Vec3],
    scales: Option<&[f32]>,
    spacing: f32,
    radius: f32,
) -> (SortedParticles, Option<Vec<u32>>) {
    let particles = SortedParticles::new(positions, radius);
    let Some(kept) = thinned(&particles.cells, positions, scales, spacing) else { return (particles, None) };
    drop(particles);
    let few: Vec<Vec3> = kept.iter().map(|&i| positions[i as usize]).collect();
    (SortedParticles::new(&few, radius), Some(kept))
}

/// The particles that remain where clusters are thinned, ascending; `None` if all do. `cells` are those of
/// `positions`.
pub(crate) fn thinned(
    cells: &CellGrid,
    positions: &[Vec3],
    scales: Option<&[f32]>,
    spacing: f32,
) -> Option<Vec<u32>> {
    let usual = CellGrid::particles_per_cell(cells.cell(), spacing);
    let limit = ((OVER_DENSE * usual) as usize).max(MIN_PER_CELL);
    if cells.fullest().is_none_or(|(_, count)| count <= limit) {
        return None;
    }
    // In particles of scale 1.
    let volume = |i: u32| scales.map_or(1.0, |scales| scales[i as usize].powi(3));
    let is_over_dense = |places: &Range<usize>| {
        let count = places.len();
        let all = &cells.order()[places.clone()];
        count > limit && all.iter().map(|&i| volume(i)).sum::<f32>() > limit as f32
    };
    let mut is_kept = vec![true; positions.len()];
    let edge = 0.5 * f64::from(spacing);
    let over_dense: Vec<_> = cells.occupied().filter(is_over_dense).collect();
    let surplus = par::map_chunks(over_dense.len(), 1, |range| {
        let places = over_dense[range.start].clone();
        let mut of_cubes: Vec<([i64; 3], u32)> = cells.order()[places]
            .iter()
            .map(|&i| (positions[i as usize].map(|x| (f64::from(x) / edge).floor() as i64).into(), i))
            .collect();
        of_cubes.sort_unstable();
        let mut surplus: Vec<u32> = Vec::new();
        for cube in of_cubes.chunk_by(|(a, _), (b, _)| a == b) {
            let mut filled = 0.0;
            for &(_, i) in cube {
                if filled >= PER_CUBE {
                    surplus.push(i);
                }
                filled += volume(i);
            }
        }
        surplus
    });
    surplus.into_iter().flatten().for_each(|i| is_kept[i as usize] = false);
    let kept: Vec<u32> = (0..positions.len() as u32).filter(|&i| is_kept[i as usize]).collect();
    (kept.len() < positions.len()).then_some(kept)
}

#[cfg(test)]
mod tests {
    use super::super::{DensityParams, density};
    use super::*;

    const SPACING: f32 = 0.1;
    const RADIUS: f32 = 0.2;

    /// A block of particles at rest, and so many more within `width` spacings around its middle.
    fn block_with_cluster(cluster: u32, width: f32) -> Vec<Vec3> {
        let rest = (0..1000).map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32));
        let unit = |i: u32, prime: u64| (u64::from(i) * prime % 65_537) as f32 / 65_537.0 - 0.5;
        let more = (0..cluster).map(|i| Vec3::new(unit(i, 7919), unit(i, 104_729), unit(i, 31_337)) * width);
        rest.map(|x| x * SPACING).chain(more.map(|x| (x + Vec3::repeat(4.5)) * SPACING)).collect()
    }

    #[test]
    fn the_work_is_proportional_to_the_number_of_particles() {
        for width in [0.0, 1e-4, 0.3, 2.0] {
            for cluster in [1_000, 10_000, 40_000] {
                let positions = block_with_cluster(cluster, width);
                let (particles, kept) = sorted_thinned(&positions, None, SPACING, RADIUS);
                let surplus = positions.len() - kept.map_or(positions.len(), |kept| kept.len());
                let candidates = particles.candidates(RADIUS);
                println!("{cluster} in {width} spacings: {surplus} surplus, {candidates} candidates");
                assert_eq!(particles.len() + surplus, positions.len());
                // Filled space has about 80 candidates within two spacings.
                assert!(candidates < 64 * 80 * particles.len(), "{cluster} in {width}: {candidates}");
                assert!(particles.len() < 1000 + 3 * 3 * 3 * 64 * 8 || width == 0.0);
            }
        }
    }

    /// Volume counts, not number; a small particle elsewhere has no influence.
    #[test]
    fn small_particles_are_thinned_by_their_volume() {
        let positions = block_with_cluster(20_000, 0.2);
        let scales = |cluster: f32, first: f32| {
            let mut scales = vec![1.0; positions.len()];
            scales[1000..].fill(cluster);
            scales[0] = first;
            scales
        };
        let kept = |scales: &[f32]| {
            sorted_thinned(&positions, Some(scales), SPACING, RADIUS)
                .1
                .map_or(positions.len(), |kept| kept.len())
        };
        let plain = sorted_thinned(&positions, None, SPACING, RADIUS).1.unwrap().len();
        assert_eq!(kept(&scales(1.0, 1.0)), plain);
        assert_eq!(kept(&scales(1.0, 0.25)), plain);
        let small = kept(&scales(0.5, 1.0));
        assert!(small > plain && small - 992 < 9 * (plain - 992), "{small} and {plain}");
    }

    #[test]
    fn no_particle_of_a_liquid_is_surplus_and_a_thinned_cluster_has_the_same_surface() {
        let params =
            DensityParams { spacing: SPACING, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: true };
        let twice = [block_with_cluster(0, 1.0), block_with_cluster(0, 1.0)].concat();
        for positions in [block_with_cluster(0, 1.0), block_with_cluster(20, 0.1), twice] {
            assert_eq!(density(&positions, &params).clustered, 0);
        }
        let inside = |positions: &[Vec3]| {
            let found = density(positions, &params);
            let count = found.grid.values.iter().filter(|&&value| value >= found.threshold).count();
            (found.clustered, count)
        };
        let (few, many) = (inside(&block_with_cluster(25, 0.2)), inside(&block_with_cluster(20_000, 0.2)));
        println!("{few:?} {many:?}");
        assert!(few.0 == 0 && many.0 > 19_000 && few.1.abs_diff(many.1) * 50 < few.1, "{few:?} {many:?}");
    }
}
