//! Inflow: particles that emitters add while the shot runs.
//!
//! *Method*: see `emitter.rs` for the moving seeding lattice, and `nozzle.rs` for the shifts of its columns. A particle that has entered moves with its seeding lattice, whatever the density solve
//! wants, until it is farther than the kernel's support from the place where the last layer enters: those in front of it then have
//! all of their neighbours, and are neither sucked back nor pushed by a surface that is not there. It pushes the liquid like a moving
//! solid, and its work raises the bound of the energy. When the flow stops, the nozzle's particles are let go.
//! A particle does not enter where a solid or a particle is too close, and one whose seeding lattice leads it into a solid is let go early.
//! Both are counted.
//!
//! *Limits*: liquid behind a nozzle in the open is pushed aside by layers that enter. A wall behind the nozzle avoids that.

mod emitter;
mod nozzle;
mod params;
mod schedule;

pub use params::{FrameRange, LiquidDomain, LiquidEmitter, LiquidOutflow, RateKeyframe, Side};
pub(in crate::sim::liquid) use schedule::OnTimes;
use schedule::Schedule;

use super::{LiquidParams, calibration::RestState, record::NozzleReport, setup::LIST_SKIN, walls::Walls};
use crate::{
    math::Vec3,
    sim::{SetupError, Timeline},
    solid::Shape,
};
pub(in crate::sim::liquid) use emitter::{Emitter, EmitterStep, LayerPoint};

/// Smallest distance from a solid at which a particle enters, in spacings, as for sources.
pub(in crate::sim::liquid) const MIN_SOLID_DISTANCE: f32 = 0.49;

/// Depth in a solid that counts as rounding, in spacings.
const ROUNDING: f32 = 1e-2;

/// Places in front of a column at which a solid is looked for.
const PROBES: u32 = 6;

/// The emitters of a liquid.
#[derive(Debug)]
pub(super) struct Inflow {
    pub(super) emitters: Vec<Emitter>,
    /// Distance beyond the reference plane at which particles are let go [m].
    pub(super) nozzle_length: f64,
    pub(super) spacing: f32,
}

/// Whether a particle at `x` with a flow along the unit vector `flow` is free of solids, by `distance` spacings. It may be closer to
/// one that it leaves, as from a nozzle in a wall.
pub(in crate::sim::liquid) fn is_free(
    walls: &Walls,
    x: Vec3,
    flow: Vec3,
    distance: f32,
    spacing: f32,
) -> bool {
    let here = walls.distance(x);
    if here >= distance * spacing {
        return true;
    }
    let ahead = walls.distance(x + flow * spacing);
    here > -ROUNDING * spacing && ahead >= distance * spacing && ahead > here
}

/// Whether a particle that enters at `x` is led into a solid within `length` [m] along the unit vector `flow`.
pub(in crate::sim::liquid) fn leads_into_solid(
    walls: &Walls,
    x: Vec3,
    flow: Vec3,
    length: f32,
    spacing: f32,
) -> bool {
    let place = |probe: u32| x + flow * (length * probe as f32 / PROBES as f32);
    (1..=PROBES).any(|probe| !is_free(walls, place(probe), flow, MIN_SOLID_DISTANCE, spacing))
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
            let emitter = Emitter::new(params, rest, timeline, first_column);
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
            let length = self.nozzle_length as f32;
            let is_blocked = |x: Vec3| !is_free(walls, x, flow, MIN_SOLID_DISTANCE, self.spacing);
            let count = |test: &dyn Fn(Vec3) -> bool| places.iter().filter(|x| test(**x)).count() as u32;
            NozzleReport {
                columns: places.len() as u32,
                area: emitter.area,
                outline_area: emitter.nozzle.outline_area,
                in_solids: count(&is_blocked),
                at_wall: count(&|x| !is_blocked(x) && leads_into_solid(walls, x, flow, length, self.spacing)),
                in_outflow: count(&is_removed),
                max_speed: emitter.max_speed(0.0, f64::INFINITY),
            }
        };
        self.emitters.iter().map(report).collect()
    }
}

/// Bound of [`emitted_particles`] that takes no cross-section: the grid over the outline for a velocity, the volume for a rate.
#[cfg(feature = "presets")]
pub(in crate::sim) fn max_emitted_particles(params: &LiquidParams, timeline: Timeline, seconds: f64) -> f64 {
    let spacing = f64::from(params.spacing);
    let bound = |emitter: &LiquidEmitter| {
        let points =
            nozzle::grid_points(&emitter.shape, emitter.flow_direction().unwrap_or_default(), spacing);
        // By an area of one, the length is the volume.
        let area = emitter.velocity.map_or(1.0, |_| points * spacing.powi(2));
        let volume = area * Schedule::new(emitter, 1.0, timeline).length(0.0, seconds);
        volume / spacing.powi(3) + points
    };
    // The cross-section of a mesh is not known until the mesh is read.
    let is_known = |emitter: &&LiquidEmitter| !matches!(emitter.shape, Shape::Mesh(_));
    params.emitter.iter().filter(is_known).map(bound).filter(|count| count.is_finite()).sum()
}

/// Particles that the emitters of a preset add in the first `seconds` [s] of a shot, if their places are free.
#[cfg(feature = "presets")]
pub(in crate::sim) fn emitted_particles(params: &LiquidParams, timeline: Timeline, seconds: f64) -> f64 {
    let rest = RestState::new(params.kernel, params.spacing, params.kernel_radius);
    let count = |emitter: &Emitter| emitter.entering_count([0.0, emitter.flow_length(0.0, seconds)]);
    match Inflow::new(params, &rest, timeline) {
        Ok(Some(inflow)) => inflow.emitters.iter().map(count).sum(),
        _ => 0.0,
    }
}
