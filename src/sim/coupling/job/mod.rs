//! What jobs need to know of the couplings.

pub(crate) mod check;

use crate::{
    preset::{check::Places, problem::Finding},
    sim::{scene::Scene, system::System},
};

/// The couplings, as jobs see them.
pub(crate) struct Couplings;

impl System for Couplings {
    fn is_present(&self, scene: &Scene) -> bool {
        !scene.coupling.is_empty()
    }

    fn check(&self, scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
        check::check_couplings(scene, places, findings);
    }
}
