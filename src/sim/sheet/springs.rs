//! Springs and plates: forces, and their derivatives.
//!
//! *Method*: [gudukbay97] Eq. 6 and 7: each point gathers k [(x_j − x_i) − ℓ (x_j − x_i)/|x_j − x_i|] from
//! its neighbours j, here in the direction of the force. Plates are linear: Σ k_ij (x_j − x_i). The
//! derivative is that of [baraff98] section 4, split into the parts along and across the spring. The part
//! across is left out where it is negative (a spring in compression).
//! *Departs from the paper*: any number of neighbours, each with its own k and ℓ; springs may damp the rate
//! of their own length.
//!
//! Symbols: d → x_j − x_i [m]; k → `stiffness` [N/m]; ℓ → `rest` [m]. The two ends of a spring compute the
//! same numbers with opposite signs, so that forces cancel to the last digit before they are summed.
//! Limits: a spring of length zero has no direction and pulls only if its rest length is zero; the record
//! counts such springs.

use super::{
    sliced_ellpack::{SlicedEllpack, Slot},
    vectors::{Dot, Eight, Flat, Vectors, chunk_len, in_chunks},
};
use crate::{
    par,
    simd::{self, F32x8, LANES, Lanes, Pass},
};

/// Smallest squared length [m²]: far below the resolution of positions, and its root is not zero.
const MIN_SQUARED_LENGTH: f32 = 1e-30;

/// Symmetric 3×3 matrices of eight points: xx, yy, zz, xy, xz, yz.
pub(super) type Blocks = [F32x8; 6];

/// Vectors of the neighbours in a slot; `at` is the number of the eight.
#[inline(always)]
pub(super) fn fetch(of: &Flat<'_>, slot: &Slot, at: usize) -> Eight {
    let mut out = [[0.0; LANES]; 3];
    for axis in 0..3 {
        if slot.in_row {
            out[axis] = *of[axis][slot.to(at, 0)..].first_chunk().expect("they are all there");
        } else {
            for lane in 0..LANES {
                out[axis][lane] = of[axis][slot.to(at, lane)];
            }
        }
    }
    out
}

#[inline(always)]
fn difference(a: &Eight, b: &Eight) -> Eight {
    let mut out = [[0.0; LANES]; 3];
    for axis in 0..3 {
        for lane in 0..LANES {
            out[axis][lane] = a[axis][lane] - b[axis][lane];
        }
    }
    out
}

#[inline(always)]
fn dot(a: &Eight, b: &Eight) -> F32x8 {
    let mut out = [0.0; LANES];
    for lane in 0..LANES {
        out[lane] = a[0][lane] * b[0][lane] + a[1][lane] * b[1][lane] + a[2][lane] * b[2][lane];
    }
    out
}

/// `sum` + `weight` `v`.
#[inline(always)]
fn add_weighted(sum: &mut Eight, weight: &F32x8, v: &Eight) {
    for axis in 0..3 {
        for lane in 0..LANES {
            sum[axis][lane] += weight[lane] * v[axis][lane];
        }
    }
}

/// 1/|d|.
#[inline(always)]
fn inverse_length(d: &Eight) -> F32x8 {
    let mut out = dot(d, d);
    for r in &mut out {
        *r = 1.0 / (if *r > MIN_SQUARED_LENGTH { *r } else { MIN_SQUARED_LENGTH }).sqrt();
    }
    out
}

/// A sum over the neighbours of each point.
pub(super) trait Gather: Sync {
    /// The sums of eight points. Implementations must be `#[inline(always)]`.
    fn eight(&self, at: usize) -> Eight;
}

struct AddSums<'a, G> {
    gather: &'a G,
    start: usize,
    out: [&'a mut [F32x8]; 3],
}

impl<G: Gather> Pass for AddSums<'_, G> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let [x, y, z] = self.out;
        for k in 0..x.len() {
            let sums = self.gather.eight(self.start + k);
            for lane in 0..LANES {
                x[k][lane] += sums[0][lane];
                y[k][lane] += sums[1][lane];
                z[k][lane] += sums[2][lane];
            }
        }
    }
}

/// Adds the sums of `gather` to `out`.
fn add<G: Gather>(out: &mut Vectors, gather: &G) {
    let [x, y, z] = &mut out.axes;
    in_chunks([x, y, z], |start, out| simd::dispatch(AddSums { gather, start, out }));
}

struct WriteSums<'a, G> {
    gather: &'a G,
    with: &'a Vectors,
    start: usize,
    out: [&'a mut [F32x8]; 3],
}

impl<G: Gather> Pass for WriteSums<'_, G> {
    type Out = f64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f64 {
        let [x, y, z] = self.out;
        let mut sum = Dot::default();
        for k in 0..x.len() {
            let sums = self.gather.eight(self.start + k);
            sum.add(&self.with.eight(self.start + k), &sums);
            [x[k], y[k], z[k]] = sums;
        }
        sum.total()
    }
}

/// Writes the sums of `gather` to `out`, and returns their product with `with`, as by [`Vectors::dot`].
pub(super) fn write<G: Gather>(out: &mut Vectors, gather: &G, with: &Vectors) -> f64 {
    let [x, y, z] = &mut out.axes;
    in_chunks([x, y, z], |start, out| simd::dispatch(WriteSums { gather, with, start, out }))
        .into_iter()
        .sum()
}

/// Forces of springs [N]; with `DAMPED` also those of their damping.
pub(super) struct SpringForces<'a, const DAMPED: bool> {
    pub(super) table: &'a SlicedEllpack,
    pub(super) x: &'a Vectors,
    pub(super) v: &'a Vectors,
}

impl<const DAMPED: bool> Gather for SpringForces<'_, DAMPED> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let own = self.x.eight(at);
        let own_v = if DAMPED { self.v.eight(at) } else { own };
        let (all, all_v) = (self.x.flat(), self.v.flat());
        let mut sum = [[0.0; LANES]; 3];
        let (slots, damping) = self.table.of(at);
        for k in 0..slots.len() {
            let slot = &slots[k];
            let d = difference(&fetch(&all, slot, at), &own);
            let inverse = inverse_length(&d);
            let mut coefficient = [0.0; LANES];
            for lane in 0..LANES {
                coefficient[lane] = slot.stiffness[lane] * (1.0 - slot.rest[lane] * inverse[lane]); // [gudukbay97] Eq. 6
            }
            if DAMPED {
                let w = dot(&difference(&fetch(&all_v, slot, at), &own_v), &d);
                for lane in 0..LANES {
                    coefficient[lane] += damping[k][lane] * w[lane] * (inverse[lane] * inverse[lane]);
                }
            }
            add_weighted(&mut sum, &coefficient, &d); // [gudukbay97] Eq. 7
        }
        sum
    }
}

/// Adds the forces of springs at `x` to `out` [N], without their damping.
pub(super) fn add_forces(table: &SlicedEllpack, x: &Vectors, out: &mut Vectors) {
    add(out, &SpringForces::<false> { table, x, v: x });
}

/// `factor` Σ k_ij (y_j − y_i).
pub(super) struct LinearTerms<'a> {
    pub(super) table: &'a SlicedEllpack,
    pub(super) y: &'a Vectors,
    pub(super) factor: f32,
}

/// Sum of the forces of springs, of plates and of everything else.
pub(super) struct ForceSum<'a, S> {
    pub(super) springs: S,
    pub(super) plates: Option<LinearTerms<'a>>,
    pub(super) other: Option<&'a Vectors>,
}

impl<S: Gather> Gather for ForceSum<'_, S> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let mut sum = self.springs.eight(at);
        if let Some(plates) = &self.plates {
            add_weighted(&mut sum, &[1.0; LANES], &plates.eight(at));
        }
        if let Some(other) = self.other {
            add_weighted(&mut sum, &[1.0; LANES], &other.eight(at));
        }
        sum
    }
}

impl Gather for LinearTerms<'_> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let (own, all) = (self.y.eight(at), self.y.flat());
        let mut sum = [[0.0; LANES]; 3];
        let (slots, _) = self.table.of(at);
        for slot in slots {
            let d = difference(&fetch(&all, slot, at), &own);
            add_weighted(&mut sum, &slot.stiffness.map(|stiffness| stiffness * self.factor), &d);
        }
        sum
    }
}

/// Adds `factor` Σ stiffness (y_j − y_i) to `out`.
pub(super) fn add_linear(table: &SlicedEllpack, y: &Vectors, factor: f32, out: &mut Vectors) {
    add(out, &LinearTerms { table, y, factor });
}

/// (Δt² K + Δt C) p of springs at `x`: the derivative of their forces, split along and across each.
pub(super) struct SpringProduct<'a> {
    pub(super) table: &'a SlicedEllpack,
    pub(super) x: &'a Vectors,
    pub(super) p: &'a Vectors,
    pub(super) dt: f32,
}

/// Stiffness of a spring along itself and across, the latter at least zero.
#[inline(always)]
fn along_and_across(slot: &Slot, damping: Option<&F32x8>, inverse: &F32x8, dt: f32) -> [F32x8; 2] {
    let mut out = [[0.0; LANES]; 2];
    for lane in 0..LANES {
        let taut = 1.0 - slot.rest[lane] * inverse[lane];
        out[0][lane] = dt * dt * slot.stiffness[lane];
        out[1][lane] = dt * dt * slot.stiffness[lane] * if taut > 0.0 { taut } else { 0.0 };
    }
    if let Some(damping) = damping {
        for lane in 0..LANES {
            out[0][lane] += dt * damping[lane];
        }
    }
    out
}

impl Gather for SpringProduct<'_> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let (own, own_p) = (self.x.eight(at), self.p.eight(at));
        let (all, all_p) = (self.x.flat(), self.p.flat());
        let mut sum = [[0.0; LANES]; 3];
        let (slots, damping) = self.table.of(at);
        for k in 0..slots.len() {
            let slot = &slots[k];
            let d = difference(&fetch(&all, slot, at), &own);
            let q = difference(&own_p, &fetch(&all_p, slot, at));
            let inverse = inverse_length(&d);
            let [along, across] = along_and_across(
                slot,
                if damping.is_empty() { None } else { Some(&damping[k]) },
                &inverse,
                self.dt,
            );
            let w = dot(&q, &d);
            let mut part = [0.0; LANES];
            for lane in 0..LANES {
                part[lane] = (along[lane] - across[lane]) * w[lane] * (inverse[lane] * inverse[lane]);
            }
            add_weighted(&mut sum, &across, &q);
            add_weighted(&mut sum, &part, &d);
        }
        sum
    }
}

/// Calls `f(number of the eight, its blocks)` for each.
pub(super) fn update_blocks(blocks: &mut [Blocks], f: impl Fn(usize, &mut Blocks) + Sync) {
    let len = chunk_len(blocks.len());
    par::for_chunks(blocks, len, |start, part| {
        part.iter_mut().enumerate().for_each(|(k, block)| f(start + k, block));
    });
}

/// Adds the diagonal blocks of Δt² K + Δt C of springs at `x` to `out`.
pub(super) fn add_blocks(table: &SlicedEllpack, x: &Vectors, dt: f32, out: &mut [Blocks]) {
    update_blocks(out, |at, out| {
        let (own, all) = (x.eight(at), x.flat());
        let (slots, damping) = table.of(at);
        for (k, slot) in slots.iter().enumerate() {
            let d = difference(&fetch(&all, slot, at), &own);
            let inverse = inverse_length(&d);
            let [along, across] = along_and_across(slot, damping.get(k), &inverse, dt);
            for lane in 0..LANES {
                let n: [f32; 3] = std::array::from_fn(|axis| d[axis][lane] * inverse[lane]);
                let part = along[lane] - across[lane];
                for (block, (a, b)) in
                    [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate()
                {
                    out[block][lane] += part * n[a] * n[b] + if a == b { across[lane] } else { 0.0 };
                }
            }
        }
    });
}

/// Adds the diagonal of a linear table to `out`.
pub(super) fn add_linear_blocks(table: &SlicedEllpack, factor: f32, out: &mut [Blocks]) {
    update_blocks(out, |at, out| {
        let (slots, _) = table.of(at);
        for slot in slots {
            for lane in 0..LANES {
                let weight = factor * slot.stiffness[lane];
                out[..3].iter_mut().for_each(|block| block[lane] += weight);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::{super::sliced_ellpack::Entry, *};
    use crate::{math::Vec3, simd::ScalarLanes};

    const COUNT: usize = 45;

    /// Random springs between some points, or those of a grid.
    fn entries(grid: bool, damping: f32) -> Vec<Entry> {
        let pairs: Vec<[u32; 2]> = if grid {
            let row = (0..COUNT as u32 - 1).filter(|i| i % 9 != 8).map(|i| [i, i + 1]);
            row.chain((0..COUNT as u32 - 9).map(|i| [i, i + 9])).collect()
        } else {
            (0..90).map(|k| [(k * 7) % 45, (k * k * 11 + 3) % 45]).filter(|[a, b]| a != b).collect()
        };
        let both = |(k, [a, b]): (usize, [u32; 2])| {
            let (stiffness, rest) = (1.0 + k as f32, 0.01 * k as f32);
            let entry = |of, to| Entry { of, to, stiffness, rest, damping };
            [entry(a, b), entry(b, a)]
        };
        pairs.into_iter().enumerate().flat_map(both).collect()
    }

    fn cloud(seed: f32) -> Vectors {
        let at = |i: usize, k: f32| (seed + k + i as f32 * (1.3 + 0.7 * k)).sin();
        Vectors::of(&(0..COUNT).map(|i| Vec3::new(at(i, 0.0), at(i, 1.0), at(i, 2.0))).collect::<Vec<_>>())
    }

    /// Reference: entry by entry, in double precision.
    fn expected(entries: &[Entry], x: &Vectors, v: &Vectors) -> Vec<nalgebra::Vector3<f64>> {
        let mut out = vec![nalgebra::Vector3::zeros(); COUNT];
        for e in entries {
            let [of, to] = [e.of as usize, e.to as usize];
            let d = x.get(to).cast::<f64>() - x.get(of).cast();
            let w = (v.get(to).cast::<f64>() - v.get(of).cast()).dot(&d) / d.norm_squared();
            let coefficient = f64::from(e.stiffness) * (1.0 - f64::from(e.rest) / d.norm());
            out[of] += d * (coefficient + f64::from(e.damping) * w);
        }
        out
    }

    #[test]
    fn forces_are_the_sum_over_entries_and_both_lane_types_give_the_same_bits() {
        let (x, v) = (cloud(0.3), cloud(1.9));
        for (grid, damping) in [(true, 0.0), (true, 0.5), (false, 0.0), (false, 0.5)] {
            let entries = entries(grid, damping);
            let table = SlicedEllpack::new(COUNT, entries.clone());
            assert_eq!((0..COUNT / 8).any(|e| table.of(e).0.iter().all(|slot| slot.in_row)), grid);
            let mut wide = Vectors::zeros(COUNT);
            if damping > 0.0 {
                add(&mut wide, &SpringForces::<true> { table: &table, x: &x, v: &v });
            } else {
                add_forces(&table, &x, &mut wide);
            }
            for (i, expected) in expected(&entries, &x, &v).into_iter().enumerate() {
                assert!(
                    (wide.get(i).cast() - expected).norm() < 1e-5 * (1.0 + expected.norm()),
                    "{grid} {i}"
                );
            }
            let mut plain = Vectors::zeros(COUNT);
            let [a, b, c] = &mut plain.axes;
            if damping > 0.0 {
                AddSums {
                    gather: &SpringForces::<true> { table: &table, x: &x, v: &v },
                    start: 0,
                    out: [a, b, c],
                }
                .run::<ScalarLanes>();
            } else {
                AddSums {
                    gather: &SpringForces::<false> { table: &table, x: &x, v: &x },
                    start: 0,
                    out: [a, b, c],
                }
                .run::<ScalarLanes>();
            }
            assert_eq!(plain, wide);
        }
    }

    #[test]
    fn the_matrix_product_is_the_derivative_of_taut_springs_and_positive() {
        let (x, p) = (cloud(0.3), cloud(4.1));
        let entries: Vec<Entry> =
            entries(false, 0.0).iter().map(|e| Entry { rest: 1e-3 * e.rest, ..*e }).collect();
        let table = SlicedEllpack::new(COUNT, entries.clone());
        let mut change = Vectors::zeros(COUNT);
        add(&mut change, &SpringProduct { table: &table, x: &x, p: &p, dt: 1.0 });
        let moved = |by: f32| {
            let all: Vec<Vec3> = (0..COUNT).map(|i| x.get(i) + p.get(i) * by).collect();
            expected(&entries, &Vectors::of(&all), &x)
        };
        let step = 1e-2;
        for (i, (a, b)) in moved(step).into_iter().zip(moved(-step)).enumerate() {
            let slope = (b - a) / (2.0 * f64::from(step));
            assert!((change.get(i).cast() - slope).norm() < 1e-2 * (1.0 + slope.norm()), "{i}");
        }
        // The diagonal blocks are the derivative by the point's own position.
        let mut blocks = vec![[[0.0; LANES]; 6]; COUNT.div_ceil(LANES)];
        add_blocks(&table, &x, 1.0, &mut blocks);
        for i in 0..COUNT {
            let (mut one, mut sums) = (Vectors::zeros(COUNT), Vectors::zeros(COUNT));
            one.set(i, Vec3::x());
            add(&mut sums, &SpringProduct { table: &table, x: &x, p: &one, dt: 1.0 });
            let block = [0, 3, 4].map(|part| blocks[i / LANES][part][i % LANES]);
            assert!((sums.get(i) - Vec3::from(block)).norm() < 1e-4 * (1.0 + sums.get(i).norm()));
        }
        // In compression the part across a spring is zero, and the quadratic form is positive.
        let compressed: Vec<Entry> = entries.iter().map(|e| Entry { rest: 9.0, ..*e }).collect();
        let mut change = Vectors::zeros(COUNT);
        add(
            &mut change,
            &SpringProduct { table: &SlicedEllpack::new(COUNT, compressed), x: &x, p: &p, dt: 1.0 },
        );
        assert!(change.dot(&p) > 0.0);
    }
}
