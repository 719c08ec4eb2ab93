//! Semi-implicit (symplectic) Euler: v ← (v + Δt a)/(1 + Δt c), x ← x + Δt v.
//!
//! *Method*: [gudukbay97] Eq. 4. Velocity-proportional damping is taken at the new velocity, so that it never
//! reverses a motion. [hairer06] chapter VI shows why energy does not drift without damping.
//!
//! Forces, velocities and positions of eight points are computed in one pass. Points read the old positions
//! of their neighbours, and new positions are written elsewhere. So no data of a million points passes
//! through memory twice.
//!
//! Symbols: c → `drag` [1/s], 1/m → `inverse` [1/kg]; a point of zero mobility (1/m = 0) does not move. There
//! are many substeps, and at constant speed the rounding errors of a position have the same sign. The
//! rounding error is therefore kept for the next substep (compensated summation).
//!
//! Limits: first order in time; stable up to the time step of `stable_step.rs`.

use super::{
    DIVERGENCE_LIMIT,
    springs::Gather,
    vectors::{Eight, Vectors, in_chunks},
};
use crate::{
    math::Vec3,
    simd::{self, F32x8, LANES, Lanes, Pass},
};

/// What advances points apart from forces.
pub(super) struct StepInput<'a> {
    pub(super) inverse: &'a [F32x8],
    pub(super) drag: Option<&'a [F32x8]>,
    pub(super) gravity: Vec3,
    pub(super) dt: f32,
    /// Positions before [m].
    pub(super) x: &'a Vectors,
    /// Velocities before [m/s], if forces read those of neighbours; `None`: they are where the new ones are
    /// written.
    pub(super) v: Option<&'a Vectors>,
}

/// No force.
pub(super) struct NoForce;

impl Gather for NoForce {
    #[inline(always)]
    fn eight(&self, _: usize) -> Eight {
        [[0.0; LANES]; 3]
    }
}

struct Advance<'a, 'b, G> {
    input: &'b StepInput<'a>,
    forces: &'b G,
    start: usize,
    x: [&'b mut [F32x8]; 3],
    v: [&'b mut [F32x8]; 3],
    low: [&'b mut [F32x8]; 3],
}

impl<G: Gather> Pass for Advance<'_, '_, G> {
    /// The first eight points of which one diverged.
    type Out = Option<usize>;

    #[inline(always)]
    fn run<L: Lanes>(self) -> Option<usize> {
        let StepInput { inverse, drag, gravity, dt, x: old, v: old_v } = *self.input;
        let mut diverged = None;
        for k in 0..self.x[0].len() {
            let at = self.start + k;
            let (f, w, old) = (self.forces.eight(at), inverse[at], old.eight(at));
            let mut slow = [1.0; LANES];
            if let Some(drag) = drag {
                for lane in 0..LANES {
                    slow[lane] = 1.0 / (1.0 + dt * drag[at][lane]);
                }
            }
            let free = w.map(|w| if w > 0.0 { 1.0 } else { 0.0 });
            let mut largest = [0.0_f32; LANES];
            for axis in 0..3 {
                // Copies: the compiler vectorizes only if old and new cannot alias.
                let mut v = old_v.map_or(self.v[axis][k], |old_v| old_v.axes[axis][at]);
                let (mut x, mut low) = (old[axis], self.low[axis][k]);
                for lane in 0..LANES {
                    let a = f[axis][lane] * w[lane] + gravity[axis] * free[lane]; // [gudukbay97] Eq. 4
                    v[lane] = (v[lane] + dt * a) * slow[lane];
                    // The rounding error of the displacement is added to the next one ([kahan65]).
                    let displacement = (dt * v[lane] + low[lane]) * free[lane];
                    let before = x[lane];
                    x[lane] = before + displacement;
                    low[lane] = displacement - (x[lane] - before);
                    // A NaN in either makes the sum one.
                    largest[lane] += x[lane].abs() + v[lane].abs();
                }
                (self.x[axis][k], self.v[axis][k], self.low[axis][k]) = (x, v, low);
            }
            // All points are checked: an early exit would prevent a vector comparison.
            let is_finite =
                largest.iter().fold(true, |is_finite, &largest| is_finite & (largest < DIVERGENCE_LIMIT));
            if !is_finite && diverged.is_none() {
                diverged = Some(at);
            }
        }
        diverged
    }
}

/// Advances points by `input.dt` [s] under these forces [N] to new positions and velocities. `low` holds the
/// rounding errors of positions so far. Returns the first eight points of which one diverged, if any.
pub(super) fn advance<G: Gather>(
    input: &StepInput<'_>,
    forces: &G,
    x: &mut Vectors,
    v: &mut Vectors,
    low: &mut Vectors,
) -> Option<usize> {
    let ([x0, x1, x2], [v0, v1, v2], [l0, l1, l2]) = (&mut x.axes, &mut v.axes, &mut low.axes);
    let all: [&mut [F32x8]; 9] = [x0, x1, x2, v0, v1, v2, l0, l1, l2];
    let diverged = in_chunks(all, |start, [x0, x1, x2, v0, v1, v2, l0, l1, l2]| {
        simd::dispatch(Advance { input, forces, start, x: [x0, x1, x2], v: [v0, v1, v2], low: [l0, l1, l2] })
    });
    diverged.into_iter().flatten().next()
}
