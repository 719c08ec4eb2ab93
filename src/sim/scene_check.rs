//! Checks of what a preset means as a whole, once every value is valid on its own.

use super::{registry::ALL, scene::Scene};
use crate::{
    export::vdb::VolumeGrid,
    preset::{
        check::Places,
        problem::Finding,
        shapes::{check_motion, name, shape_finding},
    },
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
    check_output(scene, places, &mut findings);
    findings
}

/// Whether there is something that meshes and volumes can be made of: found out after hours of simulating, it is too late.
fn check_output(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let mut refuse = |key: &str, message: &str, label: &str, help: &str| {
        findings.push(Finding::new(places.of(key), key, message, label).with_help(help));
    };
    let output = &scene.output;
    if !output.sheet.is_empty() && scene.sheet.is_empty() {
        let label = "found files of sheets asked of a shot without `[[sheet]]`, expected none";
        refuse("output.sheet", "there are no sheets to write", label, "remove `sheet`, or add a `[[sheet]]`");
    }
    if scene.liquid.is_none() && !output.mesh.is_empty() {
        let (message, help) = match scene.smoke {
            Some(_) => (
                "smoke has no surface to mesh",
                "remove `mesh`, and write `volume = [\"density\", \"velocity\"]` in `[output]`",
            ),
            None => ("sheets are not meshed", "remove `mesh`, and write `sheet = [\"ply\"]` in `[output]`"),
        };
        let label = "found meshes asked of a shot without `[liquid]`, expected none";
        refuse("output.mesh", message, label, help);
    }
    let (known, system) = match (&scene.liquid, &scene.smoke) {
        (None, Some(_)) => (&VolumeGrid::SMOKE[..], "smoke"),
        (Some(_), None) => (&VolumeGrid::LIQUID[..], "a liquid"),
        (None, None) if !output.volume.is_empty() => {
            let label = "found volumes asked of a shot of sheets, expected none";
            let help = "remove `volume`, and write `sheet = [\"pc2\"]` in `[output]`";
            return refuse("output.volume", "sheets have no volume", label, help);
        }
        _ => return,
    };
    let asked = &scene.output.volume;
    if asked.iter().any(|grid| !known.contains(grid)) {
        let names = |grids: &[VolumeGrid]| {
            grids.iter().map(|grid| format!("`{}`", grid.name())).collect::<Vec<_>>().join(", ")
        };
        let label = format!("found {}, expected some of {}", names(asked), names(known));
        let message = format!("{system} has no such grid");
        refuse("output.volume", &message, &label, "name one of those, or leave `volume` out");
    }
}
