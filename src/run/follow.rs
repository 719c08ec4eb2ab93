//! The frames of a simulation that another process runs.

use super::{Control, Manifest, RunError, ShotFolder, verify::requested_frames};
use crate::{
    frame::FrameIndex,
    job::batch::{await_frame, await_shot_file},
    run::frame_ranges,
    scene::Frames,
};
use std::time::Duration;

/// Waits until a simulation has written its first frame, and returns the frames that it will have: those of `selection`, or all that
/// were requested of it.
///
/// # Errors
/// [`RunError::NotFollowed`] if no simulation starts; [`RunError::Interrupted`]; if `shot.json` cannot be read.
pub(crate) fn follow(
    shot: &ShotFolder,
    selection: Option<&Frames>,
    limit: Duration,
    control: Control,
) -> Result<Frames, RunError> {
    await_shot_file(&shot.manifest(), "shot.json", shot, limit, control)?;
    let frames = match selection {
        Some(frames) => frames.clone(),
        None => {
            let manifest = Manifest::read(shot)?;
            let requested = manifest.as_ref().map(requested_frames).unwrap_or_default();
            let numbers: Vec<u32> = requested.into_iter().collect();
            frame_ranges(&numbers).parse().map_err(|_| {
                RunError::Request(format!(
                    "{}: found no frames that were requested of a simulation; name them with --frames",
                    shot.manifest().display()
                ))
            })?
        }
    };
    let FrameIndex(first) = frames.first();
    await_frame(shot, FrameIndex(first), limit, control)?;
    Ok(frames)
}
