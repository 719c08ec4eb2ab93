//! The job that fills the cache.

use super::{Control, FrameSpan, Manifest, RunError, ShotFolder, solids, stale};
use crate::{
    cache::{self, CacheError, Lock},
    control::{UnderWay, printable_path},
    frame::{FrameIndex, Stream},
    job::{
        Progress,
        batch::{MAX_FRAMES, no_locks},
        file_records::hex,
        log::{self, LogLine},
    },
    scene::{Frames, Scene},
    sim::{FrameRecord, Simulation, Stop, World, registry},
};
use std::{
    collections::BTreeSet,
    io::ErrorKind,
    path::{Path, PathBuf},
    time::Instant,
};

/// What a simulation job did.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Simulated {
    /// Frames that were there already and are valid.
    pub kept: usize,
    /// Frames computed and stored.
    pub computed: usize,
    /// Bytes written.
    pub bytes: u64,
}

/// Simulates `scene` so that every frame of `selection` stands in the folder's cache.
///
/// Frames that are there, valid and of the same simulation are kept; the job goes on from the nearest one, with
/// the same bytes as if it had never stopped; that frame may take `max_memory` [bytes] when it is read. `force` starts over, whatever
/// is there.
///
/// # Errors
/// See [`RunError`]; a cache of other settings is [`RunError::OtherSettings`]. Whatever happens, frames that were
/// finished stay.
pub(crate) fn simulate(
    scene: &Scene,
    folder: &ShotFolder,
    selection: &Frames,
    force: bool,
    max_memory: Option<u64>,
    control: Control,
) -> Result<Simulated, RunError> {
    check_selection(scene, selection)?;
    refuse_foreign_preset(folder)?;
    solids::refuse_assets(scene, folder)?;
    ShotFolder::create(&folder.cache())?;
    let lock = Lock::acquire_past_probes(&folder.cache())?;
    if !lock.is_held() {
        control.reporter.note(&no_locks(&folder.cache()));
    }
    clean(folder, lock.is_held(), control)?;
    let keys = scene.frame_keys();
    let requested = scene;
    let scene = &solids::fill(scene, Some(folder), control.reporter)?;
    let mut state = None;
    if force {
        match scene.branch.last() {
            // Its first frame is where it starts, and is not its own work.
            Some(branch) => {
                let is_start = |index, path: &Path| {
                    index <= FrameIndex(branch.frame)
                        && cache::read_header(path).is_ok_and(|found| keys.expect(&found, path).is_ok())
                };
                start_over(folder, is_start)?;
            }
            // What is there is given up only when the new simulation is known to start.
            None => {
                state = Some(begin(scene, control)?);
                start_over(folder, |_, _| false)?;
            }
        }
    }
    let valid = survey(folder, scene, selection, control).map_err(|why| match why {
        RunError::Cache(CacheError::Stale { found, .. }) => stale::explain(folder, requested, found),
        other => other,
    })?;
    {
        let _lock = Manifest::lock(folder, control)?;
        ShotFolder::write(folder.preset(), &(RECORD.to_owned() + &scene.to_toml()))?;
        solids::keep_assets(scene, folder)?;
        log::retain(folder, |frame| valid.contains(&frame))?;
    }
    write_manifest(scene, folder, selection, &valid, control)?;

    let records: Vec<_> = log::read(folder)?.into_iter().map(|(index, line)| (index, line.record)).collect();
    warn_of_lost_lines(scene, &valid, &records, control);
    let key = keys.own();
    let mut job = Job {
        scene,
        folder,
        key,
        max_memory,
        state,
        done: Simulated::default(),
        absent: None,
        records,
        control,
    };
    control.reporter.begin("simulate", selection.count() as usize);
    let outcome = job.run(selection, &valid);
    // However it ended.
    let warnings = registry::ALL.iter().flat_map(|system| system.shot_warnings(scene, &job.records));
    warnings.for_each(|line| control.reporter.note(&line));
    outcome?;
    control.reporter.end();
    Ok(job.done)
}

/// The first line of the preset that a shot folder keeps: a file without it is the user's own.
pub(super) const RECORD: &str = "# The preset as it was run, with every default. Written by meniscus.\n";

/// Whether the folder's `preset.toml` was written by a job.
pub(super) fn is_record(folder: &ShotFolder) -> bool {
    cache::read_text(&folder.preset()).is_ok_and(|text| text.starts_with(RECORD))
}

/// Refuses to replace a `preset.toml` that no job has written.
pub(super) fn refuse_foreign_preset(folder: &ShotFolder) -> Result<(), RunError> {
    match cache::read_text(&folder.preset()) {
        Ok(text) if !text.starts_with(RECORD) => Err(RunError::Request(format!(
            "{}: this preset is not a record of meniscus, and the shot's record would replace it; name another folder \
             with -o, or rename the file",
            folder.preset().display()
        ))),
        Err(source) if !matches!(source.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            Err(cannot_clean(folder.preset(), source))
        }
        _ => Ok(()),
    }
}

/// Refuses frames before the shot's first, and more than a job takes.
pub(crate) fn check_selection(scene: &Scene, selection: &Frames) -> Result<(), RunError> {
    let start = scene.frames.first();
    if selection.count() > MAX_FRAMES {
        return Err(RunError::Request(format!(
            "frames {selection}: found {} of them, expected at most {MAX_FRAMES}; choose fewer by --frames or in the preset",
            selection.count()
        )));
    }
    if selection.first() >= start {
        return Ok(());
    }
    Err(RunError::Request(format!(
        "--frames: frame {} is before the shot's first, {start}; choose frames from {start} on",
        selection.first()
    )))
}

/// The frames in the cache that are valid and of this simulation. Damaged ones are named, and computed again if
/// they are in `selection`.
fn survey(
    folder: &ShotFolder,
    scene: &Scene,
    selection: &Frames,
    control: Control,
) -> Result<BTreeSet<FrameIndex>, RunError> {
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) => return Ok(BTreeSet::new()),
        listed => listed?,
    };
    let keys = scene.frame_keys();
    // Frames up to the first of a branch are not of this simulation.
    let is_computed = |index| {
        selection.contains(index) && scene.branch.last().is_none_or(|branch| index > FrameIndex(branch.frame))
    };
    let mut valid = BTreeSet::new();
    for (index, path) in present {
        match cache::verify_frame(&path) {
            Ok(info) => {
                keys.expect(&info, &path)?;
                valid.insert(index);
            }
            Err(
                damage @ (CacheError::Corrupt { .. } | CacheError::Misplaced { .. } | CacheError::Io { .. }),
            ) => {
                let fate = if is_computed(index) { "computed again" } else { "left as it is" };
                control.reporter.note(&format!("frame {index} is {fate}: {damage}"));
            }
            Err(other) => return Err(other.into()),
        }
    }
    Ok(valid)
}

/// Removes what crashed jobs left in the folder, and puts a damaged manifest out of the way. `alone`: no other process
/// simulates here.
fn clean(folder: &ShotFolder, alone: bool, control: Control) -> Result<(), RunError> {
    Manifest::clean_root(folder, control)?;
    {
        let _lock = Manifest::lock(folder, control)?;
        Manifest::set_aside_damaged(folder, control)?;
    }
    // What lies behind a link is another folder's.
    let is_own =
        |place: &PathBuf| alone && std::fs::symlink_metadata(place).is_ok_and(|found| found.is_dir());
    for place in [folder.cache(), folder.samples()].into_iter().filter(is_own) {
        match cache::remove_temporaries(&place) {
            Err(error) if error.kind() != ErrorKind::NotFound => return Err(cannot_clean(place, error)),
            _ => {}
        }
    }
    Ok(())
}

/// Reports frames that were computed and of which the log has no line.
fn warn_of_lost_lines(
    scene: &Scene,
    valid: &BTreeSet<FrameIndex>,
    records: &[(FrameIndex, FrameRecord)],
    control: Control,
) {
    let known: BTreeSet<FrameIndex> = records.iter().map(|(index, _)| *index).collect();
    let is_computed = |frame: &&FrameIndex| **frame != scene.frames.first();
    let lost: Vec<String> = valid.difference(&known).filter(is_computed).map(FrameIndex::to_string).collect();
    if let [first, ..] = &lost[..] {
        control.reporter.note(&format!(
            "log.jsonl has no line about {} of the cached frames (first: {first}): what they report is lost, the frames are valid",
            lost.len()
        ));
    }
}

/// Removes the cached frames but those that `is_kept` wants.
fn start_over(folder: &ShotFolder, is_kept: impl Fn(FrameIndex, &Path) -> bool) -> Result<(), RunError> {
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) => return Ok(()),
        listed => listed?,
    };
    for (_, path) in present.into_iter().filter(|(index, path)| !is_kept(*index, path)) {
        std::fs::remove_file(&path).map_err(|source| cannot_clean(path, source))?;
    }
    Ok(())
}

fn cannot_clean(path: PathBuf, source: std::io::Error) -> RunError {
    RunError::File { path, source, next: "check that the folder can be read and written" }
}

/// A simulation under way.
struct Job<'a> {
    scene: &'a Scene,
    folder: &'a ShotFolder,
    key: u64,
    /// The memory that the columns of a cached frame may take [bytes].
    max_memory: Option<u64>,
    /// The newest state in memory and its frame.
    state: Option<(FrameIndex, Simulation)>,
    done: Simulated,
    /// The first requested frame before a branch that is not there, and the number of such frames.
    absent: Option<(FrameIndex, u64)>,
    /// The records of the frames in the log and of those that were computed.
    records: Vec<(FrameIndex, FrameRecord)>,
    control: Control<'a>,
}

impl Job<'_> {
    /// Computes the frames of a selection that are not `valid` yet.
    fn run(&mut self, selection: &Frames, valid: &BTreeSet<FrameIndex>) -> Result<(), RunError> {
        for (place, target) in selection.iter().enumerate() {
            if valid.contains(&target) {
                self.done.kept += 1;
            } else if target >= self.start() {
                let before = valid.range(self.start()..target).next_back().copied();
                self.reach(target, before, selection, place)?;
            } else {
                self.absent.get_or_insert((target, 0)).1 += 1;
            }
            self.control.reporter.progress((place + 1) as f64);
        }
        if let Some((first, count)) = self.absent {
            self.control.reporter.note(&format!(
                "{count} frames before the branch at frame {} are not there (first: {first}): they are of the shot that it branched from",
                self.start()
            ));
        }
        Ok(())
    }

    /// The first frame that is of this simulation.
    fn start(&self) -> FrameIndex {
        self.scene.branch.last().map_or(self.scene.frames.first(), |branch| FrameIndex(branch.frame))
    }

    /// Computes on to `target` from the state in memory or from the cached frame `before`, whichever is newer.
    fn reach(
        &mut self,
        target: FrameIndex,
        before: Option<FrameIndex>,
        selection: &Frames,
        place: usize,
    ) -> Result<(), RunError> {
        let (mut at, mut simulation) = match (self.state.take(), before) {
            (Some(state), before) if before.is_none_or(|cached| cached <= state.0) => state,
            (_, Some(cached)) => (cached, self.restore(cached)?),
            (_, None) if !self.scene.branch.is_empty() => return Err(self.no_start()),
            (_, None) => begin(self.scene, self.control)?,
        };
        let origin = at;
        if at == target {
            self.store(at, &simulation, None)?;
        }
        while at < target {
            let ahead = f64::from(target.0 - origin.0);
            let mut watch = Progress {
                control: self.control,
                base: place as f64 + f64::from(at.0 - origin.0) / ahead,
                scale: 1.0 / ahead,
            };
            at = FrameIndex(at.0 + 1);
            let _under_way = UnderWay::new(at.0);
            let clock = Instant::now();
            let seconds = 1.0 / f64::from(self.scene.fps);
            let record = simulation.advance(seconds, &mut watch).map_err(|stop| match stop {
                Stop::Interrupted => RunError::Interrupted,
                Stop::Diverged(diverged) => RunError::Diverged { frame: at, diverged },
            })?;
            let seconds = clock.elapsed().as_secs_f64();
            self.control.reporter.frame(&figures(at, &record, seconds));
            if selection.contains(at) {
                self.store(at, &simulation, Some(&record))?;
            }
            self.records.push((at, record));
        }
        self.state = Some((at, simulation));
        Ok(())
    }

    /// A branch cannot start without its first frame.
    fn no_start(&self) -> RunError {
        RunError::Request(format!(
            "{}: found no valid frame {}, with which this branch of another shot starts; branch again with `meniscus simulate SHOT \
             --from {}`, or delete the [[branch]] tables of the preset to start with its seeds",
            printable_path(&self.folder.cache()),
            self.start(),
            self.start().0
        ))
    }

    fn restore(&self, index: FrameIndex) -> Result<Simulation, RunError> {
        let path = cache::frame_path(&self.folder.cache(), index);
        let (frame, _) = cache::read_frame_within(&path, self.max_memory)?;
        self.control.reporter.note(&format!("continuing after frame {index}"));
        let simulation = Simulation::restore(world(self.scene), self.scene.systems(), &frame)?;
        warn_of_seeding(&simulation, self.control);
        Ok(simulation)
    }

    fn store(
        &mut self,
        index: FrameIndex,
        simulation: &Simulation,
        record: Option<&FrameRecord>,
    ) -> Result<(), RunError> {
        let frame = simulation.frame(index);
        let prepared = cache::prepare_frame(&self.folder.cache(), &frame, self.key)?;
        let bytes = prepared.bytes();
        // The line comes first: a frame that is there then has one, however the job ends.
        if let Some(record) = record {
            let points = frame.streams.iter().filter(|stream| stream.kind.has_positions());
            let particles = points.map(Stream::len).sum();
            let line = LogLine { frame: index, bytes, particles, record: record.clone() };
            log::append(self.folder, &line)?;
        }
        prepared.commit()?;
        self.done.computed += 1;
        self.done.bytes += bytes;
        Ok(())
    }
}

/// The initial state.
fn begin(scene: &Scene, control: Control) -> Result<(FrameIndex, Simulation), RunError> {
    let simulation = Simulation::new(world(scene), scene.systems())?;
    warn_of_seeding(&simulation, control);
    Ok((scene.frames.first(), simulation))
}

/// Reports what seeding left out or could not do.
fn warn_of_seeding(simulation: &Simulation, control: Control) {
    registry::seeding_warnings(&simulation.seeded()).iter().for_each(|line| control.reporter.note(line));
}

/// The world of the simulation.
pub(super) fn world(scene: &Scene) -> World {
    scene.surroundings()
}

/// The progress line of a frame that took `seconds`.
fn figures(index: FrameIndex, record: &FrameRecord, seconds: f64) -> String {
    let progress = registry::ALL.iter().filter_map(|system| system.progress(record));
    let warnings = registry::ALL.iter().flat_map(|system| system.warnings(record));
    let parts = [format!("frame {index}")].into_iter().chain(progress);
    let parts = parts.chain([format!("{seconds:.2} s")]).chain(warnings);
    parts.collect::<Vec<_>>().join("  ")
}

/// Ranges of requested frames that a manifest lists; of more, the span that covers them.
const MAX_RANGES: usize = 1000;

/// Lists the requested and the existing frames. Meshes made earlier stay listed if frames of this simulation exist, since
/// otherwise they may show another one.
fn write_manifest(
    scene: &Scene,
    folder: &ShotFolder,
    selection: &Frames,
    valid: &BTreeSet<FrameIndex>,
    control: Control,
) -> Result<(), RunError> {
    // Range by range: a selection may name more frames than memory holds numbers.
    let requested = selection.ranges().map(|(first, last, step)| FrameSpan { first, last, step });
    let there = valid.iter().map(|&FrameIndex(frame)| FrameSpan { first: frame, last: frame, step: 1 });
    let Some(span) = requested.chain(there).reduce(FrameSpan::union) else { return Ok(()) };
    let _lock = Manifest::lock(folder, control)?;
    let new = Manifest::new(&scene.title, f64::from(scene.fps), span);
    let keys = scene.frame_keys();
    let is_same = |old: &Manifest| old.frame_keys().is_none_or(|found| found == keys);
    let old = if valid.is_empty() { None } else { Manifest::read(folder)?.filter(is_same) };
    let (outputs, mut requested) = old.map(|old| (old.outputs, old.requested)).unwrap_or_default();
    let ranges = selection.ranges().map(|(first, last, step)| FrameSpan { first, last, step });
    let unknown: Vec<FrameSpan> = ranges.filter(|range| !requested.contains(range)).collect();
    requested.extend(unknown);
    if requested.len() > MAX_RANGES {
        requested = vec![span];
    }
    let simulation = Some(hex(scene.simulation_key()));
    let manifest = Manifest {
        outputs,
        requested,
        simulation,
        branch: scene.branch.clone(),
        camera: scene.camera,
        ..new
    };
    manifest.write(folder)
}
