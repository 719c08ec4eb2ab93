//! The common step of sheets and rigid bodies in contact.
//!
//! *Method*: augmented Lagrangian ([nocedal06] 17.4). A solve finds displacements Δx of points and Δq of bodies, on top of those by the Λ so
//! far, with A Δx = Σ (P(Λ − k y) − Λ) and M Δq = −Σ Jᵀ (P(Λ − k y) − Λ), where y is the relative displacement that is left after them. P
//! projects to what contacts can do: the normal part to pushes, the part across to the friction that the last solve allows. P(Λ − k y) are the
//! next Λ, and y decreases from solve to solve by the ratio of k to the masses. Both equations are the gradient of a convex function, as P
//! projects to convex sets. Its minimum is found by nonlinear conjugate gradients of Polak and Ribière, as for masses on faces
//! (`face_contacts.rs`).
//!
//! Symbols: k → `stiffness`, M → `masses`, (Δx, Δq) → [`Unknowns`].
//! Limits: at most [`MAX_CG_ITERATIONS`] a solve and [`MAX_SOLVES`] a substep; what is left is reduced in the next substep.

use super::contact::{BodyContact, BodyContacts, Unknowns, wrench};
use crate::{
    math::Vec3,
    sim::sheet::{
        Integrator, Sheets,
        face_contacts::{CoupledSubstep, line_search},
        implicit::{self, Matrix},
        springs::Blocks,
        vectors::Vectors,
    },
    simd::LANES,
    solid::RigidBody,
};
use nalgebra::{Matrix6, Vector6};

/// Tolerance of the conjugate gradients of one solve, relative to the largest right side of the substep, and their maximum number of
/// iterations. docs/decisions/045 has what others cost.
const TOLERANCE: f64 = 3e-4;
const MAX_CG_ITERATIONS: u32 = 200;

/// Maximum number of solves in a substep, and the change of Λ at which they end, relative to that of the first.
pub(in crate::sim) const MAX_SOLVES: u32 = 8;
const SOLVE_TOLERANCE: f32 = 1e-2;

/// Displacement that is rounding [m]: less is no reason for another iteration.
const ROUNDING: f32 = 1e-7;

/// k over the diagonal block of A at the point, along the normal and across it: a sheet is far softer across its plane than in it. With one k
/// for both, by the trace, the rounding of y was larger in Λ than the weight of a ball, and points were up to 2 % of its radius deep at rest.
const STIFFNESS: f32 = 4.0;

/// A: the sheet's own matrix, or the masses of the points in contact, which are all that move.
enum SheetSide<'a> {
    Implicit(Matrix<'a>),
    Symplectic { mass: Vec<[f32; LANES]>, inverse: Vec<[f32; LANES]> },
}

/// A and the matrices of the bodies.
struct Sides<'a> {
    sheet: SheetSide<'a>,
    masses: Vec<Matrix6<f64>>,
    /// Number of points.
    len: usize,
}

impl Sides<'_> {
    fn zeros(&self) -> Unknowns {
        Unknowns { points: Vectors::zeros(self.len), bodies: vec![Vector6::zeros(); self.masses.len()] }
    }

    fn multiply(&self, p: &Unknowns, out: &mut Unknowns) {
        match &self.sheet {
            SheetSide::Implicit(matrix) => {
                matrix.multiply(&p.points, &mut out.points);
            }
            SheetSide::Symplectic { mass, .. } => out.points.update(|at, axes| {
                for (axis, p) in axes.into_iter().zip(p.points.eight(at)) {
                    (0..LANES).for_each(|lane| axis[lane] = mass[at][lane] * p[lane]);
                }
            }),
        }
        let rows = out.bodies.iter_mut().zip(&p.bodies).zip(&self.masses);
        rows.for_each(|((out, p), mass)| *out = mass * p);
    }

    /// Residual of both equations at the relative displacements `y`, with the `product` of A and M.
    fn residual(&self, contacts: &[BodyContact], y: &[Vec3], product: &Unknowns) -> Unknowns {
        let mut out = self.zeros();
        for (contact, &y) in contacts.iter().zip(y) {
            out.push(contact, contact.force(y) - contact.push);
        }
        out.combine(1.0, product, -1.0);
        self.filter(&mut out.points);
        out
    }

    /// Diagonal blocks of A.
    fn blocks(&self) -> Vec<Blocks> {
        match &self.sheet {
            SheetSide::Implicit(matrix) => matrix.diagonal(),
            SheetSide::Symplectic { mass, .. } => {
                mass.iter().map(|&m| [m, m, m, [0.0; LANES], [0.0; LANES], [0.0; LANES]]).collect()
            }
        }
    }

    /// Projects to the motions that pins and exact joints allow.
    fn filter(&self, out: &mut Vectors) {
        match &self.sheet {
            SheetSide::Implicit(matrix) => matrix.filter(out),
            SheetSide::Symplectic { inverse, .. } => out.update(|at, axes| {
                for axis in axes {
                    (0..LANES).filter(|&lane| inverse[at][lane] == 0.0).for_each(|lane| axis[lane] = 0.0);
                }
            }),
        }
    }
}

/// Inverses of the diagonal blocks, with those of the contacts that act.
struct Preconditioner {
    points: Vec<Blocks>,
    bodies: Vec<Matrix6<f64>>,
}

impl Preconditioner {
    fn new(mut blocks: Vec<Blocks>, masses: &[Matrix6<f64>], contacts: &[BodyContact], y: &[Vec3]) -> Self {
        let mut bodies: Vec<Matrix6<f64>> = masses.to_vec();
        for (contact, &y) in contacts.iter().zip(y) {
            let BodyContact { normal: n, stiffness: [along, across], .. } = *contact;
            if contact.force(y) == Vec3::zeros() {
                continue;
            }
            let mut act = |direction: Vec3, k: f32| {
                implicit::add_along(&mut blocks, contact.slot, k, direction);
                let lever = wrench(contact, direction.cast());
                if let Some(body) = contact.body {
                    bodies[body] += lever * lever.transpose() * f64::from(k);
                }
            };
            act(n, along);
            if contact.limit > 0.0 {
                let axis = Vec3::ith(n.iamin(), 1.0);
                let side = n.cross(&axis).normalize();
                act(side, across);
                act(n.cross(&side), across);
            }
        }
        implicit::invert_all(&mut blocks);
        let invert = |matrix: Matrix6<f64>| matrix.try_inverse().unwrap_or_else(Matrix6::identity);
        Self { points: blocks, bodies: bodies.into_iter().map(invert).collect() }
    }

    /// Applies it to `r`, and returns the squared norm.
    fn norm(&self, system: &Sides<'_>, r: &Unknowns, z: &mut Unknowns) -> f64 {
        implicit::precondition(&self.points, &r.points, &mut z.points);
        system.filter(&mut z.points);
        let rows = z.bodies.iter_mut().zip(&r.bodies).zip(&self.bodies);
        rows.for_each(|((z, r), inverse)| *z = inverse * r);
        r.dot(z)
    }
}

impl Sheets {
    /// Solves once for the impulses of all contacts, and moves both sides. Returns whether another solve would change them.
    pub(in crate::sim) fn solve_body_contacts(
        &mut self,
        substep: &mut CoupledSubstep,
        contacts: &mut BodyContacts,
        bodies: &mut [RigidBody],
    ) -> bool {
        let dt = substep.dt;
        let present = |contact: &BodyContact| {
            let body = contact.body.map(|body| (&bodies[body], &contacts.free[body]));
            contact.relative(self.x.get(contact.point), body, dt)
        };
        let mut y: Vec<Vec3> = contacts.list.iter().map(present).collect();
        let acts = |(contact, y): (&BodyContact, &Vec3)| {
            contact.push != Vec3::zeros() || contact.normal.dot(y) < 0.0
        };
        if !contacts.list.iter().zip(&y).any(acts) {
            return false;
        }
        let change = self.minimum(substep, contacts, bodies, &mut y);
        let is_implicit = self.params.common.solver.integrator == Integrator::Implicit;
        let (mut largest, mut wrenches) = (0.0_f32, vec![Vector6::zeros(); bodies.len()]);
        for (contact, &y) in contacts.list.iter_mut().zip(&y) {
            let impulse_change = contact.accept(y);
            substep.given.add(contact.point, impulse_change);
            if let Some(body) = contact.body {
                wrenches[body] -= wrench(contact, impulse_change.cast());
            }
            largest = largest.max(contact.displacement(impulse_change));
        }
        if is_implicit {
            implicit::combine(&mut self.x, 1.0, &change.points, 1.0);
            match &mut contacts.solution {
                Some(solution) => solution.combine(1.0, &change, 1.0),
                none => *none = Some(change),
            }
        } else {
            self.apply_impulses(substep);
        }
        for (body, wrench) in bodies.iter_mut().zip(&wrenches) {
            body.apply(wrench.fixed_rows::<3>(0) / dt, wrench.fixed_rows::<3>(3) / dt);
            body.advance();
        }
        // Friction is first known after the first solve.
        let is_first = contacts.first_change.is_none();
        let first = *contacts.first_change.get_or_insert(largest);
        largest > ROUNDING && (is_first || largest > SOLVE_TOLERANCE * first)
    }

    /// The matrices of both sides, with the number of the unknowns of each contact's point.
    fn system<'a>(
        &'a self,
        [now, dt]: [f64; 2],
        before: &'a Vectors,
        contacts: &mut BodyContacts,
        bodies: &[RigidBody],
    ) -> Sides<'a> {
        let masses = bodies.iter().map(RigidBody::mass_matrix).collect();
        if self.params.common.solver.integrator == Integrator::Implicit {
            contacts.list.iter_mut().for_each(|contact| contact.slot = contact.point);
            let matrix = self.matrix(before, self.pin_blocks(now, dt), now, dt);
            return Sides { sheet: SheetSide::Implicit(matrix), masses, len: self.len() };
        }
        // Contacts ascend by point.
        let mut points: Vec<usize> = Vec::new();
        for contact in &mut contacts.list {
            if points.last() != Some(&contact.point) {
                points.push(contact.point);
            }
            contact.slot = points.len() - 1;
        }
        let eights = |of: &dyn Fn(usize) -> f32, filler: f32| {
            let eight = |eight: &[usize]| {
                let mut out = [filler; LANES];
                eight.iter().zip(&mut out).for_each(|(&point, out)| *out = of(point));
                out
            };
            points.chunks(LANES).map(eight).collect()
        };
        let mass = eights(&|point| self.mass(point), 1.0);
        let sheet = SheetSide::Symplectic { mass, inverse: eights(&|point| self.mobility(point), 0.0) };
        Sides { sheet, masses, len: points.len() }
    }

    /// The displacements of the minimum, with the relative displacements there in `y`.
    fn minimum(
        &self,
        substep: &mut CoupledSubstep,
        contacts: &mut BodyContacts,
        bodies: &[RigidBody],
        y: &mut [Vec3],
    ) -> Unknowns {
        let CoupledSubstep { now, dt, before, right_norm, unconverged, .. } = substep;
        let system = self.system([*now, *dt], before, contacts, bodies);
        let blocks = system.blocks();
        for contact in &mut contacts.list {
            let along = implicit::along(&blocks, contact.slot, contact.normal);
            let across = 0.5 * (implicit::trace(&blocks, contact.slot) - along);
            contact.stiffness = [STIFFNESS * along, STIFFNESS * across];
            // A point that is held exactly does not yield, and the body alone does.
            if let (Some(body), 0.0) = (contact.body, self.mobility(contact.point)) {
                contact.stiffness = [STIFFNESS * bodies[body].mass() as f32; 2];
            }
        }
        let list = &contacts.list;
        let preconditioner = Preconditioner::new(blocks, &system.masses, list, y);
        let [mut change, mut product_change, mut preconditioned, mut direction, mut product] =
            std::array::from_fn(|_| system.zeros());
        let rounding = list.iter().map(|contact| f64::from(contact.stiffness[0])).sum::<f64>()
            * f64::from(ROUNDING).powi(2);
        let mut steps = vec![Vec3::zeros(); list.len()];
        let mut last: Option<(Unknowns, f64)> = None;
        let mut residual = system.residual(list, y, &product_change);
        let norm = preconditioner.norm(&system, &residual, &mut preconditioned);
        *right_norm = right_norm.max(norm);
        if let Some(mut guess) = contacts.guess.take() {
            system.filter(&mut guess.points);
            system.multiply(&guess, &mut product);
            let guessed: Vec<Vec3> =
                list.iter().zip(&*y).map(|(contact, y)| y + guess.relative(contact)).collect();
            let left = system.residual(list, &guessed, &product);
            // Otherwise the contacts of the last substep are gone.
            if preconditioner.norm(&system, &left, &mut preconditioned) < norm {
                (change, residual) = (guess, left);
                std::mem::swap(&mut product_change, &mut product);
                y.copy_from_slice(&guessed);
            }
        }
        for iterations in 0.. {
            if iterations > 0 {
                residual = system.residual(list, y, &product_change);
            }
            let norm = preconditioner.norm(&system, &residual, &mut preconditioned);
            if norm <= rounding.max(TOLERANCE * TOLERANCE * *right_norm) {
                break;
            }
            if iterations == MAX_CG_ITERATIONS {
                *unconverged += 1;
                break;
            }
            // [nocedal06] Eq. 5.45
            let beta = last
                .as_ref()
                .map_or(0.0, |(old, before)| ((norm - old.dot(&preconditioned)) / before).max(0.0));
            direction.combine(beta, &preconditioned, 1.0);
            system.multiply(&direction, &mut product);
            list.iter().zip(&mut steps).for_each(|(contact, step)| *step = direction.relative(contact));
            let slope = [product_change.dot(&direction), product.dot(&direction)];
            let alpha = line_search(slope, |alpha| {
                let mut sum = [0.0; 2];
                for ((contact, &y), &w) in list.iter().zip(&*y).zip(&steps) {
                    let at = y + w * alpha as f32;
                    sum[0] -= f64::from((contact.force(at) - contact.push).dot(&w));
                    sum[1] += contact.curvature(at, w);
                }
                sum
            });
            change.combine(1.0, &direction, alpha);
            product_change.combine(1.0, &product, alpha);
            y.iter_mut().zip(&steps).for_each(|(y, w)| *y += w * alpha as f32);
            last = Some((std::mem::replace(&mut residual, system.zeros()), norm));
        }
        change
    }
}
