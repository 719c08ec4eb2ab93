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

    /// The moments around every particle, in the cells' order, of what is closer than `radius` [m] ≤ the cells' edge;
    /// `then` makes of each what is kept. With `ALL` there are all of them, else only the zeroth. Groups of particles that are not `wanted`, by
    /// the range of their places, have none.
    pub(super) fn moments<W: Weight, const ALL: bool, T: Send + Clone + Default>(
        &self,
        radius: f32,
        wanted: impl Fn(Range<usize>) -> bool + Sync,
        then: impl Fn(usize, &Moments) -> T + Sync,
    ) -> Vec<T> {
        let mut kept = vec![T::default(); self.len()];
        par::for_chunks(&mut kept, TASK, |first, kept| {
            let mut groups = Vec::new();
            self.cells.for_each_group(first..first + kept.len(), SPAN, |places, stretches| {
                if wanted(places.clone()) {
                    groups.push((places, *stretches));
                }
            });
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

/// The moments of a chunk of particles.
struct Around<'a, W, const ALL: bool> {
    axes: [&'a [f32]; 3],
    /// Places of particles, and the stretches that hold all that may be near them.
    groups: &'a [(Range<usize>, [[u32; 2]; 9])],
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
