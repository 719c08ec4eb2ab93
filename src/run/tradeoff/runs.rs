//! Simulations of a tradeoff: run once, timed as often as is asked for, and kept on disk with what was measured.

use super::{Spread, sweep::Setting};
use crate::{
    cache,
    frame::FrameIndex,
    job::log,
    par,
    run::{
        Control, Reporter, RunError, ShotFolder, simulate,
        usage::{Meter, Peak},
    },
    scene::{Frames, Scene},
    sim::FrameRecord,
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// How a run is measured, beside what it cost.
pub(super) trait Measure {
    /// What comes out.
    type Found: Serialize + DeserializeOwned;

    /// Raised when rows hold something else, so that older ones are run again; with the subject's name.
    const VERSION: &str;

    /// Reads what the simulation of `place` left in `shot`.
    ///
    /// # Errors
    /// If it cannot be read, or measured.
    fn measure(
        &self,
        place: &Place<'_>,
        shot: &ShotFolder,
        control: Control,
    ) -> Result<Self::Found, RunError>;
}

/// What a run cost and what came out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row<F> {
    /// What came out.
    #[serde(flatten)]
    pub(super) found: F,
    /// Wall-clock time of the passes of all frames [s], once a repeat.
    pub(super) seconds: Vec<f64>,
    /// Processor time of all threads [s], once a repeat that was not interrupted, where the system tells.
    pub(super) cpu_seconds: Vec<f64>,
    /// The most memory that the process held [bytes], where the system tells.
    pub(super) memory: Option<u64>,
    /// Why the run ended before its last frame, if it did.
    pub(super) diverged: Option<String>,
    /// A hash of the last frame's file: a repeat must give the same.
    last_frame: u64,
}

/// Where a run is kept, and with which frames.
#[derive(Clone, Debug)]
pub(super) struct Place<'a> {
    pub(super) scene: &'a Scene,
    /// The last frame to simulate.
    pub(super) last: FrameIndex,
    /// What belongs to it.
    pub(super) folder: PathBuf,
}

/// A run that is wanted.
#[derive(Clone, Debug)]
pub(super) struct Wanted<'a> {
    pub(super) setting: &'a Setting,
    pub(super) place: Place<'a>,
    /// How often it is to be timed.
    pub(super) repeats: usize,
}

/// A finished run.
#[derive(Clone, Debug)]
pub(super) struct Run<'a, F> {
    pub(super) setting: &'a Setting,
    pub(super) place: Place<'a>,
    pub(super) row: Row<F>,
}

impl<'a> Place<'a> {
    /// The place of a run below `root`: its name is a hash of all that decides the result and its time. `decisive` is what
    /// decides it beside the simulation.
    pub(super) fn new<M: Measure>(root: &Path, scene: &'a Scene, last: FrameIndex, decisive: &str) -> Self {
        let (tool, version, threads) = (env!("CARGO_PKG_VERSION"), M::VERSION, par::threads());
        let text = format!("{version} {tool} {} {last} {decisive} {threads}", scene.simulation_key());
        let key = xxh3_64(text.as_bytes());
        Self { scene, last, folder: root.join("rows").join(format!("{key:016x}")) }
    }

    /// The row that an earlier run left here.
    fn load<F: DeserializeOwned>(&self) -> Option<Row<F>> {
        serde_json::from_str(&std::fs::read_to_string(self.folder.join("row.json")).ok()?).ok()
    }

    /// The row with at least `repeats` times, run as far as it is not there; and whether it was.
    ///
    /// # Errors
    /// Whatever stops a simulation, but for divergence, which is a result.
    fn complete<M: Measure>(
        &self,
        repeats: usize,
        how: &M,
        control: Control,
    ) -> Result<(Row<M::Found>, bool), RunError> {
        let enough = |row: &Row<M::Found>| row.diverged.is_some() || row.seconds.len() >= repeats;
        let loaded = self.load();
        let kept = loaded.as_ref().is_some_and(enough);
        let mut row = match loaded {
            Some(row) => row,
            None => self.first(how, control)?,
        };
        while !enough(&row) {
            self.again(&mut row, control)?;
        }
        Ok((row, kept))
    }

    /// Simulates, measures, keeps the figures, and gives the frames up.
    fn first<M: Measure>(&self, how: &M, control: Control) -> Result<Row<M::Found>, RunError> {
        let shot = ShotFolder::new(&self.folder);
        let (peak, meter) = (Peak::since_now(), Meter::new());
        let (done, diverged) = self.simulate(&shot, false, control)?;
        let (cpu, memory) = (meter.cpu(), peak.bytes());
        let whole = done.is_some_and(|done| done.kept == 0);
        let row = Row {
            found: how.measure(self, &shot, control)?,
            seconds: vec![seconds(&shot)?],
            cpu_seconds: cpu.filter(|_| whole).into_iter().collect(),
            memory,
            diverged,
            last_frame: last_frame(&shot)?,
        };
        self.keep(&row)?;
        remove(&shot.cache());
        Ok(row)
    }

    /// Runs it once more for the time.
    fn again<F: Serialize>(&self, row: &mut Row<F>, control: Control) -> Result<(), RunError> {
        let shot = ShotFolder::new(self.folder.join("again"));
        let meter = Meter::new();
        self.simulate(&shot, true, control)?;
        row.cpu_seconds.extend(meter.cpu());
        row.seconds.push(seconds(&shot)?);
        if last_frame(&shot)? != row.last_frame {
            return Err(RunError::Request(format!(
                "{}: a second run gave other bytes than the first; expected the same: please report this with the \
                 preset, and check the machine's memory",
                shot.root().display()
            )));
        }
        self.keep(row)?;
        remove(shot.root());
        Ok(())
    }

    /// Fills the cache; a divergence is told in words.
    fn simulate(
        &self,
        shot: &ShotFolder,
        force: bool,
        control: Control,
    ) -> Result<(Option<simulate::Simulated>, Option<String>), RunError> {
        let all = Frames::from_first_to_last(self.scene.frames.first(), self.last)
            .expect("the selection was checked to begin at the first frame or later");
        match simulate::simulate(self.scene, shot, &all, force, control) {
            Ok(done) => Ok((Some(done), None)),
            Err(RunError::Diverged { frame, diverged }) => {
                Ok((None, Some(format!("frame {frame}: {diverged}"))))
            }
            Err(other) => Err(other),
        }
    }

    fn keep<F: Serialize>(&self, row: &Row<F>) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(row).expect("a row is plain data") + "\n";
        ShotFolder::write(self.folder.join("row.json"), &text)
    }
}

/// Completes every run in turn.
///
/// # Errors
/// Whatever stops a simulation, but for divergence, which is a result.
pub(super) fn complete<'a, M: Measure>(
    wanted: Vec<Wanted<'a>>,
    how: &M,
    control: Control,
) -> Result<Vec<Run<'a, M::Found>>, RunError> {
    let count = wanted.len();
    let mut runs = Vec::with_capacity(count);
    control.reporter.begin("tradeoff", count);
    for (number, Wanted { setting, place, repeats }) in wanted.into_iter().enumerate() {
        let frames = f64::from(place.last.0 - place.scene.frames.first().0 + 1);
        let part = Part { whole: control.reporter, number, scale: 1.0 / frames };
        let (row, kept) = place.complete(repeats, how, Control { reporter: &part, ..control })?;
        let what = match (&row.diverged, kept) {
            (Some(why), _) => why.clone(),
            (None, true) => "was there".into(),
            (None, false) => {
                format!("{:.1} s", Spread::of(&row.seconds).expect("a row has been run").median)
            }
        };
        control.reporter.frame(&format!("{} of {count}  {}: {what}", number + 1, setting.label));
        control.reporter.progress((number + 1) as f64);
        runs.push(Run { setting, place, row });
    }
    control.reporter.end();
    Ok(runs)
}

/// Wall-clock time of the passes of all logged frames [s].
fn seconds(shot: &ShotFolder) -> Result<f64, RunError> {
    Ok(log::read::<FrameRecord>(shot)?.values().map(|line| line.record.total_seconds()).sum())
}

fn last_frame(shot: &ShotFolder) -> Result<u64, RunError> {
    let Some((_, path)) = cache::list(&shot.cache())?.pop() else { return Ok(0) };
    match std::fs::read(&path) {
        Ok(bytes) => Ok(xxh3_64(&bytes)),
        Err(source) => Err(RunError::File { path, source, next: "check that the folder can be read" }),
    }
}

/// Gives up what is no longer needed; what cannot be removed only takes room.
fn remove(folder: &Path) {
    let _ = std::fs::remove_dir_all(folder);
}

/// Shows one run as a part of the whole job.
struct Part<'a> {
    whole: &'a dyn Reporter,
    number: usize,
    scale: f64,
}

impl Reporter for Part<'_> {
    fn begin(&self, _job: &str, _frames: usize) {}
    fn progress(&self, frames_done: f64) {
        self.whole.progress(self.number as f64 + frames_done * self.scale);
    }
    fn frame(&self, _figures: &str) {}
    fn note(&self, text: &str) {
        // What is true of one run is true of all, and said once.
        if self.number == 0 {
            self.whole.note(text);
        }
    }
    fn end(&self) {}
    fn stop(&self) {}
}
