//! Masses in contact with faces of sheets, and the impulses between both.
//!
//! *Method*: a contact requires that its mass and the place q = Σ w x of its face separate by a distance v
//! along n. Let J be the row w n of a contact, m its mass and A the sheet's own matrix (`implicit.rs`; for
//! the symplectic integrator only the masses, and contacts are swept one after another). The constrained
//! Euler step is (A + Σ m JᵀJ) Δx = −Σ m v Jᵀ, and the impulse times Δt is λ = m (v + J Δx). Both sides take
//! this step together. No force acts one substep late, so neither a sheet much lighter than the masses on it
//! nor a stiff one is unstable. A contact only pushes: where v + J Δx is negative there is no impulse.
//! *Departs from the paper*: [gudukbay97] and [baraff98] have no such masses.
//!
//! Symbols: λ → impulse times Δt [kg·m]; Λ = Σ λ Jᵀ → `given`.
//! Limits: the caller decides once an iteration which contacts may push. Normals are constant during the
//! iteration. The implicit integrator sees the sheet as it is linearised at the start of the substep.

use super::{
    Integrator, SheetRecord, Sheets, implicit,
    overshoot::{self, EnergyBalance},
    springs::Blocks,
    vectors::Vectors,
};
use crate::{
    math::Vec3,
    par::{self, Groups},
    sim::{Diverged, clock::Clock},
    simd::LANES,
};

/// Tolerance of the conjugate gradients of one solve, relative to the largest right side of the substep, and
/// their iterations at most. The next solve takes what is left, and the final solve of the substep is exact
/// for the impulses given.
const TOLERANCE: f64 = 1e-3;
const MAX_CG_ITERATIONS: u32 = 60;

/// Iterations of the line search at most, and the slope at which it ends, relative to the slope at its start.
/// Along a line contacts open or close, and between these events the slope is linear.
const MAX_LINE_SEARCH_ITERATIONS: u32 = 20;
const LINE_SEARCH_TOLERANCE: f64 = 1e-3;

/// Tolerance of the Gauss–Seidel sweeps of one solve, relative to the largest missing distance, and the
/// sweeps at most.
const SWEEP_TOLERANCE: f32 = 1e-3;
const MAX_SWEEPS: u32 = 30;

/// Tolerance and iterations at most of the sheet's final solve with the implicit integrator.
const FINAL_SOLVE: (f64, u32) = (1e-6, 200);

/// A mass in contact with a face.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim) struct FaceContact {
    /// The corners, among the points of all sheets, and the weights of the contact point, which sum to 1.
    pub(in crate::sim) points: [u32; 3],
    pub(in crate::sim) weights: [f32; 3],
    /// Unit vector from the face to the mass.
    pub(in crate::sim) normal: Vec3,
    /// [kg].
    pub(in crate::sim) mass: f32,
}

impl FaceContact {
    /// The contact point on the face.
    pub(in crate::sim) fn contact_point(&self, x: impl Fn(usize) -> Vec3) -> Vec3 {
        self.points.iter().zip(self.weights).map(|(&i, w)| x(i as usize) * w).sum()
    }
}

/// Contacts, and which of them act on each point.
#[derive(Debug, Default)]
pub(in crate::sim) struct FaceContacts {
    pub(in crate::sim) list: Vec<FaceContact>,
    at: Groups,
}

impl FaceContacts {
    /// Contacts on sheets with `points` points.
    pub(in crate::sim) fn new(list: Vec<FaceContact>, points: usize) -> Self {
        // The padding of the last eight points has none.
        let at = Groups::new(list.len(), points.next_multiple_of(LANES), |i| list[i].points);
        Self { list, at }
    }

    /// Adds Σ s w n over contacts to the points: Jᵀ s.
    fn scatter(&self, s: &[f32], out: &mut Vectors) {
        out.update(|at, [x, y, z]| {
            for lane in 0..LANES {
                for &entry in self.at.of(at * LANES + lane) {
                    let (contact, corner) = (entry as usize / 3, entry as usize % 3);
                    let d = self.list[contact].normal * (self.list[contact].weights[corner] * s[contact]);
                    (x[lane], y[lane], z[lane]) = (x[lane] + d.x, y[lane] + d.y, z[lane] + d.z);
                }
            }
        });
    }

    /// Σ w n·p of every contact: J p.
    fn gather(&self, p: &Vectors, out: &mut [f32]) {
        par::fill(out, |i| self.list[i].normal.dot(&self.list[i].contact_point(|point| p.get(point))));
    }

    /// Applies λ to the sheets.
    fn apply(&self, lambda: &[f32], substep: &mut CoupledSubstep) {
        let pushed: Vec<f32> = lambda.iter().map(|l| -l).collect();
        self.scatter(&pushed, &mut substep.given);
    }

    /// Adds the diagonal blocks Σ s w² n nᵀ of the points.
    fn add_blocks(&self, s: &[f32], blocks: &mut [Blocks]) {
        par::update(blocks, |at, block| {
            for lane in 0..LANES {
                for &entry in self.at.of(at * LANES + lane) {
                    let (contact, corner) = (entry as usize / 3, entry as usize % 3);
                    let w = self.list[contact].weights[corner];
                    implicit::add_to_block(block, lane, s[contact] * w * w, self.list[contact].normal);
                }
            }
        });
    }
}

/// A substep of sheets that masses may push.
#[derive(Debug)]
pub(in crate::sim) struct CoupledSubstep {
    pub(super) now: f64,
    pub(super) dt: f64,
    /// Positions at the start of the substep [m].
    pub(super) before: Vectors,
    /// Velocities at the start of the substep [m/s].
    pub(super) velocities: Vectors,
    /// The balance of the substep without contacts.
    pub(super) balance: EnergyBalance,
    /// Positions at its end without contacts [m].
    without_contacts: Vectors,
    /// Λ [kg·m].
    pub(super) given: Vectors,
    /// The largest squared norm of a right side in the substep.
    pub(super) right_norm: f64,
    /// Solves that reached their limit of iterations or sweeps.
    pub(in crate::sim) unconverged: u64,
    /// First guess Δx of the first solve.
    guess: Option<Vectors>,
    /// Change of velocities by contacts over Δt [m/s²], the first guess of the next substep.
    solution: Option<Vectors>,
}

impl CoupledSubstep {
    /// Length of the substep [s].
    pub(in crate::sim) fn dt(&self) -> f64 {
        self.dt
    }

    /// Time of its end [s].
    pub(in crate::sim) fn end(&self) -> f64 {
        self.now + self.dt
    }

    /// Takes the present positions as those without contacts: later impulses come on top.
    pub(in crate::sim) fn restart_from(&mut self, sheets: &Sheets) {
        self.without_contacts = sheets.x.clone();
        self.given.clear();
        self.guess = None;
    }

    /// Starts from the solution of the last substep, as contacts often push as they did.
    pub(in crate::sim) fn warm_start(&mut self, last: &mut Self) {
        self.guess = last.solution.take();
        if let Some(guess) = &mut self.guess {
            let by = (self.dt * self.dt) as f32;
            guess.update(|_, axes| axes.into_iter().flatten().for_each(|value| *value *= by));
        }
    }
}

impl Sheets {
    /// Advances by one substep without the contacts of masses, which are added afterwards.
    ///
    /// # Errors
    /// If a point diverges.
    pub(in crate::sim) fn begin_coupled_substep(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<CoupledSubstep, Diverged> {
        let [before, velocities] = [self.x.clone(), self.v.clone()];
        record.substeps += 1;
        let balance = self.substep(now, dt, clock, record)?;
        let given = Vectors::zeros(self.len());
        let without_contacts = self.x.clone();
        Ok(CoupledSubstep {
            now,
            dt,
            before,
            velocities,
            balance,
            without_contacts,
            given,
            right_norm: 0.0,
            unconverged: 0,
            guess: None,
            solution: None,
        })
    }

    /// Solves once for the impulses of all contacts with a missing distance above zero. Returns λ of all
    /// contacts [kg·m]. The sheet has moved; the caller moves the masses.
    pub(in crate::sim) fn solve_face_contacts(
        &mut self,
        substep: &mut CoupledSubstep,
        contacts: &FaceContacts,
        missing: &[f32],
    ) -> Vec<f32> {
        let largest = par::max(missing.len(), |i| missing[i]).map_or(0.0, |(_, largest)| largest);
        if largest <= 0.0 {
            return vec![0.0; missing.len()];
        }
        let mass: Vec<f32> = contacts
            .list
            .iter()
            .zip(missing)
            .map(|(contact, &v)| if v > 0.0 { contact.mass } else { 0.0 })
            .collect();
        match self.params.common.solver.integrator {
            Integrator::Symplectic => {
                let lambda = self.solve_symplectic(substep, contacts, &mass, missing);
                contacts.apply(&lambda, substep);
                // From Λ itself, so that momentum is conserved to rounding.
                self.apply_impulses(substep);
                lambda
            }
            Integrator::Implicit => {
                let (lambda, change) = self.solve_implicit(substep, contacts, &mass, missing);
                contacts.apply(&lambda, substep);
                implicit::combine(&mut self.x, 1.0, &change, 1.0);
                lambda
            }
        }
    }

    /// λ and Δx with the implicit integrator: the minimum of ½ Δxᵀ A Δx + ½ Σ m max(0, v + J Δx)², so that
    /// contacts never pull. Nonlinear conjugate gradients of Polak and Ribière ([nocedal06]) with an exact
    /// line search. If all contacts were taken as closed, half of them would pull where many masses rest on
    /// few points, and the others would push the sheet away too hard.
    fn solve_implicit(
        &self,
        substep: &mut CoupledSubstep,
        contacts: &FaceContacts,
        mass: &[f32],
        missing: &[f32],
    ) -> (Vec<f32>, Vectors) {
        let guess = substep.guess.take();
        let CoupledSubstep { now, dt, before, right_norm, unconverged, .. } = substep;
        let matrix = self.matrix(before, self.pin_blocks(*now, *dt), *now, *dt);
        let mut blocks = matrix.diagonal();
        contacts.add_blocks(mass, &mut blocks);
        implicit::invert_all(&mut blocks);

        let [mut change, mut product_change, mut residual, mut preconditioned, mut direction, mut product] =
            std::array::from_fn(|_| Vectors::zeros(self.len()));
        let (mut gap, mut push, mut contact_change) =
            (missing.to_vec(), vec![0.0; missing.len()], vec![0.0; missing.len()]);
        // r = −A Δx − Σ m max(0, v + J Δx) Jᵀ, the preconditioned residual, and their product.
        let update_residual = |gap: &[f32],
                               product_change: &Vectors,
                               push: &mut [f32],
                               residual: &mut Vectors,
                               preconditioned: &mut Vectors| {
            par::fill(push, |i| -mass[i] * gap[i].max(0.0));
            residual.clear();
            contacts.scatter(push, residual);
            implicit::combine(residual, 1.0, product_change, -1.0);
            matrix.filter(residual);
            implicit::precondition(&blocks, residual, preconditioned);
            matrix.filter(preconditioned);
            residual.dot(preconditioned)
        };
        let initial = update_residual(&gap, &product_change, &mut push, &mut residual, &mut preconditioned);
        *right_norm = right_norm.max(initial);
        if let Some(mut guess) = guess {
            matrix.filter(&mut guess);
            matrix.multiply(&guess, &mut product_change);
            contacts.gather(&guess, &mut contact_change);
            gap.iter_mut().zip(&contact_change).for_each(|(u, w)| *u += w);
            if update_residual(&gap, &product_change, &mut push, &mut residual, &mut preconditioned) < initial
            {
                change = guess;
            } else {
                // The contacts of the last substep are gone.
                gap.copy_from_slice(missing);
                product_change.clear();
            }
        }
        let mut last: Option<(Vectors, f64)> = None;
        for iterations in 0.. {
            let norm = update_residual(&gap, &product_change, &mut push, &mut residual, &mut preconditioned);
            // [nocedal06] Eq. 5.45
            let beta = last
                .as_ref()
                .map_or(0.0, |(old, before)| ((norm - old.dot(&preconditioned)) / before).max(0.0));
            if norm <= TOLERANCE * TOLERANCE * *right_norm {
                break;
            }
            if iterations == MAX_CG_ITERATIONS {
                *unconverged += 1;
                break;
            }
            implicit::combine(&mut direction, beta as f32, &preconditioned, 1.0);
            matrix.multiply(&direction, &mut product);
            contacts.gather(&direction, &mut contact_change);
            let slope = [product_change.dot(&direction), product.dot(&direction)];
            let alpha = line_search(slope, |alpha| {
                let terms = mass.iter().zip(&gap).zip(&contact_change).map(|((&m, &u), &w)| {
                    let [m, u, w] = [m, u, w].map(f64::from);
                    let at = u + alpha * w;
                    if at > 0.0 { [m * at * w, m * w * w] } else { [0.0; 2] }
                });
                terms.fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]])
            }) as f32;
            implicit::combine(&mut change, 1.0, &direction, alpha);
            implicit::combine(&mut product_change, 1.0, &product, alpha);
            par::update(&mut gap, |i, u| *u += alpha * contact_change[i]);
            last = Some((residual.clone(), norm));
        }
        let lambda = mass.iter().zip(&gap).map(|(m, u)| m * u.max(0.0)).collect();
        (lambda, change)
    }

    /// λ with the masses alone for A: projected Gauss–Seidel over the contacts.
    fn solve_symplectic(
        &self,
        substep: &mut CoupledSubstep,
        contacts: &FaceContacts,
        mass: &[f32],
        missing: &[f32],
    ) -> Vec<f32> {
        let inverse = self.inverse.as_flattened();
        let pushing: Vec<usize> = (0..missing.len()).filter(|&i| missing[i] > 0.0).collect();
        let mobility = |contact: &FaceContact| -> f32 {
            contact.points.iter().zip(contact.weights).map(|(&i, w)| w * w * inverse[i as usize]).sum()
        };
        let compliance: Vec<f32> =
            pushing.iter().map(|&i| 1.0 / mass[i] + mobility(&contacts.list[i])).collect();
        let tolerance = pushing.iter().map(|&i| missing[i]).fold(0.0, f32::max) * SWEEP_TOLERANCE;
        let mut change = vec![Vec3::zeros(); self.len()];
        let mut lambda = vec![0.0_f32; missing.len()];
        for sweep in 1.. {
            let mut largest = 0.0_f32;
            for (&i, compliance) in pushing.iter().zip(&compliance) {
                let contact = &contacts.list[i];
                let gap = missing[i] + contact.normal.dot(&contact.contact_point(|point| change[point]))
                    - lambda[i] / mass[i];
                let increment = (gap / compliance).max(-lambda[i]);
                largest = largest.max((increment * compliance).abs());
                lambda[i] += increment;
                for (&point, w) in contact.points.iter().zip(contact.weights) {
                    change[point as usize] -= contact.normal * (increment * w * inverse[point as usize]);
                }
            }
            if largest <= tolerance {
                break;
            }
            if sweep == MAX_SWEEPS {
                substep.unconverged += 1;
                break;
            }
        }
        lambda
    }

    /// x ← positions without contacts + Λ/m.
    pub(super) fn apply_impulses(&mut self, substep: &CoupledSubstep) {
        let Self { x, inverse, .. } = self;
        x.update(|at, axes| {
            let (without_contacts, given) = (substep.without_contacts.eight(at), substep.given.eight(at));
            for (axis, out) in axes.into_iter().enumerate() {
                for lane in 0..LANES {
                    // Points without contact keep their bits.
                    if given[axis][lane] != 0.0 {
                        out[lane] = without_contacts[axis][lane] + given[axis][lane] * inverse[at][lane];
                    }
                }
            }
        });
    }

    /// Counts the energy that springs gained in a substep that ends here. `pushing` are the energies of what pushed the sheets: of its
    /// motion, and ½ ΔV·MΔV, which the substep dissipates \[J\]; zero of liquid, whose energy is bounded elsewhere. `None`: nothing did.
    pub(in crate::sim) fn account_energy(
        &self,
        substep: &CoupledSubstep,
        pushing: Option<[f64; 2]>,
        record: &mut SheetRecord,
    ) {
        let mut balance = substep.balance;
        if let (Some([motion, dissipated]), Integrator::Implicit) =
            (pushing, self.params.common.solver.integrator)
        {
            // From displacements: the pushes of the substep are in them.
            let dt = substep.dt as f32;
            let mut after = self.x.clone();
            implicit::combine(&mut after, 1.0 / dt, &substep.before, -1.0 / dt);
            balance = EnergyBalance::new(&overshoot::Substep {
                springs: &self.springs,
                x: &substep.before,
                mass: &self.mass,
                before: &substep.velocities,
                after: &after,
                dt,
            });
            balance.gain -= dissipated;
            balance.total += motion;
        }
        balance.count(record);
    }

    /// Turns the impulses into velocities, and moves points out of solids and other sheets into which
    /// contacts pushed them.
    pub(in crate::sim) fn end_coupled_substep(
        &mut self,
        substep: &mut CoupledSubstep,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) {
        let dt = substep.dt as f32;
        let change = match self.params.common.solver.integrator {
            Integrator::Symplectic => {
                let mut change = Vectors::zeros(self.len());
                let inverse = &self.inverse;
                change.update(|at, axes| {
                    let given = substep.given.eight(at);
                    for (axis, out) in axes.into_iter().enumerate() {
                        for lane in 0..LANES {
                            out[lane] = given[axis][lane] * inverse[at][lane] / dt;
                        }
                    }
                });
                change
            }
            Integrator::Implicit => {
                let CoupledSubstep { now, dt: dt_double, before, .. } = substep;
                let matrix = self.matrix(before, self.pin_blocks(*now, *dt_double), *now, *dt_double);
                let (mut right, mut change) = (substep.given.clone(), self.x.clone());
                implicit::combine(&mut change, 1.0 / dt, &substep.without_contacts, -1.0 / dt);
                implicit::combine(&mut right, 1.0 / dt, &substep.given, 0.0);
                let report = matrix.solve(&right, &mut change, FINAL_SOLVE.0, FINAL_SOLVE.1);
                record.iterations += report.iterations;
                record.residual = record.residual.max(report.residual);
                record.unconverged +=
                    u32::from(report.residual > f64::from(self.params.common.solver.tolerance));
                self.x = substep.without_contacts.clone();
                implicit::combine(&mut self.x, 1.0, &change, dt);
                substep.solution.get_or_insert_with(|| {
                    let mut solution = change.clone();
                    implicit::combine(&mut solution, 1.0 / dt, &change, 0.0);
                    solution
                });
                change
            }
        };
        implicit::combine(&mut self.v, 1.0, &change, 1.0);
        // The liquid pushed after contacts were resolved: without resolving it again, one sheet would pass
        // through the other.
        self.resolve_collisions(substep.now, substep.dt, clock, record);
        if self.forces.is_some() {
            clock.time("sheet_account", || self.account_forces(&substep.without_contacts, record));
        }
    }
}

/// Root of the increasing slope a + α b + s(α); `contact_slope` gives s and its derivative. Newton's method
/// with bisection where it leaves the bracket of the root.
pub(super) fn line_search([a, b]: [f64; 2], contact_slope: impl Fn(f64) -> [f64; 2]) -> f64 {
    let (mut alpha, mut low, mut high) = (0.0, 0.0, f64::INFINITY);
    let mut first = None;
    for _ in 0..MAX_LINE_SEARCH_ITERATIONS {
        let [s, derivative] = contact_slope(alpha);
        let slope = a + alpha * b + s;
        if slope.abs() <= LINE_SEARCH_TOLERANCE * *first.get_or_insert(slope.abs()) && alpha > 0.0
            || slope == 0.0
        {
            break;
        }
        if slope < 0.0 {
            low = alpha
        } else {
            high = alpha
        }
        let next = alpha - slope / (b + derivative);
        alpha = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    alpha
}
