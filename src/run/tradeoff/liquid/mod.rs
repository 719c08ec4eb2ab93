//! Work against precision of the simulation: which settings of the solver are worth their time.
//!
//! *Method*: every setting of a sweep is run on the same frames and kept (`row`); it is compared with a reference that is
//! finer than all of them, and the reference with a refinement of itself, which tells how small an error can be seen
//! at all (`compare`).
//!
//! Limits: splashing liquid is chaotic, so paths part after some frames; extents and energies are compared over all of
//! them, particles only as long as the reference agrees with its own refinement.

mod compare;
mod files;
mod row;

#[cfg(test)]
mod tests;

pub use compare::Apart;
pub use files::write;

use super::{
    Compared, Spread,
    runs::{self, Place, Run, Wanted},
    sweep::{Setting, Sweep},
};
use crate::{
    cache::Lock,
    frame::FrameIndex,
    run::{Control, RunError, ShotFolder, simulate},
    scene::Frames,
    sim::{Observable, liquid::LiquidRecord},
};
use compare::{curves, horizon, position};
use row::{Figures, Particles, Row, show_the_same};
use serde::Serialize;
use std::path::Path;

/// The error that decides which settings are on the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// Density deviation, mean of the frames' averages: needs no reference.
    Density,
    /// Mechanical energy against the reference.
    Energy,
    /// The observable against the reference.
    Observable,
}

impl By {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Density, Self::Energy, Self::Observable];
}

/// A liquid, and what its table says besides the lines.
#[derive(Clone, Debug, Serialize)]
pub struct Liquid {
    /// The frames that were compared.
    pub frames: Frames,
    /// What was observed.
    pub observable: Observable,
    /// The last frame up to which particles can be compared.
    pub horizon: Option<u32>,
}

/// A setting of a liquid.
pub type Line = super::Line<Liquid>;

/// The result of a tradeoff.
pub type Table = super::Table<Liquid>;

/// What a run alone tells.
#[derive(Clone, Debug, Serialize)]
pub struct Told {
    /// Particles.
    pub particles: usize,
    /// Substeps a frame.
    pub substeps: f64,
    /// Iterations a frame.
    pub iterations: f64,
    /// Substeps that ended above the target, over all frames.
    pub unconverged: u32,
    /// Density deviation, as fractions: mean of averages.
    pub density_dev_avg: f64,
    /// Mean of the frames' maxima.
    pub density_dev_max: f64,
    /// Largest of all frames.
    pub density_dev_largest: f64,
    /// The surface's volume in the last frame over that in the first, less one.
    pub volume_change: Option<f64>,
}

impl Compared for Liquid {
    type By = By;
    type Told = Told;
    type Apart = Apart;

    const LIMITED: By = By::Density;
    const WITHOUT_REFERENCE: &'static str =
        "name another with --reference, or choose with --by density or --dev";

    fn needs_reference(by: By) -> bool {
        by != By::Density
    }

    fn error(by: By, told: &Told, apart: &Apart) -> Option<f64> {
        match by {
            By::Density => Some(told.density_dev_avg),
            By::Energy => apart.energy,
            By::Observable => apart.observable,
        }
    }

    fn limit(most: f64) -> String {
        format!("a mean density deviation of {}%", 100.0 * most)
    }
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
    let all = [&sweep.reference, &sweep.refined].into_iter().chain(&sweep.rows);
    let wanted = all.enumerate().map(|(number, (setting, scene))| {
        let surface = serde_json::to_string(&scene.surface).expect("settings are plain data");
        let place = Place::new::<Particles>(folder, scene, selection.last(), &surface);
        // The reference and its refinement are wanted for their frames, not for their time.
        Wanted { setting, place, repeats: if number < 2 { 1 } else { repeats } }
    });
    let runs = runs::complete(wanted.collect(), &Particles, control)?;
    tabulate(sweep, selection, &runs, by)
}

fn tabulate(sweep: &Sweep, selection: &Frames, runs: &[Run<'_, Figures>], by: By) -> Result<Table, RunError> {
    let observable = sweep.base.tradeoff.clone().unwrap_or_default().observable;
    let wanted = |frame: u32| selection.contains(crate::frame::FrameIndex(frame));
    let [reference, refined, rows @ ..] = runs else {
        unreachable!("a sweep has a reference and its refinement");
    };
    let at = |run: &Run<'_, Figures>| line(run.setting, &run.row, sweep, selection);
    let last = horizon((&reference.place, &reference.row), (&refined.place, &refined.row))?;
    let against = |run: &Run<'_, Figures>| -> Result<Apart, RunError> {
        // A reference that ended early says nothing about the frames after.
        if reference.row.diverged.is_some() {
            return Ok(Apart::default());
        }
        let apart = curves(&run.row, &reference.row, observable, &wanted);
        let position = position((&run.place, &run.row), (&reference.place, &reference.row), last)?;
        Ok(Apart { position, ..apart })
    };
    let mut lines = Vec::new();
    for (place, run) in rows.iter().enumerate() {
        let same_as = rows[..place].iter().position(|other| show_the_same(&other.row, &run.row));
        lines.push(Line { apart: against(run)?, same_as, ..at(run) });
    }
    let uncertainty = if refined.row.diverged.is_some() { Apart::default() } else { against(refined)? };
    let references = [at(reference), Line { apart: uncertainty, ..at(refined) }];
    let about = Liquid { frames: selection.clone(), observable, horizon: last };
    Ok(Table::new(&sweep.base.title, about, by, lines, references))
}

/// What a run alone says, without the reference.
fn line(setting: &Setting, row: &Row, sweep: &Sweep, selection: &Frames) -> Line {
    let logged = || row.found.frames.iter().filter_map(|seen| Some((seen.frame, seen.logged.as_ref()?)));
    let judged: Vec<&LiquidRecord> = logged()
        .filter(|(frame, _)| selection.contains(FrameIndex(*frame)))
        .map(|(_, record)| record)
        .collect();
    let mean = |value: &dyn Fn(&LiquidRecord) -> f64| {
        judged.iter().map(|line| value(line)).sum::<f64>() / judged.len().max(1) as f64
    };
    let first = sweep.base.frames.first().0;
    let [slice, shot] = [selection.last(), sweep.base.frames.last()].map(|last| f64::from(last.0 - first));
    let [seconds, cpu_seconds] = [&row.seconds, &row.cpu_seconds].map(|times| Spread::of(times));
    let whole = seconds.map_or(0.0, |spread| spread.median) * shot / slice.max(1.0);
    let told = Told {
        particles: row.found.particles,
        substeps: mean(&|line| f64::from(line.substeps)),
        iterations: mean(&|line| f64::from(line.iterations)),
        unconverged: logged().map(|(_, record)| record.unconverged).sum(),
        density_dev_avg: mean(&|line| line.density_dev_avg),
        density_dev_max: mean(&|line| line.density_dev_max),
        density_dev_largest: judged.iter().map(|line| line.density_dev_max).fold(0.0, f64::max),
        volume_change: row.found.volume_change,
    };
    Line { diverged: row.diverged.clone(), ..Line::new(setting, [seconds, cpu_seconds], whole, told) }
}
