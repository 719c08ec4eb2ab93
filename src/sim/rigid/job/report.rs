//! What jobs report of the rigid bodies: progress, warnings, totals.

use crate::{
    job::{Total, nonzero},
    sim::{
        force,
        rigid::{BodyRecord, BodySeeds},
        system::CachedFrame,
    },
};
use serde_json::json;

/// Depth over the inner radius of a body above which a frame warns.
const MAX_DEPTH: f64 = 0.05;

/// What is wrong with the bodies at the start.
pub(super) fn seeding_warnings(seeds: &BodySeeds) -> Vec<String> {
    nonzero(&[(
        seeds.overlapping,
        "bodies start inside a collider or another body, and are pushed apart: move them (body.position)",
    )])
}

/// What a frame's progress line shows.
pub(super) fn progress(record: &BodyRecord) -> String {
    let BodyRecord { bodies, max_speed, contacts, .. } = record;
    format!("bodies {bodies}, at most {max_speed:.2} m/s, {contacts} contacts")
}

/// What changed a frame, in which the bodies share the substeps of a liquid or not.
pub(super) fn warnings(record: &BodyRecord, has_liquid: bool) -> Vec<String> {
    let shorter = if has_liquid { " (more substeps: liquid.cfl, liquid.min_substeps)" } else { "" };
    let depth = format!(
        "a body is {:.0}% of the inner radius inside a collider or another body{shorter}",
        100.0 * record.penetration
    );
    let mut found = nonzero(&[(
        u64::from(record.capped),
        "substeps of rigid bodies longer than their speed allows (2000 a frame at most): bodies are thinner than they move in one",
    )]);
    found.extend((record.penetration > MAX_DEPTH).then_some(depth));
    found.extend(force::report::warnings(record.forces.as_ref(), "the substeps of the liquid or sheets"));
    found
}

/// Work of forces over the logged frames.
pub(super) fn force_totals(frames: &[CachedFrame]) -> Option<Total> {
    let records = frames.iter().filter_map(|frame| frame.record.as_ref()?.bodies.as_ref()?.forces.as_ref());
    force::report::total("forces_on_bodies", records)
}

/// Extremes over the logged frames.
pub(super) fn totals(frames: &[CachedFrame]) -> Option<Total> {
    let records = || frames.iter().filter_map(|frame| frame.record.as_ref()?.bodies.as_ref());
    let (count, bodies) = (records().count(), records().map(|record| record.bodies).max()?);
    let speed = records().map(|record| record.max_speed).fold(0.0, f64::max);
    let penetration = records().map(|record| record.penetration).fold(0.0, f64::max);
    Some(Total {
        key: "bodies",
        value: json!({ "frames": count, "bodies": bodies, "max_speed": speed, "penetration": penetration }),
        heading: "bodies",
        text: format!(
            "{bodies}, at most {speed:.2} m/s, {:.1}% of the inner radius deep in others at most, in {count} frames",
            100.0 * penetration
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::FrameRecord;

    #[test]
    fn deep_bodies_are_warned_of_and_counted() {
        let record = |penetration: f64| BodyRecord { bodies: 2, penetration, ..BodyRecord::default() };
        assert!(warnings(&record(0.04), true).is_empty());
        assert!(warnings(&record(0.06), true)[0].contains("6% of the inner radius"));
        assert!(!warnings(&record(0.06), false)[0].contains("liquid"));
        let capped = BodyRecord { capped: 3, ..BodyRecord::default() };
        assert!(warnings(&capped, false)[0].contains("3 substeps"));
        let frame = |penetration: f64| CachedFrame {
            record: Some(FrameRecord { bodies: Some(record(penetration)), ..FrameRecord::default() }),
            ..CachedFrame::default()
        };
        let total = totals(&[CachedFrame::default(), frame(0.5), frame(0.25)]).expect("there are records");
        assert_eq!(total.value, json!({ "frames": 2, "bodies": 2, "max_speed": 0.0, "penetration": 0.5 }));
        assert_eq!(totals(&[CachedFrame::default()]), None);
    }
}
