//! What one linearisation makes of the energy of springs.
//!
//! *Method*: v₁ times the linear system of `implicit.rs` is the change of ½ v·Mv, and what springs would do if they were as
//! linearised. What they do beyond that is energy from nowhere, less ½ Δv·MΔv and ½ Δt² v₁·Kv₁, which the rule takes:
//! V(x₁) − V(x₀) + Δt v₁·f(x₀) − Δt² v₁·Kv₁ − ½ Δv·MΔv. Where that is negative, energy did not grow by it.
//!
//! Symbols: d → x_j − x_i [m]; u → Δt (v_j − v_i) [m]; a and b → its parts along and across d; k, ℓ as in `springs.rs`; s → how
//! much longer than |d| + a the spring becomes [m].
//! Limits: what plates, pins and dampers take besides is not counted, so that it tells of too much rather than of too little.

use super::{
    lanes::{Eight, Vectors, parts},
    springs::fetch,
    table::Table,
};
use crate::math::wide::{self, Job, WIDTH, Wide};
use std::ops::Range;

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
    let [made, whole] = balance(substep);
    if made > MATTERS * whole { made } else { 0.0 }
}

/// What it made and what springs and motion hold after [J].
fn balance(substep: &Substep<'_>) -> [f64; 2] {
    let all = parts(substep.mass.len(), |eights| wide::run(Account { substep, eights }));
    all.iter().fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]])
}

/// Of some eights what they make, and what they hold after, of motion and half of each spring: each is asked from both ends.
struct Account<'a> {
    substep: &'a Substep<'a>,
    eights: Range<usize>,
}

impl Job for Account<'_> {
    type Out = [f64; 2];

    #[inline(always)]
    fn run(self) -> [f64; 2] {
        let Substep { springs, x, mass, before, after, dt } = *self.substep;
        let (all, all_v, dt) = (x.flat(), after.flat(), f64::from(dt));
        let (mut made, mut whole) = ([0.0; WIDTH], [0.0; WIDTH]);
        for at in self.eights {
            let (own, own_v, was) = (x.eight(at), after.eight(at), before.eight(at));
            for lane in 0..WIDTH {
                let m = 0.5 * f64::from(mass[at][lane]);
                let (is, was) = (vector(&own_v, lane), vector(&was, lane));
                let more = [is[0] - was[0], is[1] - was[1], is[2] - was[2]];
                made[lane] -= m * dot(&more, &more);
                whole[lane] += m * dot(&is, &is);
            }
            for slot in springs.of(at).0 {
                let (far, far_v) = (fetch(&all, slot, at), fetch(&all_v, slot, at));
                for lane in 0..WIDTH {
                    let (x, v) = (vector(&own, lane), vector(&own_v, lane));
                    let (y, w) = (vector(&far, lane), vector(&far_v, lane));
                    let d = [y[0] - x[0], y[1] - x[1], y[2] - x[2]];
                    let u = [(w[0] - v[0]) * dt, (w[1] - v[1]) * dt, (w[2] - v[2]) * dt];
                    let (k, rest) = (0.25 * f64::from(slot.stiffness[lane]), f64::from(slot.rest[lane]));
                    let length = dot(&d, &d).sqrt();
                    // In one place u is wholly across.
                    let along = dot(&d, &u) / if length > 0.0 { length } else { 1.0 };
                    let across2 = dot(&u, &u) - along * along;
                    let across2 = if across2 > 0.0 { across2 } else { 0.0 };
                    let longer = length + along - rest;
                    // |d + u| − (|d| + a), without the difference of what is nearly the same where the spring goes on as it was.
                    let straight = length + along;
                    let turned = (straight * straight + across2).sqrt();
                    let s = if straight > 0.0 { across2 / (turned + straight) } else { turned - straight };
                    // As `springs` has it: what has no rest length is taut in one place too.
                    let taut = 1.0 - rest / if length > 1e-15 { length } else { 1e-15 };
                    let taut = if taut > 0.0 { taut } else { 0.0 };
                    // V₁ − V₀ − k (|d| − ℓ) a − k a² − k c b², with V₁ = ½ k (|d| + a − ℓ + s)².
                    made[lane] += k * ((2.0 * longer + s) * s - along * along - 2.0 * taut * across2);
                    whole[lane] += k * (longer + s) * (longer + s);
                }
            }
        }
        [made.iter().sum(), whole.iter().sum()]
    }
}

#[inline(always)]
fn vector(of: &Eight, lane: usize) -> [f64; 3] {
    [f64::from(of[0][lane]), f64::from(of[1][lane]), f64::from(of[2][lane])]
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::{super::table::Entry, *};
    use crate::math::Vec3;

    const COUNT: usize = 45;

    fn cloud(seed: f32) -> Vectors {
        let at = |i: usize, k: f32| (seed + k + i as f32 * (1.3 + 0.7 * k)).sin();
        Vectors::of(&(0..COUNT).map(|i| Vec3::new(at(i, 0.0), at(i, 1.0), at(i, 2.0))).collect::<Vec<_>>())
    }

    /// By the balance of the module's head, spring by spring, of springs that are taut, loose and in compression.
    #[test]
    fn what_is_made_is_what_the_balance_lacks_and_little_is_not_told() {
        let x = cloud(0.3);
        // What turns moves wholly across its springs.
        let turning =
            Vectors::of(&x.to_vec().iter().map(|x| Vec3::new(0.3, 0.5, 1.0).cross(x)).collect::<Vec<_>>());
        let any = [cloud(1.9), cloud(2.0)];
        let turned = [turning.clone(), turning];
        let of = |v: &Vectors, i: usize| v.get(i).cast::<f64>();
        let mut mass = vec![[0.0; WIDTH]; COUNT.div_ceil(WIDTH)];
        mass.as_flattened_mut()[..COUNT].iter_mut().enumerate().for_each(|(i, m)| *m = 1.0 + i as f32);
        // Loose springs give way to what turns them, and pull it back only once it is there.
        let loose = |_: usize| 0.99;
        let mixed = |k: usize| 0.05 * (k % 40) as f32;
        type Case<'a> = (&'a [Vectors; 2], &'a dyn Fn(usize) -> f32, f32, bool);
        let cases: [Case<'_>; 7] = [
            (&turned, &loose, 3.0, true),
            (&turned, &loose, 0.3, true),   // 1.2 % of what is there
            (&turned, &loose, 0.25, false), // 0.6 %
            (&turned, &loose, 0.03, false),
            (&turned, &mixed, 1.0, false),
            (&any, &mixed, 1.0, false),
            (&any, &loose, 0.1, false),
        ];
        for ([before, after], rest, dt, is_told) in cases {
            let springs: Vec<Entry> = (0..90)
                .map(|k| ((k * 7) % COUNT, (k * k * 11 + 3) % COUNT, k))
                .filter(|(a, b, _)| a != b)
                .map(|(a, b, k)| Entry {
                    of: a as u32,
                    to: b as u32,
                    stiffness: 1.0 + k as f32,
                    rest: rest(k) * (x.get(b) - x.get(a)).norm(),
                    damping: 0.0,
                })
                .collect();
            let both = |e: &Entry| [*e, Entry { of: e.to, to: e.of, ..*e }];
            let table = Table::new(COUNT, springs.iter().flat_map(both).collect());
            let (mut expected, mut whole, h) = (0.0, 0.0, f64::from(dt));
            for e in &springs {
                let (k, rest, [a, b]) =
                    (f64::from(e.stiffness), f64::from(e.rest), [e.of as usize, e.to as usize]);
                let (d, w) = (of(&x, b) - of(&x, a), of(after, b) - of(after, a));
                let (length, then) = (d.norm(), (d + w * h).norm());
                let along = d.dot(&w) / length;
                let across = (1.0 - rest / length).max(0.0) * (w.norm_squared() - along * along);
                expected += 0.5 * k * ((then - rest).powi(2) - (length - rest).powi(2));
                expected -= h * k * (length - rest) * along + h * h * k * (along * along + across);
                whole += 0.5 * k * (then - rest).powi(2);
            }
            for i in 0..COUNT {
                let m = f64::from(mass[i / WIDTH][i % WIDTH]);
                expected -= 0.5 * m * (of(after, i) - of(before, i)).norm_squared();
                whole += 0.5 * m * of(after, i).norm_squared();
            }
            let substep = Substep { springs: &table, x: &x, mass: &mass, before, after, dt };
            let found = balance(&substep);
            println!("{dt}: {found:?} {expected} {whole}");
            assert!((found[0] - expected).abs() < 1e-12 * whole && (found[1] - whole).abs() < 1e-12 * whole);
            assert_eq!(made(&substep), if is_told { found[0] } else { 0.0 });
        }
    }
}
