//! Whether a spacing fits the particles, by the distances to their nearest neighbours.
//!
//! *Method*: the distances of [`SAMPLES`] particles, evenly chosen, to the nearest other that is not in the same place.
//! Their median is 0.8 to 1 spacings in a liquid, and 0.55 where positions are random. Spray has larger
//! distances, hence a spacing is too small only where nine particles of ten have no neighbour.
//!
//! Limits: spray alone is reported like particles whose spacing is too small.

use crate::{frame::SPACING_RANGE, job::tradeoff::figure, math::Vec3, par};
use serde::{Deserialize, Serialize};

/// Particles whose nearest neighbours are searched, among all: 64 million distances for a million particles.
const SAMPLES: usize = 64;

/// Fewer particles show no spacing.
const MIN_PARTICLES: usize = 32;

/// A spacing of more medians is too large: random positions have 1.8.
const MAX_OVER_MEDIAN: f64 = 4.0;

/// A spacing below the first decile by this factor is too small: kernels of two spacings do not meet from 2 on.
const MIN_UNDER_DECILE: f64 = 1.6;

/// Distances to the nearest neighbours of a sample of the particles.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct NeighbourDistances {
    /// Spacing that the surface was made with [m].
    pub(super) spacing: f64,
    /// First decile [m].
    pub(super) decile: f64,
    /// Median [m].
    pub(super) median: f64,
}

impl NeighbourDistances {
    /// Those of particles at `positions`; `None` if there are too few, or too many have no other.
    pub(super) fn new(positions: &[Vec3], spacing: f32) -> Option<Self> {
        let [decile, median] = (positions.len() >= MIN_PARTICLES).then(|| deciles(positions)).flatten()?;
        Some(Self { spacing: spacing.into(), decile, median })
    }
    /// What is wrong with the spacing, if it is much too large or too small.
    pub(super) fn finding(&self) -> Option<String> {
        let Self { spacing, decile, median } = *self;
        let show = |value: f64| figure(value, 2);
        let (why, so) = if spacing > MAX_OVER_MEDIAN * median {
            (
                format!(
                    "half of the particles have another within {} m: {} m is too large, and details vanish",
                    show(median),
                    show(spacing)
                ),
                median,
            )
        } else if spacing < decile / MIN_UNDER_DECILE {
            (
                format!(
                    "nine particles of ten have no other within {} m: {} m is too small, and every particle is a drop of its own",
                    show(decile),
                    show(spacing)
                ),
                median,
            )
        } else {
            return None;
        };
        let fits = so.clamp(*SPACING_RANGE.start(), *SPACING_RANGE.end());
        Some(format!("{why}; --spacing {} would fit a liquid", show(fits)))
    }
}

/// First decile and median [m] of the distances to the nearest neighbours; `None` if half of the particles have no other.
fn deciles(positions: &[Vec3]) -> Option<[f64; 2]> {
    let count = positions.len();
    let sample = |i: usize| positions[(i as u64 * count as u64 / SAMPLES as u64) as usize];
    let axes: [[f32; SAMPLES]; 3] = [0, 1, 2].map(|axis| std::array::from_fn(|i| sample(i)[axis]));
    let parts = par::map_chunks(count, par::CHUNK, |range| {
        let mut nearest = [f32::INFINITY; SAMPLES];
        for x in &positions[range] {
            for i in 0..SAMPLES {
                let [dx, dy, dz] = [x.x - axes[0][i], x.y - axes[1][i], x.z - axes[2][i]];
                let d2 = dx * dx + dy * dy + dz * dz;
                nearest[i] = nearest[i].min(if d2 > 0.0 { d2 } else { f32::INFINITY });
            }
        }
        nearest
    });
    let nearest = |i: usize| parts.iter().map(|part| part[i]).fold(f32::INFINITY, f32::min);
    let mut distances: Vec<f32> = (0..SAMPLES).map(nearest).filter(|d2| d2.is_finite()).collect();
    if distances.len() < SAMPLES / 2 {
        return None;
    }
    distances.sort_unstable_by(f32::total_cmp);
    Some([10, 2].map(|part| f64::from(distances[distances.len() / part]).sqrt()))
}

/// The spacing of particles [m] by the median; `None` if half of them have no other.
///
/// Particles on a seeding lattice have exactly their spacing; those of a simulation are nearer to one of their neighbours, so
/// the estimate is up to a fifth too small.
pub(super) fn estimated_spacing(positions: &[Vec3]) -> Option<f32> {
    let [_, median] = if positions.is_empty() { None } else { deciles(positions) }?;
    Some(median as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(i: u64) -> f32 {
        let mut z = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (z >> 40) as f32 / (1 << 24) as f32
    }

    /// A block of n³ particles a decimetre apart, displaced by up to `jitter` decimetres.
    fn block(n: u64, jitter: f32) -> Vec<Vec3> {
        let place = |i: u64| [i % n, i / n % n, i / n / n];
        let offset = |i: u64| Vec3::from_fn(|axis, _| (2.0 * random(3 * i + axis as u64) - 1.0) * jitter);
        (0..n * n * n).map(|i| (Vec3::from(place(i).map(|v| v as f32)) + offset(i)) * 0.1).collect()
    }

    fn finding(positions: &[Vec3], spacing: f32) -> Option<String> {
        NeighbourDistances::new(positions, spacing)?.finding()
    }

    #[test]
    fn a_spacing_that_does_not_fit_is_reported_with_one_that_does() {
        for (spacing, word) in
            [(10.0, "too large"), (1e-3, "too small"), (1e6, "too large"), (1e-6, "too small")]
        {
            let found = finding(&block(10, 0.0), spacing).unwrap();
            assert!(found.contains(word) && found.ends_with("--spacing 0.1 would fit a liquid"), "{found}");
            assert!(found.len() < 250, "{found}");
        }
    }

    #[test]
    fn a_spacing_that_fits_is_not_reported() {
        let random: Vec<Vec3> =
            (0..1000).map(|i| Vec3::from_fn(|axis, _| random(3 * i + axis as u64))).collect();
        let splash: Vec<Vec3> = block(6, 0.3).into_iter().chain(random.iter().map(|x| x * 100.0)).collect();
        let coincident = [block(8, 0.2), block(8, 0.2)].concat();
        for positions in [
            block(10, 0.0),
            block(10, 0.45),
            random,
            splash,
            coincident,
            vec![Vec3::zeros(); 500],
            block(3, 0.0),
        ] {
            assert_eq!(finding(&positions, 0.1), None);
        }
    }

    #[test]
    fn the_spacing_is_estimated_of_blocks_sheets_and_threads() {
        let seeding_lattice = |n: [u64; 3]| -> Vec<Vec3> {
            let place = |i: u64| [i % n[0], i / n[0] % n[1], i / (n[0] * n[1])];
            (0..n.iter().product()).map(|i| Vec3::from(place(i).map(|v| v as f32)) * 0.02).collect()
        };
        for n in [[20, 20, 20], [100, 40, 1], [300, 1, 1], [2, 1, 1]] {
            let once = seeding_lattice(n);
            let twice = [once.clone(), once.clone()].concat();
            let stray = [once.clone(), vec![Vec3::repeat(1e4)]].concat();
            for positions in [once, twice, stray] {
                let found = estimated_spacing(&positions).unwrap();
                assert!((found / 0.02 - 1.0).abs() < 1e-3, "{n:?}: {found}");
            }
        }
        let disordered = estimated_spacing(&block(20, 0.15)).unwrap() / 0.1;
        assert!((0.8..1.0).contains(&disordered), "{disordered}");
        for coincident in [0, 1, 5] {
            assert_eq!(estimated_spacing(&vec![Vec3::zeros(); coincident]), None);
        }
    }
}
