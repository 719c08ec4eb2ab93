//! Checks of what a preset says about sheets, once every value is valid on its own.

use super::{
    Scene,
    check::Places,
    meaning::{check_motion, name, shape_finding},
    problem::Finding,
};
use crate::{
    sim::sheet::{self, Select, SheetError, SheetParams, SheetShape},
    solid::Shape,
};

/// Everything about the sheets that contradicts itself or cannot be simulated.
pub(super) fn check_sheets(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    for (index, sheet) in scene.sheet.iter().enumerate() {
        let path = format!("sheet.{index}");
        check_name(&sheet.name, &format!("{path}.name"), places, findings);
        for (key, shape) in shapes(sheet) {
            if let Err(error) = shape.check() {
                findings.push(shape_finding(&format!("{path}.{key}.{}", name(shape)), error, places));
            }
        }
        for (number, pin) in sheet.pin.iter().enumerate() {
            let path = format!("{path}.pin.{number}");
            // What a pin holds has no shape of its own: it may go and turn anyhow.
            let any = Shape::Sphere { center: [0.0; 3], radius: 1.0 };
            check_motion(&pin.keyframes, &any, &path, places, findings);
            if pin.collider.is_some() && !pin.keyframes.is_empty() {
                let key = format!("{path}.collider");
                let message = format!("`{path}` moves in two ways");
                let finding =
                    Finding::new(places.of(&key), &key, message, "a collider, but keyframes are given too");
                findings.push(finding.with_help("keep one of them"));
            }
        }
    }
    if scene.sheets.is_some() && scene.sheet.is_empty() {
        let message = "there are no sheets that could have anything in common";
        let finding = Finding::new(places.of("sheets"), "sheets", message, "no `[[sheet]]` in this preset");
        findings.push(finding.with_help("add a `[[sheet]]`, or take `[sheets]` out"));
    }
    // Meshes are in files, which are read later.
    let drawn = |sheet: &SheetParams| matches!(sheet.shape, SheetShape::Grid { .. });
    if scene.sheet.iter().all(drawn)
        && let Some(shot) = scene.systems().sheets
        && let Err(error) = sheet::check(&shot.params)
    {
        findings.push(finding(&error, places));
    }
}

/// The shapes that a sheet names, with their keys.
pub(super) fn shapes(sheet: &SheetParams) -> impl Iterator<Item = (String, &Shape)> {
    let regions =
        sheet.region.iter().enumerate().map(|(i, region)| (format!("region.{i}.shape"), &region.shape));
    let pins = sheet.pin.iter().enumerate().filter_map(|(i, pin)| match &pin.at {
        Select::Inside(shape) => Some((format!("pin.{i}.at.inside"), shape)),
        _ => None,
    });
    regions.chain(pins)
}

/// Names become those of files and streams.
fn check_name(name: &str, key: &str, places: &Places, findings: &mut Vec<Finding>) {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
    if name.is_empty() || !name.chars().all(plain) {
        let message = format!("`{name}` cannot be the name of a file");
        let finding = Finding::new(places.of(key), key, message, format!("found {name:?}"));
        findings.push(finding.with_help("use letters of the alphabet, digits, `-` and `_`"));
    }
}

fn finding(error: &SheetError, places: &Places) -> Finding {
    let (key, help) = match error {
        SheetError::OutOfRange { key, .. } => (key.as_str(), "docs/parameters.md has the ranges"),
        SheetError::NoArea { key } => (key.as_str(), "give sides of two directions, each with a length"),
        SheetError::NoSuchPoint { key, .. } | SheetError::Selection { key, .. } => {
            (key.as_str(), "points count from 0; a grid has them row by row along `first`")
        }
        SheetError::Name { key, .. } => {
            (key.as_str(), "give every sheet a name of its own, and use these names")
        }
        SheetError::TooMany { .. } => ("sheet", "lower `cells`"),
        SheetError::Missing { .. } => ("sheet", "simulate the shot again"),
    };
    Finding::new(places.of(key), key, error.to_string(), "found here").with_help(help)
}
