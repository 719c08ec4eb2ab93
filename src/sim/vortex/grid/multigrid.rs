//! The Poisson equation on a box, by full multigrid: the source text's way.
//!
//! *Method*: [gourlay19], [briggs00]: 6u − Σ of the six neighbours = h² ω, Gauss–Seidel sweeps over red and then over black nodes, the
//! residual weighted onto a lattice of twice the spacing, its solution added back by linear interpolation. The solution begins
//! on the coarsest lattice; each finer one starts from the last and takes [`CYCLES`] V-cycles.
//!
//! A node's red neighbours are all black, and a sweep writes to another array than it reads, so threads leave no trace.
//!
//! *Order*: the second. *Limits*: numbers of cells should be even many times: what is left is solved by sweeps alone.

use super::{
    boundary::Faces,
    lattice::{Field, Lattice},
};
use crate::{
    math::{
        Vec3,
        wide::{self, Job},
    },
    par,
};

/// V-cycles of a level. One leaves a tenth of the error of the operator, two a hundredth.
const CYCLES: usize = 2;

/// Sweeps before and after the coarser lattice.
const BEFORE: usize = 2;
const AFTER: usize = 1;

/// One component on one lattice.
struct Level {
    lattice: Lattice,
    u: Vec<f32>,
    /// What sweeps write to, and the residual.
    spare: Vec<f32>,
    /// h² ω.
    f: Vec<f32>,
}

impl Level {
    fn new(cells: [usize; 3]) -> Self {
        let lattice = Lattice { low: Vec3::zeros(), spacing: 1.0, cells };
        let zero = || par::repeated(0.0, lattice.plane() * (cells[2] + 1));
        Self { lattice, u: zero(), spare: zero(), f: zero() }
    }

    fn coarser(&self) -> Option<Self> {
        let halves = self.lattice.cells.iter().all(|n| n.is_multiple_of(2) && *n >= 4);
        halves.then(|| Self::new(self.lattice.cells.map(|n| n / 2)))
    }

    /// Writes to the spare array, row by row of the inside, `row(own place, parity of the row, out)`, and what the boundary is.
    fn rows(&mut self, row: impl Fn(&Self, usize, usize, &mut [f32]) + Sync) {
        let mut out = std::mem::take(&mut self.spare);
        let (lattice, this) = (self.lattice, &*self);
        par::for_chunks(&mut out, lattice.plane(), |first, plane| {
            let z = first / lattice.plane();
            let inside = |at: usize, axis: usize| at > 0 && at < lattice.cells[axis];
            for (y, out) in plane.chunks_exact_mut(lattice.row()).enumerate() {
                let place = first + y * lattice.row();
                if inside(z, 2) && inside(y, 1) {
                    row(this, place, (y + z) % 2, out);
                } else {
                    out.copy_from_slice(&this.u[place..place + lattice.row()]);
                }
            }
        });
        self.spare = out;
    }

    /// One sweep over the nodes of each colour.
    fn sweep(&mut self) {
        for colour in 0..2 {
            self.rows(|level, place, parity, out| {
                wide::run(Update { level, place, colour: Some((colour + parity) % 2), out });
            });
            std::mem::swap(&mut self.u, &mut self.spare);
        }
    }

    /// Writes the residual to the spare array; it is 0 on the boundary.
    fn residual(&mut self) {
        self.rows(|level, place, _, out| wide::run(Update { level, place, colour: None, out }));
        let lattice = self.lattice;
        par::for_chunks(&mut self.spare, lattice.plane(), |first, plane| {
            let z = first / lattice.plane();
            if z == 0 || z == lattice.cells[2] {
                plane.fill(0.0);
            }
            for (y, row) in plane.chunks_exact_mut(lattice.row()).enumerate() {
                if y == 0 || y == lattice.cells[1] {
                    row.fill(0.0);
                }
            }
        });
    }

    /// Adds the solution of the coarser level, interpolated, to every node inside.
    fn add(&mut self, coarse: &Self) {
        let lattice = self.lattice;
        par::for_chunks(&mut self.u, lattice.plane(), |first, plane| {
            let z = first / lattice.plane();
            if z == 0 || z == lattice.cells[2] {
                return;
            }
            let mut sum = vec![0.0; coarse.lattice.row()];
            for (y, row) in
                plane.chunks_exact_mut(lattice.row()).enumerate().skip(1).take(lattice.cells[1] - 1)
            {
                let rows = [
                    [y / 2, z / 2],
                    [y.div_ceil(2), z / 2],
                    [y / 2, z.div_ceil(2)],
                    [y.div_ceil(2), z.div_ceil(2)],
                ];
                let from = rows.map(|[y, z]| &coarse.u[coarse.lattice.place([0, y, z])..][..sum.len()]);
                for i in 0..sum.len() {
                    sum[i] = 0.25 * ((from[0][i] + from[1][i]) + (from[2][i] + from[3][i]));
                }
                for x in 1..lattice.cells[0] {
                    row[x] += 0.5 * (sum[x / 2] + sum[x.div_ceil(2)]);
                }
            }
        });
    }
}

/// Σ over the 27 nodes around every node of a coarser lattice of weights 8, 4, 2 and 1 over 64, times the four by which h² grows.
fn restrict(fine: Lattice, from: &[f32], coarse: Lattice, to: &mut [f32]) {
    par::for_chunks(to, coarse.plane(), |first, plane| {
        let z = first / coarse.plane();
        if z == 0 || z == coarse.cells[2] {
            return;
        }
        let mut sum = vec![0.0; fine.row()];
        for (y, row) in plane.chunks_exact_mut(coarse.row()).enumerate().skip(1).take(coarse.cells[1] - 1) {
            wide::run(Weigh { fine, from, place: fine.place([0, 2 * y, 2 * z]), sum: &mut sum });
            for (x, value) in row.iter_mut().enumerate().skip(1).take(coarse.cells[0] - 1) {
                *value = 0.25 * (sum[2 * x - 1] + sum[2 * x + 1]) + 0.5 * sum[2 * x];
            }
        }
    });
}

/// The weighted sum of nine rows around one, four times as large.
struct Weigh<'a> {
    fine: Lattice,
    from: &'a [f32],
    place: usize,
    sum: &'a mut [f32],
}

impl Job for Weigh<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Self { fine, from, place, sum } = self;
        let count = sum.len();
        let (row, plane) = (fine.row(), fine.plane());
        for (k, at) in [place - plane, place, place + plane].into_iter().enumerate() {
            let (a, b, c) = (&from[at - row..][..count], &from[at..][..count], &from[at + row..][..count]);
            let weight = if k == 1 { 0.5 } else { 0.25 };
            for i in 0..count {
                let part = weight * ((a[i] + c[i]) + 2.0 * b[i]);
                sum[i] = if k == 0 { part } else { sum[i] + part };
            }
        }
    }
}

/// A row of nodes of one colour, or of residuals.
struct Update<'a> {
    level: &'a Level,
    place: usize,
    colour: Option<usize>,
    out: &'a mut [f32],
}

impl Job for Update<'_> {
    type Out = ();

    #[inline(always)]
    fn run(self) {
        let Self { level: Level { lattice, u, f, .. }, place, colour, out } = self;
        let (row, plane, n) = (lattice.row(), lattice.plane(), lattice.cells[0]);
        // Nodes 1..n; the slices begin where they are read.
        let count = n - 1;
        let (own, source) = (&u[place + 1..][..count], &f[place + 1..][..count]);
        let (left, right) = (&u[place..][..count], &u[place + 2..][..count]);
        let (front, back) = (&u[place + 1 - row..][..count], &u[place + 1 + row..][..count]);
        let (below, above) = (&u[place + 1 - plane..][..count], &u[place + 1 + plane..][..count]);
        let inside = &mut out[1..n];
        let colour_of_first = colour.map_or(0, |colour| 1 - colour);
        for i in 0..count {
            let sum = ((left[i] + right[i]) + (front[i] + back[i])) + ((below[i] + above[i]) + source[i]);
            inside[i] = match colour {
                None => sum - 6.0 * own[i],
                Some(_) if i % 2 == colour_of_first => sum * (1.0 / 6.0),
                Some(_) => own[i],
            };
        }
        (out[0], out[n]) = if colour.is_none() { (0.0, 0.0) } else { (u[place], u[place + n]) };
    }
}

/// Replaces the source h² ω inside `field` by the potential, and its boundary by `faces`.
pub(super) fn solve(field: &mut Field, faces: &Faces) {
    let mut levels = vec![Level::new(field.lattice.cells)];
    while let Some(coarser) = levels[levels.len() - 1].coarser() {
        levels.push(coarser);
    }
    let sources = field.values.each_mut().map(std::mem::take);
    field.values = [0, 1, 2].map(|_| vec![0.0; sources[0].len()]);
    faces.write(field);
    for (k, source) in sources.into_iter().enumerate() {
        levels[0].f = source;
        levels[0].u = std::mem::take(&mut field.values[k]);
        full(&mut levels);
        field.values[k] = levels[0].u.clone();
    }
}

/// Full multigrid: the finest level holds the source and the boundary.
fn full(levels: &mut [Level]) {
    let last = levels.len() - 1;
    for l in 0..last {
        let (fine, coarse) = levels.split_at_mut(l + 1);
        let (fine, coarse) = (&fine[l], &mut coarse[0]);
        restrict(fine.lattice, &fine.f, coarse.lattice, &mut coarse.f);
        inject(fine, coarse);
    }
    relax(&mut levels[last]);
    for l in (0..last).rev() {
        let (fine, coarse) = levels.split_at_mut(l + 1);
        fine[l].add(&coarse[0]);
        for _ in 0..CYCLES {
            cycle(&mut levels[l..]);
        }
    }
}

/// The boundary of a coarser level, and 0 inside.
fn inject(fine: &Level, coarse: &mut Level) {
    let (from, to) = (fine.lattice, coarse.lattice);
    let u = &fine.u;
    par::for_chunks(&mut coarse.u, to.plane(), |first, plane| {
        let z = first / to.plane();
        for (y, row) in plane.chunks_exact_mut(to.row()).enumerate() {
            for (x, value) in row.iter_mut().enumerate().take(to.cells[0] + 1) {
                let at = [x, y, z];
                let outside = (0..3).any(|k| at[k] == 0 || at[k] == to.cells[k]);
                *value = if outside { u[from.place(at.map(|i| 2 * i))] } else { 0.0 };
            }
        }
    });
}

/// One V-cycle on the first level and all that are coarser.
fn cycle(levels: &mut [Level]) {
    let (fine, rest) = levels.split_first_mut().expect("a level");
    let Some(coarse) = rest.first_mut() else {
        return relax(fine);
    };
    for _ in 0..BEFORE {
        fine.sweep();
    }
    fine.residual();
    restrict(fine.lattice, &fine.spare, coarse.lattice, &mut coarse.f);
    coarse.u.fill(0.0);
    cycle(rest);
    fine.add(&rest[0]);
    for _ in 0..AFTER {
        fine.sweep();
    }
}

/// Sweeps until a millionth is left of a coarsest level: one leaves e^(−π²/3 Σ 1/n²) of the slowest wave.
fn relax(level: &mut Level) {
    let slowest: f64 = level.lattice.cells.iter().map(|&n| 1.0 / (n * n) as f64).sum();
    for _ in 0..(4.2 / slowest).ceil() as usize {
        level.sweep();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn little_is_left_of_the_equations() {
        for cells in [[16, 16, 16], [48, 40, 8], [12, 6, 10], [2, 3, 5]] {
            let lattice = Lattice { low: Vec3::zeros(), spacing: 0.1, cells };
            let mut field = Field::new(lattice);
            for (k, values) in field.values.iter_mut().enumerate() {
                values
                    .iter_mut()
                    .enumerate()
                    .for_each(|(i, v)| *v = ((i * 7919 + k) % 1009) as f32 / 1009.0 - 0.5);
            }
            let (faces, source) = (Faces::read(&field), field.clone());
            solve(&mut field, &faces);
            let (mut left, mut whole) = (0.0, 0.0);
            for z in 0..=cells[2] {
                for y in 0..=cells[1] {
                    for x in 0..=cells[0] {
                        let outside = [x, y, z].iter().zip(cells).any(|(&i, n)| i == 0 || i == n);
                        if outside {
                            assert_eq!(field.at([x, y, z]), source.at([x, y, z]), "the boundary stays");
                            continue;
                        }
                        let sides = field.at([x - 1, y, z])
                            + field.at([x + 1, y, z])
                            + field.at([x, y - 1, z])
                            + field.at([x, y + 1, z])
                            + field.at([x, y, z - 1])
                            + field.at([x, y, z + 1]);
                        left += (sides + source.at([x, y, z]) - field.at([x, y, z]) * 6.0).norm_squared();
                        whole += source.at([x, y, z]).norm_squared();
                    }
                }
            }
            assert!(left < 1e-4 * whole, "{cells:?}: {left} of {whole}");
        }
    }
}
