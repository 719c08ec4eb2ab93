//! Micropolar model: particles have an angular velocity of their own, the microrotation, which drives vortices.
//!
//! *Method*: [bender17]: Θ dω/dt = ν_t (∇×v − 2ω) + ζ ∇²ω and dv/dt = ν_t ∇×ω, with difference forms of both curls. ω relaxes to
//! the rotation ½ ∇×v of the liquid; the force then is −½ ν_t ∇²v, a negative viscosity that returns what eddies lose in the
//! solver. With the viscosity ν_t ∇²v of classical micropolar fluids, which the paper leaves out, the exchange would only
//! dissipate.
//!
//! *Departs from the paper*: ν_t and ζ/Θ are relative to spacing √(g₀ · spacing), so that they vanish with the spacing. Θ is the
//! moment of inertia of the particle's cube, spacing²/6. ∇×v − 2ω is the curl of the neighbours' velocities in the frame that
//! rotates with ω, so that rigid rotation is an equilibrium for any arrangement of particles, also at surfaces. A substep is
//! integrated exactly for constant v. ½ m Θ ω² is part of the liquid's energy, and the exchange is bounded as confinement is: it
//! returns at most the energy that the liquid has lost since the start.
//!
//! *Conserves*: inside the liquid v gains no momentum, and gains the angular momentum that the microrotation loses, less the
//! circulation around the liquid. At a free surface the difference form is not antisymmetric, and momentum changes by
//! ν_t ∮ n×ω. The symmetric form conserves momentum exactly, but exerts this as a traction: a drop in free space that rotates
//! rigidly then spins itself up. See docs/decisions/021.
//!
//! Symbols: ω_i → `spin` [1/s]; ν_t Δt → `exchange` [m²]; Θ → `inertia` [m²]; ∇×v − 2ω → `slip` [1/s].

use super::{
    Micropolar,
    calibration::{RestState, seeding_neighbours},
    lanes::{self, Node},
    neighbourhood::{NeighbourPairs, Neighbourhood},
    pair::Pair,
    pass::{self, NeighbourPass},
    vorticity::{STANDARD_GRAVITY, largest_share},
};
use crate::math::elementary::exp_m1;
use crate::{math::Vec3, par, simd::Lanes};

/// Θ over spacing²: that of a cube. At 4 the microrotation lags, and an eddy keeps 0.22 of its energy instead of 0.37.
const INERTIA: f32 = 1.0 / 6.0;

/// Largest ν_t Δt over spacing²: in one substep no vortex grows by more than about a tenth.
const MAX_EXCHANGE: f32 = 0.1;

/// Largest weight of the neighbours' mean in the smoothing of a substep.
const MAX_SMOOTHING: f32 = 0.5;

/// Microrotation and its buffers.
#[derive(Debug)]
pub(super) struct Microrotation {
    /// ν_t [m²/s].
    transfer: f32,
    /// ζ/Θ [m²/s].
    viscosity: f32,
    /// Θ [m²].
    inertia: f32,
    /// Factor from slopes times offsets over h to ∇, exact for linear fields on the filled seeding lattice [1/m].
    gradient: f32,
    /// Σ V W r²/6 of the filled seeding lattice: diffusivity times time of one smoothing with weight 1 [m²].
    smoothing: f32,
    /// Microrotation ω [1/s].
    pub(super) spin: Vec<Vec3>,
    /// Microrotation as neighbours read it: at the substep's start, then its mean over the substep.
    field: Vec<Node>,
    /// Changes of ω [1/s].
    turn: Vec<Vec3>,
    /// Changes of v [m/s].
    change: Vec<Vec3>,
}

impl Microrotation {
    pub(super) fn new(params: &Micropolar, rest: &RestState) -> Self {
        let unit = rest.spacing * (STANDARD_GRAVITY * rest.spacing).sqrt();
        let (mut sum, mut moment, mut slopes) = (0.0, 0.0, 0.0);
        for (_, q) in seeding_neighbours(f64::from(rest.support / rest.spacing)) {
            sum += rest.kernel.density(q);
            moment += rest.kernel.density(q) * q * q;
            slopes += if q > 0.0 { rest.kernel.slope(q) * q * q / 3.0 } else { 0.0 };
        }
        Self {
            transfer: params.transfer * unit,
            viscosity: params.viscosity * unit,
            inertia: INERTIA * rest.spacing * rest.spacing,
            gradient: rest.inv_support / slopes as f32,
            smoothing: (moment / sum / 6.0) as f32 * rest.support * rest.support,
            spin: Vec::new(),
            field: Vec::new(),
            turn: Vec::new(),
            change: Vec::new(),
        }
    }

    /// Kinetic energy ½ Σ m Θ ω² of particles of `mass` [kg], in J.
    pub(super) fn energy(&self, mass: f64) -> f64 {
        self.energy_of(&self.spin, mass)
    }

    /// Kinetic energy of particles with this microrotation [J].
    pub(super) fn energy_of(&self, spin: &[Vec3], mass: f64) -> f64 {
        0.5 * mass * f64::from(self.inertia) * par::sum(spin.len(), |i| f64::from(spin[i].norm_squared()))
    }

    /// Exchanges rotation with `v` over `dt` [s], adding at most `budget` [J] with particles of `mass` [kg]. Returns the energy [J]
    /// added to velocities and microrotation together, and whether a bound reduced the exchange.
    pub(super) fn apply(
        &mut self,
        at: Neighbourhood<'_>,
        v: &mut [Vec3],
        dt: f32,
        mass: f64,
        budget: f64,
    ) -> (f64, bool) {
        self.field.resize(v.len(), Node::default());
        self.turn.resize(v.len(), Vec3::zeros());
        self.change.resize(v.len(), Vec3::zeros());
        let Self { spin, field, turn, change, .. } = self;
        let (kernel, theta, gradient) = (at.rest.kernel, self.inertia, self.gradient);
        let wanted = self.transfer * dt;
        let exchange = wanted.min(MAX_EXCHANGE * at.rest.spacing * at.rest.spacing);
        let decay = 2.0 * exchange / theta;
        // Approach to equilibrium, as a fraction: at the end of the substep, and on average over it.
        let relaxation = -exp_m1(-decay);
        let mean = if decay > 0.0 { 1.0 - relaxation / decay } else { 0.0 };
        let smoothing = (self.viscosity * dt / self.smoothing).min(MAX_SMOOTHING);

        // Smooths ω, which has its own kernel sum, and relaxes it.
        par::fill(field, |i| Node::new(spin[i], 0.0));
        let published = &*field;
        par::for_chunks(turn, par::CHUNK, |start, turn| {
            let relaxation = 0.5 * relaxation * gradient;
            pass::run(kernel, TurnPass { at, start, spin: published, relaxation, smoothing, turn });
        });
        // The force acts with the mean of ω over the substep.
        let elapsed = if relaxation > 0.0 { mean / relaxation } else { 0.0 };
        let turns = &*turn;
        par::update(field, |i, field| *field = Node::new(field.vector() + turns[i] * elapsed, 0.0));
        let published = &*field;
        par::for_chunks(change, par::CHUNK, |start, change| {
            let exchange = exchange * gradient;
            pass::run(kernel, ForcePass { at, start, spin: published, exchange, change });
        });

        // Takes as much of the exchange as the energy allows.
        let (change, velocities, spins, theta) = (&*change, &*v, &*spin, f64::from(theta));
        let dot = |a: &Vec3, b: &Vec3| f64::from(a.dot(b));
        let linear = |i: usize| dot(&velocities[i], &change[i]) + theta * dot(&spins[i], &turns[i]);
        let square = |i: usize| dot(&change[i], &change[i]) + theta * dot(&turns[i], &turns[i]);
        let (linear, square) = (mass * par::sum(v.len(), linear), 0.5 * mass * par::sum(v.len(), square));
        let share = largest_share(linear, square, budget.max(0.0));
        par::update(v, |i, v| *v += change[i] * share as f32);
        par::update(spin, |i, spin| *spin += turns[i] * share as f32);
        (share * (linear + share * square), exchange < wanted || share < 1.0)
    }
}

/// Changes of the microrotation of a chunk of particles.
struct TurnPass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    spin: &'a [Node],
    /// Half of the approach to equilibrium, times the factor of gradients [1/m].
    relaxation: f32,
    /// Weight of the neighbours' mean.
    smoothing: f32,
    turn: &'a mut [Vec3],
}

impl NeighbourPass for TurnPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        let h = L::splat(self.at.rest.support);
        for (offset, turn) in self.turn.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.at.motion[i]);
            let own_spin = lanes::spread::<L>(self.spin[i]);
            let spin = [own_spin[0] * h, own_spin[1] * h, own_spin[2] * h];
            let (mut slip, mut mean) = ([L::splat(0.0); 3], [L::splat(0.0); 3]);
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { d, q2, q, weight, .. } = self.at.pairs::<L>(i, index);
                let other = lanes::gather::<L>(self.at.motion, index);
                let around = lanes::cross(spin, d);
                let u = [
                    other[0] - own[0] + around[0],
                    other[1] - own[1] + around[1],
                    other[2] - own[2] + around[2],
                ];
                slip = lanes::plus(slip, lanes::cross(u, d), weight * P::slope(q));
                let (apart, _) = lanes::offset(lanes::gather::<L>(self.spin, index), own_spin);
                mean = lanes::plus(mean, apart, weight * P::density(q2, q));
            }
            *turn = lanes::total(slip) * self.relaxation // ∇×v − 2ω
                + lanes::total(mean) * (self.smoothing * self.at.rest.density_scale); // ζ ∇²ω
        }
    }
}

/// Changes of the velocities of a chunk of particles.
struct ForcePass<'a> {
    at: Neighbourhood<'a>,
    start: usize,
    spin: &'a [Node],
    /// ν_t Δt, times the factor of gradients [m].
    exchange: f32,
    change: &'a mut [Vec3],
}

impl NeighbourPass for ForcePass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        for (offset, change) in self.change.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.spin[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = self.at.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let NeighbourPairs { d, q, weight, .. } = self.at.pairs::<L>(i, index);
                let (apart, _) = lanes::offset(lanes::gather::<L>(self.spin, index), own);
                sum = lanes::plus(sum, lanes::cross(apart, d), weight * P::slope(q));
            }
            *change = lanes::total(sum) * self.exchange; // Δt ν_t ∇×ω
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::Kernel,
        space::{CellGrid, Neighbours},
    };

    const SPACING: f32 = 0.05;
    const DT: f32 = 0.004;

    /// A column before and after the exchange.
    type BeforeAfter = [Vec<Vec3>; 2];

    /// Applies the exchange to a block of 13 × 13 × 13 particles, displaced by up to `jitter` spacings, without a budget of energy
    /// unless one is given. Returns positions, and velocities and spins before and after.
    fn applied(
        params: &Micropolar,
        jitter: f32,
        budget: f64,
        v: impl Fn(Vec3) -> Vec3,
        spin: impl Fn(Vec3) -> Vec3,
    ) -> (Vec<Vec3>, BeforeAfter, BeforeAfter, (f64, bool)) {
        let rest = RestState::new(Kernel::Wendland, SPACING, 2.0);
        let random =
            |k: usize| ((k as u32).wrapping_mul(2_654_435_761).rotate_left(9) >> 16) as f32 / 65536.0 - 0.5;
        let at = |k: usize| {
            let cell = Vec3::new((k % 13) as f32, (k / 13 % 13) as f32, (k / 169) as f32).add_scalar(-6.0);
            (cell + Vec3::new(random(3 * k), random(3 * k + 1), random(3 * k + 2)) * 2.0 * jitter) * SPACING
        };
        let p: Vec<Vec3> = (0..13 * 13 * 13).map(at).collect();
        let lists = Neighbours::build(&CellGrid::new(&p, rest.support), &p, rest.support);
        let nodes: Vec<Node> = p.iter().map(|&x| Node::new(x * rest.inv_support, 1.0)).collect();
        let before: Vec<Vec3> = p.iter().map(|&x| v(x)).collect();
        let motion: Vec<Node> = before.iter().map(|&v| Node::new(v, 0.0)).collect();
        let at = Neighbourhood { rest: &rest, nodes: &nodes, motion: &motion, lists: &lists };
        let mut term = Microrotation::new(params, &rest);
        term.spin = p.iter().map(|&x| spin(x)).collect();
        let (spin_before, mut after) = (term.spin.clone(), before.clone());
        let kinetic = |v: &[Vec3], term: &Microrotation| {
            v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>() + term.energy(2.0)
        };
        let first = kinetic(&before, &term);
        let report = term.apply(at, &mut after, DT, 2.0, budget);
        let gained = kinetic(&after, &term) - first;
        assert!((gained - report.0).abs() < 1e-5 * first + 1e-9, "gained {gained}, reported {}", report.0);
        (p, [before, after], [spin_before, term.spin], report)
    }

    fn params(transfer: f32, viscosity: f32) -> Micropolar {
        Micropolar { transfer, viscosity }
    }

    fn largest([before, after]: &BeforeAfter) -> f32 {
        before.iter().zip(after).map(|(a, b)| (a - b).norm()).fold(0.0, f32::max)
    }

    /// 1 at the origin, 0 from four spacings on: within them all neighbourhoods are filled.
    fn inside(x: Vec3) -> f32 {
        (1.0 - x.norm_squared() / (4.0 * SPACING).powi(2)).max(0.0).powi(2)
    }

    #[test]
    fn rigid_rotation_with_half_of_the_vorticity_is_an_equilibrium() {
        let (rotation, drift) = (Vec3::new(1.0, -2.0, 3.0), Vec3::new(5.0, 0.0, -1.0));
        for transfer in [0.5, 10.0] {
            let rigid = |x: Vec3| drift + rotation.cross(&x);
            let (_, v, spin, _) = applied(&params(transfer, 1.0), 0.3, f64::INFINITY, rigid, |_| rotation);
            assert!(largest(&v) < 1e-6, "{} m/s", largest(&v));
            assert!(largest(&spin) < 2e-5, "{} 1/s", largest(&spin));
        }
    }

    #[test]
    fn shear_spins_particles_up_to_half_of_its_vorticity() {
        // A vorticity of -4/s about y.
        let shear = |x: Vec3| Vec3::new(-4.0 * x.z, 0.0, 0.0);
        let (p, _, [_, spin], _) = applied(&params(0.5, 0.0), 0.0, f64::INFINITY, shear, |_| Vec3::zeros());
        let unit = SPACING * (STANDARD_GRAVITY * SPACING).sqrt();
        let expected = -2.0 * -(-2.0 * 0.5 * unit * DT / (SPACING * SPACING / 6.0)).exp_m1();
        let middle = p.iter().zip(&spin).find(|(x, _)| x.norm() < 0.1 * SPACING).unwrap().1;
        assert!((middle.y / expected - 1.0).abs() < 1e-3, "{middle:?}, expected {expected}");
        assert!(middle.xz().norm() < 1e-4, "{middle:?}");
    }

    #[test]
    fn inside_the_liquid_momenta_are_exchanged_and_kept() {
        // A vortex and a microrotation that end within the block: the circulation around them is zero.
        let vortex = |x: Vec3| Vec3::new(0.3, -0.2, 1.0).cross(&x) * inside(x) * 8.0;
        let spin = |x: Vec3| Vec3::new(-2.0, 5.0 * x.x / SPACING, 3.0) * inside(x);
        for (transfer, viscosity) in [(0.1, 0.0), (0.5, 0.3), (10.0, 10.0)] {
            let (p, v, spins, _) = applied(&params(transfer, viscosity), 0.0, f64::INFINITY, vortex, spin);
            let sum = |f: &dyn Fn(usize) -> Vec3| {
                (0..p.len()).map(|i| f(i).cast::<f64>()).sum::<nalgebra::Vector3<f64>>()
            };
            let change = |i: usize| v[1][i] - v[0][i];
            let speed: f64 = (0..p.len()).map(|i| f64::from(change(i).norm())).sum();
            assert!(speed > 1e-3 && sum(&change).norm() < 1e-5 * speed, "{transfer}: {:?}", sum(&change));
            let gained = sum(&|i| p[i].cross(&change(i)));
            let lost = sum(&|i| (spins[0][i] - spins[1][i]) * (SPACING * SPACING / 6.0));
            assert!(
                lost.norm() > 1e-3 && (gained - lost).norm() < 1e-3 * lost.norm(),
                "{transfer}: {gained:?} {lost:?}"
            );
        }
    }

    #[test]
    fn the_sum_of_energies_rises_by_no_more_than_the_budget() {
        // A vortex and half of its vorticity.
        let profile = |x: Vec3| 3.0 * (-20.0 * x.xy().norm_squared()).exp();
        let vortex = |x: Vec3| Vec3::new(-x.y, x.x, 0.0) * profile(x);
        let half = |x: Vec3| Vec3::new(0.0, 0.0, profile(x) * (1.0 - 20.0 * x.xy().norm_squared()));
        let run = |transfer: f32, budget: f64| applied(&params(transfer, 0.1), 0.2, budget, vortex, half).3;
        let (free, bounded) = run(0.5, f64::INFINITY);
        assert!(free > 0.0 && !bounded, "{free}");
        let (added, bounded) = run(0.5, 0.25 * free);
        assert!(bounded && (added / (0.25 * free) - 1.0).abs() < 1e-6, "{added} of {free}");
        for budget in [0.0, -1.0] {
            assert!(run(0.5, budget).0.abs() < 1e-9);
        }
        // Beyond its bound, a larger coefficient does no more.
        assert_eq!(run(10.0, f64::INFINITY), run(5.0, f64::INFINITY));
        assert!(run(10.0, f64::INFINITY).1);
        // Without transfer there is smoothing alone, which removes energy.
        let uneven = |x: Vec3| Vec3::new((90.0 * x.x).sin(), (70.0 * x.y).cos(), 0.0);
        let (lost, bounded) = applied(&params(0.0, 10.0), 0.2, 0.0, |_| Vec3::zeros(), uneven).3;
        assert!(lost < 0.0 && !bounded, "{lost}");
    }
}
