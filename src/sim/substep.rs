//! The substep loop that all systems share.

use super::{Stop, Watch};

/// A frame ends when at most this part of it is left: substeps that end it leave rounding errors.
const END_TOLERANCE: f64 = 1e-9;

/// How far a frame has been advanced.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameProgress {
    /// Time at which the frame starts [s].
    start: f64,
    /// Length of the frame [s].
    pub(super) seconds: f64,
    /// Time left in the frame [s].
    pub(super) left: f64,
}

impl FrameProgress {
    /// Time at which the next substep starts [s].
    pub(super) fn now(&self) -> f64 {
        self.after(0.0)
    }

    /// Time after a substep of `dt` [s].
    pub(super) fn after(&self, dt: f64) -> f64 {
        self.start + (self.seconds - (self.left - dt))
    }
}

/// Advances from `start` [s] by one frame of `seconds` [s]. `substep` chooses the length of its time step, takes the step,
/// and returns the length [s].
///
/// # Errors
/// If the run is cancelled, or `substep` fails.
pub(super) fn advance_frame(
    [start, seconds]: [f64; 2],
    watch: &mut dyn Watch,
    mut substep: impl FnMut(FrameProgress, &mut dyn Watch) -> Result<f64, Stop>,
) -> Result<(), Stop> {
    let mut progress = FrameProgress { start, seconds, left: seconds };
    while progress.left > END_TOLERANCE * seconds {
        if watch.is_cancelled() {
            return Err(Stop::Interrupted);
        }
        progress.left -= substep(progress, watch)?;
        watch.substep(1.0 - progress.left / seconds);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::CancelToken;

    /// Records the reported progress and cancels after some substeps.
    #[derive(Default)]
    struct Recorder {
        reports: Vec<f64>,
        limit: usize,
        token: CancelToken,
    }

    impl Watch for Recorder {
        fn token(&self) -> Option<&CancelToken> {
            Some(&self.token)
        }

        fn substep(&mut self, done: f64) {
            self.reports.push(done);
            if self.reports.len() == self.limit {
                self.token.cancel();
            }
        }
    }

    #[test]
    fn substeps_cover_the_frame_and_report_their_progress() {
        let (mut watch, mut starts) = (Recorder::default(), Vec::new());
        let mut end = 0.0;
        advance_frame([2.0, 0.5], &mut watch, |progress, _| {
            starts.push(progress.now());
            // Not quite the rest: rounding errors do not cause a fifth substep.
            let dt = if starts.len() == 4 { progress.left * (1.0 - 1e-12) } else { 0.125 };
            end = progress.after(dt);
            Ok(dt)
        })
        .unwrap();
        assert_eq!(starts, [2.0, 2.125, 2.25, 2.375]);
        assert!((end - 2.5).abs() < 1e-9);
        assert_eq!(watch.reports[..3], [0.25, 0.5, 0.75]);
        assert!((watch.reports[3] - 1.0).abs() < 1e-9 && watch.reports.len() == 4);
    }

    #[test]
    fn an_interrupted_frame_takes_no_further_substep() {
        let (mut watch, mut steps) = (Recorder { limit: 2, ..Recorder::default() }, 0);
        let result = advance_frame([0.0, 1.0], &mut watch, |_, _| {
            steps += 1;
            Ok(0.25)
        });
        assert_eq!((result, steps), (Err(Stop::Interrupted), 2));
    }
}
