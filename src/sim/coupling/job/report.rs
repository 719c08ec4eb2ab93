//! Reports of couplings: progress, warnings, totals.

use crate::math::elementary::hypot;
use crate::{
    job::{Total, nonzero},
    sim::{
        coupling::{BodySheetRecord, CouplingRecord, LiquidSheetRecord, WindRecord},
        system::CachedFrame,
    },
};
use serde_json::json;

/// Depth of a sheet in a body over the inner radius above which a frame warns.
const MAX_DEPTH: f64 = 0.1;

/// Progress line of a frame.
pub(super) fn progress(record: &CouplingRecord) -> Option<String> {
    if let Some(BodySheetRecord { contacts, .. }) = &record.bodies {
        return Some(format!("contacts of sheets with bodies {contacts}"));
    }
    let LiquidSheetRecord { contacts, impulse: [x, y, z], .. } = record.liquid.as_ref()?;
    Some(format!("contacts {contacts}  impulse {:.3} N·s", hypot(hypot(*x, *y), *z)))
}

/// Limits that changed a frame.
pub(super) fn warnings(record: &CouplingRecord) -> Vec<String> {
    let liquid = record.liquid.clone().unwrap_or_default();
    let smoke = record.smoke.clone().unwrap_or_default();
    let mut found = nonzero(&[
        (liquid.crossed, "particles crossed a sheet"),
        (liquid.projected_back, "particles projected back to their side of a sheet"),
        (liquid.unconverged, "contact solves reached their iteration limit"),
        (smoke.limited, "drag forces on faces limited (substeps too long for the air)"),
    ]);
    let depth = record.bodies.as_ref().map_or(0.0, |bodies| bodies.penetration);
    found.extend((depth > MAX_DEPTH).then(|| {
        format!(
            "a point of a sheet was {:.0}% of the inner radius inside a rigid body (more substeps: sheets.solver.substeps or \
             courant)",
            100.0 * depth
        )
    }));
    found
}

/// Sums and extremes over the logged frames.
pub(super) fn totals(frames: &[CachedFrame]) -> Vec<Total> {
    let records = || frames.iter().filter_map(|frame| frame.record.as_ref()?.coupling.as_ref());
    let liquid: Vec<&LiquidSheetRecord> = records().filter_map(|record| record.liquid.as_ref()).collect();
    let smoke: Vec<&WindRecord> = records().filter_map(|record| record.smoke.as_ref()).collect();
    let bodies: Vec<&BodySheetRecord> = records().filter_map(|record| record.bodies.as_ref()).collect();
    let totals = [liquid_total(&liquid), smoke_total(&smoke), body_total(&bodies)];
    totals.into_iter().flatten().collect()
}

fn body_total(records: &[&BodySheetRecord]) -> Option<Total> {
    let count = records.len();
    let contacts = records.iter().map(|record| record.contacts).max()?;
    let penetration = records.iter().map(|record| record.penetration).fold(0.0, f64::max);
    let unconverged: u64 = records.iter().map(|record| record.unconverged).sum();
    Some(Total {
        key: "bodies_on_sheets",
        value: json!({ "frames": count, "contacts": contacts, "penetration": penetration, "unfinished": unconverged }),
        heading: "coupling",
        text: format!(
            "bodies: {contacts} points of sheets in contact at most, {:.1}% of the inner radius deep in them at most, {unconverged} \
             contact solves at their limit, in {count} frames",
            100.0 * penetration
        ),
    })
}

fn liquid_total(records: &[&LiquidSheetRecord]) -> Option<Total> {
    let count = records.len();
    let sum = |field: fn(&LiquidSheetRecord) -> u64| records.iter().map(|record| field(record)).sum::<u64>();
    let crossed = sum(|record| record.crossed);
    let projected_back = sum(|record| record.projected_back);
    let unconverged = sum(|record| record.unconverged);
    (count > 0).then(|| Total {
        key: "liquid_on_sheets",
        value: json!({ "frames": count, "crossed": crossed, "put_back": projected_back, "unfinished": unconverged }),
        heading: "coupling",
        text: format!(
            "liquid: {crossed} particles through sheets, {projected_back} projected back, {unconverged} contact solves at \
             their limit, in {count} frames"
        ),
    })
}

fn smoke_total(records: &[&WindRecord]) -> Option<Total> {
    let count = records.len();
    let max_speed = records.iter().map(|record| record.max_speed).fold(0.0, f64::max);
    let limited: u64 = records.iter().map(|record| record.limited).sum();
    (count > 0).then(|| Total {
        key: "smoke_on_sheets",
        value: json!({ "frames": count, "fastest": max_speed, "cut": limited }),
        heading: "coupling",
        text: format!(
            "smoke: {max_speed:.1} m/s of air at most, drag of faces limited {limited} times, in {count} frames"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::FrameRecord;

    #[test]
    fn totals_are_sums_and_extremes_of_logged_frames() {
        let frame = |crossed: u64, max_speed: f64, limited: u64| {
            let liquid = LiquidSheetRecord {
                crossed,
                projected_back: 2,
                unconverged: 3,
                ..LiquidSheetRecord::default()
            };
            let smoke = WindRecord { max_speed, limited, ..WindRecord::default() };
            let bodies = BodySheetRecord { contacts: 7, unconverged: limited, penetration: 0.1 * max_speed };
            let coupling =
                Some(CouplingRecord { liquid: Some(liquid), smoke: Some(smoke), bodies: Some(bodies) });
            CachedFrame {
                record: Some(FrameRecord { coupling, ..FrameRecord::default() }),
                ..CachedFrame::default()
            }
        };
        let found = totals(&[CachedFrame::default(), frame(4, 0.5, 1), frame(1, 0.25, 10)]);
        let values: Vec<_> = found.into_iter().map(|total| (total.key, total.value)).collect();
        let liquid = json!({ "frames": 2, "crossed": 5, "put_back": 4, "unfinished": 6 });
        let smoke = json!({ "frames": 2, "fastest": 0.5, "cut": 11 });
        let bodies = json!({ "frames": 2, "contacts": 7, "penetration": 0.05, "unfinished": 11 });
        assert_eq!(
            values,
            [("liquid_on_sheets", liquid), ("smoke_on_sheets", smoke), ("bodies_on_sheets", bodies)]
        );
        assert!(totals(&[CachedFrame::default()]).is_empty());
    }

    #[test]
    fn sheets_deep_in_bodies_are_warned_of() {
        let record = |penetration: f64| CouplingRecord {
            bodies: Some(BodySheetRecord { penetration, ..BodySheetRecord::default() }),
            ..CouplingRecord::default()
        };
        assert!(warnings(&record(0.09)).is_empty());
        assert!(warnings(&record(0.125))[0].contains("12% of the inner radius"));
    }
}
