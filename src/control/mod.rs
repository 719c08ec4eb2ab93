//! How a run is observed, and the reasons why it ends early.

/// Observes a run from the thread that runs it.
pub trait Watch {
    /// Whether to go on; called before every substep and every iteration.
    fn keep_going(&mut self) -> bool;

    /// Called after every substep; `done` is the finished fraction of the frame.
    fn substep(&mut self, done: f64) {
        let _ = done;
    }
}

/// Lets a run go on to its end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Unwatched;

impl Watch for Unwatched {
    fn keep_going(&mut self) -> bool {
        true
    }
}

/// Why a frame was not finished. The simulation's state is then somewhere inside the frame: to go on, restore
/// it from the last finished frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Stop {
    /// The watch requested a stop.
    #[error("interrupted")]
    Interrupted,
    /// The state became meaningless.
    #[error(transparent)]
    Diverged(#[from] Diverged),
}

/// A system left the numbers that mean anything.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{system} diverged in substep {substep} of the frame: particle {particle} {what}; try {try_next}")]
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
