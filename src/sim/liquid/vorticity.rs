//! Vorticity confinement: gives swirls back energy that the solver lost.
//!
//! *Method*: [pbf] Eqs. 15–16. *Departs from the paper*: sums carry the volume weight m/ρ̄_ij, so that ω is a
//! curl in 1/s; ε is `strength` · √(g₀ · spacing) [m/s], so that the acceleration is one and vanishes as the
//! spacing does; and the term is bounded twice. In one substep it changes a velocity by at most a tenth of the
//! swirl speed ω · spacing, and over the shot it gives back at most the mechanical energy that the liquid has
//! lost since the start: it can prolong motion but never wind it up.
//!
//! Symbols: ω_i → `omega` [1/s]; η → `eta` [1/(m s)]; ε → `epsilon` [m/s].

use super::{VorticityConfinement, rest::Rest};
use crate::{math::Vec3, par, space::Neighbours};

/// g₀, the acceleration that makes ε dimensionless [m/s²].
const STANDARD_GRAVITY: f32 = 9.81;

/// Largest change of a velocity in one substep, as a fraction of ω · spacing. At 1 a swirl doubles in a
/// substep and tears its surroundings.
const LARGEST_KICK: f32 = 0.1;

/// The term and its buffers.
#[derive(Debug)]
pub(super) struct Confinement {
    strength: f32,
    /// ω [1/s], and |ω| beside it.
    omega: Vec<(Vec3, f32)>,
    /// Velocity changes [m/s].
    kick: Vec<Vec3>,
}

/// Positions and the densities and lists that belong to them.
#[derive(Clone, Copy)]
pub(super) struct Neighbourhood<'a> {
    pub(super) rest: &'a Rest,
    pub(super) p: &'a [Vec3],
    pub(super) ratio: &'a [f32],
    pub(super) lists: &'a Neighbours,
}

impl Neighbourhood<'_> {
    /// Calls `f(j, x_i − x_j over h, q, 2/(ρ_i + ρ_j) in units of 1/ρ₀)` for every neighbour within h, except at q = 0.
    #[inline]
    pub(super) fn each(&self, i: usize, mut f: impl FnMut(usize, Vec3, f32, f32)) {
        for &j in self.lists.of(i) {
            let j = j as usize;
            let d = (self.p[i] - self.p[j]) * self.rest.inv_support;
            let q2 = d.norm_squared();
            if q2 < 1.0 && q2 > 0.0 {
                f(j, d, q2.sqrt(), 2.0 / (self.ratio[i] + self.ratio[j]));
            }
        }
    }

    /// Volume times ∇_i W [1/m].
    #[inline]
    fn gradient(&self, d: Vec3, q: f32, weight: f32) -> Vec3 {
        d * (-self.rest.gradient_scale * weight * (1.0 - q) * (1.0 - q) / q)
    }
}

impl Confinement {
    pub(super) fn new(params: &VorticityConfinement) -> Self {
        Self { strength: params.strength, omega: Vec::new(), kick: Vec::new() }
    }

    /// Changes `v` over `dt` [s], adding at most `budget` [J] with particles of `mass` [kg]; returns the energy
    /// added [J] and whether a bound cut it.
    pub(super) fn apply(
        &mut self,
        at: Neighbourhood<'_>,
        v: &mut [Vec3],
        dt: f32,
        mass: f64,
        budget: f64,
    ) -> (f64, bool) {
        self.omega.resize(v.len(), (Vec3::zeros(), 0.0));
        self.kick.resize(v.len(), Vec3::zeros());
        let velocities = &*v;
        par::fill(&mut self.omega, |i| {
            let mut omega = Vec3::zeros();
            at.each(i, |j, d, q, weight| {
                omega -= (velocities[j] - velocities[i]).cross(&at.gradient(d, q, weight)); // ω_i, [pbf] Eq. 15
            });
            (omega, omega.norm())
        });
        let epsilon = self.strength * (STANDARD_GRAVITY * at.rest.spacing).sqrt();
        let wanted = epsilon * dt;
        let step = wanted.min(LARGEST_KICK * at.rest.spacing);
        let omega = &self.omega;
        par::fill(&mut self.kick, |i| {
            let mut eta = Vec3::zeros();
            at.each(i, |j, d, q, weight| eta += at.gradient(d, q, weight) * (omega[j].1 - omega[i].1));
            let size = eta.norm();
            // Where |ω| is level, N has no direction.
            if size * at.rest.support <= 1e-6 * omega[i].1 {
                return Vec3::zeros();
            }
            (eta / size).cross(&omega[i].0) * step // Δt f, [pbf] Eq. 16
        });
        let kick = &self.kick;
        let linear = mass * par::sum(v.len(), |i| f64::from(velocities[i].dot(&kick[i])));
        let square = 0.5 * mass * par::sum(v.len(), |i| f64::from(kick[i].norm_squared()));
        let share = affordable(linear, square, budget.max(0.0));
        par::update(v, |i, v| *v += kick[i] * share as f32);
        (share * (linear + share * square), step < wanted || share < 1.0)
    }
}

/// The largest s ≤ 1 with s·linear + s²·square ≤ budget.
fn affordable(linear: f64, square: f64, budget: f64) -> f64 {
    if linear + square <= budget || square <= 0.0 {
        return 1.0;
    }
    let root = (linear * linear + 4.0 * square * budget).sqrt();
    // The form without cancellation: linear may be much larger than what remains.
    let s = if linear > 0.0 { 2.0 * budget / (linear + root) } else { (root - linear) / (2.0 * square) };
    s.clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::space::CellGrid;

    #[test]
    fn the_share_spends_the_budget_and_no_more() {
        for (linear, square, budget) in [(1.0, 2.0, 0.5), (-1.0, 3.0, 0.1), (5.0, 0.1, 0.0), (1e6, 1e-3, 1.0)]
        {
            let s = affordable(linear, square, budget);
            assert!((0.0..1.0).contains(&s));
            assert!((s * linear + s * s * square - budget).abs() < 1e-9 * budget.max(1.0), "{s}");
        }
        assert_eq!(affordable(1.0, 1.0, 2.5), 1.0);
        assert_eq!(affordable(0.0, 0.0, 0.0), 1.0);
    }

    #[test]
    fn a_vortex_gains_what_is_reported_and_what_the_budget_allows() {
        let rest = Rest::new(0.1, 2.0);
        let at =
            |k: usize| Vec3::new((k % 11) as f32 - 5.0, (k / 11 % 11) as f32 - 5.0, (k / 121) as f32) * 0.1;
        let p: Vec<Vec3> = (0..11 * 11 * 5).map(at).collect();
        let lists = Neighbours::build(&CellGrid::new(&p, 0.2), &p, 0.2);
        let at = Neighbourhood { rest: &rest, p: &p, ratio: &vec![1.0; p.len()], lists: &lists };
        // A column that turns like a rigid body inside and slower outside.
        let turning = |x: &Vec3| Vec3::new(-x.y, x.x, 0.0) * 3.0 * (-4.0 * (x.x * x.x + x.y * x.y)).exp();
        let still: Vec<Vec3> = p.iter().map(turning).collect();
        let kinetic = |v: &[Vec3]| v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>();
        let gain = |budget: f64, strength: f32| {
            let mut term = Confinement::new(&VorticityConfinement { strength });
            let mut v = still.clone();
            let (added, bounded) = term.apply(at, &mut v, 0.01, 2.0, budget);
            assert!((kinetic(&v) - kinetic(&still) - added).abs() < 1e-4 * kinetic(&still), "{added}");
            (added, bounded, term.omega[5 + 5 * 11 + 2 * 121].0)
        };
        let (free, bounded, omega) = gain(f64::INFINITY, 0.5);
        assert!(free > 0.0 && !bounded, "{free}");
        // Twice the angular velocity, less what a sum over a kernel smooths.
        assert!((omega.z / 6.0 - 1.0).abs() < 0.12 && omega.xy().norm() < 1e-3, "{omega:?}");
        let (half, bounded, _) = gain(0.5 * free, 0.5);
        assert!(bounded && (half - 0.5 * free).abs() < 1e-6 * free);
        assert!(gain(0.0, 0.5).0.abs() < 1e-9);
        let (most, bounded, _) = gain(f64::INFINITY, 1e6);
        assert!(bounded && most < 0.3 * kinetic(&still), "{most} of {}", kinetic(&still));
    }
}
