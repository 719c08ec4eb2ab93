//! Checks of shapes and their motion, for every table of a preset that has some.

use super::{check::Places, problem::Finding};
use crate::solid::{Keyframe, Shape, ShapeError};

/// Whether the keyframes ascend and turn in one way, and whether their shape can.
pub(crate) fn check_motion(
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
                format!("the keyframes of `{path}` have different kinds of rotation"),
                "some keyframes have a quaternion and some have not".to_owned(),
                "give all of them a quaternion, or none",
            );
            break;
        }
    }
    let is_collider =
        path.starts_with("world.collider.") && !matches!(shape, Shape::Plane { .. } | Shape::Tank { .. });
    if let Some(index) = keys.iter().position(|key| key.scale != 1.0).filter(|_| !is_collider) {
        report(
            format!("{path}.keyframes.{index}.scale"),
            format!("`{path}` keeps its size"),
            format!("found {}; bounded shapes of `[[world.collider]]` alone change it", keys[index].scale),
            "leave `scale` out",
        );
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

/// What is wrong with the shape of the source or emitter at `path`: it is no shape, or it is unbounded.
pub(crate) fn source_finding(path: &str, shape: &Shape, places: &Places) -> Option<Finding> {
    let key = format!("{path}.shape.{}", shape.name());
    if let Err(error) = shape.check() {
        return Some(shape_finding(&key, error, places));
    }
    matches!(shape, Shape::Plane { .. } | Shape::Tank { .. }).then(|| {
        let message = format!("`{path}` cannot be filled: a {} is unbounded", shape.name());
        let label = format!("found a {}, expected a bounded shape", shape.name());
        Finding::new(places.of(&key), &key, message, label)
            .with_help("use `box`, `sphere`, `capsule`, `torus`, `ellipsoid`, `disc` or `mesh`")
    })
}

/// The diagnostic for a shape that is not one.
pub(crate) fn shape_finding(path: &str, error: ShapeError, places: &Places) -> Finding {
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
