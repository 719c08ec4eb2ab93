//! The figures of whitewater in the lines of `whitewater.jsonl`.

use super::folder::WhitewaterPoints;
use crate::{
    frame::FrameIndex,
    job::{
        RunError, ShotFolder,
        batch::ProductFolder,
        file_records::{path, read_lines},
    },
    product::request::ProductInfo,
    sim::whitewater::Kind,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Particles of a frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct FrameCounts {
    frame: FrameIndex,
    spray: u64,
    foam: u64,
    bubbles: u64,
    #[serde(default)]
    over_limit: u64,
    #[serde(default)]
    stuck: u64,
    #[serde(default)]
    left_out: u64,
    #[serde(default)]
    too_far_for_volume: u64,
}

/// A count of a frame that the line about all frames sums.
type Loss = (fn(&FrameCounts) -> u64, &'static str);

/// What is missing in files.
const LOSSES: [Loss; 4] = [
    (|of| of.over_limit, "not emitted, above `whitewater.max_particles`"),
    (|of| of.stuck, "removed between solids"),
    (|of| of.left_out, "particles of the liquid left out"),
    (|of| of.too_far_for_volume, "too far away for the volume"),
];

/// Figures for `info`: the particles of the last frame, and the maximum over all frames.
pub(super) fn info(folder: &ShotFolder) -> Result<ProductInfo, RunError> {
    let text = read_lines(&path(folder, WhitewaterPoints.name()))?;
    let lines = text.lines().filter_map(|line| serde_json::from_str::<FrameCounts>(line).ok());
    // A frame that was made again has several lines; the last one holds.
    let frames: BTreeMap<FrameIndex, FrameCounts> = lines.map(|line| (line.frame, line)).collect();
    let Some((_, last)) = frames.last_key_value() else { return Ok(ProductInfo::default()) };
    let counts = |of: &FrameCounts| [of.spray, of.foam, of.bubbles];
    // Counts may be crafted.
    let all = |of: &FrameCounts| counts(of).into_iter().fold(0_u64, u64::saturating_add);
    let maximum = frames.values().max_by_key(|of| all(of)).unwrap_or(last);
    let of_kinds = Kind::ALL.iter().zip(counts(last)).map(|(kind, count)| format!("{count} {}", kind.name()));
    let of_kinds = of_kinds.collect::<Vec<_>>().join(", ");
    let mut line = format!(
        "whitewater {} particles in frame {} ({of_kinds}); {} at most (frame {})",
        all(last),
        last.frame,
        all(maximum),
        maximum.frame
    );
    for (count, what) in LOSSES {
        let sum = frames.values().map(count).fold(0, u64::saturating_add);
        if sum > 0 {
            line += &format!("; {sum} {what} in {} frames", frames.len());
        }
    }
    let values = serde_json::to_value(frames.values().collect::<Vec<_>>()).expect("counts are plain data");
    Ok(ProductInfo { values: [("whitewater".to_owned(), values)].into_iter().collect(), lines: vec![line] })
}
