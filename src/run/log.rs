//! `log.jsonl`: one line a simulated frame, with what it cost and how far from exact it is.

use super::{RunError, ShotFolder};
use crate::{frame::FrameIndex, sim::FrameRecord};
use serde::{Deserialize, Serialize};
use std::{fs::OpenOptions, io::Write};

/// One line of the log.
#[derive(Serialize)]
struct Line<'a> {
    frame: FrameIndex,
    bytes: u64,
    particles: usize,
    #[serde(flatten)]
    record: &'a FrameRecord,
}

/// The part of a line that tells which frame it is about.
#[derive(Deserialize)]
struct LineHead {
    frame: FrameIndex,
}

/// Adds the line of a frame; a line that an earlier run left about the same frame is replaced.
pub(super) fn append(
    folder: &ShotFolder,
    frame: FrameIndex,
    bytes: u64,
    particles: usize,
    record: &FrameRecord,
) -> Result<(), RunError> {
    let mut line =
        serde_json::to_vec(&Line { frame, bytes, particles, record }).expect("a record is plain data");
    line.push(b'\n');
    let written = OpenOptions::new().create(true).append(true).open(folder.log());
    written.and_then(|mut file| file.write_all(&line)).map_err(|source| fail(folder, source))
}

/// Drops the lines about frames that `keep` refuses, and a last line that a crash cut short.
pub(super) fn retain(folder: &ShotFolder, keep: impl Fn(FrameIndex) -> bool) -> Result<(), RunError> {
    let Ok(text) = std::fs::read_to_string(folder.log()) else { return Ok(()) };
    let kept: String = text
        .lines()
        .filter(|line| serde_json::from_str::<LineHead>(line).is_ok_and(|head| keep(head.frame)))
        .map(|line| format!("{line}\n"))
        .collect();
    if kept != text {
        ShotFolder::write(folder.log(), &kept)?;
    }
    Ok(())
}

fn fail(folder: &ShotFolder, source: std::io::Error) -> RunError {
    RunError::File {
        path: folder.log(),
        source,
        next: "check that the folder can be written and the disk has room",
    }
}
