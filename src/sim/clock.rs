//! Wall-clock time by pass.

use std::{borrow::Cow, time::Instant};

/// Wall-clock time by pass [s].
pub type Seconds = Vec<(Cow<'static, str>, f64)>;

/// Accumulates wall-clock time by pass.
#[derive(Debug)]
pub(super) struct Clock {
    totals: Seconds,
}

impl Clock {
    /// A clock for these passes.
    pub(super) fn new(passes: &[&'static str]) -> Self {
        Self { totals: passes.iter().map(|&name| (name.into(), 0.0)).collect() }
    }

    /// Runs `job` and adds its time to `pass`.
    ///
    /// # Panics
    /// If `pass` is not among the clock's passes.
    pub(super) fn time<T>(&mut self, pass: &'static str, job: impl FnOnce() -> T) -> T {
        let entry = self.totals.iter_mut().find(|(name, _)| *name == pass).expect("the clock has the pass");
        let start = Instant::now();
        let result = job();
        entry.1 += start.elapsed().as_secs_f64();
        result
    }

    /// Runs a `job` that times passes itself, and adds the remaining time to `pass`.
    ///
    /// # Panics
    /// If `pass` is not among the clock's passes.
    pub(super) fn around<T>(&mut self, pass: &'static str, job: impl FnOnce(&mut Self) -> T) -> T {
        let (start, before) = (Instant::now(), self.total());
        let result = job(self);
        let own = start.elapsed().as_secs_f64() - (self.total() - before);
        let entry = self.totals.iter_mut().find(|(name, _)| *name == pass).expect("the clock has the pass");
        entry.1 += own;
        result
    }

    fn total(&self) -> f64 {
        self.totals.iter().map(|(_, seconds)| seconds).sum()
    }

    /// The seconds by pass.
    pub(super) fn into_totals(self) -> Seconds {
        self.totals
    }
}
