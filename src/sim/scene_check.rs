//! Checks of what a preset means as a whole, once every value is valid on its own.

use super::{registry::ALL, scene::Scene};
use crate::preset::{
    check::Places,
    problem::Finding,
    shapes::{check_motion, name, shape_finding},
};

/// Everything about the scene that contradicts itself or cannot be simulated.
pub(crate) fn check(scene: &Scene, places: &Places) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, collider) in scene.world.collider.iter().enumerate() {
        let path = format!("world.collider.{index}.shape.{}", name(&collider.shape));
        if let Err(error) = collider.shape.check() {
            findings.push(shape_finding(&path, error, places));
        }
        let path = format!("world.collider.{index}");
        check_motion(&collider.keyframes, &collider.shape, &path, places, &mut findings);
    }
    for system in ALL {
        system.check(scene, places, &mut findings);
    }
    if !ALL.iter().any(|system| system.is_present(scene)) {
        findings.push(
            Finding::new(
                places.of(""),
                "liquid",
                "the preset names nothing to simulate",
                "no `[liquid]`, no `[smoke]` and no `[[sheet]]` in this preset",
            )
            .with_help(
                "add a `[liquid]` table with a `spacing` and at least one `[[liquid.source]]`, or a `[smoke]` table with a \
                 `spacing` and a `[[smoke.ring]]`, or a `[[sheet]]` with a `shape`",
            ),
        );
    }
    findings
}
