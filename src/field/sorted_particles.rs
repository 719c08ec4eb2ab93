//! Particles sorted into cells, and weighted moments of the neighbours of each.

use crate::{
    math::{Vec3, symmetric::Symmetric},
    par,
    simd::{self, F32x8, LANES, Lanes, Pass},
    space::{CellGrid, ONE_EDGE, TWO_EDGES},
};
use std::ops::Range;

/// Particles of a task.
const PARTICLES_PER_TASK: usize = 1024;

/// Largest group of cells along x that shares its candidates.
const GROUP_SPAN: i32 = 2;

/// Groups of particles that share their neighbour candidates.
#[derive(Default)]
struct Groups {
    /// Ends, for each group, of its places and of the ranges of places that hold all candidates.
    ends: Vec<(usize, usize)>,
    places: Vec<u32>,
    ranges: Vec<[u32; 2]>,
}

impl Groups {
    /// Adds the group of those `places` that are wanted.
    fn push(&mut self, places: impl Iterator<Item = usize>, ranges: &[[u32; 2]]) {
        let before = self.places.len();
        self.places.extend(places.map(|place| place as u32));
        if self.places.len() > before {
            self.ranges.extend(ranges.iter().filter(|[from, to]| from < to));
            self.ends.push((self.places.len(), self.ranges.len()));
        }
    }

    /// Every place in turn, with its candidate ranges.
    fn iter(&self) -> impl Iterator<Item = (usize, &[[u32; 2]])> {
        let mut start = (0, 0);
        self.ends.iter().flat_map(move |&end| {
            let ranges = &self.ranges[start.1..end.1];
            let places = &self.places[start.0..end.0];
            start = end;
            places.iter().map(move |&place| (place as usize, ranges))
        })
    }
}

/// Particles sorted into cells.
pub(super) struct SortedParticles {
    pub(super) cells: CellGrid,
    /// Coordinates in the cells' order, one array per axis; eight more numbers than particles.
    axes: [Vec<f32>; 3],
}

/// Σ w, Σ w d and Σ w d dᵀ over the particles within a radius of one, itself included; d from the particle
/// [radii].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub(super) zeroth: f32,
    /// Zero, like the following, if only the zeroth moment is requested.
    pub(super) first: Vec3,
    pub(super) second: Symmetric,
    /// Number of particles with a weight.
    pub(super) count: f32,
}

/// A weight of q = r/radius in 0..=1, zero at 1.
pub(super) trait Weight: Sync {
    fn of(q: f32) -> f32;
}

impl SortedParticles {
    /// Sorts `positions`, finite, into cells of `edge` [m].
    pub(super) fn new(positions: &[Vec3], edge: f32) -> Self {
        let cells = CellGrid::new(positions, edge);
        let order = cells.order();
        let axes = std::array::from_fn(|axis| {
            let mut values = vec![0.0; order.len() + LANES];
            par::fill(&mut values, |place| order.get(place).map_or(0.0, |&i| positions[i as usize][axis]));
            values
        });
        Self { cells, axes }
    }

    pub(super) fn len(&self) -> usize {
        self.cells.order().len()
    }

    /// The particle at a place of the order [m].
    #[inline(always)]
    pub(super) fn at(&self, place: usize) -> Vec3 {
        Vec3::new(self.axes[0][place], self.axes[1][place], self.axes[2][place])
    }

    /// The groups of those of a range of places that are `wanted`, with all particles closer to them than
    /// `radius` [m], at most two of the cells' edges.
    fn groups(&self, range: Range<usize>, radius: f32, wanted: impl Fn(usize) -> bool) -> Groups {
        let mut groups = Groups::default();
        let mut push =
            |places: Range<usize>, ranges: &[_]| groups.push(places.filter(|&place| wanted(place)), ranges);
        if radius <= self.cells.cell() {
            self.cells.for_each_group(range, GROUP_SPAN, &ONE_EDGE, |places, ranges| push(places, ranges));
        } else {
            assert!(radius <= 2.0 * self.cells.cell(), "at most two edges");
            self.cells.for_each_group(range, GROUP_SPAN, &TWO_EDGES, |places, ranges| push(places, ranges));
        }
        groups
    }

    /// Number of candidates that [`SortedParticles::moments`] examines for all particles.
    #[cfg(test)]
    pub(super) fn candidates(&self, radius: f32) -> usize {
        let groups = self.groups(0..self.len(), radius, |_| true);
        let count = |ranges: &[[u32; 2]]| ranges.iter().map(|[from, to]| (to - from) as usize).sum::<usize>();
        groups.iter().map(|(_, ranges)| count(ranges)).sum()
    }

    /// Moments at each place that is `wanted`, passed to `then`, whose results are returned in the order of the places. They are over the
    /// particles closer than `radius` [m], at most two of the cells' edges. With `ALL` all moments are computed, else only the
    /// zeroth.
    pub(super) fn moments<W: Weight, const ALL: bool, T: Send + Clone>(
        &self,
        radius: f32,
        wanted: impl Fn(usize) -> bool + Sync,
        then: impl Fn(usize, &Moments) -> T + Sync,
    ) -> Vec<T> {
        let axes = [&*self.axes[0], &*self.axes[1], &*self.axes[2]];
        par::map_chunks(self.len(), PARTICLES_PER_TASK, |range| {
            let groups = self.groups(range, radius, &wanted);
            let inverse = 1.0 / radius;
            let weight = std::marker::PhantomData::<W>;
            let found = simd::dispatch(NeighbourMoments::<W, ALL> { axes, groups: &groups, inverse, weight });
            groups
                .places
                .iter()
                .zip(&found)
                .map(|(&place, moments)| then(place as usize, moments))
                .collect::<Vec<_>>()
        })
        .concat()
    }
}

/// Vectors of particles, in the order of a [`SortedParticles`].
pub(super) struct Vectors {
    /// One array per axis; eight more numbers than particles.
    axes: [Vec<f32>; 3],
}

impl Vectors {
    /// All zero.
    pub(super) fn new(particles: &SortedParticles) -> Self {
        Self { axes: [(); 3].map(|()| vec![0.0; particles.len() + LANES]) }
    }

    pub(super) fn at(&self, place: usize) -> Vec3 {
        Vec3::new(self.axes[0][place], self.axes[1][place], self.axes[2][place])
    }

    pub(super) fn set(&mut self, place: usize, value: Vec3) {
        for axis in 0..3 {
            self.axes[axis][place] = value[axis];
        }
    }
}

impl SortedParticles {
    /// Weighted means of `vectors` over the particles of a layer: within `radius` [m], at most two of the
    /// cells' edges, and less than `half` [m] from the plane through a particle across its own vector; for
    /// every place that is `wanted`, in their order.
    pub(super) fn layer_means<W: Weight>(
        &self,
        radius: f32,
        half: f32,
        vectors: &Vectors,
        wanted: impl Fn(usize) -> bool + Sync,
    ) -> Vec<Vec3> {
        let axes = [&*self.axes[0], &*self.axes[1], &*self.axes[2]];
        let vectors = [&*vectors.axes[0], &*vectors.axes[1], &*vectors.axes[2]];
        let (inverse, inverse_half) = (1.0 / radius, radius / half);
        par::map_chunks(self.len(), PARTICLES_PER_TASK, |range| {
            let groups = self.groups(range, radius, &wanted);
            let weight = std::marker::PhantomData::<W>;
            simd::dispatch(LayerMeans { axes, vectors, groups: &groups, inverse, inverse_half, weight })
        })
        .concat()
    }
}

/// The layer means around some particles.
struct LayerMeans<'a, W> {
    axes: [&'a [f32]; 3],
    vectors: [&'a [f32]; 3],
    groups: &'a Groups,
    /// 1/radius [1/m].
    inverse: f32,
    /// radius/half.
    inverse_half: f32,
    weight: std::marker::PhantomData<W>,
}

impl<W: Weight> Pass for LayerMeans<'_, W> {
    type Out = Vec<Vec3>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<Vec3> {
        let mut means = Vec::with_capacity(self.groups.places.len());
        let mut last = None;
        for (place, ranges) in self.groups.iter() {
            let own = [self.axes[0][place], self.axes[1][place], self.axes[2][place]];
            let vector = [self.vectors[0][place], self.vectors[1][place], self.vectors[2][place]];
            if last.replace((own, vector)) == Some((own, vector)) {
                means.extend(means.last().copied());
                continue;
            }
            let length = (vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]).sqrt();
            let scale = if length > 0.0 { self.inverse_half / length } else { 0.0 };
            let normal = vector.map(|v| v * scale);
            let mut sums = [[0.0; LANES]; 4];
            for &[from, to] in ranges {
                let (mut at, to) = (from as usize, to as usize);
                while at < to {
                    self.eight(own, normal, at, to - at, &mut sums);
                    at += LANES;
                }
            }
            let [w, x, y, z] = sums.map(simd::sum);
            means.push(Vec3::new(x, y, z) / w);
        }
        means
    }
}

impl<W: Weight> LayerMeans<'_, W> {
    /// Adds eight candidates from place `at` on, of which the first `left` count; `normal` is radius/half
    /// long.
    #[inline(always)]
    fn eight(&self, own: [f32; 3], normal: [f32; 3], at: usize, left: usize, sums: &mut [F32x8; 4]) {
        let rows: [&F32x8; 3] = [row(self.axes[0], at), row(self.axes[1], at), row(self.axes[2], at)];
        let values: [&F32x8; 3] =
            [row(self.vectors[0], at), row(self.vectors[1], at), row(self.vectors[2], at)];
        let mask = &LANE_MASKS[left.min(LANES)];
        for lane in 0..LANES {
            let dx = (rows[0][lane] - own[0]) * self.inverse;
            let dy = (rows[1][lane] - own[1]) * self.inverse;
            let dz = (rows[2][lane] - own[2]) * self.inverse;
            let q = (dx * dx + dy * dy + dz * dz).sqrt().min(1.0);
            let distance = dx * normal[0] + dy * normal[1] + dz * normal[2];
            let w = W::of(q) * (1.0 - distance * distance).max(0.0) * mask[lane];
            sums[0][lane] += w;
            sums[1][lane] += w * values[0][lane];
            sums[2][lane] += w * values[1][lane];
            sums[3][lane] += w * values[2][lane];
        }
    }
}

/// The moments around some particles.
struct NeighbourMoments<'a, W, const ALL: bool> {
    axes: [&'a [f32]; 3],
    groups: &'a Groups,
    /// 1/radius [1/m].
    inverse: f32,
    weight: std::marker::PhantomData<W>,
}

impl<W: Weight, const ALL: bool> Pass for NeighbourMoments<'_, W, ALL> {
    type Out = Vec<Moments>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<Moments> {
        let mut found = Vec::with_capacity(self.groups.places.len());
        let mut last = None;
        for (place, ranges) in self.groups.iter() {
            let own = [self.axes[0][place], self.axes[1][place], self.axes[2][place]];
            // Particles in one place have one sum: without this, their time would be quadratic.
            if last.replace(own) == Some(own) {
                found.extend(found.last().copied());
                continue;
            }
            let mut sums = [[0.0; LANES]; 11];
            for &[from, to] in ranges {
                let (mut at, to) = (from as usize, to as usize);
                while at < to {
                    eight::<W, ALL>(&self.axes, own, self.inverse, at, to - at, &mut sums);
                    at += LANES;
                }
            }
            let mut moments = Moments { zeroth: simd::sum(sums[0]), ..Moments::default() };
            if ALL {
                moments.first = Vec3::new(simd::sum(sums[1]), simd::sum(sums[2]), simd::sum(sums[3]));
                for part in 0..6 {
                    moments.second[part] = simd::sum(sums[4 + part]);
                }
                moments.count = simd::sum(sums[10]);
            }
            found.push(moments);
        }
        found
    }
}

/// Adds eight candidates from place `at` on, of which the first `left` count.
#[inline(always)]
fn eight<W: Weight, const ALL: bool>(
    axes: &[&[f32]; 3],
    own: [f32; 3],
    inverse: f32,
    at: usize,
    left: usize,
    sums: &mut [F32x8; 11],
) {
    let rows: [&F32x8; 3] = [row(axes[0], at), row(axes[1], at), row(axes[2], at)];
    let mask = &LANE_MASKS[left.min(LANES)];
    let (mut d, mut w) = ([[0.0; LANES]; 3], [0.0; LANES]);
    for lane in 0..LANES {
        let x = (rows[0][lane] - own[0]) * inverse;
        let y = (rows[1][lane] - own[1]) * inverse;
        let z = (rows[2][lane] - own[2]) * inverse;
        w[lane] = W::of((x * x + y * y + z * z).sqrt().min(1.0)) * mask[lane];
        (d[0][lane], d[1][lane], d[2][lane]) = (x, y, z);
    }
    for lane in 0..LANES {
        let (w, x, y, z) = (w[lane], d[0][lane], d[1][lane], d[2][lane]);
        sums[0][lane] += w;
        if ALL {
            let (wx, wy, wz) = (w * x, w * y, w * z);
            sums[1][lane] += wx;
            sums[2][lane] += wy;
            sums[3][lane] += wz;
            sums[4][lane] += wx * x;
            sums[5][lane] += wy * y;
            sums[6][lane] += wz * z;
            sums[7][lane] += wx * y;
            sums[8][lane] += wx * z;
            sums[9][lane] += wy * z;
            sums[10][lane] += if w > 0.0 { 1.0 } else { 0.0 };
        }
    }
}

/// Masks with 1 for the first lanes of eight, 0 for the others, by the number of lanes.
const LANE_MASKS: [F32x8; LANES + 1] = {
    let mut mask = [[0.0; LANES]; LANES + 1];
    let mut count = 1;
    while count <= LANES {
        mask[count] = mask[count - 1];
        mask[count][count - 1] = 1.0;
        count += 1;
    }
    mask
};

/// Eight numbers from `at` on.
#[inline(always)]
fn row(values: &[f32], at: usize) -> &F32x8 {
    values[at..].first_chunk().expect("eight numbers follow the last particle")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The weight 1 − q.
    struct Cone;

    impl Weight for Cone {
        #[inline(always)]
        fn of(q: f32) -> f32 {
            1.0 - q
        }
    }

    /// Random points in a box of 4 × 3 × 2 m.
    fn scattered(count: u64) -> SortedParticles {
        let at = |i: u64| ((i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as f32 / (1 << 24) as f32;
        let point = |i: u64| Vec3::new(4.0 * at(3 * i), 3.0 * at(3 * i + 1), 2.0 * at(3 * i + 2) - 1.0);
        SortedParticles::new(&(0..count).map(point).collect::<Vec<_>>(), 0.5)
    }

    #[test]
    fn moments_are_the_sums_over_all_within_one_or_two_edges() {
        let particles = scattered(3000);
        for radius in [0.31_f32, 0.5, 0.83, 1.0] {
            let odd = |place: usize| place % 2 == 1;
            let found = particles.moments::<Cone, true, _>(radius, odd, |place, moments| (place, *moments));
            assert!(found.iter().map(|(place, _)| *place).eq((0..3000).filter(|&place| odd(place))));
            let alone = particles.moments::<Cone, false, _>(radius, odd, |_, moments| moments.zeroth);
            for (&(place, moments), alone) in found.iter().zip(alone) {
                let (mut sum, mut first, mut second, mut count) = (0.0, nalgebra::Vector3::zeros(), 0.0, 0.0);
                for other in 0..particles.len() {
                    let d = (particles.at(other) - particles.at(place)).cast::<f64>() / f64::from(radius);
                    let w = (1.0 - d.norm()).max(0.0);
                    (sum, first, second) = (sum + w, first + d * w, second + d.x * d.z * w);
                    count += f64::from(u8::from(w > 0.0));
                }
                let close = |a: f32, b: f64| (f64::from(a) - b).abs() < 1e-4 * (1.0 + b.abs());
                assert!(close(moments.zeroth, sum) && close(alone, sum), "{place} within {radius}");
                assert!((0..3).all(|axis| close(moments.first[axis], first[axis])));
                assert!(close(moments.second[4], second) && (f64::from(moments.count) - count).abs() <= 1.0);
            }
        }
    }

    #[test]
    fn particles_in_one_place_have_one_sum_which_counts_them_all() {
        let single = scattered(500);
        let points = (0..3 * 500).map(|i| single.at(i % 500)).collect::<Vec<_>>();
        let triple = SortedParticles::new(&points, 0.5);
        let moments = |particles: &SortedParticles| {
            particles.moments::<Cone, true, _>(
                0.7,
                |_| true,
                |place, moments| (particles.at(place), *moments),
            )
        };
        let (alone, found) = (moments(&single), moments(&triple));
        assert_eq!(found.len(), 3 * 500);
        for (at, sum) in found {
            let (_, one) = alone.iter().find(|(place, _)| *place == at).expect("one of the 500");
            assert!((sum.zeroth / one.zeroth - 3.0).abs() < 1e-4 && sum.count == 3.0 * one.count);
            assert!((sum.first - 3.0 * one.first).norm() < 1e-3);
        }
    }

    #[test]
    fn layer_means_cover_the_particles_in_the_layer_across_a_vector() {
        let particles = scattered(2000);
        let mut vectors = Vectors::new(&particles);
        (0..particles.len()).for_each(|place| vectors.set(place, Vec3::new(0.0, 0.1, particles.at(place).z)));
        let (radius, half) = (0.9_f32, 0.3_f32);
        let found = particles.layer_means::<Cone>(radius, half, &vectors, |_| true);
        for (place, found) in found.iter().enumerate() {
            let normal = vectors.at(place).normalize();
            let (mut sum, mut mean) = (0.0, Vec3::zeros());
            for other in 0..particles.len() {
                let d = particles.at(other) - particles.at(place);
                let distance = d.dot(&normal) / half;
                let w = (1.0 - d.norm() / radius).max(0.0) * (1.0 - distance * distance).max(0.0);
                (sum, mean) = (sum + w, mean + vectors.at(other) * w);
            }
            assert!((mean / sum - found).norm() < 1e-4, "{place}");
        }
    }
}
