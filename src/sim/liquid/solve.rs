//! The density solver: neighbour lists with a skin, densities, multipliers, corrections.
//!
//! *Method*: [pbf] Eqs. 1–2 and 8–12. Two passes over the lists an iteration: one evaluates densities and decides
//! every particle's change of multiplier, the other moves particles by it and out of the solids. Both gather, eight
//! neighbours at a time. What the first decides is the solver's own: `jacobi.rs` and `accelerated.rs`.
//! *Departs from the paper*: lists reach a skin beyond h and are rebuilt when a particle has moved half of it
//! (the paper searches once a step); solids add their share of density. See also `density.rs` and `correction.rs`, which
//! hold the passes.
//!
//! Symbols: x* → `p` [m]; C_i → `error` [1]; λ_i → `lambda` [m²]; ε → `softening` [1/m²].

use super::{
    SubstepParticles,
    correction::{CorrectionPass, Moved},
    density::{Chunk, Decide, DensityPass, Residual, Unknown, Unknowns, Verdict},
    lanes::Node,
    pass,
    rest::Rest,
    setup::{SKIN, Setup},
};
use crate::{
    math::Vec3,
    par,
    simd::Lanes,
    space::{CellGrid, Neighbours},
};

/// A cell with this many times the particles of the lattice is refused: where thousands share one place, their lists
/// grow with the square of their number (10 000 particles: 400 MB). With it a list is at most about as many times as
/// long as the lattice's 45. At 16, a lid that closes through the floor is refused at once; a thousand g and a block
/// that hits a plate at 500 m/s in one substep stay below even that.
const CROWDED: f32 = 256.0;

/// The state of the solver within a substep.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// Predicted positions x* [m].
    pub(super) p: Vec<Vec3>,
    /// ρ_i/ρ₀ at the last evaluation.
    pub(super) ratio: Vec<f32>,
    /// What is solved for.
    pub(super) unknowns: Unknowns,
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
    /// SubstepParticles that still touched a solid after the last round.
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

/// Decides nothing.
struct Measure {
    least: f32,
}

impl Decide for Measure {
    #[inline(always)]
    fn decide<L: Lanes>(&self, ratio: L, unknown: Unknown<L>) -> (Unknown<L>, Verdict<L>) {
        (unknown, Verdict { error: error(ratio, self.least), uphill: L::splat(0.0) })
    }
}

/// C_i, as far as it is to be corrected: at least `least`. Lets a NaN through, so that it is found.
#[inline(always)]
pub(super) fn error<L: Lanes>(ratio: L, least: f32) -> L {
    L::splat(least).max(ratio - L::splat(1.0)) // C_i, [pbf] Eq. 1
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

    /// Evaluates density, and if asked for gradients, of every particle at x* and has `decide` choose the change of λ.
    /// Without gradients it takes the denominators of the last evaluation that had them.
    pub(super) fn evaluate<const GRADIENTS: bool>(
        &mut self,
        setup: &Setup<'_>,
        decide: &impl Decide,
    ) -> Residual {
        let count = self.p.len();
        self.unknowns.resize(count);
        self.publish_positions(setup.rest.inv_support);
        self.ratio.resize(count, 0.0);
        let Self { unknowns, ratio, nodes, lists, clearance, .. } = self;
        let (list, published, clearance) = (&*lists, &**nodes, &**clearance);
        let [lambda, applied, last, denominator] = unknowns.slices_mut();
        let slices: [&mut [f32]; 5] = [ratio, lambda, applied, last, denominator];
        let partials = par::map_chunks_mut(slices, par::CHUNK, |start, slices| {
            let at = Chunk { setup, nodes: published, lists: list, clearance, start };
            let [ratio, lambda, applied, last, denominator] = slices;
            let unknown = Unknown { lambda, applied, last, denominator };
            pass::run(setup.rest.kernel, DensityPass::<_, GRADIENTS> { at, ratio, unknown, decide })
        });
        let lambda = &*unknowns.0.lambda;
        par::update(nodes, |i, node| node.0[3] = lambda[i]);
        Residual::of(&partials, count)
    }

    /// Evaluates every constraint and leaves κ and λ alone.
    pub(super) fn measure(&mut self, setup: &Setup<'_>) -> Residual {
        self.evaluate::<true>(setup, &Measure { least: setup.least() })
    }

    /// Lets neighbours read the positions and the unknowns' changes of λ.
    pub(super) fn publish(&mut self, inv_h: f32) {
        self.nodes.resize(self.p.len(), Node::default());
        let (p, unknowns) = (&self.p, &self.unknowns);
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, unknowns.0.lambda[i]));
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

    /// The particles, which began the substep at `from`, for what shares it.
    pub(super) fn particles<'a>(
        &'a mut self,
        start: &'a [Vec3],
        collide: &'a (dyn Fn(Vec3, Vec3) -> Vec3 + Sync),
    ) -> SubstepParticles<'a> {
        let Self { p, grid, built_at, .. } = self;
        SubstepParticles { start, predicted: p, grid, sorted_at: built_at, collide }
    }

    /// Moves every particle by its Δp and out of the solids.
    pub(super) fn correct(&mut self, setup: &Setup<'_>) {
        let Self { p, nodes, lists, built_at, clearance, .. } = self;
        let (nodes, lists, clearance) = (&**nodes, &*lists, &**clearance);
        let partials = par::map_chunks_mut([p.as_mut_slice()], par::CHUNK, |start, [p]| {
            let built_at = &built_at[start..][..p.len()];
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::{Constraint, Kernel, jacobi, walls::Walls};

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
            let lambda = f64::from(solver.unknowns.0.lambda[i]);
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
}
