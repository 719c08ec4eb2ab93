//! Implicit Euler, linearised once a time step, solved by preconditioned conjugate gradients.
//!
//! *Method*: [baraff98]: (M (1 + Δt c) + Δt C + Δt² K) v₁ = M v₀ + Δt f(x₀), solved by matrix-free conjugate
//! gradients from the first guess v₀. The preconditioner is block Jacobi: the inverses of the 3×3 blocks of
//! each point. Points of zero mobility are filtered out. f has no damping, since that acts on v₁. This is
//! [baraff98] Eq. 6 with v₀ on the right.
//! *Departs from the paper*: springs in compression keep only the part of their derivative along themselves,
//! so that the matrix is positive definite. Joints with a direction are linearised across it.
//!
//! Symbols: as in `springs.rs`; A → [`Matrix`]; r, the residual → `residual`; z, the preconditioned residual
//! → `preconditioned`; p, the search direction → `direction`.
//! Limits: first order in time; damps waves faster than the time step. Sums are double, vectors single
//! precision, so residuals below 1e-7 are not reached.

use super::{
    constraints::JointPair,
    exact_joints::ExactJoints,
    sliced_ellpack::SlicedEllpack,
    springs::{self, Blocks, Gather, LinearTerms, SpringProduct, update_blocks},
    vectors::{Dot, Eight, Vectors, in_chunks},
};
use crate::{
    math::Vec3,
    par,
    simd::{self, F32x8, LANES, Lanes, Pass},
};

/// The points of a part, as ranges of sheets.
pub(super) type FreePart = Vec<std::ops::Range<usize>>;

/// Left side of the implicit equation.
pub(super) struct Matrix<'a> {
    pub(super) springs: &'a SlicedEllpack,
    pub(super) plates: Option<&'a SlicedEllpack>,
    /// Positions at which forces are linearised.
    pub(super) x: &'a Vectors,
    pub(super) mass: &'a [F32x8],
    pub(super) inverse: &'a [F32x8],
    pub(super) drag: Option<&'a [F32x8]>,
    /// Δt² times the stiffness of soft pins and repulsion; empty if there are none.
    pub(super) blocks: Vec<Blocks>,
    pub(super) joints: Vec<&'a JointPair>,
    pub(super) exact_joints: &'a ExactJoints,
    /// The parts of the sheets that no pin holds.
    pub(super) free_parts: &'a [FreePart],
    pub(super) dt: f32,
}

/// Iterations and residual of a solve by conjugate gradients.
#[derive(Clone, Copy, Debug)]
pub(super) struct SolveReport {
    pub(super) iterations: u32,
    /// |r|/|b| in the norm of the preconditioner; the first guess's r takes the place of b where it is
    /// larger.
    pub(super) residual: f64,
}

impl Matrix<'_> {
    /// M (1 + Δt c) of eight points.
    #[inline(always)]
    pub(super) fn inertia(&self, at: usize) -> F32x8 {
        let mut out = self.mass[at];
        if let Some(drag) = self.drag {
            for lane in 0..LANES {
                out[lane] *= 1.0 + self.dt * drag[at][lane];
            }
        }
        out
    }

    /// A p, zero at points of zero mobility. Returns p·A p.
    pub(super) fn multiply(&self, p: &Vectors, out: &mut Vectors) -> f64 {
        let springs = SpringProduct { table: self.springs, x: self.x, p, dt: self.dt };
        let plates = self.plates.map(|table| LinearTerms { table, y: p, factor: -self.dt * self.dt });
        let product = springs::write(out, &Product { matrix: self, p, springs, plates }, p);
        if self.joints.is_empty() && self.exact_joints.is_empty() {
            return product;
        }
        for joint in &self.joints {
            let [a, b] = joint.ends.map(|i| i as usize);
            let mut q = (p.get(a) - p.get(b)) * (self.dt * self.dt * joint.stiffness.unwrap_or(0.0));
            q -= joint.direction.map_or(Vec3::zeros(), |n| n * n.dot(&q));
            out.add(a, q);
            out.add(b, -q);
        }
        self.filter(out);
        p.dot(out)
    }

    /// Projects to the motions that pins and exact joints allow.
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
        self.exact_joints.filter(self.inverse, out);
    }

    /// Diagonal blocks of A.
    pub(super) fn diagonal(&self) -> Vec<Blocks> {
        let mut blocks = if self.blocks.is_empty() {
            par::repeated([[0.0; LANES]; 6], self.mass.len())
        } else {
            par::copied(&self.blocks)
        };
        update_blocks(&mut blocks, |at, block| {
            let m = self.inertia(at);
            for part in &mut block[..3] {
                for lane in 0..LANES {
                    part[lane] += m[lane];
                }
            }
        });
        springs::add_blocks(self.springs, self.x, self.dt, &mut blocks);
        if let Some(plates) = self.plates {
            springs::add_linear_blocks(plates, self.dt * self.dt, &mut blocks);
        }
        for joint in &self.joints {
            let stiffness = self.dt * self.dt * joint.stiffness.unwrap_or(0.0);
            joint.ends.iter().for_each(|&i| add_all(&mut blocks, i as usize, stiffness));
        }
        blocks
    }

    /// Solves A v = `right` from the first guess `v`. Points of zero mobility keep their velocity.
    pub(super) fn solve(
        &self,
        right: &Vectors,
        v: &mut Vectors,
        tolerance: f64,
        max_iterations: u32,
    ) -> SolveReport {
        let mut preconditioner = self.diagonal();
        invert_all(&mut preconditioner);
        let precondition = |r: &Vectors, z: &mut Vectors| {
            precondition(&preconditioner, r, z);
            self.exact_joints.filter(self.inverse, z);
        };
        let len = v.len();
        let (mut product, mut preconditioned) = (Vectors::zeros(len), Vectors::zeros(len));

        // Size of the right side, and the residual of the first guess.
        let mut residual = right.clone();
        self.filter(&mut residual);
        precondition(&residual, &mut preconditioned);
        let right_norm = residual.dot(&preconditioned);
        self.multiply(v, &mut product);
        combine(&mut residual, 1.0, &product, -1.0);
        precondition(&residual, &mut preconditioned);
        let mut direction = preconditioned.clone();
        let mut norm = residual.dot(&preconditioned);
        // If only the motion of a pin moves points, the right side is zero.
        let right_norm = right_norm.max(norm);
        let goal = tolerance * tolerance * right_norm;
        let mut iterations = 0;
        while norm > goal && iterations < max_iterations {
            let alpha = norm / self.multiply(&direction, &mut product);
            let iteration = Iteration {
                alpha: alpha as f32,
                direction: &direction,
                product: &product,
                preconditioner: &preconditioner,
            };
            let mut next = iteration.step(v, &mut residual, &mut preconditioned);
            if !self.exact_joints.is_empty() {
                self.exact_joints.filter(self.inverse, &mut preconditioned);
                next = residual.dot(&preconditioned);
            }
            let before = std::mem::replace(&mut norm, next);
            combine(&mut direction, (norm / before) as f32, &preconditioned, 1.0);
            iterations += 1;
        }
        self.translate(right, v);
        let residual = if right_norm > 0.0 { (norm / right_norm).max(0.0).sqrt() } else { 0.0 };
        SolveReport { iterations, residual }
    }
}

/// The rows of A p without joints.
struct Product<'a> {
    matrix: &'a Matrix<'a>,
    p: &'a Vectors,
    springs: SpringProduct<'a>,
    plates: Option<LinearTerms<'a>>,
}

impl Gather for Product<'_> {
    #[inline(always)]
    fn eight(&self, at: usize) -> Eight {
        let (p, m) = (self.p.eight(at), self.matrix.inertia(at));
        let mut sum = [[0.0; LANES]; 3];
        if let Some(blocks) = self.matrix.blocks.get(at) {
            sum = multiply_symmetric(blocks, &p);
        }
        let springs = self.springs.eight(at);
        let mut plates = [[0.0; LANES]; 3];
        if let Some(table) = &self.plates {
            plates = table.eight(at);
        }
        let inverse = self.matrix.inverse[at];
        for axis in 0..3 {
            for lane in 0..LANES {
                let own = m[lane] * p[axis][lane] + sum[axis][lane];
                let all = own + springs[axis][lane] + plates[axis][lane];
                sum[axis][lane] = if inverse[lane] == 0.0 { 0.0 } else { all };
            }
        }
        sum
    }
}

/// One iteration of the conjugate gradients, in one pass through memory.
struct Iteration<'a> {
    alpha: f32,
    direction: &'a Vectors,
    product: &'a Vectors,
    preconditioner: &'a [Blocks],
}

impl Iteration<'_> {
    /// v ← v + α p, r ← r − α A p, z ← blocks r. Returns r·z.
    fn step(&self, v: &mut Vectors, residual: &mut Vectors, preconditioned: &mut Vectors) -> f64 {
        let ([v0, v1, v2], [r0, r1, r2], [z0, z1, z2]) =
            (&mut v.axes, &mut residual.axes, &mut preconditioned.axes);
        let all: [&mut [F32x8]; 9] = [v0, v1, v2, r0, r1, r2, z0, z1, z2];
        let sums = in_chunks(all, |start, [v0, v1, v2, r0, r1, r2, z0, z1, z2]| {
            simd::dispatch(IterationChunk {
                iteration: self,
                start,
                v: [v0, v1, v2],
                r: [r0, r1, r2],
                z: [z0, z1, z2],
            })
        });
        sums.into_iter().sum()
    }
}

struct IterationChunk<'a> {
    iteration: &'a Iteration<'a>,
    start: usize,
    v: [&'a mut [F32x8]; 3],
    r: [&'a mut [F32x8]; 3],
    z: [&'a mut [F32x8]; 3],
}

impl Pass for IterationChunk<'_> {
    type Out = f64;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> f64 {
        let Iteration { alpha, direction, product, preconditioner } = *self.iteration;
        let mut sum = Dot::default();
        for k in 0..self.v[0].len() {
            let at = self.start + k;
            let (direction, product) = (direction.eight(at), product.eight(at));
            let mut residual = [[0.0; LANES]; 3];
            for axis in 0..3 {
                let (mut v, r) = (self.v[axis][k], self.r[axis][k]);
                for lane in 0..LANES {
                    v[lane] += alpha * direction[axis][lane];
                    residual[axis][lane] = r[lane] - alpha * product[axis][lane];
                }
                (self.v[axis][k], self.r[axis][k]) = (v, residual[axis]);
            }
            let preconditioned = multiply_symmetric(&preconditioner[at], &residual);
            let [z0, z1, z2] = &mut self.z;
            [z0[k], z1[k], z2[k]] = preconditioned;
            sum.add(&residual, &preconditioned);
        }
        sum.total()
    }
}

/// z ← blocks r: applies the preconditioner.
pub(super) fn precondition(blocks: &[Blocks], r: &Vectors, z: &mut Vectors) {
    z.update(|at, out| {
        let product = multiply_symmetric(&blocks[at], &r.eight(at));
        out.into_iter().zip(product).for_each(|(out, product)| *out = product);
    });
}

/// Inverts every block.
pub(super) fn invert_all(blocks: &mut [Blocks]) {
    update_blocks(blocks, |_, block| {
        for lane in 0..LANES {
            let inverted = invert(std::array::from_fn(|part| block[part][lane]));
            block.iter_mut().zip(inverted).for_each(|(part, value)| part[lane] = value);
        }
    });
}

/// a ← f a + g b.
pub(super) fn combine(a: &mut Vectors, f: f32, b: &Vectors, g: f32) {
    a.update(|at, out| {
        for (out, b) in out.into_iter().zip(b.eight(at)) {
            for lane in 0..LANES {
                out[lane] = f * out[lane] + g * b[lane];
            }
        }
    });
}

/// Symmetric matrices times vectors.
#[inline(always)]
fn multiply_symmetric(m: &Blocks, p: &Eight) -> Eight {
    let mut out = [[0.0; LANES]; 3];
    for (axis, parts) in [[0, 3, 4], [3, 1, 5], [4, 5, 2]].into_iter().enumerate() {
        for lane in 0..LANES {
            out[axis][lane] = m[parts[0]][lane] * p[0][lane]
                + m[parts[1]][lane] * p[1][lane]
                + m[parts[2]][lane] * p[2][lane];
        }
    }
    out
}

/// Inverse of a symmetric positive definite matrix; zero for the padding, which has no point.
fn invert(m: [f32; 6]) -> [f32; 6] {
    let [a, b, c, d, e, f] = m.map(f64::from); // xx, yy, zz, xy, xz, yz
    let (aa, dd, ee) = (b * c - f * f, e * f - d * c, d * f - e * b);
    let determinant = a * aa + d * dd + e * ee;
    let scaled =
        [aa, a * c - e * e, a * b - d * d, dd, ee, d * e - a * f].map(|part| (part / determinant) as f32);
    if scaled.iter().all(|part| part.is_finite()) { scaled } else { [0.0; 6] }
}

/// Adds k n nᵀ to the block of a point.
pub(super) fn add_along(blocks: &mut [Blocks], i: usize, k: f32, n: Vec3) {
    add_to_block(&mut blocks[i / LANES], i % LANES, k, n);
}

/// Adds k n nᵀ to the block of one of eight points.
pub(super) fn add_to_block(block: &mut Blocks, lane: usize, k: f32, n: Vec3) {
    for (part, (a, b)) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
        block[part][lane] += k * n[a] * n[b];
    }
}

/// n · B n of the block B of a point.
pub(super) fn along(blocks: &[Blocks], i: usize, n: Vec3) -> f32 {
    let [xx, yy, zz, xy, xz, yz] = blocks[i / LANES].map(|part| part[i % LANES]);
    let mixed = xy * n.x * n.y + xz * n.x * n.z + yz * n.y * n.z;
    xx * n.x * n.x + yy * n.y * n.y + zz * n.z * n.z + 2.0 * mixed
}

/// Trace of the block of a point.
pub(super) fn trace(blocks: &[Blocks], i: usize) -> f32 {
    blocks[i / LANES][..3].iter().map(|part| part[i % LANES]).sum()
}

/// Adds k 1 to the block of a point.
pub(super) fn add_all(blocks: &mut [Blocks], i: usize, k: f32) {
    blocks[i / LANES][..3].iter_mut().for_each(|part| part[i % LANES] += k);
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

    /// Two sheets with every term of the left side: plates, both kinds of damping, soft and exact pins and
    /// joints.
    fn sheets_with_every_term() -> Sheets {
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
        let params: SheetsParams = crate::from_toml(&text);
        let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
        let mut sheets = Sheets::new(Shot { params, fps: 24.0, first: 1 }, &world).unwrap();
        sheets.update_holds(0.0);
        let crumpled: Vec<Vec3> =
            sheets.positions().iter().zip(noise(sheets.len(), 0.7)).map(|(x, by)| x + 0.08 * by).collect();
        sheets.x = Vectors::of(&crumpled);
        sheets
    }

    fn noise(count: usize, seed: f32) -> Vec<Vec3> {
        let at = |i: usize, k: f32| (seed + k + i as f32 * (1.3 + 0.7 * k)).sin();
        (0..count).map(|i| Vec3::new(at(i, 0.0), at(i, 1.0), at(i, 2.0))).collect()
    }

    /// Reference for A p: entry by entry, in double precision.
    fn expected(matrix: &Matrix<'_>, p: &Vectors) -> Vectors {
        let of = |v: &Vectors, i: usize| v.get(i).cast::<f64>();
        let mut out = Vec::new();
        for i in 0..p.len() {
            let (at, lane) = (i / LANES, i % LANES);
            let drag = 1.0 + DT * f64::from(matrix.drag.unwrap()[at][lane]);
            let [xx, yy, zz, xy, xz, yz] = matrix.blocks[at].map(|part| f64::from(part[lane]));
            let block = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
            let mut sum = of(p, i) * (f64::from(matrix.mass[at][lane]) * drag) + block * of(p, i);
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
        for joint in &matrix.joints {
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
    fn the_matrix_is_the_sum_of_its_terms_and_conjugate_gradients_invert_it() {
        let sheets = sheets_with_every_term();
        let matrix = sheets.matrix(&sheets.x, sheets.pin_blocks(0.0, DT), 0.0, DT);
        assert!(!matrix.blocks.is_empty() && matrix.joints.len() == 3 && !matrix.exact_joints.is_empty());
        let mut p = Vectors::of(&noise(sheets.len(), 2.9));
        matrix.filter(&mut p);
        let mut found = Vectors::zeros(p.len());
        let product = matrix.multiply(&p, &mut found);
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

        // The solution of A v = A p is p. The block Jacobi preconditioner needs the blocks of pins and
        // joints; without them it takes more iterations.
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
