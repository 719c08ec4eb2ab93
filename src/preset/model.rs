//! Keys of a preset, read from the JSON schema of [`Scene`](crate::scene::Scene).
//!
//! The schema is generated from the parameter structs, so keys, types, ranges, units and descriptions are written once, with
//! the code that uses them. Units and ranges are read from the doc comments. The model understands the forms that those
//! structs use and refuses any other when it is built, which a test does.

use schemars::{JsonSchema, Schema, generate::SchemaSettings, transform::RecursiveTransform};
use serde_json::Value as Json;

/// One value of a preset: what it may be and what it means.
#[derive(Clone, Debug)]
pub(crate) struct Field {
    pub(crate) doc: String,
    pub(crate) unit: Option<String>,
    /// Whether the key may be left out with its own meaning ("absent: not applied"), also written as "none".
    pub(crate) optional: bool,
    pub(crate) default: Option<Json>,
    pub(crate) kind: Kind,
}

/// The type of a value.
#[derive(Clone, Debug)]
pub(crate) enum Kind {
    Number { limits: Limits, single: bool },
    Integer { limits: Limits },
    Boolean,
    Text { format: Option<String> },
    List { item: Box<Field>, min: usize, max: Option<usize> },
    Table(Vec<Key>),
    Choice(Vec<Variant>),
}

/// One key of a table.
#[derive(Clone, Debug)]
pub(crate) struct Key {
    pub(crate) name: String,
    pub(crate) required: bool,
    /// Dotted path that the key had in earlier versions.
    pub(crate) former: Option<String>,
    pub(crate) field: Field,
}

/// One of several things a value may be: a word, or a table with the word as its only key.
#[derive(Clone, Debug)]
pub(crate) struct Variant {
    pub(crate) name: String,
    pub(crate) doc: String,
    pub(crate) content: Option<Field>,
}

/// The range of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Limits {
    pub(crate) min: Option<f64>,
    pub(crate) above: Option<f64>,
    pub(crate) max: Option<f64>,
    pub(crate) below: Option<f64>,
}

impl Limits {
    pub(crate) fn hold(&self, value: f64) -> bool {
        self.min.is_none_or(|min| value >= min)
            && self.above.is_none_or(|above| value > above)
            && self.max.is_none_or(|max| value <= max)
            && self.below.is_none_or(|below| value < below)
    }

    /// "above 0, at most 10"; empty without limits.
    pub(crate) fn describe(&self) -> String {
        let mut parts = Vec::new();
        match (self.min, self.max) {
            (Some(min), Some(max)) => parts.push(format!("{min} to {max}")),
            (Some(min), None) => parts.push(format!("at least {min}")),
            _ => {}
        }
        parts.extend(self.above.map(|above| format!("above {above}")));
        parts.extend(self.below.map(|below| format!("below {below}")));
        parts.extend(self.max.filter(|_| self.min.is_none()).map(|max| format!("at most {max}")));
        parts.join(", ")
    }
}

impl Field {
    /// What may stand here, for a message.
    pub(crate) fn expected(&self) -> String {
        match &self.kind {
            Kind::Number { limits, .. } => {
                with_range(format!("a number{}", unit_words(self.unit.as_deref())), limits)
            }
            Kind::Integer { limits } => with_range("a whole number".to_owned(), limits),
            Kind::Boolean => "true or false".to_owned(),
            Kind::Text { format: Some(format) } if format == "frames" => {
                "frames in quotes, such as \"1-96\"".to_owned()
            }
            Kind::Text { .. } => "text in quotes".to_owned(),
            Kind::List { item, min, max } => {
                let what = match &item.kind {
                    Kind::Number { .. } => format!("numbers{}", unit_words(self.unit.as_deref())),
                    Kind::Integer { .. } => "whole numbers".to_owned(),
                    Kind::Table(_) => "tables".to_owned(),
                    Kind::Choice(variants) => format!("choices from {}", words(variants)),
                    _ => "values".to_owned(),
                };
                match (min, max) {
                    (min, Some(max)) if min == max => format!("a list of {min} {what}"),
                    _ => format!("a list of {what}"),
                }
            }
            Kind::Table(_) => "a table".to_owned(),
            Kind::Choice(variants) if variants.iter().all(|variant| variant.content.is_some()) => {
                format!("a table with one of the keys {}", words(variants))
            }
            Kind::Choice(variants) => format!("one of {}", words(variants)),
        }
    }

    /// The first sentence of the description.
    pub(crate) fn gist(&self) -> &str {
        let doc = self.doc.lines().next().unwrap_or_default();
        doc.split_inclusive(['.', ':', ';']).next().unwrap_or(doc).trim_end_matches([':', ';'])
    }
}

fn unit_words(unit: Option<&str>) -> String {
    match unit {
        Some("1") | None => String::new(),
        Some(unit) => format!(" in {unit}"),
    }
}

fn with_range(what: String, limits: &Limits) -> String {
    let range = limits.describe();
    if range.is_empty() { what } else { format!("{what}, {range}") }
}

/// The variants' names, quoted and joined.
pub(crate) fn words(variants: &[Variant]) -> String {
    variants.iter().map(|variant| format!("`{}`", variant.name)).collect::<Vec<_>>().join(", ")
}

/// The model of a type that derives its schema.
///
/// # Panics
/// If the schema has a form that presets do not use: a fault of the type, not of any preset.
pub(crate) fn of<T: JsonSchema>() -> Field {
    let schema = schema::<T>();
    field(&schema, &schema, 0)
}

/// The JSON schema of a type, with the units and ranges that its doc comments name.
pub(crate) fn schema<T: JsonSchema>() -> Json {
    let settings = SchemaSettings::default().with_transform(RecursiveTransform(documented));
    settings.into_generator().into_root_schema_for::<T>().to_value()
}

/// Moves the range of a number out of its description, and adds the unit that this names first: "… [m] … Range: above 0."
fn documented(schema: &mut Schema) {
    let Some(doc) = schema.get("description").and_then(Json::as_str).map(str::to_owned) else { return };
    if !is_numeric(schema.as_value()) {
        return;
    }
    let bracketed = doc.split('[').skip(1).filter_map(|text| text.split(']').next());
    let unit = bracketed.map(|text| text.trim_end_matches('\\')).find(|unit| super::units::is_known(unit));
    if let Some(unit) = unit {
        schema.insert("unit".into(), unit.into());
    }
    let Some((doc, range)) = doc.rsplit_once("Range: ") else { return };
    schema.insert("description".into(), doc.trim_end().into());
    let is_integer = schema.as_value()["type"].to_string().contains("integer");
    let number = |text: &str| -> Json {
        let value: f64 = text.parse().unwrap_or_else(|_| panic!("a range has numbers: {range}"));
        if is_integer { (value as i64).into() } else { value.into() }
    };
    for part in range.trim_end_matches('.').split(", ") {
        let limits = match part.split_once(" to ") {
            Some((min, max)) => vec![("minimum", min), ("maximum", max)],
            None => {
                let words = [
                    ("at least ", "minimum"),
                    ("above ", "exclusiveMinimum"),
                    ("at most ", "maximum"),
                    ("below ", "exclusiveMaximum"),
                ];
                let limit = words.iter().find_map(|(word, key)| Some((*key, part.strip_prefix(word)?)));
                vec![
                    limit.unwrap_or_else(|| panic!("a range is described as in `Limits::describe`: {range}")),
                ]
            }
        };
        // That of a list is the range of its numbers.
        let place = if schema.get("items").is_some() { "/items" } else { "" };
        let place = schema.pointer_mut(place).expect("schemas are objects");
        limits.into_iter().for_each(|(key, text)| place[key] = number(text));
    }
}

/// Whether a schema is that of a number or a list of numbers.
fn is_numeric(schema: &Json) -> bool {
    let types = schema["type"].to_string();
    types.contains("number")
        || types.contains("integer")
        || (types.contains("array") && is_numeric(&schema["items"]))
}

fn field(schema: &Json, root: &Json, depth: usize) -> Field {
    assert!(depth < 40, "parameter types do not contain themselves");
    let mut field = if let Some(target) = schema["$ref"].as_str() {
        let pointer = target.strip_prefix('#').expect("references stay within the schema");
        field(root.pointer(pointer).expect("references have a target"), root, depth + 1)
    } else if let Some(options) = schema["anyOf"].as_array() {
        let [value] = &options.iter().filter(|option| option["type"] != "null").collect::<Vec<_>>()[..]
        else {
            panic!("anyOf is used for optional values only: {schema}");
        };
        Field { optional: true, ..field(value, root, depth + 1) }
    } else {
        let (kind, optional) = kind(schema, root, depth);
        Field { doc: String::new(), unit: None, optional, default: None, kind }
    };
    if let Some(doc) = schema["description"].as_str() {
        field.doc = doc.replace("\\[", "[").replace("\\]", "]");
    }
    if let Some(unit) = schema["unit"].as_str() {
        field.unit = Some(unit.to_owned());
    }
    if let Some(default) = schema.get("default").filter(|default| !default.is_null()) {
        field.default = Some(default.clone());
    }
    // A list's numbers carry its unit.
    if let (Some(unit), Kind::List { item, .. }) = (&field.unit, &mut field.kind) {
        item.unit.get_or_insert_with(|| unit.clone());
    }
    field
}

fn kind(schema: &Json, root: &Json, depth: usize) -> (Kind, bool) {
    if let Some(variants) = schema["oneOf"].as_array() {
        return (Kind::Choice(variants.iter().flat_map(|v| variant(v, root, depth)).collect()), false);
    }
    if schema.get("enum").is_some() || schema.get("const").is_some() {
        return (Kind::Choice(variant(schema, root, depth)), false);
    }
    let types: Vec<&str> = match &schema["type"] {
        Json::String(name) => vec![name],
        Json::Array(names) => names.iter().filter_map(Json::as_str).collect(),
        _ => panic!("a type is named: {schema}"),
    };
    let optional = types.contains(&"null");
    let [name] = types.iter().copied().filter(|&name| name != "null").collect::<Vec<_>>()[..] else {
        panic!("a value has one type: {schema}");
    };
    let kind = match name {
        "number" => Kind::Number { limits: limits(schema), single: schema["format"] == "float" },
        "integer" => Kind::Integer { limits: integer_limits(schema) },
        "boolean" => Kind::Boolean,
        "string" => Kind::Text { format: schema["format"].as_str().map(str::to_owned) },
        "array" => Kind::List {
            item: Box::new(field(&schema["items"], root, depth + 1)),
            min: schema["minItems"].as_u64().unwrap_or(0) as usize,
            max: schema["maxItems"].as_u64().map(|max| max as usize),
        },
        "object" => Kind::Table(keys(schema, root, depth)),
        _ => panic!("presets have no type {name}"),
    };
    (kind, optional)
}

fn keys(schema: &Json, root: &Json, depth: usize) -> Vec<Key> {
    assert_eq!(schema["additionalProperties"], false, "tables refuse unknown keys: {schema}");
    let required =
        |name: &str| schema["required"].as_array().is_some_and(|r| r.iter().any(|key| key == name));
    let properties = schema["properties"].as_object().into_iter().flatten();
    properties
        .map(|(name, schema)| Key {
            name: name.clone(),
            required: required(name),
            former: schema["former"].as_str().map(str::to_owned),
            field: field(schema, root, depth + 1),
        })
        .collect()
}

fn variant(schema: &Json, root: &Json, depth: usize) -> Vec<Variant> {
    let doc = schema["description"].as_str().unwrap_or_default().to_owned();
    let word = |name: &Json| Variant {
        name: name.as_str().expect("choices are words").to_owned(),
        doc: doc.clone(),
        content: None,
    };
    if let Some(name) = schema.get("const") {
        return vec![word(name)];
    }
    if let Some(names) = schema["enum"].as_array() {
        return names.iter().map(word).collect();
    }
    let mut keys = keys(schema, root, depth);
    assert!(keys.len() == 1 && keys[0].required, "a choice is a word or a table with one key: {schema}");
    let Key { name, field, .. } = keys.remove(0);
    vec![Variant { name, doc, content: Some(field) }]
}

fn limits(schema: &Json) -> Limits {
    let limit = |name: &str| schema[name].as_f64();
    Limits {
        min: limit("minimum"),
        above: limit("exclusiveMinimum"),
        max: limit("maximum"),
        below: limit("exclusiveMaximum"),
    }
}

/// The stated limits, closed by what the integer type can hold.
fn integer_limits(schema: &Json) -> Limits {
    let (min, max) = match schema["format"].as_str() {
        Some("uint8") => (0.0, f64::from(u8::MAX)),
        Some("uint16") => (0.0, f64::from(u16::MAX)),
        Some("uint32") => (0.0, f64::from(u32::MAX)),
        // The largest f64 that is not above the type's maximum.
        Some("uint64" | "uint") => (0.0, 18_446_744_073_709_549_568.0),
        Some("int32") => (f64::from(i32::MIN), f64::from(i32::MAX)),
        Some("int64" | "int") => (i64::MIN as f64, 9_223_372_036_854_774_784.0),
        other => panic!("presets have no integers of format {other:?}"),
    };
    let stated = limits(schema);
    Limits { min: stated.min.or(Some(min)), max: stated.max.or(Some(max)), ..stated }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_read_as_words() {
        let above = Limits { above: Some(0.0), max: Some(10.0), ..Limits::default() };
        assert_eq!(above.describe(), "above 0, at most 10");
        assert!(!above.hold(0.0) && above.hold(10.0) && !above.hold(10.1) && !above.hold(f64::NAN));
        let closed = Limits { min: Some(1.2), max: Some(4.0), ..Limits::default() };
        assert_eq!(closed.describe(), "1.2 to 4");
        assert!(closed.hold(1.2) && !closed.hold(1.1));
        let below = Limits { below: Some(1.0), ..Limits::default() };
        assert!(below.hold(0.9) && !below.hold(1.0));
    }
}
