//! Volumes of tracers.

use super::{
    file::{figures, write_file},
    settings::VolumeSettings,
    tracer_grids::{TracerFrame, TracerGridError, TracerGridStats, TracerGrids},
};
use crate::{
    export::vdb::VolumeGrid,
    job::{
        Control, Failure, RunError, ShotFolder,
        batch::{FileTarget, FrameFiles, FrameOutcome},
        nonzero,
    },
    mesh::SurfaceParams,
    sim::SetupError,
};
use std::time::Instant;
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a volume holds gives the same tracers and settings another file.
const TRACER_VOLUME_VERSION: u32 = 3;

/// Identifies the volume that is made of the tracers of `state`.
pub(super) fn tracer_key(settings: &VolumeSettings, grids: &[VolumeGrid], state: u64) -> u64 {
    let VolumeSettings { surface: SurfaceParams { voxel, kernel_radius, .. }, volume, .. } = settings;
    let air = settings.smoke.is_some();
    xxh3_64(
        format!(
            "smoke {TRACER_VOLUME_VERSION} {state:016x} {voxel} {kernel_radius} {volume:?} {grids:?} {air}"
        )
        .as_bytes(),
    )
}

/// Makes and writes the volume of the tracers of a frame. What cannot be made is recorded in `outcome`.
///
/// # Errors
/// What a folder or disk refuses; [`RunError::Interrupted`].
pub(super) fn write_tracers(
    out: &ShotFolder,
    settings: &VolumeSettings,
    frame: TracerFrame<'_>,
    target: &FileTarget,
    outcome: &mut FrameOutcome,
    control: Control,
) -> Result<(), RunError> {
    let start = Instant::now();
    let shutter = settings.smoke.as_ref().map_or(0.0, |around| 1.0 / around.smoke.fps) as f32;
    let shutter = shutter / frame.slowdown as f32;
    let grids = match TracerGrids::new(&frame, shutter, &settings.surface, control.cancel) {
        Ok(grids) => grids,
        Err(TracerGridError::Interrupted) => return Err(RunError::Interrupted),
        Err(TracerGridError::Missing(what)) => {
            outcome.fail(format!("the tracers have no {what}; simulate the shot again"), Failure::Other);
            return Ok(());
        }
        Err(TracerGridError::OutOfRange(error)) => {
            outcome.fail(no_velocity(&SetupError::from(error)), Failure::Other);
            return Ok(());
        }
    };
    let written = write_file(out, target, outcome, grids.names(), |path| {
        grids.write(path, &settings.volume, target.key)
    })?;
    let Some((output, mut written)) = written else { return Ok(()) };
    let remarks = remarks(&grids.stats);
    let bytes = written.record.bytes();
    written.figures = figures(target.index, grids.names(), grids.stats.bricks, bytes, start, &remarks);
    outcome.files.push(FrameFiles { outputs: vec![output], written: Some(written), stale: Vec::new() });
    Ok(())
}

/// What a volume lacks of its tracers.
fn remarks(stats: &TracerGridStats) -> Vec<String> {
    let truncated = stats
        .truncated
        .then(|| "velocities end before the distance that the smoke moves in a frame".to_owned());
    nonzero(&[(stats.too_far as u64, "tracers too far from the origin, left out")])
        .into_iter()
        .chain(truncated)
        .collect()
}

/// Why the velocity of the air in a cached frame cannot be computed.
pub(in crate::product) fn no_velocity(why: &(dyn std::error::Error + 'static)) -> String {
    match why.downcast_ref() {
        Some(SetupError::OutOfRange(error)) => {
            format!("the air's velocity cannot be computed: {error}; simulate the shot again")
        }
        _ => why.to_string(),
    }
}
