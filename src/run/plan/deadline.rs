//! A watch that ends a calibration when its time is up.

use crate::{
    run::{Control, usage::Meter},
    sim::Watch,
};

/// Goes on until time is up, or the user stops the job.
pub(super) struct Deadline<'a> {
    pub(super) control: Control<'a>,
    pub(super) clock: Meter,
    /// How long it may take [s].
    pub(super) seconds: f64,
}

impl Watch for Deadline<'_> {
    fn keep_going(&mut self) -> bool {
        self.clock.wall() < self.seconds && !(self.control.interrupted)()
    }
}
