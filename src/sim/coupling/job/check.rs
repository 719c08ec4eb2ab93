//! Checks of the couplings in a preset, once every value is valid on its own.

use crate::{
    preset::{
        check::{Places, nearest},
        problem::Finding,
    },
    sim::{
        coupling::{self, CouplingError, PresentSystems},
        liquid,
        scene::Scene,
        smoke,
    },
};

/// Reports invalid couplings.
pub(super) fn check_couplings(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let present = PresentSystems {
        liquid: scene.liquid.is_some(),
        smoke: scene.smoke.is_some(),
        sheets: scene.sheet.iter().map(|sheet| sheet.name.as_str()).collect(),
    };
    let resolved = coupling::resolve(&scene.coupling, &present);
    if resolved.as_ref().is_ok_and(|resolved| !resolved.liquid.is_empty()) {
        let sources = scene.liquid.iter().flat_map(|liquid| &liquid.source).enumerate();
        for (index, _) in sources.filter(|(_, source)| source.jitter.is_some()) {
            let key = format!("liquid.source.{index}.jitter");
            let message = format!("`{key}` would displace particles through the coupled sheets");
            let help = "remove `jitter`, or the coupling of the liquid with sheets";
            findings.push(Finding::new(places.of(&key), &key, message, "found here").with_help(help));
        }
    }
    let is_joined = resolved.as_ref().is_ok_and(|resolved| !resolved.liquid.is_empty());
    if !scene.body.is_empty()
        && scene.liquid.is_some()
        && !scene.sheet.is_empty()
        && resolved.is_ok()
        && !is_joined
    {
        let message = "`[[body]]` acts on `[liquid]` and `[[sheet]]` in one shot if both are coupled";
        let label = "found all three without a `[[coupling]]` of the liquid with a sheet";
        let help = "add a `[[coupling]]` with `between = [\"liquid\", \"NAME\"]` and the `name` of a `[[sheet]]`, or simulate two shots";
        findings.push(Finding::new(places.of("body"), "body", message, label).with_help(help));
    }
    if let Err(error) = resolved {
        let help = help(&error, &present);
        let key = error.key().to_owned();
        findings.push(Finding::new(places.of(&key), &key, error.to_string(), "found here").with_help(help));
    }
}

fn help(error: &CouplingError, present: &PresentSystems<'_>) -> String {
    match error {
        CouplingError::UnknownName { name, .. } if name == liquid::NAME && !present.liquid => {
            "add a `[liquid]` with a source, or take the coupling out".into()
        }
        CouplingError::UnknownName { name, .. } if name == smoke::NAME && !present.smoke => {
            "add a `[smoke]`, or take the coupling out".into()
        }
        CouplingError::UnknownName { name, .. } => {
            match nearest(name, present.sheets.iter().copied().chain([liquid::NAME, smoke::NAME])) {
                Some(meant) => format!("did you mean \"{meant}\"?"),
                None => "write `between = [\"liquid\", \"NAME\"]` with the `name` of a `[[sheet]]`".into(),
            }
        }
        CouplingError::UnsupportedPair { .. } => {
            "write `between = [\"liquid\", \"NAME\"]` or `[\"smoke\", \"NAME\"]`".into()
        }
        CouplingError::Duplicate { .. } => "keep one of them".into(),
        CouplingError::Inapplicable { .. } => {
            "`friction` is between a liquid and a sheet, `drag` between smoke and a sheet".into()
        }
        CouplingError::OutOfRange { .. } => "docs/parameters.md has the ranges".into(),
    }
}
