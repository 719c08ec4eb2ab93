//! Inflow: particles that emitters add while the shot runs.
//!
//! *Method*: see `emitter.rs` for the moving lattice. A particle that has entered moves with its lattice, whatever the density solve
//! wants, until it is farther than the kernel's support from the place where the last layer enters: those in front of it then have
//! all of their neighbours, and are neither sucked back nor pushed by a surface that is not there. It pushes the liquid like a moving
//! solid, and its work raises the bound of the energy. When the flow stops, the nozzle's particles are let go.
//! A particle does not enter where a solid or a particle is too close, and one whose lattice leads it into a solid is let go early.
//! Both are counted.
//!
//! *Limits*: liquid behind a nozzle in the open is pushed aside by layers that enter. A wall behind the nozzle avoids that.

mod emitter;
mod nozzle;
mod params;
mod schedule;

pub use params::{FrameRange, LiquidDomain, LiquidEmitter, LiquidOutflow, RateKeyframe, Side};
pub(in crate::sim::liquid) use schedule::OnTimes;

use super::{
    Diverged, Liquid, LiquidParams, LiquidRecord, NAME,
    calibration::RestState,
    energy::energy,
    pins::Pin,
    record::{FlowRecord, NozzleReport},
    setup::LIST_SKIN,
    walls::Walls,
};
use crate::{
    math::Vec3,
    sim::{SetupError, Timeline},
    space::CellGrid,
};
use emitter::{Emitter, EmitterStep, LatticePoint};

/// Smallest distance from a solid at which a particle enters, in spacings, as for sources.
const MIN_SOLID_DISTANCE: f32 = 0.49;

/// Distance from a solid at which a particle in a nozzle is let go, in spacings. It is below [`MIN_SOLID_DISTANCE`], so that rounding
/// lets none go.
const RELEASE_DISTANCE: f32 = 0.45;

/// Smallest distance to another particle of a nozzle at which a particle enters, in spacings, as for sources.
const MIN_NOZZLE_SEPARATION: f32 = 0.9;

/// The same to a free particle: liquid in front of a nozzle is pushed away. At 0.5 liquid that rests at a nozzle, half a spacing from
/// its wall, blocks it for good, since nothing enters that would push it.
const MIN_FREE_SEPARATION: f32 = 0.25;

/// Depth in a solid that counts as rounding, in spacings.
const ROUNDING: f32 = 1e-2;

/// Places in front of a column at which a solid is looked for.
const PROBES: u32 = 6;

/// Most particles of a liquid, and of a shot: ids and neighbour lists have 32 bits.
const MAX_PARTICLES: usize = u32::MAX as usize / 2;

/// The emitters of a liquid.
#[derive(Debug)]
pub(super) struct Inflow {
    emitters: Vec<Emitter>,
    /// Distance beyond the reference plane at which particles are let go [m].
    nozzle_length: f64,
    spacing: f32,
}

/// A particle that is about to enter.
struct Entering {
    point: LatticePoint,
    start: Vec3,
    end: Vec3,
}

/// Whether a particle at `x` with a flow along the unit vector `flow` is free of solids, by `distance` spacings. It may be closer to
/// one that it leaves, as from a nozzle in a wall.
fn is_free(walls: &Walls, x: Vec3, flow: Vec3, distance: f32, spacing: f32) -> bool {
    let here = walls.distance(x);
    if here >= distance * spacing {
        return true;
    }
    let ahead = walls.distance(x + flow * spacing);
    here > -ROUNDING * spacing && ahead >= distance * spacing && ahead > here
}

impl Inflow {
    /// The emitters of a preset; `None` without any.
    ///
    /// # Errors
    /// If the cross-sections need more points than memory is reserved for.
    pub(super) fn new(
        params: &LiquidParams,
        rest: &RestState,
        timeline: Timeline,
    ) -> Result<Option<Self>, SetupError> {
        if params.emitter.is_empty() {
            return Ok(None);
        }
        let spacing = f64::from(rest.spacing);
        let points = |emitter: &LiquidEmitter| {
            nozzle::grid_points(&emitter.shape, emitter.flow_direction().unwrap_or_default(), spacing)
        };
        let count: f64 = params.emitter.iter().map(points).filter(|count| count.is_finite()).sum();
        if count > nozzle::MAX_POINTS {
            return Err(SetupError::TooManyColumns { count });
        }
        let (mut emitters, mut first_column) = (Vec::new(), 0);
        for params in &params.emitter {
            let emitter = Emitter::new(params, spacing, timeline, first_column);
            first_column += emitter.nozzle.columns.len() as u32;
            emitters.push(emitter);
        }
        let nozzle_length = f64::from(rest.support * (1.0 + LIST_SKIN));
        Ok(Some(Self { emitters, nozzle_length, spacing: rest.spacing }))
    }

    /// Whether any emitter has a column.
    pub(super) fn has_columns(&self) -> bool {
        self.emitters.iter().any(|emitter| !emitter.nozzle.columns.is_empty())
    }

    /// Bound of the speed in all nozzles from `from` to `to` [m/s].
    pub(super) fn max_speed(&self, from: f64, to: f64) -> f64 {
        self.emitters.iter().map(|emitter| emitter.max_speed(from, to)).fold(0.0, f64::max)
    }

    /// Flow lengths of all emitters [m].
    pub(super) fn lengths(&self) -> impl Iterator<Item = f64> {
        self.emitters.iter().map(|emitter| emitter.length)
    }

    /// Sets the flow lengths of all emitters [m].
    pub(super) fn set_lengths(&mut self, lengths: &[f64]) {
        self.emitters.iter_mut().zip(lengths).for_each(|(emitter, length)| emitter.length = *length);
    }

    /// Number of columns of all emitters.
    pub(super) fn column_count(&self) -> u32 {
        self.emitters.last().map_or(0, |last| last.first_column + last.nozzle.columns.len() as u32)
    }

    /// Reports of the nozzles at the start of a shot.
    pub(super) fn report(&self, walls: &Walls, is_removed: impl Fn(Vec3) -> bool) -> Vec<NozzleReport> {
        let report = |emitter: &Emitter| {
            let pose = emitter.pose(0.0);
            let places: Vec<Vec3> = (0..emitter.nozzle.columns.len())
                .map(|column| {
                    let front = emitter.nozzle.columns[column].depth;
                    let foot = emitter.nozzle.columns[column].foot - emitter.nozzle.direction * front;
                    pose.to_world(foot.cast())
                })
                .collect();
            let flow = emitter.flow_direction(&pose);
            let ahead = flow * self.nozzle_length as f32;
            let is_blocked = |x: Vec3| !is_free(walls, x, flow, MIN_SOLID_DISTANCE, self.spacing);
            let count = |test: &dyn Fn(Vec3) -> bool| places.iter().filter(|x| test(**x)).count() as u32;
            NozzleReport {
                columns: places.len() as u32,
                area: places.len() as f64 * f64::from(self.spacing).powi(2),
                outline_area: emitter.nozzle.outline_area,
                in_solids: count(&is_blocked),
                at_wall: count(&|x| {
                    !is_blocked(x) && (1..=PROBES).any(|k| is_blocked(x + ahead * (k as f32 / PROBES as f32)))
                }),
                in_outflow: count(&is_removed),
                max_speed: emitter.max_speed(0.0, f64::INFINITY),
            }
        };
        self.emitters.iter().map(report).collect()
    }
}

/// Particles that the emitters of a preset add in the first `seconds` [s] of a shot, if nothing is in their way.
#[cfg(feature = "presets")]
pub(in crate::sim) fn emitted_particles(params: &LiquidParams, timeline: Timeline, seconds: f64) -> f64 {
    let rest = RestState::new(params.kernel, params.spacing, params.kernel_radius);
    let count = |emitter: &Emitter| emitter.entering_count([0.0, emitter.flow_length(0.0, seconds)]);
    match Inflow::new(params, &rest, timeline) {
        Ok(Some(inflow)) => inflow.emitters.iter().map(count).sum(),
        _ => 0.0,
    }
}

impl Liquid {
    /// Moves the particles in the nozzles and adds those that enter, from `from` [s] over `dt` [s].
    ///
    /// # Errors
    /// If there are too many particles.
    pub(super) fn emit(&mut self, from: f64, dt: f32, record: &mut LiquidRecord) -> Result<(), Diverged> {
        self.solver.pins.clear();
        let Some(flow) = &mut record.flow else { return Ok(()) };
        let Some(mut inflow) = self.inflow.take() else { return Ok(()) };
        let to = self.walls.now();
        let steps: Vec<EmitterStep> =
            inflow.emitters.iter_mut().map(|emitter| emitter.advance(from, to)).collect();
        self.move_nozzles(&inflow, &steps, dt, flow);
        let mut result = Ok(());
        for (index, (emitter, step)) in inflow.emitters.iter().zip(&steps).enumerate() {
            let entering = self.entering(emitter, step, [inflow.spacing, dt], flow, index);
            flow.emitted[index] += entering.len() as u64;
            if self.x.len() + entering.len() > MAX_PARTICLES
                || u32::MAX - self.next_id < entering.len() as u32
            {
                let what = format!("would be followed by {} more, and ids have 32 bits", entering.len());
                let particle = self.next_id.saturating_sub(1);
                let try_next = "a larger liquid.spacing, a smaller rate or fewer frames";
                result = Err(Diverged { system: NAME, substep: record.substeps, particle, what, try_next });
                break;
            }
            self.add_particles(index, emitter, &entering, [from, f64::from(dt)]);
        }
        self.inflow = Some(inflow);
        self.solver.pins.sort_unstable_by_key(|pin| pin.particle);
        result
    }

    /// Moves the particles that are in nozzles by a substep of `dt` [s], or lets them go.
    fn move_nozzles(&mut self, inflow: &Inflow, steps: &[EmitterStep], dt: f32, flow: &mut FlowRecord) {
        let mut added = 0.0;
        for i in 0..self.nozzle.len() {
            let Some(column) = self.nozzle[i].checked_sub(1) else { continue };
            let owner = inflow.emitters.partition_point(|emitter| emitter.first_column <= column) - 1;
            let (emitter, step) = (&inflow.emitters[owner], &steps[owner]);
            let (point, place) = emitter.point_at((column - emitter.first_column) as usize, self.x[i], step);
            let target = emitter.position(point, step.length[1], &step.pose[1]);
            let is_on = step.length[1] > step.length[0];
            let flow_direction = emitter.flow_direction(&step.pose[1]);
            let is_free = is_free(&self.walls, target, flow_direction, RELEASE_DISTANCE, inflow.spacing);
            if is_on && is_free && place < inflow.nozzle_length {
                added += self.pin(i, target, dt);
            } else {
                flow.released_early += u64::from(is_on && !is_free);
                self.nozzle[i] = 0;
            }
        }
        self.first_energy += added;
    }

    /// Prescribes the motion of a particle to `target` over `dt` [s]. Returns the energy that it gains [J].
    fn pin(&mut self, i: usize, target: Vec3, dt: f32) -> f64 {
        let state = |v: Vec3, x: Vec3| energy(&[v], &[x], self.gravity, self.mass);
        let before = state(self.v[i], self.x[i]);
        let v = (target - self.x[i]) / dt;
        let gained = state(v, target) - before;
        self.v[i] = v;
        self.solver.pins.push(Pin { particle: i as u32, target });
        gained
    }

    /// The particles of an emitter that enter in a substep, without those whose place is not free.
    fn entering(
        &self,
        emitter: &Emitter,
        step: &EmitterStep,
        [spacing, dt]: [f32; 2],
        flow: &mut FlowRecord,
        index: usize,
    ) -> Vec<Entering> {
        let at = |point| Entering {
            point,
            start: emitter.position(point, step.length[0], &step.pose[0]),
            end: emitter.position(point, step.length[1], &step.pose[1]),
        };
        let mut entering: Vec<Entering> = emitter.entering(step.length).into_iter().map(at).collect();
        if entering.is_empty() {
            return entering;
        }
        let wanted = entering.len();
        let flow_direction = emitter.flow_direction(&step.pose[1]);
        entering.retain(|entering| {
            is_free(&self.walls, entering.end, flow_direction, MIN_SOLID_DISTANCE, spacing)
        });
        flow.blocked_by_solids[index] += (wanted - entering.len()) as u64;

        // Particles near the places, where they will be.
        let low =
            entering.iter().fold(Vec3::repeat(f32::INFINITY), |low, e| low.inf(&e.end)).add_scalar(-spacing);
        let high = entering
            .iter()
            .fold(Vec3::repeat(-f32::INFINITY), |high, e| high.sup(&e.end))
            .add_scalar(spacing);
        let (mut near, mut in_nozzle) = (Vec::new(), Vec::new());
        for (i, x) in self.x.iter().enumerate() {
            let x = x + self.v[i] * dt;
            if (0..3).all(|axis| low[axis] <= x[axis] && x[axis] <= high[axis]) {
                near.push(x);
                in_nozzle.push(self.nozzle[i] != 0);
            }
        }
        let grid = CellGrid::new(&near, spacing);
        let wanted = entering.len();
        entering.retain(|entering| {
            let mut is_free = true;
            grid.for_each_within(&near, entering.end, MIN_NOZZLE_SEPARATION * spacing, |j, distance2| {
                let separation = if in_nozzle[j] { MIN_NOZZLE_SEPARATION } else { MIN_FREE_SEPARATION };
                is_free &= distance2 >= (separation * spacing).powi(2);
            });
            is_free
        });
        flow.blocked_by_liquid[index] += (wanted - entering.len()) as u64;
        entering
    }

    /// Adds the particles of emitter `index` that enter in a substep from `from` over `dt` [s].
    fn add_particles(
        &mut self,
        index: usize,
        emitter: &Emitter,
        entering: &[Entering],
        [from, dt]: [f64; 2],
    ) {
        if entering.is_empty() {
            return;
        }
        let mut added = 0.0;
        let source = (self.params.source.len() + index) as u32;
        let first = self.x.len();
        self.append(entering.len(), [source, self.next_id], (from + dt) as f32);
        self.next_id += entering.len() as u32;
        for (k, Entering { point, start, end }) in entering.iter().enumerate() {
            let i = first + k;
            self.x[i] = *start;
            self.v[i] = (end - start) / dt as f32;
            self.nozzle[i] = 1 + emitter.first_column + point.column as u32;
            added += energy(&[self.v[i]], &[self.x[i]], self.gravity, self.mass);
            added += self.pin(i, *end, dt as f32);
        }
        self.first_energy += added;
    }
}
