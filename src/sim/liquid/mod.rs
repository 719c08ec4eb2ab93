//! Position based fluid ([pbf]).
//!
//! *Method*: [pbf] Algorithm 1, once per time step; `substep` below reads as the paper's listing.
//! *Departs from the paper*: see the files of the parts (`calibration`, `solve`, `walls`, `repulsion`, `vorticity`,
//! `micropolar`, `xsph`). The length of a time step follows a CFL rule. Predicted positions are projected out of the solids
//! before the search, so that the lists hold a particle's neighbours at its final position. Under gravity the last correction is
//! shortened so that the deviation ends at its target, which grows in the first substeps of a shot. A substep retains a part of the
//! deviation that it starts with. Without gravity and tension, or with `jitter`, the deviations of the seeded positions are corrected first.
//! All of this is in docs/decisions/022 and 044.
//!
//! Symbols: x_i → `x` [m]; v_i → `v` [m/s]; x* → `Solver::p` [m]; Δt → `dt` [s].
//! Limits: first order in time; positions are single precision, so the motion loses digits far from the origin
//! (at 1 km, 0.06 mm).

mod accelerated;
mod bodies;
mod calibration;
mod columns;
mod contact;
mod correction;
mod coupled;
mod coupled_contacts;
mod density;
mod density_map;
mod depth;
mod drain;
mod emit;
mod energy;
mod energy_bound;
mod faults;
mod flow;
mod force_field;
mod forced;
mod forces;
mod images;
pub(in crate::sim) mod inflow;
mod jacobi;
mod jitter;
#[cfg(feature = "presets")]
pub(crate) mod job;
mod lanes;
#[cfg(test)]
mod laplace;
mod measures;
mod micropolar;
mod neighbourhood;
mod outflow;
mod pair;
mod params;
mod pass;
mod pins;
mod record;
mod relaxation;
mod repulsion;
mod rigid;
mod rigid_pairs;
mod rigid_pressure;
mod rigid_system;
mod seed;
mod setup;
mod shorten;
mod solve;
mod sparse;
mod state;
mod submerged;
mod surface_tension;
mod target;
mod viscosity;
mod viscous_bodies;
mod viscous_kernel;
mod vorticity;
mod walls;
mod xsph;

pub(super) use coupled::{CoupledSystem, Partners, Pushed, SubstepParticles};
pub use inflow::{FrameRange, LiquidDomain, LiquidEmitter, LiquidOutflow, RateKeyframe, Side};
pub use params::{
    ArtificialPressure, Constraint, ImplicitViscosity, Kernel, LiquidChannel, LiquidParams, LiquidSource,
    Micropolar, SolverKind, SurfaceTension, VorticityConfinement, Xsph,
};
pub use record::{
    Clamps, EmptySource, FlowRecord, FlowTotals, LiquidRecord, LiquidSeeds, NozzleReport, SubmergedBody,
    ThinSolid,
};
pub(super) use rigid::CoupledBodies;

use super::{
    Diverged, Stop, Watch,
    clock::{Clock, Seconds},
    substep::advance_frame,
};
use crate::{math::Vec3, par};
use accelerated::Momentum;
use calibration::RestState;
use coupled::reborrow;
use energy::energy;
use force_field::ForceField;
use inflow::Inflow;
use lanes::Node;
use measures::Particles;
use micropolar::Microrotation;
use neighbourhood::Neighbourhood;
use outflow::Outflow;
use record::FRAME_FIGURES;
use repulsion::Repulsion;
use setup::SolverSetup;
use solve::{Directions, Solver, Target};
use surface_tension::Tension;
use viscosity::{ViscositySolver, ViscousStep};
use vorticity::Confinement;
use walls::Walls;

/// Name of the system and of its stream.
pub const NAME: &str = "liquid";

/// Fewest iterations of a substep, even if the target is met. With 0, errors below the target accumulate until one substep
/// corrects them at once and throws the liquid apart; with 1, a dam break still gains 1 to 5 % of energy.
const MIN_ITERATIONS: u32 = 2;

/// Iterations of a substep after which directions are those at x*, whatever [`LiquidParams::implicitness`]. So many are
/// needed by deep liquid that is stopped after falling: without this limit a column of 100 layers bursts at a deviation of 0.3 %.
const MAX_EARLY_ITERATIONS: u32 = 20;

/// Deviation over that at which the iteration stops, up to which a correction is shortened if it would lead below. The deviation at the end
/// of each substep is then the same, and a pool at rest does not breathe: 0.3 mm/s instead of up to 9. An iteration far above leaves more
/// than half of the deviation.
const MAX_INTERPOLATED_DEVIATION: f64 = 2.0;

/// Corrections of a solve from which the last is shortened. Where fewer do, the iteration ends below its target as often as it is
/// shortened, and a pool bounces.
const MIN_SHORTENED: u32 = 4;

/// A liquid and its current state.
#[derive(Debug)]
pub(super) struct Liquid {
    params: LiquidParams,
    rest: RestState,
    walls: Walls,
    gravity: Vec3,
    /// Force fields; `None`: there are none.
    forces: Option<Box<ForceField>>,
    /// Mass of a particle [kg].
    mass: f64,
    /// Mechanical and surface energy at the start of the shot and the work of moving solids and sheets since [J], which
    /// confinement or the micropolar exchange may restore.
    first_energy: f64,
    /// [`FRAME_FIGURES`] of the last frame; `None` in the first.
    figures: Option<[f64; FRAME_FIGURES.len()]>,
    seeded: LiquidSeeds,
    /// Whether frames have the channels `source` and, with emitters, `birth`.
    has_sources: bool,
    has_births: bool,
    /// Number of the source or emitter of each particle, and the time at which it entered [s]; empty without the channels.
    source: Vec<u32>,
    birth: Vec<f32>,
    id: Vec<u32>,
    /// Id of the next particle that enters.
    next_id: u32,
    /// One more than the column of the nozzle that a particle is in, and zero outside; empty without emitters.
    nozzle: Vec<u32>,
    inflow: Option<Inflow>,
    outflow: Option<Outflow>,
    /// Particles that have entered and left since the shot's start.
    flow_totals: FlowTotals,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    solver: Solver,
    momentum: Momentum,
    repulsion: Option<Repulsion>,
    tension: Option<Tension>,
    /// Velocities before the density solve; `None` unless a solid has friction or restitution.
    v_before: Option<Vec<Vec3>>,
    viscosity: Option<ViscositySolver>,
    confinement: Option<Confinement>,
    microrotation: Option<Microrotation>,
    /// Velocities in the layout of neighbour sums; empty unless a term needs them.
    motion: Vec<Node>,
}

impl Liquid {
    /// Report of the seeding.
    pub(super) fn seeded(&self) -> LiquidSeeds {
        self.seeded.clone()
    }

    /// The passes of a substep, in order.
    pub(super) fn passes(&self) -> Vec<&'static str> {
        let optional = |present: bool, name| present.then_some(name);
        [
            optional(self.inflow.is_some(), "inflow"),
            optional(self.forces.is_some(), "forces"),
            optional(self.walls.rigid_bodies() > 0, "bodies"),
            Some("sort"),
            Some("predict"),
            Some("search"),
            optional(self.tension.is_some(), "surface_tension"),
            optional(self.repulsion.is_some(), "artificial_pressure"),
            optional(self.viscosity.is_some(), "viscosity"),
            Some("solve"),
            Some("velocity"),
            optional(self.v_before.is_some(), "friction"),
            optional(self.confinement.is_some(), "vorticity"),
            optional(self.microrotation.is_some(), "micropolar"),
            optional(self.params.xsph.is_some(), "xsph"),
            optional(self.outflow.is_some(), "outflow"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    /// Advances from `start` [s] by one frame of `seconds`, with the rigid bodies among its solids.
    pub(super) fn advance(
        &mut self,
        start: f64,
        seconds: f64,
        bodies: Option<&mut dyn CoupledBodies>,
        watch: &mut dyn Watch,
    ) -> Result<(LiquidRecord, Seconds), Stop> {
        let mut clock = Clock::new(&self.passes());
        let partners = Partners { system: None, bodies };
        let record = self.advance_with(partners, [start, seconds], &mut clock, watch)?;
        Ok((record, clock.into_totals()))
    }

    /// Advances by one frame together with coupled systems; `clock` receives the seconds of the passes.
    pub(super) fn advance_with(
        &mut self,
        mut partners: Partners<'_>,
        span: [f64; 2],
        clock: &mut Clock,
        watch: &mut dyn Watch,
    ) -> Result<LiquidRecord, Stop> {
        let mut record = LiquidRecord { flow: self.flow_record(), ..LiquidRecord::default() };
        (self.solver.rebuilds, self.solver.shortened, self.solver.unresolved_contacts) = (0, 0, 0);
        self.momentum.reset();
        if let Some(bodies) = &partners.bodies {
            self.place_bodies(bodies.bodies());
        }
        self.check_state(0)?;
        self.sample_forces(span[0], clock);
        let is_driven = self.body_acceleration() > 0.0 || self.tension.is_some();
        let needs_relaxation = self.params.has_jitter() || !is_driven;
        if span[0] == 0.0 && needs_relaxation && partners.system.is_none() {
            self.relax(clock, &mut record, watch)?;
        }
        self.retain_from_frame(clock)?;
        let waves = clock.time("predict", || self.wave_speed());
        advance_frame(span, watch, |progress, watch| {
            let (now, left, seconds) = (progress.now(), progress.left, progress.seconds);
            self.sample_forces(now, clock);
            let [wanted, mut remaining] = self.substeps_left([now, left, waves], &partners, record.substeps);
            if let Some(coupled) = &mut partners.system {
                remaining = remaining.max(coupled.substeps_left(now, left, seconds, record.substeps)?);
            }
            record.cfl_capped += u32::from(wanted > remaining);
            let dt = left / f64::from(remaining);
            record.substeps += 1;
            self.walls.move_to(progress.after(dt));
            self.start_bodies(&mut partners, now, dt, clock);
            if let Some(coupled) = &mut partners.system {
                coupled.advance_uncoupled(now, dt, clock)?;
            }
            if self.inflow.is_some() {
                clock.time("inflow", || self.emit(now, dt as f32, &mut record))?;
                self.sample_entered(now, clock);
            }
            if !self.x.is_empty() {
                self.substep(dt as f32, &mut partners, clock, &mut record, watch)?;
                self.check_state(record.substeps)?;
            } else if let (Some(coupled), Some(bodies)) =
                (&mut partners.system, reborrow(&mut partners.bodies))
            {
                coupled.end_without_liquid(bodies, clock);
            }
            if let Some(bodies) = &mut partners.bodies {
                clock.time("bodies", || bodies.end_substep());
            }
            if self.outflow.is_some() {
                clock.time("outflow", || self.drain(&mut record));
            }
            Ok(dt)
        })?;
        self.measure(clock, &mut record)?;
        record.forces = self.forces.as_mut().map(|forces| std::mem::take(&mut forces.record));
        Ok(record)
    }

    /// One time step: [pbf] Algorithm 1.
    fn substep(
        &mut self,
        dt: f32,
        partners: &mut Partners<'_>,
        clock: &mut Clock,
        record: &mut LiquidRecord,
        watch: &mut dyn Watch,
    ) -> Result<(), Stop> {
        clock.time("predict", || self.predict(dt));
        self.exchange_prediction(partners, dt, clock);
        let cells = clock.time("search", || self.solver.find_cells(&self.rest));
        cells.map_err(|cell| self.overcrowded(record.substeps, cell))?;
        clock.time("sort", || self.sort());
        self.solver.rigid.resize(self.x.len(), partners.bodies.is_some());
        self.solver.exempt_pins(self.params.constraint);
        if self.v_before.is_some() {
            clock.time("friction", || self.start_contacts(dt));
        }
        clock.time("search", || self.solver.build_lists(&setup(&self.params, &self.rest, &self.walls)));
        if self.tension.is_some() {
            record.clamps.corrections += clock.time("surface_tension", || self.apply_tension(dt, partners));
        }
        self.apply_artificial_pressure(dt, clock, record)?;
        if self.viscosity.is_some() {
            self.apply_viscosity(dt, partners, clock, record, watch)?;
        }
        self.detect_contacts(partners, clock);
        self.project_contacts(dt, partners, clock);
        let target = self.target(dt, partners.system.as_deref());
        clock.around("solve", |clock| self.solve(dt, target, partners, clock, record, watch))?;
        self.retain();
        if let Some(viscosity) = &mut self.viscosity {
            self.momentum.give_back(&mut self.solver, &mut viscosity.pressures, dt);
        }
        self.end_contacts(dt, partners, clock);
        clock.time("velocity", || self.update_velocities(dt));
        if self.v_before.is_some() {
            clock.time("friction", || self.apply_friction(dt, partners, record));
            self.solver.restore_pins();
        }
        if let Some(coupled) = &mut partners.system {
            self.first_energy += coupled.apply_friction(&mut self.v, clock);
        }
        self.add_solid_work(dt, record);
        self.add_body_work(partners, record);
        self.add_nozzle_work(dt, record);
        self.add_force_work(dt);
        if self.confinement.is_some() || self.microrotation.is_some() || self.params.xsph.is_some() {
            let setup = setup(&self.params, &self.rest, &self.walls);
            let lists = clock.time("search", || self.solver.ensure_lists(&setup));
            lists.map_err(|cell| self.overcrowded(record.substeps, cell))?;
            clock.time("search", || self.solver.publish_ratio(self.rest.inv_support));
        }
        if self.confinement.is_some() {
            clock.time("vorticity", || self.confine(dt, record));
        }
        if self.microrotation.is_some() {
            clock.time("micropolar", || self.exchange_rotation(dt, record));
        }
        let gain = self.body_acceleration() * dt;
        if let Some(xsph) = &self.params.xsph {
            clock.time("xsph", || {
                publish(&mut self.motion, &self.v);
                let at = neighbourhood(&self.rest, &self.solver, &self.motion);
                xsph::apply(xsph, at, gain, &mut self.v);
            });
        }
        clock.time("velocity", || {
            self.bound_energy(record);
            self.restore_pinned_velocities(dt);
        });
        std::mem::swap(&mut self.x, &mut self.solver.p); // x_i ← x*, [pbf] Alg. 1, line 23
        Ok(())
    }

    /// Sorts the particles at x into the cells of the neighbour search and builds their lists, before the first substep of a frame.
    fn list_positions(&mut self, clock: &mut Clock) -> Result<(), Diverged> {
        self.solver.p.clone_from(&self.x);
        // What fails here would fail in the first substep.
        let cells = clock.time("search", || self.solver.find_cells(&self.rest));
        cells.map_err(|cell| self.overcrowded(1, cell))?;
        clock.time("sort", || self.sort());
        clock.time("search", || self.solver.build_lists(&setup(&self.params, &self.rest, &self.walls)));
        Ok(())
    }

    /// Advection: velocities after gravity, and predicted positions, [pbf] Alg. 1, lines 1–4.
    fn predict(&mut self, dt: f32) {
        self.apply_forces(dt);
        let gain = self.gravity * dt;
        par::update(&mut self.v, |_, v| *v += gain);
        self.restore_pinned_velocities(dt);
        self.predict_positions(dt);
    }

    /// Predicted positions from velocities, [pbf] Alg. 1, line 3.
    fn predict_positions(&mut self, dt: f32) {
        let (x, v, walls) = (&self.x, &self.v, &self.walls);
        self.solver.p.resize(x.len(), Vec3::zeros());
        par::fill(&mut self.solver.p, |i| walls.collide_moving(x[i], x[i] + v[i] * dt).0);
        let p = &self.solver.p;
        self.solver.work = if walls.has_moving_solids() {
            par::sum(p.len(), |i| walls.work(x[i] + v[i] * dt, p[i]))
        } else {
            0.0
        };
        self.solver.restore_pins();
    }

    /// Solves the density constraints, [pbf] Alg. 1, lines 8–19, to `target` or with a fixed number of iterations.
    fn solve(
        &mut self,
        dt: f32,
        target: Option<Target>,
        partners: &mut Partners<'_>,
        clock: &mut Clock,
        record: &mut LiquidRecord,
        watch: &mut dyn Watch,
    ) -> Result<(), Stop> {
        let kind = self.params.solver;
        let theta = self.params.first_theta();
        let is_calmed = self.is_calmed(partners.system.as_deref());
        let acceleration = self.body_acceleration();
        self.ensure_lists(record)?;
        if kind == SolverKind::Accelerated {
            self.start_pressures(dt, theta, partners, clock);
        }
        let max_iterations = self.params.iterations.unwrap_or(self.params.max_iterations);
        let min_iterations = MIN_ITERATIONS.min(max_iterations);
        let Target { stop, limit } =
            target.unwrap_or(Target { stop: f64::NEG_INFINITY, limit: f64::INFINITY });
        // Deviation before the last correction, if a part of the correction may do.
        let mut before = None;
        for done in 0..=max_iterations {
            if watch.is_cancelled() {
                return Err(Stop::Interrupted);
            }
            if done == max_iterations && target.is_none() {
                break;
            }
            self.ensure_lists(record)?;
            let solids = setup(&self.params, &self.rest, &self.walls);
            let residual = match kind {
                SolverKind::Accelerated => {
                    self.momentum.evaluate(&mut self.solver, &solids, acceleration, done == 0)
                }
                SolverKind::Jacobi => jacobi::evaluate(&mut self.solver, &solids),
            };
            let reached = residual.average;
            if !reached.is_finite() {
                return Err(self.undefined_constraint(record.substeps).into());
            }
            if done >= min_iterations && reached <= stop {
                if let Some(before) = before {
                    self.shorten_correction((before - stop) / (before - reached), dt, partners, clock);
                }
                break;
            }
            if done == max_iterations {
                record.unconverged += u32::from(reached > limit);
                break;
            }
            let is_near = stop < reached && reached <= MAX_INTERPOLATED_DEVIATION * stop;
            before = (is_near && is_calmed && done + 1 >= MIN_SHORTENED).then(|| {
                self.solver.save_state();
                self.save_bodies(partners);
                reached
            });
            let is_late = self.momentum.is_slowed() || done >= MAX_EARLY_ITERATIONS;
            let theta = if is_late { 1.0 } else { theta };
            self.yield_to_bodies(partners, clock);
            let x = &self.x;
            self.solver.evaluate_directions_at(Directions { theta, x }, &self.rest);
            self.solver.correct(&setup(&self.params, &self.rest, &self.walls));
            self.solver.restore_pins_with_work(x);
            self.push_bodies(dt, partners, clock);
            self.project_contacts(dt, partners, clock);
            record.iterations += 1;
        }
        self.solver.rigid.discard_samples();
        Ok(())
    }

    /// Velocities from positions, [pbf] Alg. 1, line 21.
    fn update_velocities(&mut self, dt: f32) {
        let (x, p) = (&self.x, &self.solver.p);
        par::fill(&mut self.v, |i| (p[i] - x[i]) / dt);
    }

    /// Vorticity confinement, [pbf] Alg. 1, line 22.
    fn confine(&mut self, dt: f32, record: &mut LiquidRecord) {
        let (surface_energy, gain) = (self.surface_energy(), self.body_acceleration() * dt);
        let Some(confinement) = &mut self.confinement else { return };
        publish(&mut self.motion, &self.v);
        let lost =
            self.first_energy - energy(&self.v, &self.solver.p, self.gravity, self.mass) - surface_energy;
        let at = neighbourhood(&self.rest, &self.solver, &self.motion);
        let (added, bounded) = confinement.apply(at, &mut self.v, [dt, gain], self.mass, lost);
        record.confinement_energy += added;
        record.clamps.confinement += u64::from(bounded);
    }

    /// Exchange of rotation between the velocities and the microrotation of the particles.
    fn exchange_rotation(&mut self, dt: f32, record: &mut LiquidRecord) {
        let (surface, spin) = (self.surface_energy(), self.microrotation_energy());
        let Some(microrotation) = &mut self.microrotation else { return };
        publish(&mut self.motion, &self.v);
        let mechanical = energy(&self.v, &self.solver.p, self.gravity, self.mass);
        let lost = self.first_energy - mechanical - surface - spin;
        let at = neighbourhood(&self.rest, &self.solver, &self.motion);
        let (added, bounded) = microrotation.apply(at, &mut self.v, dt, self.mass, lost);
        record.micropolar_energy += added;
        record.clamps.micropolar += u64::from(bounded);
    }

    /// Number of equal substeps that the CFL rule wants for the `left` [s] of the frame, with the speed of `waves` [m/s], and the number
    /// within the limits of the preset after `done` substeps.
    fn substeps_left(&self, [now, left, waves]: [f64; 3], partners: &Partners<'_>, done: u32) -> [u32; 2] {
        let fastest = par::max(self.v.len(), |i| self.v[i].norm()).map_or(0.0, |(_, speed)| f64::from(speed));
        let coupled = partners.system.as_deref().map_or(0.0, CoupledSystem::max_speed);
        let bodies = partners.bodies.as_deref().map_or(0.0, CoupledBodies::max_speed);
        let nozzle = self.inflow.as_ref().map_or(0.0, |inflow| inflow.max_speed(now, now + left));
        let other = self.walls.max_speed(left).max(coupled);
        // Rigid bodies move with the liquid that moves them.
        let fastest = fastest.max(nozzle).max(bodies) + other;
        let gravity = f64::from(self.steady_acceleration().norm());
        let allowed = self.cfl_length();
        // The positive root of (v + g dt) dt = allowed, in the form that survives v = g = 0.
        let root = fastest + (fastest * fastest + 4.0 * gravity * allowed).sqrt();
        let longest = self.tension.as_ref().map_or(f64::INFINITY, Tension::longest_substep);
        let wanted = (left * root / (2.0 * allowed)).max(left / longest);
        let forces = self.forces.as_ref();
        let forced = forces.map_or(0.0, |forces| forces.substep_rate(&self.v, self.gravity, allowed, other));
        let wanted = wanted.max(left * forced).max(left * waves / allowed);
        let wanted = (wanted - 1e-6).ceil().clamp(1.0, 4e9) as u32;
        let min_substeps = self.params.min_substeps.saturating_sub(done).max(1);
        let max_substeps = self.params.max_substeps.saturating_sub(done).max(1);
        [wanted, wanted.max(min_substeps).min(max_substeps)]
    }

    /// Fills in the record of the frame's end.
    fn measure(&mut self, clock: &mut Clock, record: &mut LiquidRecord) -> Result<(), Diverged> {
        self.record_flow(record);
        if self.x.is_empty() {
            self.figures = Some(FRAME_FIGURES.map(|(_, value)| value(record)));
            return Ok(());
        }
        let setup = setup(&self.params, &self.rest, &self.walls);
        self.solver.p.clone_from(&self.x);
        let lists = clock.time("solve", || self.solver.ensure_lists(&setup));
        lists.map_err(|cell| self.overcrowded(record.substeps, cell))?;
        let residual = clock.time("solve", || self.solver.measure(&setup));
        record.density_dev_avg = residual.average;
        record.density_dev_max = residual.largest;
        let Solver { ratio, lists, .. } = &self.solver;
        let particles = Particles { rest: &self.rest, walls: &self.walls, x: &self.x, ratio, lists };
        clock.time("solve", || particles.measure()).fill(record);
        self.figures = Some(FRAME_FIGURES.map(|(_, value)| value(record)));
        record.kinetic_energy = self.kinetic_energy();
        record.potential_energy = self.potential_energy();
        record.surface_energy = self.surface_energy();
        record.microrotation_energy = self.microrotation_energy();
        record.list_rebuilds = self.solver.rebuilds;
        record.clamps.corrections += self.solver.shortened;
        record.clamps.contacts += self.solver.unresolved_contacts;
        record.clamps.momentum = self.momentum.slowed;
        let inside = |i: usize| f64::from(u8::from(self.walls.distance(self.x[i]) < 0.0));
        record.particles_inside_solids = par::sum(self.x.len(), inside) as u32;
        Ok(())
    }
}

fn setup<'a>(params: &LiquidParams, rest: &'a RestState, walls: &'a Walls) -> SolverSetup<'a> {
    SolverSetup {
        rest,
        walls,
        constraint: params.constraint,
        softening: params.softening * rest.rest_gradient2,
    }
}

fn neighbourhood<'a>(rest: &'a RestState, solver: &'a Solver, motion: &'a [Node]) -> Neighbourhood<'a> {
    Neighbourhood { rest, nodes: &solver.nodes, motion, lists: &solver.lists }
}

/// Copies velocities into the layout of neighbour sums.
fn publish(motion: &mut Vec<Node>, v: &[Vec3]) {
    motion.resize(v.len(), Node::default());
    par::fill(motion, |i| Node::new(v[i], 0.0));
}
