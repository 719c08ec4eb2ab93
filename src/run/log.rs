//! `log.jsonl`: one line a simulated frame, with what it cost and how far from exact it is.

use super::{RunError, ShotFolder};
use crate::{
    frame::FrameIndex,
    sim::{
        FrameRecord, coupling::CouplingRecord, sheet::SheetRecord, smoke::SmokeRecord, vortex::Invariants,
    },
};
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::{fs::OpenOptions, io::Write};

/// One line of the log.
#[derive(Serialize)]
struct Line<'a, R: Serialize> {
    frame: FrameIndex,
    bytes: u64,
    particles: usize,
    #[serde(flatten)]
    record: &'a R,
}

/// What a line tells of a shot without a liquid.
#[derive(Serialize)]
struct Dry<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    smoke: &'a Option<SmokeRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sheets: &'a Option<SheetRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    coupling: &'a Option<CouplingRecord>,
    seconds: &'a [(&'static str, f64)],
}

/// The part of a line that tells which frame it is about.
#[derive(Deserialize)]
struct LineHead {
    frame: FrameIndex,
}

/// What a line tells, for jobs that read it back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Logged {
    /// The frame.
    pub frame: FrameIndex,
    /// Substeps taken.
    pub substeps: u32,
    /// Iterations over all substeps.
    pub iterations: u32,
    /// Substeps that ended above the target.
    pub unconverged: u32,
    /// Average density deviation, as a fraction.
    pub density_dev_avg: f64,
    /// Largest density deviation, as a fraction.
    pub density_dev_max: f64,
    /// Kinetic energy [J].
    pub kinetic_energy: f64,
    /// Potential energy [J]; its zero is at the world's origin.
    pub potential_energy: f64,
}

/// What a line tells of smoke, for jobs that read it back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LoggedSmoke {
    /// The frame.
    pub frame: FrameIndex,
    /// The frame's file [bytes].
    pub bytes: u64,
    /// The smoke.
    pub smoke: Smoke,
}

/// The part of a [`SmokeRecord`] that jobs read back; what each is, is said there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Smoke {
    /// Steps taken.
    pub substeps: u32,
    /// Steps longer than the limits ask for.
    pub capped: u32,
    /// Strengths cut.
    pub clamped: u64,
    /// Vortons at the end.
    pub vortons: u64,
    /// Tracers at the end.
    pub tracers: u64,
    /// What motion keeps.
    pub invariants: Invariants,
    /// The sampled error of the velocity.
    pub error: Option<f64>,
}

/// What a line tells of sheets, for jobs that read it back.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct LoggedSheets {
    /// The frame.
    pub frame: FrameIndex,
    /// The sheets.
    pub sheets: Sheets,
}

/// The part of a [`SheetRecord`] that jobs read back; what each is, is said there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Sheets {
    /// Substeps taken.
    pub substeps: u32,
    /// Rounds of the conjugate gradients.
    pub iterations: u32,
    /// Substeps that ended above the tolerance.
    pub unconverged: u32,
    /// Substeps in which one linearisation made energy.
    pub overshot: u32,
    /// Energy of motion [J].
    pub kinetic_energy: f64,
    /// Energy of springs and plates [J].
    pub elastic_energy: f64,
    /// Energy of height [J].
    pub potential_energy: f64,
    /// Largest strain of a spring.
    pub strain_max: f64,
    /// Points put out of solids.
    pub caught: u64,
    /// Points within a solid at the end.
    pub inside_solids: u64,
}

/// Wall-clock time of the passes of all logged frames [s].
///
/// # Errors
/// As [`read`].
pub(super) fn seconds(folder: &ShotFolder) -> Result<f64, RunError> {
    #[derive(Deserialize)]
    struct Timed {
        seconds: Vec<(String, f64)>,
    }
    let lines: Vec<Timed> = read(folder)?;
    Ok(lines.iter().flat_map(|line| &line.seconds).map(|(_, seconds)| seconds).sum())
}

/// Every line of the folder's log; none if there is no log.
///
/// # Errors
/// If it cannot be read, or a line is not what is looked for.
pub(super) fn read<L: DeserializeOwned>(folder: &ShotFolder) -> Result<Vec<L>, RunError> {
    let text = match std::fs::read_to_string(folder.log()) {
        Err(absent) if absent.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        read => read.map_err(|source| fail(folder, source))?,
    };
    let line = |line: &str| serde_json::from_str(line).map_err(|why| fail(folder, why.into()));
    text.lines().map(line).collect()
}

/// Adds the line of a frame; a line that an earlier run left about the same frame is replaced. Without a `liquid` it has nothing of
/// one.
pub(super) fn append(
    folder: &ShotFolder,
    frame: FrameIndex,
    bytes: u64,
    particles: usize,
    liquid: bool,
    record: &FrameRecord,
) -> Result<(), RunError> {
    let line = if liquid {
        serde_json::to_vec(&Line { frame, bytes, particles, record })
    } else {
        let FrameRecord { smoke, sheets, coupling, seconds, .. } = record;
        let record = &Dry { smoke, sheets, coupling, seconds };
        serde_json::to_vec(&Line { frame, bytes, particles, record })
    };
    let mut line = line.expect("a record is plain data");
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
