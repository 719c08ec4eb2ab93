//! The density solver: neighbour lists with a skin, λ, Δp.
//!
//! *Method*: [pbf] Eqs. 1–2 and 8–12, Jacobi. Density and λ are one pass over the lists, Δp and collisions
//! another; both gather, eight neighbours at a time, so that the loops over lanes vectorise.
//! *Departs from the paper*: lists reach a skin beyond h and are rebuilt when a particle has moved half of it
//! (the paper searches once a step); solids add their share of density; a correction is at most half a spacing,
//! and every one that was shortened is counted; equality constraints are under-relaxed; coincident particles are
//! pushed apart along a direction made from their places, since no gradient separates them.
//!
//! Symbols: x* → `p` [m]; C_i → `error` [1]; λ_i → `Node::lambda` [m²]; ε → `softening` [1/m²].

use super::{Constraint, rest::Rest, walls::Walls};
use crate::{
    math::Vec3,
    par,
    space::{CellGrid, Neighbours},
};

/// Neighbours handled at once.
const LANES: usize = 8;

/// How far lists reach beyond h, as a fraction of h.
const SKIN: f32 = 0.1;

/// Longest correction of one iteration, in spacings: beyond it the linearised constraint and the lists mean
/// nothing. 0.1 slows the stop of a block that hits a floor; 1 lets it throw particles through their neighbours.
const LONGEST_CORRECTION: f32 = 0.5;

/// The fraction of λ taken under the equality constraint. At 1 the Jacobi iteration diverges: a filled tank at rest
/// shakes itself to its energy bound. Compression needs none, since what is pushed too far is not pulled back, and
/// there ½ leaves a 32-layer column 2.5 times as compressed.
const EQUALITY_RELAXATION: f32 = 0.5;

/// A neighbourhood counts as filled when |∇_i C_i| is below this fraction of its value on a flat free surface.
const FILLED: f32 = 0.2;

/// A predicted position and its multiplier, side by side for one load a neighbour.
#[derive(Clone, Copy, Debug, Default)]
struct Node {
    x: Vec3,
    lambda: f32,
}

/// The state of the solver within a substep.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// Predicted positions x* [m].
    pub(super) p: Vec<Vec3>,
    /// ρ_i/ρ₀ at the last evaluation.
    pub(super) ratio: Vec<f32>,
    nodes: Vec<Node>,
    /// Positions when the lists were built.
    built_at: Vec<Vec3>,
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

/// What one evaluation of the constraints found.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Residual {
    /// Mean constraint error.
    pub(super) average: f64,
    /// Largest constraint error.
    pub(super) largest: f64,
    /// Mean |C| where the neighbourhood is filled.
    pub(super) bulk: f64,
}

/// Partial sums of a [`Residual`] over one chunk.
#[derive(Clone, Copy, Default)]
struct Partial {
    sum: f64,
    largest: f64,
    bulk_sum: f64,
    bulk: u64,
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

/// One constraint and its derivatives.
struct Evaluation {
    ratio: f32,
    error: f32,
    lambda: f32,
    own_gradient: f32,
}

impl Solver {
    /// Lists neighbours of the predicted positions.
    pub(super) fn search(&mut self, rest: &Rest) {
        let reach = rest.support * (1.0 + SKIN);
        let grid = CellGrid::new(&self.p, reach);
        self.lists = Neighbours::build(&grid, &self.p, reach);
        self.built_at.clone_from(&self.p);
        self.stale = false;
    }

    /// Builds the lists again if a particle has moved too far since.
    pub(super) fn ensure_lists(&mut self, rest: &Rest) {
        if self.stale {
            self.search(rest);
            self.rebuilds += 1;
        }
    }

    /// Evaluates every constraint and its λ.
    pub(super) fn evaluate(&mut self, setup: &Setup<'_>) -> Residual {
        let count = self.p.len();
        self.nodes.resize(count, Node::default());
        self.ratio.resize(count, 0.0);
        let surface = FILLED * 1.5 * setup.rest.inv_support;
        let (p, lists) = (&self.p, &self.lists);
        let partials =
            par::map_chunks_of_two(&mut self.nodes, &mut self.ratio, par::CHUNK, |start, nodes, ratios| {
                let mut partial = Partial::default();
                for (offset, (node, ratio)) in nodes.iter_mut().zip(ratios).enumerate() {
                    let found = constraint(setup, p, start + offset, lists.of(start + offset));
                    *node = Node { x: p[start + offset], lambda: found.lambda };
                    *ratio = found.ratio;
                    partial.add(&found, found.own_gradient < surface);
                }
                partial
            });
        let total = partials.into_iter().fold(Partial::default(), Partial::and);
        Residual {
            average: total.sum / count.max(1) as f64,
            largest: total.largest,
            bulk: total.bulk_sum / total.bulk.max(1) as f64,
        }
    }

    /// Moves every particle by its Δp and out of the solids.
    pub(super) fn correct(&mut self, setup: &Setup<'_>) {
        let Self { p, nodes, lists, built_at, .. } = self;
        let (nodes, lists) = (&*nodes, &*lists);
        let any_move = setup.walls.any_move();
        let partials = par::map_chunks_of_two(p, built_at, par::CHUNK, |start, p, built_at| {
            let (mut farthest, mut shortened, mut stuck, mut work) = (0.0_f32, 0_u64, 0_u64, 0.0_f64);
            for (offset, (x, built_at)) in p.iter_mut().zip(built_at).enumerate() {
                let i = start + offset;
                let (delta, short) = limit(correction(setup, nodes, i, lists.of(i)), setup.rest.spacing);
                let (moved, touching) = setup.walls.step(*x, *x + delta); // x* + Δp, [pbf] Alg. 1, lines 14–17
                if any_move {
                    work += setup.walls.work(*x + delta, moved) + setup.walls.pressing(*x, nodes[i].lambda);
                }
                *x = moved;
                farthest = farthest.max((moved - *built_at).norm_squared());
                shortened += u64::from(short);
                stuck += u64::from(touching);
            }
            (farthest, shortened, stuck, work)
        });
        let skin = SKIN * setup.rest.support;
        for (farthest, shortened, stuck, work) in partials {
            self.stale |= 4.0 * farthest > skin * skin;
            self.shortened += shortened;
            self.stuck += stuck;
            self.work += work;
        }
    }
}

impl Partial {
    fn add(&mut self, found: &Evaluation, filled: bool) {
        let error = f64::from(found.error.abs());
        self.sum += error;
        self.largest = self.largest.max(error);
        if filled {
            self.bulk_sum += f64::from((found.ratio - 1.0).abs());
            self.bulk += 1;
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            sum: self.sum + other.sum,
            largest: self.largest.max(other.largest),
            bulk_sum: self.bulk_sum + other.bulk_sum,
            bulk: self.bulk + other.bulk,
        }
    }
}

/// Offsets from up to eight neighbours to `x`; lanes without one lie outside the support.
#[inline(always)]
fn offsets(list: &[u32], x: Vec3, far: f32, at: impl Fn(usize) -> Vec3) -> [[f32; LANES]; 3] {
    let mut d = [[far; LANES]; 3];
    for (lane, &j) in list.iter().enumerate() {
        let y = at(j as usize);
        d[0][lane] = x.x - y.x;
        d[1][lane] = x.y - y.y;
        d[2][lane] = x.z - y.z;
    }
    d
}

/// Σ over lanes, in order.
#[inline(always)]
fn total(lanes: [f32; LANES]) -> f32 {
    lanes.iter().sum()
}

/// C_i and λ_i of one particle.
#[inline]
fn constraint(setup: &Setup<'_>, p: &[Vec3], i: usize, list: &[u32]) -> Evaluation {
    let rest = setup.rest;
    let (x, inv_h) = (p[i], rest.inv_support);
    let far = 2.0 * rest.support;
    let mut density = [0.0; LANES];
    let mut gradient = [[0.0; LANES]; 3];
    let mut gradient2 = [0.0; LANES];
    let mut add = |d: [[f32; LANES]; 3]| {
        for l in 0..LANES {
            let (dx, dy, dz) = (d[0][l] * inv_h, d[1][l] * inv_h, d[2][l] * inv_h);
            let q2 = dx * dx + dy * dy + dz * dz;
            let q = q2.sqrt();
            let w = (1.0 - q2).max(0.0);
            let t = (1.0 - q).max(0.0);
            let t2 = t * t;
            let slope = t2 / q.max(1e-12);
            density[l] += w * w * w;
            gradient2[l] += t2 * t2;
            gradient[0][l] -= dx * slope;
            gradient[1][l] -= dy * slope;
            gradient[2][l] -= dz * slope;
        }
    };
    let (full, rest_of_list) = list.as_chunks::<LANES>();
    for eight in full {
        add(offsets(eight, x, far, |j| p[j]));
    }
    if !rest_of_list.is_empty() {
        add(offsets(rest_of_list, x, far, |j| p[j]));
    }
    let (share, share_gradient) = setup.walls.share(x);
    let g = rest.gradient_scale;
    let ratio = rest.density_scale * (1.0 + total(density)) + share; // ρ_i/ρ₀, [pbf] Eq. 2
    let own = Vec3::new(total(gradient[0]), total(gradient[1]), total(gradient[2])) * g + share_gradient; // [pbf] Eq. 8, k = i
    let sum = own.norm_squared() + g * g * total(gradient2); // Σ_k |∇_k C_i|²
    let (error, relaxation) = match setup.constraint {
        Constraint::Compression => ((ratio - 1.0).max(0.0), 1.0),
        Constraint::Equality => (ratio - 1.0, EQUALITY_RELAXATION), // C_i, [pbf] Eq. 1
    };
    let denominator = sum + setup.softening;
    // Without neighbours nothing can be corrected, and at ε = 0 nothing may be divided.
    let alone = denominator <= 1e-6 * rest.lattice_gradient2;
    let lambda = if alone { 0.0 } else { -relaxation * error / denominator }; // λ_i, [pbf] Eq. 11
    // A comparison drops a NaN, a maximum would too: let it through to be found.
    let error = if ratio.is_nan() { f32::NAN } else { error };
    Evaluation { ratio, error, lambda, own_gradient: own.norm() }
}

/// Δp_i of one particle.
#[inline]
fn correction(setup: &Setup<'_>, nodes: &[Node], i: usize, list: &[u32]) -> Vec3 {
    let rest = setup.rest;
    let (own, inv_h) = (nodes[i], rest.inv_support);
    let far = 2.0 * rest.support;
    let mut delta = [[0.0; LANES]; 3];
    let mut coincident = [0.0; LANES];
    let mut add = |d: [[f32; LANES]; 3], lambda: [f32; LANES]| {
        for l in 0..LANES {
            let (dx, dy, dz) = (d[0][l] * inv_h, d[1][l] * inv_h, d[2][l] * inv_h);
            let q2 = dx * dx + dy * dy + dz * dz;
            let q = q2.sqrt();
            let t = (1.0 - q).max(0.0);
            let slope = (own.lambda + lambda[l]) * (t * t / q.max(1e-12));
            delta[0][l] -= slope * dx;
            delta[1][l] -= slope * dy;
            delta[2][l] -= slope * dz;
            coincident[l] += if q2 == 0.0 { 1.0 } else { 0.0 };
        }
    };
    let lambdas = |list: &[u32]| {
        let mut lambda = [0.0; LANES];
        for (lane, &j) in list.iter().enumerate() {
            lambda[lane] = nodes[j as usize].lambda;
        }
        lambda
    };
    let (full, rest_of_list) = list.as_chunks::<LANES>();
    for eight in full {
        add(offsets(eight, own.x, far, |j| nodes[j].x), lambdas(eight));
    }
    if !rest_of_list.is_empty() {
        add(offsets(rest_of_list, own.x, far, |j| nodes[j].x), lambdas(rest_of_list));
    }
    let mut sum = Vec3::new(total(delta[0]), total(delta[1]), total(delta[2]));
    if total(coincident) > 0.0 {
        for &j in list {
            let other = nodes[j as usize];
            if (other.x - own.x).norm_squared() * inv_h * inv_h == 0.0 {
                sum -= parting(i as u32, j) * (own.lambda + other.lambda);
            }
        }
    }
    let mut delta = sum * rest.gradient_scale; // Δp_i, [pbf] Eq. 12
    if own.lambda != 0.0 {
        delta += setup.walls.share(own.x).1 * own.lambda;
    }
    delta
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

    fn evaluated(rest: &Rest, constraint: Constraint, p: Vec<Vec3>) -> Solver {
        let walls = Walls::new(&[], rest);
        let setup = Setup { rest, walls: &walls, constraint, softening: 0.01 * rest.lattice_gradient2 };
        let mut solver = Solver { p, ..Solver::default() };
        solver.search(rest);
        solver.evaluate(&setup);
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
        for (spacing, radius) in [(0.02, 2.0), (1.0, 1.6), (1e-4, 2.7), (10.0, 3.5)] {
            let rest = Rest::new(spacing, radius);
            let lattice = |k: u32| Vec3::new((k % 9) as f32, (k / 9 % 9) as f32, (k / 81) as f32) * spacing;
            let solver = evaluated(&rest, Constraint::Equality, (0..729).map(lattice).collect());
            let middle = 4 + 9 * 4 + 81 * 4;
            assert!((solver.ratio[middle] - 1.0).abs() < 1e-3, "{spacing}: {}", solver.ratio[middle]);
        }
    }

    #[test]
    fn lambda_agrees_with_finite_differences() {
        let rest = Rest::new(0.02, 2.0);
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
            let lambda = f64::from(solver.nodes[i].lambda);
            assert!((lambda / expected - 1.0).abs() < 1e-3, "{i}: {lambda}, expected {expected}");
        }
    }

    #[test]
    fn corrections_cancel_and_reduce_the_error() {
        let rest = Rest::new(0.02, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup = Setup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        let mut solver = evaluated(&rest, Constraint::Compression, cloud(&rest));
        let sum = |p: &[Vec3]| p.iter().map(|x| x.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
        let before = sum(&solver.p);
        let first = solver.evaluate(&setup).average;
        for _ in 0..10 {
            solver.correct(&setup);
            solver.ensure_lists(&rest);
            solver.evaluate(&setup);
        }
        assert!((sum(&solver.p) - before).norm() < 1e-5);
        assert!(solver.evaluate(&setup).average < 0.1 * first);
        assert!(solver.rebuilds > 0, "a squeezed block moves farther than the skin");
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
