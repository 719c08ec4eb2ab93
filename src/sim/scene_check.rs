//! Checks of what a preset means as a whole, once every value is valid on its own.

use super::{
    force,
    registry::{ALL, mesh_files},
    scene::Scene,
};
use crate::preset::{
    check::Places,
    problem::Finding,
    shapes::{check_motion, shape_finding},
};

/// Everything about the scene that contradicts itself or cannot be simulated.
pub(crate) fn check(scene: &Scene, places: &Places) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, collider) in scene.world.collider.iter().enumerate() {
        let path = format!("world.collider.{index}.shape.{}", collider.shape.name());
        if let Err(error) = collider.shape.check() {
            findings.push(shape_finding(&path, error, places));
        }
        let path = format!("world.collider.{index}");
        check_motion(&collider.keyframes, &collider.shape, &path, places, &mut findings);
    }
    check_deforming(scene, places, &mut findings);
    if let Some(camera) = &scene.camera
        && camera.position == camera.target
    {
        let label = "found the same place twice, expected a direction to look in";
        let finding = Finding::new(
            places.of("camera.target"),
            "camera.target",
            "`camera.target` is `camera.position`",
            label,
        );
        findings.push(finding.with_help("name a point that is in the middle of the picture"));
    }
    let mut before = scene.frames.first().0;
    for (index, branch) in scene.branch.iter().enumerate() {
        let mut refuse = |key: &str, what: &str, label: String| {
            let path = format!("branch.{index}.{key}");
            let finding = Finding::new(places.of(&path), &path, what, label);
            findings.push(finding.with_help(
                "branch again with `meniscus simulate SHOT --from FRAME`, which writes this table",
            ));
        };
        if branch.frame <= before {
            let label = format!("found {}, expected a frame after {before}", branch.frame);
            refuse("frame", "branches follow each other after the shot's first frame", label);
        }
        if branch.key().is_none() {
            refuse("before", "this is no key of a simulation", "expected 16 hexadecimal digits".to_owned());
        }
        before = branch.frame;
    }
    for system in ALL {
        system.check(scene, places, &mut findings);
    }
    let feeling = ALL.iter().filter(|system| system.feels_forces());
    let feeling = feeling.map(|system| (system.name(), system.is_present(scene))).collect();
    let insensitive = ALL.iter().filter(|system| {
        !system.feels_forces() && system.preset_table().is_some() && system.is_present(scene)
    });
    let names =
        force::check::SystemNames { feeling, insensitive: insensitive.map(|system| system.name()).collect() };
    force::check::check(&scene.force, &names, places, &mut findings);
    if !ALL.iter().any(|system| system.is_present(scene)) {
        let tables: Vec<_> = ALL.iter().filter_map(|system| system.preset_table()).collect();
        let names: Vec<String> = tables.iter().map(|(table, _)| format!("no `{table}`")).collect();
        let examples: Vec<String> =
            tables.iter().map(|(table, content)| format!("a `{table}` table with {content}")).collect();
        let label = format!("{} in this preset", names.join(", "));
        let finding = Finding::new(places.of(""), "", "the preset names nothing to simulate", label);
        findings.push(finding.with_help(format!("add {}", examples.join(", or "))));
    }
    findings
}

/// Reports meshes that deform where they cannot, or in two ways.
fn check_deforming(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    for (key, file) in mesh_files(scene) {
        let is_cache = key.ends_with(".point_cache");
        if !key.starts_with("world.collider.") && (is_cache || file.contains('#')) {
            let message = format!("`{key}` deforms a shape that is no collider");
            let label = format!("found {file:?}, expected the file of a mesh that keeps its shape");
            let help = "only a `[[world.collider]]` deforms; name one .ply or .obj file here";
            findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
        }
        let mesh = key.strip_suffix(".point_cache").map(|mesh| format!("{mesh}.file"));
        if mesh.is_some_and(|mesh| {
            mesh_files(scene).iter().any(|(other, file)| *other == mesh && file.contains('#'))
        }) {
            let message = format!("`{key}` and a sequence of files both give the motion of one mesh");
            let label = "found both, expected one of them";
            let help = "remove `point_cache`, or name one file of the sequence as `file`";
            findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
        }
    }
}
