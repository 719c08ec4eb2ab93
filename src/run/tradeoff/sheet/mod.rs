//! Work against precision of sheets: which integrator, which substeps and which cells are worth their time.
//!
//! *Method*: every setting of a sweep is run on the same frames and kept (`row`); it is compared with a reference that is
//! finer than all of them, and the reference with a refinement of itself, which tells how small an error can be seen
//! at all (`compare`). Places are compared at the same points of the cloth, whatever its cells: those that the preset as written has, between the
//! points of other grids by bilinear interpolation, as a picture of them shows it.
//!
//! The whole shot is run, with what else it has: what is coupled to sheets moves them.
//!
//! Limits: folds of thin cloth are chaotic, and then no two runs agree on them; the line *certainty* tells.

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
    scene::{Frames, Scene},
    sim::sheet::SheetRecord,
};
use compare::{energy, places};
use row::{Figures, Woven};
use serde::Serialize;
use std::path::Path;

/// The error that decides which settings are on the front.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// Distance of points from the reference's, root mean square.
    Distance,
    /// The largest of these distances.
    Farthest,
    /// Energy of motion, springs and height against the reference's.
    Energy,
}

impl By {
    /// Every one.
    pub const ALL: [Self; 3] = [Self::Distance, Self::Farthest, Self::Energy];
}

/// Sheets, and what their table says besides the lines.
#[derive(Clone, Debug, Serialize)]
pub struct Cloth {
    /// The frames that were compared.
    pub frames: Frames,
    /// Mean distance between the points of the sheets as written [m].
    pub spacing: f64,
}

/// A setting of sheets.
pub type Line = super::Line<Cloth>;

/// The result of a tradeoff.
pub type Table = super::Table<Cloth>;

/// What a run alone tells.
#[derive(Clone, Debug, Serialize)]
pub struct Told {
    /// Points of all sheets.
    pub points: u64,
    /// Substeps a frame.
    pub substeps: f64,
    /// Rounds of the conjugate gradients a frame.
    pub iterations: f64,
    /// Substeps whose conjugate gradients ended above the tolerance, over all frames.
    pub unconverged: u32,
    /// Substeps in which one linearisation made energy, over all frames.
    pub overshot: u32,
    /// Largest strain of a spring at the end of any frame, as a fraction.
    pub strain: f64,
    /// Points put out of solids, over all frames.
    pub caught: u64,
    /// Points within a solid at a frame's end, over all frames.
    pub inside: u64,
    /// The most memory that the process held [bytes].
    pub memory: Option<u64>,
}

impl Compared for Cloth {
    type By = By;
    type Told = Told;
    type Apart = Apart;

    const LIMITED: By = By::Distance;
    const WITHOUT_REFERENCE: &'static str = "name another with --reference, such as \
                                             sheets.solver.integrator=implicit with sheets.solver.substeps=200";

    fn needs_reference(_: By) -> bool {
        true
    }

    fn error(by: By, _: &Told, apart: &Apart) -> Option<f64> {
        match by {
            By::Distance => apart.distance,
            By::Farthest => apart.farthest,
            By::Energy => apart.energy,
        }
    }

    fn unit(&self) -> f64 {
        self.spacing
    }

    fn limit(most: f64) -> String {
        format!("points off by {}% of the distance between them", 100.0 * most)
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
    let woven = Woven::new(&sweep.base);
    let decisive = woven.to_string();
    // The references last: what the allocator keeps of them would show in the memory of the rest.
    let all: Vec<&(Setting, Scene)> = sweep.rows.iter().chain([&sweep.reference, &sweep.refined]).collect();
    let wanted = all.into_iter().enumerate().map(|(number, (setting, scene))| Wanted {
        setting,
        place: Place::new::<Woven>(folder, scene, selection.last(), &decisive),
        // The reference and its refinement are wanted for their frames, not for their time.
        repeats: if number < sweep.rows.len() { repeats } else { 1 },
    });
    let runs = runs::complete(wanted.collect(), &woven, control)?;
    tabulate(sweep, selection, &runs, by)
}

fn tabulate(sweep: &Sweep, selection: &Frames, runs: &[Run<'_, Figures>], by: By) -> Result<Table, RunError> {
    let wanted = |frame: u32| selection.contains(FrameIndex(frame));
    let [rows @ .., reference, refined] = runs else {
        unreachable!("a sweep has a reference and its refinement");
    };
    let at = |run: &Run<'_, Figures>| line(run, sweep, selection);
    let against = |run: &Run<'_, Figures>| -> Result<Apart, RunError> {
        // A reference that ended early says nothing about the frames after.
        if reference.row.diverged.is_some() {
            return Ok(Apart::default());
        }
        let [distance, farthest] =
            places((&run.place, &run.row), (&reference.place, &reference.row), &wanted)?;
        Ok(Apart { distance, farthest, energy: energy(&run.row, &reference.row, &wanted) })
    };
    let mut lines = Vec::new();
    for (number, run) in rows.iter().enumerate() {
        let is_same = |other: &Run<'_, Figures>| {
            let (a, b) = (&other.row, &run.row);
            a.diverged.is_none() && b.diverged.is_none() && row::show_the_same(a, b)
        };
        let same_as = rows[..number].iter().position(is_same);
        lines.push(Line { apart: against(run)?, same_as, ..at(run) });
    }
    let uncertainty = if refined.row.diverged.is_some() { Apart::default() } else { against(refined)? };
    let references = [at(reference), Line { apart: uncertainty, ..at(refined) }];
    // The first row is the preset as written.
    let spacing = rows.first().map_or(0.0, |run| run.row.found.spacing);
    let about = Cloth { frames: selection.clone(), spacing };
    Ok(Table::new(&sweep.base.title, about, by, lines, references))
}

/// What a run alone says, without the reference.
fn line(Run { setting, row, .. }: &Run<'_, Figures>, sweep: &Sweep, selection: &Frames) -> Line {
    let logged: Vec<&SheetRecord> = row.found.frames.iter().filter_map(|seen| seen.logged.as_ref()).collect();
    let mean = |of: fn(&SheetRecord) -> u32| {
        logged.iter().map(|line| f64::from(of(line))).sum::<f64>() / logged.len().max(1) as f64
    };
    let first = sweep.base.frames.first().0;
    let [slice, shot] = [selection.last(), sweep.base.frames.last()].map(|last| f64::from(last.0 - first));
    let [seconds, cpu_seconds] = [&row.seconds, &row.cpu_seconds].map(|times| Spread::of(times));
    let whole = seconds.map_or(0.0, |spread| spread.median) * shot / slice.max(1.0);
    let told = Told {
        points: row.found.points,
        substeps: mean(|line| line.substeps),
        iterations: mean(|line| line.iterations),
        unconverged: logged.iter().map(|line| line.unconverged).sum(),
        overshot: logged.iter().map(|line| line.overshot).sum(),
        strain: logged.iter().map(|line| line.strain_max).fold(0.0, f64::max),
        caught: logged.iter().map(|line| line.projected_out).sum(),
        inside: logged.iter().map(|line| line.inside_solids).sum(),
        memory: row.memory,
    };
    Line { diverged: row.diverged.clone(), ..Line::new(setting, [seconds, cpu_seconds], whole, told) }
}
