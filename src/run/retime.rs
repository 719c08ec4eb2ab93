//! The job that plays a cache of smoke again, slower, faster or with other tracers, without simulating.

use super::{
    Control, Done, Failure, Job, RunError, ShotFolder,
    job::Target,
    ledger::{Ledger, Made},
    plan::{Product, stream_memory},
    remarks,
    simulate::Progress,
    source::MOST_FRAMES,
    volume::{SmokeFrame, Surroundings, VolumeSettings, kept, no_air, smoke_key, write_smoke},
};
use crate::{
    cache,
    export::vdb::VolumeGrid,
    frame::{Frame, FrameIndex},
    sim::smoke::{self, Drifting, FrameAir, KeyedAir, Replay},
};
use std::{collections::BTreeMap, ops::ControlFlow, path::PathBuf};
use xxhash_rust::xxh3::xxh3_64;

/// How a cache is played again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Retime {
    /// Frames that are made of one [–], above 0: 2 is half as fast.
    pub factor: f64,
    /// Whether tracers are seeded anew as the settings have them, and drift from the start; else those of the cache do.
    pub fresh: bool,
}

/// What is to be made.
struct Order<'a> {
    out: &'a ShotFolder,
    settings: &'a VolumeSettings,
    retime: Retime,
    job: &'a Job,
    grids: Vec<VolumeGrid>,
}

impl Order<'_> {
    /// Whether the velocity of the air is asked for.
    fn moves(&self) -> bool {
        self.grids.contains(&VolumeGrid::Velocity)
    }
}

/// Nearer than this to a cached frame, in frames, a time is that of the frame.
const SAME: f64 = 1e-6;

/// Makes volumes in `out` of the smoke cached in `folder`, played again as `retime` says.
///
/// Frame n of the output shows the cached shot at its first frame and (n − first)/factor more. Velocities are those that are
/// seen: slower by the factor.
///
/// # Errors
/// As [`volume`](super::volume::volume); [`RunError::Request`] if frames are missing in between. A frame that is damaged takes
/// those with it that are found from it: its neighbours', and, if tracers drift from the start, all that come after.
pub fn retime(
    folder: &ShotFolder,
    out: &ShotFolder,
    settings: &VolumeSettings,
    retime: Retime,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let Some(Surroundings { smoke, world }) = settings.smoke.clone() else {
        return Err(RunError::Request("this shot has no smoke, and only smoke can be played again".into()));
    };
    let present = cache::list(&folder.cache())?;
    let (first, last) = ends(&present)?;
    let count = ((f64::from(last - first) * retime.factor + SAME).floor() as u64) + 1;
    if count > MOST_FRAMES {
        return Err(RunError::Request(format!(
            "--retime {} makes {count} frames of the shot",
            retime.factor
        )));
    }
    if retime.fresh && first != smoke.first {
        return Err(RunError::Request(format!(
            "the cache begins with frame {first}, expected {}, from which other tracers drift; simulate the shot from there on",
            smoke.first
        )));
    }
    let end = u64::from(first) + count - 1;
    let beyond = |frame: &FrameIndex| !(u64::from(first)..=end).contains(&u64::from(frame.0));
    if let Some(frame) = job.selection.as_ref().and_then(|selection| selection.iter().find(beyond)) {
        return Err(RunError::Request(format!(
            "--frames: found frame {frame}, expected frames from {first} to {end}, which the cache gives at this pace"
        )));
    }
    let numbers: Vec<u32> = (0..count as u32)
        .map(|n| first + n)
        .filter(|&n| job.selection.as_ref().is_none_or(|selection| selection.contains(FrameIndex(n))))
        .collect();
    let grids: Vec<VolumeGrid> =
        settings.grids.iter().copied().filter(|grid| VolumeGrid::SMOKE.contains(grid)).collect();
    if grids.is_empty() {
        let known: Vec<&str> = VolumeGrid::SMOKE.into_iter().map(VolumeGrid::name).collect();
        return Err(RunError::Request(format!(
            "no grid of smoke is asked for; expected {}",
            known.join(", ")
        )));
    }
    let order = Order { out, settings, retime, job, grids };
    let replay = Replay::new(smoke.clone(), world)?;
    let drifting = retime.fresh.then(|| (replay.seeded(), 0.0));
    let mut player = Player { present: &present, replay, reel: BTreeMap::new(), drifting };
    let (title, fps) = super::Source::Cache(folder).title(out, smoke.fps)?;
    let mut ledger = Ledger::new(out, Product::Volumes)?;
    control.reporter.begin(Product::Volumes.name(), numbers.len());
    let mut outcome = Ok(());
    for (place, &number) in numbers.iter().enumerate() {
        if (control.interrupted)() {
            outcome = Err(RunError::Interrupted);
            break;
        }
        let mut made = Made::new(FrameIndex(number));
        let due = (f64::from(number - first) / retime.factor).min(f64::from(last - first));
        let progress = Progress { control, base: place as f64, scale: 1.0 };
        match player.frame(due, &order, &mut made, progress) {
            Err(RunError::Cache(why)) => made.fail(why.to_string(), Failure::of(&why)),
            Err(RunError::Setup(why)) => made.fail(no_air(&*why), Failure::Other),
            Err(why @ RunError::OverMemory { .. }) => made.fail(why.to_string(), Failure::Memory),
            Err(why) => {
                outcome = Err(why);
                break;
            }
            Ok(()) => {}
        }
        ledger.take(made, control);
        control.reporter.progress((place + 1) as f64);
    }
    if outcome.is_ok() {
        control.reporter.end();
    }
    ledger.finish(&title, fps, &numbers, outcome, control)
}

/// The first and the last frame of a cache in which none is missing.
fn ends(present: &[(FrameIndex, PathBuf)]) -> Result<(u32, u32), RunError> {
    let numbers: Vec<u32> = present.iter().map(|(index, _)| index.0).collect();
    if let Some(pair) = numbers.windows(2).find(|pair| pair[1] != pair[0] + 1) {
        return Err(RunError::Request(format!(
            "the cache has no frame {}, and what is between frames is found from both; simulate it first",
            pair[0] + 1
        )));
    }
    numbers
        .first()
        .copied()
        .zip(numbers.last().copied())
        .ok_or_else(|| RunError::Request("the cache is empty".into()))
}

/// A cached frame at hand.
struct Shown {
    frame: Frame,
    /// The simulation's key.
    key: u64,
    /// `None` as long as nothing moves in it.
    air: Option<KeyedAir>,
}

/// What plays.
struct Player<'a> {
    present: &'a [(FrameIndex, PathBuf)],
    replay: Replay,
    /// The cached frames that are at hand, by how many frames they come after the first.
    reel: BTreeMap<usize, Shown>,
    /// Tracers that drift from the shot's start, and where they are [frames after the first]; `None`: those of the cache.
    drifting: Option<(Drifting, f64)>,
}

/// A place between two cached frames.
struct Place {
    /// The frame before [frames after the first].
    before: usize,
    /// How far it is behind that [frames]; 0: it is that frame.
    part: f64,
}

impl Player<'_> {
    /// Makes the volume of the time `due` [frames after the first].
    fn frame(
        &mut self,
        due: f64,
        order: &Order,
        made: &mut Made,
        progress: Progress<'_>,
    ) -> Result<(), RunError> {
        let control = progress.control;
        let before = (due + SAME).floor();
        let part = if due - before > SAME { due - before } else { 0.0 };
        let place = Place { before: before as usize, part };
        self.follow(due, &progress)?;
        self.load(place.before, part > 0.0, part > 0.0 || order.moves())?;
        let followed = self.drifting.as_mut().map(|(drifting, _)| std::mem::take(&mut drifting.report));

        // What was made of the same is kept; the tracers had to drift on all the same.
        let Order { out, settings, retime, job, grids } = order;
        let spacing = settings.smoke.as_ref().map_or(0.0, |around| around.smoke.params.tracer_spacing());
        let key = self.reel[&place.before].key;
        let told = format!("{key:016x} {due} {} {} {spacing}", retime.factor, retime.fresh);
        let key = smoke_key(settings, grids, xxh3_64(told.as_bytes()));
        let target = Target { index: made.index, name: smoke::NAME.into(), key };
        if let Some(piece) = kept(out, &target).filter(|_| !job.force) {
            made.pieces.push(piece);
            return Ok(());
        }
        let (tracers, air) = self.at(&place, order.moves(), progress)?;
        made.notes.extend(remarks::of_drift(made.index, &followed.unwrap_or(tracers.report)));
        let stream = tracers.stream();
        let needed = |enough| stream_memory(Product::Volumes, &stream, spacing, &settings.surface, enough);
        job.fit(None, needed)?;
        let slower = retime.factor;
        let frame = SmokeFrame { tracers: &stream, air: air.as_ref(), spacing, wanted: grids, slower };
        write_smoke(out, settings, frame, &target, made, control)
    }

    /// Reads the cached frame that comes `number` frames after the first, and the `next` one if asked to, with their air if something
    /// `moves` there; others are put away.
    fn load(&mut self, number: usize, next: bool, moves: bool) -> Result<(), RunError> {
        self.reel.retain(|&other, _| (number..=number + 1).contains(&other));
        for number in number..=number + usize::from(next) {
            if !self.reel.contains_key(&number) {
                let (frame, info) = cache::read_frame(&self.present[number].1)?;
                self.reel.insert(number, Shown { frame, key: info.key, air: None });
            }
            let shown = self.reel.get_mut(&number).expect("it was put there");
            if moves && shown.air.is_none() {
                shown.air = Some(self.replay.keyed(&shown.frame.streams, shown.frame.time)?);
            }
        }
        Ok(())
    }

    /// The air of a cached frame that was loaded with it.
    fn air(&self, number: usize) -> &KeyedAir {
        self.reel[&number].air.as_ref().expect("loaded with its air")
    }

    /// Lets tracers of its own drift to the time `due` [frames after the first], past every cached frame on the way.
    fn follow(&mut self, due: f64, progress: &Progress<'_>) -> Result<(), RunError> {
        let start = self.drifting.as_ref().map_or(due, |(_, at)| *at);
        while let Some(at) = self.drifting.as_ref().map(|(_, at)| *at).filter(|at| due - at > SAME) {
            let before = (at + SAME).floor();
            let end = due.min(before + 1.0);
            self.load(before as usize, true, true)?;
            let [a, b] = [0, 1].map(|step| self.air(before as usize + step));
            let then = a.time + (end - before) * (b.time - a.time);
            // Where a frame is damaged they stay as they were before it.
            let (mut drifting, _) = self.drifting.clone().expect("they drift");
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

    /// The tracers at a place whose frames are at hand, and the air there if something `moves`.
    fn at(
        &self,
        place: &Place,
        moves: bool,
        mut progress: Progress<'_>,
    ) -> Result<(Drifting, Option<FrameAir>), RunError> {
        let Shown { frame, .. } = &self.reel[&place.before];
        let ends = || {
            let a = self.air(place.before);
            (a, if place.part > 0.0 { self.air(place.before + 1) } else { a })
        };
        let then = if place.part > 0.0 {
            frame.time + place.part * (self.reel[&(place.before + 1)].frame.time - frame.time)
        } else {
            frame.time
        };
        let tracers = match &self.drifting {
            Some((drifting, _)) => drifting.clone(),
            None => {
                let mut tracers = self.replay.cached(&frame.streams, frame.time)?;
                if place.part > 0.0 {
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
        let air = moves.then(|| {
            let (a, b) = ends();
            self.replay.air(a, b, then)
        });
        Ok((tracers, air.transpose()?))
    }
}
