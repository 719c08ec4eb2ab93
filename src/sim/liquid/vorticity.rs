//! Vorticity confinement: returns energy that the solver dissipated to vortices.
//!
//! *Method*: [pbf] Eqs. 15–16. *Departs from the paper*: sums have the volume weight m/ρ̄_ij, so that ω is a curl in 1/s; ε is
//! `strength` · √(g₀ · spacing) [m/s], so that the term is an acceleration and vanishes with the spacing. The term has two
//! bounds. In one substep it changes a velocity by at most a tenth of the rotation speed ω · spacing. Over the shot it returns
//! at most the mechanical energy that the liquid has lost since the start: it prolongs motion without amplifying it. Rotation
//! that is slow against what gravity adds in a substep is noise of the density solve, which XSPH's `rest` damps: the term has
//! the weight ω²/(ω² + ω₀²) with ω₀ = [`REST_SPEED`] g Δt/spacing, so that still water stays still.
//!
//! Symbols: ω_i → `omega` [1/s]; η → `eta` [1/(m s)]; ε → `epsilon` [m/s].

use super::{
    VorticityConfinement,
    lanes::{self, Node},
    neighbourhood::{NeighbourPairs, Neighbourhood},
    pair::Pair,
    pass::{self, NeighbourPass},
    xsph::REST_SPEED,
};
use crate::{math::Vec3, par, simd::Lanes};

/// g₀, which makes ε dimensionless [m/s²].
pub(super) const STANDARD_GRAVITY: f32 = 9.81;

/// Largest change of a velocity in one substep, as a fraction of ω · spacing. At 1 a vortex doubles its speed in a substep
/// and tears its surroundings.
const MAX_VELOCITY_CHANGE: f32 = 0.1;

/// Vorticity confinement and its buffers.
#[derive(Debug)]
pub(super) struct Confinement {
    strength: f32,
    /// Vorticity ω and its norm [1/s].
    omega: Vec<Node>,
    /// Velocity changes [m/s].
    change: Vec<Vec3>,
}

impl Confinement {
    pub(super) fn new(params: &VorticityConfinement) -> Self {
        Self { strength: params.strength, omega: Vec::new(), change: Vec::new() }
    }

    /// Changes `v` over `dt` [s], in which gravity adds `gain` [m/s], adding at most `budget` [J] with particles of `mass` [kg].
    /// Returns the added energy [J] and whether a bound reduced it.
    pub(super) fn apply(
        &mut self,
        at: Neighbourhood<'_>,
        v: &mut [Vec3],
        [dt, gain]: [f32; 2],
        mass: f64,
        budget: f64,
    ) -> (f64, bool) {
        self.omega.resize(v.len(), Node::default());
        self.change.resize(v.len(), Vec3::zeros());
        let kernel = at.rest.kernel;
        par::for_chunks(&mut self.omega, par::CHUNK, |start, omega| {
            pass::run(kernel, CurlPass { at, start, omega });
        });
        let epsilon = self.strength * (STANDARD_GRAVITY * at.rest.spacing).sqrt();
        let wanted = epsilon * dt;
        let step = wanted.min(MAX_VELOCITY_CHANGE * at.rest.spacing);
        let rest2 = (REST_SPEED * gain / at.rest.spacing).powi(2);
        let omega = &*self.omega;
        par::for_chunks(&mut self.change, par::CHUNK, |start, change| {
            pass::run(kernel, ConfinementPass { at, start, omega, step, rest2, change });
        });
        let (change, velocities) = (&self.change, &*v);
        let linear = mass * par::sum(v.len(), |i| f64::from(velocities[i].dot(&change[i])));
        let square = 0.5 * mass * par::sum(v.len(), |i| f64::from(change[i].norm_squared()));
        let share = largest_share(linear, square, budget.max(0.0));
        par::update(v, |i, v| *v += change[i] * share as f32);
        (share * (linear + share * square), step < wanted || share < 1.0)
    }
}

/// Vorticity of a chunk of particles.
struct CurlPass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    omega: &'a mut [Node],
}

impl NeighbourPass for CurlPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        for (offset, omega) in self.omega.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.at.motion[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { d, q, weight, .. } = self.at.pairs::<L>(i, index);
                let other = lanes::gather::<L>(self.at.motion, index);
                let (u, _) = lanes::offset(other, own);
                sum = lanes::plus(sum, lanes::cross(u, d), weight * P::slope(q));
            }
            let curl = lanes::total(sum) * self.at.rest.gradient_scale; // ω_i, [pbf] Eq. 15
            *omega = Node::new(curl, curl.norm());
        }
    }
}

/// Velocity changes of a chunk of particles.
struct ConfinementPass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    omega: &'a [Node],
    /// ε Δt [m].
    step: f32,
    /// ω₀² [1/s²].
    rest2: f32,
    change: &'a mut [Vec3],
}

impl NeighbourPass for ConfinementPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        for (offset, change) in self.change.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = self.omega[i];
            let size = L::splat(own.value());
            let mut eta = [L::splat(0.0); 3];
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { d, q, weight, .. } = self.at.pairs::<L>(i, index);
                let [_, _, _, other] = lanes::gather::<L>(self.omega, index);
                eta = lanes::plus(eta, d, weight * P::slope(q) * (size - other));
            }
            let eta = lanes::total(eta) * self.at.rest.gradient_scale;
            let length = eta.norm();
            // Where |ω| is constant, N has no direction.
            *change = if length * self.at.rest.support <= 1e-6 * own.value() {
                Vec3::zeros()
            } else {
                let omega2 = own.value() * own.value();
                let weight = omega2 / (omega2 + self.rest2).max(f32::MIN_POSITIVE);
                (eta / length).cross(&own.vector()) * (self.step * weight) // Δt f, [pbf] Eq. 16
            };
        }
    }
}

/// Largest s ≤ 1 with s·linear + s²·square ≤ budget.
pub(super) fn largest_share(linear: f64, square: f64, budget: f64) -> f64 {
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
    use crate::{
        sim::liquid::{Kernel, calibration::RestState},
        space::{CellGrid, Neighbours},
    };

    #[test]
    fn the_share_uses_exactly_the_budget() {
        for (linear, square, budget) in [(1.0, 2.0, 0.5), (-1.0, 3.0, 0.1), (5.0, 0.1, 0.0), (1e6, 1e-3, 1.0)]
        {
            let s = largest_share(linear, square, budget);
            assert!((0.0..1.0).contains(&s));
            assert!((s * linear + s * s * square - budget).abs() < 1e-9 * budget.max(1.0), "{s}");
        }
        assert_eq!(largest_share(1.0, 1.0, 2.5), 1.0);
        assert_eq!(largest_share(0.0, 0.0, 0.0), 1.0);
    }

    #[test]
    fn a_vortex_gains_what_is_reported_and_what_the_budget_allows() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let at =
            |k: usize| Vec3::new((k % 11) as f32 - 5.0, (k / 11 % 11) as f32 - 5.0, (k / 121) as f32) * 0.1;
        let p: Vec<Vec3> = (0..11 * 11 * 5).map(at).collect();
        let lists = Neighbours::build(&CellGrid::new(&p, 0.2), &p, 0.2);
        let nodes: Vec<Node> = p.iter().map(|&x| Node::new(x * rest.inv_support, 1.0)).collect();
        // A column that rotates rigidly inside and slower outside.
        let turning = |x: &Vec3| Vec3::new(-x.y, x.x, 0.0) * 3.0 * (-4.0 * (x.x * x.x + x.y * x.y)).exp();
        let still: Vec<Vec3> = p.iter().map(turning).collect();
        let motion: Vec<Node> = still.iter().map(|&v| Node::new(v, 0.0)).collect();
        let at = Neighbourhood { rest: &rest, nodes: &nodes, motion: &motion, lists: &lists };
        let kinetic = |v: &[Vec3]| v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>();
        let gain_under = |gravity: f32, budget: f64, strength: f32| {
            let mut term = Confinement::new(&VorticityConfinement { strength });
            let mut v = still.clone();
            let (added, bounded) = term.apply(at, &mut v, [0.01, 0.01 * gravity], 2.0, budget);
            assert!((kinetic(&v) - kinetic(&still) - added).abs() < 1e-4 * kinetic(&still), "{added}");
            (added, bounded, term.omega[5 + 5 * 11 + 2 * 121].vector())
        };
        let gain = |budget: f64, strength: f32| gain_under(0.0, budget, strength);
        let (free, bounded, omega) = gain(f64::INFINITY, 0.5);
        assert!(free > 0.0 && !bounded, "{free}");
        // Twice the angular velocity, reduced by the smoothing of the kernel.

        assert!((omega.z / 6.0 - 1.0).abs() < 0.12 && omega.xy().norm() < 1e-3, "{omega:?}");
        // ω falls from 6/s outwards; ω₀ is 0.4/s, then 400/s.
        let [water, heavy] = [9.81, 1e4].map(|gravity| gain_under(gravity, f64::INFINITY, 0.5).0);
        assert!(water < free && water > 0.85 * free && heavy < 1e-3 * free, "{water} and {heavy} of {free}");
        let (half, bounded, _) = gain(0.5 * free, 0.5);
        assert!(bounded && (half - 0.5 * free).abs() < 1e-6 * free);
        assert!(gain(0.0, 0.5).0.abs() < 1e-9);
        let (most, bounded, _) = gain(f64::INFINITY, 1e6);
        assert!(bounded && most < 0.3 * kinetic(&still), "{most} of {}", kinetic(&still));
    }
}
