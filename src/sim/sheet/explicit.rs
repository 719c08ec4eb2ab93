//! Semi-implicit (symplectic) Euler: v ← (v + Δt a)/(1 + Δt c), x ← x + Δt v.
//!
//! *Method*: [gudukbay97] Eq. 4, whose velocity-proportional damping is taken at the new velocity, so that it never turns a motion round.
//! [hairer06] chapter VI shows why energy does not drift without damping.
//!
//! Forces, velocities and positions of eight points are made in one go. Points read the old positions of their neighbours, and new ones are
//! written elsewhere: so nothing of a million points goes through memory twice.
//!
//! Symbols: c → `drag` [1/s], 1/m → `inverse` [1/kg]; a point of no mobility (1/m = 0) is left where it is.
//! Substeps are many, and each rounds a position the same way where the speed is constant; so what rounding takes is kept for the next.
//!
//! Limits: first order in time; stable up to `bound.rs`.

use super::{
    ABSURD,
    lanes::{Eight, Vectors, in_chunks},
    springs::Gather,
};
use crate::math::{
    Vec3,
    wide::{self, Job, WIDTH, Wide},
};

/// What moves points besides forces.
pub(super) struct Drive<'a> {
    pub(super) inverse: &'a [Wide],
    pub(super) drag: Option<&'a [Wide]>,
    pub(super) gravity: Vec3,
    pub(super) dt: f32,
    /// Positions before [m].
    pub(super) x: &'a Vectors,
    /// Velocities before [m/s], if forces read those of neighbours; `None`: they stand where the new ones are written.
    pub(super) v: Option<&'a Vectors>,
}

/// No force.
pub(super) struct Nothing;

impl Gather for Nothing {
    #[inline(always)]
    fn eight(&self, _: usize) -> Eight {
        [[0.0; WIDTH]; 3]
    }
}

struct Advance<'a, 'b, G> {
    drive: &'b Drive<'a>,
    forces: &'b G,
    start: usize,
    x: [&'b mut [Wide]; 3],
    v: [&'b mut [Wide]; 3],
    low: [&'b mut [Wide]; 3],
}

impl<G: Gather> Job for Advance<'_, '_, G> {
    /// The first eight that left what can be computed.
    type Out = Option<usize>;

    #[inline(always)]
    fn run(self) -> Option<usize> {
        let Drive { inverse, drag, gravity, dt, x: old, v: old_v } = *self.drive;
        let mut lost = None;
        for k in 0..self.x[0].len() {
            let at = self.start + k;
            let (f, w, old) = (self.forces.eight(at), inverse[at], old.eight(at));
            let mut slow = [1.0; WIDTH];
            if let Some(drag) = drag {
                for lane in 0..WIDTH {
                    slow[lane] = 1.0 / (1.0 + dt * drag[at][lane]);
                }
            }
            let free = w.map(|w| if w > 0.0 { 1.0 } else { 0.0 });
            let mut largest = [0.0_f32; WIDTH];
            for axis in 0..3 {
                // Copies: where old and new might be one place, nothing is computed eight at a time.
                let mut v = old_v.map_or(self.v[axis][k], |old_v| old_v.axes[axis][at]);
                let (mut x, mut low) = (old[axis], self.low[axis][k]);
                for lane in 0..WIDTH {
                    let a = f[axis][lane] * w[lane] + gravity[axis] * free[lane]; // [gudukbay97] Eq. 4
                    v[lane] = (v[lane] + dt * a) * slow[lane];
                    // What rounding takes from the way is added to the next ([kahan65]).
                    let way = (dt * v[lane] + low[lane]) * free[lane];
                    let before = x[lane];
                    x[lane] = before + way;
                    low[lane] = way - (x[lane] - before);
                    // A NaN in either makes the sum one.
                    largest[lane] += x[lane].abs() + v[lane].abs();
                }
                (self.x[axis][k], self.v[axis][k], self.low[axis][k]) = (x, v, low);
            }
            // All are looked at: an early end would keep the lanes from being compared at once.
            let whole = largest.iter().fold(true, |whole, &largest| whole & (largest < ABSURD));
            if !whole && lost.is_none() {
                lost = Some(at);
            }
        }
        lost
    }
}

/// Advances points by `drive.dt` [s] under these forces [N] to new positions and velocities; `low` is what rounding took from positions so far. Returns one of
/// eight that has a point that left what can be computed, if there is one.
pub(super) fn advance<G: Gather>(
    drive: &Drive<'_>,
    forces: &G,
    x: &mut Vectors,
    v: &mut Vectors,
    low: &mut Vectors,
) -> Option<usize> {
    let ([x0, x1, x2], [v0, v1, v2], [l0, l1, l2]) = (&mut x.axes, &mut v.axes, &mut low.axes);
    let all: [&mut [Wide]; 9] = [x0, x1, x2, v0, v1, v2, l0, l1, l2];
    let lost = in_chunks(all, |start, [x0, x1, x2, v0, v1, v2, l0, l1, l2]| {
        wide::run(Advance { drive, forces, start, x: [x0, x1, x2], v: [v0, v1, v2], low: [l0, l1, l2] })
    });
    lost.into_iter().flatten().next()
}
