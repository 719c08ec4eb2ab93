//! Work against precision of smoke: which settings of its motion and of its volumes are worth their time.
//!
//! *Method*: every setting of a sweep is run on the same frames and kept (`row`); it is compared with a reference that is
//! finer than all of them, and the reference with a refinement of itself, which tells how small an error can be seen
//! at all (`compare`). The velocity is also compared with the sum over all pairs, at sampled vortons of every frame, and the
//! volume of the last frame with the sum over its tracers (`grids`): these two errors need no reference.
//!
//! Turbulent smoke is chaotic, so nothing is compared tracer by tracer: densities on a lattice of two spacings, where the
//! smoke is as a whole, and what its motion keeps.
//!
//! Limits: a measure of places says nothing of swirls smaller than the lattice's cells.

mod compare;
mod files;
mod grids;
mod row;

#[cfg(test)]
mod tests;

pub use compare::{Apart, Drift};
pub use files::write;

use super::{
    Compared, Spread,
    runs::{self, Place, Run, Wanted},
    sweep::{Setting, Sweep},
};
use crate::{
    cache::Lock,
    run::{Control, RunError, ShotFolder, simulate},
    scene::{Frames, Scene},
    sim::smoke::SmokeRecord,
};
use compare::{curves, density, drift};
use grids::Grids;
use row::{Figures, Smoky};
use serde::Serialize;
use std::path::Path;

/// Cells of the lattice on which densities are compared, in spacings of the preset's vortons: finer ones tell swirls apart that no
/// setting of a shot makes at the same place twice.
const CELL: f32 = 2.0;

/// The error that decides which settings are on the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// The share of the smoke that is elsewhere than the reference's.
    Density,
    /// The centre of the smoke against the reference's.
    Center,
    /// The size of the smoke against the reference's.
    Extent,
    /// Energy of the air against the reference's.
    Energy,
    /// Impulse of the air against the reference's.
    Impulse,
    /// The velocity against the sum over all pairs: needs no reference.
    Velocity,
    /// The volume's density against the sum over tracers, for the time that volumes take alone: needs no reference.
    Voxel,
}

impl By {
    /// Every one.
    pub const ALL: [Self; 7] =
        [Self::Density, Self::Center, Self::Extent, Self::Energy, Self::Impulse, Self::Velocity, Self::Voxel];
}

/// Smoke, and what its table says besides the lines.
#[derive(Clone, Debug, Serialize)]
pub struct Smoke {
    /// The frames that were compared.
    pub frames: Frames,
    /// Cells of the lattice on which densities are compared [m].
    pub cell: f32,
}

/// A setting of smoke.
pub type Line = super::Line<Smoke>;

/// The result of a tradeoff.
pub type Table = super::Table<Smoke>;

/// What a run alone tells. Errors are fractions.
#[derive(Clone, Debug, Serialize)]
pub struct Told {
    /// Wall-clock time of the last frame's volume [s]; `None`: none is made.
    pub volume_seconds: Option<Spread>,
    /// The most memory that the process held, simulating and making volumes [bytes].
    pub memory: Option<u64>,
    /// The cached frames of the slice [bytes].
    pub cache: u64,
    /// The last frame's volume [bytes].
    pub volume: Option<u64>,
    /// Vortons in the last frame.
    pub vortons: usize,
    /// Tracers in the last frame.
    pub tracers: usize,
    /// Steps a frame.
    pub substeps: f64,
    /// Steps longer than the limits ask for, over all frames.
    pub capped: u32,
    /// Strengths cut, over all frames.
    pub clamped: u64,
    /// Error of the velocity against the sum over all pairs, largest of the frames.
    pub velocity: Option<f64>,
    /// Error of the volume's density between nodes.
    pub voxel: Option<f64>,
    /// What motion keeps, at the end against the start.
    pub drift: Drift,
}

impl Compared for Smoke {
    type By = By;
    type Told = Told;
    type Apart = Apart;

    const LIMITED: By = By::Density;
    const WITHOUT_REFERENCE: &'static str =
        "name another with --reference, or choose by --time with --by velocity";

    fn needs_reference(by: By) -> bool {
        !matches!(by, By::Velocity | By::Voxel)
    }

    fn error(by: By, told: &Told, apart: &Apart) -> Option<f64> {
        match by {
            By::Density => apart.density,
            By::Center => apart.center,
            By::Extent => apart.extent,
            By::Energy => apart.energy,
            By::Impulse => apart.impulse,
            By::Velocity => told.velocity,
            By::Voxel => told.voxel,
        }
    }

    fn seconds(by: By, line: &Line) -> Option<Spread> {
        if by == By::Voxel { line.told.volume_seconds } else { Some(line.seconds) }
    }

    fn limit(most: f64) -> String {
        format!("at most {}% of the smoke elsewhere", 100.0 * most)
    }
}

/// A run and its volumes.
struct Made<'a> {
    run: Run<'a, Figures>,
    grids: Option<Grids>,
}

/// Runs what is not there yet and tabulates everything. Rows live in `folder`, a folder each.
///
/// # Errors
/// Whatever stops a run but divergence, which is a result. Finished rows are kept.
pub fn tradeoff(
    sweep: &Sweep,
    selection: &Frames,
    folder: &Path,
    repeats: usize,
    by: By,
    control: Control,
) -> Result<Table, RunError> {
    simulate::check_selection(&sweep.base, selection)?;
    let rows_folder = folder.join("rows");
    ShotFolder::create(&rows_folder)?;
    let _lock = Lock::acquire(&rows_folder)?;
    let spacing = sweep.base.smoke.as_ref().map_or(0.0, |smoke| smoke.spacing);
    let cell = CELL * spacing;

    // The references last: what the allocator keeps of them would show in the memory of the rest.
    let all: Vec<(&Setting, Scene)> = sweep
        .rows
        .iter()
        .chain([&sweep.reference, &sweep.refined])
        .map(|(setting, scene)| (setting, alone(scene)))
        .collect();
    // The reference and its refinement are wanted for their frames, not for their time.
    let often = |number: usize| if number < sweep.rows.len() { repeats } else { 1 };
    let wanted = all.iter().enumerate().map(|(number, (setting, scene))| Wanted {
        setting,
        place: Place::new::<Smoky>(folder, scene, selection.last(), &cell.to_string()),
        repeats: often(number),
    });
    let runs = runs::complete(wanted.collect(), &Smoky { cell }, control)?;

    // A volume of the last frame of each.
    control.reporter.begin("volumes", runs.len());
    let mut made = Vec::with_capacity(runs.len());
    for (number, run) in runs.into_iter().enumerate() {
        let grids = grids::complete(&run.place, &run.row, often(number), control)?;
        made.push(Made { run, grids });
        control.reporter.progress((number + 1) as f64);
    }
    control.reporter.end();
    tabulate(sweep, selection, &made, cell, by)
}

/// The smoke of a scene, whose error is sampled in every frame.
fn alone(scene: &Scene) -> Scene {
    let mut alone = Scene { liquid: None, ..scene.clone() };
    if let Some(smoke) = &mut alone.smoke {
        smoke.sample_every = 1;
    }
    alone
}

fn tabulate(
    sweep: &Sweep,
    selection: &Frames,
    made: &[Made<'_>],
    cell: f32,
    by: By,
) -> Result<Table, RunError> {
    let wanted = |frame: u32| selection.contains(crate::frame::FrameIndex(frame));
    let [rows @ .., reference, refined] = made else {
        unreachable!("a sweep has a reference and its refinement");
    };
    let at = |made: &Made<'_>| line(made, sweep, selection);
    let against = |Made { run, .. }: &Made<'_>| -> Result<Apart, RunError> {
        // A reference that ended early says nothing about the frames after.
        if reference.run.row.diverged.is_some() {
            return Ok(Apart::default());
        }
        let (place, row) = (&reference.run.place, &reference.run.row);
        let density = density((&run.place, &run.row), (place, row), &wanted)?;
        Ok(Apart { density, ..curves(&run.row, row, &wanted) })
    };
    let mut lines = Vec::new();
    for (number, made) in rows.iter().enumerate() {
        let is_same = |other: &Made<'_>| {
            let (a, b) = (&other.run.row, &made.run.row);
            a.diverged.is_none() && b.diverged.is_none() && a.found.frames == b.found.frames
        };
        let same_as = rows[..number].iter().position(is_same);
        lines.push(Line { apart: against(made)?, same_as, ..at(made) });
    }
    let uncertainty = if refined.run.row.diverged.is_some() { Apart::default() } else { against(refined)? };
    let references = [at(reference), Line { apart: uncertainty, ..at(refined) }];
    let about = Smoke { frames: selection.clone(), cell };
    Ok(Table::new(&sweep.base.title, about, by, lines, references))
}

/// What a run alone says, without the reference.
fn line(Made { run, grids }: &Made<'_>, sweep: &Sweep, selection: &Frames) -> Line {
    let Run { setting, row, .. } = run;
    let logged: Vec<&SmokeRecord> = row.found.frames.iter().filter_map(|seen| seen.logged.as_ref()).collect();
    let chosen =
        row.found.frames.iter().filter(|seen| selection.contains(crate::frame::FrameIndex(seen.frame)));
    let errors = chosen.filter_map(|seen| seen.logged.as_ref()?.account.error);
    let first = sweep.base.frames.first().0;
    let [slice, shot] = [selection.last(), sweep.base.frames.last()].map(|last| f64::from(last.0 - first));
    let [seconds, cpu_seconds] = [&row.seconds, &row.cpu_seconds].map(|times| Spread::of(times));
    let volume_seconds = grids.as_ref().and_then(|grids| Spread::of(&grids.seconds));
    let volumes = volume_seconds.map_or(0.0, |spread| spread.median * sweep.base.frames.count() as f64);
    let whole = seconds.map_or(0.0, |spread| spread.median) * shot / slice.max(1.0) + volumes;
    let counts = row.found.frames.last().map_or([0; 2], |seen| seen.counts);
    let told = Told {
        volume_seconds,
        memory: row.memory.max(grids.as_ref().and_then(|grids| grids.memory)),
        cache: row.found.cache,
        volume: grids.as_ref().map(|grids| grids.bytes),
        vortons: counts[0],
        tracers: counts[1],
        substeps: logged.iter().map(|line| f64::from(line.flow.substeps)).sum::<f64>()
            / logged.len().max(1) as f64,
        capped: logged.iter().map(|line| line.flow.capped).sum(),
        clamped: logged.iter().map(|line| line.flow.clamped).sum(),
        velocity: errors.reduce(f64::max),
        voxel: grids.as_ref().and_then(|grids| grids.error),
        drift: drift(row),
    };
    Line { diverged: row.diverged.clone(), ..Line::new(setting, [seconds, cpu_seconds], whole, told) }
}
