//! Checks of the products that a preset requests.

use super::{interface::Product, registry::ALL, request::ProductSettings};
use crate::{
    frame::StreamKind,
    preset::{check::Places, problem::Finding},
    sim::{registry, scene::Scene},
};

/// Reports products that cannot be made of the systems of the scene, before hours of simulating.
pub(crate) fn check(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let settings = ProductSettings::of(scene);
    let systems = registry::ALL.iter().filter(|system| system.is_present(scene));
    let kinds: Vec<StreamKind> = systems.flat_map(|system| system.stream_kinds()).copied().collect();
    let accepts = |product: &dyn Product| kinds.iter().any(|&kind| product.accepts(kind));
    for product in ALL.into_iter().filter(|product| product.is_requested(&settings)) {
        product.check_scene(scene, places, findings);
        if accepts(product) {
            product.check(&settings, &kinds, places, findings);
            continue;
        }
        let Some((key, _)) = product.preset_key() else { continue };
        let input = product.input();
        let others: Vec<&str> = ALL
            .into_iter()
            .filter(|&other| accepts(other))
            .filter_map(|other| Some(other.preset_key()?.1))
            .collect();
        let name = key.rsplit('.').next().unwrap_or(key);
        let help = match others.first() {
            Some(other) => format!("remove `{name}`, and write `{other}` in `[output]`"),
            None => format!("remove `{name}`"),
        };
        let finding = Finding::new(
            places.of(key),
            key,
            format!("`{key}` needs {input}, and no system of the preset has any"),
            format!("found files requested of {input}, expected none"),
        )
        .with_help(help);
        if !findings.contains(&finding) {
            findings.push(finding);
        }
    }
}
