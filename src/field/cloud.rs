//! Particles in the order of their cells, and weighted moments of what is around each.

use crate::{
    math::{
        Vec3,
        symmetric::Symmetric,
        wide::{self, Job, WIDTH, Wide},
    },
    par,
    space::CellGrid,
};
use std::ops::Range;

/// Particles a task works on.
const TASK: usize = 1024;

/// The widest group of cells along x that shares its candidates.
const SPAN: i32 = 2;

/// Places of particles, and the stretches of places that hold all that may be near them.
type Group = (Range<usize>, [[u32; 2]; 9]);

/// Particles sorted into cells.
pub(super) struct Cloud {
    pub(super) cells: CellGrid,
    /// Coordinates in the cells' order, one array an axis; eight more numbers than particles.
    axes: [Vec<f32>; 3],
}

/// Σ w, Σ w d and Σ w d dᵀ over the particles within a radius of one, itself included; d from the particle [radii].
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Moments {
    pub(super) zeroth: f32,
    /// Zero, like what follows, where only the zeroth is asked for.
    pub(super) first: Vec3,
    pub(super) second: Symmetric,
    /// How many particles have a weight.
    pub(super) count: f32,
}

/// A weight of q = r/radius that vanishes from 1 on.
pub(super) trait Weight: Sync {
    fn of(q: f32) -> f32;
}

impl Cloud {
    /// Sorts `positions`, finite, into cells of `edge` [m].
    pub(super) fn new(positions: &[Vec3], edge: f32) -> Self {
        let cells = CellGrid::new(positions, edge);
        let order = cells.order();
        let axes = std::array::from_fn(|axis| {
            let mut values = vec![0.0; order.len() + WIDTH];
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

    /// The groups of a range of places that are `wanted`, by the range of their own.
    fn groups(&self, range: Range<usize>, wanted: impl Fn(Range<usize>) -> bool) -> Vec<Group> {
        let mut groups = Vec::new();
        self.cells.for_each_group(range, SPAN, |places, stretches| {
            if wanted(places.clone()) {
                groups.push((places, *stretches));
            }
        });
        groups
    }

    /// The moments around every particle, in the cells' order, of what is closer than `radius` [m] ≤ the cells' edge;
    /// `then` makes of each what is kept. With `ALL` there are all of them, else only the zeroth. Groups of particles that
    /// are not `wanted`, by the range of their places, have none.
    pub(super) fn moments<W: Weight, const ALL: bool, T: Send + Clone + Default>(
        &self,
        radius: f32,
        wanted: impl Fn(Range<usize>) -> bool + Sync,
        then: impl Fn(usize, &Moments) -> T + Sync,
    ) -> Vec<T> {
        let mut kept = vec![T::default(); self.len()];
        par::for_chunks(&mut kept, TASK, |first, kept| {
            let groups = self.groups(first..first + kept.len(), &wanted);
            let mut found = vec![Moments::default(); kept.len()];
            wide::run(Around::<W, ALL> {
                axes: [&self.axes[0], &self.axes[1], &self.axes[2]],
                groups: &groups,
                first,
                inverse: 1.0 / radius,
                found: &mut found,
                weight: std::marker::PhantomData,
            });
            for (offset, (kept, moments)) in kept.iter_mut().zip(&found).enumerate() {
                *kept = then(first + offset, moments);
            }
        });
        kept
    }
}

/// Vectors of particles, in the order of a [`Cloud`].
pub(super) struct Vectors {
    /// One array an axis; eight more numbers than particles.
    axes: [Vec<f32>; 3],
}

impl Vectors {
    /// All zero.
    pub(super) fn new(cloud: &Cloud) -> Self {
        Self { axes: [(); 3].map(|()| vec![0.0; cloud.len() + WIDTH]) }
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

impl Cloud {
    /// The weighted means of `vectors` over the particles within `radius` [m] ≤ the cells' edge that lie less than `half`
    /// [m] before or behind the plane through a particle across its own vector; zero for groups that are not `wanted`.
    pub(super) fn means_across<W: Weight>(
        &self,
        radius: f32,
        half: f32,
        vectors: &Vectors,
        wanted: impl Fn(Range<usize>) -> bool + Sync,
    ) -> Vec<Vec3> {
        let mut means = vec![Vec3::zeros(); self.len()];
        par::for_chunks(&mut means, TASK, |first, means| {
            let groups = self.groups(first..first + means.len(), &wanted);
            wide::run(Across::<W> {
                axes: [&self.axes[0], &self.axes[1], &self.axes[2]],
                vectors: [&vectors.axes[0], &vectors.axes[1], &vectors.axes[2]],
                groups: &groups,
                first,
                inverse: 1.0 / radius,
                thin: radius / half,
                means,
                weight: std::marker::PhantomData,
            });
        });
        means
    }
}

/// The means of a chunk of particles.
struct Across<'a, W> {
    axes: [&'a [f32]; 3],
    vectors: [&'a [f32]; 3],
    groups: &'a [Group],
    first: usize,
    /// 1/radius [1/m].
    inverse: f32,
    /// radius/half.
    thin: f32,
    means: &'a mut [Vec3],
    weight: std::marker::PhantomData<W>,
}

impl<W: Weight> Job for Across<'_, W> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        for (places, stretches) in self.groups {
            for place in places.clone() {
                let own = [self.axes[0][place], self.axes[1][place], self.axes[2][place]];
                let vector = [self.vectors[0][place], self.vectors[1][place], self.vectors[2][place]];
                let length = (vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]).sqrt();
                let scale = if length > 0.0 { self.thin / length } else { 0.0 };
                let normal = vector.map(|v| v * scale);
                let mut sums = [[0.0; WIDTH]; 4];
                for &[from, to] in stretches {
                    let (mut at, to) = (from as usize, to as usize);
                    while at < to {
                        self.eight(own, normal, at, to - at, &mut sums);
                        at += WIDTH;
                    }
                }
                let [w, x, y, z] = sums.map(wide::sum);
                self.means[place - self.first] = Vec3::new(x, y, z) / w;
            }
        }
    }
}

impl<W: Weight> Across<'_, W> {
    /// Adds eight candidates from place `at` on, of which the first `left` are meant; `normal` is radius/half long.
    #[inline(always)]
    fn eight(&self, own: [f32; 3], normal: [f32; 3], at: usize, left: usize, sums: &mut [Wide; 4]) {
        let rows: [&Wide; 3] = [row(self.axes[0], at), row(self.axes[1], at), row(self.axes[2], at)];
        let values: [&Wide; 3] =
            [row(self.vectors[0], at), row(self.vectors[1], at), row(self.vectors[2], at)];
        for lane in 0..WIDTH {
            let dx = (rows[0][lane] - own[0]) * self.inverse;
            let dy = (rows[1][lane] - own[1]) * self.inverse;
            let dz = (rows[2][lane] - own[2]) * self.inverse;
            let q = (dx * dx + dy * dy + dz * dz).sqrt();
            let away = dx * normal[0] + dy * normal[1] + dz * normal[2];
            let meant = (lane as u32) < (left as u32) && q < 1.0;
            let w = if meant { W::of(q) * (1.0 - away * away).max(0.0) } else { 0.0 };
            sums[0][lane] += w;
            sums[1][lane] += if meant { w * values[0][lane] } else { 0.0 };
            sums[2][lane] += if meant { w * values[1][lane] } else { 0.0 };
            sums[3][lane] += if meant { w * values[2][lane] } else { 0.0 };
        }
    }
}

/// The moments of a chunk of particles.
struct Around<'a, W, const ALL: bool> {
    axes: [&'a [f32]; 3],
    groups: &'a [Group],
    first: usize,
    /// 1/radius [1/m].
    inverse: f32,
    found: &'a mut [Moments],
    weight: std::marker::PhantomData<W>,
}

impl<W: Weight, const ALL: bool> Job for Around<'_, W, ALL> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        for (places, stretches) in self.groups {
            for place in places.clone() {
                let own = [self.axes[0][place], self.axes[1][place], self.axes[2][place]];
                let mut sums = [[0.0; WIDTH]; 11];
                for &[from, to] in stretches {
                    let (mut at, to) = (from as usize, to as usize);
                    while at < to {
                        eight::<W, ALL>(&self.axes, own, self.inverse, at, to - at, &mut sums);
                        at += WIDTH;
                    }
                }
                let mut moments = Moments { zeroth: wide::sum(sums[0]), ..Moments::default() };
                if ALL {
                    moments.first = Vec3::new(wide::sum(sums[1]), wide::sum(sums[2]), wide::sum(sums[3]));
                    for part in 0..6 {
                        moments.second[part] = wide::sum(sums[4 + part]);
                    }
                    moments.count = wide::sum(sums[10]);
                }
                self.found[place - self.first] = moments;
            }
        }
    }
}

/// Adds eight candidates from place `at` on, of which the first `left` are meant.
#[inline(always)]
fn eight<W: Weight, const ALL: bool>(
    axes: &[&[f32]; 3],
    own: [f32; 3],
    inverse: f32,
    at: usize,
    left: usize,
    sums: &mut [Wide; 11],
) {
    let rows: [&Wide; 3] = [row(axes[0], at), row(axes[1], at), row(axes[2], at)];
    let (mut d, mut w) = ([[0.0; WIDTH]; 3], [0.0; WIDTH]);
    for lane in 0..WIDTH {
        let dx = (rows[0][lane] - own[0]) * inverse;
        let dy = (rows[1][lane] - own[1]) * inverse;
        let dz = (rows[2][lane] - own[2]) * inverse;
        let q = (dx * dx + dy * dy + dz * dz).sqrt();
        let meant = (lane as u32) < (left as u32) && q < 1.0;
        w[lane] = if meant { W::of(q) } else { 0.0 };
        d[0][lane] = if meant { dx } else { 0.0 };
        d[1][lane] = if meant { dy } else { 0.0 };
        d[2][lane] = if meant { dz } else { 0.0 };
    }
    for lane in 0..WIDTH {
        let (w, x, y, z) = (w[lane], d[0][lane], d[1][lane], d[2][lane]);
        sums[0][lane] += w;
        if ALL {
            sums[1][lane] += w * x;
            sums[2][lane] += w * y;
            sums[3][lane] += w * z;
            sums[4][lane] += w * x * x;
            sums[5][lane] += w * y * y;
            sums[6][lane] += w * z * z;
            sums[7][lane] += w * x * y;
            sums[8][lane] += w * x * z;
            sums[9][lane] += w * y * z;
            sums[10][lane] += if w > 0.0 { 1.0 } else { 0.0 };
        }
    }
}

/// Eight numbers from `at` on.
#[inline(always)]
fn row(values: &[f32], at: usize) -> &Wide {
    values[at..].first_chunk().expect("eight numbers follow the last particle")
}
