//! Implicit Euler, linearised once a substep.
//!
//! *Method*: [baraff98]: (M (1 + Δt c) + Δt C + Δt² K) v₁ = M v₀ + Δt f(x₀), solved by conjugate gradients without a matrix, begun
//! at v₀ and preconditioned by the inverses of the 3×3 blocks of each point. Points of no mobility are filtered out. f has no damping:
//! that acts on v₁. It is [baraff98] Eq. 6 with v₀ on the right.
//! *Departs from the paper*: springs in compression keep the part of their derivative along themselves only, so that the matrix is positive;
//! joints with a direction are taken across it.
//!
//! Symbols: as in `springs.rs`; A → [`Matrix`], r → `rest`, z → `better`, p → `way`.
//! Limits: first order in time; damps waves faster than the substep. Sums are double, vectors single precision: residuals below 1e-7 are
//! not reached.

use super::{
    bonds::Bonds,
    free::Part,
    hold::Joined,
    lanes::{Dot, Eight, Vectors, in_chunks},
    springs::{self, Blocks, Change, Gather, Linear, update_blocks},
    table::Table,
};
use crate::{
    math::{
        Vec3,
        wide::{self, Job, WIDTH, Wide},
    },
    par,
};

/// The left side.
pub(super) struct Matrix<'a> {
    pub(super) springs: &'a Table,
    pub(super) plates: Option<&'a Table>,
    /// Positions at which it is taken.
    pub(super) x: &'a Vectors,
    pub(super) mass: &'a [Wide],
    pub(super) inverse: &'a [Wide],
    pub(super) drag: Option<&'a [Wide]>,
    /// Δt² of what else holds points; empty if nothing does.
    pub(super) held: Vec<Blocks>,
    pub(super) joined: Vec<&'a Joined>,
    pub(super) bonds: &'a Bonds,
    /// Which of the points move as a whole.
    pub(super) parts: &'a [Part],
    pub(super) dt: f32,
}

/// How the conjugate gradients went.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solved {
    pub(super) iterations: u32,
    /// |r|/|b| in the preconditioner's norm; of the first guess's r where that is larger than b.
    pub(super) residual: f64,
}

impl Matrix<'_> {
    /// M (1 + Δt c) of eight points.
    #[inline(always)]
    pub(super) fn inertia(&self, at: usize) -> Wide {
        let mut out = self.mass[at];
        if let Some(drag) = self.drag {
            for lane in 0..WIDTH {
                out[lane] *= 1.0 + self.dt * drag[at][lane];
            }
        }
        out
    }

    /// A p, zero at points of no mobility. Returns p·A p.
    pub(super) fn times(&self, p: &Vectors, out: &mut Vectors) -> f64 {
        let springs = Change { table: self.springs, x: self.x, p, dt: self.dt };
        let plates = self.plates.map(|table| Linear { table, y: p, factor: -self.dt * self.dt });
        let found = springs::write(out, &Product { matrix: self, p, springs, plates }, p);
        if self.joined.is_empty() && self.bonds.is_empty() {
            return found;
        }
        for joint in &self.joined {
            let [a, b] = joint.ends.map(|i| i as usize);
            let mut q = (p.get(a) - p.get(b)) * (self.dt * self.dt * joint.stiffness.unwrap_or(0.0));
            q -= joint.direction.map_or(Vec3::zeros(), |n| n * n.dot(&q));
            out.add(a, q);
            out.add(b, -q);
        }
        self.filter(out);
        p.dot(out)
    }

    /// Leaves what points of mobility and bonds allow.
    pub(super) fn filter(&self, out: &mut Vectors) {
        out.update(|at, axes| {
            for axis in axes {
                for (value, &inverse) in axis.iter_mut().zip(&self.inverse[at]) {
                    if inverse == 0.0 {
                        *value = 0.0;
                    }
                }
            }
        });
        self.bonds.filter(self.inverse, out);
    }

    /// The blocks on the diagonal.
    pub(super) fn diagonal(&self) -> Vec<Blocks> {
        let mut blocks = if self.held.is_empty() {
            par::repeated([[0.0; WIDTH]; 6], self.mass.len())
        } else {
            par::copied(&self.held)
        };
        update_blocks(&mut blocks, |at, block| {
            let m = self.inertia(at);
            for part in &mut block[..3] {
                for lane in 0..WIDTH {
                    part[lane] += m[lane];
                }
            }
        });
        springs::add_blocks(self.springs, self.x, self.dt, &mut blocks);
        if let Some(plates) = self.plates {
            springs::add_linear_blocks(plates, self.dt * self.dt, &mut blocks);
        }
        for joint in &self.joined {
            let stiffness = self.dt * self.dt * joint.stiffness.unwrap_or(0.0);
            joint.ends.iter().for_each(|&i| add_all(&mut blocks, i as usize, stiffness));
        }
        blocks
    }

    /// Solves A v = `right`, from `v`, whose points of no mobility stay.
    pub(super) fn solve(&self, right: &Vectors, v: &mut Vectors, tolerance: f64, most: u32) -> Solved {
        let mut inverses = self.diagonal();
        invert_all(&mut inverses);
        let precondition = |r: &Vectors, z: &mut Vectors| {
            precondition(&inverses, r, z);
            self.bonds.filter(self.inverse, z);
        };
        let len = v.len();
        let (mut product, mut better) = (Vectors::zeros(len), Vectors::zeros(len));

        // The size of the right side, and what the first guess leaves of it.
        let mut rest = right.clone();
        self.filter(&mut rest);
        precondition(&rest, &mut better);
        let size = rest.dot(&better);
        self.times(v, &mut product);
        combine(&mut rest, 1.0, &product, -1.0);
        precondition(&rest, &mut better);
        let mut way = better.clone();
        let mut left = rest.dot(&better);
        // Where nothing but the way of a pin moves points, the right side has no size.
        let size = size.max(left);
        let goal = tolerance * tolerance * size;
        let mut iterations = 0;
        while left > goal && iterations < most {
            let alpha = left / self.times(&way, &mut product);
            let down = Down { alpha: alpha as f32, way: &way, product: &product, inverses: &inverses };
            let mut next = down.step(v, &mut rest, &mut better);
            if !self.bonds.is_empty() {
                self.bonds.filter(self.inverse, &mut better);
                next = rest.dot(&better);
            }
            let before = std::mem::replace(&mut left, next);
            combine(&mut way, (left / before) as f32, &better, 1.0);
            iterations += 1;
        }
        self.translate(right, v);
        let residual = if size > 0.0 { (left / size).max(0.0).sqrt() } else { 0.0 };
        Solved { iterations, residual }
    }
}

/// The rows of A p but for joints and bonds.
struct Product<'a> {
    matrix: &'a Matrix<'a>,
    p: &'a Vectors,
    springs: Change<'a>,
    plates: Option<Linear<'a>>,
}

impl Gather for Product<'_> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let (p, m) = (self.p.eight(at), self.matrix.inertia(at));
        let mut sum = [[0.0; WIDTH]; 3];
        if let Some(held) = self.matrix.held.get(at) {
            sum = symmetric(held, &p);
        }
        let springs = self.springs.eight(at);
        let mut plates = [[0.0; WIDTH]; 3];
        if let Some(table) = &self.plates {
            plates = table.eight(at);
        }
        let inverse = self.matrix.inverse[at];
        for axis in 0..3 {
            for lane in 0..WIDTH {
                let own = m[lane] * p[axis][lane] + sum[axis][lane];
                let all = own + springs[axis][lane] + plates[axis][lane];
                sum[axis][lane] = if inverse[lane] == 0.0 { 0.0 } else { all };
            }
        }
        sum
    }
}

/// A step of the conjugate gradients, in one go through memory.
struct Down<'a> {
    alpha: f32,
    way: &'a Vectors,
    product: &'a Vectors,
    inverses: &'a [Blocks],
}

impl Down<'_> {
    /// v ← v + α p, r ← r − α A p, z ← blocks r. Returns r·z.
    fn step(&self, v: &mut Vectors, rest: &mut Vectors, better: &mut Vectors) -> f64 {
        let ([v0, v1, v2], [r0, r1, r2], [z0, z1, z2]) = (&mut v.axes, &mut rest.axes, &mut better.axes);
        let all: [&mut [Wide]; 9] = [v0, v1, v2, r0, r1, r2, z0, z1, z2];
        let parts = in_chunks(all, |start, [v0, v1, v2, r0, r1, r2, z0, z1, z2]| {
            wide::run(DownPart { down: self, start, v: [v0, v1, v2], r: [r0, r1, r2], z: [z0, z1, z2] })
        });
        parts.into_iter().sum()
    }
}

struct DownPart<'a> {
    down: &'a Down<'a>,
    start: usize,
    v: [&'a mut [Wide]; 3],
    r: [&'a mut [Wide]; 3],
    z: [&'a mut [Wide]; 3],
}

impl Job for DownPart<'_> {
    type Out = f64;

    #[inline(always)]
    fn run(mut self) -> f64 {
        let Down { alpha, way, product, inverses } = *self.down;
        let mut sum = Dot::default();
        for k in 0..self.v[0].len() {
            let at = self.start + k;
            let (way, product) = (way.eight(at), product.eight(at));
            let mut rest = [[0.0; WIDTH]; 3];
            for axis in 0..3 {
                let (mut v, r) = (self.v[axis][k], self.r[axis][k]);
                for lane in 0..WIDTH {
                    v[lane] += alpha * way[axis][lane];
                    rest[axis][lane] = r[lane] - alpha * product[axis][lane];
                }
                (self.v[axis][k], self.r[axis][k]) = (v, rest[axis]);
            }
            let better = symmetric(&inverses[at], &rest);
            let [z0, z1, z2] = &mut self.z;
            [z0[k], z1[k], z2[k]] = better;
            sum.add(&rest, &better);
        }
        sum.total()
    }
}

/// z ← blocks r.
pub(super) fn precondition(blocks: &[Blocks], r: &Vectors, z: &mut Vectors) {
    z.update(|at, out| {
        let found = symmetric(&blocks[at], &r.eight(at));
        out.into_iter().zip(found).for_each(|(out, found)| *out = found);
    });
}

/// Inverts every block.
pub(super) fn invert_all(blocks: &mut [Blocks]) {
    update_blocks(blocks, |_, block| {
        for lane in 0..WIDTH {
            let inverted = invert(std::array::from_fn(|part| block[part][lane]));
            block.iter_mut().zip(inverted).for_each(|(part, value)| part[lane] = value);
        }
    });
}

/// a ← f a + g b.
pub(super) fn combine(a: &mut Vectors, f: f32, b: &Vectors, g: f32) {
    a.update(|at, out| {
        for (out, b) in out.into_iter().zip(b.eight(at)) {
            for lane in 0..WIDTH {
                out[lane] = f * out[lane] + g * b[lane];
            }
        }
    });
}

/// Symmetric matrices times vectors.
#[inline(always)]
fn symmetric(m: &Blocks, p: &Eight) -> Eight {
    let mut out = [[0.0; WIDTH]; 3];
    for (axis, parts) in [[0, 3, 4], [3, 1, 5], [4, 5, 2]].into_iter().enumerate() {
        for lane in 0..WIDTH {
            out[axis][lane] = m[parts[0]][lane] * p[0][lane]
                + m[parts[1]][lane] * p[1][lane]
                + m[parts[2]][lane] * p[2][lane];
        }
    }
    out
}

/// The inverse of a symmetric positive matrix; zero for that of no point.
fn invert(m: [f32; 6]) -> [f32; 6] {
    let [a, b, c, d, e, f] = m.map(f64::from); // xx, yy, zz, xy, xz, yz
    let (aa, dd, ee) = (b * c - f * f, e * f - d * c, d * f - e * b);
    let determinant = a * aa + d * dd + e * ee;
    let scaled =
        [aa, a * c - e * e, a * b - d * d, dd, ee, d * e - a * f].map(|part| (part / determinant) as f32);
    if scaled.iter().all(|part| part.is_finite()) { scaled } else { [0.0; 6] }
}

/// The blocks k n nᵀ.
pub(super) fn add_along(blocks: &mut [Blocks], i: usize, k: f32, n: Vec3) {
    add_to_block(&mut blocks[i / WIDTH], i % WIDTH, k, n);
}

/// The block k n nᵀ of one of eight.
pub(super) fn add_to_block(block: &mut Blocks, lane: usize, k: f32, n: Vec3) {
    for (part, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
        block[part][lane] += k * n[a] * n[b];
    }
}

/// The blocks k 1.
pub(super) fn add_all(blocks: &mut [Blocks], i: usize, k: f32) {
    blocks[i / WIDTH][..3].iter_mut().for_each(|part| part[i % WIDTH] += k);
}

#[cfg(test)]
mod tests {
    use super::{
        super::{Sheets, SheetsParams, Shot},
        *,
    };
    use crate::sim::World;
    use nalgebra::{Matrix3, Vector3};

    const DT: f64 = 0.02;

    /// Two sheets with everything that the left side has: plates, both dampings, pins and joints of springs and exact ones.
    fn everything() -> Sheets {
        let sheet = |name: &str, z: f64, pin: &str| {
            format!(
                "[[sheet]]\nname = '{name}'\ndensity = 0.4\nstiffness = [50.0, 80.0]\nshear = 20.0\nbending = 0.02\ndamping = 3.0\n\
                 spring_damping = [0.01, 0.02]\nrest = [0.8, 1.3]\n{pin}\n\
                 shape = {{ grid = {{ origin = [0, 0, {z}], first = [1, 0, 0], second = [0, 0.9, 0], cells = [5, 4] }} }}\n"
            )
        };
        let joint = |points: [u32; 2], terms: &str| {
            let [a, b] = points;
            format!(
                "[[sheets.joint]]\nsheets = ['one', 'two']\nat = [{{ points = [{a}] }}, {{ points = [{b}] }}]\n{terms}\n"
            )
        };
        let text = sheet(
            "one",
            0.0,
            "pin = [{ at = { points = [0, 7] } }, { at = { points = [12] }, stiffness = 30.0 }]",
        ) + &sheet("two", 0.0, "")
            + &joint([29, 29], "")
            + &joint([20, 14], "stiffness = 40.0")
            + &joint([16, 9], "stiffness = 60.0\ndirection = [0, 0.6, 0.8]");
        let params: SheetsParams = toml::from_str(&text).unwrap();
        let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
        let mut sheets = Sheets::new(Shot { params, fps: 24.0, first: 1 }, &world).unwrap();
        sheets.settle(0.0);
        let crumpled: Vec<Vec3> =
            sheets.positions().iter().zip(noise(sheets.len(), 0.7)).map(|(x, by)| x + 0.08 * by).collect();
        sheets.x = Vectors::of(&crumpled);
        sheets
    }

    fn noise(count: usize, seed: f32) -> Vec<Vec3> {
        let at = |i: usize, k: f32| (seed + k + i as f32 * (1.3 + 0.7 * k)).sin();
        (0..count).map(|i| Vec3::new(at(i, 0.0), at(i, 1.0), at(i, 2.0))).collect()
    }

    /// The readable form of A p: entry by entry, in double precision.
    fn expected(matrix: &Matrix<'_>, p: &Vectors) -> Vectors {
        let of = |v: &Vectors, i: usize| v.get(i).cast::<f64>();
        let mut out = Vec::new();
        for i in 0..p.len() {
            let (at, lane) = (i / WIDTH, i % WIDTH);
            let drag = 1.0 + DT * f64::from(matrix.drag.unwrap()[at][lane]);
            let [xx, yy, zz, xy, xz, yz] = matrix.held[at].map(|part| f64::from(part[lane]));
            let held = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let mut sum = of(p, i) * (f64::from(matrix.mass[at][lane]) * drag) + held * of(p, i);
            let (slots, damping) = matrix.springs.of(at);
            for (slot, damping) in slots.iter().zip(damping) {
                let (j, k) = (slot.to(at, lane), f64::from(slot.stiffness[lane]));
                let d = of(matrix.x, j) - of(matrix.x, i);
                if k > 0.0 {
                    let n = d.normalize();
                    let taut = (1.0 - f64::from(slot.rest[lane]) / d.norm()).max(0.0);
                    let q = of(p, i) - of(p, j);
                    let along = n * n.dot(&q);
                    sum += along * (DT * DT * k + DT * f64::from(damping[lane]))
                        + (q - along) * (DT * DT * k * taut);
                }
            }
            for slot in matrix.plates.unwrap().of(at).0 {
                let q = of(p, i) - of(p, slot.to(at, lane));
                sum += q * (DT * DT * f64::from(slot.stiffness[lane]));
            }
            out.push(sum);
        }
        for joint in &matrix.joined {
            let [a, b] = joint.ends.map(|i| i as usize);
            let mut q = (of(p, a) - of(p, b)) * (DT * DT * f64::from(joint.stiffness.unwrap_or(0.0)));
            if let Some(n) = joint.direction {
                let n: Vector3<f64> = n.cast();
                q -= n * n.dot(&q);
            }
            out[a] += q;
            out[b] -= q;
        }
        let mut out = Vectors::of(&out.iter().map(|v| v.cast()).collect::<Vec<Vec3>>());
        matrix.filter(&mut out);
        out
    }

    #[test]
    fn the_left_side_is_the_sum_of_its_parts_and_solved() {
        let sheets = everything();
        let matrix = sheets.matrix(&sheets.x, sheets.held_blocks(0.0, DT), 0.0, DT);
        assert!(!matrix.held.is_empty() && matrix.joined.len() == 3 && !matrix.bonds.is_empty());
        let mut p = Vectors::of(&noise(sheets.len(), 2.9));
        matrix.filter(&mut p);
        let mut found = Vectors::zeros(p.len());
        let product = matrix.times(&p, &mut found);
        let expected = expected(&matrix, &p);
        let largest = expected.to_vec().iter().map(|v| v.norm()).fold(0.0, f32::max);
        for i in 0..p.len() {
            assert!(
                (found.get(i) - expected.get(i)).norm() < 1e-5 * largest,
                "{i}: {} {}",
                found.get(i),
                expected.get(i)
            );
        }
        assert!((product - p.dot(&expected)).abs() < 1e-5 * product && product > 0.0, "{product}");

        // What it makes of p has p for its solution. Blocks of points are the best guess there is: without what holds them, it takes longer.
        let mut v = Vectors::zeros(p.len());
        let solved = matrix.solve(&expected, &mut v, 1e-6, 200);
        let farthest = (0..p.len()).map(|i| (v.get(i) - p.get(i)).norm()).fold(0.0, f32::max);
        println!("{solved:?} {farthest}");
        assert!(
            solved.residual <= 1e-6 && farthest < 1e-4 && solved.iterations < 28,
            "{solved:?} {farthest}"
        );
    }
}
