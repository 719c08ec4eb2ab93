//! Does something for every frame of a batch, and keeps account of it.

use super::{
    follow::await_frame,
    ledger::{BatchSummary, FrameOutcome, Ledger, ProductFolder},
    request::{BatchRequest, MemoryCheck},
    schedule::{self, Queue},
    source::RequestedFrame,
};
use crate::{
    control::{UnderWay, printable_path},
    job::{Control, Failure, FrameSpan, RunError, ShotFolder},
};
use std::{path::Path, time::Duration};

/// The frames of a batch.
pub(crate) struct FrameBatch<'a> {
    pub(crate) frames: &'a [RequestedFrame],
    /// The shot whose simulation writes these frames while they are made, and how long to wait for each; `None`: all are there.
    pub(crate) followed: Option<(&'a ShotFolder, Duration)>,
    /// Why a frame that is not present cannot be made.
    pub(crate) absent: &'a str,
    /// Whether one file is all that was requested: what is wrong with it is the batch's error.
    pub(crate) is_single_file: bool,
    pub(crate) title: &'a str,
    /// Frames a second.
    pub(crate) fps: f64,
}

/// Calls `work(path, reserved, outcome)` for every frame of a batch, several at once where memory allows. `estimate`
/// gives the memory that a frame needs [bytes]; `reserved` is that estimate for a frame that is not alone.
///
/// # Errors
/// Frames that cannot be made are left out and reported together at the end ([`RunError::SomeFailed`]). Errors of a
/// single file, and a folder or disk that refuses to be written, end the batch at once.
pub(crate) fn process_frames(
    product: &dyn ProductFolder,
    out: &ShotFolder,
    batch: &FrameBatch,
    request: &BatchRequest,
    control: Control,
    estimate: impl Fn(&Path) -> u64 + Sync,
    work: impl Fn(&Path, Option<u64>, &mut FrameOutcome) -> Result<MemoryCheck, RunError> + Sync,
) -> Result<BatchSummary, RunError> {
    let FrameBatch { frames, absent, is_single_file, title, fps, .. } = *batch;
    let numbers: Vec<u32> = frames.iter().map(|(index, _)| index.0).collect();
    let mut ledger = Ledger::new(out, product, control)?;
    if request.selection.is_none() {
        missing_frames(&numbers).iter().for_each(|missing| control.reporter.note(missing));
    }
    let frame = |place: usize, reserved: Option<u64>| {
        let (index, path) = &frames[place];
        let _under_way = UnderWay::new(index.0);
        let mut outcome = FrameOutcome::new(*index);
        let Some(path) = path else {
            outcome.fail(absent.into(), Failure::Other);
            return Some(Ok(outcome));
        };
        match work(path, reserved, &mut outcome) {
            Ok(MemoryCheck::Fits) => {}
            Ok(MemoryCheck::NeedsMore) => return None,
            Err(RunError::Cache(why)) => outcome.fail(why.to_string(), Failure::of(&why)),
            Err(RunError::Import(why)) if !is_single_file => outcome.fail(why.to_string(), Failure::Other),
            Err(why @ RunError::OverMemory { .. }) if !is_single_file => {
                outcome.fail(format!("{}: {why}", printable_path(path)), Failure::Memory);
            }
            Err(why) => return Some(Err(why)),
        }
        // At once: what ends the job later does not make these files unknown.
        Some(outcome.record(out, product.name(), control).map(|()| outcome))
    };
    let memory = request.concurrent_memory();
    let queue = &BatchQueue { batch, estimate, control };
    let ended = schedule::run(product.name(), queue, memory, control, frame, |outcome| {
        ledger.add_frame(outcome, control);
    });
    ledger.finish(title, fps, &numbers, ended, control)
}

/// The frames of a batch in their order.
struct BatchQueue<'a, E> {
    batch: &'a FrameBatch<'a>,
    estimate: E,
    control: Control<'a>,
}

impl<E: Fn(&Path) -> u64 + Sync> Queue for BatchQueue<'_, E> {
    fn len(&self) -> usize {
        self.batch.frames.len()
    }

    fn arrived(&self, place: usize, max: usize) -> Result<usize, RunError> {
        let Some((shot, limit)) = self.batch.followed else { return Ok(max) };
        let frames = &self.batch.frames[place..place + max];
        await_frame(shot, frames[0].0, limit, self.control)?;
        let is_there = |(_, path): &&RequestedFrame| path.as_ref().is_some_and(|path| path.is_file());
        Ok(1 + frames[1..].iter().take_while(is_there).count())
    }

    fn estimate(&self, place: usize) -> u64 {
        self.batch.frames[place].1.as_deref().map_or(0, &self.estimate)
    }
}

/// Ranges of missing frames that a line lists.
const MAX_LISTED_RANGES: usize = 20;

/// Reports the frames that a sequence lacks between its first and its last. Where more than two frames are all at multiples
/// of a distance, that is its step.
fn missing_frames(frames: &[u32]) -> Option<String> {
    let span = FrameSpan::of(frames)?;
    let step = if frames.len() > 2 { span.step } else { 1 };
    let gaps: Vec<(u32, u32)> = frames
        .windows(2)
        .filter(|pair| pair[1] - pair[0] > step)
        .map(|pair| (pair[0] + step, pair[1] - step))
        .collect();
    let missing: u64 = gaps.iter().map(|(first, last)| u64::from((last - first) / step) + 1).sum();
    let text = |&(first, last): &(u32, u32)| match step {
        _ if first == last => first.to_string(),
        1 => format!("{first}-{last}"),
        step => format!("{first}-{last}x{step}"),
    };
    let listed: Vec<String> = gaps.iter().take(MAX_LISTED_RANGES).map(text).collect();
    let more = if gaps.len() > MAX_LISTED_RANGES { ",…" } else { "" };
    (missing > 0).then(|| {
        let (first, last) = (span.first, span.last);
        format!("{missing} frames are missing between {first} and {last}: {}{more}", listed.join(","))
    })
}

#[cfg(test)]
mod tests {
    use super::missing_frames;

    #[test]
    fn missing_frames_are_written_as_ranges() {
        let reported = |count: u32, first: u32, last: u32, which: &str| {
            Some(format!("{count} frames are missing between {first} and {last}: {which}"))
        };
        assert_eq!(missing_frames(&[]), None);
        assert_eq!(missing_frames(&[5]), None);
        assert_eq!(missing_frames(&[1, 2, 3]), None);
        assert_eq!(missing_frames(&[1, 3]), reported(1, 1, 3, "2"));
        assert_eq!(missing_frames(&[3, 4, 10]), reported(5, 3, 10, "5-9"));
        assert_eq!(missing_frames(&[1, 3, 5, 7]), None, "every second frame is present");
        assert_eq!(missing_frames(&[10, 20, 50, 70]), reported(3, 10, 70, "30-40x10,60"));
        assert_eq!(missing_frames(&[0, 1, u32::MAX]), reported(u32::MAX - 2, 0, u32::MAX, "2-4294967294"));
        let every_third_is_missing: Vec<u32> = (0..90).filter(|i| i % 3 != 1).collect();
        assert!(missing_frames(&every_third_is_missing).unwrap().starts_with("30 frames"));
        assert!(missing_frames(&every_third_is_missing).unwrap().ends_with("55,58,…"));
    }
}
