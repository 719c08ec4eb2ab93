//! The density solver: neighbour lists with a skin, densities, multipliers and corrections.
//!
//! *Method*: [pbf] Eqs. 1–2 and 8–12. An iteration has two passes over the lists: one evaluates densities and updates every
//! particle's multiplier, the other moves particles by their corrections and out of the solids. Both gather, eight
//! neighbours at a time. The update is that of a solver, in `jacobi.rs` or `accelerated.rs`.
//! *Departs from the paper*: lists reach a skin beyond h and are rebuilt when a particle has moved half of it
//! (the paper searches once a step); solids contribute density; the directions of corrections are those at positions near the
//! start of the substep ([`Directions`], docs/decisions/022). A substep corrects C less a part of what C was at its start, as
//! [baumgarte72] stabilises constraints ([`Solver::retain`]). The passes are in `density.rs` and `correction.rs`.
//!
//! Symbols: x* → `p` [m]; C_i → `error` [1]; λ_i → `lambda` [m²]; ε → `softening` [1/m²]; θ → `theta` [1].

use super::{
    SubstepParticles,
    calibration::RestState,
    correction::{CorrectionPass, CorrectionSummary, map_columns},
    density::{Chunk, DensityPass, Multiplier, MultiplierColumns, MultiplierUpdate, NoUpdate, Residual},
    lanes::{self, Node},
    pass,
    rigid::RigidSide,
    setup::{LIST_SKIN, SolverSetup},
};
use crate::{
    math::Vec3,
    par,
    space::{CellGrid, Neighbours},
};

/// Particles in a cell, over those of the seeding lattice, at which the cell is refused. Lists grow with the square of the
/// particles in one place (10 000 particles: 400 MB); with this limit a list is at most about as many times as long as the
/// 45 neighbours of the seeding lattice. At 16, a lid that closes through the floor is refused at once; a thousand g and a
/// block that hits a plate at 500 m/s in one substep stay below even that.
const MAX_CELL_OVERCROWDING: f32 = 256.0;

/// Mean κ over the squared spacing, which is p dt²/(ρ₀ spacing²), above which θ is larger than given, and from which it is 1.
/// A column of 50 layers at rest has 0.35 in substeps of 5.2 ms, and several
/// times as much when it is stopped after falling freely. With early directions throughout, the column bursts.
const DIRECTION_PRESSURE: [f32; 2] = [0.15, 0.4];

/// Largest deviation that counts for the retained part [1]: what is above, as after an impact, is corrected at once. Bulk at rest stays
/// below 2 % for every `density_dev` up to 1 %. Other values were not measured.
const MAX_RETAINED_DEVIATION: f32 = 0.02;

/// Where the directions of corrections are evaluated: at x + θ (x* − x). With θ = 1 that is x*, as in the paper.
#[derive(Clone, Copy)]
pub(super) struct Directions<'a> {
    /// θ: 0 to 1.
    pub(super) theta: f32,
    /// Positions x at the start of the substep [m].
    pub(super) x: &'a [Vec3],
}

/// Average deviations of a density solve [1].
#[derive(Clone, Copy)]
pub(super) struct Target {
    /// The iteration stops here.
    pub(super) stop: f64,
    /// A substep that ends above is counted as unconverged.
    pub(super) limit: f64,
}

/// A particle with a prescribed position at the end of the substep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pin {
    /// Index of the particle.
    pub(super) particle: u32,
    /// Its position at the end of the substep [m].
    pub(super) target: Vec3,
}

/// State of the solver within a substep.
#[derive(Debug, Default)]
pub(super) struct Solver {
    /// Predicted positions x* [m].
    pub(super) p: Vec<Vec3>,
    /// ρ_i/ρ₀ at the last evaluation.
    pub(super) ratio: Vec<f32>,
    /// Density that the free surface lacks, over ρ₀.
    deficit: Vec<f32>,
    /// Part of the tensile strength that a particle bears: 1 inside the liquid, 0 at its surface and at solids.
    pub(super) tensile_part: Vec<f32>,
    /// Part of each C that this substep does not correct; empty: none.
    pub(super) retained: Vec<f32>,
    /// Lagrange multipliers.
    pub(super) multipliers: MultiplierColumns,
    /// Positions over h, or those of the directions, and changes of λ, in the layout of neighbour sums.
    pub(super) nodes: Vec<Node>,
    /// Buffer for sorting.
    pub(super) spare: Vec<Vec3>,
    /// Positions when the lists were built.
    pub(super) built_at: Vec<Vec3>,
    /// Distances to the nearest solid when the lists were built [m].
    pub(super) clearance: Vec<f32>,
    pub(super) grid: CellGrid,
    pub(super) lists: Neighbours,
    pub(super) stale: bool,
    /// Number of times that lists were rebuilt within a substep.
    pub(super) rebuilds: u32,
    /// Number of shortened corrections.
    pub(super) shortened: u64,
    /// Particles still in contact with a solid after the last iteration.
    pub(super) unresolved_contacts: u64,
    /// Displacements by solids in this substep [m]; empty unless a solid has friction or restitution, or is a rigid body.
    pub(super) wall_push: Vec<Vec3>,
    /// The rigid bodies.
    pub(super) rigid: RigidSide,
    /// Work of moving solids in this substep, by mass over dt² [m²].
    pub(super) work: f64,
    /// Particles whose motion is prescribed, in ascending order.
    pub(super) pins: Vec<Pin>,
    /// Work of prescribed motion in this substep, by mass over dt² [m²].
    pub(super) pin_work: f64,
    /// The state before the last correction.
    pub(super) before: SavedState,
}

/// Columns of a [`Solver`] that a correction changes.
#[derive(Debug, Default)]
pub(super) struct SavedState {
    pub(super) p: Vec<Vec3>,
    pub(super) wall_push: Vec<Vec3>,
    pub(super) ratio: Vec<f32>,
    pub(super) work: f64,
    pub(super) pin_work: f64,
}

/// Radius of the lists [m].
pub(super) fn reach(rest: &RestState) -> f32 {
    rest.support * (1.0 + LIST_SKIN)
}

/// Whether a displacement since the lists were built, squared [m²], exceeds half the skin.
fn exceeds_skin(displacement2: f32, rest: &RestState) -> bool {
    let skin = LIST_SKIN * rest.support;
    4.0 * displacement2 > skin * skin
}

/// A cell with too many particles to be listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct OvercrowdedCell {
    /// Index of one of the particles.
    pub(super) particle: usize,
    /// Number of particles.
    pub(super) count: usize,
}

impl Solver {
    /// Sorts the predicted positions into the cells of the neighbour search.
    ///
    /// # Errors
    /// If a cell is overcrowded.
    pub(super) fn find_cells(&mut self, rest: &RestState) -> Result<(), OvercrowdedCell> {
        self.grid.rebuild(&self.p, reach(rest));
        let limit = MAX_CELL_OVERCROWDING * CellGrid::particles_per_cell(self.grid.cell(), rest.spacing);
        match self.grid.fullest() {
            Some((particle, count)) if count as f32 > limit => Err(OvercrowdedCell { particle, count }),
            _ => Ok(()),
        }
    }

    /// Builds the neighbour lists of the predicted positions, which are sorted into cells.
    pub(super) fn build_lists(&mut self, setup: &SolverSetup<'_>) {
        self.lists.rebuild(&self.grid, &self.p, reach(setup.rest));
        self.built_at.clone_from(&self.p);
        self.clearance.clear();
        self.clearance.resize(self.p.len(), f32::INFINITY);
        self.find_clearance(setup, |_| true);
        self.stale = false;
    }

    /// Marks the lists as stale, because particles have other indices than when they were built. Distances of pinned particles were replaced.
    pub(super) fn mark_as_stale(&mut self) {
        self.clearance.clear();
        self.stale = true;
    }

    /// As [`Solver::build_lists`], where particles and bodies have moved little since others were built.
    fn rebuild_lists(&mut self, setup: &SolverSetup<'_>) {
        let has_distances = self.clearance.len() == self.p.len();
        if setup.walls.rigid_bodies() == 0 || !has_distances {
            return self.build_lists(setup);
        }
        self.lists.rebuild(&self.grid, &self.p, reach(setup.rest));
        self.update_clearance(setup);
        self.stale = false;
    }

    /// Marks the lists as stale if a particle has moved more than half the skin since they were built.
    pub(super) fn check_skin(&mut self, rest: &RestState) {
        let (p, built_at) = (&self.p, &self.built_at);
        let farthest2 = par::max(p.len(), |i| (p[i] - built_at[i]).norm_squared());
        self.stale |= farthest2.is_some_and(|(_, farthest2)| exceeds_skin(farthest2, rest));
    }

    /// Rebuilds the lists if they are stale.
    ///
    /// # Errors
    /// See [`Solver::find_cells`].
    pub(super) fn ensure_lists(&mut self, setup: &SolverSetup<'_>) -> Result<(), OvercrowdedCell> {
        if self.stale {
            self.find_cells(setup.rest)?;
            self.rebuild_lists(setup);
            self.rebuilds += 1;
        } else if self.rigid.stale {
            self.find_clearance(setup, |x| setup.walls.may_be_near_rigid_body(x));
        }
        Ok(())
    }

    /// Evaluates the density of every particle at x*, with or without gradients, and updates the multipliers. Without
    /// gradients it uses the denominators of the last evaluation that had them.
    pub(super) fn evaluate<const GRADIENTS: bool>(
        &mut self,
        setup: &SolverSetup<'_>,
        update: &impl MultiplierUpdate,
    ) -> Residual {
        let count = self.p.len();
        self.multipliers.resize(count);
        self.publish_positions(setup.rest.inv_support);
        self.ratio.resize(count, 0.0);
        self.deficit.resize(count, 0.0);
        self.tensile_part.resize(count, 0.0);
        let Self {
            multipliers, ratio, deficit, tensile_part, retained, nodes, lists, clearance, rigid, ..
        } = self;
        let (list, published, clearance) = (&*lists, &**nodes, &**clearance);
        let (samples, _) = rigid.samples_and_projection();
        let [lambda, applied, last, denominator] = multipliers.slices_mut();
        let slices: [&mut [f32]; 7] = [ratio, deficit, tensile_part, lambda, applied, last, denominator];
        let partials = par::map_chunks_mut(slices, par::CHUNK, |start, slices| {
            let at = Chunk { setup, nodes: published, lists: list, clearance, samples, start };
            let retained = retained.get(start..).unwrap_or_default();
            let [ratio, deficit, tensile_part, lambda, applied, last, denominator] = slices;
            let multiplier = Multiplier { lambda, applied, last, denominator };
            pass::run(
                setup.rest.kernel,
                DensityPass::<_, GRADIENTS> {
                    at,
                    ratio,
                    deficit,
                    tensile_part,
                    retained,
                    multiplier,
                    update,
                },
            )
        });
        self.clear_pin_pressures();
        let Self { multipliers, nodes, .. } = self;
        let lambda = &*multipliers.0.lambda;
        par::update(nodes, |i, node| node.0[3] = lambda[i]);
        Residual::of(&partials, count)
    }

    /// Evaluates every constraint without an update, and retains nothing of it.
    pub(super) fn measure(&mut self, setup: &SolverSetup<'_>) -> Residual {
        self.retained.clear();
        self.sample_rigid_pairs(setup);
        let residual = self.evaluate::<true>(setup, &NoUpdate { lower_bound: setup.lower_bound() });
        self.rigid.discard_samples();
        residual
    }

    /// Copies positions and changes of λ into the layout of neighbour sums.
    pub(super) fn publish(&mut self, inv_h: f32) {
        self.nodes.resize(self.p.len(), Node::default());
        let (p, multipliers) = (&self.p, &self.multipliers);
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, multipliers.0.lambda[i]));
    }

    /// Copies positions into the layout of neighbour sums.
    pub(super) fn publish_positions(&mut self, inv_h: f32) {
        lanes::publish_positions(&mut self.nodes, &self.p, inv_h);
    }

    /// Copies positions and densities into the layout of neighbour sums.
    pub(super) fn publish_ratio(&mut self, inv_h: f32) {
        let (p, ratio) = (&self.p, &self.ratio);
        par::fill(&mut self.nodes, |i| Node::new(p[i] * inv_h, ratio[i]));
    }

    /// The particles for a coupled system, with their positions at the start of the substep.
    pub(super) fn particles<'a>(
        &'a mut self,
        start: &'a [Vec3],
        collide: &'a (dyn Fn(Vec3, Vec3) -> Vec3 + Sync),
    ) -> SubstepParticles<'a> {
        let Self { p, grid, built_at, rigid, .. } = self;
        let (_, projection) = rigid.samples_and_projection();
        SubstepParticles { start, predicted: p, grid, sorted_at: built_at, collide, projection }
    }

    /// Moves the positions of the neighbour sums from x* to where the directions of the next corrections are evaluated. θ
    /// rises to 1 with the mean pressure; it is one for all particles, so that a common velocity changes nothing.
    pub(super) fn evaluate_directions_at(
        &mut self,
        Directions { theta, x }: Directions<'_>,
        rest: &RestState,
    ) {
        if theta >= 1.0 {
            return;
        }
        let (p, kappa) = (&self.p, &self.multipliers.0.applied);
        let mean = par::sum(p.len(), |i| f64::from(kappa[i].abs())) / p.len() as f64;
        let [low, high] = DIRECTION_PRESSURE.map(f64::from);
        let implicit = ((mean / f64::from(rest.spacing).powi(2) - low) / (high - low)).clamp(0.0, 1.0) as f32;
        let theta = theta + (1.0 - theta) * implicit;
        par::update(&mut self.nodes, |i, node| {
            *node = Node::new((x[i] + (p[i] - x[i]) * theta) * rest.inv_support, node.value());
        });
    }

    /// Retains `part` of each compression of the last evaluation, for the next substep.
    pub(super) fn retain(&mut self, part: f32) {
        let Self { ratio, deficit, retained, .. } = self;
        retained.resize(ratio.len(), 0.0);
        par::update(retained, |i, retained| {
            *retained = part * (ratio[i] + deficit[i] - 1.0).clamp(0.0, MAX_RETAINED_DEVIATION);
        });
    }

    /// Moves every particle by its correction and out of the solids.
    pub(super) fn correct(&mut self, setup: &SolverSetup<'_>) {
        self.sample_image_pushes(setup);
        let Self { p, nodes, lists, built_at, clearance, wall_push, rigid, .. } = self;
        let (nodes, lists, clearance) = (&**nodes, &*lists, &**clearance);
        let (samples, projection) = rigid.samples_and_projection();
        let correct = |start: usize, p: &mut [Vec3], wall_push: &mut [Vec3], projection: &mut [Vec3]| {
            let built_at = &built_at[start..][..p.len()];
            let at = Chunk { setup, nodes, lists, clearance, samples, start };
            pass::run(setup.rest.kernel, CorrectionPass { at, p, built_at, wall_push, projection })
        };
        let partials = map_columns(p, wall_push, projection, correct);
        for CorrectionSummary { farthest2, shortened, unresolved_contacts, work } in partials {
            self.stale |= exceeds_skin(farthest2, setup.rest);
            self.shortened += shortened;
            self.unresolved_contacts += unresolved_contacts;
            self.work += work;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Constraint, Kernel, jacobi, walls::Walls},
        solid::{Shape, Solid},
    };

    fn evaluated(rest: &RestState, constraint: Constraint, p: Vec<Vec3>) -> Solver {
        let walls = Walls::new(&[], rest);
        let setup = SolverSetup { rest, walls: &walls, constraint, softening: 0.01 * rest.rest_gradient2 };
        let mut solver = Solver { p, ..Solver::default() };
        solver.find_cells(rest).expect("no crowd");
        solver.build_lists(&setup);
        jacobi::evaluate(&mut solver, &setup);
        solver
    }

    /// A compressed seeding lattice with jittered positions.
    fn cloud(rest: &RestState) -> Vec<Vec3> {
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
            let rest = RestState::new(kernel, spacing, radius);
            let position = |k: u32| Vec3::new((k % 9) as f32, (k / 9 % 9) as f32, (k / 81) as f32) * spacing;
            let solver = evaluated(&rest, Constraint::Equality, (0..729).map(position).collect());
            let middle = 4 + 9 * 4 + 81 * 4;
            assert!((solver.ratio[middle] - 1.0).abs() < 1e-3, "{spacing}: {}", solver.ratio[middle]);
        }
    }

    #[test]
    fn flat_free_surfaces_of_the_seeding_lattice_are_at_rest() {
        for (kernel, radius, bound) in [
            (Kernel::Wendland, 1.6, 0.011),
            (Kernel::Wendland, 2.0, 0.011),
            (Kernel::Wendland, 2.5, 0.011),
            (Kernel::Wendland, 3.0, 0.011),
            (Kernel::Poly6Spiky, 2.0, 0.011),
            (Kernel::Poly6Spiky, 3.0, 0.03),
        ] {
            let rest = RestState::new(kernel, 0.02, radius);
            let position = |k: u32| Vec3::new((k % 9) as f32, (k / 9 % 9) as f32, (k / 81) as f32) * 0.02;
            let solver = evaluated(&rest, Constraint::Compression, (0..729).map(position).collect());
            for layer in 4..9 {
                let i = 4 + 9 * 4 + 81 * layer;
                let c = solver.ratio[i] + solver.deficit[i] - 1.0;
                assert!(c.abs() < bound, "{kernel:?}, radius {radius}, layer {layer}: C = {c}");
            }
            assert!(solver.deficit[4 + 9 * 4 + 81 * 4] < 1e-6);
        }
    }

    #[test]
    fn retained_deviations_are_not_corrected_up_to_their_limit_and_are_measured() {
        let rest = RestState::new(Kernel::Wendland, 0.02, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        for (compression, expected) in [(0.997_f32, 0.5), (0.9, 0.97)] {
            let place = |k: u32| Vec3::new((k % 12) as f32, (k / 12 % 12) as f32, (k / 144) as f32) * 0.02;
            let p: Vec<Vec3> = (0..1728).map(|k| place(k) * compression).collect();
            let mut solver = evaluated(&rest, Constraint::Compression, p);
            let whole = solver.measure(&setup);
            solver.retain(0.5);
            let corrected = jacobi::evaluate(&mut solver, &setup);
            let part = corrected.average / whole.average;
            assert!((part - expected).abs() < 0.02, "{part} of {} is corrected", whole.average);
            assert_eq!(solver.measure(&setup).average.to_bits(), whole.average.to_bits());
        }
    }

    #[test]
    fn lambda_agrees_with_finite_differences() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.02, 2.0);
        let p = cloud(&rest);
        let solver = evaluated(&rest, Constraint::Equality, p.clone());
        // The constraint with the solver's gradient: Spiky instead of Poly6.
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
            let expected =
                -0.5 * f64::from(solver.ratio[i] - 1.0) / (gradient2 + 0.01 * f64::from(rest.rest_gradient2));
            let lambda = f64::from(solver.multipliers.0.lambda[i]);
            assert!((lambda / expected - 1.0).abs() < 1e-3, "{i}: {lambda}, expected {expected}");
        }
    }

    #[test]
    fn corrections_along_the_directions_at_the_start_have_no_torque() {
        let rest = RestState::new(Kernel::Wendland, 0.02, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        let p = cloud(&rest);
        // A rotation and a shear within the substep, by up to a spacing.
        let start = |p: &Vec3| p + Vec3::new(0.15 * p.y, -0.05 * p.x, 0.1 * p.x);
        let x: Vec<Vec3> = p.iter().map(start).collect();
        let torque = |theta: f32| {
            let mut solver = evaluated(&rest, Constraint::Compression, p.clone());
            solver.multipliers.0.applied.fill(0.0);
            solver.evaluate_directions_at(Directions { theta, x: &x }, &rest);
            solver.correct(&setup);
            let moved = |i: usize| (solver.p[i] - p[i]).cast::<f64>();
            let torque: nalgebra::Vector3<f64> = (0..p.len()).map(|i| x[i].cast().cross(&moved(i))).sum();
            torque.norm() / (0..p.len()).map(|i| x[i].cast::<f64>().cross(&moved(i)).norm()).sum::<f64>()
        };
        assert!(torque(0.0) < 1e-5, "{}", torque(0.0));
        assert!(torque(1.0) > 1e-3, "{}", torque(1.0));
    }

    #[test]
    fn corrections_cancel_and_reduce_the_error() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.02, 2.0);
        let walls = Walls::new(&[], &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        // Compressed so little that no correction is shortened, which would break the sum.
        let gentle = cloud(&rest).iter().map(|x| x * 1.035).collect();
        let mut solver = evaluated(&rest, Constraint::Compression, gentle);
        let sum = |p: &[Vec3]| p.iter().map(|x| x.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
        let before = sum(&solver.p);
        let first = jacobi::evaluate(&mut solver, &setup).average;
        for _ in 0..10 {
            solver.correct(&setup);
            solver.ensure_lists(&setup).expect("no crowd");
            jacobi::evaluate(&mut solver, &setup);
        }
        assert!((sum(&solver.p) - before).norm() < 1e-5 && solver.shortened == 0, "{}", solver.shortened);
        assert!(solver.measure(&setup).average < 0.1 * first);
        assert!(solver.rebuilds > 0, "a squeezed block moves farther than the skin");
    }

    #[test]
    fn a_shortened_correction_keeps_its_part_and_stays_out_of_solids() {
        let rest = RestState::new(Kernel::Wendland, 0.02, 2.0);
        let ball = Shape::Sphere { center: [0.055, 0.045, -0.03], radius: 0.03 };
        let walls = Walls::new(&[Solid::fixed(ball)], &rest);
        let setup =
            SolverSetup { rest: &rest, walls: &walls, constraint: Constraint::Compression, softening: 0.0 };
        let p: Vec<Vec3> = cloud(&rest).iter().map(|x| walls.collide(*x, *x).0).collect();
        let mut solver = Solver { p, ..Solver::default() };
        solver.find_cells(&rest).expect("no crowd");
        solver.build_lists(&setup);
        jacobi::evaluate(&mut solver, &setup);
        let (before, ratio) = (solver.p.clone(), solver.ratio.clone());
        solver.save_state();
        solver.correct(&setup);
        jacobi::evaluate(&mut solver, &setup);
        let evaluated = solver.ratio.clone();
        // One particle goes to the other side of the ball: a part of its displacement ends inside.
        let centre = Vec3::new(0.055, 0.045, -0.03);
        let outside = |x: &Vec3| ((x - centre).norm() - 0.04).abs();
        let below = (0..before.len())
            .min_by(|&i, &j| outside(&before[i]).total_cmp(&outside(&before[j])))
            .expect("it has some");
        solver.p[below] = centre - (before[below] - centre);
        let straight = before[below] + (solver.p[below] - before[below]) * 0.25;
        assert!((straight - centre).norm() < 0.03, "{straight} is outside of the ball");
        let after = solver.p.clone();
        solver.shorten_correction(0.25, &setup);
        for i in (0..before.len()).filter(|&i| i != below) {
            let expected = before[i] + (after[i] - before[i]) * 0.25;
            let is_free = walls.distance(expected) > 0.51 * rest.spacing;
            assert!(!is_free || (solver.p[i] - expected).norm() < 1e-7, "{i}");
        }
        for i in 0..ratio.len() {
            assert_eq!(solver.ratio[i], ratio[i] + (evaluated[i] - ratio[i]) * 0.25, "{i}");
        }
        for x in &solver.p {
            assert!(walls.distance(*x) > 0.49 * rest.spacing, "{x} at {}", walls.distance(*x));
        }
    }

    #[test]
    fn lists_are_stale_after_any_move_of_half_the_skin() {
        let rest = RestState::new(Kernel::Wendland, 0.02, 2.0);
        let mut solver = evaluated(&rest, Constraint::Compression, cloud(&rest));
        for (part, stale) in [(0.0, false), (0.49, false), (0.51, true)] {
            solver.p[7] = solver.built_at[7] + Vec3::new(0.0, part * LIST_SKIN * rest.support, 0.0);
            solver.check_skin(&rest);
            assert_eq!(solver.stale, stale, "{part} of the skin");
        }
    }
}
