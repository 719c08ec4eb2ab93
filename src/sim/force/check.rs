//! Checks of a preset's forces, once every value is valid on its own.

use super::{ForceKind, ForceParams};
use crate::{
    preset::{
        check::Places,
        problem::Finding,
        shapes::{check_motion, shape_finding},
    },
    solid::Shape,
};

/// Most forces of a preset: each is evaluated for every particle in every substep.
const MAX_FORCES: usize = 64;

/// Largest acceleration of a uniform force [m/s²]; the schema has the ranges of other strengths.
const MAX_ACCELERATION: f64 = 1e6;

/// Largest velocity of a drag [m/s].
const MAX_DRAG_SPEED: f64 = 1e5;

/// The systems of the tool, by name.
pub(crate) struct SystemNames {
    /// Those that feel forces, and whether the preset has them.
    pub(crate) feeling: Vec<(&'static str, bool)>,
    /// Those of the preset that do not.
    pub(crate) insensitive: Vec<&'static str>,
}

/// Reports everything about the forces that contradicts itself or cannot be simulated.
pub(crate) fn check(
    forces: &[ForceParams],
    SystemNames { feeling, insensitive }: &SystemNames,
    places: &Places,
    findings: &mut Vec<Finding>,
) {
    let mut report = |key: String, message: String, label: String, help: &str| {
        findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
    };
    if forces.len() > MAX_FORCES {
        let message = format!("the preset has {} forces", forces.len());
        let label = format!("expected at most {MAX_FORCES}");
        report("force".into(), message, label, "unite forces, or keyframe one instead of several");
    }
    for (index, force) in forces.iter().enumerate() {
        let path = format!("force.{index}");
        let inner = |key: &str| format!("{path}.kind.{}.{key}", force.kind.name());
        match &force.kind {
            ForceKind::Uniform { acceleration } => {
                if let Some((message, label)) = too_long(acceleration, MAX_ACCELERATION, "m/s²") {
                    report(inner("acceleration"), message, label, "lower it; gravity is 9.81 m/s²");
                }
            }
            ForceKind::Drag { velocity, .. } => {
                if let Some((message, label)) = too_long(velocity, MAX_DRAG_SPEED, "m/s") {
                    report(inner("velocity"), message, label, "lower it; sound in air has 340 m/s");
                }
            }
            ForceKind::Vortex { axis, .. } if axis.iter().all(|&c| c == 0.0) => {
                let message = format!("`{}` gives no direction", inner("axis"));
                report(inner("axis"), message, "a vector of length zero".into(), "give any other vector");
            }
            ForceKind::Turbulence { .. } if force.shape.is_some() && force.falloff.is_none() => {
                let message = format!("`{path}` is turbulence that ends abruptly at its shape");
                let help = "give a `falloff` of about `scale`: an abrupt end would have divergence";
                report(path.clone(), message, "found a `shape`, but no `falloff`".into(), help);
            }
            _ => {}
        }
        if force.falloff.is_some() && force.shape.is_none() {
            let key = format!("{path}.falloff");
            let message = format!("`falloff` of `{path}` needs a shape");
            report(key, message, "found no `shape`".into(), "give a `shape`, or remove the falloff");
        }
        for (number, pair) in force.strength_keyframes.windows(2).enumerate() {
            if pair[1].frame <= pair[0].frame {
                report(
                    format!("{path}.strength_keyframes.{}.frame", number + 1),
                    format!("the strength keyframes of `{path}` do not ascend"),
                    format!("found frame {} after frame {}", pair[1].frame, pair[0].frame),
                    "sort the keyframes by frame, and give each frame once",
                );
            }
        }
        for (number, name) in force.systems.iter().enumerate() {
            let key = format!("{path}.systems.{number}");
            let names: Vec<String> = feeling.iter().map(|(name, _)| format!("\"{name}\"")).collect();
            match feeling.iter().find(|(system, _)| system == name) {
                Some((_, true)) => {}
                Some(_) => report(
                    key,
                    format!("`{path}` acts on a system that the preset does not have"),
                    format!("found \"{name}\""),
                    "add the system, or remove it from the list",
                ),
                None => report(
                    key,
                    format!("no system of the name \"{name}\" feels forces"),
                    format!("expected {}", names.join(" or ")),
                    "docs/forces.md has what acts on what",
                ),
            }
        }
    }
    if !forces.is_empty() && !feeling.iter().any(|(_, is_present)| *is_present) {
        let names: Vec<&str> = feeling.iter().map(|(name, _)| *name).collect();
        let label = format!("found no {}", names.join(" and no "));
        let help = "add such a system, or remove the forces; docs/forces.md has what acts on smoke";
        report("force".into(), "forces act on nothing in this preset".into(), label, help);
    }
    let unnamed = forces.iter().position(|force| force.systems.is_empty());
    if let (Some(index), Some(system)) = (unnamed, insensitive.first())
        && feeling.iter().any(|(_, is_present)| *is_present)
    {
        let message = format!("`force.{index}` does not act on {system}, which the preset has");
        let help = "give `systems` those on which it acts; docs/forces.md has why not on all";
        report(format!("force.{index}"), message, "found no `systems`".into(), help);
    }
    check_shapes(forces, places, findings);
}

/// Reports shapes and motions that cannot be used.
fn check_shapes(forces: &[ForceParams], places: &Places, findings: &mut Vec<Finding>) {
    for (index, force) in forces.iter().enumerate() {
        let path = format!("force.{index}");
        if let Some(shape) = &force.shape
            && let Err(error) = shape.check()
        {
            findings.push(shape_finding(&format!("{path}.shape.{}", shape.name()), error, places));
        }
        // What acts everywhere may turn anyhow.
        let any = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
        check_motion(&force.keyframes, force.shape.as_ref().unwrap_or(&any), &path, places, findings);
    }
}

/// What is wrong with a vector longer than `limit`.
fn too_long(vector: &[f32; 3], limit: f64, unit: &str) -> Option<(String, String)> {
    let length = vector.iter().map(|&c| f64::from(c).powi(2)).sum::<f64>().sqrt();
    let found =
        || (format!("the vector is {length:.3e} {unit} long"), format!("expected at most {limit:e} {unit}"));
    (length > limit).then(found)
}
