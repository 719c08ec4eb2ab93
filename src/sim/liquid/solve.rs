//! The density solver: neighbour lists with a skin, densities, multipliers, corrections.
//!
//! *Method*: [pbf] Eqs. 1–2 and 8–12. Two passes over the lists an iteration: one evaluates densities and decides
//! every particle's change of multiplier, the other moves particles by it and out of the solids. Both gather, eight
//! neighbours at a time. What the first decides is the solver's own: `jacobi.rs` and `accelerated.rs`.
//! *Departs from the paper*: lists reach a skin beyond h and are rebuilt when a particle has moved half of it
//! (the paper searches once a step); solids add their share of density; a correction is at most half a spacing,
//! and every one that was shortened is counted; coincident particles are pushed apart along a direction made from
//! their places, since no gradient separates them.
//!
//! Symbols: x* → `p` [m]; C_i → `error` [1]; λ_i → `lambda` [m²]; ε → `softening` [1/m²].

use super::{
    Constraint,
    lanes::{self, Lanes, Node},
    pair::Pair,
    pass::{self, Pass},
    rest::Rest,
    walls::Walls,
};
use crate::{
    math::Vec3,
    par,
    space::{CellGrid, Neighbours},
};

/// How far lists reach beyond h, as a fraction of h.
const SKIN: f32 = 0.1;

/// Longest correction of one iteration, in spacings: beyond it the linearised constraint and the lists mean
/// nothing. 0.1 slows the stop of a block that hits a floor; 1 lets it throw particles through their neighbours.
const LONGEST_CORRECTION: f32 = 0.5;

/// A cell with this many times the particles of the lattice is refused: where thousands share one place, their lists
/// grow with the square of their number (10 000 particles: 400 MB). With it a list is at most about as many times as
/// long as the lattice's 45. At 16, a lid that closes through the floor is refused at once; a thousand g and a block
/// that hits a plate at 500 m/s in one substep stay below even that.
const CROWDED: f32 = 256.0;

/// A neighbourhood counts as filled when |∇_i C_i| is below this fraction of its value on a flat free surface.
const FILLED: f32 = 0.2;

/// The state of the solver within a substep.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// Predicted positions x* [m].
    pub(super) p: Vec<Vec3>,
    /// ρ_i/ρ₀ at the last evaluation.
    pub(super) ratio: Vec<f32>,
    /// What is solved for.
    pub(super) unknowns: Vec<Unknown>,
    /// Positions over h and changes of λ, as neighbours read them.
    pub(super) nodes: Vec<Node>,
    /// Room to sort in.
    pub(super) spare: Vec<Vec3>,
    /// Positions when the lists were built.
    built_at: Vec<Vec3>,
    /// Distances to the nearest solid then [m].
    clearance: Vec<f32>,
    pub(super) grid: CellGrid,
    pub(super) lists: Neighbours,
    stale: bool,
    /// Times the lists were rebuilt within a substep.
    pub(super) rebuilds: u32,
    /// Corrections shortened.
    pub(super) shortened: u64,
    /// Particles that still touched a solid after the last round.
    pub(super) stuck: u64,
    /// What moving solids did in this substep, by mass over dt² [m²].
    pub(super) work: f64,
}

/// How far lists reach [m].
fn reach(rest: &Rest) -> f32 {
    rest.support * (1.0 + SKIN)
}

/// Whether a way since the lists were built, squared [m²], may have led out of them.
fn outruns(way2: f32, rest: &Rest) -> bool {
    let skin = SKIN * rest.support;
    4.0 * way2 > skin * skin
}

/// More particles in one cell than are listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Crowd {
    /// The index of one of them.
    pub(super) particle: usize,
    /// How many there are.
    pub(super) count: usize,
}

/// A particle's multiplier, as its solver keeps it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unknown {
    /// The change of λ that the last evaluation decided [m²].
    pub(super) lambda: f32,
    /// κ that positions have been moved by [m²]; the accelerated solver's, like the following.
    pub(super) applied: f32,
    /// κ before extrapolation [m²].
    pub(super) last: f32,
    /// D + ε [1/m²].
    pub(super) denominator: f32,
}

/// What a solver says of one particle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Verdict {
    /// The constraint's error [1].
    pub(super) error: f32,
    /// How far momentum leads uphill: the part of the sum whose sign asks for a restart.
    pub(super) uphill: f32,
}

/// What one evaluation of the constraints found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Residual {
    /// Mean constraint error.
    pub(super) average: f64,
    /// Largest constraint error.
    pub(super) largest: f64,
    /// Mean |C| where the neighbourhood is filled.
    pub(super) bulk: f64,
    /// Σ of [`Verdict::uphill`].
    pub(super) uphill: f64,
}

/// Partial sums of a [`Residual`] over one chunk.
#[derive(Clone, Copy, Default)]
struct Partial {
    sum: f64,
    largest: f64,
    bulk_sum: f64,
    bulk: u64,
    uphill: f64,
}

/// What the solver needs to know besides the particles.
#[derive(Clone, Copy, Debug)]
pub(super) struct Setup<'a> {
    pub(super) rest: &'a Rest,
    pub(super) walls: &'a Walls,
    pub(super) constraint: Constraint,
    /// ε [1/m²].
    pub(super) softening: f32,
}

/// A particle's density and its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Density {
    /// ρ_i/ρ₀.
    pub(super) ratio: f32,
    /// |∇_i C_i| [1/m].
    pub(super) own_gradient: f32,
    /// Σ_k |∇_k C_i|² [1/m²].
    pub(super) gradient2: f32,
}

impl Setup<'_> {
    /// C_i, as far as it is to be corrected.
    #[inline(always)]
    pub(super) fn error(&self, ratio: f32) -> f32 {
        match self.constraint {
            // Written so that a NaN gets through and is found.
            Constraint::Compression if ratio < 1.0 => 0.0,
            _ => ratio - 1.0, // C_i, [pbf] Eq. 1
        }
    }

    /// Σ_k |∇_k C_i|² + ε [1/m²]; infinite without neighbours, where nothing can be corrected, and at ε = 0
    /// nothing may be divided.
    #[inline(always)]
    pub(super) fn denominator(&self, gradient2: f32) -> f32 {
        let denominator = gradient2 + self.softening;
        if denominator <= 1e-6 * self.rest.lattice_gradient2 { f32::INFINITY } else { denominator }
    }
}

impl Solver {
    /// Sorts the predicted positions into the cells of the lists.
    ///
    /// # Errors
    /// If too many share a cell to be listed.
    pub(super) fn find_cells(&mut self, rest: &Rest) -> Result<(), Crowd> {
        self.grid.rebuild(&self.p, reach(rest));
        let most = CROWDED * CellGrid::lattice_share(self.grid.cell(), rest.spacing);
        match self.grid.fullest() {
            Some((particle, count)) if count as f32 > most => Err(Crowd { particle, count }),
            _ => Ok(()),
        }
    }

    /// Lists neighbours of the predicted positions, which the grid knows.
    pub(super) fn list(&mut self, setup: &Setup<'_>) {
        self.lists.rebuild(&self.grid, &self.p, reach(setup.rest));
        self.built_at.clone_from(&self.p);
        self.clearance.resize(self.p.len(), 0.0);
        let p = &self.p;
        par::fill(&mut self.clearance, |i| setup.walls.distance(p[i]));
        self.stale = false;
    }

    /// Finds out whether a particle has moved too far for the lists, after something else than the solver moved them.
    pub(super) fn notice_moves(&mut self, rest: &Rest) {
        let (p, built_at) = (&self.p, &self.built_at);
        let farthest2 = par::max(p.len(), |i| (p[i] - built_at[i]).norm_squared());
        self.stale |= farthest2.is_some_and(|(_, farthest2)| outruns(farthest2, rest));
    }

    /// Builds the lists again if a particle has moved too far since.
    ///
    /// # Errors
    /// As [`Solver::find_cells`].
    pub(super) fn ensure_lists(&mut self, setup: &Setup<'_>) -> Result<(), Crowd> {
        if self.stale {
            self.find_cells(setup.rest)?;
            self.list(setup);
            self.rebuilds += 1;
        }
        Ok(())
    }

    /// Evaluates density and gradients of every particle at x* and has `decide` choose the change of λ.
    pub(super) fn evaluate(
        &mut self,
        setup: &Setup<'_>,
        decide: impl Fn(&mut Unknown, Density) -> Verdict + Sync,
    ) -> Residual {
        self.evaluate_as::<true>(setup, decide)
    }

    /// Evaluates every constraint and leaves the unknowns alone.
    pub(super) fn measure(&mut self, setup: &Setup<'_>) -> Residual {
        self.evaluate(setup, |_, density| Verdict { error: setup.error(density.ratio), uphill: 0.0 })
    }

    /// [`Solver::evaluate`] without the gradients, which are left zero.
    pub(super) fn evaluate_density(
        &mut self,
        setup: &Setup<'_>,
        decide: impl Fn(&mut Unknown, Density) -> Verdict + Sync,
    ) -> Residual {
        self.evaluate_as::<false>(setup, decide)
    }

    fn evaluate_as<const GRADIENTS: bool>(
        &mut self,
        setup: &Setup<'_>,
        decide: impl Fn(&mut Unknown, Density) -> Verdict + Sync,
    ) -> Residual {
        let count = self.p.len();
        self.unknowns.resize(count, Unknown::default());
        self.publish_positions(setup.rest.inv_support);
        self.ratio.resize(count, 0.0);
        let Self { unknowns, ratio, nodes, lists, clearance, .. } = self;
        let (list, published, clearance) = (&*lists, &**nodes, &**clearance);
        let partials = par::map_chunks_of_two(unknowns, ratio, par::CHUNK, |start, unknowns, ratios| {
            let at = Chunk { setup, nodes: published, lists: list, clearance, start };
            pass::run(
                setup.rest.kernel,
                DensityPass::<_, GRADIENTS> { at, unknowns, ratios, decide: &decide },
            )
        });
        let unknowns = &*unknowns;
        par::update(nodes, |i, node| node.0[3] = unknowns[i].lambda);
        let total = partials.into_iter().fold(Partial::default(), Partial::and);
        Residual {
            average: total.sum / count.max(1) as f64,
            largest: total.largest,
            bulk: total.bulk_sum / total.bulk.max(1) as f64,
            uphill: total.uphill,
        }
    }

    /// Lets neighbours read the positions and the unknowns' changes of λ.
    pub(super) fn publish(&mut self, inv_h: f32) {
        self.nodes.resize(self.p.len(), Node::default());
        let (p, unknowns) = (&self.p, &self.unknowns);
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, unknowns[i].lambda));
    }

    /// Lets neighbours read the positions.
    pub(super) fn publish_positions(&mut self, inv_h: f32) {
        self.nodes.resize(self.p.len(), Node::default());
        let p = &self.p;
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, 0.0));
    }

    /// Lets neighbours read the positions and densities.
    pub(super) fn publish_ratio(&mut self, inv_h: f32) {
        let (p, ratio) = (&self.p, &self.ratio);
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, ratio[i]));
    }

    /// Moves every particle by its Δp and out of the solids.
    pub(super) fn correct(&mut self, setup: &Setup<'_>) {
        let Self { p, nodes, lists, built_at, clearance, .. } = self;
        let (nodes, lists, clearance) = (&**nodes, &*lists, &**clearance);
        let partials = par::map_chunks_of_two(p, built_at, par::CHUNK, |start, p, built_at| {
            let at = Chunk { setup, nodes, lists, clearance, start };
            pass::run(setup.rest.kernel, CorrectionPass { at, p, built_at })
        });
        for Moved { farthest2, shortened, stuck, work } in partials {
            self.stale |= outruns(farthest2, setup.rest);
            self.shortened += shortened;
            self.stuck += stuck;
            self.work += work;
        }
    }
}

impl Partial {
    fn add(&mut self, ratio: f32, verdict: Verdict, filled: bool) {
        let error = f64::from(verdict.error.abs());
        self.sum += error;
        self.uphill += f64::from(verdict.uphill);
        self.largest = self.largest.max(error);
        if filled {
            self.bulk_sum += f64::from((ratio - 1.0).abs());
            self.bulk += 1;
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            largest: self.largest.max(other.largest),
            bulk_sum: self.bulk_sum + other.bulk_sum,
            bulk: self.bulk + other.bulk,
            uphill: self.uphill + other.uphill,
        }
    }
}

/// The particles that a chunk's passes read.
#[derive(Clone, Copy)]
struct Chunk<'a> {
    setup: &'a Setup<'a>,
    nodes: &'a [Node],
    lists: &'a Neighbours,
    clearance: &'a [f32],
    /// Index of the chunk's first particle.
    start: usize,
}

/// Evaluates a chunk of densities.
struct DensityPass<'a, F, const GRADIENTS: bool> {
    at: Chunk<'a>,
    unknowns: &'a mut [Unknown],
    ratios: &'a mut [f32],
    decide: F,
}

impl<F: Fn(&mut Unknown, Density) -> Verdict, const GRADIENTS: bool> Pass for DensityPass<'_, F, GRADIENTS> {
    type Out = Partial;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> Partial {
        let mut partial = Partial::default();
        let surface = FILLED * 1.5 * self.at.setup.rest.inv_support;
        for (offset, (unknown, ratio)) in self.unknowns.iter_mut().zip(self.ratios).enumerate() {
            let density = density::<L, P, GRADIENTS>(&self.at, self.at.start + offset);
            *ratio = density.ratio;
            partial.add(density.ratio, (self.decide)(unknown, density), density.own_gradient < surface);
        }
        partial
    }
}

/// ρ_i and, if asked for, its gradients.
#[inline(always)]
fn density<L: Lanes, P: Pair, const GRADIENTS: bool>(at: &Chunk<'_>, i: usize) -> Density {
    let rest = at.setup.rest;
    let (own, zero) = (lanes::spread::<L>(at.nodes[i]), L::splat(0.0));
    let (mut density, mut gradient, mut gradient2) = (zero, [zero; 3], zero);
    let mut neighbours = lanes::eights::<L>(at.lists, i);
    // What fills up the last eight counts as 1 each, like the particle itself.
    let itself = 1.0 - neighbours.padded();
    while let Some(index) = neighbours.next() {
        let (d, q2) = lanes::offset(own, L::gather(at.nodes, index));
        let q = q2.sqrt();
        density = density + P::density(q2, q);
        if GRADIENTS {
            let slope = P::slope(q);
            gradient2 = gradient2 + slope * slope * q2;
            gradient = lanes::plus(gradient, d, slope);
        }
    }
    let (share, share_gradient) = at.share(i, at.nodes[i].vector() * rest.support);
    let ratio = rest.density_scale * (density.sum() + itself) + share; // ρ_i/ρ₀, [pbf] Eq. 2
    if !GRADIENTS {
        return Density { ratio, own_gradient: 0.0, gradient2: 0.0 };
    }
    let g = rest.gradient_scale;
    let own_gradient = lanes::total(gradient) * -g + share_gradient; // [pbf] Eq. 8, k = i
    let gradient2 = own_gradient.norm_squared() + g * g * gradient2.sum(); // Σ_k |∇_k C_i|²
    Density { ratio, own_gradient: own_gradient.norm(), gradient2 }
}

impl Chunk<'_> {
    /// The solids' share at `x`, where the lists do not rule it out.
    #[inline(always)]
    fn share(&self, i: usize, x: Vec3) -> (f32, Vec3) {
        let rest = self.setup.rest;
        let reach = rest.support + rest.wall_shift.abs() + SKIN * rest.support;
        if self.clearance[i] > reach { (0.0, Vec3::zeros()) } else { self.setup.walls.share(x) }
    }
}

/// What a chunk's corrections did.
#[derive(Clone, Copy, Default)]
struct Moved {
    /// The longest way from where the lists were built, squared [m²].
    farthest2: f32,
    shortened: u64,
    stuck: u64,
    /// What moving solids did, by mass over dt² [m²].
    work: f64,
}

/// Moves a chunk of particles.
struct CorrectionPass<'a> {
    at: Chunk<'a>,
    p: &'a mut [Vec3],
    built_at: &'a [Vec3],
}

impl Pass for CorrectionPass<'_> {
    type Out = Moved;

    #[inline(always)]
    fn run<L: Lanes, P: Pair>(self) -> Moved {
        let (mut total, setup) = (Moved::default(), self.at.setup);
        let (contact, any_move) = (0.5 * setup.rest.spacing, setup.walls.any_move());
        for (offset, (x, built_at)) in self.p.iter_mut().zip(self.built_at).enumerate() {
            let i = self.at.start + offset;
            let (delta, short) = limit(correction::<L, P>(&self.at, i, *x), setup.rest.spacing);
            let mut moved = *x + delta; // x* + Δp, [pbf] Alg. 1, line 17
            let mut way2 = (moved - built_at).norm_squared();
            let room = self.at.clearance[i] - contact;
            if room <= 0.0 || way2 >= room * room {
                let (free, touching) = setup.walls.step(*x, moved); // [pbf] Alg. 1, line 14
                if any_move {
                    total.work += setup.walls.work(moved, free);
                }
                moved = free;
                way2 = (moved - built_at).norm_squared();
                total.stuck += u64::from(touching);
            }
            if any_move {
                total.work += setup.walls.pressing(*x, self.at.nodes[i].value());
            }
            *x = moved;
            total.farthest2 = total.farthest2.max(way2);
            total.shortened += u64::from(short);
        }
        total
    }
}

/// Δp_i of one particle.
#[inline(always)]
fn correction<L: Lanes, P: Pair>(at: &Chunk<'_>, i: usize, x: Vec3) -> Vec3 {
    let rest = at.setup.rest;
    let node = at.nodes[i];
    let (own, zero) = (lanes::spread::<L>(node), L::splat(0.0));
    let (mut delta, mut coincident) = ([zero; 3], zero);
    let mut neighbours = lanes::eights::<L>(at.lists, i);
    let padded = neighbours.padded();
    while let Some(index) = neighbours.next() {
        let other = L::gather(at.nodes, index);
        let (d, q2) = lanes::offset(own, other);
        let weight = (own[3] + other[3]) * P::slope(q2.sqrt());
        delta = lanes::plus(delta, d, weight);
        coincident = coincident + q2.is_zero();
    }
    let mut sum = -lanes::total(delta);
    if coincident.sum() > padded {
        sum += parted(at, i);
    }
    let mut delta = sum * rest.gradient_scale; // Δp_i, [pbf] Eq. 12
    if node.value() != 0.0 {
        delta += at.share(i, x).1 * node.value();
    }
    delta
}

/// What the neighbours in the particle's very place add to the sum of [`correction`].
#[cold]
fn parted(at: &Chunk<'_>, i: usize) -> Vec3 {
    let own = at.nodes[i];
    let mut sum = Vec3::zeros();
    for &j in at.lists.of(i) {
        let other = at.nodes[j as usize];
        let d = own.vector() - other.vector();
        if d.norm_squared() == 0.0 {
            sum -= parting(i as u32, j) * (own.value() + other.value());
        }
    }
    sum
}

/// The unit direction in which particle `i` leaves a coincident `j`; opposite for the other of the pair.
fn parting(i: u32, j: u32) -> Vec3 {
    let (low, high) = (i.min(j), i.max(j));
    let mut bits = (u64::from(low) << 32 | u64::from(high)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits ^= bits >> 29;
    bits = bits.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let part = |shift: u32| ((bits >> shift & 0xffff) as f32 + 0.5) / 32768.0 - 1.0;
    let direction = Vec3::new(part(0), part(16), part(32)).normalize();
    if i < j { direction } else { -direction }
}

/// `delta` at most [`LONGEST_CORRECTION`] long, and whether it had to be shortened.
#[inline]
pub(super) fn limit(delta: Vec3, spacing: f32) -> (Vec3, bool) {
    let longest = LONGEST_CORRECTION * spacing;
    let length2 = delta.norm_squared();
    if length2 > longest * longest { (delta * (longest / length2.sqrt()), true) } else { (delta, false) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::{Kernel, jacobi};

    fn evaluated(rest: &Rest, constraint: Constraint, p: Vec<Vec3>) -> Solver {
        let walls = Walls::new(&[], rest);
        let setup = Setup { rest, walls: &walls, constraint, softening: 0.01 * rest.lattice_gradient2 };
        let mut solver = Solver { p, ..Solver::default() };
        solver.find_cells(rest).expect("no crowd");
        solver.list(&setup);
        jacobi::evaluate(&mut solver, &setup);
        solver
    }

    /// A squeezed lattice with every particle off its place.
    fn cloud(rest: &Rest) -> Vec<Vec3> {
        let jitter =
            |k: u32, axis: u32| ((k * 3 + axis).wrapping_mul(2_654_435_761) >> 16) as f32 / 65536.0 - 0.5;
        (0..216_u32)
            .map(|k| {
                let cell = Vec3::new((k % 6) as f32, (k / 6 % 6) as f32, (k / 36) as f32) * 0.94;
                (cell + Vec3::new(jitter(k, 0), jitter(k, 1), jitter(k, 2)) * 0.2) * rest.spacing
            })
            .collect()
    }

    #[test]
    fn the_seeding_lattice_is_at_rest() {
        for (kernel, spacing, radius) in [
            (Kernel::Poly6Spiky, 0.02, 2.0),
            (Kernel::Poly6Spiky, 1.0, 1.6),
            (Kernel::Wendland, 1e-4, 2.7),
            (Kernel::Wendland, 10.0, 3.5),
        ] {
            let rest = Rest::new(kernel, spacing, radius);
            let lattice = |k: u32| Vec3::new((k % 9) as f32, (k / 9 % 9) as f32, (k / 81) as f32) * spacing;
            let solver = evaluated(&rest, Constraint::Equality, (0..729).map(lattice).collect());
            let middle = 4 + 9 * 4 + 81 * 4;
            assert!((solver.ratio[middle] - 1.0).abs() < 1e-3, "{spacing}: {}", solver.ratio[middle]);
        }
    }

    #[test]
    fn lambda_agrees_with_finite_differences() {
        let rest = Rest::new(Kernel::Poly6Spiky, 0.02, 2.0);
        let p = cloud(&rest);
        let solver = evaluated(&rest, Constraint::Equality, p.clone());
        // The constraint whose gradient the solver takes: Spiky in place of Poly6.
        let spiky = |i: usize, k: usize, moved: nalgebra::Vector3<f64>| {
            let at = |j: usize| p[j].cast::<f64>() + if j == k { moved } else { nalgebra::Vector3::zeros() };
            let term = |j: usize| (1.0 - (at(i) - at(j)).norm() / f64::from(rest.support)).max(0.0).powi(3);
            let sum: f64 = (0..p.len()).filter(|&j| j != i).map(term).sum();
            f64::from(rest.gradient_scale) * f64::from(rest.support) / 3.0 * sum
        };
        for i in [0, 100, 130, 215] {
            let mut gradient2 = 0.0;
            for k in 0..p.len() {
                for axis in 0..3 {
                    let e = nalgebra::Vector3::ith(axis, 1e-6);
                    gradient2 += ((spiky(i, k, e) - spiky(i, k, -e)) / 2e-6).powi(2);
                }
            }
            let expected = -0.5 * f64::from(solver.ratio[i] - 1.0)
                / (gradient2 + 0.01 * f64::from(rest.lattice_gradient2));
            let lambda = f64::from(solver.unknowns[i].lambda);
            assert!((lambda / expected - 1.0).abs() < 1e-3, "{i}: {lambda}, expected {expected}");
        }
    }

    #[test]
    fn corrections_cancel_and_reduce_the_error() {
        let rest = Rest::new(Kernel::Poly6Spiky, 0.02, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup = Setup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        let mut solver = evaluated(&rest, Constraint::Compression, cloud(&rest));
        let sum = |p: &[Vec3]| p.iter().map(|x| x.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
        let before = sum(&solver.p);
        let first = jacobi::evaluate(&mut solver, &setup).average;
        for _ in 0..10 {
            solver.correct(&setup);
            solver.ensure_lists(&setup).expect("no crowd");
            jacobi::evaluate(&mut solver, &setup);
        }
        assert!((sum(&solver.p) - before).norm() < 1e-5);
        assert!(solver.measure(&setup).average < 0.1 * first);
        assert!(solver.rebuilds > 0, "a squeezed block moves farther than the skin");
    }

    #[test]
    fn lists_are_stale_after_any_move_of_half_the_skin() {
        let rest = Rest::new(Kernel::Wendland, 0.02, 2.0);
        let mut solver = evaluated(&rest, Constraint::Compression, cloud(&rest));
        for (way, stale) in [(0.0, false), (0.49, false), (0.51, true)] {
            solver.p[7] = solver.built_at[7] + Vec3::new(0.0, way * SKIN * rest.support, 0.0);
            solver.notice_moves(&rest);
            assert_eq!(solver.stale, stale, "{way} of the skin");
        }
    }

    #[test]
    fn a_pair_in_one_place_parts_in_opposite_directions() {
        assert_eq!(parting(3, 8), -parting(8, 3));
        assert!((parting(0, 1).norm() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn long_corrections_are_shortened_and_reported() {
        let (delta, short) = limit(Vec3::new(3.0, 4.0, 0.0), 1.0);
        assert!(short && (delta.norm() - 0.5).abs() < 1e-6);
        assert_eq!(limit(Vec3::new(0.3, 0.0, 0.0), 1.0), (Vec3::new(0.3, 0.0, 0.0), false));
    }
}
