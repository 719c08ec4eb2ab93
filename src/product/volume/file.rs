//! The volume file of a frame.

use super::folder::VolumeFile;
use crate::{
    cache::WrittenFile,
    export::{
        ExportError,
        vdb::{self, VolumeGrid},
    },
    frame::FrameIndex,
    job::{
        Failure, OutputFiles, RunError, ShotFolder,
        batch::{FileTarget, FrameFiles, FrameOutcome, ProductFolder, Written},
    },
};
use std::{path::Path, time::Instant};

/// The names of some grids, for a message.
pub(super) fn names(grids: &[VolumeGrid]) -> String {
    grids.iter().map(|grid| grid.name()).collect::<Vec<_>>().join(", ")
}

/// Writes the volume file of a target, which has these grids; `None` if the grids do not fit in the format, which is recorded in
/// `outcome`.
pub(super) fn write_file(
    out: &ShotFolder,
    target: &FileTarget,
    outcome: &mut FrameOutcome,
    grids: &[VolumeGrid],
    write: impl FnOnce(&Path) -> Result<WrittenFile, ExportError>,
) -> Result<Option<(OutputFiles, Written)>, RunError> {
    let mut output = output(target);
    let mut written = Written::of(target);
    match write(&output.file(out, target.index.0)) {
        Ok(file) => written.add(&output, file),
        Err(why @ ExportError::Volume { .. }) => {
            outcome.fail(why.to_string(), Failure::Other);
            return Ok(None);
        }
        Err(why) => return Err(why.into()),
    }
    output.grids = grids.iter().map(|grid| grid.name().into()).collect();
    Ok(Some((output, written)))
}

/// The file of a target, if it is present and has its key.
pub(super) fn up_to_date(out: &ShotFolder, target: &FileTarget) -> Option<FrameFiles> {
    let mut output = output(target);
    let (key, grids) = vdb::made_from(&output.file(out, target.index.0))?;
    if key != target.key {
        return None;
    }
    // Which grids were made depends on the frame's particles, too.
    output.grids = grids;
    Some(FrameFiles { outputs: vec![output], written: None, stale: Vec::new() })
}

/// The output that the volume of a target belongs to, with its frame alone.
fn output(target: &FileTarget) -> OutputFiles {
    OutputFiles::of("volume", VolumeFile.name(), &target.name, "vdb", target.index)
}

/// One line about the volume of a frame.
pub(super) fn figures(
    index: FrameIndex,
    grids: &[VolumeGrid],
    bricks: usize,
    bytes: u64,
    start: Instant,
    remarks: &[String],
) -> String {
    let (names, mib) = (names(grids), bytes as f64 / f64::from(1 << 20));
    let seconds = start.elapsed().as_secs_f64();
    let mut line = format!("frame {index}  {names}  {bricks} bricks  {mib:.2} MiB  {seconds:.2} s");
    for remark in remarks {
        line += &format!("  {remark}");
    }
    line
}
