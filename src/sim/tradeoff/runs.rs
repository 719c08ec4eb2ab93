//! Runs of a tradeoff: made once, timed as often as requested, kept on disk with what was measured of them, and compared
//! with the reference.
//!
//! The reference and its refinement run last: what the allocator keeps of them would show in the memory of the rest.

use super::{
    folder::{KEPT, RunFolder, remove},
    measure::{ComparedRun, FrameSample, Measure, Run, RunRecord},
    subject::{Sweep, TradeoffJob},
};
use crate::{
    cache::{self, Lock},
    job::{
        Control, Reporter, RunError, ShotFolder,
        tradeoff::{About, Costs, Spread, Table, TableRow, Wording},
    },
    par,
    preset::Frames,
    sim::scene::Scene,
};
use serde_json::json;
use std::{collections::BTreeMap, path::Path, rc::Rc};
use xxhash_rust::xxh3::xxh3_64;

/// Runs what is not there yet, and tabulates everything. Fails with whatever stops a run but divergence, which is a
/// result; finished runs are kept.
pub(crate) fn tradeoff<M: Measure>(
    wording: &'static Wording,
    mut measure: M,
    sweep: &Sweep,
    job: &TradeoffJob<'_>,
    control: Control,
) -> Result<Table, RunError> {
    let rows_folder = job.folder.join("rows");
    ShotFolder::create(&rows_folder)?;
    let _lock = Lock::acquire(&rows_folder)?;
    let settings: Vec<_> = sweep.rows.iter().chain([&sweep.reference, &sweep.refined]).collect();
    let folders: Vec<RunFolder> =
        settings.iter().map(|(_, scene)| RunFolder::new(&rows_folder, scene, &measure, job)).collect();
    let mut records: Vec<Option<RunRecord<M>>> = folders.iter().map(RunFolder::load).collect();
    let (count, reference) = (settings.len(), sweep.rows.len());
    let is_compared = |record: &Option<RunRecord<M>>| {
        record.as_ref().is_some_and(|record| record.distances.contains_key(&folders[reference].name()))
    };
    let lacks_distance: Vec<bool> =
        (0..count).map(|i| i != reference && !M::KEEPS_FRAMES && !is_compared(&records[i])).collect();

    // Every run. The reference and its refinement are needed for their frames, not for their time.
    control.reporter.begin("tradeoff", count);
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| {
        let coarseness = |place: usize| measure.coarseness(&folders[place].scene);
        coarseness(b).total_cmp(&coarseness(a))
    });
    let mut runs: Vec<Option<Rc<Run<M>>>> = (0..count).map(|_| None).collect();
    for (number, &place) in order.iter().enumerate() {
        let (folder, setting) = (folders[place].clone(), settings[place].0.clone());
        let first = folder.scene.frames.first().min(job.frames.first());
        let frames = f64::from(folder.last.0 - first.0 + 1);
        let reporter = RunReporter { whole: control.reporter, number, scale: 1.0 / frames };
        let own = Control { reporter: &reporter, ..control };
        let repeats = if place < reference { job.repeats } else { 1 };
        let needs_frames = lacks_distance[place] || (place == reference && lacks_distance.contains(&true));
        // Settings that differ in nothing simulated share a run.
        let loaded = records[place].take().or_else(|| folder.load());
        let (record, was_there) = folder.complete(loaded, repeats, needs_frames, &measure, own)?;
        let product = match record.diverged {
            None => measure.product(&folder, repeats, own)?,
            Some(_) => None,
        };
        let what = match (&record.diverged, was_there) {
            (Some(why), _) => why.clone(),
            (None, true) => "was there".into(),
            (None, false) => format!("{:.2} s", record.seconds().median),
        };
        control.reporter.frame(&format!("{} of {count}  {}: {what}", number + 1, setting.label));
        control.reporter.progress((number + 1) as f64);
        runs[place] = Some(Rc::new(Run { setting, folder, record, product }));
    }
    control.reporter.end();
    let runs: Vec<Rc<Run<M>>> = runs.into_iter().flatten().collect();
    measure.prepare(&runs[reference], &runs[reference + 1])?;
    tabulate(wording, Rc::new(measure), runs, sweep, job)
}

/// Compares runs with the reference. The last two are the reference and its refinement.
fn tabulate<M: Measure>(
    wording: &'static Wording,
    measure: Rc<M>,
    mut runs: Vec<Rc<Run<M>>>,
    sweep: &Sweep,
    job: &TradeoffJob<'_>,
) -> Result<Table, RunError> {
    let (columns, reference) = (measure.columns(), runs[runs.len() - 2].clone());
    let mut about = About {
        title: sweep.base.title.clone(),
        frames: format!("frames {}", job.frames),
        facts: vec![("frames", json!(job.frames))],
        spacing: 1.0,
        remarks: Vec::new(),
    };
    measure.describe(&runs, job.by, &mut about);
    let mut rows: Vec<TableRow> = Vec::new();
    for place in 0..runs.len() {
        let is_reference = Rc::ptr_eq(&runs[place], &reference);
        let is_refined = place + 1 == runs.len();
        // A reference that ended early has no frames after, and neither does its refinement.
        let is_comparable = !is_reference
            && reference.record.diverged.is_none()
            && !(is_refined && runs[place].record.diverged.is_some());
        let distance = if is_comparable {
            distance(&*measure, &mut runs[place], &reference, job.frames)?
        } else {
            M::Distance::default()
        };
        let run = runs[place].clone();
        let same_as =
            runs[..place.min(runs.len() - 2)].iter().position(|other| other.record.is_same(&run.record));
        let (costs, diverged) = (run.costs(&*measure, &sweep.base), run.record.diverged.clone());
        let (setting, passes) = (run.setting.clone(), run.passes(&*measure, &sweep.base));
        let reference = is_comparable.then(|| reference.clone());
        let compared =
            ComparedRun { measure: measure.clone(), run, reference, distance, frames: job.frames.clone() };
        let row = TableRow::new(&setting, &costs, &columns, &compared);
        rows.push(TableRow { same_as, diverged, passes, ..row });
    }
    if !M::KEEPS_FRAMES {
        runs.iter().for_each(|run| remove(&run.folder.path.join(KEPT)));
    }
    let refined = rows.pop().expect("a sweep has a refined reference");
    let reference = rows.pop().expect("a sweep has a reference");
    Ok(Table::new(about, wording, &columns, job.by, rows, [reference, refined]))
}

/// The distance of a run from the reference, which is kept if frames are not.
fn distance<M: Measure>(
    measure: &M,
    run: &mut Rc<Run<M>>,
    reference: &Run<M>,
    frames: &Frames,
) -> Result<M::Distance, RunError> {
    let name = reference.folder.name();
    if let Some(known) = run.record.distances.get(&name) {
        return Ok(known.clone());
    }
    let found = measure.distance(run, reference, frames)?;
    if let Some(run) = Rc::get_mut(run).filter(|_| !M::KEEPS_FRAMES) {
        run.record.distances.insert(name, found.clone());
        run.folder.keep(&run.record)?;
    }
    Ok(found)
}

impl<M: Measure> Run<M> {
    /// What the run costs, and a whole shot of its setting.
    fn costs(&self, measure: &M, base: &Scene) -> Costs {
        let [shown, whole] = measure.scales(&self.folder, base);
        let seconds = self.record.seconds();
        let product = self.product.as_ref();
        let made =
            product.and_then(|product| Spread::of(&product.seconds)).map_or(0.0, |spread| spread.median);
        Costs {
            seconds: seconds.times(shown),
            cpu_seconds: Spread::of(&self.record.cpu_seconds).map(|spread| spread.times(shown)),
            shot_seconds: seconds.median * whole + made * base.frames.count() as f64,
            memory: self.record.memory.max(product.and_then(|product| product.memory)),
        }
    }

    /// Every pass and its time as it is shown [s], mean of the repeats.
    fn passes(&self, measure: &M, base: &Scene) -> Vec<(String, f64)> {
        let scale = measure.scales(&self.folder, base)[0] / self.record.passes.len() as f64;
        let mut passes: Vec<(String, f64)> = Vec::new();
        for (name, seconds) in self.record.passes.iter().flatten() {
            match passes.iter_mut().find(|(known, _)| known == name) {
                Some((_, sum)) => *sum += scale * seconds,
                None => passes.push((name.clone(), scale * seconds)),
            }
        }
        passes
    }
}

impl<M: Measure> RunRecord<M> {
    /// Times of the repeats [s].
    fn seconds(&self) -> Spread {
        let sums = self.passes.iter().map(|passes| passes.iter().map(|(_, seconds)| seconds).sum());
        Spread::of(&sums.collect::<Vec<_>>()).expect("a run has been timed")
    }

    /// Whether all frames of both are the same, as far as was measured. No if one of them diverged.
    fn is_same(&self, other: &Self) -> bool {
        let frames =
            |record: &Self| record.frames.iter().map(|f| (f.frame, f.sample.clone())).collect::<Vec<_>>();
        self.diverged.is_none() && other.diverged.is_none() && frames(self) == frames(other)
    }
}

impl RunFolder {
    /// The folder of a run below `root`: its name is a hash of everything that decides its result and its time.
    fn new<M: Measure>(root: &Path, scene: &Scene, measure: &M, job: &TradeoffJob<'_>) -> Self {
        let (scene, last) = (measure.scene(scene), job.frames.last());
        let (tool, version, threads) = (env!("CARGO_PKG_VERSION"), M::VERSION, par::threads());
        let text = format!("{version} {tool} {} {last} {threads}", measure.decisive(&scene));
        let path = root.join(format!("{:016x}", xxh3_64(text.as_bytes())));
        Self { scene, last, path, jobs: job.jobs }
    }

    /// The record that an earlier run left here.
    fn load<M: Measure>(&self) -> Option<RunRecord<M>> {
        serde_json::from_str(&std::fs::read_to_string(self.path.join("row.json")).ok()?).ok()
    }

    fn keep<M: Measure>(&self, record: &RunRecord<M>) -> Result<(), RunError> {
        let text = serde_json::to_string_pretty(record).expect("a record is plain data") + "\n";
        ShotFolder::write(self.path.join("row.json"), &text)
    }

    /// The record with at least `repeats` times, run as far as it is not there, and whether it was; with its kept frames, if
    /// these are needed.
    fn complete<M: Measure>(
        &self,
        loaded: Option<RunRecord<M>>,
        repeats: usize,
        needs_frames: bool,
        measure: &M,
        control: Control,
    ) -> Result<(RunRecord<M>, bool), RunError> {
        let (mut known, mut was_there) = (loaded, true);
        loop {
            let lacks_frames = needs_frames && !self.path.join(KEPT).exists();
            let is_enough =
                |record: &RunRecord<M>| record.diverged.is_some() || record.passes.len() >= repeats;
            match known {
                Some(record) if is_enough(&record) && !lacks_frames => return Ok((record, was_there)),
                other => known = Some(self.make(other, measure, control)?),
            }
            was_there = false;
        }
    }

    /// Runs it, measures its frames if that has not been done, keeps the record, and deletes the cache.
    fn make<M: Measure>(
        &self,
        known: Option<RunRecord<M>>,
        measure: &M,
        control: Control,
    ) -> Result<RunRecord<M>, RunError> {
        let is_repeat = known.is_some();
        let shot = ShotFolder::new(if is_repeat { self.path.join("again") } else { self.path.clone() });
        let mut made = measure.make(self, &shot, is_repeat, control)?;
        let (mut hashes, mut bytes) = (Vec::new(), 0);
        let present = cache::list(&shot.cache())?;
        for (_, path) in &present {
            let next = "check that the folder can be read";
            let file =
                std::fs::read(path).map_err(|source| RunError::File { path: path.clone(), source, next })?;
            hashes.push(xxh3_64(&file));
            bytes += file.len() as u64;
        }
        let frames_hash = xxh3_64(bytemuck::cast_slice(&hashes));
        let mut record = known.unwrap_or_else(|| RunRecord {
            frames: Vec::new(),
            bytes,
            passes: Vec::new(),
            cpu_seconds: Vec::new(),
            memory: made.memory,
            diverged: made.diverged,
            frames_hash,
            distances: BTreeMap::new(),
        });
        if record.frames_hash != frames_hash {
            return Err(RunError::Request(format!(
                "{}: a second run gave other bytes than the first; expected the same: please report this with the \
                 preset or particles, and check the machine's memory",
                shot.root().display()
            )));
        }
        if !is_repeat {
            // A run that was cut off before its record was written may have left frames.
            remove(&self.path.join(KEPT));
        }
        if !self.path.join(KEPT).exists() {
            for (number, (index, path)) in present.iter().enumerate() {
                let (frame, _) = cache::read_frame(path)?;
                let is_end = number == 0 || number + 1 == present.len();
                let (sample, kept) = measure.sample(self, &frame, is_end, control)?;
                self.write(KEPT, &kept)?;
                if !is_repeat {
                    let logged = made.logged.remove(index);
                    record.frames.push(FrameSample { frame: index.0, sample, logged });
                }
            }
        }
        record.passes.push(made.passes);
        record.cpu_seconds.extend(made.cpu_seconds);
        record.memory = [record.memory, made.memory].into_iter().flatten().min();
        self.keep(&record)?;
        remove(&if is_repeat { shot.root().to_owned() } else { shot.cache() });
        Ok(record)
    }
}

/// Shows one run as a part of the whole job.
struct RunReporter<'a> {
    whole: &'a dyn Reporter,
    number: usize,
    scale: f64,
}

impl Reporter for RunReporter<'_> {
    fn begin(&self, _job: &str, _frames: usize) {}
    fn progress(&self, frames_done: f64) {
        self.whole.progress(self.number as f64 + frames_done * self.scale);
    }
    fn frame(&self, _figures: &str) {}
    fn note(&self, text: &str) {
        // What holds for one run holds for all, and is printed once.
        if self.number == 0 {
            self.whole.note(text);
        }
    }
    fn end(&self) {}
    fn stop(&self) {}
}
