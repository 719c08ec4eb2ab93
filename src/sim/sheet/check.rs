//! Checks of the parameters of sheets.

use super::{
    SheetError,
    params::{SheetMesh, SheetParams, SheetShape, SheetsParams},
};
use crate::math::Vec3;

/// Checks all parameters of sheets.
///
/// # Errors
/// The first key at fault.
pub fn check(params: &SheetsParams) -> Result<(), SheetError> {
    for (i, sheet) in params.sheet.iter().enumerate() {
        let key = |name: &str| format!("sheet.{i}.{name}");
        if params.sheet[..i].iter().any(|other| other.name.eq_ignore_ascii_case(&sheet.name)) {
            return Err(SheetError::Name { key: key("name"), name: sheet.name.clone() });
        }
        check_numbers(sheet, &key)?;
        check_shape(sheet, &key)?;
        for (k, region) in sheet.region.iter().enumerate() {
            let key = |name: &str| format!("sheet.{i}.region.{k}.{name}");
            not_negative(region.stiffness, key("stiffness"))?;
            not_negative(region.rest, key("rest"))?;
            not_negative(region.damping, key("damping"))?;
            positive(region.density, key("density"))?;
        }
        for (k, pin) in sheet.pin.iter().enumerate() {
            let key = |name: &str| format!("sheet.{i}.pin.{k}.{name}");
            pin.stiffness.map_or(Ok(()), |value| positive(value, key("stiffness")))?;
            finite(&pin.place.unwrap_or_default(), key("place"))?;
            for (n, at) in pin.keyframes.iter().enumerate() {
                let key = |name: &str| key(&format!("keyframes.{n}.{name}"));
                finite(&at.position, key("position"))?;
                finite(&at.rotation, key("rotation"))?;
                finite(&at.quaternion.unwrap_or_default(), key("quaternion"))?;
            }
        }
    }
    for (i, joint) in params.common.joint.iter().enumerate() {
        joint.stiffness.map_or(Ok(()), |value| positive(value, format!("sheets.joint.{i}.stiffness")))?;
        if let Some(direction) = joint.direction {
            finite(&direction, format!("sheets.joint.{i}.direction"))?;
            positive(Vec3::from(direction).norm(), format!("sheets.joint.{i}.direction"))?;
        }
    }
    if let Some(repulsion) = &params.common.repulsion {
        positive(repulsion.energy, "sheets.repulsion.energy".into())?;
        positive(repulsion.range, "sheets.repulsion.range".into())?;
    }
    not_negative(params.common.clearance.unwrap_or(0.0), "sheets.clearance".into())?;
    if let Some(contact) = &params.common.contact {
        positive(contact.thickness, "sheets.contact.thickness".into())?;
        not_negative(contact.friction.unwrap_or(0.0), "sheets.contact.friction".into())?;
    }
    let solver = &params.common.solver;
    positive(solver.tolerance, "sheets.solver.tolerance".into())?;
    positive(solver.courant, "sheets.solver.courant".into())?;
    positive(solver.substeps as f32, "sheets.solver.substeps".into())?;
    positive(solver.max_iterations as f32, "sheets.solver.max_iterations".into())?;
    if solver.courant > 0.95 {
        let expected = "beyond 0.95 of the stable substep nothing is left for rounding";
        return Err(SheetError::OutOfRange {
            key: "sheets.solver.courant".into(),
            value: solver.courant,
            expected,
        });
    }
    not_negative(params.common.friction.unwrap_or(0.0), "sheets.friction".into())
}

fn check_numbers(sheet: &SheetParams, key: &dyn Fn(&str) -> String) -> Result<(), SheetError> {
    positive(sheet.density, key("density"))?;
    let [a, b] = sheet.spring_damping.unwrap_or_default();
    let [y1, y2] = sheet.stiffness;
    let [r1, r2] = sheet.rest;
    for (name, value) in [
        ("stiffness", y1),
        ("stiffness", y2),
        ("rest", r1),
        ("rest", r2),
        ("shear", sheet.shear.unwrap_or(0.0)),
        ("bending", sheet.bending.unwrap_or(0.0)),
        ("damping", sheet.damping.unwrap_or(0.0)),
        ("spring_damping", a),
        ("spring_damping", b),
    ] {
        not_negative(value, key(name))?;
    }
    finite(&sheet.velocity, key("velocity"))
}

fn check_shape(sheet: &SheetParams, key: &dyn Fn(&str) -> String) -> Result<(), SheetError> {
    match &sheet.shape {
        SheetShape::Grid { origin, first, second, .. } => {
            for (name, side) in [("origin", origin), ("first", first), ("second", second)] {
                finite(side, key(&format!("shape.grid.{name}")))?;
            }
            let requested = sheet.shape.points();
            if requested > f64::from(1_u32 << 31) {
                return Err(SheetError::TooMany { requested });
            }
            let area = Vec3::from(*first).cross(&Vec3::from(*second)).norm();
            if area > 0.0 { Ok(()) } else { Err(SheetError::NoArea { key: key("shape.grid") }) }
        }
        SheetShape::Mesh(mesh) => {
            for point in &mesh.points {
                finite(point, key("shape.mesh"))?;
            }
            positive(Vec3::from(sheet.grain).norm(), key("grain"))?;
            let count = mesh.points.len() as u32;
            for (name, painted) in
                [("stiffness", &mesh.stiffness), ("rest", &mesh.rest), ("damping", &mesh.damping)]
            {
                let key = key(&format!("shape.mesh.{name}"));
                if !painted.is_empty() && painted.len() != count as usize {
                    let expected = "a painted factor for each is needed, or for none";
                    return Err(SheetError::Selection { key, found: painted.len(), expected });
                }
                painted.iter().try_for_each(|&value| not_negative(value, key.clone()))?;
            }
            if let Some(&point) = mesh.faces.as_flattened().iter().find(|&&i| i >= count) {
                return Err(SheetError::NoSuchPoint { key: key("shape.mesh"), point, count });
            }
            check_mesh(mesh, key("shape.mesh"))
        }
    }
}

/// Checks that every edge of a mesh has a length and every point a face. A mesh that was not read yet has
/// neither.
fn check_mesh(mesh: &SheetMesh, key: String) -> Result<(), SheetError> {
    let mut used = vec![false; mesh.points.len()];
    for &[a, b, c, d] in &mesh.faces {
        for (k, [from, to]) in [[a, b], [b, c], [c, d], [d, a]].into_iter().enumerate() {
            used[from as usize] = true;
            let is_last_of_three = c == d && k == 2;
            if !is_last_of_three && mesh.points[from as usize] == mesh.points[to as usize] {
                return Err(SheetError::Flat { key, point: from });
            }
        }
    }
    match used.iter().position(|&is_used| !is_used) {
        Some(point) => Err(SheetError::Loose { key, point: point as u32 }),
        None => Ok(()),
    }
}

fn finite(values: &[f32], key: String) -> Result<(), SheetError> {
    let wrong = values.iter().find(|value| !value.is_finite());
    wrong.map_or(Ok(()), |&value| Err(SheetError::OutOfRange { key, value, expected: "a finite number" }))
}

fn positive(value: f32, key: String) -> Result<(), SheetError> {
    let expected = "a finite number above zero";
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(SheetError::OutOfRange { key, value, expected })
    }
}

fn not_negative(value: f32, key: String) -> Result<(), SheetError> {
    let expected = "a finite number, zero or above";
    if value >= 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(SheetError::OutOfRange { key, value, expected })
    }
}
