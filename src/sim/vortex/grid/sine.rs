//! The Poisson equation on a box, by sine transforms.
//!
//! *Method*: ∇²A = −ω with A given on the boundary. The 19-point operator [spotz96] has sines as eigenvectors on a box: with
//! p = sin²(θ/2) of each axis, θ = πk/n, P = Σp and Q = Σ p p′, its eigenvalue is −(4P − ⁸⁄₃Q)/h²; it stands against
//! (1 + h²∇²/12) ω, whose eigenvalue is 1 − P/3. The boundary's part of the equations next to it is known: it goes to the right side,
//! and its transform in three dimensions is a product of a sine and the transform of a face in two.
//!
//! Of vorticity that is spread as a kernel spreads it the solution is known: its [`Green`] stands for the operator's own
//! quotient, and the boundary's part alone is the operator's.
//!
//! *Order*: the fourth, and the sixth where ω = 0.
//!
//! Passes: rows and columns of planes of constant z forward; lines along z forward, the solution, lines along z back, into planes of
//! constant y; columns and rows back.

use super::{
    boundary::{Faces, Plane},
    fourier::{Complex, Sine},
    lattice::{Field, Lattice, ROW},
};
use crate::{
    par,
    sim::vortex::lanes::{self, LANES, Lanes, Pass, splat},
};

/// What turns the transform of a source into that of its potential: a function of θ and p of the three axes.
pub(super) type Green<'a> = &'a (dyn Fn([f32; 3], [f32; 3]) -> f32 + Sync);

/// The quotient of the 19-point operator, over h².
pub(super) fn quotient(p: [f32; 3]) -> f32 {
    (1.0 - sum(p) / 3.0) / operator(p)
}

fn sum(p: [f32; 3]) -> f32 {
    p[0] + p[1] + p[2]
}

/// −h² times the eigenvalue.
fn operator(p: [f32; 3]) -> f32 {
    4.0 * sum(p) - 8.0 / 3.0 * (p[0] * p[1] + p[1] * p[2] + p[2] * p[0])
}

/// Replaces the source inside `field` by the potential, and its boundary by `faces`.
///
/// # Panics
/// If an axis has a number of cells that cannot be transformed.
pub(super) fn solve(field: &mut Field, faces: &Faces, green: Green<'_>) {
    let lattice = field.lattice;
    let sines = lattice.cells.map(Sine::new);
    let sides = sides(faces, &sines);
    let modes = lattice.cells.map(|n| {
        let angle = |k: usize| std::f64::consts::PI * k as f64 / n as f64;
        (0..n).map(|k| [angle(k) as f32, (angle(k) / 2.0).sin().powi(2) as f32]).collect()
    });
    for values in &mut field.values {
        par::for_chunks(values, lattice.plane(), |first, plane| {
            let z = first / lattice.plane();
            if z > 0 && z < lattice.cells[2] {
                lanes::run(Across { sines: [&sines[0], &sines[1]], row: lattice.row(), plane });
            }
        });
    }

    // Planes of constant y: the three components of each after one another.
    let slab = lattice.row() * (lattice.cells[2] + 1);
    let mut turned = par::repeated(0.0_f32, 3 * slab * (lattice.cells[1] + 1));
    let values = [0, 1, 2].map(|k| &field.values[k][..]);
    par::for_chunks(&mut turned, 3 * slab, |first, out| {
        let y = first / (3 * slab);
        if y > 0 && y < lattice.cells[1] {
            lanes::run(Along { lattice, sines: &sines, modes: &modes, sides: &sides, green, values, y, out });
        }
    });

    for (k, values) in field.values.iter_mut().enumerate() {
        par::for_chunks(values, lattice.plane(), |first, plane| {
            let (z, row) = (first / lattice.plane(), lattice.row());
            if z > 0 && z < lattice.cells[2] {
                for (y, values) in plane.chunks_exact_mut(row).enumerate() {
                    let from = 3 * slab * y + k * slab + row * z;
                    values.copy_from_slice(&turned[from..from + row]);
                }
                lanes::run(Across { sines: [&sines[0], &sines[1]], row, plane });
            }
        });
    }
    faces.write(field);
}

/// The transforms of what the boundary adds to the equations next to it, for the two faces of every axis and every component: h²
/// times the operator's weights, ⅓ of the nearest node and ⅙ of its four neighbours on the face.
type Sides = [[[Plane; 3]; 2]; 3];

fn sides(faces: &Faces, sines: &[Sine; 3]) -> Sides {
    let mut planes = par::map(18, |n| {
        let (axis, side, k) = (n / 6, n / 3 % 2, n % 3);
        Some(side_of(&faces.values[axis][side][k], axis, sines))
    });
    [0, 1, 2].map(|axis| {
        [0, 1].map(|side| [0, 1, 2].map(|k| planes[6 * axis + 3 * side + k].take().expect("one each")))
    })
}

fn side_of(face: &Plane, axis: usize, sines: &[Sine; 3]) -> Plane {
    // Nodes that two or three faces share count for the first of these axes.
    let [b, c] = others(axis);
    let (low_b, low_c) = (usize::from(b < axis), usize::from(c < axis));
    let counted = |i: usize, j: usize| {
        let own = i >= low_b && i + low_b <= face.cells[0] && j >= low_c && j + low_c <= face.cells[1];
        if own { face.at(i, j) } else { 0.0 }
    };
    let mut out = Plane::new(face.cells);
    for j in 1..face.cells[1] {
        for i in 1..face.cells[0] {
            let beside = counted(i - 1, j) + counted(i + 1, j) + counted(i, j - 1) + counted(i, j + 1);
            out.set(i, j, counted(i, j) / 3.0 + beside / 6.0);
        }
    }
    let row = out.row();
    lanes::run(Across { sines: [&sines[b], &sines[c]], row, plane: &mut out.values });
    out
}

/// The axes of a face.
pub(super) fn others(axis: usize) -> [usize; 2] {
    [[1, 2], [0, 2], [0, 1]][axis]
}

/// Transforms the rows and then the columns of a plane, but those of its edges.
struct Across<'a> {
    sines: [&'a Sine; 2],
    row: usize,
    plane: &'a mut [f32],
}

impl Pass for Across<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { sines: [along, across], row, plane } = self;
        let rows = across.cells();
        let mut line: Vec<Complex<L>> = vec![[splat(0.0); 2]; row.max(rows)];
        let mut work = line.clone();

        // Sixteen rows at a time, turned so that a lane is a row. Rows beyond the last are its copies.
        for first in (1..rows).step_by(2 * LANES) {
            let place = |c: usize, lane: usize, x: usize| (first + LANES * c + lane).min(rows - 1) * row + x;
            for x in (0..row).step_by(LANES) {
                for c in 0..2 {
                    let part = |lane| eight(&plane[place(c, lane, x)..]);
                    let turned = L::columns(std::array::from_fn(part));
                    for k in 0..LANES {
                        line[x + k][c] = turned[k];
                    }
                }
            }
            along.transform(&mut line, &mut work);
            for x in (0..row).step_by(LANES) {
                for c in 0..2 {
                    let rows_of: [[f32; LANES]; LANES] = std::array::from_fn(|k| line[x + k][c].row());
                    let turned = L::columns(std::array::from_fn(|k| &rows_of[k]));
                    for lane in 0..LANES {
                        if first + LANES * c + lane < rows {
                            plane[place(c, lane, x)..][..LANES].copy_from_slice(&turned[lane].row());
                        }
                    }
                }
            }
        }

        for x in (0..row).step_by(ROW) {
            for y in 1..rows {
                let at = &plane[y * row + x..];
                line[y] = [L::load(eight(at)), L::load(eight(&at[LANES..]))];
            }
            across.transform(&mut line, &mut work);
            for y in 1..rows {
                let at = &mut plane[y * row + x..][..ROW];
                at[..LANES].copy_from_slice(&line[y][0].row());
                at[LANES..].copy_from_slice(&line[y][1].row());
            }
        }
    }
}

/// Lines along z of one y: forward, solved, and back.
struct Along<'a> {
    lattice: Lattice,
    sines: &'a [Sine; 3],
    /// θ and p of every mode of an axis.
    modes: &'a [Vec<[f32; 2]>; 3],
    sides: &'a Sides,
    green: Green<'a>,
    values: [&'a [f32]; 3],
    y: usize,
    out: &'a mut [f32],
}

impl Along<'_> {
    /// For modes x..x+16 of z-mode `z`: what the source is multiplied by, and the boundary's part.
    #[inline(always)]
    fn quotients(&self, x: usize, z: usize) -> [[f32; ROW]; 2] {
        let cells = self.lattice.cells;
        let norm = cells.iter().map(|&n| 2.0 / n as f32).product::<f32>();
        let mut out = [[0.0; ROW]; 2];
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

    /// The transform of the boundary's part at modes x..x+8 of z-mode `z`.
    #[inline(always)]
    fn boundary<L: Lanes>(&self, k: usize, x: usize, z: usize) -> L {
        let (y, n) = (self.y, self.lattice.cells);
        // A source in the last layer has the sine of that in the first, of alternating sign.
        let last = |k: usize, sine: f32| if k.is_multiple_of(2) { -sine } else { sine };
        let (mut first_x, mut last_x) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            if x + lane < n[0] {
                first_x[lane] = self.sines[0].sine(x + lane);
                last_x[lane] = last(x + lane, first_x[lane]);
            }
        }
        let (sine_y, sine_z) = (self.sines[1].sine(y), self.sines[2].sine(z));
        let row = |plane: &Plane, j: usize| L::load(eight(&plane.values[j * plane.row() + x..]));
        let of = |axis: usize, side: usize| &self.sides[axis][side][k];
        let from_x =
            L::load(&first_x) * splat(of(0, 0).at(y, z)) + L::load(&last_x) * splat(of(0, 1).at(y, z));
        let from_y = splat::<L>(sine_y) * row(of(1, 0), z) + splat::<L>(last(y, sine_y)) * row(of(1, 1), z);
        let from_z = splat::<L>(sine_z) * row(of(2, 0), y) + splat::<L>(last(z, sine_z)) * row(of(2, 1), y);
        from_x + from_y + from_z
    }
}

impl Pass for Along<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (row, count) = (self.lattice.row(), self.lattice.cells[2]);
        let slab = row * (count + 1);
        let mut line: Vec<Complex<L>> = vec![[splat(0.0); 2]; count];
        let mut work = line.clone();
        let mut quotients = vec![[[0.0; ROW]; 2]; count];
        for x in (0..row).step_by(ROW) {
            for (z, quotients) in quotients.iter_mut().enumerate().skip(1) {
                *quotients = self.quotients(x, z);
            }
            for k in 0..3 {
                let place = |z: usize| z * self.lattice.plane() + self.y * row + x;
                for (z, both) in line.iter_mut().enumerate().skip(1) {
                    let at = &self.values[k][place(z)..];
                    *both = [L::load(eight(at)), L::load(eight(&at[LANES..]))];
                }
                self.sines[2].transform(&mut line, &mut work);
                for (z, (both, quotients)) in line.iter_mut().zip(&quotients).enumerate().skip(1) {
                    for (c, value) in both.iter_mut().enumerate() {
                        let [source, boundary] =
                            quotients.each_ref().map(|q| L::load(eight(&q[LANES * c..])));
                        *value = *value * source;
                        *value += boundary * self.boundary::<L>(k, x + LANES * c, z);
                    }
                }
                self.sines[2].transform(&mut line, &mut work);
                for (z, both) in line.iter().enumerate().skip(1) {
                    let at = &mut self.out[k * slab + z * row + x..][..ROW];
                    at[..LANES].copy_from_slice(&both[0].row());
                    at[LANES..].copy_from_slice(&both[1].row());
                }
            }
        }
    }
}

/// The first eight of a slice.
#[inline(always)]
fn eight(values: &[f32]) -> &[f32; LANES] {
    values.first_chunk().expect("rows are filled up")
}
