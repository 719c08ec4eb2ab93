//! Checks of a preset's sheets, once every value is valid on its own.

use crate::{
    preset::{
        check::Places,
        problem::Finding,
        shapes::{check_motion, shape_finding},
    },
    sim::{
        scene::Scene,
        sheet::{self, SheetError, SheetParams},
    },
    solid::{Collider, Shape},
};

/// Everything about the sheets that contradicts itself or cannot be simulated.
pub(super) fn check_sheets(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    for (index, sheet) in scene.sheet.iter().enumerate() {
        let path = format!("sheet.{index}");
        check_name(&sheet.name, &format!("{path}.name"), places, findings);
        for (number, pin) in sheet.pin.iter().enumerate() {
            let path = format!("{path}.pin.{number}");
            // What a pin holds has no shape of its own: it may go and turn anyhow.
            let any = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
            check_motion(&pin.keyframes, &any, &path, places, findings);
            let held = pin.collider.and_then(|number| scene.world.collider.get(number as usize));
            if held.is_some_and(Collider::is_deforming) {
                let key = format!("{path}.collider");
                let message = format!("`{key}` follows a collider that deforms");
                let label = "found a mesh whose vertices move, or `scale` in keyframes: the pinned points would not follow it";
                findings.push(Finding::new(places.of(&key), &key, message, label).with_help(
                    "pin them with `keyframes` of their own, or to a collider that keeps its form",
                ));
            }
            if pin.collider.is_some() && !pin.keyframes.is_empty() {
                let key = format!("{path}.collider");
                let message = format!("`{path}` moves in two ways");
                let finding =
                    Finding::new(places.of(&key), &key, message, "a collider, but keyframes are given too");
                findings.push(finding.with_help("keep one of them"));
            }
        }
    }
    for (key, shape) in shapes(scene) {
        if let Err(error) = shape.check() {
            findings.push(shape_finding(&format!("{key}.{}", shape.name()), error, places));
        }
    }
    if scene.sheets.is_some() && scene.sheet.is_empty() {
        let message = "there are no sheets that could have anything in common";
        let finding = Finding::new(places.of("sheets"), "sheets", message, "no `[[sheet]]` in this preset");
        findings.push(finding.with_help("add a `[[sheet]]`, or take `[sheets]` out"));
    }
    if let Some(shot) = scene.systems().sheets
        && let Err(error) = sheet::check(&shot.params)
    {
        findings.push(finding(&error, places));
    }
}

/// The shapes that sheets and their joints name, with their keys.
pub(super) fn shapes(scene: &Scene) -> impl Iterator<Item = (String, &Shape)> {
    let sheets = scene.sheet.iter().enumerate();
    let sheets = sheets
        .flat_map(|(i, sheet)| of_sheet(sheet).map(move |(key, shape)| (format!("sheet.{i}.{key}"), shape)));
    let joints = scene.sheets.iter().flat_map(|common| common.joint.iter().enumerate());
    let joints = joints.flat_map(|(i, joint)| {
        let named = joint.at.iter().enumerate().filter_map(|(side, at)| Some((side, at.shape()?)));
        named.map(move |(side, shape)| (format!("sheets.joint.{i}.at.{side}.inside"), shape))
    });
    sheets.chain(joints)
}

fn of_sheet(sheet: &SheetParams) -> impl Iterator<Item = (String, &Shape)> {
    let regions =
        sheet.region.iter().enumerate().map(|(i, region)| (format!("region.{i}.shape"), &region.shape));
    let pins = sheet.pin.iter().enumerate();
    regions.chain(pins.filter_map(|(i, pin)| Some((format!("pin.{i}.at.inside"), pin.at.shape()?))))
}

/// The longest name of a sheet: Blender's names have 63 bytes.
const MAX_NAME: usize = 63;

/// Names become those of files and streams.
fn check_name(name: &str, key: &str, places: &Places, findings: &mut Vec<Finding>) {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    // Files of frames end in the frame's number.
    let digits = name.rsplit('_').next().filter(|end| end.len() < name.len() && end.len() > 3);
    let is_frame = digits.is_some_and(|end| end.chars().all(|c| c.is_ascii_digit()));
    if !(1..=MAX_NAME).contains(&name.len()) || is_frame || !name.chars().all(plain) {
        let message = format!("`{name}` cannot be the name of a file");
        let finding = Finding::new(places.of(key), key, message, format!("found {name:?}"));
        findings.push(finding.with_help(
            "use 1 to 63 letters of the alphabet, digits, `-` and `_`, and no frame's number at the end",
        ));
    }
}

fn finding(error: &SheetError, places: &Places) -> Finding {
    let (key, help) = match error {
        SheetError::OutOfRange { key, .. } => (key.as_str(), "docs/parameters.md has the ranges"),
        SheetError::NoArea { key } => (key.as_str(), "give sides of two directions, each with a length"),
        SheetError::Flat { key, .. } | SheetError::Loose { key, .. } => {
            (key.as_str(), "clean the mesh up where it was made")
        }
        SheetError::NoSuchPoint { key, .. } | SheetError::Selection { key, .. } => {
            (key.as_str(), "points count from 0; a grid has them row by row along `first`")
        }
        SheetError::Apart { key, .. } => (key.as_str(), "`stiffness` in N/m, or other points in `at`"),
        SheetError::Name { key, .. } => {
            (key.as_str(), "give every sheet a name of its own, and use these names")
        }
        SheetError::TooMany { .. } => ("sheet", "lower `cells`"),
        SheetError::Missing { .. } => ("sheet", "simulate the shot again"),
    };
    Finding::new(places.of(key), key, error.to_string(), "found here").with_help(help)
}
