//! Checks of what a preset says about couplings, once every value is valid on its own.

use crate::{
    preset::{
        check::{Places, nearest},
        problem::Finding,
    },
    sim::{
        coupling::{self, CouplingError, There},
        liquid,
        scene::Scene,
        smoke,
    },
};

/// Everything about the couplings that has no meaning.
pub(super) fn check_couplings(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let there = There {
        liquid: scene.liquid.is_some(),
        smoke: scene.smoke.is_some(),
        sheets: scene.sheet.iter().map(|sheet| sheet.name.as_str()).collect(),
    };
    if let Err(error) = coupling::resolve(&scene.coupling, &there) {
        let help = help(&error, &there);
        let key = error.key().to_owned();
        findings.push(Finding::new(places.of(&key), &key, error.to_string(), "found here").with_help(help));
    }
}

fn help(error: &CouplingError, there: &There<'_>) -> String {
    match error {
        CouplingError::Name { name, .. } if name == liquid::NAME && !there.liquid => {
            "add a `[liquid]` with a source, or take the coupling out".into()
        }
        CouplingError::Name { name, .. } if name == smoke::NAME && !there.smoke => {
            "add a `[smoke]`, or take the coupling out".into()
        }
        CouplingError::Name { name, .. } => {
            match nearest(name, there.sheets.iter().copied().chain([liquid::NAME, smoke::NAME])) {
                Some(meant) => format!("did you mean \"{meant}\"?"),
                None => "write `between = [\"liquid\", \"NAME\"]` with the `name` of a `[[sheet]]`".into(),
            }
        }
        CouplingError::Pair { .. } => {
            "write `between = [\"liquid\", \"NAME\"]` or `[\"smoke\", \"NAME\"]`".into()
        }
        CouplingError::Twice { .. } => "keep one of them".into(),
        CouplingError::Foreign { .. } => {
            "`friction` is between a liquid and a sheet, `drag` between smoke and a sheet".into()
        }
        CouplingError::OutOfRange { .. } => "docs/parameters.md has the ranges".into(),
    }
}
