//! Frames that another process is still simulating.

use crate::{
    cache::{Arrival, await_file, frame_path},
    control::printable_path,
    frame::FrameIndex,
    job::{Control, RunError, ShotFolder},
};
use std::{path::Path, time::Duration};

/// Waits for a frame of a shot that another process simulates: as long as that process lives, at most for `limit`; without one at
/// most as long as jobs wait for others (`--wait`).
///
/// # Errors
/// [`RunError::NotFollowed`] if the frame does not come; [`RunError::Interrupted`].
pub(crate) fn await_frame(
    shot: &ShotFolder,
    index: FrameIndex,
    limit: Duration,
    control: Control,
) -> Result<(), RunError> {
    await_shot_file(&frame_path(&shot.cache(), index), &format!("frame {index}"), shot, limit, control)
}

/// As [`await_frame`], for any file that the simulation of a shot writes.
///
/// # Errors
/// As [`await_frame`].
pub(crate) fn await_shot_file(
    path: &Path,
    what: &str,
    shot: &ShotFolder,
    limit: Duration,
    control: Control,
) -> Result<(), RunError> {
    let why = match await_file(path, &shot.cache(), limit, &control)? {
        Arrival::There => return Ok(()),
        Arrival::Cancelled => return Err(RunError::Interrupted),
        Arrival::Abandoned => format!(
            "no process has simulated there for {} s (--wait); simulate it on, then run this command again",
            control.wait.as_secs()
        ),
        Arrival::Late => format!(
            "the simulation is still running, but {what} has not come within {} s; allow more with --follow=TIME",
            limit.as_secs()
        ),
    };
    Err(RunError::NotFollowed { shot: printable_path(shot.root()).to_string(), what: what.into(), why })
}
