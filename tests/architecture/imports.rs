//! The imports between the files of `src/`, read from their text.
//!
//! A path is followed through re-exports to the file that defines its item, so that `super::Item` is an import of
//! the sibling in which `Item` is defined and not of the folder's `mod.rs`. Tests inside the files are left out:
//! they may use anything.

use std::collections::{BTreeMap, BTreeSet};

/// Source text by path below the project's root.
pub(crate) type Sources = BTreeMap<String, String>;

/// A module as the segments of its path below the crate.
type Module = Vec<String>;

/// Which file imports which.
pub(crate) type Imports = BTreeMap<String, BTreeSet<String>>;

/// The text without comments, string literals and the tests at its end.
pub(crate) fn code(text: &str) -> String {
    strip(text, false)
}

/// The text without comments and the tests at its end; string literals are kept on request, without escapes.
pub(crate) fn strip(text: &str, keeps_literals: bool) -> String {
    let text = text.find("#[cfg(test)]\nmod tests {").map_or(text, |end| &text[..end]);
    let bytes: Vec<char> = text.chars().collect();
    let (mut out, mut i) = (String::new(), 0);
    while i < bytes.len() {
        match (bytes[i], bytes.get(i + 1)) {
            ('/', Some('/')) => {
                while i < bytes.len() && bytes[i] != '\n' {
                    i += 1;
                }
            }
            ('"', _) => {
                i += 1;
                out.push('"');
                while i < bytes.len() && bytes[i] != '"' {
                    if keeps_literals && bytes[i] != '\\' {
                        out.push(bytes[i]);
                    }
                    i += if bytes[i] == '\\' { 2 } else { 1 };
                }
                i += 1;
                out.push('"');
            }
            // A quotation mark as a character would open a string.
            ('\'', Some('"')) if bytes.get(i + 2) == Some(&'\'') => i += 3,
            (c, _) => {
                out.push(c);
                i += 1;
            }
        }
    }
    out
}

/// Reads which file of `sources` imports which.
pub(crate) fn imports(sources: &Sources) -> Imports {
    let files: BTreeMap<Module, &String> =
        sources.keys().filter(|path| !is_test(path)).filter_map(|path| Some((module(path)?, path))).collect();
    let uses: BTreeMap<&Module, Uses> =
        files.iter().map(|(module, path)| (module, Uses::of(&code(&sources[*path])))).collect();
    let tree = Tree { files: &files, uses: &uses };
    let mut found = Imports::new();
    for (module, path) in &files {
        let targets = tree.imports_of(module);
        found.insert((*path).clone(), targets.into_iter().filter(|target| target != *path).collect());
    }
    found
}

/// The groups of files that import each other in a circle.
pub(crate) fn cycles(imports: &Imports) -> Vec<Vec<String>> {
    // A file is in a circle with those that it reaches and that reach it.
    let reached: BTreeMap<&String, BTreeSet<&String>> =
        imports.keys().map(|file| (file, reach(imports, file))).collect();
    let mut found: Vec<Vec<String>> = Vec::new();
    for file in imports.keys() {
        if found.iter().any(|cycle| cycle.contains(file)) {
            continue;
        }
        let mut cycle: Vec<String> = reached[file]
            .iter()
            .filter(|&&other| reached[other].contains(file))
            .map(|&o| o.clone())
            .collect();
        if !cycle.is_empty() {
            cycle.sort();
            cycle.dedup();
            found.push(cycle);
        }
    }
    found
}

fn reach<'a>(imports: &'a Imports, file: &'a String) -> BTreeSet<&'a String> {
    let (mut found, mut next) = (BTreeSet::new(), vec![file]);
    while let Some(file) = next.pop() {
        next.extend(imports[file].iter().filter(|target| found.insert(*target)));
    }
    found
}

/// Whether a file holds tests only.
fn is_test(path: &str) -> bool {
    path.ends_with("/tests.rs") || path.contains("/tests/")
}

/// The module of a file; none for `main.rs`.
fn module(path: &str) -> Option<Module> {
    let inside = path.strip_prefix("src/")?.strip_suffix(".rs")?;
    let mut segments: Module = inside.split('/').map(String::from).collect();
    match segments.last()?.as_str() {
        "mod" => _ = segments.pop(),
        "lib" if segments.len() == 1 => segments.clear(),
        "main" if segments.len() == 1 => return None,
        _ => {}
    }
    Some(segments)
}

/// Uses of other modules in a file.
struct Uses {
    /// Full paths of `use` items, with the name that each gets here.
    imported: Vec<(Vec<String>, String)>,
    /// `pub use` items, likewise.
    exported: Vec<(Vec<String>, String)>,
    /// Paths in the rest of the text.
    inline: Vec<Vec<String>>,
}

impl Uses {
    fn of(code: &str) -> Self {
        let (mut imported, mut exported, mut rest) = (Vec::new(), Vec::new(), String::new());
        for statement in code.split_inclusive(';') {
            let start = statement.rfind("\nuse ").or_else(|| statement.rfind(" use "));
            let start = start.or_else(|| statement.starts_with("use ").then_some(0));
            let Some(start) = start.filter(|&at| statement[at..].trim_end().ends_with(';')) else {
                rest.push_str(statement);
                continue;
            };
            let before = statement[..start].trim_end();
            let is_public = before.ends_with("pub") || (before.ends_with(')') && before.contains("pub("));
            rest.push_str(before);
            let tree = statement[start..].trim_start()[3..].trim().trim_end_matches(';');
            let into = if is_public { &mut exported } else { &mut imported };
            expand(tree, &[], into);
        }
        Self { imported, exported, inline: paths(&rest) }
    }
}

/// Every path of a `use` tree below `before`, with its name.
fn expand(tree: &str, before: &[String], into: &mut Vec<(Vec<String>, String)>) {
    let tree = tree.trim();
    let Some((head, rest)) = tree.split_once("::").filter(|(head, _)| !head.contains('{')) else {
        if let Some(group) = tree.strip_prefix('{').and_then(|tree| tree.strip_suffix('}')) {
            items(group).iter().for_each(|item| expand(item, before, into));
            return;
        }
        let (item, name) = tree.split_once(" as ").unwrap_or((tree, tree));
        let mut path = before.to_vec();
        if item == "self" {
            let name = if name == "self" { before.last().cloned().unwrap_or_default() } else { name.into() };
            into.push((path, name));
        } else if !item.is_empty() {
            path.push(item.trim().into());
            into.push((path, name.trim().into()));
        }
        return;
    };
    expand(rest, &[before, &[head.trim().to_owned()]].concat(), into);
}

/// The items of a group, split at its own commas.
fn items(group: &str) -> Vec<String> {
    let (mut depth, mut found) = (0, vec![String::new()]);
    for c in group.chars() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                found.push(String::new());
                continue;
            }
            _ => {}
        }
        found.last_mut().expect("there is always one").push(c);
    }
    found.into_iter().map(|item| item.trim().to_owned()).filter(|item| !item.is_empty()).collect()
}

/// Every path of at least two segments in the text.
fn paths(text: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut rest = text;
    while let Some(at) = rest.find("::") {
        let head = rest[..at].rsplit(|c: char| !is_word(c)).next().unwrap_or_default();
        let mut path = vec![head.to_owned()];
        let mut tail = &rest[at..];
        while let Some(next) = tail.strip_prefix("::") {
            let word: String = next.chars().take_while(|&c| is_word(c)).collect();
            tail = &next[word.len()..];
            if word.is_empty() {
                break;
            }
            path.push(word);
        }
        if !head.is_empty() && path.len() > 1 {
            found.push(path);
        }
        rest = if tail.len() < rest[at..].len() { tail } else { &rest[at + 2..] };
    }
    found
}

/// All modules and their uses.
struct Tree<'a> {
    files: &'a BTreeMap<Module, &'a String>,
    uses: &'a BTreeMap<&'a Module, Uses>,
}

impl Tree<'_> {
    /// The files whose items the file of `module` uses.
    fn imports_of(&self, module: &Module) -> BTreeSet<String> {
        let uses = &self.uses[module];
        let mut found = BTreeSet::new();
        let mut modules: BTreeMap<&str, Module> = BTreeMap::new();
        for (path, name) in &uses.imported {
            match self.resolve(module, path, 0) {
                Some(Found::Module(target)) => _ = modules.insert(name, target),
                Some(Found::Item(file)) => _ = found.insert(file),
                None => {}
            }
        }
        for path in &uses.inline {
            let target = match modules.get(path[0].as_str()) {
                Some(alias) => self.walk(alias.clone(), &path[1..], 0),
                None => self.resolve(module, path, 0),
            };
            if let Some(Found::Item(file)) = target {
                found.insert(file);
            }
        }
        found
    }

    /// What a path in `module` leads to; `None` outside the crate.
    fn resolve(&self, module: &Module, path: &[String], depth: usize) -> Option<Found> {
        let (mut from, mut rest) = (module.clone(), path);
        match path.first()?.as_str() {
            "crate" => (from, rest) = (Vec::new(), &path[1..]),
            "self" => rest = &path[1..],
            "super" => {
                while rest.first().is_some_and(|segment| segment == "super") {
                    from.pop();
                    rest = &rest[1..];
                }
            }
            child if self.files.contains_key(&[&from[..], &[child.to_owned()]].concat()) => {}
            _ => return None,
        }
        self.walk(from, rest, depth)
    }

    /// Follows the segments of a path from a module.
    fn walk(&self, mut from: Module, path: &[String], depth: usize) -> Option<Found> {
        // Re-exports of re-exports, and no endless circle of them.
        if depth > 8 {
            return None;
        }
        let mut rest = path;
        while let Some((segment, after)) = rest.split_first() {
            let child = [&from[..], std::slice::from_ref(segment)].concat();
            if self.files.contains_key(&child) {
                (from, rest) = (child, after);
                continue;
            }
            // A module's children may use what it imports.
            let Uses { exported, imported, .. } = self.uses.get(&from)?;
            let named = exported.iter().chain(imported).find(|(_, name)| name == segment);
            if let Some((target, _)) = named {
                return match self.resolve(&from, target, depth + 1)? {
                    Found::Module(module) => self.walk(module, after, depth + 1),
                    item => Some(item),
                };
            }
            return Some(Found::Item((*self.files.get(&from)?).clone()));
        }
        Some(Found::Module(from))
    }
}

/// What a path leads to.
enum Found {
    Module(Module),
    /// An item, by the file that defines it.
    Item(String),
}
