//! The warning that energy was removed from a liquid.

use super::capped::why_capped;
use crate::{
    frame::FrameIndex,
    sim::{
        FrameRecord,
        liquid::{LiquidParams, LiquidRecord},
    },
};

/// Part of the substeps whose velocities may be held to the energy bound without a warning [1]: single impacts need it, and a film that the
/// solver shakes is held in all of them.
const MAX_HELD: f64 = 0.1;

/// Whether more than [`MAX_HELD`] of the substeps of `records` were held to the energy bound.
pub(super) fn is_held<'a>(records: impl IntoIterator<Item = &'a LiquidRecord>) -> bool {
    let [held, substeps] = count(records);
    held as f64 > MAX_HELD * substeps as f64
}

/// Warns of a shot that [`is_held`], and names what gives the solver less to correct.
pub(super) fn warning(liquid: &LiquidParams, frames: &[(FrameIndex, FrameRecord)]) -> Option<String> {
    let records = || frames.iter().filter_map(|(_, record)| record.liquid.as_ref());
    let [held, substeps] = count(records());
    let remedy = || {
        why_capped(liquid, records())
            .unwrap_or_else(|| format!("raise liquid.min_substeps ({})", liquid.min_substeps))
    };
    is_held(records()).then(|| {
        format!(
            "in {held} of {substeps} substeps energy that the solver had added was taken from the velocities: the liquid is slower than it \
             should be; {}",
            remedy()
        )
    })
}

/// Substeps that were held to the energy bound, and all.
fn count<'a>(records: impl IntoIterator<Item = &'a LiquidRecord>) -> [u64; 2] {
    records.into_iter().fold([0, 0], |[held, substeps], record| {
        [held + record.clamps.energy, substeps + u64::from(record.substeps)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shot_warns_that_is_held_in_more_than_a_tenth_of_its_substeps() {
        let frames = |held: &[u64]| -> Vec<(FrameIndex, FrameRecord)> {
            let frame = |(index, &energy): (u32, &u64)| {
                let mut liquid = LiquidRecord { substeps: 10, ..LiquidRecord::default() };
                liquid.clamps.energy = energy;
                (FrameIndex(index), FrameRecord { liquid: Some(liquid), ..FrameRecord::default() })
            };
            (2..).zip(held).map(frame).collect()
        };
        let liquid = LiquidParams::new(0.1);
        for few in [&[0, 0, 0][..], &[3, 0, 0], &[]] {
            assert_eq!(warning(&liquid, &frames(few)), None);
        }
        let text = warning(&liquid, &frames(&[3, 1, 0])).expect("4 of 30 are more than a tenth");
        assert!(text.starts_with("in 4 of 30 substeps") && text.contains("min_substeps (8)"), "{text}");
        let mut capped = frames(&[3, 1, 0]);
        capped[0].1.liquid.as_mut().expect("it has a liquid").cfl_capped = 1;
        let text = warning(&liquid, &capped).expect("4 of 30 are more than a tenth");
        assert!(text.contains("max_substeps (100)") && !text.contains("min_substeps"), "{text}");
        assert_eq!(warning(&liquid, &[(FrameIndex(2), FrameRecord::default())]), None);
    }
}
