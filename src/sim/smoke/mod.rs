//! Smoke from vortons ([gourlay19]).
//!
//! *Method*: vortons discretise the vorticity of the air and induce its velocity, which advects them
//! ([`flow`](super::vortex::flow)). The same velocity advects tracers, which have density and temperature. A step advects both,
//! emits tracers (`emit.rs`), turns impulses into vorticity (`kick.rs`) and lets smoke fade. Air far away is still, or moves with
//! the wind.
//! *Departs from the paper*: tracers are no vortons; see the files of the parts.
//!
//! Symbols: Γ → `strength` [m³/s], σ → `core` [m], u → `velocity` [m/s].
//! Limits: impulses are first order in time.

mod air;
mod body;
mod emit;
mod estimate;
mod field;
mod filaments;
mod influence;
#[cfg(feature = "presets")]
pub(crate) mod job;
mod kick;
mod mirror;
mod panels;
mod params;
mod point_sums;
mod push;
mod record;
mod replay;
mod shed;
mod sources;
mod state;
mod tiles;
mod tracers;
mod turbulence;
mod walls;
mod widths;

use estimate::refuse_kernel;
pub(in crate::sim) use estimate::{MAX_TRACERS_AND_VORTONS, estimate, refuse_too_much};
pub use field::FrameAir;
pub(crate) use field::ShotAir;
pub use params::{Buoyancy, Emitter, Ring, Shedding, SmokeParams, SmokeSource, Tube, Turbulence};
pub use record::{SmokeRecord, SmokeSeeds};
pub(crate) use replay::{DriftReport, Drifting, KeyedAir, Replay};
pub use tracers::TRACERS;

use super::{
    SetupError, Stop, Watch, World,
    clock::{Clock, Seconds},
    substep::advance_frame,
    vortex::{
        OutOfRange, Vortons,
        flow::{Flow, Medium, SubstepLimits},
    },
};
use crate::{math::Vec3, sim::Diverged};
use air::{Air, Instant};
use body::PlacedForm;
use emit::Emitted;
use filaments::Setting;
use tracers::{Seeds, Tracers};
use walls::Spun;

/// Name of the system, and of the stream of its vortons.
pub const NAME: &str = "smoke";

/// Parameters of smoke, and the times of its frames.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoke {
    /// Parameters of the preset.
    pub params: SmokeParams,
    /// Frames a second.
    pub fps: f64,
    /// The frame at time 0.
    pub first: u32,
}

/// Number of vortons at which the velocity's error is sampled.
const SAMPLES: usize = 200;

/// Smoke, its state and its surroundings.
#[derive(Debug)]
pub(super) struct System {
    params: SmokeParams,
    gravity: Vec3,
    air: Air,
    emitters: Vec<emit::Source>,
    flow: Flow,
    tracers: Tracers,
    /// Frames advanced since the start of the shot, for what happens every so many.
    frames: u32,
    skipped_in_solids: u32,
}

impl System {
    /// Seeds rings, tubes, turbulence and sources.
    pub(super) fn seed(smoke: Smoke, world: &World) -> Result<Self, SetupError> {
        refuse_kernel(&smoke.params)?;
        let mut system = Self::empty(smoke, world);
        let params = &system.params;
        let setting = Setting::of(params);
        let (mut vortons, mut seeds) = (Vortons::default(), Seeds::default());
        for (key, ring) in params.ring.iter().enumerate() {
            filaments::ring(ring, setting, key as u32, &mut vortons, &mut seeds);
        }
        for (key, tube) in params.tube.iter().enumerate() {
            filaments::tube(tube, setting, (params.ring.len() + key) as u32, &mut vortons, &mut seeds);
        }
        if let Some(turbulence) = &params.turbulence {
            turbulence::seed(turbulence, params, &mut vortons)?;
        }
        for (key, source) in params.source.iter().enumerate() {
            emit::fill(source, setting.tracers, key as u32, &mut seeds);
        }
        vortons.check()?;
        system.skipped_in_solids = seeds.retain(system.air.outside_solids(0.0));
        system.tracers.add(seeds);
        system.add(vortons);
        if system.flow.vortons.is_empty() && system.tracers.is_empty() && system.emitters.is_empty() {
            return Err(SetupError::NoSmoke);
        }
        Ok(system)
    }

    fn empty(smoke: Smoke, world: &World) -> Self {
        let Smoke { params, fps, first } = smoke;
        let spacing = params.tracer_spacing();
        let emitters = params.emitter.iter().enumerate();
        let emitters =
            emitters.map(|(key, emitter)| emit::Source::new(emitter, key as u32, spacing, fps, first));
        Self {
            gravity: world.gravity,
            air: Air::new(&params, world),
            emitters: emitters.collect(),
            flow: Flow::new(params.flow.clone()),
            tracers: Tracers::default(),
            frames: 0,
            skipped_in_solids: 0,
            params,
        }
    }

    /// Adds vortons whose volume is a cell of the seeding lattice.
    fn add(&mut self, vortons: Vortons) {
        let volume = vec![self.params.spacing.powi(3); vortons.len()];
        self.flow.add(&vortons, &volume);
    }

    /// The record of the seeding.
    pub(super) fn seeded(&self) -> SmokeSeeds {
        SmokeSeeds {
            vortons: self.flow.vortons.len() as u32,
            tracers: self.tracers.len() as u32,
            skipped_in_solids: self.skipped_in_solids,
            wind_across: self.air.across,
            narrow_cores: self.narrow_cores(),
            sourceless: self.air.walls.as_ref().map_or_else(Vec::new, |walls| walls.sourceless()),
        }
    }

    /// The number of rings and tubes whose cores are narrower than those of vortons.
    fn narrow_cores(&self) -> u32 {
        let SmokeParams { ring, tube, .. } = &self.params;
        let setting = Setting::of(&self.params);
        let thickness = ring.iter().map(|ring| ring.thickness).chain(tube.iter().map(|tube| tube.thickness));
        thickness.filter(|&thickness| setting.filament_variance(thickness) < 0.0).count() as u32
    }

    /// The passes of a step, in order.
    pub(super) fn passes(&self) -> Vec<&'static str> {
        let optional = |present: bool, name| present.then_some(name);
        [
            Some("smoke_move"),
            optional(!self.emitters.is_empty(), "smoke_emit"),
            optional(self.pushes(), "smoke_push"),
            optional(self.air.walls.is_some(), "smoke_walls"),
            optional(self.fades(), "smoke_fade"),
            Some("smoke_account"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn fades(&self) -> bool {
        self.params.dissolve.is_some() || self.params.cooling.is_some()
    }

    /// The air at `time` [s].
    fn air(&self, time: f64) -> Result<FrameAir, Diverged> {
        let air = self.air.around(self.flow.vortons.clone(), time, Spun::at(time));
        air.map_err(|error| self.diverged(0, &error))
    }

    /// Advances from `start` [s] by one frame of `seconds`; adds the air at its start and after every step to `airs`, if given.
    pub(super) fn advance(
        &mut self,
        start: f64,
        seconds: f64,
        mut airs: Option<&mut Vec<FrameAir>>,
        watch: &mut dyn Watch,
    ) -> Result<(SmokeRecord, Seconds), Stop> {
        if let Some(airs) = &mut airs {
            airs.push(self.air(start)?);
        }
        let mut clock = Clock::new(&self.passes());
        let mut record = SmokeRecord::default();
        let shortest = seconds / f64::from(self.params.flow.max_substeps);
        advance_frame([start, seconds], watch, |progress, _| {
            let span = SubstepLimits {
                remaining: progress.left,
                min_time_step: shortest,
                number: record.flow.substeps + 1,
            };
            let dt = self.step(progress.now(), span, &mut clock, &mut record)?;
            if let Some(airs) = &mut airs {
                airs.push(self.air(progress.after(dt))?);
            }
            Ok(dt)
        })?;
        self.frames += 1;
        let last = record.flow.substeps;
        record.vortons = self.flow.vortons.len() as u64;
        record.tracers = self.tracers.len() as u64;
        let samples = self.frames.is_multiple_of(self.params.sample_every).then_some(SAMPLES);
        let account = clock.time("smoke_account", || self.account(samples, start + seconds, &mut record));
        account.map_err(|error| self.diverged(last, &error))?;
        Ok((record, clock.into_totals()))
    }

    /// One step that begins at `now` [s]; returns its length [s].
    fn step(
        &mut self,
        now: f64,
        span: SubstepLimits,
        clock: &mut Clock,
        record: &mut SmokeRecord,
    ) -> Result<f64, Diverged> {
        self.air.span = [now, now + span.remaining];
        let tracers = &mut self.tracers.position;
        let report = clock.time("smoke_move", || self.flow.step(span, tracers, &mut self.air))?;
        record.flow.add(&report, None);
        let then = now + report.seconds;
        let mut emitted = Emitted::default();
        if !self.emitters.is_empty() {
            clock.time("smoke_emit", || self.emit(now, then, &mut emitted, record));
        }
        if self.pushes() {
            let pushed =
                clock.time("smoke_push", || self.push(&emitted, then, report.seconds as f32, record));
            pushed.map_err(|error| self.diverged(span.number, &error))?;
        }
        self.tracers.add(emitted.seeds);
        if self.air.walls.is_some() {
            let shed = clock.time("smoke_walls", || {
                self.project_out(then, record);
                self.shed(now, then, record)
            });
            shed.map_err(|error| self.diverged(span.number, &error))?;
        }
        if self.fades() {
            let SmokeParams { dissolve, cooling, .. } = self.params;
            clock.time("smoke_fade", || self.tracers.fade(dissolve, cooling, report.seconds));
        }
        let solids = self.air.solids(then);
        let tended =
            clock.time("smoke_move", || self.flow.remesh_if_needed(span.number, &|x| medium(&solids, x)));
        record.flow.add_remeshing(tended?);
        Ok(report.seconds)
    }

    /// Fills the record's figures of the end of a frame, at `time` [s].
    fn account(&self, samples: Option<usize>, time: f64, record: &mut SmokeRecord) -> Result<(), OutOfRange> {
        record.account = self.flow.account(samples)?;
        if self.air.walls.is_some() {
            let sources = self.air.sources(&self.flow.vortons, time, Spun::at(time))?;
            let instant = Instant { vortons: &self.flow.vortons, sources: &sources };
            record.unsolved = Some(sources.residual);
            if let Some(leak) = self.air.max_leakage(instant, time)? {
                (record.through_flow, record.leakiest) = (Some(leak.part), Some(leak.body as u32));
            }
        }
        Ok(())
    }

    /// Emits tracers; those inside a solid are rejected.
    fn emit(&self, now: f64, then: f64, emitted: &mut Emitted, record: &mut SmokeRecord) {
        self.emitters.iter().for_each(|emitter| emitter.emit(now, then, emitted));
        record.rejected += u64::from(emitted.retain(self.air.outside_solids(then)));
        record.emitted += emitted.seeds.position.len() as u64;
    }

    /// The error for a vorton or point that left the range of what can be computed.
    fn diverged(&self, substep: u32, error: &OutOfRange) -> Diverged {
        let limits = "a smaller smoke.flow.strain or a larger smoke.flow.max_substeps";
        error.diverged(substep, &self.flow.id, "points that drift along", limits)
    }
}

/// What a point is in. Beyond a plane are mirror images.
fn medium(solids: &[PlacedForm], x: Vec3) -> Medium {
    let mut medium = Medium::Air;
    for solid in solids.iter().filter(|solid| solid.contains(x)) {
        if !solid.is_plane() {
            return Medium::Solid;
        }
        medium = Medium::Mirror;
    }
    medium
}
