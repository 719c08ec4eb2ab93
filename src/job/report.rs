//! How a job reports progress and learns of cancellation.

use crate::{
    cache::Patience,
    control::{CancelToken, Watch},
    image::Canvas,
};
use std::time::Duration;

/// Progress and messages of a job. Implemented by the command line.
pub(crate) trait Reporter: Sync {
    /// A job of `frames` frames begins.
    fn begin(&self, job: &str, frames: usize);

    /// So many frames of the job are done; fractions count.
    fn progress(&self, frames_done: f64);

    /// A frame is finished; `figures` is one line about it.
    fn frame(&self, figures: &str);

    /// A picture of a frame is drawn; most callers show none.
    fn picture(&self, _picture: &Canvas) {}

    /// Runs `print` while nothing of the progress is drawn, so that it does not mix with what is printed.
    fn suspended(&self, print: &mut dyn FnMut()) {
        print();
    }

    /// Something the user should know, once.
    fn note(&self, text: &str);

    /// The job is done.
    fn end(&self);

    /// The job, if one was running, ended early; the reason is reported elsewhere.
    fn stop(&self);
}

/// Reports nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Silent;

impl Reporter for Silent {
    fn begin(&self, _job: &str, _frames: usize) {}
    fn progress(&self, _frames_done: f64) {}
    fn frame(&self, _figures: &str) {}
    fn note(&self, _text: &str) {}
    fn end(&self) {}
    fn stop(&self) {}
}

/// Connection of a job to its caller.
#[derive(Clone, Copy)]
pub(crate) struct Control<'a> {
    /// Receiver of progress and messages.
    pub reporter: &'a dyn Reporter,
    /// Cancels the job between two steps; everything finished so far is kept.
    pub cancel: &'a CancelToken,
    /// The longest time to wait for files that another process writes.
    pub wait: Duration,
}

impl<'a> Control<'a> {
    /// A connection whose job waits as long as jobs do by default.
    #[cfg(test)]
    pub(crate) fn new(reporter: &'a dyn Reporter, cancel: &'a CancelToken) -> Self {
        Self { reporter, cancel, wait: Duration::from_secs(120) }
    }
}

impl Patience for Control<'_> {
    fn limit(&self) -> Duration {
        self.wait
    }

    fn announce(&self, line: &str) {
        self.reporter.note(line);
    }

    fn is_over(&self) -> bool {
        self.cancel.is_cancelled()
    }
}

/// Reports the progress of a part of a job and passes on its cancellation.
pub(crate) struct Progress<'a> {
    pub(crate) control: Control<'a>,
    /// Frames that were done before.
    pub(crate) base: f64,
    /// Frames that are done with this part.
    pub(crate) scale: f64,
}

impl Watch for Progress<'_> {
    fn token(&self) -> Option<&CancelToken> {
        Some(self.control.cancel)
    }

    fn substep(&mut self, done: f64) {
        self.control.reporter.progress(self.base + self.scale * done);
    }
}

/// The counts that are not zero, each followed by what it counts.
pub(crate) fn nonzero(counts: &[(u64, &str)]) -> Vec<String> {
    counts.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}")).collect()
}
