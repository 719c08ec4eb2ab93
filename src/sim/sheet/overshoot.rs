//! Energy that the linearisation of implicit Euler adds to springs.
//!
//! *Method*: v₁ times the linear system of `implicit.rs` is the change of ½ v·Mv and of the energy of
//! linearised springs. Real springs gain more where their force changes within the time step. This gain, less
//! ½ Δv·MΔv and ½ Δt² v₁·Kv₁, which implicit Euler dissipates, is V(x₁) − V(x₀) + Δt v₁·f(x₀) − Δt² v₁·Kv₁ −
//! ½ Δv·MΔv. Where it is negative, the linearisation did not raise the energy.
//!
//! Symbols: d → x_j − x_i [m]; u → Δt (v_j − v_i) [m]; a and b → its parts along and across d; k, ℓ as in
//! `springs.rs`; s → the length of the spring beyond |d| + a at the end [m].
//! Limits: what plates, pins, dampers and a coupled liquid dissipate is not counted, so the gain is an upper bound. Of a pushed body ½ ΔV·MΔV is
//! taken off, with what it loses by impacts on colliders in the same substep.

use super::{
    record::SheetRecord,
    sliced_ellpack::SlicedEllpack,
    springs::fetch,
    vectors::{Eight, Vectors, map_chunks},
};
use crate::simd::{self, F32x8, LANES, Lanes, Pass};
use std::ops::Range;

/// Smallest gain that is reported, relative to the energy of springs and motion.
const MIN_REPORTED_FRACTION: f64 = 0.01;

/// A substep of the implicit integrator.
pub(super) struct Substep<'a> {
    pub(super) springs: &'a SlicedEllpack,
    /// Positions at its start.
    pub(super) x: &'a Vectors,
    pub(super) mass: &'a [F32x8],
    /// Velocities before and after.
    pub(super) before: &'a Vectors,
    pub(super) after: &'a Vectors,
    pub(super) dt: f32,
}

/// Energy that springs gained in a substep, and the energy of springs and motion after it [J]. Zero with the symplectic integrator.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct EnergyBalance {
    pub(super) gain: f64,
    pub(super) total: f64,
}

impl EnergyBalance {
    /// The balance of a substep.
    pub(super) fn new(substep: &Substep<'_>) -> Self {
        let all = map_chunks(substep.mass.len(), |eights| simd::dispatch(BalanceChunk { substep, eights }));
        let [gain, total] = all.iter().fold([0.0; 2], |sum, part| [sum[0] + part[0], sum[1] + part[1]]);
        Self { gain, total }
    }

    /// Adds the gain to the record if it is large enough to report.
    pub(super) fn count(self, record: &mut SheetRecord) {
        if self.gain > MIN_REPORTED_FRACTION * self.total {
            record.overshot += 1;
            record.overshot_energy += self.gain;
        }
    }
}

/// Energy gain of some eights, and their energy after the substep: that of motion and half of each spring,
/// since both ends count it.
struct BalanceChunk<'a> {
    substep: &'a Substep<'a>,
    eights: Range<usize>,
}

impl Pass for BalanceChunk<'_> {
    type Out = [f64; 2];

    #[inline(always)]
    fn run<L: Lanes>(self) -> [f64; 2] {
        let Substep { springs, x, mass, before, after, dt } = *self.substep;
        let (all, all_v, dt) = (x.flat(), after.flat(), f64::from(dt));
        let (mut gain, mut total) = ([0.0; LANES], [0.0; LANES]);
        for at in self.eights {
            let (own, own_v, previous) = (x.eight(at), after.eight(at), before.eight(at));
            for lane in 0..LANES {
                let m = 0.5 * f64::from(mass[at][lane]);
                let (is, previous) = (vector(&own_v, lane), vector(&previous, lane));
                let change = [is[0] - previous[0], is[1] - previous[1], is[2] - previous[2]];
                gain[lane] -= m * dot(&change, &change);
                total[lane] += m * dot(&is, &is);
            }
            for slot in springs.of(at).0 {
                let (far, far_v) = (fetch(&all, slot, at), fetch(&all_v, slot, at));
                for lane in 0..LANES {
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
                    let elongation = length + along - rest;
                    // |d + u| − (|d| + a), written without the difference of nearly equal lengths where a
                    // spring keeps its direction.
                    let straight = length + along;
                    let turned = (straight * straight + across2).sqrt();
                    let s = if straight > 0.0 { across2 / (turned + straight) } else { turned - straight };
                    // As in `springs`: a spring of zero rest length is taut even at zero length.
                    let taut = 1.0 - rest / if length > 1e-15 { length } else { 1e-15 };
                    let taut = if taut > 0.0 { taut } else { 0.0 };
                    // V₁ − V₀ − k (|d| − ℓ) a − k a² − k c b², with V₁ = ½ k (|d| + a − ℓ + s)².
                    gain[lane] += k * ((2.0 * elongation + s) * s - along * along - 2.0 * taut * across2);
                    total[lane] += k * (elongation + s) * (elongation + s);
                }
            }
        }
        [gain.iter().sum(), total.iter().sum()]
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
    use super::{super::sliced_ellpack::Entry, *};
    use crate::math::Vec3;

    const COUNT: usize = 45;

    fn cloud(seed: f32) -> Vectors {
        let at = |i: usize, k: f32| (seed + k + i as f32 * (1.3 + 0.7 * k)).sin();
        Vectors::of(&(0..COUNT).map(|i| Vec3::new(at(i, 0.0), at(i, 1.0), at(i, 2.0))).collect::<Vec<_>>())
    }

    /// Against the balance of the module's documentation, spring by spring, for taut, loose and compressed
    /// springs.
    #[test]
    fn the_energy_gain_closes_the_balance_and_small_gains_are_not_reported() {
        let x = cloud(0.3);
        // Points that turn move wholly across their springs.
        let turning =
            Vectors::of(&x.to_vec().iter().map(|x| Vec3::new(0.3, 0.5, 1.0).cross(x)).collect::<Vec<_>>());
        let any = [cloud(1.9), cloud(2.0)];
        let turned = [turning.clone(), turning];
        let of = |v: &Vectors, i: usize| v.get(i).cast::<f64>();
        let mut mass = vec![[0.0; LANES]; COUNT.div_ceil(LANES)];
        mass.as_flattened_mut()[..COUNT].iter_mut().enumerate().for_each(|(i, m)| *m = 1.0 + i as f32);
        // Loose springs resist turning only at the end of the substep.
        let loose = |_: usize| 0.99;
        let mixed = |k: usize| 0.05 * (k % 40) as f32;
        type Case<'a> = (&'a [Vectors; 2], &'a dyn Fn(usize) -> f32, f32, bool);
        let cases: [Case<'_>; 7] = [
            (&turned, &loose, 3.0, true),
            (&turned, &loose, 0.3, true),   // 1.2 % of the energy
            (&turned, &loose, 0.25, false), // 0.6 %
            (&turned, &loose, 0.03, false),
            (&turned, &mixed, 1.0, false),
            (&any, &mixed, 1.0, false),
            (&any, &loose, 0.1, false),
        ];
        for ([before, after], rest, dt, is_reported) in cases {
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
            let table = SlicedEllpack::new(COUNT, springs.iter().flat_map(both).collect());
            let (mut expected, mut total, h) = (0.0, 0.0, f64::from(dt));
            for e in &springs {
                let (k, rest, [a, b]) =
                    (f64::from(e.stiffness), f64::from(e.rest), [e.of as usize, e.to as usize]);
                let (d, w) = (of(&x, b) - of(&x, a), of(after, b) - of(after, a));
                let (length, then) = (d.norm(), (d + w * h).norm());
                let along = d.dot(&w) / length;
                let across = (1.0 - rest / length).max(0.0) * (w.norm_squared() - along * along);
                expected += 0.5 * k * ((then - rest).powi(2) - (length - rest).powi(2));
                expected -= h * k * (length - rest) * along + h * h * k * (along * along + across);
                total += 0.5 * k * (then - rest).powi(2);
            }
            for i in 0..COUNT {
                let m = f64::from(mass[i / LANES][i % LANES]);
                expected -= 0.5 * m * (of(after, i) - of(before, i)).norm_squared();
                total += 0.5 * m * of(after, i).norm_squared();
            }
            let substep = Substep { springs: &table, x: &x, mass: &mass, before, after, dt };
            let (found, mut record) = (EnergyBalance::new(&substep), SheetRecord::default());
            println!("{dt}: {found:?} {expected} {total}");
            assert!(
                (found.gain - expected).abs() < 1e-12 * total && (found.total - total).abs() < 1e-12 * total
            );
            found.count(&mut record);
            let reported = if is_reported { (1, found.gain) } else { (0, 0.0) };
            assert_eq!((record.overshot, record.overshot_energy), reported);
        }
    }
}
