//! The order of the modules, as a test: data flows one way.
//!
//! `src/lib.rs` lists the modules; a module uses only modules above it. Only `par` knows threads. What
//! `ARCHITECTURE.md` names exists, and it names every module.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

/// The modules, in the order in which data flows through them.
const ORDER: [&str; 19] = [
    "par", "math", "frame", "control", "space", "grid", "sdf", "solid", "cache", "field", "mesh", "import",
    "export", "preset", "job", "sim", "scene", "run", "cli",
];

/// Source text by path below the project's root.
type Sources = BTreeMap<String, String>;

#[test]
fn modules_use_only_modules_above_them() {
    assert_eq!(back_edges(&sources()), Vec::<String>::new());
}

#[test]
fn every_module_is_listed_in_order() {
    assert_eq!(unlisted(&sources()), Vec::<String>::new());
}

#[test]
fn only_par_knows_threads() {
    let offenders: Vec<_> = sources()
        .iter()
        .filter(|(path, _)| module_of(path) != Some("par"))
        .filter(|(_, text)| ["rayon::", "std::thread"].iter().any(|word| code(text).contains(word)))
        .filter(|(path, _)| !WATCHERS.contains(&path.as_str()))
        .map(|(path, _)| path.clone())
        .collect();
    assert_eq!(offenders, Vec::<String>::new());
}

/// Files outside `par` that may start a thread, because what they do is waiting and not computing.
const WATCHERS: [&str; 2] = ["src/cli/interrupt.rs", "src/cli/progress.rs"];

#[test]
fn the_architecture_page_names_what_exists() {
    let page = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let named: Vec<&str> = page.split('`').skip(1).step_by(2).collect();
    let paths = named.iter().filter(|name| {
        ["src/", "docs/", "tests/", "tools/", "presets/", "benches/"].iter().any(|top| name.starts_with(top))
    });
    for path in paths {
        assert!(root().join(path).exists(), "ARCHITECTURE.md names `{path}`, which does not exist");
    }
    for module in ORDER {
        let folder = format!("src/{module}/");
        assert!(named.contains(&folder.as_str()), "ARCHITECTURE.md does not name `{folder}`");
    }
}

#[test]
fn a_back_edge_and_an_unlisted_module_are_found() {
    let planted = |path: &str, text: &str| {
        let mut sources = sources();
        sources.insert(path.into(), text.into());
        (back_edges(&sources).len(), unlisted(&sources).len())
    };
    assert_eq!(planted("src/grid/planted.rs", "use crate::mesh::Mesh;"), (1, 0));
    assert_eq!(planted("src/grid/planted.rs", "use crate::{math::Vec3, run::{a, b}, cli};"), (2, 0));
    assert_eq!(planted("src/grid/planted.rs", "fn f() { crate::sim::x() }"), (1, 0));
    assert_eq!(planted("src/grid/planted.rs", "use super::super::mesh::Mesh;"), (1, 0));
    assert_eq!(planted("src/grid/planted.rs", "// use crate::mesh::Mesh;\nuse crate::par;"), (0, 0));
    assert_eq!(planted("src/extra/mod.rs", ""), (0, 1));
    assert_eq!(planted("src/extra.rs", ""), (0, 1));
}

/// Every use of a module that stands below the user.
fn back_edges(sources: &Sources) -> Vec<String> {
    let place = |module: &str| ORDER.iter().position(|&name| name == module);
    let mut found = Vec::new();
    for (path, text) in sources {
        let Some(user) = module_of(path).and_then(place) else { continue };
        let code = code(text);
        for used in used_modules(&code).iter().filter_map(|name| place(name)) {
            if used > user {
                found.push(format!("{path} uses {}", ORDER[used]));
            }
        }
    }
    found
}

/// Modules that the list lacks, and listed ones that `lib.rs` has in another order.
fn unlisted(sources: &Sources) -> Vec<String> {
    let mut found: Vec<String> = sources
        .keys()
        .filter_map(|path| module_of(path))
        .filter(|module| !ORDER.contains(module))
        .map(|module| format!("src/{module} is not listed"))
        .collect();
    found.dedup();
    let library = code(&sources["src/lib.rs"]);
    let declared: Vec<&str> =
        library.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    if declared != ORDER {
        found.push(format!("src/lib.rs declares {declared:?}"));
    }
    found
}

/// The names that follow `crate::` or `super::`, directly or in a group.
fn used_modules(code: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (at, root) in code.match_indices("crate::").chain(code.match_indices("super::")) {
        let rest = code[at + root.len()..].trim_start();
        match rest.strip_prefix('{') {
            None => found.push(first_word(rest)),
            Some(group) => {
                let mut depth = 0;
                let mut item = String::new();
                for c in group.chars() {
                    match c {
                        '}' if depth == 0 => break,
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        ',' if depth == 0 => found.push(first_word(&std::mem::take(&mut item))),
                        _ => {}
                    }
                    if c != ',' || depth > 0 {
                        item.push(c);
                    }
                }
                found.push(first_word(&item));
            }
        }
    }
    found
}

fn first_word(text: &str) -> String {
    text.trim_start().chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

/// The module a source file belongs to; none for `lib.rs` and `main.rs`.
fn module_of(path: &str) -> Option<&str> {
    let inside = path.strip_prefix("src/")?;
    match inside.split_once('/') {
        Some((module, _)) => Some(module),
        None => inside.strip_suffix(".rs").filter(|name| !["lib", "main"].contains(name)),
    }
}

/// The text without its line comments.
fn code(text: &str) -> String {
    text.lines().map(|line| line.split("//").next().unwrap_or("")).collect::<Vec<_>>().join("\n")
}

fn sources() -> Sources {
    let mut found = Sources::new();
    collect(&root().join("src"), &mut found);
    found
}

fn collect(folder: &Path, found: &mut Sources) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let name = path.strip_prefix(root()).unwrap().to_str().unwrap().replace('\\', "/");
            found.insert(name, fs::read_to_string(&path).unwrap());
        }
    }
}

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}
