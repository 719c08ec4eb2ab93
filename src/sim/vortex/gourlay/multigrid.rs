//! The Poisson equation on a box by full multigrid, as in [gourlay19].
//!
//! *Method*: [gourlay19], [briggs00]: 6u − Σ of the six neighbours = h² ω. Gauss–Seidel sweeps go over red
//! and then over black nodes. The residual is restricted to a grid of twice the spacing, and its solution is
//! prolonged by linear interpolation. The solution begins on the coarsest grid; each finer one starts from
//! the last and takes [`CYCLES`] V-cycles.
//!
//! The neighbours of a red node are all black, and a sweep writes to another array than it reads, so the
//! number of threads does not change the result.
//!
//! *Order*: the second. *Limits*: the numbers of cells should be even many times, because the coarsest grid
//! is solved by sweeps alone.

use crate::{
    math::Vec3,
    par,
    sim::vortex::{UniformGrid, VectorField},
    simd::{self, Lanes, Pass},
};

/// V-cycles per level. One leaves a tenth of the discretisation error, two a hundredth.
const CYCLES: usize = 2;

/// Smoothing sweeps before and after the coarse-grid correction.
const SWEEPS_BEFORE: usize = 2;
const SWEEPS_AFTER: usize = 1;

/// One component on one grid.
struct Level {
    grid: UniformGrid,
    u: Vec<f32>,
    /// The output of sweeps, and the residual.
    spare: Vec<f32>,
    /// h² ω.
    f: Vec<f32>,
}

impl Level {
    fn new(cells: [usize; 3]) -> Self {
        let grid = UniformGrid { low: Vec3::zeros(), spacing: 1.0, cells };
        let zero = || par::repeated(0.0, grid.plane() * (cells[2] + 1));
        Self { grid, u: zero(), spare: zero(), f: zero() }
    }

    fn coarser(&self) -> Option<Self> {
        let halves = self.grid.cells.iter().all(|n| n.is_multiple_of(2) && *n >= 4);
        halves.then(|| Self::new(self.grid.cells.map(|n| n / 2)))
    }

    /// Writes to the spare array: the boundary values, and for each row inside `row(own place, parity of the
    /// row, out)`.
    fn rows(&mut self, row: impl Fn(&Self, usize, usize, &mut [f32]) + Sync) {
        let mut out = std::mem::take(&mut self.spare);
        let (grid, this) = (self.grid, &*self);
        par::for_chunks(&mut out, grid.plane(), |first, plane| {
            let z = first / grid.plane();
            let inside = |at: usize, axis: usize| at > 0 && at < grid.cells[axis];
            for (y, out) in plane.chunks_exact_mut(grid.row()).enumerate() {
                let place = first + y * grid.row();
                if inside(z, 2) && inside(y, 1) {
                    row(this, place, (y + z) % 2, out);
                } else {
                    out.copy_from_slice(&this.u[place..place + grid.row()]);
                }
            }
        });
        self.spare = out;
    }

    /// One sweep over the nodes of each colour.
    fn sweep(&mut self) {
        for colour in 0..2 {
            self.rows(|level, place, parity, out| {
                simd::dispatch(Update { level, place, colour: Some((colour + parity) % 2), out });
            });
            std::mem::swap(&mut self.u, &mut self.spare);
        }
    }

    /// Writes the residual to the spare array. It is 0 on the boundary.
    fn residual(&mut self) {
        self.rows(|level, place, _, out| simd::dispatch(Update { level, place, colour: None, out }));
        let grid = self.grid;
        par::for_chunks(&mut self.spare, grid.plane(), |first, plane| {
            let z = first / grid.plane();
            if z == 0 || z == grid.cells[2] {
                plane.fill(0.0);
            }
            for (y, row) in plane.chunks_exact_mut(grid.row()).enumerate() {
                if y == 0 || y == grid.cells[1] {
                    row.fill(0.0);
                }
            }
        });
    }

    /// Prolongs the solution of the coarser level: adds it, interpolated, to every node inside.
    fn prolong(&mut self, coarse: &Self) {
        let grid = self.grid;
        par::for_chunks(&mut self.u, grid.plane(), |first, plane| {
            let z = first / grid.plane();
            if z == 0 || z == grid.cells[2] {
                return;
            }
            let mut sum = vec![0.0; coarse.grid.row()];
            for (y, row) in plane.chunks_exact_mut(grid.row()).enumerate().skip(1).take(grid.cells[1] - 1) {
                let rows = [
                    [y / 2, z / 2],
                    [y.div_ceil(2), z / 2],
                    [y / 2, z.div_ceil(2)],
                    [y.div_ceil(2), z.div_ceil(2)],
                ];
                let from = rows.map(|[y, z]| &coarse.u[coarse.grid.index([0, y, z])..][..sum.len()]);
                for i in 0..sum.len() {
                    sum[i] = 0.25 * ((from[0][i] + from[1][i]) + (from[2][i] + from[3][i]));
                }
                for x in 1..grid.cells[0] {
                    row[x] += 0.5 * (sum[x / 2] + sum[x.div_ceil(2)]);
                }
            }
        });
    }
}

/// Restriction: Σ over the 27 nodes around every node of a coarser grid with weights 8, 4, 2 and 1 over 64,
/// times 4 for h².
fn restrict(fine: UniformGrid, from: &[f32], coarse: UniformGrid, to: &mut [f32]) {
    par::for_chunks(to, coarse.plane(), |first, plane| {
        let z = first / coarse.plane();
        if z == 0 || z == coarse.cells[2] {
            return;
        }
        let mut sum = vec![0.0; fine.row()];
        for (y, row) in plane.chunks_exact_mut(coarse.row()).enumerate().skip(1).take(coarse.cells[1] - 1) {
            simd::dispatch(Weigh { fine, from, place: fine.index([0, 2 * y, 2 * z]), sum: &mut sum });
            for (x, value) in row.iter_mut().enumerate().skip(1).take(coarse.cells[0] - 1) {
                *value = 0.25 * (sum[2 * x - 1] + sum[2 * x + 1]) + 0.5 * sum[2 * x];
            }
        }
    });
}

/// The weighted sum of nine rows around one, four times as large.
struct Weigh<'a> {
    fine: UniformGrid,
    from: &'a [f32],
    place: usize,
    sum: &'a mut [f32],
}

impl Pass for Weigh<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
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

impl Pass for Update<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { level: Level { grid, u, f, .. }, place, colour, out } = self;
        let (row, plane, n) = (grid.row(), grid.plane(), grid.cells[0]);
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

/// Replaces the source h² ω inside `field` by the potential, whose boundary values `field` holds.
pub(super) fn solve(field: &mut VectorField) {
    let mut levels = vec![Level::new(field.grid.cells)];
    while let Some(coarser) = levels[levels.len() - 1].coarser() {
        levels.push(coarser);
    }
    for values in &mut field.values {
        levels[0].f = values.clone();
        levels[0].u = values.clone();
        for_each_inside(field.grid, &mut levels[0].u, |value| *value = 0.0);
        full(&mut levels);
        *values = levels[0].u.clone();
    }
}

/// Solves ∇²A = −ω on a box to second order: `field` holds ω [1/s] inside and A [m²/s] on the boundary, and
/// then A everywhere.
pub fn multigrid_poisson(field: &mut VectorField) {
    let grid = field.grid;
    for values in &mut field.values {
        for_each_inside(grid, values, |value| *value *= grid.spacing * grid.spacing);
    }
    solve(field);
}

/// Calls `f` with the value of every node inside.
fn for_each_inside(grid: UniformGrid, values: &mut [f32], f: impl Fn(&mut f32)) {
    for z in 1..grid.cells[2] {
        for y in 1..grid.cells[1] {
            let first = grid.index([1, y, z]);
            values[first..first + grid.cells[0] - 1].iter_mut().for_each(&f);
        }
    }
}

/// Full multigrid: the finest level holds the source and the boundary.
fn full(levels: &mut [Level]) {
    let last = levels.len() - 1;
    for l in 0..last {
        let (fine, coarse) = levels.split_at_mut(l + 1);
        let (fine, coarse) = (&fine[l], &mut coarse[0]);
        restrict(fine.grid, &fine.f, coarse.grid, &mut coarse.f);
        inject(fine, coarse);
    }
    relax(&mut levels[last]);
    for l in (0..last).rev() {
        let (fine, coarse) = levels.split_at_mut(l + 1);
        fine[l].prolong(&coarse[0]);
        for _ in 0..CYCLES {
            cycle(&mut levels[l..]);
        }
    }
}

/// The boundary values on a coarser level, and 0 inside.
fn inject(fine: &Level, coarse: &mut Level) {
    let (from, to) = (fine.grid, coarse.grid);
    let u = &fine.u;
    par::for_chunks(&mut coarse.u, to.plane(), |first, plane| {
        let z = first / to.plane();
        for (y, row) in plane.chunks_exact_mut(to.row()).enumerate() {
            for (x, value) in row.iter_mut().enumerate().take(to.cells[0] + 1) {
                let at = [x, y, z];
                let outside = (0..3).any(|k| at[k] == 0 || at[k] == to.cells[k]);
                *value = if outside { u[from.index(at.map(|i| 2 * i))] } else { 0.0 };
            }
        }
    });
}

/// One V-cycle on the first level and all that are coarser.
fn cycle(levels: &mut [Level]) {
    let (fine, coarser) = levels.split_first_mut().expect("a level");
    let Some(coarse) = coarser.first_mut() else {
        return relax(fine);
    };
    for _ in 0..SWEEPS_BEFORE {
        fine.sweep();
    }
    fine.residual();
    restrict(fine.grid, &fine.spare, coarse.grid, &mut coarse.f);
    coarse.u.fill(0.0);
    cycle(coarser);
    fine.prolong(&coarser[0]);
    for _ in 0..SWEEPS_AFTER {
        fine.sweep();
    }
}

/// Sweeps until a millionth of the residual is left on the coarsest level: one leaves e^(−π²/3 Σ 1/n²) of the
/// slowest wave.
fn relax(level: &mut Level) {
    let slowest: f64 = level.grid.cells.iter().map(|&n| 1.0 / (n * n) as f64).sum();
    for _ in 0..(4.2 / slowest).ceil() as usize {
        level.sweep();
    }
}
