//! Checks of a preset's rigid bodies, once every value is valid on its own.

use crate::{
    preset::{check::Places, problem::Finding, shapes::source_finding},
    sim::scene::Scene,
};

/// Most bodies: each is compared with each other one in every substep.
const MAX_BODIES: usize = 1000;

/// Densities over that of the liquid between which bodies are simulated. Lighter ones leave the liquid at up to 40 m/s: the pressure of a few
/// particles then decides about a body of less than their mass (docs/decisions/049). The draft of a box would differ by less than 3 % of its height,
/// that of a ball by less than 10 % of its diameter.
const DENSITY_RATIOS: [f64; 2] = [0.03, 1e6];

/// Reports everything about the bodies that contradicts itself or cannot be simulated.
pub(super) fn check(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let mut report = |key: String, message: String, label: String, help: &str| {
        findings.push(Finding::new(places.of(&key), &key, message, label).with_help(help));
    };
    if scene.body.len() > MAX_BODIES {
        let label = format!("found {}, expected at most {MAX_BODIES}", scene.body.len());
        report("body".into(), "there are too many bodies".into(), label, "remove some");
    }
    if !scene.body.is_empty() {
        let help =
            "simulate them as two shots, or use a `[[world.collider]]` with keyframes in place of the body";
        if scene.smoke.is_some() {
            let message = "`[[body]]` and `smoke` do not act on each other".into();
            let label = "found both, and bodies would pass through the `smoke`".into();
            report("body".into(), message, label, help);
        }
        if !scene.sheet.is_empty() && scene.sheets.as_ref().is_some_and(|common| common.contact.is_some()) {
            let message = "contact of sheets with each other does not know rigid bodies yet".into();
            let label =
                "found `[[body]]` with `[sheets.contact]`: layers under a body would pass through each other"
                    .into();
            report(
                "sheets.contact".into(),
                message,
                label,
                "remove `[sheets.contact]`, or use a `[[world.collider]]` with keyframes in place of the body",
            );
        }
    }
    let mut more = Vec::new();
    for (index, body) in scene.body.iter().enumerate() {
        let path = format!("body.{index}");
        let unusable = source_finding(&path, &body.shape, places);
        more.extend(unusable.map(|finding| finding.with_help("a body needs a bounded shape with a volume")));
        let Some(liquid) = &scene.liquid else { continue };
        let ratio = f64::from(body.density) / f64::from(liquid.density);
        if !(DENSITY_RATIOS[0]..=DENSITY_RATIOS[1]).contains(&ratio) {
            report(
                format!("{path}.density"),
                format!("the density of `{path}` is {ratio:.1e} of the liquid's"),
                format!("expected {} to {:.0e} of it", DENSITY_RATIOS[0], DENSITY_RATIOS[1]),
                "give the density in kg/m³; a lighter box floats up to 3 % of its height higher than with 0.03; use a `[[world.collider]]` for what \
                 does not yield at all",
            );
        }
        if body.contact_angle.is_some() && liquid.surface_tension.is_none() {
            report(
                format!("{path}.contact_angle"),
                "`contact_angle` of a body needs a liquid with surface tension".into(),
                "found no `[liquid.surface_tension]`".into(),
                "add that table with a `coefficient`, \"0.072 N/m\" for water, or remove the angle",
            );
        }
    }
    findings.extend(more);
}
