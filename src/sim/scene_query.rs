//! Queries of a scene by key, for jobs that work with any key of a preset.

use super::{scene::Scene, smoke::estimate};
use crate::preset::model::{self, Field, Key, Kind};
use serde_json::Value as Json;

impl Scene {
    /// Optional tables that the scene does not have ("liquid.vorticity"), whose passes do not run.
    pub fn absent_tables(&self) -> Vec<String> {
        let values = serde_json::to_value(self).expect("a scene has only values that JSON can hold");
        let mut found = Vec::new();
        if let Kind::Table(keys) = &model::of::<Self>().kind {
            absent(keys, &values, "", &mut found);
        }
        found
    }

    /// Whether the smoke starts with at most so many vortons and tracers; smoke from emitters and meshes is not counted.
    pub fn few_vortons(&self, most: f64) -> bool {
        self.smoke.as_ref().is_some_and(|smoke| estimate(smoke, 0.0) <= most)
    }

    /// The value at a dotted key, in SI; `None` if the key is absent or unknown. Lists count from 0.
    pub fn value(&self, key: &str) -> Option<Json> {
        let values = serde_json::to_value(self).expect("a scene has only values that JSON can hold");
        let pointer = format!("/{}", key.replace('.', "/"));
        values.pointer(&pointer).filter(|value| !value.is_null()).cloned()
    }
}

/// Words that are valid values of the key; empty if its values are no words.
pub fn choices(key: &str) -> Vec<String> {
    let mut field = model::of::<Scene>();
    for word in key.split('.') {
        let Kind::Table(keys) = field.kind else { return Vec::new() };
        let Some(key) = keys.into_iter().find(|key| key.name == word) else { return Vec::new() };
        field = key.field;
    }
    match field {
        Field { kind: Kind::Choice(variants), .. } => {
            variants.into_iter().filter(|variant| variant.content.is_none()).map(|v| v.name).collect()
        }
        _ => Vec::new(),
    }
}

fn absent(keys: &[Key], values: &Json, path: &str, found: &mut Vec<String>) {
    for Key { name, field, .. } in keys {
        let Kind::Table(inner) = &field.kind else { continue };
        let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
        match values.get(name).filter(|value| !value.is_null()) {
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
        let surface = [
            "surface.anisotropy",
            "surface.distance",
            "surface.components",
            "surface.smoothing",
            "surface.decimation",
        ];
        assert_eq!(scene(&[]).absent_tables(), surface);
        let bare = scene(&["liquid.vorticity=none", "liquid.viscosity=none"]);
        assert_eq!(bare.absent_tables()[..2], ["liquid.vorticity", "liquid.viscosity"]);
        assert_eq!(bare.value("liquid.max_iterations"), Some(Json::from(60)));
        assert_eq!(bare.value("liquid.source.0.velocity.1"), Some(Json::from(0.0)));
        assert_eq!(bare.value("liquid.vorticity.strength"), None);
        assert_eq!(bare.value("liquid.spacign"), None);
        assert_eq!(choices("liquid.constraint"), ["compression", "equality"]);
        assert!(choices("liquid.spacing").is_empty() && choices("liquid.solver.x").is_empty());
    }
}
