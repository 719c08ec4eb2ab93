//! Preset tree against schema: every problem found, and the values without units.

use super::{
    frames::Frames,
    model::{Field, Key, Kind, Variant, words},
    problem::{Finding, Span},
    tree::{Entry, Node, Value},
    units::{self, UnitError},
};
use serde_json::{Map, Number, Value as Json};
use std::{
    cell::OnceCell,
    collections::{HashMap, HashSet},
};

/// Where each key of a preset stands, by dotted path.
#[derive(Debug, Default)]
pub(crate) struct Places {
    places: HashMap<String, Span>,
}

impl Places {
    /// The place of the key, or of the closest table around it that the preset wrote.
    pub(crate) fn of(&self, path: &str) -> Span {
        let mut path = path;
        loop {
            if let Some(&span) = self.places.get(path) {
                return span;
            }
            match path.rsplit_once('.') {
                Some((parent, _)) => path = parent,
                None => break,
            }
        }
        self.places.get("").copied().unwrap_or(Span { source: 0, start: 0, end: 0 })
    }
}

/// What a walk over a preset found.
#[derive(Debug)]
pub(crate) struct Checked {
    /// The values as the parameter structs expect them; complete only if there are no findings.
    pub(crate) values: Json,
    /// Positions of the values in the text.
    pub(crate) places: Places,
    /// Everything that is wrong.
    pub(crate) findings: Vec<Finding>,
}

/// Checks a whole preset.
pub(crate) fn check(root: &Node, model: &Field) -> Checked {
    let mut walk = Walk { model, known: OnceCell::new(), places: Places::default(), findings: Vec::new() };
    let values = walk.value(root, root.span, model, "").unwrap_or(Json::Null);
    Checked { values, places: walk.places, findings: walk.findings }
}

/// The word of `candidates` that `word` resembles most, if it resembles any.
pub(crate) fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    // A third of the letters may differ: fewer would miss `spacign`, more would suggest unrelated words.
    let length = word.chars().count();
    let close = |candidate: &str| {
        let other = candidate.chars().count();
        let max = other.max(length).div_ceil(3);
        // So many letters differ at least. A word may be as long as a preset, and their distance takes the memory of their product.
        if other.abs_diff(length) > max {
            return (usize::MAX, false);
        }
        let distance = strsim::damerau_levenshtein(&word.to_lowercase(), &candidate.to_lowercase());
        (distance, distance <= max)
    };
    candidates
        .into_iter()
        .map(|candidate| (close(candidate), candidate))
        .filter(|((_, near), _)| *near)
        .min_by_key(|((distance, _), _)| *distance)
        .map(|(_, candidate)| candidate.to_owned())
}

struct Walk<'a> {
    /// Of the whole preset.
    model: &'a Field,
    /// Made for the first key that is unknown.
    known: OnceCell<Known>,
    places: Places,
    findings: Vec<Finding>,
}

/// The keys of the whole schema: a preset may have a hundred thousand that are not among them, and each is looked up.
#[derive(Default)]
struct Known {
    /// The path of each key that earlier versions had elsewhere, by its path there.
    moved: HashMap<String, String>,
    /// The first path of a key, shallow ones first, by its name.
    by_name: HashMap<String, String>,
}

impl Known {
    fn of(model: &Field) -> Self {
        let mut known = Self::default();
        known.add(model, "");
        known
    }

    fn add(&mut self, field: &Field, path: &str) {
        match &field.kind {
            Kind::Table(keys) => {
                for key in keys {
                    self.by_name.entry(key.name.clone()).or_insert_with(|| join(path, &key.name));
                }
                for key in keys {
                    let path = join(path, &key.name);
                    if let Some(former) = &key.former {
                        self.moved.entry(former.clone()).or_insert_with(|| path.clone());
                    }
                    self.add(&key.field, &path);
                }
            }
            Kind::List { item, .. } => self.add(item, path),
            _ => {}
        }
    }
}

/// `path` extended by one key.
fn join(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// How messages call the table at `path`.
fn table_name(path: &str) -> String {
    if path.is_empty() { "the preset's top level".to_owned() } else { format!("`{path}`") }
}

impl Walk<'_> {
    /// The value of `node`, whose key (or heading) is at `place`; `None` if it is wrong or left out.
    fn value(&mut self, node: &Node, place: Span, field: &Field, path: &str) -> Option<Json> {
        self.places.places.insert(path.to_owned(), place);
        if field.optional && matches!(&node.value, Value::Text(text) if text == "none") {
            return None;
        }
        match (&field.kind, &node.value) {
            (Kind::Table(keys), Value::Table(entries)) => Some(self.table(entries, place, keys, path)),
            (Kind::List { item, min, max }, Value::List(items)) => {
                self.list(node, items, (item, *min, *max), field, path)
            }
            (Kind::Choice(variants), _) => self.choice(node, place, variants, field, path),
            (Kind::Number { .. } | Kind::Integer { .. }, _) => self.number(node, field, path),
            (Kind::Boolean, Value::Boolean(value)) => Some(Json::Bool(*value)),
            (Kind::Text { format }, _) => self.text(node, format.as_deref(), field, path),
            _ => self.wrong_type(node, field, path),
        }
    }

    fn report(&mut self, finding: Finding) -> Option<Json> {
        self.findings.push(finding);
        None
    }

    fn wrong_type(&mut self, node: &Node, field: &Field, path: &str) -> Option<Json> {
        let label = format!("found {}, expected {}", node.describe(), field.expected());
        let message = if path.is_empty() {
            "the preset is not a table".to_owned()
        } else {
            format!("`{path}` has the wrong type")
        };
        let help = match (&field.kind, &node.value) {
            (Kind::Text { .. }, Value::Integer(value)) => format!("put it in quotes: \"{value}\""),
            (Kind::Boolean, Value::Text(text)) if text == "true" || text == "false" => {
                format!("remove the quotes: {text}")
            }
            (Kind::List { .. }, Value::Table(_)) if matches!(&field.kind, Kind::List { item, .. } if matches!(item.kind, Kind::Table(_))) =>
            {
                format!("a list of tables is written with double brackets: `[[{path}]]`")
            }
            (Kind::Table(_), Value::List(_)) => {
                format!("there is one `{path}`: write `[{path}]`, single brackets")
            }
            (Kind::Table(_), _) => format!("write a `[{path}]` heading, or `{{ key = value }}`"),
            _ => about(field, path),
        };
        self.report(Finding::new(node.span, path, message, label).with_help(help))
    }

    fn table(&mut self, entries: &[Entry], place: Span, keys: &[Key], path: &str) -> Json {
        let mut values = Map::new();
        let (mut misspelt, mut moved) = (Vec::new(), false);
        for entry in entries {
            let path = join(path, &entry.key);
            match keys.iter().find(|key| key.name == entry.key) {
                Some(key) => {
                    if let Some(value) = self.value(&entry.node, entry.key_span, &key.field, &path) {
                        values.insert(entry.key.clone(), value);
                    }
                }
                None => {
                    moved |= self.moved(&path).is_some();
                    misspelt.extend(self.unknown_key(entry, keys, &path));
                }
            }
        }
        // A required key that is there, but misspelt, is one mistake and not two; so is a table whose keys have moved.
        let misspelt: HashSet<String> = misspelt.into_iter().collect();
        for key in keys.iter().filter(|key| key.required && !moved && !misspelt.contains(&key.name)) {
            if !entries.iter().any(|entry| entry.key == key.name) {
                let label = format!("`{}` is missing here", key.name);
                let message = format!("{} needs the key `{}`", table_name(path), key.name);
                let help = format!("add `{} = …`, {}: {}", key.name, key.field.expected(), key.field.gist());
                self.findings
                    .push(Finding::new(place, join(path, &key.name), message, label).with_help(help));
            }
        }
        Json::Object(values)
    }

    /// Where the key at `path` is now, if earlier versions had it there.
    fn moved(&self, path: &str) -> Option<&String> {
        self.known().moved.get(path)
    }

    fn known(&self) -> &Known {
        self.known.get_or_init(|| Known::of(self.model))
    }

    /// Reports a key that the table does not have, and returns the one that may have been meant.
    fn unknown_key(&mut self, entry: &Entry, keys: &[Key], path: &str) -> Option<String> {
        let names = keys.iter().map(|key| key.name.as_str());
        let nearest = nearest(&entry.key, names.clone());
        let list = names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let parent = path.strip_suffix(&entry.key).unwrap_or_default().trim_end_matches('.');
        if let Some(now) = self.moved(path).cloned() {
            let message = format!("unknown key `{}` in {}", entry.key, table_name(parent));
            let mut finding = Finding::new(entry.key_span, path, message, format!("this is `{now}` now"))
                .with_help(format!("write `{now}`; valid keys here: {list}"));
            finding.nearest = Some(now);
            self.findings.push(finding);
            return None;
        }
        let elsewhere = self.known().by_name.get(&entry.key);
        let advice = match (&nearest, elsewhere) {
            (Some(name), _) => format!("did you mean `{name}`? "),
            (None, Some(other)) => format!("did you mean `{other}`? "),
            (None, None) => String::new(),
        };
        let message = format!("unknown key `{}` in {}", entry.key, table_name(parent));
        let mut finding = Finding::new(entry.key_span, path, message, "this key has no meaning here")
            .with_help(format!("{advice}valid keys: {list}"));
        finding.nearest = nearest.clone().or_else(|| elsewhere.cloned());
        self.findings.push(finding);
        nearest
    }

    fn list(
        &mut self,
        node: &Node,
        items: &[Node],
        (item, min, max): (&Field, usize, Option<usize>),
        field: &Field,
        path: &str,
    ) -> Option<Json> {
        if items.len() < min || max.is_some_and(|max| items.len() > max) {
            return self.wrong_type(node, field, path);
        }
        let values = items
            .iter()
            .enumerate()
            .map(|(index, value)| self.value(value, value.span, item, &join(path, &index.to_string())))
            .collect::<Vec<_>>();
        Some(Json::Array(values.into_iter().map(|value| value.unwrap_or(Json::Null)).collect()))
    }

    fn choice(
        &mut self,
        node: &Node,
        place: Span,
        variants: &[Variant],
        field: &Field,
        path: &str,
    ) -> Option<Json> {
        let names = || variants.iter().map(|variant| variant.name.as_str());
        match &node.value {
            Value::Text(word) => match variants.iter().find(|variant| variant.name == *word) {
                Some(Variant { content: None, .. }) => Some(Json::String(word.clone())),
                Some(Variant { content: Some(content), .. }) => {
                    let label = format!("`{word}` needs values, expected {}", content.expected());
                    let help = format!("write `{{ {word} = {{ … }} }}`{}", keys_of(content));
                    let message = format!("`{path}` is incomplete");
                    self.report(Finding::new(node.span, path, message, label).with_help(help))
                }
                None => self.unknown_choice(node.span, word, variants, field, path),
            },
            Value::Table(entries) if variants.iter().any(|variant| variant.content.is_some()) => {
                let [entry] = &entries[..] else {
                    let label = match entries.len() {
                        0 => format!("found an empty table, expected {}", field.expected()),
                        n => format!("found {n} keys, expected only one of {}", words(variants)),
                    };
                    let message = format!("`{path}` must be exactly one of {}", words(variants));
                    let help = match entries.iter().find(|entry| names().any(|name| name == entry.key)) {
                        Some(entry) => format!("keep one of them, for example `{}`", entry.key),
                        None => about(field, path),
                    };
                    return self.report(Finding::new(place, path, message, label).with_help(help));
                };
                let content = variants.iter().find(|variant| variant.name == entry.key);
                let Some(Variant { content: Some(content), .. }) = content else {
                    return self.unknown_choice(entry.key_span, &entry.key, variants, field, path);
                };
                let value = self.value(&entry.node, entry.key_span, content, &join(path, &entry.key))?;
                Some(Json::Object(Map::from_iter([(entry.key.clone(), value)])))
            }
            _ => self.wrong_type(node, field, path),
        }
    }

    fn unknown_choice(
        &mut self,
        span: Span,
        word: &str,
        variants: &[Variant],
        field: &Field,
        path: &str,
    ) -> Option<Json> {
        let nearest = nearest(word, variants.iter().map(|variant| variant.name.as_str()));
        let advice = nearest.as_ref().map(|name| format!("did you mean `{name}`? ")).unwrap_or_default();
        let label = format!("found `{word}`, expected {}", field.expected());
        let mut finding = Finding::new(span, path, format!("`{path}` cannot be `{word}`"), label)
            .with_help(format!("{advice}{}", about(field, path)));
        finding.nearest = nearest;
        self.report(finding)
    }

    fn text(&mut self, node: &Node, format: Option<&str>, field: &Field, path: &str) -> Option<Json> {
        let text = match (&node.value, &node.bare) {
            (Value::Text(text), _) | (_, Some(text)) => text,
            _ => return self.wrong_type(node, field, path),
        };
        if format == Some("frames")
            && let Err(error) = text.parse::<Frames>()
        {
            let message = format!("`{path}` is not a list of frames: {error}");
            let label = format!("found {}, expected {}", node.describe(), field.expected());
            return self.report(Finding::new(node.span, path, message, label).with_help(about(field, path)));
        }
        Some(Json::String(text.clone()))
    }

    fn number(&mut self, node: &Node, field: &Field, path: &str) -> Option<Json> {
        if let Kind::Integer { limits } = &field.kind {
            return match &node.value {
                Value::Integer(value) if limits.hold(*value as f64) => integer(*value),
                Value::Integer(_) => self.out_of_range(node, field, path),
                Value::Number(value) if value.is_finite() && value.fract() == 0.0 && limits.hold(*value) => {
                    let label =
                        format!("found {} with a decimal point, expected {}", value, field.expected());
                    let finding = Finding::new(node.span, path, format!("`{path}` is a whole number"), label);
                    self.report(finding.with_help(format!("write {}", *value as i128)))
                }
                _ => self.wrong_type(node, field, path),
            };
        }
        let Kind::Number { limits, single } = &field.kind else { return self.wrong_type(node, field, path) };
        let value = match &node.value {
            Value::Integer(value) => *value as f64,
            Value::Number(value) => *value,
            Value::Text(text) => match units::convert(text, field.unit.as_deref()) {
                Ok(value) => value,
                Err(error) => return self.bad_unit(node, text, &error, field, path),
            },
            _ => return self.wrong_type(node, field, path),
        };
        if !value.is_finite() {
            let label = format!("found {}, expected {}", node.describe(), field.expected());
            let message = format!("`{path}` is not a finite number");
            return self.report(Finding::new(node.span, path, message, label).with_help(about(field, path)));
        }
        // A value that single precision turns into zero or infinity would not be the one that was written.
        let lost = *single && (!(value as f32).is_finite() || (value != 0.0 && value as f32 == 0.0));
        if !limits.hold(value) || lost {
            return self.out_of_range(node, field, path);
        }
        Number::from_f64(value).map(Json::Number)
    }

    fn out_of_range(&mut self, node: &Node, field: &Field, path: &str) -> Option<Json> {
        let mut expected = field.expected();
        if matches!(&field.kind, Kind::Number { single: true, .. }) {
            expected.push_str(" (single precision holds magnitudes from 1.4e-45 to 3.4e38)");
        }
        let expected = match &field.kind {
            Kind::Number { limits, .. } if node_value(node, field).is_some_and(|v| !limits.hold(v)) => {
                field.expected()
            }
            _ => expected,
        };
        let label = format!("found {}, expected {expected}", node.describe());
        let finding = Finding::new(node.span, path, format!("`{path}` is out of range"), label);
        self.report(finding.with_help(about(field, path)))
    }

    fn bad_unit(
        &mut self,
        node: &Node,
        text: &str,
        error: &UnitError,
        field: &Field,
        path: &str,
    ) -> Option<Json> {
        let unit = field.unit.as_deref().filter(|unit| *unit != "1");
        let example = match unit {
            Some(unit) => format!("write a bare number in {unit}, or a text such as \"2 {unit}\""),
            None => "write a bare number, or a percentage such as \"50 %\"".to_owned(),
        };
        let (message, help) = match error {
            UnitError::NoNumber => (format!("`{path}` is not a number"), example),
            UnitError::NoUnit => (
                format!("`{path}` is a number in quotes, without a unit"),
                format!("remove the quotes: {}", text.trim()),
            ),
            UnitError::Unknown(found) => (format!("`{path}` has an unknown unit `{found}`"), example),
            UnitError::Other(found) => {
                let wanted =
                    unit.map_or("it has no unit".to_owned(), |unit| format!("it is measured in {unit}"));
                (format!("`{path}` cannot be in `{found}`: {wanted}"), example)
            }
        };
        let label = format!("found {}, expected {}", node.describe(), field.expected());
        self.report(Finding::new(node.span, path, message, label).with_help(help))
    }
}

/// An integer of up to 64 bits as a value.
fn integer(value: i128) -> Option<Json> {
    let number = u64::try_from(value).map(Number::from).or_else(|_| i64::try_from(value).map(Number::from));
    number.ok().map(Json::Number)
}

/// The number that a node stands for, if it stands for one.
fn node_value(node: &Node, field: &Field) -> Option<f64> {
    match &node.value {
        Value::Integer(value) => Some(*value as f64),
        Value::Number(value) => Some(*value),
        Value::Text(text) => units::convert(text, field.unit.as_deref()).ok(),
        _ => None,
    }
}

/// What a field is, from its description.
fn about(field: &Field, path: &str) -> String {
    if field.gist().is_empty() {
        format!("`{path}` is {}", field.expected())
    } else {
        format!("`{path}`: {}", field.gist())
    }
}

/// ", with the keys `a`, `b`" for a table.
fn keys_of(field: &Field) -> String {
    match &field.kind {
        Kind::Table(keys) => {
            let names: Vec<_> = keys.iter().map(|key| format!("`{}`", key.name)).collect();
            format!(" with the keys {}", names.join(", "))
        }
        _ => String::new(),
    }
}
