//! What one linearisation makes of the energy of springs.
//!
//! *Method*: v₁ times the linear system of `implicit.rs` is the change of ½ v·Mv, and what springs would do if they were as
//! linearised. What they do beyond that is energy from nowhere, less ½ Δv·MΔv and ½ Δt² v₁·Kv₁, which the rule takes:
//! V(x₁) − V(x₀) + Δt v₁·f(x₀) − Δt² v₁·Kv₁ − ½ Δv·MΔv. Where that is negative, energy did not grow by it.
//!
//! Symbols: d → x_j − x_i [m]; u → Δt (v_j − v_i) [m]; a and b → its parts along and across d; k, ℓ as in `springs.rs`; s → how
//! much longer than |d| + a the spring becomes [m].
//! Limits: what plates, pins and dampers take besides is not counted, so that it tells of too much rather than of too little.

use super::{lanes::Vectors, table::Table};
use crate::{
    math::wide::{WIDTH, Wide},
    par,
};

/// Part of the energy of springs and motion above which it is told.
const MATTERS: f64 = 0.01;

/// A substep of the implicit rule.
pub(super) struct Substep<'a> {
    pub(super) springs: &'a Table,
    /// Where it began.
    pub(super) x: &'a Vectors,
    pub(super) mass: &'a [Wide],
    /// Velocities before and after.
    pub(super) before: &'a Vectors,
    pub(super) after: &'a Vectors,
    pub(super) dt: f32,
}

/// The energy that it made [J]; 0 if it does not matter.
pub(super) fn made(substep: &Substep<'_>) -> f64 {
    let Substep { mass, before, after, .. } = substep;
    let parts = par::map_chunks(after.len(), par::CHUNK, |range| {
        range.fold([0.0; 2], |[made, whole], i| {
            let m = 0.5 * f64::from(mass[i / WIDTH][i % WIDTH]);
            let (was, is) = (before.get(i).cast::<f64>(), after.get(i).cast::<f64>());
            let [more, held] = of_springs(substep, i);
            [made + more - m * (is - was).norm_squared(), whole + held + m * is.norm_squared()]
        })
    });
    let [made, whole] = parts.iter().fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
    if made > MATTERS * whole { made } else { 0.0 }
}

/// Half of what the springs of a point make, and of what they hold after: each is asked from both ends.
fn of_springs(Substep { springs, x, after, dt, .. }: &Substep<'_>, i: usize) -> [f64; 2] {
    let mut out = [0.0; 2];
    let (own, own_v) = (x.get(i), after.get(i));
    for slot in springs.of(i / WIDTH).0 {
        let (j, k, rest) = (
            slot.to(i / WIDTH, i % WIDTH),
            f64::from(slot.stiffness[i % WIDTH]),
            f64::from(slot.rest[i % WIDTH]),
        );
        if k == 0.0 {
            continue;
        }
        let d = (x.get(j) - own).cast::<f64>();
        let u = (after.get(j) - own_v).cast::<f64>() * f64::from(*dt);
        let length = d.norm();
        let along = if length > 0.0 { d.dot(&u) / length } else { 0.0 };
        let across2 = (u.norm_squared() - along * along).max(0.0);
        let longer = length + along - rest;
        // |d + u| − (|d| + a), without the difference of what is nearly the same where the spring goes on as it was.
        let straight = length + along;
        let turned = (straight * straight + across2).sqrt();
        let s = if straight > 0.0 { across2 / (turned + straight) } else { turned - straight };
        // As `springs` has it: what has no rest length is taut in one place too.
        let taut = (1.0 - rest / length.max(1e-15)).max(0.0);
        // V₁ − V₀ − k (|d| − ℓ) a − k a² − k c b², with V₁ = ½ k (|d| + a − ℓ + s)².
        let more = (2.0 * longer + s) * s - along * along - 2.0 * taut * across2;
        out[0] += 0.25 * k * more;
        out[1] += 0.25 * k * (longer + s).powi(2);
    }
    out
}
