//! Preset text as a tree in which every key and value knows its place.

use super::problem::{Finding, Source, Span};
use std::collections::{BTreeSet, HashMap};
use toml::{
    Spanned,
    de::{DeInteger, DeTable, DeValue},
};

/// A value and where it stands.
#[derive(Clone, Debug)]
pub(crate) struct Node {
    pub(crate) span: Span,
    pub(crate) value: Value,
    /// The text of a bare word or number of the command line, for keys that take text.
    pub(crate) bare: Option<String>,
}

/// What a node holds.
#[derive(Clone, Debug)]
pub(crate) enum Value {
    Text(String),
    Integer(i128),
    Number(f64),
    Boolean(bool),
    Date,
    List(Vec<Node>),
    Table(Vec<Entry>),
}

/// One key of a table.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) key: String,
    pub(crate) key_span: Span,
    pub(crate) node: Node,
}

/// Most keys a `--set` path may have: deeper than any preset, shallow enough to walk by recursion.
const MAX_DEPTH: usize = 40;

impl Node {
    /// What the value is, for a message.
    pub(crate) fn describe(&self) -> String {
        match &self.value {
            Value::Text(text) if text.chars().count() > 40 => "a long text".to_owned(),
            Value::Text(text) => format!("the text {text:?}"),
            Value::Integer(value) => value.to_string(),
            Value::Number(value) => format!("{value}"),
            Value::Boolean(value) => value.to_string(),
            Value::Date => "a date".to_owned(),
            Value::List(items) => match items.len() {
                1 => "a list of 1 value".to_owned(),
                n => format!("a list of {n} values"),
            },
            Value::Table(_) => "a table".to_owned(),
        }
    }

    /// Puts `other` over this: tables are joined key by key, anything else is replaced.
    pub(crate) fn overlay(&mut self, other: Self) {
        match (&mut self.value, other) {
            (Value::Table(mine), Self { value: Value::Table(theirs), .. }) => {
                let keys = mine.iter().enumerate();
                let places: HashMap<String, usize> =
                    keys.map(|(place, known)| (known.key.clone(), place)).collect();
                for entry in theirs {
                    match places.get(&entry.key).map(|&place| &mut mine[place]) {
                        Some(known) => {
                            if !matches!(
                                (&known.node.value, &entry.node.value),
                                (Value::Table(_), Value::Table(_))
                            ) {
                                known.key_span = entry.key_span;
                            }
                            known.node.overlay(entry.node);
                        }
                        None => mine.push(entry),
                    }
                }
            }
            (_, other) => *self = other,
        }
    }
}

/// Reads a whole preset. On syntax errors, one finding for each line that has any.
pub(crate) fn parse(source: usize, text: &str) -> Result<Node, Vec<Finding>> {
    let (table, errors) = DeTable::parse_recoverable(text);
    if errors.is_empty() {
        let (span, table) = (table.span(), table.into_inner());
        return Ok(Node { span: at(source, span), value: entries(source, table), bare: None });
    }
    let ends: Vec<usize> = text.match_indices('\n').map(|(at, _)| at).collect();
    let mut lines = BTreeSet::new();
    let mut findings = Vec::new();
    for error in errors {
        let span = within(text, error.span().unwrap_or(0..0));
        if lines.insert(ends.partition_point(|&end| end < span.start)) {
            findings.push(syntax(at(source, span), error.message()));
        }
    }
    Err(findings)
}

fn syntax(span: Span, message: &str) -> Finding {
    let help = if message.contains("duplicate key") {
        "a key stands once in its table, and a table once in the preset; remove or join them"
    } else if message.contains("string values must be quoted") {
        "text and numbers with units stand in quotes: \"2 cm\""
    } else {
        "presets are TOML: `key = value` lines below `[table]` headings"
    };
    Finding::new(span, "", format!("the preset cannot be read: {message}"), message).with_help(help)
}

/// The span cut to the text and widened to whole characters.
fn within(text: &str, span: std::ops::Range<usize>) -> std::ops::Range<usize> {
    let mut start = span.start.min(text.len());
    while !text.is_char_boundary(start) {
        start -= 1;
    }
    let mut end = span.end.clamp(start, text.len());
    while !text.is_char_boundary(end) {
        end += 1;
    }
    start..end
}

fn at(source: usize, span: std::ops::Range<usize>) -> Span {
    Span { source, start: span.start, end: span.end }
}

fn entries(source: usize, table: DeTable<'_>) -> Value {
    let entry = |(key, value): (Spanned<std::borrow::Cow<'_, str>>, Spanned<DeValue<'_>>)| Entry {
        key_span: at(source, key.span()),
        key: key.into_inner().into_owned(),
        node: node(source, value),
    };
    Value::Table(table.into_iter().map(entry).collect())
}

fn node(source: usize, value: Spanned<DeValue<'_>>) -> Node {
    let span = at(source, value.span());
    let value = match value.into_inner() {
        DeValue::String(text) => Value::Text(text.into_owned()),
        DeValue::Integer(integer) => integer_value(&integer),
        DeValue::Float(float) => Value::Number(float.as_str().parse().unwrap_or(f64::INFINITY)),
        DeValue::Boolean(value) => Value::Boolean(value),
        DeValue::Datetime(_) => Value::Date,
        DeValue::Array(items) => Value::List(items.into_iter().map(|item| node(source, item)).collect()),
        DeValue::Table(table) => entries(source, table),
    };
    Node { span, value, bare: None }
}

/// An integer; one that not even 128 bits can hold becomes an infinite number, which the check refuses.
fn integer_value(integer: &DeInteger<'_>) -> Value {
    i128::from_str_radix(integer.as_str(), integer.radix())
        .map_or(Value::Number(f64::INFINITY), Value::Integer)
}

/// Applies one `--set key=value` argument, which is the text of `sources[source]`.
pub(crate) fn set(root: &mut Node, source: usize, sources: &[Source]) -> Result<(), Box<Finding>> {
    let text = &*sources[source].text;
    let whole = Span { source, start: 0, end: text.len() };
    let Some((path, value)) = text.split_once('=') else {
        return Err(Finding::new(whole, "", format!("`--set {text}` sets nothing"), "no `=` here")
            .with_help("write `--set key=value`, for example `--set liquid.spacing=0.02`")
            .into());
    };
    let mut parts = Vec::new();
    let mut start = 0;
    for part in path.split('.') {
        let lead = part.len() - part.trim_start().len();
        let word = part.trim();
        let span = Span { source, start: start + lead, end: start + lead + word.len() };
        if word.is_empty() || parts.len() == MAX_DEPTH {
            let label = if word.is_empty() { "a key is missing here" } else { "no preset is this deep" };
            return Err(Finding::new(
                span,
                path,
                format!("`{}` is not a key of a preset", path.trim()),
                label,
            )
            .with_help("write the key with dots, for example `liquid.source.0.velocity`")
            .into());
        }
        parts.push((word, span));
        start += part.len() + 1;
    }
    let value = argument(source, value, path.len() + 1)?;
    put(root, &parts, value)
}

/// The value of a `--set` argument: TOML if it reads as such, else the words as text.
fn argument(source: usize, text: &str, offset: usize) -> Result<Node, Box<Finding>> {
    let word = text.trim();
    let offset = offset + text.len() - text.trim_start().len();
    let span = Span { source, start: offset, end: offset + word.len() };
    let mut value = match DeValue::parse(word) {
        Ok(parsed) => {
            let mut value = node(source, parsed);
            shift(&mut value, offset, span.end);
            value
        }
        Err(error) if word.starts_with(['[', '{', '"', '\'']) => {
            let place = within(word, error.span().unwrap_or(0..word.len()));
            let place = Span { source, start: offset + place.start, end: offset + place.end };
            return Err(Finding::new(
                place,
                "",
                format!("the value cannot be read: {}", error.message()),
                error.message(),
            )
            .with_help("lists are written as `[1, 0, 0]`, tables as `{ key = value }`")
            .into());
        }
        Err(_) => Node { span, value: Value::Text(word.to_owned()), bare: None },
    };
    if !word.starts_with(['[', '{', '"', '\'']) {
        value.span = span;
        value.bare = Some(word.to_owned());
    }
    Ok(value)
}

/// Moves spans that count from the value's start to where the value stands in the argument.
fn shift(node: &mut Node, offset: usize, end: usize) {
    let moved = |span: Span| Span {
        source: span.source,
        start: (span.start + offset).min(end),
        end: (span.end + offset).min(end),
    };
    node.span = moved(node.span);
    match &mut node.value {
        Value::List(items) => items.iter_mut().for_each(|item| shift(item, offset, end)),
        Value::Table(entries) => {
            for entry in entries {
                entry.key_span = moved(entry.key_span);
                shift(&mut entry.node, offset, end);
            }
        }
        _ => {}
    }
}

/// Puts `value` at the end of the path, making tables on the way where there are none.
fn put(root: &mut Node, parts: &[(&str, Span)], value: Node) -> Result<(), Box<Finding>> {
    let mut node = root;
    let mut value = Some(value);
    for (depth, &(word, span)) in parts.iter().enumerate() {
        let last = depth + 1 == parts.len();
        let path = || parts[..depth].iter().map(|part| part.0).collect::<Vec<_>>().join(".");
        let found = node.describe();
        node = match &mut node.value {
            Value::Table(entries) => {
                let index = entries.iter().position(|entry| entry.key == word).unwrap_or_else(|| {
                    let node = Node { span, value: Value::Table(Vec::new()), bare: None };
                    entries.push(Entry { key: word.to_owned(), key_span: span, node });
                    entries.len() - 1
                });
                if last {
                    entries[index].key_span = span;
                }
                &mut entries[index].node
            }
            Value::List(items) => {
                let count = items.len();
                match word.parse::<usize>().ok().and_then(|index| items.get_mut(index)) {
                    Some(item) => item,
                    None => return Err(no_such_item(span, &path(), word, count).into()),
                }
            }
            _ => {
                return Err(Finding::new(
                    span,
                    path(),
                    format!("`{}` has no key `{word}`", path()),
                    format!("`{}` is {found}, not a table", path()),
                )
                .into());
            }
        };
        if last && let Some(value) = value.take() {
            *node = value;
        }
    }
    Ok(())
}

fn no_such_item(span: Span, path: &str, word: &str, count: usize) -> Finding {
    let label = match count {
        0 => "the list is empty".to_owned(),
        1 => "the list has one entry, with index 0".to_owned(),
        _ => format!("the list's entries are 0 to {}", count - 1),
    };
    Finding::new(span, path, format!("`{path}` has no entry `{word}`"), label)
        .with_help(format!("replace the whole list with `--set {path}=[…]`, or add the entry to the preset"))
}
