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
    Spread,
    pareto::{self, Candidate},
    runs::{self, Place, Run, Wanted},
    sweep::{Setting, Sweep},
};
use crate::{
    cache::Lock,
    run::{Control, RunError, ShotFolder, log, simulate},
    scene::Frames,
    sim::Observable,
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

/// One line of the table.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// The keys that the setting changes.
    pub label: String,
    /// The changes, as `--set` takes them.
    pub set: Vec<String>,
    /// The preset's tier, if the setting is one.
    pub quality: Option<String>,
    /// Wall-clock time of the slice's simulation [s].
    pub seconds: Spread,
    /// Processor time of the same [s].
    pub cpu_seconds: Option<Spread>,
    /// The whole shot's simulation, if its other frames cost as much [s].
    pub shot_seconds: f64,
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
    /// Distances from the reference.
    pub apart: Apart,
    /// Why and where the run ended early.
    pub diverged: Option<String>,
    /// The first line that gave the same frames, if another did: what tells them apart does nothing here.
    pub same_as: Option<usize>,
    /// Whether nothing beats it, by the chosen error.
    pub front: bool,
}

/// The result of a tradeoff.
#[derive(Clone, Debug, Serialize)]
pub struct Table {
    /// The shot's name.
    pub title: String,
    /// The frames that were compared.
    pub frames: Frames,
    /// Threads that computed.
    pub threads: usize,
    /// What was observed.
    pub observable: Observable,
    /// The error that decides.
    pub by: By,
    /// The settings.
    pub lines: Vec<Line>,
    /// The reference.
    pub reference: Line,
    /// The reference refined once more.
    pub refined: Line,
    /// How far these two are apart: smaller errors cannot be told from none.
    pub uncertainty: Apart,
    /// The last frame up to which particles can be compared.
    pub horizon: Option<u32>,
    /// The line after which more time buys little.
    pub knee: Option<usize>,
}

impl Table {
    /// The error of a line that decides, as it can be judged: at least the reference's own uncertainty. `None` if
    /// there is none, or the run diverged.
    pub fn judged(&self, line: &Line, by: By) -> Option<f64> {
        if line.diverged.is_some() {
            return None;
        }
        let at_least =
            |found: Option<f64>, floor: Option<f64>| found.map(|found| found.max(floor.unwrap_or(0.0)));
        match by {
            By::Density => Some(line.density_dev_avg),
            By::Energy => at_least(line.apart.energy, self.uncertainty.energy),
            By::Observable => at_least(line.apart.observable, self.uncertainty.observable),
        }
    }

    /// The front by `by`: indices of lines, ascending in cost.
    pub fn front(&self, by: By) -> Vec<usize> {
        pareto::front(&self.points(by))
    }

    /// Time and error of every line.
    fn points(&self, by: By) -> Vec<Option<(f64, f64)>> {
        let point = |line| self.judged(line, by).map(|error| (line.seconds.median, error));
        self.lines.iter().map(point).collect()
    }

    /// The setting to use: the most exact that takes at most `time` [s] for the whole shot, the cheapest whose mean
    /// density deviation is at most `dev`, or with neither the knee.
    ///
    /// # Errors
    /// [`RunError::NoSetting`] if no line keeps the limits; [`RunError::Request`] if `time` alone is to decide and nothing can
    /// be compared, because the reference diverged.
    pub fn choose(&self, time: Option<f64>, dev: Option<f64>) -> Result<Option<usize>, RunError> {
        if time.is_none() && dev.is_none() {
            return Ok(self.knee);
        }
        if dev.is_none() && self.by != By::Density && self.reference.diverged.is_some() {
            return Err(RunError::Request(
                "--time: the reference diverged, so nobody knows which setting is the most exact; name another with \
                 --reference, or choose with --by density or --dev"
                    .into(),
            ));
        }
        let candidate = |line: &Line| Candidate {
            cost: line.seconds.median,
            whole: line.shot_seconds,
            error: self.judged(line, self.by),
            dev: line.diverged.is_none().then_some(line.density_dev_avg),
        };
        let best = pareto::choose(self.lines.iter().map(candidate), time, dev);
        best.map(Some).ok_or_else(|| RunError::NoSetting { wanted: wanted(time, dev) })
    }
}

fn wanted(time: Option<f64>, dev: Option<f64>) -> String {
    let time = time.map(|time| format!("{time} s for the shot"));
    let dev = dev.map(|dev| format!("a mean density deviation of {}%", 100.0 * dev));
    [time, dev].into_iter().flatten().collect::<Vec<_>>().join(" and ")
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
    let mut table = Table {
        title: sweep.base.title.clone(),
        frames: selection.clone(),
        threads: crate::par::threads(),
        observable,
        by,
        lines,
        reference: at(reference),
        refined: at(refined),
        uncertainty: if refined.row.diverged.is_some() { Apart::default() } else { against(refined)? },
        horizon: last,
        knee: None,
    };
    let front = table.front(by);
    table.knee = pareto::knee_of(&table.points(by), &front);
    for i in front {
        table.lines[i].front = true;
    }
    Ok(table)
}

/// What a run alone says, without the reference.
fn line(setting: &Setting, row: &Row, sweep: &Sweep, selection: &Frames) -> Line {
    let logged: Vec<_> = row.found.frames.iter().filter_map(|seen| seen.logged.as_ref()).collect();
    let judged: Vec<_> = logged.iter().filter(|line| selection.contains(line.frame)).collect();
    let mean = |value: &dyn Fn(&log::Logged) -> f64| {
        judged.iter().map(|line| value(line)).sum::<f64>() / judged.len().max(1) as f64
    };
    let first = sweep.base.frames.first().0;
    let [slice, shot] = [selection.last(), sweep.base.frames.last()].map(|last| f64::from(last.0 - first));
    let seconds = Spread::of(&row.seconds).expect("a row has been run");
    Line {
        label: setting.label.clone(),
        set: setting.overrides.set.clone(),
        quality: setting.overrides.quality.map(|tier| tier.name().into()),
        shot_seconds: seconds.median * shot / slice.max(1.0),
        seconds,
        cpu_seconds: Spread::of(&row.cpu_seconds),
        particles: row.found.particles,
        substeps: mean(&|line| f64::from(line.substeps)),
        iterations: mean(&|line| f64::from(line.iterations)),
        unconverged: logged.iter().map(|line| line.unconverged).sum(),
        density_dev_avg: mean(&|line| line.density_dev_avg),
        density_dev_max: mean(&|line| line.density_dev_max),
        density_dev_largest: judged.iter().map(|line| line.density_dev_max).fold(0.0, f64::max),
        volume_change: row.found.volume_change,
        apart: Apart::default(),
        diverged: row.diverged.clone(),
        same_as: None,
        front: false,
    }
}
