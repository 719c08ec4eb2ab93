//! What jobs report of the forces on a system.

use super::ForceRecord;
use crate::job::{Total, nonzero};
use serde_json::json;

/// The limit that changed a frame, as a warning that names the strongest force there and the `parameter` of most substeps.
pub(crate) fn warnings(record: Option<&ForceRecord>, parameter: &str) -> Vec<String> {
    let Some(&ForceRecord { limited, strongest: Some(index), .. }) = record else { return Vec::new() };
    let what =
        format!("accelerations by forces limited, most by force.{index} (reduce it, or raise {parameter})");
    nonzero(&[(limited, &what)])
}

/// Sums and extremes over the logged frames; `None` without forces.
pub(crate) fn total<'a>(key: &'static str, records: impl Iterator<Item = &'a ForceRecord>) -> Option<Total> {
    let (mut frames, mut sum) = (0_u32, ForceRecord::default());
    for record in records {
        frames += 1;
        sum.unite(record);
    }
    let ForceRecord { work, max_acceleration, limited, strongest, .. } = sum;
    (frames > 0).then(|| Total {
        key,
        value: json!({
            "frames": frames,
            "work": work,
            "max_acceleration": max_acceleration,
            "limited": limited,
            "strongest": strongest,
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
        let frames = [(2.0, 5.0, 0, None), (-3.0, 9.0, 4, Some(2))].map(
            |(work, max_acceleration, limited, strongest)| ForceRecord {
                work,
                max_acceleration,
                limited,
                strongest,
                ..ForceRecord::default()
            },
        );
        let total = total("forces_on_planted", frames.iter()).unwrap();
        let expected =
            json!({ "frames": 2, "work": -1.0, "max_acceleration": 9.0, "limited": 4, "strongest": 2 });
        assert_eq!(total.value, expected);
        assert_eq!(super::total("forces_on_planted", [].iter()), None);
        let warnings = |record| super::warnings(record, "planted.max_substeps");
        assert!(warnings(Some(&frames[0])).is_empty() && warnings(None).is_empty());
        assert_eq!(
            warnings(Some(&frames[1])),
            ["4 accelerations by forces limited, most by force.2 (reduce it, or raise planted.max_substeps)"]
        );
    }
}
