//! What leans on sheets: masses that touch faces, and the impulses that pass between.
//!
//! *Method*: a touch asks that its mass and the place q = Σ w x of its face part by a way v along n. With J the row w n of a touch, m its mass
//! and A the sheet's own matrix (`implicit.rs`; the masses alone for the symplectic rule, where touches are swept one after another) the constrained Euler step is
//! (A + Σ m JᵀJ) Δx = −Σ m v Jᵀ, and the impulse by Δt λ = m (v + J Δx). It is the step that both sides take together: nothing is
//! handed over late, so that neither a sheet much lighter than what leans on it nor a stiff one is unstable. A touch only pushes: where
//! v + J Δx is below zero there is none.
//! *Departs from the paper*: [gudukbay97] and [baraff98] have no such masses.
//!
//! Symbols: λ → impulse by Δt [kg·m]; Λ = Σ λ Jᵀ → `given`.
//! Limits: which touches may push is decided once a round, by the caller. Directions stand during the round. Under the implicit rule what
//! touches feels the sheet as it is linearised at the start of the substep.

use super::{Integrator, SheetRecord, Sheets, implicit, lanes::Vectors, springs::Blocks};
use crate::{
    math::{Vec3, wide::WIDTH},
    par::{self, Groups},
    sim::{Diverged, record::Clock},
};

/// The part of the substep's largest right side at which the conjugate gradients of a round end, and how many they are at most. What is left
/// the next round takes, and the answer that ends the substep is exact for what was given.
const TOLERANCE: f64 = 1e-3;
const MOST: u32 = 60;

/// Steps in which the least along a line is looked for, and the part of the slope at its start that is none. Along a line touches
/// let go or join, and between the slope is linear.
const STEPS: u32 = 20;
const FLAT: f64 = 1e-3;

/// The part of the longest way asked for at which sweeps of a round end, and how many they are at most.
const SWEPT: f32 = 1e-3;
const SWEEPS: u32 = 30;

/// The same for the sheet's final answer under the implicit rule.
const FINAL: (f64, u32) = (1e-6, 200);

/// A mass that touches a face.
#[derive(Clone, Copy, Debug)]
pub(in crate::sim) struct Touch {
    /// The corners, among the points of all sheets, and their weights, which sum to 1.
    pub(in crate::sim) points: [u32; 3],
    pub(in crate::sim) weights: [f32; 3],
    /// Unit vector from the face to the mass.
    pub(in crate::sim) normal: Vec3,
    /// [kg].
    pub(in crate::sim) mass: f32,
}

impl Touch {
    /// The place on the face.
    pub(in crate::sim) fn place(&self, x: impl Fn(usize) -> Vec3) -> Vec3 {
        self.points.iter().zip(self.weights).map(|(&i, w)| x(i as usize) * w).sum()
    }
}

/// Touches, and which of them are at each point.
#[derive(Debug, Default)]
pub(in crate::sim) struct Touches {
    pub(in crate::sim) list: Vec<Touch>,
    at: Groups,
}

impl Touches {
    /// On sheets with `points` points.
    pub(in crate::sim) fn new(list: Vec<Touch>, points: usize) -> Self {
        // What fills up the last eight points has none.
        let at = Groups::new(list.len(), points.next_multiple_of(WIDTH), |i| list[i].points);
        Self { list, at }
    }

    /// Adds Σ s w n over touches to the points.
    fn spread(&self, s: &[f32], out: &mut Vectors) {
        out.update(|at, [x, y, z]| {
            for lane in 0..WIDTH {
                for &entry in self.at.of(at * WIDTH + lane) {
                    let (touch, corner) = (entry as usize / 3, entry as usize % 3);
                    let d = self.list[touch].normal * (self.list[touch].weights[corner] * s[touch]);
                    (x[lane], y[lane], z[lane]) = (x[lane] + d.x, y[lane] + d.y, z[lane] + d.z);
                }
            }
        });
    }

    /// Σ w n·p of every touch.
    fn gather(&self, p: &Vectors, out: &mut [f32]) {
        par::fill(out, |i| self.list[i].normal.dot(&self.list[i].place(|point| p.get(point))));
    }

    /// Gives λ to the sheets.
    fn give(&self, lambda: &[f32], leaning: &mut Leaning) {
        let pushed: Vec<f32> = lambda.iter().map(|l| -l).collect();
        self.spread(&pushed, &mut leaning.given);
    }

    /// Adds Σ s w² n nᵀ to the blocks of points.
    fn add_blocks(&self, s: &[f32], blocks: &mut [Blocks]) {
        par::update(blocks, |at, block| {
            for lane in 0..WIDTH {
                for &entry in self.at.of(at * WIDTH + lane) {
                    let (touch, corner) = (entry as usize / 3, entry as usize % 3);
                    let w = self.list[touch].weights[corner];
                    implicit::add_to_block(block, lane, s[touch] * w * w, self.list[touch].normal);
                }
            }
        });
    }
}

/// What touches did to sheets in a substep.
#[derive(Debug)]
pub(in crate::sim) struct Leaning {
    now: f64,
    dt: f64,
    /// Positions at the substep's start [m], …
    before: Vectors,
    /// … and where it leads without touches.
    alone: Vectors,
    /// Λ [kg·m].
    given: Vectors,
    /// The size of the largest right side of a round.
    size: f64,
    /// Rounds that ended by the number of their iterations or sweeps.
    pub(in crate::sim) unfinished: u64,
    /// Δx with which the first round begins.
    guess: Option<Vectors>,
    /// What touches changed of velocities, by Δt [m/s²]; for the next substep's guess.
    answer: Option<Vectors>,
}

impl Leaning {
    /// Takes what sheets are now for what they are alone: what follows is given on top.
    pub(in crate::sim) fn go_on(&mut self, sheets: &Sheets) {
        self.alone = sheets.x.clone();
        self.given.clear();
        self.guess = None;
    }

    /// Begins where the substep before ended, if what leans pushes as it did.
    pub(in crate::sim) fn go_on_from(&mut self, last: &mut Self) {
        self.guess = last.answer.take();
        if let Some(guess) = &mut self.guess {
            let by = (self.dt * self.dt) as f32;
            guess.update(|_, axes| axes.into_iter().flatten().for_each(|value| *value *= by));
        }
    }
}

impl Sheets {
    /// Advances by one substep in which something may lean on the sheets: first as if nothing did.
    ///
    /// # Errors
    /// If a point leaves what can be computed.
    pub(in crate::sim) fn lean(
        &mut self,
        now: f64,
        dt: f64,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) -> Result<Leaning, Diverged> {
        let before = self.x.clone();
        record.substeps += 1;
        self.substep(now, dt, clock, record)?;
        let given = Vectors::zeros(self.len());
        let alone = self.x.clone();
        Ok(Leaning { now, dt, before, alone, given, size: 0.0, unfinished: 0, guess: None, answer: None })
    }

    /// One round: lets every touch that asks for a way above zero push both sides. Returns λ of all [kg·m]; the sheet has moved, the
    /// masses are the caller's.
    pub(in crate::sim) fn press(
        &mut self,
        leaning: &mut Leaning,
        touches: &Touches,
        way: &[f32],
    ) -> Vec<f32> {
        let asked = par::max(way.len(), |i| way[i]).map_or(0.0, |(_, most)| most);
        if asked <= 0.0 {
            return vec![0.0; way.len()];
        }
        let mass: Vec<f32> =
            touches.list.iter().zip(way).map(|(touch, &v)| if v > 0.0 { touch.mass } else { 0.0 }).collect();
        match self.params.common.solver.integrator {
            Integrator::Symplectic => {
                let lambda = self.swept(leaning, touches, &mass, way);
                touches.give(&lambda, leaning);
                // Exactly what was given, so that momentum is kept to rounding.
                self.moved(leaning);
                lambda
            }
            Integrator::Implicit => {
                let (lambda, change) = self.solved(leaning, touches, &mass, way);
                touches.give(&lambda, leaning);
                implicit::combine(&mut self.x, 1.0, &change, 1.0);
                lambda
            }
        }
    }

    /// λ and Δx under the implicit rule: where ½ Δxᵀ A Δx + ½ Σ m max(0, v + J Δx)² is least, so that touches that would pull are none.
    /// Conjugate gradients of Polak and Ribière ([nocedal06]), each step as long as the function falls along it. Solved as if all touches held, half of
    /// them would pull where many lean on few points, and the sheet would be thrown by what the others push too much.
    fn solved(
        &self,
        leaning: &mut Leaning,
        touches: &Touches,
        mass: &[f32],
        way: &[f32],
    ) -> (Vec<f32>, Vectors) {
        let guess = leaning.guess.take();
        let Leaning { now, dt, before, size, unfinished, .. } = leaning;
        let own = self.matrix(before, self.held_blocks(*now, *dt), *now, *dt);
        let mut blocks = own.diagonal();
        touches.add_blocks(mass, &mut blocks);
        implicit::invert_all(&mut blocks);

        let [mut change, mut pulled, mut rest, mut better, mut direction, mut product] =
            std::array::from_fn(|_| Vectors::zeros(self.len()));
        let (mut lacks, mut push, mut turn) = (way.to_vec(), vec![0.0; way.len()], vec![0.0; way.len()]);
        // r = −A Δx − Σ m max(0, v + J Δx) Jᵀ, its better and their product.
        let residual =
            |lacks: &[f32], pulled: &Vectors, push: &mut [f32], rest: &mut Vectors, better: &mut Vectors| {
                par::fill(push, |i| -mass[i] * lacks[i].max(0.0));
                rest.clear();
                touches.spread(push, rest);
                implicit::combine(rest, 1.0, pulled, -1.0);
                own.filter(rest);
                implicit::precondition(&blocks, rest, better);
                own.filter(better);
                rest.dot(better)
            };
        let at_rest = residual(&lacks, &pulled, &mut push, &mut rest, &mut better);
        *size = size.max(at_rest);
        if let Some(mut guess) = guess {
            own.filter(&mut guess);
            own.times(&guess, &mut pulled);
            touches.gather(&guess, &mut turn);
            lacks.iter_mut().zip(&turn).for_each(|(u, w)| *u += w);
            if residual(&lacks, &pulled, &mut push, &mut rest, &mut better) < at_rest {
                change = guess;
            } else {
                // What leant then is gone.
                lacks.copy_from_slice(way);
                pulled.clear();
            }
        }
        let mut last: Option<(Vectors, f64)> = None;
        for iterations in 0.. {
            let left = residual(&lacks, &pulled, &mut push, &mut rest, &mut better);
            // [nocedal06] Eq. 5.45
            let beta =
                last.as_ref().map_or(0.0, |(old, before)| ((left - old.dot(&better)) / before).max(0.0));
            if left <= TOLERANCE * TOLERANCE * *size {
                break;
            }
            if iterations == MOST {
                *unfinished += 1;
                break;
            }
            implicit::combine(&mut direction, beta as f32, &better, 1.0);
            own.times(&direction, &mut product);
            touches.gather(&direction, &mut turn);
            let line = [pulled.dot(&direction), product.dot(&direction)];
            let alpha = least(line, |alpha| {
                let terms = mass.iter().zip(&lacks).zip(&turn).map(|((&m, &u), &w)| {
                    let [m, u, w] = [m, u, w].map(f64::from);
                    let at = u + alpha * w;
                    if at > 0.0 { [m * at * w, m * w * w] } else { [0.0; 2] }
                });
                terms.fold([0.0; 2], |sum, term| [sum[0] + term[0], sum[1] + term[1]])
            }) as f32;
            implicit::combine(&mut change, 1.0, &direction, alpha);
            implicit::combine(&mut pulled, 1.0, &product, alpha);
            par::update(&mut lacks, |i, u| *u += alpha * turn[i]);
            last = Some((rest.clone(), left));
        }
        let lambda = mass.iter().zip(&lacks).map(|(m, u)| m * u.max(0.0)).collect();
        (lambda, change)
    }

    /// λ where A is of the masses alone: touch after touch takes what it lacks, until none lacks much.
    fn swept(&self, leaning: &mut Leaning, touches: &Touches, mass: &[f32], way: &[f32]) -> Vec<f32> {
        let inverse = self.inverse.as_flattened();
        let asking: Vec<usize> = (0..way.len()).filter(|&i| way[i] > 0.0).collect();
        let gives = |touch: &Touch| -> f32 {
            touch.points.iter().zip(touch.weights).map(|(&i, w)| w * w * inverse[i as usize]).sum()
        };
        let softness: Vec<f32> = asking.iter().map(|&i| 1.0 / mass[i] + gives(&touches.list[i])).collect();
        let enough = asking.iter().map(|&i| way[i]).fold(0.0, f32::max) * SWEPT;
        let mut change = vec![Vec3::zeros(); self.len()];
        let mut lambda = vec![0.0_f32; way.len()];
        for sweep in 1.. {
            let mut most = 0.0_f32;
            for (&i, softness) in asking.iter().zip(&softness) {
                let touch = &touches.list[i];
                let lacks =
                    way[i] + touch.normal.dot(&touch.place(|point| change[point])) - lambda[i] / mass[i];
                let more = (lacks / softness).max(-lambda[i]);
                most = most.max((more * softness).abs());
                lambda[i] += more;
                for (&point, w) in touch.points.iter().zip(touch.weights) {
                    change[point as usize] -= touch.normal * (more * w * inverse[point as usize]);
                }
            }
            if most <= enough {
                break;
            }
            if sweep == SWEEPS {
                leaning.unfinished += 1;
                break;
            }
        }
        lambda
    }

    /// x ← what the substep leads to alone + Λ/m.
    fn moved(&mut self, leaning: &Leaning) {
        let Self { x, inverse, .. } = self;
        x.update(|at, axes| {
            let (alone, given) = (leaning.alone.eight(at), leaning.given.eight(at));
            for (axis, out) in axes.into_iter().enumerate() {
                for lane in 0..WIDTH {
                    // What was not touched keeps its digits.
                    if given[axis][lane] != 0.0 {
                        out[lane] = alone[axis][lane] + given[axis][lane] * inverse[at][lane];
                    }
                }
            }
        });
    }

    /// Makes velocities of what touches gave, and puts points back that they pressed into solids or through other sheets.
    pub(in crate::sim) fn yield_to(
        &mut self,
        leaning: &mut Leaning,
        clock: &mut Clock,
        record: &mut SheetRecord,
    ) {
        let dt = leaning.dt as f32;
        let change = match self.params.common.solver.integrator {
            Integrator::Symplectic => {
                let mut change = Vectors::zeros(self.len());
                let inverse = &self.inverse;
                change.update(|at, axes| {
                    let given = leaning.given.eight(at);
                    for (axis, out) in axes.into_iter().enumerate() {
                        for lane in 0..WIDTH {
                            out[lane] = given[axis][lane] * inverse[at][lane] / dt;
                        }
                    }
                });
                change
            }
            Integrator::Implicit => {
                let Leaning { now, dt: long, before, .. } = leaning;
                let matrix = self.matrix(before, self.held_blocks(*now, *long), *now, *long);
                let (mut asked, mut change) = (leaning.given.clone(), self.x.clone());
                implicit::combine(&mut change, 1.0 / dt, &leaning.alone, -1.0 / dt);
                implicit::combine(&mut asked, 1.0 / dt, &leaning.given, 0.0);
                let solved = matrix.solve(&asked, &mut change, FINAL.0, FINAL.1);
                record.iterations += solved.iterations;
                record.residual = record.residual.max(solved.residual);
                record.unconverged +=
                    u32::from(solved.residual > f64::from(self.params.common.solver.tolerance));
                self.x = leaning.alone.clone();
                implicit::combine(&mut self.x, 1.0, &change, dt);
                leaning.answer.get_or_insert_with(|| {
                    let mut answer = change.clone();
                    implicit::combine(&mut answer, 1.0 / dt, &change, 0.0);
                    answer
                });
                change
            }
        };
        implicit::combine(&mut self.v, 1.0, &change, 1.0);
        // The liquid pushed after sheets had met: unless they meet again, it pushes one through the other.
        self.keep_out(leaning.now, leaning.dt, clock, record);
    }
}

/// Where the slope a + α b + s(α), which rises, is zero: `touching` gives s and its own slope. By Newton's rule, halved where it leaves what is
/// known to hold the zero.
fn least([a, b]: [f64; 2], touching: impl Fn(f64) -> [f64; 2]) -> f64 {
    let (mut alpha, mut low, mut high) = (0.0, 0.0, f64::INFINITY);
    let mut first = None;
    for _ in 0..STEPS {
        let [s, rise] = touching(alpha);
        let slope = a + alpha * b + s;
        if slope.abs() <= FLAT * *first.get_or_insert(slope.abs()) && alpha > 0.0 || slope == 0.0 {
            break;
        }
        if slope < 0.0 {
            low = alpha
        } else {
            high = alpha
        }
        let next = alpha - slope / (b + rise);
        alpha = if next > low && next < high { next } else { 0.5 * (low + high) };
    }
    alpha
}
