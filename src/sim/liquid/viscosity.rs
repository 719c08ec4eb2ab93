//! Implicit viscosity.
//!
//! *Method*: [weiler18]: (1 + Δt A) v' = v by conjugate gradients without a matrix, where A is a sum over pairs of
//! forces along their line, ∝ (v_ij · x_ij) x_ij. Such forces conserve linear and angular momentum, vanish in rigid
//! motion, and leave a free surface without traction, because A is the gradient of a dissipation that is a sum over the
//! liquid alone. For incompressible motion A is −ν∇²: an isotropic mean of r̂_a r̂_b r̂_k r̂_l has 1/15 for each pairing
//! of indices, which is the paper's factor 2(d + 2) = 10 for |∇W|/r and 30 ν/Σ K r⁴ for the sum here.
//! *Departs from the paper*: another kernel, normalised by its own sum at each particle (`viscous_kernel.rs`), so that the
//! viscosity does not depend on the packing and is whole in sheets, threads and at surfaces. Solids are integrated
//! instead of sampled (`walls/no_slip.rs`). There is no preconditioner: every search direction is then a sum of pair
//! forces, and each iterate conserves momentum exactly, however early the iteration ends. The unknown is the change of
//! velocity, so that rounding scales with it. Between particles of different viscosity acts the harmonic mean of both, so that the shear
//! stress is continuous across the interface of two layers. The system is solved between two density solves (see `Liquid::substep`
//! and docs/decisions/018).
//!
//! Symbols: v_ij → `u` [m/s]; x_ij/h → `d`; Δt A → [`ViscosityPass`]; ν → `nu` [m²/s].
//! Limits: A also resists compression, with a bulk viscosity of 5/3 μ, which motion at constant density does not show. The tolerance is
//! relative to the change of all velocities, so that thin liquid next to much stiffer one is solved less precisely.

use super::{
    ImplicitViscosity, LiquidParams,
    calibration::RestState,
    lanes::{self, Node},
    pair::Pair,
    pass::{self, NeighbourPass},
    rigid_pairs::RigidPair,
    rigid_system::Lever,
    viscous_bodies::ViscousBodies,
    viscous_kernel::ViscousKernel,
    walls::{WallDrag, Walls},
};
use crate::{math::Vec3, par, simd::Lanes, solid::RigidBody, space::Neighbours};

/// The smallest sum that normalises the kernel, as a fraction of that at rest. With it, a thread of single particles
/// still has its viscosity; without it, two particles that barely touch would be welded.
const MIN_SUM: f32 = 0.125;

/// Smallest fraction of the largest viscosity in the mean of two. The weight of a pair has products of it, which below 1e-38 would
/// be zero in single precision; 1e-3 would be too large for water next to tar.
const MIN_FRACTION: f32 = 1e-12;

/// Residual over velocity below which there is nothing but rounding.
const ROUNDING: f64 = 1e-7;

/// Implicit viscosity and its buffers.
#[derive(Debug)]
pub(super) struct ViscositySolver {
    params: ImplicitViscosity,
    /// Largest kinematic viscosity [m²/s].
    nu: f32,
    /// Viscosity of each source and emitter over the largest; empty if all are equal.
    by_source: Vec<f32>,
    kernel: ViscousKernel,
    /// Resistance of the solids.
    drag: Vec<WallDrag>,
    /// Δt 30 ν/(2 S h²), half of the weight of a particle's pairs.
    weight: Vec<f32>,
    /// Search direction [m/s].
    direction: Vec<Node>,
    /// Δt A times the search direction [m/s].
    product: Vec<Vec3>,
    residual: Vec<Vec3>,
    /// Change of velocity [m/s].
    change: Vec<Vec3>,
    /// Drag on rigid bodies.
    bodies: ViscousBodies,
    /// Pressures of the first density solve of a substep, from which that of the next substep starts.
    pub(super) pressures: Vec<f32>,
}

/// What the solve reads in addition to velocities.
#[derive(Clone, Copy)]
pub(super) struct ViscousStep<'a> {
    pub(super) rest: &'a RestState,
    pub(super) walls: &'a Walls,
    pub(super) lists: &'a Neighbours,
    /// Predicted positions, from which distances to solids are taken [m].
    pub(super) p: &'a [Vec3],
    /// Distances to the nearest solid when the lists were built [m], and that from which on no solid resists.
    pub(super) clearance: &'a [f32],
    pub(super) reach: f32,
    pub(super) dt: f32,
    /// Source of each particle, if viscosities differ between them.
    pub(super) source: &'a [u32],
    /// The rigid bodies and the pairs of particles near them, which are empty without any, and the mass of a particle [kg].
    pub(super) bodies: &'a [RigidBody],
    pub(super) pairs: &'a [RigidPair],
    pub(super) mass: f64,
}

/// Report of a solve.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ViscositySolve {
    pub(super) iterations: u32,
    /// Residual over the change of velocity, both as root mean squares.
    pub(super) residual: f64,
    pub(super) converged: bool,
    /// Work of moving colliders by drag, over the mass of a particle [m²/s²].
    pub(super) work: f64,
}

impl ViscositySolver {
    /// Viscosity of a liquid with `params`, which are those of the table `viscosity`.
    pub(super) fn new(params: &ImplicitViscosity, liquid: &LiquidParams, rest: &RestState) -> Self {
        let mut by_source = liquid.viscosities();
        // A restored liquid may have no source left.
        let largest = by_source.iter().copied().reduce(f32::max).unwrap_or(params.dynamic);
        by_source.iter_mut().for_each(|viscosity| *viscosity = (*viscosity / largest).max(MIN_FRACTION));
        if by_source.iter().all(|&fraction| fraction == 1.0) {
            by_source.clear();
        }
        Self {
            params: params.clone(),
            nu: largest / liquid.density,
            by_source,
            kernel: ViscousKernel::new(rest),
            drag: Vec::new(),
            weight: Vec::new(),
            direction: Vec::new(),
            product: Vec::new(),
            residual: Vec::new(),
            change: Vec::new(),
            bodies: ViscousBodies::default(),
            pressures: Vec::new(),
        }
    }

    /// Applies viscosity to `v` at the positions over h in `nodes`, whose values receive the weights.
    pub(super) fn apply(
        &mut self,
        step: ViscousStep<'_>,
        nodes: &mut [Node],
        v: &mut [Vec3],
    ) -> ViscositySolve {
        self.assemble(&step, nodes);
        let count = v.len();
        self.direction.resize(count, Node::default());
        self.product.resize(count, Vec3::zeros());
        self.residual.resize(count, Vec3::zeros());
        self.change.resize(count, Vec3::zeros());

        // Residual of no change: Δt (A v' of the solids − A v).
        let before = &*v;
        let by_source = &self.by_source;
        let fraction = |i: usize| if by_source.is_empty() { 1.0 } else { by_source[step.source[i] as usize] };
        par::fill(&mut self.direction, |i| Node::new(before[i], fraction(i)));
        self.multiply(&step, nodes);
        self.bodies.start();
        let (drag, product) = (&self.drag, &self.product);
        par::fill(&mut self.residual, |i| drag[i].drive - product[i]);
        par::fill(&mut self.change, |_| Vec3::zeros());
        let residual = &self.residual;
        par::update(&mut self.direction, |i, d| *d = Node::new(residual[i], d.value()));

        let norm2 = |v: &[Vec3]| par::sum(v.len(), |i| v[i].iter().map(|&c| f64::from(c).powi(2)).sum());
        let rounding2 = ROUNDING.powi(2) * (norm2(v) + self.bodies.velocity2());
        let tolerance2 = f64::from(self.params.tolerance).powi(2);
        let (mut residual2, mut change2) = (norm2(&self.residual) + self.bodies.norms2()[0], 0.0);
        let mut solve = ViscositySolve::default();
        loop {
            solve.converged = residual2 <= rounding2.max(tolerance2 * change2);
            if solve.converged || solve.iterations == self.params.max_iterations || !residual2.is_finite() {
                break;
            }
            let curvature = self.multiply(&step, nodes);
            let alpha = (residual2 / curvature) as f32;
            let before2 = residual2;
            [residual2, change2] = self.advance(alpha);
            let beta = (residual2 / before2) as f32;
            let residual = &self.residual;
            par::update(&mut self.direction, |i, d| {
                *d = Node::new(residual[i] + d.vector() * beta, d.value())
            });
            self.bodies.update_direction(f64::from(beta));
            solve.iterations += 1;
        }
        if change2 > 0.0 {
            solve.residual = (residual2 / change2).sqrt();
        }
        let change = &self.change;
        par::update(v, |i, v| *v += change[i]);
        if step.walls.has_moving_solids() {
            let (v, drag) = (&*v, &self.drag);
            solve.work = par::sum(count, |i| f64::from(drag[i].work - drag[i].drive.dot(&v[i])));
        }
        solve
    }

    /// Weights of pairs and resistance of the solids.
    fn assemble(&mut self, step: &ViscousStep<'_>, nodes: &mut [Node]) {
        let Self { kernel, drag, weight, by_source, .. } = self;
        let (kernel, by_source) = (&*kernel, &*by_source);
        drag.resize(nodes.len(), WallDrag::default());
        weight.resize(nodes.len(), 0.0);
        par::fill(drag, |i| {
            if step.clearance[i] > step.reach {
                WallDrag::default()
            } else {
                step.walls.drag(step.p[i], step.dt, kernel)
            }
        });
        let (published, walls) = (&*nodes, &**drag);
        let smallest = MIN_SUM * kernel.rest_sum;
        let rate = 15.0 * self.nu * step.dt * step.rest.inv_support.powi(2);
        par::for_chunks(weight, par::CHUNK, |start, weight| {
            let lists = step.lists;
            let pass = WeightPass { smallest, nodes: published, lists, drag: walls, start, rate, weight };
            pass::run(step.rest.kernel, pass);
        });
        if !by_source.is_empty() {
            par::update(weight, |i, weight| *weight *= by_source[step.source[i] as usize]);
        }
        let weight = &*weight;
        par::update(drag, |i, drag| drag.scale(2.0 * weight[i]));
        self.bodies.assemble(step.bodies, (step.pairs, step.p), step.mass, |i, body| {
            // Particles that no solid resists, as in nozzles, have no row for it either.
            if step.clearance[i] > step.reach {
                return None;
            }
            let mut resistance = step.walls.rigid_resistance(body, step.p[i], kernel)?;
            resistance.scale(2.0 * weight[i]);
            Some(resistance)
        });
        par::update(nodes, |i, node| node.0[3] = weight[i]);
    }

    /// Multiplies the direction by Δt A. Returns the direction times (1 + Δt A) times the direction.
    fn multiply(&mut self, step: &ViscousStep<'_>, nodes: &[Node]) -> f64 {
        let Self { drag, direction, product, by_source, bodies, .. } = self;
        let (drag, direction, is_uniform) = (&**drag, &**direction, by_source.is_empty());
        let partials = par::map_chunks_mut([product.as_mut_slice()], par::CHUNK, |start, [product]| {
            let buffers = OperatorBuffers { nodes, direction, lists: step.lists, drag, start, product };
            match is_uniform {
                true => pass::run(step.rest.kernel, ViscosityPass::<true>(buffers)),
                false => pass::run(step.rest.kernel, ViscosityPass::<false>(buffers)),
            }
        });
        partials.into_iter().sum::<f64>() + bodies.multiply(|i| direction[i].vector(), product)
    }

    /// Impulses and angular impulses of the last solve on the rigid bodies, over the mass of a particle [m/s], [m²/s].
    pub(super) fn impulses(&self) -> Vec<Lever> {
        self.bodies.impulses()
    }

    /// Advances change and residual along the direction by `alpha`. Returns the squares of residual and change.
    fn advance(&mut self, alpha: f32) -> [f64; 2] {
        let Self { direction, product, residual, change, bodies, .. } = self;
        let (direction, product) = (&**direction, &**product);
        bodies.advance(f64::from(alpha));
        let slices: [&mut [Vec3]; 2] = [residual, change];
        let partials = par::map_chunks_mut(slices, par::CHUNK, |start, [residual, change]| {
            let mut sums = [0.0; 2];
            for (k, (residual, change)) in residual.iter_mut().zip(change).enumerate() {
                let d = direction[start + k].vector();
                *change += d * alpha;
                *residual -= (d + product[start + k]) * alpha;
                for (sum, v) in sums.iter_mut().zip([&*residual, &*change]) {
                    *sum += v.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>();
                }
            }
            sums
        });
        partials.into_iter().fold(bodies.norms2(), |[a, b], [c, d]| [a + c, b + d])
    }
}

/// Weight of a pair: w_i + w_j, or with viscosities of fractions f of the largest 2 (w_i f_j + w_j f_i)/(f_i + f_j).
///
/// The values of `own` and `other` are the weights w, each for the particle's own viscosity; those of `own_v` and `other_v` are the fractions. The
/// second form is that of the harmonic mean of both viscosities, which two layers in series have.
#[inline(always)]
fn pair_weight<L: Lanes, const UNIFORM: bool>(
    own: [L; 4],
    other: [L; 4],
    own_v: [L; 4],
    other_v: [L; 4],
) -> L {
    match UNIFORM {
        true => own[3] + other[3],
        false => (own[3] * other_v[3] + other[3] * own_v[3]) * L::splat(2.0) / (own_v[3] + other_v[3]),
    }
}

/// Weights of a chunk of particles.
struct WeightPass<'a> {
    /// Lower bound of the sum.
    smallest: f32,
    nodes: &'a [Node],
    lists: &'a Neighbours,
    drag: &'a [WallDrag],
    start: usize,
    /// Δt 15 ν/h².
    rate: f32,
    weight: &'a mut [f32],
}

impl NeighbourPass for WeightPass<'_> {
    type Out = ();

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) {
        for (offset, weight) in self.weight.iter_mut().enumerate() {
            let i = self.start + offset;
            let own = lanes::spread::<L>(self.nodes[i]);
            let mut sum = L::splat(0.0);
            let mut neighbours = self.lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let (_, q2) = lanes::offset(own, lanes::gather::<L>(self.nodes, index));
                sum += ViscousKernel::value(q2.sqrt()) * q2 * q2;
            }
            *weight = self.rate / (sum.sum() + self.drag[i].sum).max(self.smallest);
        }
    }
}

/// The viscous operator on a chunk of particles, whose viscosities are equal if `UNIFORM`.
struct ViscosityPass<'a, const UNIFORM: bool>(OperatorBuffers<'a>);

/// Inputs and output of the viscous operator on a chunk of particles.
struct OperatorBuffers<'a> {
    /// Positions over h, and weights.
    nodes: &'a [Node],
    /// Direction, and viscosity over the largest.
    direction: &'a [Node],
    lists: &'a Neighbours,
    drag: &'a [WallDrag],
    start: usize,
    product: &'a mut [Vec3],
}

impl<const UNIFORM: bool> NeighbourPass for ViscosityPass<'_, UNIFORM> {
    /// Direction times (1 + Δt A) times direction.
    type Out = f64;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> f64 {
        let OperatorBuffers { nodes, direction, lists, drag, start, product } = self.0;
        let mut curvature = 0.0;
        for (offset, product) in product.iter_mut().enumerate() {
            let i = start + offset;
            let own = lanes::spread::<L>(nodes[i]);
            let own_v = lanes::spread::<L>(direction[i]);
            let mut sum = [L::splat(0.0); 3];
            let mut neighbours = lists.rows::<L>(i);
            while let Some(index) = neighbours.next() {
                let other = lanes::gather::<L>(nodes, index);
                let (d, q2) = lanes::offset(own, other);
                let other_v = lanes::gather::<L>(direction, index);
                let (u, _) = lanes::offset(own_v, other_v);
                let along = u[0] * d[0] + u[1] * d[1] + u[2] * d[2];
                let weight =
                    ViscousKernel::value(q2.sqrt()) * pair_weight::<L, UNIFORM>(own, other, own_v, other_v);
                sum = lanes::plus(sum, d, along * weight); // Δt A v
            }
            let v = direction[i].vector();
            *product = lanes::total(sum) + drag[i].times(v);
            for (v, product) in v.iter().zip(product.iter()) {
                curvature += f64::from(*v) * (f64::from(*v) + f64::from(*product));
            }
        }
        curvature
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Constraint, Kernel, LiquidSource, setup::SolverSetup, solve::Solver},
        solid::{Shape, Solid},
    };

    /// Applies viscosity with Δt ν/spacing² = `number` to the velocities `motion` of a disordered block. The viscosity of
    /// every third particle is `fraction` of that.
    fn applied(
        number: f32,
        fraction: f32,
        solids: &[Solid],
        motion: impl Fn(Vec3) -> Vec3,
    ) -> (Vec<Vec3>, Vec<Vec3>, Vec<Vec3>) {
        let (spacing, dt) = (0.02_f32, 0.01);
        let rest = RestState::new(Kernel::Wendland, spacing, 2.0);
        let walls = Walls::new(solids, &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        let jitter =
            |k: u32, axis: u32| ((k * 3 + axis).wrapping_mul(2_654_435_761) >> 16) as f32 / 65536.0 - 0.5;
        let position = |k: u32| {
            let cell = Vec3::new((k % 8) as f32, (k / 8 % 8) as f32, (k / 64) as f32 + 0.5);
            (cell + Vec3::new(jitter(k, 0), jitter(k, 1), jitter(k, 2)) * 0.4) * spacing
        };
        let p: Vec<Vec3> = (0..512).map(position).collect();
        let mut solver = Solver::default();
        solver.p.clone_from(&p);
        solver.find_cells(&rest).expect("no crowd");
        solver.build_lists(&setup);
        solver.publish_positions(rest.inv_support);
        let params = ImplicitViscosity {
            dynamic: number * spacing * spacing / dt,
            tolerance: 1e-4,
            max_iterations: 1000,
        };
        let of_source = |viscosity| {
            let shape = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
            LiquidSource { shape, velocity: [0.0; 3], jitter: None, viscosity, color: None }
        };
        let liquid = LiquidParams {
            density: 1.0,
            viscosity: Some(params.clone()),
            source: vec![of_source(None), of_source(Some(fraction * params.dynamic))],
            ..LiquidParams::new(spacing)
        };
        let mut viscosity = ViscositySolver::new(&params, &liquid, &rest);
        assert_eq!(viscosity.by_source.is_empty(), fraction == 1.0);
        let source: Vec<u32> = (0..512).map(|k| u32::from(k % 3 == 0)).collect();
        let before: Vec<Vec3> = p.iter().map(|&x| motion(x)).collect();
        let mut after = before.clone();
        let Solver { nodes, lists, clearance, .. } = &mut solver;
        let reach = setup.boundary_reach();
        let step = ViscousStep {
            rest: &rest,
            walls: &walls,
            lists,
            p: &p,
            clearance,
            reach,
            dt,
            source: &source,
            bodies: &[],
            pairs: &[],
            mass: 1.0,
        };
        assert!(viscosity.apply(step, nodes, &mut after).converged);
        (p, before, after)
    }

    /// Mean momentum and angular momentum.
    fn momenta(x: &[Vec3], v: &[Vec3]) -> [nalgebra::Vector3<f64>; 2] {
        let both = || x.iter().zip(v).map(|(x, v)| (x.cast::<f64>(), v.cast::<f64>()));
        let count = x.len() as f64;
        [
            both().map(|(_, v)| v).sum::<nalgebra::Vector3<f64>>() / count,
            both().map(|(x, v)| x.cross(&v)).sum::<nalgebra::Vector3<f64>>() / count,
        ]
    }

    #[test]
    fn momenta_are_conserved_to_rounding_and_energy_falls() {
        for (number, fraction, bound) in
            [(0.01, 1.0, 2e-7), (1.0, 1.0, 2e-7), (1e4, 1.0, 2e-5), (1.0, 0.1, 2e-7), (1e4, 1e-12, 5e-5)]
        {
            let shear = |x: Vec3| Vec3::new(20.0 * x.z, (60.0 * x.x).sin(), -30.0 * x.x);
            let (x, before, after) = applied(number, fraction, &[], shear);
            for (kind, (a, b)) in momenta(&x, &before).into_iter().zip(momenta(&x, &after)).enumerate() {
                assert!((a - b).norm() < bound, "{number} and {fraction} of it, {kind}: {a:?} {b:?}");
            }
            let energy = |v: &[Vec3]| v.iter().map(|v| v.norm_squared()).sum::<f32>();
            assert!(energy(&after) < energy(&before), "{number}");
        }
    }

    #[test]
    fn rigid_motion_is_free_of_forces() {
        let rigid = |x: Vec3| Vec3::new(3.0, 0.0, 1.0) + Vec3::new(1.0, -2.0, 3.0).cross(&x);
        let (_, before, after) = applied(1e3, 0.01, &[], rigid);
        let changed = before.iter().zip(&after).map(|(a, b)| (a - b).norm()).fold(0.0, f32::max);
        assert!(changed < 1e-5, "{changed} m/s");
    }

    #[test]
    fn a_solid_at_rest_stops_a_stiff_block() {
        let floor = Solid::fixed(Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] });
        let (_, _, after) = applied(1e5, 1.0, &[floor], |_| Vec3::new(1.0, 0.0, 0.0));
        let fastest = after.iter().map(|v| v.norm()).fold(0.0, f32::max);
        assert!(fastest < 0.01, "{fastest} m/s");
    }
}
