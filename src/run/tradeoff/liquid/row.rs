//! One run of a tradeoff: what it cost and what came out, kept on disk so that it is never run twice.

use crate::{
    cache,
    frame::{Frame, FrameIndex, Stream},
    mesh, par,
    run::{Control, RunError, ShotFolder, log, remarks, simulate, tradeoff::Setting, usage::Meter},
    scene::{Frames, Scene},
    sim::Observable,
};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// What a run cost and what came out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// Particles.
    pub particles: usize,
    /// Distance between them at rest [m].
    pub spacing: f32,
    /// Wall-clock time of the passes of all frames [s], once a repeat.
    pub seconds: Vec<f64>,
    /// Processor time of all threads [s], once a repeat that was not interrupted, where the system tells.
    pub cpu_seconds: Vec<f64>,
    /// What was seen in every frame.
    pub frames: Vec<Seen>,
    /// The surface's volume in the last frame over that in the first, less one.
    pub volume_change: Option<f64>,
    /// Why the run ended before its last frame, if it did.
    pub diverged: Option<String>,
    /// A hash of the last frame's file: a repeat must give the same.
    last_frame: u64,
}

/// What was seen in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Its number.
    pub frame: u32,
    /// Every observable, in the order of [`Observable::ALL`].
    pub observables: Vec<f64>,
    /// What the simulation's log says; the first frame has none.
    pub logged: Option<log::Logged>,
}

impl Row {
    /// Whether every observable has the same values to the last digit in all frames of both, as it has if they show the
    /// same particles. No if one of them diverged.
    pub(super) fn shows_the_same(&self, other: &Self) -> bool {
        let shown = |row: &Self| {
            let frames = row.frames.iter();
            frames.map(|seen| (seen.frame, seen.observables.clone())).collect::<Vec<_>>()
        };
        self.diverged.is_none() && other.diverged.is_none() && shown(self) == shown(other)
    }
}

/// Where a run is kept, and with which frames.
#[derive(Clone, Debug)]
pub(super) struct Place<'a> {
    pub(super) scene: &'a Scene,
    /// The last frame to simulate.
    pub(super) last: FrameIndex,
    folder: PathBuf,
}

/// Particles that are kept of every frame to compare positions with: enough that the mean of their distances is known
/// to 2 %.
const KEPT_PARTICLES: usize = 4096;

/// Raised when rows hold something else, so that older ones are run again.
const VERSION: u32 = 1;

impl<'a> Place<'a> {
    /// The place of a run below `root`: its name is a hash of all that decides the result and its time.
    pub(super) fn new(root: &Path, scene: &'a Scene, last: FrameIndex) -> Self {
        let surface = serde_json::to_string(&scene.surface).expect("settings are plain data");
        let tool = env!("CARGO_PKG_VERSION");
        let text = format!("{VERSION} {tool} {} {last} {surface} {}", scene.simulation_key(), par::threads());
        let key = xxh3_64(text.as_bytes());
        Self { scene, last, folder: root.join("rows").join(format!("{key:016x}")) }
    }

    /// The row that an earlier run left here.
    pub(super) fn load(&self) -> Option<Row> {
        serde_json::from_str(&std::fs::read_to_string(self.folder.join("row.json")).ok()?).ok()
    }

    /// The row with at least `repeats` times, run as far as it is not there.
    ///
    /// # Errors
    /// Whatever stops a simulation, but for divergence, which is a result.
    pub(super) fn complete(&self, repeats: usize, control: Control) -> Result<Row, RunError> {
        let mut row = match self.load() {
            Some(row) => row,
            None => self.first(control)?,
        };
        while row.diverged.is_none() && row.seconds.len() < repeats {
            self.again(&mut row, control)?;
        }
        Ok(row)
    }

    /// Simulates, measures, keeps the figures and a sample of the particles, and gives the frames up.
    fn first(&self, control: Control) -> Result<Row, RunError> {
        let shot = ShotFolder::new(&self.folder);
        let meter = Meter::new();
        let (done, diverged) = self.simulate(&shot, false, control)?;
        let mut row = self.measure(&shot, control)?;
        row.cpu_seconds.extend(meter.cpu().filter(|_| done.is_some_and(|done| done.kept == 0)));
        row.diverged = diverged;
        self.keep(&row)?;
        remove(&shot.cache());
        Ok(row)
    }

    /// Runs it once more for the time.
    fn again(&self, row: &mut Row, control: Control) -> Result<(), RunError> {
        let shot = ShotFolder::new(self.folder.join("again"));
        let meter = Meter::new();
        self.simulate(&shot, true, control)?;
        row.cpu_seconds.extend(meter.cpu());
        row.seconds.push(log::read(&shot)?.iter().map(|line| line.seconds()).sum());
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

    /// Reads what the simulation left.
    fn measure(&self, shot: &ShotFolder, control: Control) -> Result<Row, RunError> {
        let samples = self.folder.join("sample");
        ShotFolder::create(&samples)?;
        let logged = log::read(shot)?;
        let mut row = Row {
            particles: 0,
            spacing: self.scene.liquid.as_ref().map_or(0.0, |liquid| liquid.spacing),
            seconds: vec![logged.iter().map(|line| line.seconds()).sum()],
            cpu_seconds: Vec::new(),
            frames: Vec::new(),
            volume_change: None,
            diverged: None,
            last_frame: last_frame(shot)?,
        };
        let present = cache::list(&shot.cache())?;
        let mut volumes = Vec::new();
        for (place, (index, path)) in present.iter().enumerate() {
            let (frame, _) = cache::read_frame(path)?;
            let Some(stream) = frame.streams.first() else { continue };
            row.particles = stream.len();
            let observables = Observable::ALL.iter().filter_map(|what| what.of(stream)).collect();
            let line = logged.iter().find(|line| line.frame == *index).cloned();
            row.frames.push(Seen { frame: index.0, observables, logged: line });
            cache::write_frame(&samples, &sample(&frame, stream), 0)?;
            if place == 0 || place + 1 == present.len() {
                volumes.push(self.volume(stream, row.spacing, control)?);
            }
        }
        if let [first, last] = volumes[..] {
            row.volume_change = Some(last / first - 1.0);
        }
        Ok(row)
    }

    /// The volume of the surface [m³].
    fn volume(&self, stream: &Stream, spacing: f32, control: Control) -> Result<f64, RunError> {
        let keep_going = || !(control.interrupted)();
        mesh::reconstruct(stream, spacing, &self.scene.surface, &keep_going)
            .map(|surface| surface.check.volume)
            .map_err(remarks::no_surface)
    }

    fn keep(&self, row: &Row) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(row).expect("a row is plain data") + "\n";
        ShotFolder::write(self.folder.join("row.json"), &text)
    }

    /// The kept particles of a frame, in order of their ids.
    ///
    /// # Errors
    /// If they cannot be read; without the frame, `None`.
    pub(super) fn sampled(&self, frame: u32) -> Result<Option<Stream>, RunError> {
        let path = cache::frame_path(&self.folder.join("sample"), FrameIndex(frame));
        if !path.exists() {
            return Ok(None);
        }
        Ok(cache::read_frame(&path)?.0.streams.into_iter().next())
    }
}

/// About [`KEPT_PARTICLES`] of a frame, the same in every run of as many particles.
fn sample(frame: &Frame, stream: &Stream) -> Frame {
    let (Some(x), Some(id)) = (stream.vec3("position"), stream.u32("id")) else {
        return Frame { streams: Vec::new(), ..*frame };
    };
    let every = stream.len().div_ceil(KEPT_PARTICLES) as u32;
    let mut kept: Vec<usize> = (0..id.len()).filter(|&i| id[i].is_multiple_of(every)).collect();
    kept.sort_by_key(|&i| id[i]);
    let positions: Vec<_> = kept.iter().map(|&i| x[i]).collect();
    let ids: Vec<_> = kept.iter().map(|&i| id[i]).collect();
    let stream = Stream::new(&stream.name, kept.len()).with("position", positions).with("id", ids);
    Frame { streams: vec![stream], ..*frame }
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

/// A planned or finished run and its name.
#[derive(Clone, Debug)]
pub(super) struct Run<'a> {
    pub(super) setting: &'a Setting,
    pub(super) place: Place<'a>,
    pub(super) row: Row,
}
