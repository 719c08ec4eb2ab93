//! The parameter reference and the JSON schema of presets, generated from the parameter structs.

use super::{Quality, Scene};
use crate::preset::model::{self, Field, Key, Kind, Limits, Variant};
use serde_json::{Value as Json, json};
use std::fmt::Write as _;

/// The reference of every preset key, as Markdown.
pub fn markdown() -> String {
    let mut out = String::from(
        "# Preset parameters\n\n\
         Generated from the parameter structs by `MENISCUS_BLESS=1 cargo test reference`; do not edit.\n\
         [The preset format](formats/preset.md) explains how presets are written.\n\n\
         A number may be a text with a unit (`\"2 cm\"`); a bare number is in the unit of the unit column. Keys marked\n\
         *required* have no default. Keys marked *optional* are off when left out, or when set to `\"none\"`.\n",
    );
    let root = Scene::model();
    if let Kind::Table(keys) = &root.kind {
        section(&mut out, "Top level", &root.doc, keys, "");
    }
    out
}

/// A heading with the keys of one table, then the tables below it.
fn section(out: &mut String, heading: &str, doc: &str, keys: &[Key], path: &str) {
    let _ = write!(out, "\n## {heading}\n\n{}\n", paragraph(doc));
    key_table(out, keys);
    for key in keys {
        let path = if path.is_empty() { key.name.clone() } else { format!("{path}.{}", key.name) };
        match &key.field.kind {
            Kind::Table(keys) => section(out, &format!("`[{path}]`"), &key.field.doc, keys, &path),
            Kind::List { item, .. } => {
                if let Kind::Table(keys) = &item.kind {
                    section(out, &format!("`[[{path}]]`"), &key.field.doc, keys, &path);
                }
            }
            Kind::Choice(variants) if variants.iter().any(|variant| variant.content.is_some()) => {
                choice(out, &path, &key.field.doc, variants);
            }
            _ => {}
        }
    }
}

/// The variants of a key whose value is a table with one of several keys.
fn choice(out: &mut String, path: &str, doc: &str, variants: &[Variant]) {
    let _ = write!(out, "\n### `{path}`\n\n{} Exactly one of:\n", paragraph(doc));
    for Variant { name, doc, content } in variants {
        match content {
            Some(Field { kind: Kind::Table(keys), .. }) => {
                let names: Vec<_> = keys.iter().map(|key| format!("{} = …", key.name)).collect();
                let _ = write!(out, "\n**`{{ {name} = {{ {} }} }}`** {}\n", names.join(", "), paragraph(doc));
                key_table(out, keys);
            }
            Some(content) => {
                let _ = write!(out, "\n**`{{ {name} = … }}`** {} ({})\n", paragraph(doc), content.expected());
            }
            None => {
                let _ = write!(out, "\n**`\"{name}\"`** {}\n", paragraph(doc));
            }
        }
    }
}

fn key_table(out: &mut String, keys: &[Key]) {
    out.push_str("\n| Key | Type | Unit | Range | Default | Meaning |\n|---|---|---|---|---|---|\n");
    for Key { name, required, field, .. } in keys {
        let mut meaning = paragraph(&field.doc);
        if let Kind::Choice(variants) = words_of(&field.kind) {
            for variant in variants.iter().filter(|variant| variant.content.is_none()) {
                let _ = write!(meaning, "<br>`\"{}\"`: {}", variant.name, paragraph(&variant.doc));
            }
        }
        let unit = field.unit.as_deref().unwrap_or_default();
        let _ = writeln!(
            out,
            "| `{name}` | {} | {unit} | {} | {} | {} |",
            type_name(&field.kind),
            range(&field.kind),
            default(field, *required),
            meaning.replace('|', "\\|"),
        );
    }
}

/// The kind whose words are listed: the value's own, or that of a list's items.
fn words_of(kind: &Kind) -> &Kind {
    match kind {
        Kind::List { item, .. } => &item.kind,
        kind => kind,
    }
}

fn type_name(kind: &Kind) -> String {
    match kind {
        Kind::Number { .. } => "number".to_owned(),
        Kind::Integer { .. } => "whole number".to_owned(),
        Kind::Boolean => "true or false".to_owned(),
        Kind::Text { format: Some(format) } => format.clone(),
        Kind::Text { format: None } => "text".to_owned(),
        Kind::List { item, min, max: Some(max) } if min == max => {
            format!("list of {min} × {}", type_name(&item.kind))
        }
        Kind::List { item, .. } => format!("list of {}", type_name(&item.kind)),
        Kind::Table(_) => "table".to_owned(),
        Kind::Choice(variants) if variants.iter().all(|variant| variant.content.is_none()) => {
            "word".to_owned()
        }
        Kind::Choice(_) => "choice".to_owned(),
    }
}

fn range(kind: &Kind) -> String {
    match kind {
        Kind::Number { limits, .. } | Kind::Integer { limits } => limits.describe(),
        Kind::List { item, .. } => range(&item.kind),
        _ => Limits::default().describe(),
    }
}

fn default(field: &Field, required: bool) -> String {
    match (&field.default, &field.kind) {
        _ if required => "*required*".to_owned(),
        (_, Kind::Table(_)) if !field.optional => String::new(),
        (Some(default), _) => format!("`{}`", short(default)),
        (None, _) => "*optional*".to_owned(),
    }
}

/// A default with single-precision numbers in as many digits as they have.
fn short(value: &Json) -> Json {
    match value {
        Json::Number(number) if number.is_f64() => {
            let wide = number.as_f64().unwrap_or_default();
            let single = wide as f32;
            if f64::from(single) == wide {
                format!("{single}").parse::<f64>().map_or_else(|_| value.clone(), |short| json!(short))
            } else {
                value.clone()
            }
        }
        Json::Array(items) => items.iter().map(short).collect(),
        Json::Object(entries) => entries.iter().map(|(key, value)| (key.clone(), short(value))).collect(),
        _ => value.clone(),
    }
}

fn paragraph(doc: &str) -> String {
    doc.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The JSON schema of preset files, for editors that complete and check TOML.
///
/// It is the schema of [`Scene`] and, as presets have them, numbers written as text with a unit, `"none"`
/// for optional keys, and the quality tiers.
pub fn json_schema() -> String {
    let mut schema = model::schema::<Scene>();
    as_written(&mut schema);
    schema["title"] = json!("Meniscus preset");
    let tier = |name: &str| {
        json!({
            "description": format!("Keys to change when the shot runs with `--quality {name}`."),
            "type": "object"
        })
    };
    let tiers: serde_json::Map<_, _> =
        Quality::ALL.into_iter().map(|quality| (quality.name().to_owned(), tier(quality.name()))).collect();
    schema["properties"]["quality"] = json!({
        "description": "Tiers of the shot.",
        "type": "object",
        "properties": tiers,
        "additionalProperties": false
    });
    let mut text = serde_json::to_string_pretty(&schema).expect("a schema is JSON");
    text.push('\n');
    text
}

/// Turns a schema of parameter structs into one of preset text.
fn as_written(schema: &mut Json) {
    if let Json::Array(items) = schema {
        return items.iter_mut().for_each(as_written);
    }
    let Json::Object(entries) = schema else { return };
    for (key, value) in entries.iter_mut() {
        match key.as_str() {
            "default" => *value = short(value),
            "description" => {
                if let Some(doc) = value.as_str() {
                    *value = json!(paragraph(&doc.replace("\\[", "[").replace("\\]", "]")));
                }
            }
            _ => as_written(value),
        }
    }
    match entries.get("type") {
        Some(Json::String(kind)) if kind == "number" => {
            entries.insert("type".to_owned(), json!(["number", "string"]));
        }
        Some(Json::String(kind)) if kind == "null" => {
            entries.remove("type");
            entries.insert("const".to_owned(), json!("none"));
        }
        Some(Json::Array(kinds)) => {
            let mut kinds: Vec<Json> = kinds.iter().filter(|kind| *kind != "null").cloned().collect();
            if !kinds.contains(&json!("string")) {
                kinds.push(json!("string"));
            }
            entries.insert("type".to_owned(), Json::Array(kinds));
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// Compares a committed file with what is generated now, or writes it if `MENISCUS_BLESS` is set.
    fn is_current(path: &str, generated: &str) {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
        if std::env::var_os("MENISCUS_BLESS").is_some() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, generated).unwrap();
        }
        let committed = std::fs::read_to_string(&path).unwrap_or_default();
        assert!(
            committed == generated,
            "{} is out of date: run `MENISCUS_BLESS=1 cargo test reference` and commit the result",
            path.display()
        );
    }

    #[test]
    fn the_committed_reference_is_current() {
        is_current("docs/parameters.md", &markdown());
        is_current("docs/preset.schema.json", &json_schema());
    }

    #[test]
    fn every_key_of_the_schema_is_in_the_reference() {
        fn names(field: &Field, found: &mut Vec<String>) {
            match &field.kind {
                Kind::Table(keys) => {
                    for key in keys {
                        found.push(key.name.clone());
                        names(&key.field, found);
                    }
                }
                Kind::List { item, .. } => names(item, found),
                Kind::Choice(variants) => {
                    for variant in variants {
                        found.push(variant.name.clone());
                        variant.content.iter().for_each(|content| names(content, found));
                    }
                }
                _ => {}
            }
        }
        let (text, mut found) = (markdown(), Vec::new());
        names(Scene::model(), &mut found);
        assert!(found.len() > 30);
        for name in found {
            assert!(
                text.contains(&format!("`{name}`"))
                    || text.contains(&format!("{name}\"`"))
                    || text.contains(&format!("{{ {name} =")),
                "{name}"
            );
        }
        assert!(text.contains("| `spacing` | number | m | above 0 | *required* |"));
        assert!(text.contains("`[0.0,0.0,-9.81]`"));
    }
}
