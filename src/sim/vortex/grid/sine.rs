//! The Poisson equation on a box, by sine transforms.
//!
//! *Method*: ∇²A = −ω with A given on the boundary. The 19-point operator [spotz96] has sines as eigenvectors
//! on a box: with p = sin²(θ/2) of each axis, θ = πk/n, P = Σp and Q = Σ p p′, its eigenvalue is −(4P −
//! ⁸⁄₃Q)/h². The right-hand side is (1 + h²∇²/12) ω, whose eigenvalue is 1 − P/3. The boundary values in the
//! equations next to the boundary are known: they go to the right-hand side. Their transform in three
//! dimensions is a product of a sine and the transform of a face in two.
//!
//! For vorticity in the cores of a kernel the exact solution is known. Then a [`Green`]'s function replaces
//! the quotient of the operator, except for the boundary values.
//!
//! *Order*: the fourth, and the sixth where ω = 0.
//!
//! Passes: rows and columns of planes of constant z forward; lines along z forward, the solution, lines along
//! z back, into planes of constant y; columns and rows back.

use super::{
    boundary::{BoundaryValues, FaceValues, face_axes},
    fourier::{Complex, SineTransform},
    uniform::{ROW_MULTIPLE, UniformGrid, VectorField},
};
use crate::math::elementary::sin;
use crate::{
    par,
    simd::{self, LANES, Lanes, Pass, splat},
};

/// A Green's function: the transform of the potential over that of its source, as a function of θ and p of
/// the three axes.
pub(super) type Green<'a> = &'a (dyn Fn([f32; 3], [f32; 3]) -> f32 + Sync);

/// The Green's function of the 19-point operator, over h².
pub(super) fn greens_function(p: [f32; 3]) -> f32 {
    (1.0 - sum(p) / 3.0) / operator(p)
}

fn sum(p: [f32; 3]) -> f32 {
    p[0] + p[1] + p[2]
}

/// −h² times the eigenvalue.
fn operator(p: [f32; 3]) -> f32 {
    4.0 * sum(p) - 8.0 / 3.0 * (p[0] * p[1] + p[1] * p[2] + p[2] * p[0])
}

/// Replaces the source inside `field` by the potential, and its boundary by the boundary values.
///
/// # Panics
/// If an axis has a number of cells that cannot be transformed.
pub(super) fn solve(field: &mut VectorField, boundary: &BoundaryValues, green: Green<'_>) {
    let grid = field.grid;
    let sines = grid.cells.map(SineTransform::new);
    let boundary_terms = boundary_terms(boundary, &sines);
    let modes = grid.cells.map(|n| {
        let angle = |k: usize| std::f64::consts::PI * k as f64 / n as f64;
        (0..n).map(|k| [angle(k) as f32, sin(angle(k) / 2.0).powi(2) as f32]).collect()
    });
    for values in &mut field.values {
        par::for_chunks(values, grid.plane(), |first, plane| {
            let z = first / grid.plane();
            if z > 0 && z < grid.cells[2] {
                simd::dispatch(PlaneTransform { sines: [&sines[0], &sines[1]], row: grid.row(), plane });
            }
        });
    }

    // Planes of constant y, each with its three components in sequence.
    let slab = grid.row() * (grid.cells[2] + 1);
    let mut transposed = par::repeated(0.0_f32, 3 * slab * (grid.cells[1] + 1));
    let values = [0, 1, 2].map(|k| &field.values[k][..]);
    par::for_chunks(&mut transposed, 3 * slab, |first, out| {
        let y = first / (3 * slab);
        if y > 0 && y < grid.cells[1] {
            simd::dispatch(LineSolve {
                grid,
                sines: &sines,
                modes: &modes,
                boundary_terms: &boundary_terms,
                green,
                values,
                y,
                out,
            });
        }
    });

    for (k, values) in field.values.iter_mut().enumerate() {
        par::for_chunks(values, grid.plane(), |first, plane| {
            let (z, row) = (first / grid.plane(), grid.row());
            if z > 0 && z < grid.cells[2] {
                for (y, values) in plane.chunks_exact_mut(row).enumerate() {
                    let from = 3 * slab * y + k * slab + row * z;
                    values.copy_from_slice(&transposed[from..from + row]);
                }
                simd::dispatch(PlaneTransform { sines: [&sines[0], &sines[1]], row, plane });
            }
        });
    }
    boundary.write(field);
}

/// The transforms of the terms that the boundary adds to the equations next to it, by axis, side and
/// component: h² times the weights of the operator, ⅓ of the nearest node and ⅙ of its four neighbours on the
/// face.
type BoundaryTerms = [[[FaceValues; 3]; 2]; 3];

fn boundary_terms(boundary: &BoundaryValues, sines: &[SineTransform; 3]) -> BoundaryTerms {
    let mut terms = par::map(18, |n| {
        let (axis, side, k) = (n / 6, n / 3 % 2, n % 3);
        Some(face_terms(&boundary.faces[axis][side][k], axis, sines))
    });
    [0, 1, 2].map(|axis| {
        [0, 1].map(|side| [0, 1, 2].map(|k| terms[6 * axis + 3 * side + k].take().expect("one each")))
    })
}

fn face_terms(face: &FaceValues, axis: usize, sines: &[SineTransform; 3]) -> FaceValues {
    // A node that two or three faces share counts for the face of the first axis.
    let [b, c] = face_axes(axis);
    let (low_b, low_c) = (usize::from(b < axis), usize::from(c < axis));
    let counted = |i: usize, j: usize| {
        let own = i >= low_b && i + low_b <= face.cells[0] && j >= low_c && j + low_c <= face.cells[1];
        if own { face.at(i, j) } else { 0.0 }
    };
    let mut out = FaceValues::new(face.cells);
    for j in 1..face.cells[1] {
        for i in 1..face.cells[0] {
            let neighbours = counted(i - 1, j) + counted(i + 1, j) + counted(i, j - 1) + counted(i, j + 1);
            out.set(i, j, counted(i, j) / 3.0 + neighbours / 6.0);
        }
    }
    let row = out.row();
    simd::dispatch(PlaneTransform { sines: [&sines[b], &sines[c]], row, plane: &mut out.values });
    out
}

/// Transforms the rows and then the columns of a plane, except those on its edges.
struct PlaneTransform<'a> {
    sines: [&'a SineTransform; 2],
    row: usize,
    plane: &'a mut [f32],
}

impl Pass for PlaneTransform<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { sines: [along, across], row, plane } = self;
        let rows = across.cells();
        let mut line: Vec<Complex<L>> = vec![[splat(0.0); 2]; row.max(rows)];
        let mut work = line.clone();

        // Sixteen rows at a time, transposed so that a lane is a row. Rows beyond the last are copies of it.
        for first in (1..rows).step_by(2 * LANES) {
            let index = |c: usize, lane: usize, x: usize| (first + LANES * c + lane).min(rows - 1) * row + x;
            for x in (0..row).step_by(LANES) {
                for c in 0..2 {
                    let values = |lane| eight(&plane[index(c, lane, x)..]);
                    let columns = L::transpose(std::array::from_fn(values));
                    for k in 0..LANES {
                        line[x + k][c] = columns[k];
                    }
                }
            }
            along.run(&mut line, &mut work);
            for x in (0..row).step_by(LANES) {
                for c in 0..2 {
                    let rows_of: [[f32; LANES]; LANES] = std::array::from_fn(|k| line[x + k][c].to_array());
                    let columns = L::transpose(std::array::from_fn(|k| &rows_of[k]));
                    for lane in 0..LANES {
                        if first + LANES * c + lane < rows {
                            plane[index(c, lane, x)..][..LANES].copy_from_slice(&columns[lane].to_array());
                        }
                    }
                }
            }
        }

        for x in (0..row).step_by(ROW_MULTIPLE) {
            for y in 1..rows {
                let at = &plane[y * row + x..];
                line[y] = [L::load(eight(at)), L::load(eight(&at[LANES..]))];
            }
            across.run(&mut line, &mut work);
            for y in 1..rows {
                let at = &mut plane[y * row + x..][..ROW_MULTIPLE];
                at[..LANES].copy_from_slice(&line[y][0].to_array());
                at[LANES..].copy_from_slice(&line[y][1].to_array());
            }
        }
    }
}

/// Transforms the lines along z of one y, solves for their modes, and transforms back.
struct LineSolve<'a> {
    grid: UniformGrid,
    sines: &'a [SineTransform; 3],
    /// θ and p of every mode of an axis.
    modes: &'a [Vec<[f32; 2]>; 3],
    boundary_terms: &'a BoundaryTerms,
    green: Green<'a>,
    values: [&'a [f32]; 3],
    y: usize,
    out: &'a mut [f32],
}

impl LineSolve<'_> {
    /// The factors of the source and of the boundary terms, for modes x..x+16 of z-mode `z`.
    #[inline(always)]
    fn factors(&self, x: usize, z: usize) -> [[f32; ROW_MULTIPLE]; 2] {
        let cells = self.grid.cells;
        let norm = cells.iter().map(|&n| 2.0 / n as f32).product::<f32>();
        let mut out = [[0.0; ROW_MULTIPLE]; 2];
        let [sources, boundaries] = &mut out;
        for (lane, (source, boundary)) in sources.iter_mut().zip(boundaries).enumerate() {
            let at = [x + lane, self.y, z];
            if at[0] > 0 && at[0] < cells[0] {
                let [theta, p] = [0, 1].map(|n| [0, 1, 2].map(|k| self.modes[k][at[k]][n]));
                *source = norm * (self.green)(theta, p);
                *boundary = norm / operator(p);
            }
        }
        out
    }

    /// The transform of the boundary terms at modes x..x+8 of z-mode `z`.
    #[inline(always)]
    fn boundary<L: Lanes>(&self, k: usize, x: usize, z: usize) -> L {
        let (y, n) = (self.y, self.grid.cells);
        // A source in the last layer has the sine of one in the first, with alternating sign.
        let last = |k: usize, sine: f32| if k.is_multiple_of(2) { -sine } else { sine };
        let (mut first_x, mut last_x) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            if x + lane < n[0] {
                first_x[lane] = self.sines[0].sine(x + lane);
                last_x[lane] = last(x + lane, first_x[lane]);
            }
        }
        let (sine_y, sine_z) = (self.sines[1].sine(y), self.sines[2].sine(z));
        let row = |face: &FaceValues, j: usize| L::load(eight(&face.values[j * face.row() + x..]));
        let of = |axis: usize, side: usize| &self.boundary_terms[axis][side][k];
        let from_x =
            L::load(&first_x) * splat(of(0, 0).at(y, z)) + L::load(&last_x) * splat(of(0, 1).at(y, z));
        let from_y = splat::<L>(sine_y) * row(of(1, 0), z) + splat::<L>(last(y, sine_y)) * row(of(1, 1), z);
        let from_z = splat::<L>(sine_z) * row(of(2, 0), y) + splat::<L>(last(z, sine_z)) * row(of(2, 1), y);
        from_x + from_y + from_z
    }
}

impl Pass for LineSolve<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (row, count) = (self.grid.row(), self.grid.cells[2]);
        let slab = row * (count + 1);
        let mut line: Vec<Complex<L>> = vec![[splat(0.0); 2]; count];
        let mut work = line.clone();
        let mut factors = vec![[[0.0; ROW_MULTIPLE]; 2]; count];
        for x in (0..row).step_by(ROW_MULTIPLE) {
            for (z, factors) in factors.iter_mut().enumerate().skip(1) {
                *factors = self.factors(x, z);
            }
            for k in 0..3 {
                let index = |z: usize| z * self.grid.plane() + self.y * row + x;
                for (z, both) in line.iter_mut().enumerate().skip(1) {
                    let at = &self.values[k][index(z)..];
                    *both = [L::load(eight(at)), L::load(eight(&at[LANES..]))];
                }
                self.sines[2].run(&mut line, &mut work);
                for (z, (both, factors)) in line.iter_mut().zip(&factors).enumerate().skip(1) {
                    for (c, value) in both.iter_mut().enumerate() {
                        let [source, boundary] = factors.each_ref().map(|q| L::load(eight(&q[LANES * c..])));
                        *value = *value * source;
                        *value += boundary * self.boundary::<L>(k, x + LANES * c, z);
                    }
                }
                self.sines[2].run(&mut line, &mut work);
                for (z, both) in line.iter().enumerate().skip(1) {
                    let at = &mut self.out[k * slab + z * row + x..][..ROW_MULTIPLE];
                    at[..LANES].copy_from_slice(&both[0].to_array());
                    at[LANES..].copy_from_slice(&both[1].to_array());
                }
            }
        }
    }
}

/// The first eight numbers of a slice.
#[inline(always)]
fn eight(values: &[f32]) -> &[f32; LANES] {
    values.first_chunk().expect("rows are padded")
}
