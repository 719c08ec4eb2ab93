//! What a simulation tells about its start and about every frame.

use super::{coupling::CouplingRecord, sheet::SheetRecord, smoke::SmokeRecord};
use serde::Serialize;
use std::time::Instant;

/// What seeding did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SeedReport {
    /// Particles of the liquid.
    pub particles: u32,
    /// Particles left out because they lay in a solid, or closer to one than half a spacing.
    pub skipped_in_solids: u32,
    /// Particles left out because an earlier source had already put one closer than 0.9 spacings.
    pub skipped_overlapping: u32,
    /// What seeding the smoke did, if there is any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokeSeeds>,
    /// Points of sheets.
    pub points: u32,
    /// Edges of sheets that go through faces of sheets from the start; 0 where no contact is looked for.
    pub crossings: u64,
}

/// What seeding smoke did.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct SmokeSeeds {
    /// Vortons.
    pub vortons: u32,
    /// Tracers.
    pub tracers: u32,
    /// Tracers left out because they lay in a solid.
    pub skipped_in_solids: u32,
    /// The part of the wind that blows at a plane and was left out [m/s].
    pub wind_across: f32,
}

/// How often a limit changed a result, summed over the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Clamps {
    /// Particle corrections shortened to half a spacing, over all iterations.
    pub corrections: u64,
    /// Substeps after which velocities were scaled down because the mechanical energy exceeded the shot's first and the
    /// work of moving solids.
    pub energy: u64,
    /// Substeps in which vorticity confinement was scaled down to stay bounded.
    pub confinement: u64,
    /// Times the accelerated solver found its iteration running away and slowed it.
    pub momentum: u32,
    /// Particles that still touched a solid after the last collision round, over all iterations.
    pub contacts: u64,
}

/// What happened in a frame: to the liquid, and in `smoke` to the smoke. Everything but `seconds` is the same on every run and for any thread count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct FrameRecord {
    /// Substeps taken.
    pub substeps: u32,
    /// Solver iterations, over all substeps.
    pub iterations: u32,
    /// Substeps that ended at `max_iterations` above the target `density_dev`; 0 with fixed `iterations`.
    pub unconverged: u32,
    /// Mean over all particles of the constraint's error at the frame's end [1]: max(C, 0) for
    /// `constraint = "compression"`, |C| for `"equality"`, with C = ρ/ρ₀ − 1. This is what `density_dev` bounds.
    pub density_dev_avg: f64,
    /// Largest constraint error at the frame's end [1].
    pub density_dev_max: f64,
    /// Mean of |C|, dilation and compression alike, over the particles whose neighbourhood is filled [1].
    pub bulk_dev_avg: f64,
    /// ½ Σ m v² at the frame's end [J].
    pub kinetic_energy: f64,
    /// −Σ m g·x at the frame's end [J]; the zero is at the world's origin.
    pub potential_energy: f64,
    /// Energy that vorticity confinement added during the frame [J].
    pub confinement_energy: f64,
    /// Work of moving solids on the liquid during the frame [J]: what the liquid's energy may rise by.
    pub solid_work: f64,
    /// Limits that changed a result.
    pub clamps: Clamps,
    /// Neighbour lists built again within a substep because particles had moved farther than the skin.
    pub list_rebuilds: u32,
    /// Substeps longer than the CFL rule allows, because of `max_substeps`.
    pub cfl_capped: u32,
    /// Particles whose centre lies inside a solid at the frame's end.
    pub particles_inside_solids: u32,
    /// What happened to the smoke, if there is any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub smoke: Option<SmokeRecord>,
    /// What happened to the sheets, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sheets: Option<SheetRecord>,
    /// What happened between systems that are coupled, if any are.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coupling: Option<CouplingRecord>,
    /// Wall-clock time of every pass that ran [s], in order of the passes. Lists rebuilt between iterations count
    /// as "solve".
    pub seconds: Vec<(&'static str, f64)>,
}

/// Seconds by pass.
pub(super) type Seconds = Vec<(&'static str, f64)>;

/// Adds up wall-clock time by pass.
#[derive(Debug)]
pub(super) struct Clock {
    totals: Seconds,
}

impl Clock {
    /// A clock for these passes.
    pub(super) fn new(passes: &[&'static str]) -> Self {
        Self { totals: passes.iter().map(|&name| (name, 0.0)).collect() }
    }

    /// Runs `job` and books its time on `pass`.
    ///
    /// # Panics
    /// If the pass was not announced: passes that are not named must not run.
    pub(super) fn time<T>(&mut self, pass: &'static str, job: impl FnOnce() -> T) -> T {
        let entry =
            self.totals.iter_mut().find(|(name, _)| *name == pass).expect("only announced passes run");
        let start = Instant::now();
        let result = job();
        entry.1 += start.elapsed().as_secs_f64();
        result
    }

    /// The same of a job that books passes of its own: theirs is not `pass`'s.
    ///
    /// # Panics
    /// If the pass was not announced.
    pub(super) fn around<T>(&mut self, pass: &'static str, job: impl FnOnce(&mut Self) -> T) -> T {
        let (start, before) = (Instant::now(), self.total());
        let result = job(self);
        let own = start.elapsed().as_secs_f64() - (self.total() - before);
        let entry =
            self.totals.iter_mut().find(|(name, _)| *name == pass).expect("only announced passes run");
        entry.1 += own;
        result
    }

    fn total(&self) -> f64 {
        self.totals.iter().map(|(_, seconds)| seconds).sum()
    }

    /// The seconds by pass.
    pub(super) fn into_totals(self) -> Seconds {
        self.totals
    }
}
