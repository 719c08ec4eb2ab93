//! `log.jsonl`: one line a simulated frame, with what it cost and how far from exact it is.

use super::{
    RunError, ShotFolder,
    file_records::{append_line, read_lines},
};
use crate::frame::FrameIndex;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::collections::{BTreeMap, BTreeSet};

/// One line of the log; `R` is what the simulation reports of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LogLine<R> {
    /// The frame.
    pub(crate) frame: FrameIndex,
    /// Size of the frame's file [bytes].
    pub(crate) bytes: u64,
    /// Particles and points of all systems.
    pub(crate) particles: usize,
    /// What happened in the frame.
    #[serde(flatten)]
    pub(crate) record: R,
}

/// The lines of the folder's log, the last one about each frame; none if there is no log. Lines that are not of this
/// form, as those of another version or cut short by a crash, are skipped.
///
/// # Errors
/// If the log cannot be read.
pub(crate) fn read<R: DeserializeOwned>(
    folder: &ShotFolder,
) -> Result<BTreeMap<FrameIndex, LogLine<R>>, RunError> {
    Ok(parse(&read_lines(&folder.log())?))
}

/// The lines of a log's text.
pub(crate) fn parse<R: DeserializeOwned>(text: &str) -> BTreeMap<FrameIndex, LogLine<R>> {
    let lines = text.lines().filter_map(|line| serde_json::from_str::<LogLine<R>>(line).ok());
    lines.map(|line| (line.frame, line)).collect()
}

/// Appends the line of a frame.
///
/// # Errors
/// If the log cannot be written.
pub(crate) fn append<R: Serialize>(folder: &ShotFolder, line: &LogLine<R>) -> Result<(), RunError> {
    let line = serde_json::to_string(line).expect("a record is plain data") + "\n";
    append_line(&folder.log(), &line)
}

/// The frames that have a line, of any version.
///
/// # Errors
/// If the log cannot be read.
pub(crate) fn frames(folder: &ShotFolder) -> Result<BTreeSet<u32>, RunError> {
    #[derive(Deserialize)]
    struct FrameLine {
        frame: FrameIndex,
        #[serde(rename = "bytes")]
        _bytes: u64,
        #[serde(rename = "particles")]
        _particles: u64,
    }
    let text = read_lines(&folder.log())?;
    let lines = text.lines().filter_map(|line| serde_json::from_str::<FrameLine>(line).ok());
    Ok(lines.map(|line| line.frame.0).collect())
}

/// Drops the lines about frames that `keep` refuses, and a last line that a crash cut short.
///
/// # Errors
/// If the log cannot be written.
pub(crate) fn retain(folder: &ShotFolder, keep: impl Fn(FrameIndex) -> bool) -> Result<(), RunError> {
    #[derive(Deserialize)]
    struct LineHead {
        frame: FrameIndex,
    }
    let text = read_lines(&folder.log())?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Record {
        substeps: u32,
    }

    #[test]
    fn the_last_line_of_a_frame_counts_and_invalid_lines_are_skipped() {
        let line = |frame: u32, substeps: u32| LogLine {
            frame: FrameIndex(frame),
            bytes: 10,
            particles: 3,
            record: Record { substeps },
        };
        let text = |line: &LogLine<Record>| serde_json::to_string(line).unwrap() + "\n";
        assert_eq!(text(&line(2, 8)), "{\"frame\":2,\"bytes\":10,\"particles\":3,\"substeps\":8}\n");
        let other = "{\"frame\":9,\"bytes\":10,\"particles\":3,\"steps\":8}\n{\"frame\":4,\"byt";
        let log = text(&line(2, 8)) + &text(&line(3, 1)) + &text(&line(2, 7)) + other;
        let found = parse::<Record>(&log).into_values().collect::<Vec<_>>();
        assert_eq!(found, [line(2, 7), line(3, 1)]);
    }
}
