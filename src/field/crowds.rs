//! Thinning of crowds: more particles in a place than any liquid has.
//!
//! *Method*: a cell of the particles' order is crowded from [`CROWDED`] times the particles of filled space on. It is
//! divided into cubes of half a spacing, and the first [`PER_CUBE`] particles of each cube remain. So a particle
//! has at most 64 times the neighbours of filled space, and the density takes time in proportion to the
//! number of particles. Weights are normalised by the neighbours, so that the density of the others is that
//! of all of them.
//!
//! Limits: where a spacing is more than four times too large, all particles are a crowd.

use super::sorted_particles::SortedParticles;
use crate::{math::Vec3, par, space::CellGrid};

/// A cell is crowded from this number of times the particles of filled space on. Compressed liquids have up to
/// twice as many, random positions up to eight times. Larger, and more particles are summed in vain.
const CROWDED: f32 = 16.0;

/// The smallest number of particles of a crowded cell.
const MIN_CROWD: usize = 32;

/// Particles that remain of a cube, whose edge is half a spacing. Filled space has an eighth. Smaller, and random positions
/// are thinned; larger, and crowds take longer.
const PER_CUBE: usize = 8;

/// `particles` in cells of `radius` [m], without the surplus of crowds, whose size is returned as well.
pub(super) fn sorted_without_crowds(
    positions: &[Vec3],
    spacing: f32,
    radius: f32,
) -> (SortedParticles, usize) {
    let particles = SortedParticles::new(positions, radius);
    match kept(&particles.cells, positions, spacing) {
        None => (particles, 0),
        Some(kept) => {
            let few: Vec<Vec3> = kept.iter().map(|&i| positions[i as usize]).collect();
            drop(particles);
            (SortedParticles::new(&few, radius), positions.len() - few.len())
        }
    }
}

/// The particles that remain where crowds are thinned, ascending; `None` if all do. `cells` are those of
/// `positions`.
pub(crate) fn kept(cells: &CellGrid, positions: &[Vec3], spacing: f32) -> Option<Vec<u32>> {
    let usual = CellGrid::particles_per_cell(cells.cell(), spacing);
    let limit = ((CROWDED * usual) as usize).max(MIN_CROWD);
    if cells.fullest().is_none_or(|(_, count)| count <= limit) {
        return None;
    }
    let mut is_kept = vec![true; positions.len()];
    let edge = 0.5 * f64::from(spacing);
    let crowds: Vec<_> = cells.occupied().filter(|places| places.len() > limit).collect();
    let surplus = par::map_chunks(crowds.len(), 1, |range| {
        let places = crowds[range.start].clone();
        let mut of_cubes: Vec<([i64; 3], u32)> = cells.order()[places]
            .iter()
            .map(|&i| (positions[i as usize].map(|x| (f64::from(x) / edge).floor() as i64).into(), i))
            .collect();
        of_cubes.sort_unstable();
        let cubes = of_cubes.chunk_by(|(a, _), (b, _)| a == b);
        cubes.flat_map(|cube| cube.iter().skip(PER_CUBE).map(|&(_, i)| i)).collect::<Vec<u32>>()
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
    fn block_with_crowd(crowd: u32, width: f32) -> Vec<Vec3> {
        let rest = (0..1000).map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32));
        let unit = |i: u32, prime: u64| (u64::from(i) * prime % 65_537) as f32 / 65_537.0 - 0.5;
        let more = (0..crowd).map(|i| Vec3::new(unit(i, 7919), unit(i, 104_729), unit(i, 31_337)) * width);
        rest.map(|x| x * SPACING).chain(more.map(|x| (x + Vec3::repeat(4.5)) * SPACING)).collect()
    }

    #[test]
    fn the_work_is_proportional_to_the_number_of_particles() {
        for width in [0.0, 1e-4, 0.3, 2.0] {
            for crowd in [1_000, 10_000, 40_000] {
                let positions = block_with_crowd(crowd, width);
                let (particles, surplus) = sorted_without_crowds(&positions, SPACING, RADIUS);
                let candidates = particles.candidates(RADIUS);
                println!("{crowd} in {width} spacings: {surplus} surplus, {candidates} candidates");
                assert_eq!(particles.len() + surplus, positions.len());
                // Filled space has about 80 candidates within two spacings.
                assert!(candidates < 64 * 80 * particles.len(), "{crowd} in {width}: {candidates}");
                assert!(particles.len() < 1000 + 3 * 3 * 3 * 64 * 8 || width == 0.0);
            }
        }
    }

    #[test]
    fn no_particle_of_a_liquid_is_surplus_and_a_thinned_crowd_has_the_same_surface() {
        let params =
            DensityParams { spacing: SPACING, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: true };
        let twice = [block_with_crowd(0, 1.0), block_with_crowd(0, 1.0)].concat();
        for positions in [block_with_crowd(0, 1.0), block_with_crowd(20, 0.1), twice] {
            assert_eq!(density(&positions, &params).crowded, 0);
        }
        let inside = |positions: &[Vec3]| {
            let found = density(positions, &params);
            let count = found.grid.values.iter().filter(|&&value| value >= found.threshold).count();
            (found.crowded, count)
        };
        let (few, many) = (inside(&block_with_crowd(25, 0.2)), inside(&block_with_crowd(20_000, 0.2)));
        println!("{few:?} {many:?}");
        assert!(few.0 == 0 && many.0 > 19_000 && few.1.abs_diff(many.1) * 50 < few.1, "{few:?} {many:?}");
    }
}
