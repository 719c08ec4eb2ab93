//! What jobs report of the forces on a system.

use super::ForceRecord;
use crate::job::{Total, nonzero};
use serde_json::json;

/// The limit that changed a frame, as a warning.
pub(crate) fn warnings(record: Option<&ForceRecord>) -> Vec<String> {
    let limited = record.map_or(0, |record| record.limited);
    nonzero(&[(limited, "accelerations by forces limited (weaker forces, or more max_substeps)")])
}

/// Sums and extremes over the logged frames; `None` without forces.
pub(crate) fn total<'a>(
    key: &'static str,
    records: impl Iterator<Item = &'a ForceRecord>,
) -> Option<Total> {
    let (mut frames, mut sum) = (0_u32, ForceRecord::default());
    for record in records {
        frames += 1;
        sum.work += record.work;
        sum.max_acceleration = sum.max_acceleration.max(record.max_acceleration);
        sum.limited += record.limited;
    }
    let ForceRecord { work, max_acceleration, limited } = sum;
    (frames > 0).then(|| Total {
        key,
        value: json!({
            "frames": frames,
            "work": work,
            "max_acceleration": max_acceleration,
            "limited": limited,
        }),
        heading: "forces",
        text: format!(
            "work {work:.4e} J, {max_acceleration:.3e} m/s² at most, {limited} accelerations limited, in {frames} frames"
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn totals_are_sums_and_extremes_of_logged_frames() {
        let frames = [(2.0, 5.0, 0), (-3.0, 9.0, 4)]
            .map(|(work, max_acceleration, limited)| ForceRecord { work, max_acceleration, limited });
        let total = total("forces_on_planted", frames.iter()).unwrap();
        let expected = json!({ "frames": 2, "work": -1.0, "max_acceleration": 9.0, "limited": 4 });
        assert_eq!(total.value, expected);
        assert_eq!(super::total("forces_on_planted", [].iter()), None);
        assert!(warnings(Some(&frames[0])).is_empty() && warnings(None).is_empty());
        assert_eq!(
            warnings(Some(&frames[1])),
            ["4 accelerations by forces limited (weaker forces, or more max_substeps)"]
        );
    }
}
