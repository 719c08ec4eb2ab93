//! Volumes of smoke played again slower, faster or with other tracers, without simulating.

use super::{
    file::{names, up_to_date},
    folder::VolumeFile,
    memory::stream_memory,
    settings::{Surroundings, VolumeSettings},
    tracer_grids::TracerFrame,
    tracers::{no_velocity, tracer_key, write_tracers},
};
use crate::{
    cache::{self, FrameKeys},
    export::vdb::VolumeGrid,
    frame::{Frame, FrameIndex},
    job::{
        Control, Failure, Progress, RunError, ShotFolder,
        batch::{
            BatchRequest, BatchSummary, FileTarget, FrameOutcome, Ledger, MAX_FRAMES, ProductFolder, Source,
        },
        file_records::FileRecords,
        nonzero,
    },
    product::request::Retime,
    sim::smoke::{self, DriftReport, Drifting, FrameAir, KeyedAir, Replay},
};
use std::{collections::BTreeMap, ops::ControlFlow, path::PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// Times that differ by less than this are equal [frames].
const TIME_EPSILON: f64 = 1e-6;

/// The volumes to make.
struct RetimedVolumes<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    retime: Retime,
    request: &'a BatchRequest,
    grids: Vec<VolumeGrid>,
    /// The files made so far.
    records: FileRecords,
}

impl RetimedVolumes<'_> {
    /// Whether a grid of the air is requested.
    fn needs_air(&self) -> bool {
        self.grids.iter().any(|grid| grid.is_of_air())
    }
}

/// Makes volumes in `out` of the smoke cached in `folder`, retimed.
///
/// Frame n of the output shows the cached shot at its first frame and (n − first)/factor more. Velocities are divided
/// by the factor.
///
/// # Errors
/// As [`volume`](super::writer::volume); [`RunError::Request`] if frames are missing in between. A damaged frame makes those fail that
/// are computed from it: its neighbours', and, if tracers are reseeded, all later ones.
pub(super) fn retime(
    folder: &ShotFolder,
    out: &ShotFolder,
    settings: &VolumeSettings,
    retime: Retime,
    request: &BatchRequest,
    control: Control,
) -> Result<BatchSummary, RunError> {
    let Some(Surroundings { smoke, world }) = settings.smoke.clone() else {
        return Err(RunError::Request("this shot has no smoke, and only smoke can be retimed".into()));
    };
    let present = cache::list(&folder.cache())?;
    let (first, last) = ends(&present)?;
    let count = ((f64::from(last - first) * retime.factor + TIME_EPSILON).floor() as u64) + 1;
    if count > MAX_FRAMES {
        return Err(RunError::Request(format!(
            "--retime {}: found {count} frames, expected at most {MAX_FRAMES}",
            retime.factor
        )));
    }
    if retime.reseed && first != smoke.first {
        return Err(RunError::Request(format!(
            "the cache begins with frame {first}, expected {}, at which other tracers are seeded; simulate the shot from there on",
            smoke.first
        )));
    }
    let end = u64::from(first) + count - 1;
    let beyond = |frame: &FrameIndex| !(u64::from(first)..=end).contains(&u64::from(frame.0));
    if let Some(frame) = request.selection.as_ref().and_then(|selection| selection.iter().find(beyond)) {
        return Err(RunError::Request(format!(
            "--frames: found frame {frame}, expected frames from {first} to {end}, which the cache gives with this factor"
        )));
    }
    let numbers: Vec<u32> = (0..count as u32)
        .map(|n| first + n)
        .filter(|&n| request.selection.as_ref().is_none_or(|selection| selection.contains(FrameIndex(n))))
        .collect();
    let grids: Vec<VolumeGrid> =
        settings.grids.iter().copied().filter(|grid| VolumeGrid::OF_TRACERS.contains(grid)).collect();
    if grids.is_empty() {
        let expected = names(&VolumeGrid::OF_TRACERS);
        return Err(RunError::Request(format!("smoke has none of the requested grids; expected {expected}")));
    }
    let records = FileRecords::read(out, VolumeFile.name())?;
    let volumes = RetimedVolumes { out, settings, retime, request, grids, records };
    let keys = Source::Cache(folder).keys()?;
    let replay = Replay::new(smoke.clone(), world)?;
    let drifting = retime.reseed.then(|| (replay.seeded(), 0.0));
    let loaded = BTreeMap::new();
    let max_memory = request.max_memory;
    let mut player = Player { present: &present, keys, max_memory, replay, loaded, drifting };
    let (title, fps) = Source::Cache(folder).title(out, smoke.fps)?;
    let mut ledger = Ledger::new(out, &VolumeFile, control)?;
    control.reporter.begin(VolumeFile.name(), numbers.len());
    let mut ended = Ok(());
    for (place, &number) in numbers.iter().enumerate() {
        if control.cancel.is_cancelled() {
            ended = Err(RunError::Interrupted);
            break;
        }
        let mut outcome = FrameOutcome::new(FrameIndex(number));
        let due = (f64::from(number - first) / retime.factor).min(f64::from(last - first));
        let progress = Progress { control, base: place as f64, scale: 1.0 };
        match player.frame(due, &volumes, &mut outcome, progress) {
            Err(RunError::Cache(why)) => outcome.fail(why.to_string(), Failure::of(&why)),
            Err(RunError::Setup(why)) => outcome.fail(no_velocity(&*why), Failure::Other),
            Err(why @ RunError::OverMemory { .. }) => outcome.fail(why.to_string(), Failure::Memory),
            Err(why) => {
                ended = Err(why);
                break;
            }
            Ok(()) => {}
        }
        if let Err(why) = outcome.record(out, VolumeFile.name(), control) {
            ended = Err(why);
            break;
        }
        ledger.add_frame(outcome, control);
        control.reporter.progress((place + 1) as f64);
    }
    if ended.is_ok() {
        control.reporter.end();
    }
    ledger.finish(&title, fps, &numbers, ended, control)
}

/// The first and the last frame of a cache.
///
/// # Errors
/// If the cache is empty or lacks a frame in between.
fn ends(present: &[(FrameIndex, PathBuf)]) -> Result<(u32, u32), RunError> {
    let numbers: Vec<u32> = present.iter().map(|(index, _)| index.0).collect();
    if let Some(pair) = numbers.windows(2).find(|pair| pair[1] != pair[0] + 1) {
        return Err(RunError::Request(format!(
            "the cache has no frame {}, and times between frames are computed from both; simulate it first",
            pair[0] + 1
        )));
    }
    numbers
        .first()
        .copied()
        .zip(numbers.last().copied())
        .ok_or_else(|| RunError::Request("the cache is empty".into()))
}

/// A cached frame in memory.
struct LoadedFrame {
    frame: Frame,
    /// The memory of its columns [bytes].
    bytes: u64,
    /// The simulation's key.
    key: u64,
    /// `None` as long as it is not needed.
    air: Option<KeyedAir>,
}

/// Evaluates a cache at any time.
struct Player<'a> {
    present: &'a [(FrameIndex, PathBuf)],
    /// The keys that the frames have to have.
    keys: Option<FrameKeys>,
    /// The memory that the cached frames may take together [bytes].
    max_memory: Option<u64>,
    replay: Replay,
    /// The cached frames in memory, by their distance from the first.
    loaded: BTreeMap<usize, LoadedFrame>,
    /// Tracers advected from the shot's start, and their time [frames after the first]; `None`: those of the cache.
    drifting: Option<(Drifting, f64)>,
}

/// A time between two cached frames.
struct Time {
    /// The frame before [frames after the first].
    before: usize,
    /// The time since that [frames]; 0: it is that frame.
    fraction: f64,
}

impl Player<'_> {
    /// Makes the volume of the time `due` [frames after the first].
    fn frame(
        &mut self,
        due: f64,
        volumes: &RetimedVolumes,
        outcome: &mut FrameOutcome,
        progress: Progress<'_>,
    ) -> Result<(), RunError> {
        let control = progress.control;
        let before = (due + TIME_EPSILON).floor();
        let fraction = if due - before > TIME_EPSILON { due - before } else { 0.0 };
        let time = Time { before: before as usize, fraction };
        self.advect(due, &progress)?;
        self.load(time.before, fraction > 0.0, fraction > 0.0 || volumes.needs_air())?;
        let advected = self.drifting.as_mut().map(|(drifting, _)| std::mem::take(&mut drifting.report));

        // A file that is up to date is kept; the tracers had to be advected all the same.
        let RetimedVolumes { out, settings, retime, request, grids, .. } = volumes;
        let spacing = settings.smoke.as_ref().map_or(0.0, |around| around.smoke.params.tracer_spacing());
        let key = self.loaded[&time.before].key;
        let state = format!("{key:016x} {due} {} {} {spacing}", retime.factor, retime.reseed);
        let key = tracer_key(settings, grids, xxh3_64(state.as_bytes()));
        let target = FileTarget { index: outcome.index, name: smoke::NAME.into(), key, state: None };
        let kept =
            up_to_date(out, &target).filter(|files| files.are_recorded(out, &volumes.records, &target));
        if let Some(files) = kept.filter(|_| !request.force) {
            outcome.files.push(files);
            return Ok(());
        }
        let (tracers, air) = self.evaluate(&time, volumes.needs_air(), progress)?;
        outcome.notes.extend(drift_remark(outcome.index, &advected.unwrap_or(tracers.report)));
        let stream = tracers.stream();
        request.check_memory(None, |_| stream_memory(&stream, spacing, &settings.surface, grids))?;
        let slowdown = retime.factor;
        let frame = TracerFrame { tracers: &stream, air: air.as_ref(), spacing, grids, slowdown };
        write_tracers(out, settings, frame, &target, outcome, control)
    }

    /// Loads the cached frame `number` frames after the first, on request the `next` one, and their air; drops all others.
    fn load(&mut self, number: usize, next: bool, with_air: bool) -> Result<(), RunError> {
        self.loaded.retain(|&other, _| (number..=number + 1).contains(&other));
        for number in number..=number + usize::from(next) {
            if !self.loaded.contains_key(&number) {
                let path = &self.present[number].1;
                let taken = self.loaded.values().map(|loaded| loaded.bytes).sum();
                let left = self.max_memory.map(|allowed| allowed.saturating_sub(taken));
                let (frame, info) = cache::read_frame_within(path, left)?;
                self.keys.as_ref().map_or(Ok(()), |keys| keys.expect(&info, path))?;
                let bytes = info.unpacked_bytes();
                self.loaded.insert(number, LoadedFrame { frame, bytes, key: info.key, air: None });
            }
            let loaded = self.loaded.get_mut(&number).expect("it was inserted");
            if with_air && loaded.air.is_none() {
                loaded.air = Some(self.replay.keyed(&loaded.frame.streams, loaded.frame.time)?);
            }
        }
        Ok(())
    }

    /// The air of a cached frame that was loaded with it.
    fn air(&self, number: usize) -> &KeyedAir {
        self.loaded[&number].air.as_ref().expect("it was loaded with its air")
    }

    /// Advects its own tracers to the time `due` [frames after the first], from one cached frame to the next.
    fn advect(&mut self, due: f64, progress: &Progress<'_>) -> Result<(), RunError> {
        let start = self.drifting.as_ref().map_or(due, |(_, at)| *at);
        while let Some(at) = self.drifting.as_ref().map(|(_, at)| *at).filter(|at| due - at > TIME_EPSILON) {
            let before = (at + TIME_EPSILON).floor();
            let end = due.min(before + 1.0);
            self.load(before as usize, true, true)?;
            let [a, b] = [0, 1].map(|step| self.air(before as usize + step));
            let then = a.time + (end - before) * (b.time - a.time);
            // If a frame is damaged they stay as they were before it.
            let (mut drifting, _) = self.drifting.clone().expect("there are such tracers");
            let parts = [at, end].map(|at| (at - start) / (due - start));
            let mut watch = Progress {
                control: progress.control,
                base: progress.base + progress.scale * parts[0],
                scale: progress.scale * (parts[1] - parts[0]),
            };
            if let ControlFlow::Break(()) = self.replay.drift(a, b, &mut drifting, then, &mut watch)? {
                return Err(RunError::Interrupted);
            }
            self.drifting = Some((drifting, end));
        }
        Ok(())
    }

    /// The tracers at a time whose frames are loaded, and the air there on request.
    fn evaluate(
        &self,
        time: &Time,
        with_air: bool,
        mut progress: Progress<'_>,
    ) -> Result<(Drifting, Option<FrameAir>), RunError> {
        let LoadedFrame { frame, .. } = &self.loaded[&time.before];
        let ends = || {
            let a = self.air(time.before);
            (a, if time.fraction > 0.0 { self.air(time.before + 1) } else { a })
        };
        let then = if time.fraction > 0.0 {
            frame.time + time.fraction * (self.loaded[&(time.before + 1)].frame.time - frame.time)
        } else {
            frame.time
        };
        let tracers = match &self.drifting {
            Some((drifting, _)) => drifting.clone(),
            None => {
                let mut tracers = self.replay.cached(&frame.streams, frame.time)?;
                if time.fraction > 0.0 {
                    let (a, b) = ends();
                    if let ControlFlow::Break(()) =
                        self.replay.drift(a, b, &mut tracers, then, &mut progress)?
                    {
                        return Err(RunError::Interrupted);
                    }
                }
                tracers
            }
        };
        let air = with_air.then(|| {
            let (a, b) = ends();
            self.replay.air(a, b, then)
        });
        Ok((tracers, air.transpose()?))
    }
}

/// What happened to tracers on the way to the frame `index` of retimed smoke.
fn drift_remark(index: FrameIndex, report: &DriftReport) -> Option<String> {
    let DriftReport { steps, capped, returned, rejected } = *report;
    let counts = nonzero(&[
        (capped, &format!("of {steps} steps longer than air and solids allow (cache more frames a second)")),
        (returned, "tracers projected out of solids"),
        (rejected, "tracers not emitted, inside solids"),
    ]);
    (!counts.is_empty()).then(|| format!("frame {index}: {}", counts.join(", ")))
}
