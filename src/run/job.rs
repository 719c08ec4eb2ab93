//! One way from the frames of a source to files, whatever is made of them.
//!
//! *Method*: the frames that are asked for are chosen, gaps told, and what each will need is guessed ([`Source`]). Several at
//! once ([`batch`]), frames are read, passed over where their files are there and were made of the same, unpacked, held
//! against the memory that is allowed, and made ([`Make`]). One that cannot be made is left out and named at the end
//! ([`Ledger`]).

use super::{
    Control, Failure, RunError, ShotFolder, Source, batch,
    ledger::{Done, Ledger, Made, Piece},
    plan::{Product, refuse_memory, stream_memory},
    remarks,
    source::{Known, Wanted},
};
use crate::{
    frame::{FrameIndex, Stream},
    import::ImportError,
    mesh::SurfaceParams,
    scene::Frames,
    sim::{
        sheet,
        smoke::{self, TRACERS},
    },
};
use std::path::Path;

/// What a job is to do, whatever it makes and of what.
#[derive(Clone, Debug)]
pub struct Job {
    /// The frames to use; `None`: all that are there.
    pub selection: Option<Frames>,
    /// Make again what is there already.
    pub force: bool,
    /// What frames under way share, and none may exceed by itself, as far as it can be estimated [bytes].
    pub max_memory: Option<u64>,
    /// Whether several frames may be under way at once. The memory that a plan of a shot tells is that of one.
    pub side_by_side: bool,
    /// Frames a second, where the source does not tell.
    pub fps: f64,
}

impl Job {
    /// The memory that frames under way share [bytes]; 0: one frame at a time.
    fn budget(&self) -> u64 {
        if self.side_by_side { self.max_memory.unwrap_or(batch::TOGETHER) } else { 0 }
    }

    /// Whether what needs so many bytes fits in the `allowance` that was set aside for it. `needed` is told how many bytes
    /// there are: it need not be exact below.
    ///
    /// # Errors
    /// [`RunError::OverMemory`] if it needs more than the job allows.
    pub(super) fn fit(
        &self,
        allowance: Option<u64>,
        needed: impl FnOnce(u64) -> u64,
    ) -> Result<Fit, RunError> {
        let Some(enough) = allowance.or(self.max_memory) else {
            return Ok(Fit::Yes);
        };
        let needed = needed(enough);
        // Alone it is asked again, so that what is refused does not depend on how many run at once.
        if allowance.is_some_and(|allowance| needed > allowance) {
            return Ok(Fit::No);
        }
        self.max_memory.map_or(Ok(()), |limit| refuse_memory(needed, limit))?;
        Ok(Fit::Yes)
    }
}

/// Whether a frame was made within the memory that was set aside for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fit {
    Yes,
    No,
}

/// What is made of a stream of a frame.
pub(super) struct Target {
    pub(super) index: FrameIndex,
    /// The stream's.
    pub(super) name: String,
    /// Identifies what is made of it.
    pub(super) key: u64,
}

/// What is made of the streams of frames.
pub(super) trait Make: Sync {
    /// Of which kind it is.
    const PRODUCT: Product;

    /// The settings that its memory goes by.
    fn params(&self) -> &SurfaceParams;

    /// Whether something is made of the stream of this name.
    fn takes(&self, stream: &str) -> bool;

    /// Why there is nothing to make of a cache, none of whose streams it takes, and what to do.
    fn nothing(&self) -> String;

    /// Identifies what is made of a state of the stream of this name, whose particles stand `spacing` apart at rest [m].
    fn key(&self, stream: &str, state: u64, spacing: f32) -> u64;

    /// The files of a target, if all are there and have its key.
    fn kept(&self, target: &Target) -> Option<Piece>;

    /// Makes the files of a target from a stream of a frame, whose particles stand `spacing` apart at rest [m]. What cannot be
    /// made of it is remembered in `made`.
    ///
    /// # Errors
    /// What a folder or disk refuses; [`RunError::Interrupted`].
    fn make(
        &self,
        part: Part<'_>,
        spacing: f32,
        target: &Target,
        made: &mut Made,
        control: Control,
    ) -> Result<(), RunError>;
}

/// A stream of a frame.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    /// It.
    pub(super) stream: &'a Stream,
    /// All streams of the frame, it among them.
    pub(super) streams: &'a [Stream],
    /// Time since the shot's start [s]; 0 of a file.
    pub(super) time: f64,
}

/// Makes what `maker` makes of the frames of `source`, in `out`.
///
/// # Errors
/// As [`each`]; [`RunError::Request`] if a cache has nothing that it could be made of.
pub(super) fn run<M: Make>(
    source: Source,
    out: &ShotFolder,
    maker: &M,
    job: &Job,
    control: Control,
) -> Result<Done, RunError> {
    let wanted = source.wanted(job.selection.as_ref())?;
    // The first frame that can be read tells what there is in all.
    let names = wanted.iter().find_map(|(_, path)| source.names(path.as_deref()?));
    if names.is_some_and(|names| !names.iter().any(|name| maker.takes(name))) {
        return Err(RunError::Request(maker.nothing()));
    }
    let (title, fps) = source.title(out, job.fps)?;
    let cost = |path: &Path| batch::cost(M::PRODUCT, source.count(path), maker.params());
    let sole = matches!(source, Source::Files { .. }) && wanted.len() == 1;
    let frames = Batch { wanted: &wanted, absent: source.absent(), sole, title: &title, fps };
    each(M::PRODUCT, out, &frames, job, control, cost, |path, allowance, made| {
        let opened = source.open(path, made.index)?;
        let mut due = Vec::new();
        for (place, Known { name, state, spacing }) in opened.known.iter().enumerate() {
            if !maker.takes(name) {
                continue;
            }
            let Some(spacing) = *spacing else {
                let why = format!("the stream {name} does not say its spacing; simulate it again");
                made.fail(why, Failure::Other);
                continue;
            };
            let key = maker.key(name, *state, spacing);
            let shown = match sheet::sheet_of(name) {
                Some(sheet) => sheet.to_owned(),
                None if name == TRACERS => smoke::NAME.to_owned(),
                None => name.clone(),
            };
            let target = Target { index: made.index, name: shown, key };
            match maker.kept(&target).filter(|_| !job.force) {
                Some(piece) => made.pieces.push(piece),
                None => due.push((place, spacing, target)),
            }
        }
        if due.is_empty() {
            return Ok(Fit::Yes);
        }
        let time = opened.time;
        let (streams, notes) = opened.streams()?;
        // What every stream needs is known before the first is made: a second try makes all of them.
        for &(place, spacing, _) in &due {
            let stream = &streams[place];
            if sole && stream.is_empty() {
                return Err(ImportError::NoParticles { path: path.into() }.into());
            }
            let needed = |enough| stream_memory(M::PRODUCT, stream, spacing, maker.params(), enough);
            if job.fit(allowance, needed)? == Fit::No {
                return Ok(Fit::No);
            }
        }
        for (place, spacing, target) in &due {
            let stream = &streams[*place];
            let part = Part { stream, streams: &streams, time };
            maker.make(part, *spacing, target, made, control)?;
            if stream.is_empty() {
                let product = M::PRODUCT.name();
                made.notes.push(format!("{}: no particles, so its {product} is empty", path.display()));
            }
        }
        made.notes.extend(notes.iter().map(|note| format!("{}: {note}", path.display())));
        Ok(Fit::Yes)
    })
}

/// The frames of a job.
pub(super) struct Batch<'a> {
    pub(super) wanted: &'a [Wanted],
    /// Why one that is not there cannot be made.
    pub(super) absent: &'a str,
    /// Whether one file is all that was asked for: what is wrong with it is the job's error.
    pub(super) sole: bool,
    pub(super) title: &'a str,
    /// Frames a second.
    pub(super) fps: f64,
}

/// Does `work(path, allowance, made)` for every frame of a batch, several at once where memory allows; `cost` guesses what
/// one needs [bytes], and `allowance` is that guess for one that is not alone.
///
/// # Errors
/// Frames that cannot be made are left out and named together at the end ([`RunError::SomeFailed`]); what is wrong with
/// a sole file, and a folder or disk that refuses to be written, ends the job at once.
pub(super) fn each(
    product: Product,
    out: &ShotFolder,
    batch: &Batch,
    job: &Job,
    control: Control,
    cost: impl Fn(&Path) -> u64,
    work: impl Fn(&Path, Option<u64>, &mut Made) -> Result<Fit, RunError> + Sync,
) -> Result<Done, RunError> {
    let Batch { wanted, absent, sole, title, fps } = *batch;
    let numbers: Vec<u32> = wanted.iter().map(|(index, _)| index.0).collect();
    let mut ledger = Ledger::new(out, product)?;
    if job.selection.is_none() {
        remarks::of_gaps(&numbers).iter().for_each(|gaps| control.reporter.note(gaps));
    }
    let costs: Vec<u64> = wanted.iter().map(|(_, path)| path.as_deref().map_or(0, &cost)).collect();
    let frame = |place: usize, alone: bool| {
        let (index, path) = &wanted[place];
        let mut made = Made::new(*index);
        let Some(path) = path else {
            made.fail(absent.into(), Failure::Other);
            return Some(Ok(made));
        };
        match work(path, (!alone).then_some(costs[place]), &mut made) {
            Ok(Fit::Yes) => {}
            Ok(Fit::No) => return None,
            Err(RunError::Cache(why)) => made.fail(why.to_string(), Failure::of(&why)),
            Err(RunError::Import(why)) if !sole => made.fail(why.to_string(), Failure::Other),
            Err(why @ RunError::OverMemory { .. }) if !sole => {
                made.fail(format!("{}: {why}", path.display()), Failure::Memory);
            }
            Err(why) => return Some(Err(why)),
        }
        Some(Ok(made))
    };
    let outcome = batch::each(product.name(), &costs, job.budget(), control, frame, |made| {
        ledger.take(made, control);
    });
    ledger.finish(title, fps, &numbers, outcome, control)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_needs_more_than_was_set_aside_runs_alone_and_more_than_is_allowed_not_at_all() {
        let job =
            |max_memory| Job { selection: None, force: false, max_memory, side_by_side: true, fps: 24.0 };
        let free = job(None);
        assert_eq!(free.fit(None, |_| unreachable!("nothing limits it")).unwrap(), Fit::Yes);
        assert_eq!(free.fit(Some(10), |_| 10).unwrap(), Fit::Yes);
        assert_eq!(free.fit(Some(10), |_| 11).unwrap(), Fit::No);
        let limited = job(Some(20));
        assert_eq!(limited.fit(Some(10), |_| 11).unwrap(), Fit::No);
        assert_eq!(limited.fit(None, |_| 20).unwrap(), Fit::Yes);
        let refused = limited.fit(None, |_| 21);
        assert!(matches!(refused, Err(RunError::OverMemory { needed: 21, allowed: 20 })), "{refused:?}");
        assert_eq!((free.budget(), limited.budget()), (batch::TOGETHER, 20));
        assert_eq!(Job { side_by_side: false, ..limited }.budget(), 0, "as the plan of a shot has it");
    }
}
