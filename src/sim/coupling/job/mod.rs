//! The couplings as jobs see them.

pub(crate) mod check;
mod report;

use crate::{
    job::Total,
    preset::{check::Places, problem::Finding},
    sim::{
        FrameRecord,
        scene::Scene,
        system::{CachedFrame, System},
    },
};

/// The couplings, as jobs see them.
pub(crate) struct Couplings;

impl System for Couplings {
    fn name(&self) -> &'static str {
        "coupling"
    }

    fn is_present(&self, scene: &Scene) -> bool {
        !scene.coupling.is_empty() || !scene.body.is_empty() && !scene.sheet.is_empty()
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check_couplings(scene, places, findings);
    }

    fn progress(&self, record: &FrameRecord) -> Option<String> {
        record.coupling.as_ref().and_then(report::progress)
    }

    fn warnings(&self, record: &FrameRecord) -> Vec<String> {
        record.coupling.as_ref().map(report::warnings).unwrap_or_default()
    }

    fn totals(&self, frames: &[CachedFrame]) -> Vec<Total> {
        report::totals(frames)
    }
}
