//! Queries of a scene by key, for jobs that work with any key of a preset.

use super::{scene::Scene, smoke::estimate};
use crate::preset::model::{self, Field, Key, Kind};
use serde_json::Value as Json;
use std::sync::OnceLock;

impl Scene {
    /// What the keys of a preset may be. Made once, as the schema of some hundred keys takes milliseconds.
    pub(crate) fn model() -> &'static Field {
        static MODEL: OnceLock<Field> = OnceLock::new();
        MODEL.get_or_init(model::of::<Self>)
    }

    /// Optional tables that the scene does not have ("liquid.vorticity"), whose passes do not run.
    pub fn absent_tables(&self) -> Vec<String> {
        let values = self.values();
        let mut found = Vec::new();
        if let Kind::Table(keys) = &Self::model().kind {
            absent(keys, &values, "", &mut found);
        }
        found
    }

    /// Lower and upper corner of the liquid's domain [m], if it has one.
    pub(crate) fn domain_of_whitewater(&self) -> Option<[crate::math::Vec3; 2]> {
        let domain = self.liquid.as_ref()?.domain.as_ref()?;
        Some([domain.min.into(), domain.max.into()])
    }

    /// Whether the smoke starts with at most so many vortons and tracers; smoke from emitters and meshes is not counted.
    pub fn few_vortons(&self, most: f64) -> bool {
        self.smoke.as_ref().is_some_and(|smoke| estimate(smoke, 0.0) <= most)
    }
}

fn absent(keys: &[Key], values: &Json, path: &str, found: &mut Vec<String>) {
    for Key { name, field, .. } in keys {
        let Kind::Table(inner) = &field.kind else { continue };
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        match values.get(name) {
            Some(value) => absent(inner, value, &path, found),
            None if field.optional && has_a_pass(&path) => found.push(path),
            None => {}
        }
    }
}

/// Whether the table adds a pass, as those of a system do; tables of the scene itself are systems or none.
fn has_a_pass(path: &str) -> bool {
    path.contains('.')
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Overrides, load};

    #[test]
    fn absent_tables_values_and_choices_are_found_by_key() {
        let preset = load("dam-break").unwrap();
        let scene = |set: &[&str]| {
            let set = set.iter().map(ToString::to_string).collect();
            Scene::from_preset(&preset, &Overrides { quality: None, set }).unwrap()
        };
        let absent = [
            "liquid.artificial_pressure",
            "liquid.micropolar",
            "liquid.viscosity",
            "liquid.domain",
            "surface.distance",
            "surface.components",
            "surface.smoothing.mask",
            "surface.decimation",
        ];
        assert_eq!(scene(&[]).absent_tables(), absent);
        let bare = scene(&["liquid.vorticity=none", "liquid.xsph=none"]);
        for table in ["liquid.vorticity", "liquid.xsph"] {
            assert!(bare.absent_tables().iter().any(|found| found == table), "{table}");
        }
    }
}
