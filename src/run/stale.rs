//! Which settings keep cached frames from being used.

use super::{RunError, ShotFolder};
use crate::{
    cache::{self, CacheError},
    scene::{self, Overrides, Scene},
};
use serde_json::Value;

/// Why the frames in `folder`, whose key is `found`, are not those of `scene`.
pub(super) fn explain(folder: &ShotFolder, scene: &Scene, found: u64) -> RunError {
    let recorded = recorded(folder).filter(|recorded| recorded.simulation_key() == found);
    let differences = recorded.map(|recorded| {
        differences(&recorded, scene).into_iter().map(|difference| difference.line).collect()
    });
    RunError::OtherSettings { folder: folder.root().into(), differences }
}

/// Refuses a folder with cached frames of other settings than those of `scene`.
///
/// # Errors
/// [`RunError::OtherSettings`]; if the cache cannot be listed.
pub(super) fn refuse_others(folder: &ShotFolder, scene: &Scene) -> Result<(), RunError> {
    let present = match cache::list(&folder.cache()) {
        Err(CacheError::NotFound { .. }) => return Ok(()),
        listed => listed?,
    };
    let keys = scene.frame_keys();
    // Damaged frames are computed again.
    let headers = present.iter().filter_map(|(_, path)| Some((cache::read_header(path).ok()?, path)));
    match headers.into_iter().find(|(found, path)| keys.expect(found, path).is_err()) {
        Some((found, _)) => Err(explain(folder, scene, found.key)),
        None => Ok(()),
    }
}

/// A setting that differs.
#[derive(Debug)]
pub(super) struct Difference {
    /// Its key in presets; numbers are indices of lists.
    pub(super) key: String,
    /// What was found, with its key.
    pub(super) line: String,
}

/// The settings that decide the simulation in which `now` differs from the scene of a folder.
pub(super) fn differences(folder: &Scene, now: &Scene) -> Vec<Difference> {
    let mut found = Vec::new();
    compare("", &folder.simulation_settings(), &now.simulation_settings(), &mut found);
    found
}

/// The scene that the folder's preset describes, if it can be read.
fn recorded(folder: &ShotFolder) -> Option<Scene> {
    let preset = scene::load(folder.preset().to_str()?).ok()?;
    Scene::from_preset(&preset, &Overrides::default()).ok()
}

/// Appends each setting below `key` that differs between the folder and now.
fn compare(key: &str, folder: &Value, now: &Value, found: &mut Vec<Difference>) {
    let mut add = |line| found.push(Difference { key: key.to_owned(), line });
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match (folder, now) {
        _ if folder == now => {}
        (Value::Object(a), Value::Object(b)) => {
            let names = a.keys().chain(b.keys().filter(|name| !a.contains_key(*name)));
            for name in names {
                let value = |of: &serde_json::Map<String, Value>| of.get(name).cloned().unwrap_or_default();
                compare(&below(name), &value(a), &value(b), found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() && a.iter().any(Value::is_object) => {
            for (place, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&below(&place.to_string()), a, b, found);
            }
        }
        _ if key.starts_with("files.") => {
            add(format!("the file {}: other contents than in the folder", &key["files.".len()..]));
        }
        _ => add(format!("{key}: {} in the folder, {} now", shown(folder), shown(now))),
    }
}

/// A setting's value in one line.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "absent".into(),
        Value::Object(_) => "present".into(),
        Value::Array(entries) if entries.iter().any(Value::is_object) => format!("{} entries", entries.len()),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn differing_settings_are_named_by_their_keys() {
        let lines = |folder: Value, now: Value| {
            let mut found = Vec::new();
            compare("", &folder, &now, &mut found);
            found.into_iter().map(|difference| difference.line).collect::<Vec<_>>()
        };
        let source = |radius: f64| json!({ "shape": { "sphere": { "radius": radius } } });
        assert_eq!(lines(json!({ "fps": 24.0 }), json!({ "fps": 24.0 })), [""; 0]);
        assert_eq!(
            lines(
                json!({ "fps": 24.0, "liquid": { "viscosity": { "c": 0.1 }, "source": [source(1.0)] } }),
                json!({ "fps": 25.0, "liquid": { "viscosity": null, "source": [source(2.0)] } }),
            ),
            [
                "fps: 24.0 in the folder, 25.0 now",
                "liquid.viscosity: present in the folder, absent now",
                "liquid.source.0.shape.sphere.radius: 1.0 in the folder, 2.0 now",
            ]
        );
        assert_eq!(
            lines(json!({ "source": [source(1.0)] }), json!({ "source": [source(1.0), source(2.0)] })),
            ["source: 1 entries in the folder, 2 entries now"]
        );
        assert_eq!(
            lines(json!({ "gravity": [0.0, 0.0, -9.81] }), json!({ "gravity": [0.0, 0.0, -1.6] })),
            ["gravity: [0.0,0.0,-9.81] in the folder, [0.0,0.0,-1.6] now"]
        );
        assert_eq!(
            lines(json!({ "files": { "rock.ply": 1 } }), json!({ "files": { "rock.ply": 2 } })),
            ["the file rock.ply: other contents than in the folder"]
        );
    }
}
