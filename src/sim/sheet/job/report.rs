//! What jobs report of the sheets: progress, warnings, totals.

use crate::{
    job::{Total, nonzero},
    sim::{
        force,
        sheet::{SheetRecord, SheetSeeds},
        system::CachedFrame,
    },
};
use serde_json::json;

/// What is wrong with the sheets as seeded.
pub(super) fn seeding_warnings(seeds: &SheetSeeds) -> Vec<String> {
    nonzero(&[
        (
            seeds.crossings,
            "edges of sheets go through faces of sheets: these faces collide only after they have separated; move the sheets apart",
        ),
        (
            seeds.inside_bodies,
            "points of sheets start inside rigid bodies, and are moved out at once, which stretches the sheets: move the bodies",
        ),
    ])
}

/// What a frame's progress line shows.
pub(super) fn progress(record: &SheetRecord) -> String {
    let iterations = match record.iterations {
        0 => String::new(),
        count => format!("  iterations {count}"),
    };
    format!("substeps {}{iterations}  strain at most {:.1}%", record.substeps, 100.0 * record.strain_max)
}

/// The limits that changed a frame.
pub(super) fn warnings(record: &SheetRecord) -> Vec<String> {
    let contact = record.contact.clone().unwrap_or_default();
    let limits = nonzero(&[
        (contact.crossings, "edges of sheets through faces of sheets"),
        (contact.unseparated, "pairs of sheets not certainly separated"),
        (record.unconverged.into(), "substeps of sheets stopped at max_iterations"),
        (record.overshot.into(), "substeps of sheets too long for one linearisation: springs gained energy"),
        (record.inside_solids, "points of sheets inside solids"),
        (record.cut_faces, "faces of sheets cut into solids (sheets.clearance or smaller cells)"),
        (record.folded, "springs of sheets without a direction"),
    ]);
    [limits, force::report::warnings(record.forces.as_ref(), "sheets.solver.max_substeps")].concat()
}

/// Work of forces over the logged frames.
pub(super) fn force_totals(frames: &[CachedFrame]) -> Option<Total> {
    let records = frames.iter().filter_map(|frame| frame.record.as_ref()?.sheets.as_ref()?.forces.as_ref());
    force::report::total("forces_on_sheets", records)
}

/// Extremes over the logged frames.
pub(super) fn totals(frames: &[CachedFrame]) -> Option<Total> {
    let records = || frames.iter().filter_map(|frame| frame.record.as_ref()?.sheets.as_ref());
    let count = records().count();
    let strain_max = records().map(|record| record.strain_max).fold(0.0, f64::max);
    let inside_solids = records().map(|record| record.inside_solids).max().unwrap_or(0);
    let cut_faces = records().map(|record| record.cut_faces).max().unwrap_or(0);
    (count > 0).then(|| Total {
        key: "sheets",
        value: json!({
            "frames": count,
            "strain_max": strain_max,
            "inside_solids": inside_solids,
            "cut_faces": cut_faces,
        }),
        heading: "sheets",
        text: format!(
            "strained by {:.1}%, {inside_solids} points inside solids and {cut_faces} faces cut into them at most, in {count} \
             frames",
            100.0 * strain_max
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::FrameRecord;

    #[test]
    fn totals_are_extremes_of_logged_frames() {
        let frame = |strain_max: f64, inside_solids: u64, cut_faces: u64| {
            let sheets = Some(SheetRecord { strain_max, inside_solids, cut_faces, ..SheetRecord::default() });
            CachedFrame {
                record: Some(FrameRecord { sheets, ..FrameRecord::default() }),
                ..CachedFrame::default()
            }
        };
        let total = totals(&[CachedFrame::default(), frame(0.5, 3, 1), frame(0.25, 2, 4)]).unwrap();
        let expected = json!({ "frames": 2, "strain_max": 0.5, "inside_solids": 3, "cut_faces": 4 });
        assert_eq!(total.value, expected);
        assert_eq!(totals(&[CachedFrame::default()]), None);
    }
}
