//! Checks of what a preset means, once every value is valid on its own.

use super::{
    Scene, check::Places, coupling::check_couplings, problem::Finding, sheet::check_sheets,
    smoke::check_smoke,
};
use crate::{
    export::vdb::VolumeGrid,
    sim::liquid::{LiquidChannel, LiquidParams, SourceShape},
    solid::{Keyframe, Shape, ShapeError},
};

/// Particles that the 32-bit neighbour lists can tell apart.
const MAX_PARTICLES: f64 = 2_147_483_648.0;

/// Everything about the scene that contradicts itself or cannot be simulated.
pub(super) fn check(scene: &Scene, places: &Places) -> Vec<Finding> {
    let mut findings = Vec::new();
    for (index, collider) in scene.world.collider.iter().enumerate() {
        let path = format!("world.collider.{index}.shape.{}", name(&collider.shape));
        if let Err(error) = collider.shape.check() {
            findings.push(shape_finding(&path, error, places));
        }
        let path = format!("world.collider.{index}");
        check_motion(&collider.keyframes, &collider.shape, &path, places, &mut findings);
    }
    if let Some(liquid) = &scene.liquid {
        check_liquid(liquid, places, &mut findings);
    }
    if let Some(smoke) = &scene.smoke {
        check_smoke(scene, smoke, places, &mut findings);
    }
    check_sheets(scene, places, &mut findings);
    check_couplings(scene, places, &mut findings);
    if scene.liquid.is_none() && scene.smoke.is_none() && scene.sheet.is_empty() {
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
    check_attributes(scene, places, &mut findings);
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

/// Whether the particles will have what the surface is to carry, as far as that is up to the preset.
fn check_attributes(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let Some(liquid) = &scene.liquid else { return };
    let wanted = |name: &str| scene.surface.attributes.iter().flatten().any(|attribute| attribute == name);
    let carries = |channel: &LiquidChannel| liquid.channels.contains(channel);
    let needed = LiquidChannel::ALL.into_iter().filter(|channel| carries(channel) || wanted(channel.name()));
    let needed: Vec<_> = needed.map(|channel| format!("\"{}\"", channel.name())).collect();
    for channel in LiquidChannel::ALL {
        let name = channel.name();
        if wanted(name) && !carries(&channel) {
            findings.push(
                Finding::new(
                    places.of("surface.attributes"),
                    "surface.attributes",
                    format!("the particles have no `{name}` to carry"),
                    format!("found `{name}`, which `liquid.channels` does not name"),
                )
                .with_help(format!(
                    "write `channels = [{}]` in `[liquid]`; a shot that is simulated already has to be simulated again",
                    needed.join(", ")
                )),
            );
        }
    }
}

/// Whether the keyframes ascend and turn in one way, and whether their shape can.
pub(super) fn check_motion(
    keys: &[Keyframe],
    shape: &Shape,
    path: &str,
    places: &Places,
    findings: &mut Vec<Finding>,
) {
    let mut report = |key: String, message: String, label: String, help: &str| {
        findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
    };
    for (index, pair) in keys.windows(2).enumerate() {
        if pair[1].frame <= pair[0].frame {
            report(
                format!("{path}.keyframes.{}.frame", index + 1),
                format!("the keyframes of `{path}` do not ascend"),
                format!("found frame {} after frame {}", pair[1].frame, pair[0].frame),
                "sort the keyframes by frame, and give each frame once",
            );
        }
    }
    let turned = |index: usize| format!("{path}.keyframes.{index}.quaternion");
    for (index, key) in keys.iter().enumerate() {
        match key.quaternion {
            Some(q) if !q.iter().map(|c| c * c).sum::<f32>().is_normal() => report(
                turned(index),
                format!("`{}` is no rotation", turned(index)),
                "a quaternion of length zero".to_owned(),
                "no rotation at all is [1, 0, 0, 0]",
            ),
            Some(_) if key.rotation != [0.0; 3] => report(
                turned(index),
                format!("keyframe {index} of `{path}` turns in two ways"),
                "a quaternion, but `rotation` is given too".to_owned(),
                "keep one of them",
            ),
            _ => {}
        }
        if key.quaternion.is_some() != keys[0].quaternion.is_some() {
            report(
                turned(index),
                format!("the keyframes of `{path}` turn in different ways"),
                "some keyframes have a quaternion and some have not".to_owned(),
                "give all of them a quaternion, or none",
            );
            break;
        }
    }
    let turns =
        keys.windows(2).position(|k| (k[0].rotation, k[0].quaternion) != (k[1].rotation, k[1].quaternion));
    if let (Shape::Plane { .. }, Some(index)) = (shape, turns) {
        report(
            format!("{path}.keyframes.{}", index + 1),
            format!("`{path}` is a plane and cannot turn"),
            "its rotation changes here, and far from its origin it would be infinitely fast".to_owned(),
            "use a box with its face where the plane is",
        );
    }
}

fn check_liquid(liquid: &LiquidParams, places: &Places, findings: &mut Vec<Finding>) {
    if liquid.iterations.is_some() && liquid.density_dev.is_some() {
        findings.push(
            Finding::new(
                places.of("liquid.iterations"),
                "liquid.iterations",
                "`liquid.iterations` and `liquid.density_dev` exclude each other",
                "a fixed number of iterations, but `density_dev` is given too",
            )
            .with_help("remove one of them; on the command line, `--set liquid.density_dev=none` does it"),
        );
    }
    if liquid.min_substeps > liquid.max_substeps {
        let (least, most) = (liquid.min_substeps, liquid.max_substeps);
        // The later of the two keys is the one that broke the order.
        let key = ["liquid.min_substeps", "liquid.max_substeps"].into_iter().max_by_key(|key| places.of(key));
        let key = key.unwrap_or("liquid.min_substeps");
        findings.push(
            Finding::new(
                places.of(key),
                key,
                format!("`min_substeps` ({least}) is above `max_substeps` ({most})"),
                format!("found {least} to {most} substeps a frame, expected the smaller number first"),
            )
            .with_help("raise `max_substeps` or lower `min_substeps`; both have defaults"),
        );
    }
    if liquid.source.is_empty() {
        findings.push(
            Finding::new(
                places.of("liquid.source"),
                "liquid.source",
                "the liquid has no source, so there is nothing to simulate",
                "expected at least one `[[liquid.source]]`",
            )
            .with_help(
                "add `[[liquid.source]]` with `shape = { box = { min = [0, 0, 0], max = [1, 1, 1] } }`",
            ),
        );
    }
    for (index, source) in liquid.source.iter().enumerate() {
        let (path, shape) = match source.shape.clone() {
            SourceShape::Box { min, max } => ("box", Shape::Box { min, max }),
            SourceShape::Sphere { center, radius } => ("sphere", Shape::Sphere { center, radius }),
            SourceShape::Mesh(mesh) => ("mesh", Shape::Mesh(mesh)),
        };
        if let Err(error) = shape.check() {
            findings.push(shape_finding(&format!("liquid.source.{index}.shape.{path}"), error, places));
        }
    }
    check_particle_count(liquid, places, findings);
}

fn check_particle_count(liquid: &LiquidParams, places: &Places, findings: &mut Vec<Finding>) {
    let count = particle_estimate(liquid);
    if count > MAX_PARTICLES {
        let volume = count * f64::from(liquid.spacing).powi(3);
        let key = "liquid.spacing";
        let needed = (volume / MAX_PARTICLES).cbrt();
        findings.push(
            Finding::new(
                places.of(key),
                key,
                format!("the sources hold about {count:.3e} particles, more than the {MAX_PARTICLES} that can be told apart"),
                format!("found {} m between particles, for {volume:.3} m³ of liquid", liquid.spacing),
            )
            .with_help(format!("make `liquid.spacing` larger than {needed:.2e} m, or the sources smaller")),
        );
    }
}

/// The sources' volume in particles; sources that overlap count twice, meshes, whose volume is in their file, not
/// at all.
pub(super) fn particle_estimate(liquid: &LiquidParams) -> f64 {
    let volume: f64 = liquid.source.iter().map(|source| volume(&source.shape)).sum();
    volume / f64::from(liquid.spacing).powi(3)
}

/// The volume of a source [m³]; not above zero if it is turned inside out.
fn volume(shape: &SourceShape) -> f64 {
    match shape {
        SourceShape::Box { min, max } => {
            (0..3).map(|axis| (f64::from(max[axis]) - f64::from(min[axis])).max(0.0)).product()
        }
        SourceShape::Sphere { radius, .. } => 4.0 / 3.0 * std::f64::consts::PI * f64::from(*radius).powi(3),
        SourceShape::Mesh(_) => 0.0,
    }
}

pub(super) fn name(shape: &Shape) -> &'static str {
    match shape {
        Shape::Plane { .. } => "plane",
        Shape::Box { .. } => "box",
        Shape::Sphere { .. } => "sphere",
        Shape::Capsule { .. } => "capsule",
        Shape::Tank { .. } => "tank",
        Shape::Torus { .. } => "torus",
        Shape::Ellipsoid { .. } => "ellipsoid",
        Shape::Mesh(_) => "mesh",
    }
}

pub(super) fn shape_finding(path: &str, error: ShapeError, places: &Places) -> Finding {
    let key = format!("{path}.{}", error.field());
    let help = match error {
        ShapeError::Inverted { .. } => "`min` is the lower corner, `max` the upper one, on every axis",
        ShapeError::NoDirection => {
            "give any other vector; it points out of the solid, to where the liquid may be"
        }
        ShapeError::NoRadius => "give a radius above zero",
        ShapeError::OutOfRange { .. } => {
            "radii are above zero, the tube is thinner than the ring is wide, an axis has a direction"
        }
        ShapeError::NoScale => "give a factor above zero; 1 takes the file's unit for metres",
        ShapeError::NotFinite { .. } => "give a finite number",
    };
    Finding::new(places.of(&key), &key, format!("`{path}` is not a shape: {error}"), error.to_string())
        .with_help(help)
}
