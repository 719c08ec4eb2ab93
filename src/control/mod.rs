//! How a run is observed and cancelled, the reasons why it ends early, what is under way where memory ends, and text that is
//! safe to print.

mod memory;
mod printable;

pub(crate) use memory::{UnderWay, fallible, frames_under_way, may_fail};
pub(crate) use printable::{escape_into, printable, printable_path, shell_path, shell_word};

use std::{
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Instant,
};

/// Cancels a run from any thread: clones share one flag.
///
/// Simulations, reconstructions and jobs check their token between steps and end with an error of their own; what
/// they have finished by then stays.
#[derive(Clone, Debug, Default)]
pub struct CancelToken {
    cancelled: Arc<AtomicBool>,
    deadline: Option<Instant>,
}

impl CancelToken {
    /// A token that is not cancelled.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same token, which counts as cancelled from `deadline` on too.
    pub fn with_deadline(&self, deadline: Instant) -> Self {
        let deadline = self.deadline.map_or(deadline, |earlier| earlier.min(deadline));
        Self { cancelled: self.cancelled.clone(), deadline: Some(deadline) }
    }

    /// Cancels this token and all its clones.
    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::SeqCst);
    }

    /// Whether the token was cancelled or its deadline has passed.
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::SeqCst)
            || self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }
}

/// Observes a run from the thread that runs it.
pub trait Watch {
    /// The token that cancels the run; it is read before every substep and every iteration.
    fn token(&self) -> Option<&CancelToken> {
        None
    }

    /// Reports a finished substep; `done` is the finished fraction of the frame.
    fn substep(&mut self, done: f64) {
        let _ = done;
    }
}

impl dyn Watch + '_ {
    /// Whether the run is cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.token().is_some_and(CancelToken::is_cancelled)
    }
}

impl Watch for CancelToken {
    fn token(&self) -> Option<&CancelToken> {
        Some(self)
    }
}

/// Runs to the end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watch for Unwatched {}

/// Why a frame was not finished. The simulation's state is then somewhere inside the frame: to go on, restore
/// it from the last finished frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Stop {
    /// The run was cancelled.
    #[error("interrupted")]
    Interrupted,
    /// The state became meaningless.
    #[error(transparent)]
    Diverged(#[from] Diverged),
}

/// Divergence of a system: a state that is not finite or out of range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{system} diverged in substep {substep} of the frame: particle {particle} {what}; try {try_next}")]
#[non_exhaustive]
pub struct Diverged {
    /// The system's name, as in the preset.
    pub system: &'static str,
    /// The substep of the frame, from 1; 0: the state that the frame started from.
    pub substep: u32,
    /// The id of the first particle found.
    pub particle: u32,
    /// What was found.
    pub what: String,
    /// The setting to change.
    pub try_next: &'static str,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn clones_share_their_cancellation_and_not_their_deadline() {
        let token = CancelToken::new();
        let now = Instant::now();
        let late = token.with_deadline(now + Duration::from_secs(1 << 30));
        let past = late.with_deadline(now);
        assert!(
            past.with_deadline(now + Duration::from_secs(1 << 30)).is_cancelled(),
            "the earlier one holds"
        );
        assert_eq!([&token, &late, &past].map(CancelToken::is_cancelled), [false, false, true]);
        std::thread::scope(|scope| _ = scope.spawn(|| late.clone().cancel()));
        assert_eq!([&token, &late, &past].map(CancelToken::is_cancelled), [true; 3]);
    }
}
