//! The order of the modules, as a test: data flows one way.
//!
//! `src/lib.rs` lists the modules; a module uses only modules above it. Only `par` knows threads, and only
//! `simd` is unsafe. What `ARCHITECTURE.md` names exists, and it names every module.

mod imports;
mod names;
// Other systems' programs hold the functions themselves, or their names in another form.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
mod program;

use imports::{Sources, code, cycles, imports};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// The modules, in the order in which data flows through them.
const ORDER: [&str; 24] = [
    "par",
    "math",
    "simd",
    "frame",
    "control",
    "space",
    "grid",
    "sdf",
    "solid",
    "cache",
    "field",
    "mesh",
    "import",
    "export",
    "image",
    "preset",
    "job",
    "sim",
    "product",
    "scene",
    "run",
    "farm",
    "cli",
    "untrusted",
];

#[test]
fn modules_use_only_modules_above_them() {
    assert_eq!(back_edges(&sources()), Vec::<String>::new());
}

#[test]
fn no_files_import_each_other_in_a_circle() {
    assert_eq!(cycles(&imports(&sources())), Vec::<Vec<String>>::new());
}

#[test]
fn a_circle_of_imports_is_found_through_re_exports() {
    let sources: Sources = [
        ("src/a/mod.rs", "mod b;\nmod c;\npub use b::B;\npub(crate) use c::{C, D as E};\nuse b::B;\n"),
        ("src/a/b.rs", "use super::{C, E};\nfn f() {}\n#[cfg(test)]\nmod tests {\n    use crate::x::Y;\n}\n"),
        ("src/a/c.rs", "// use super::B;\npub struct C(&'static str);\n"),
        ("src/a/d.rs", "use crate::a;\nfn f() { a::B::new() }\n"),
        ("src/x.rs", "fn f() { crate::a::d::g() }\n"),
    ]
    .map(|(path, text)| (path.to_owned(), text.to_owned()))
    .into();
    assert_eq!(cycles(&imports(&sources)), Vec::<Vec<String>>::new());
    let planted = |path: &str, text: &str| {
        let mut sources = sources.clone();
        sources.insert(path.into(), text.into());
        cycles(&imports(&sources))
    };
    assert_eq!(planted("src/a/c.rs", "use super::B;\n"), [["src/a/b.rs", "src/a/c.rs"]]);
    assert_eq!(planted("src/a/b.rs", "use crate::x::Y;\n"), [["src/a/b.rs", "src/a/d.rs", "src/x.rs"]]);
}

#[test]
fn systems_and_products_are_named_in_their_folders_and_the_composition_alone() {
    assert_eq!(names::named_outside(&sources()), Vec::<String>::new());
    assert_eq!(names::needless_exceptions(&sources()), Vec::<&str>::new());
}

#[test]
fn a_system_named_elsewhere_is_found() {
    let planted = |path: &str, text: &str| {
        let mut sources = sources();
        sources.insert(path.into(), text.into());
        names::named_outside(&sources)
    };
    let words =
        |found: &[&str]| found.iter().map(|word| format!("src/job/planted.rs: {word}")).collect::<Vec<_>>();
    let job = |text: &str| planted("src/job/planted.rs", text);
    assert_eq!(job("fn f(scene: &Scene) { scene.liquid.is_some() }"), words(&["liquid"]));
    assert_eq!(job("struct SmokeReport; fn sheet_count() {}"), words(&["Smoke", "sheet"]));
    assert_eq!(job("stream.name == \"liquid\" || key == \"smoke.spacing\""), words(&["liquid", "smoke"]));
    for product in ["SurfaceMesh", "PointCache", "TracerPoints", "VolumeFile", "ColliderMeshes", "UsdStage"] {
        assert_eq!(job(&format!("make({product})")), words(&[product]));
    }
    assert_eq!(job("VolumeGrid::Density"), words(&[]));
    assert_eq!(job("// smoke\nlet text = \"no liquid in this shot\"; surface_mesh()"), words(&[]));
    assert_eq!(
        planted("src/sim/sheet/planted.rs", "fn f() { smoke() }"),
        ["src/sim/sheet/planted.rs: smoke"]
    );
    assert_eq!(planted("src/sim/coupling/planted.rs", "fn f() { smoke(sheets(), liquid()) }"), words(&[]));
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

/// The tests' profile has no debug assertions: one of our own would never run.
#[test]
fn assertions_are_in_every_build() {
    let with_debug_assertions = |sources: &Sources| -> Vec<String> {
        let is_ours =
            |text: &str| code(text).replace("command().debug_assert()", "").contains("debug_assert");
        sources.iter().filter(|(_, text)| is_ours(text)).map(|(path, _)| path.clone()).collect()
    };
    let mut sources = sources();
    assert_eq!(with_debug_assertions(&sources), Vec::<String>::new());
    sources.insert("src/planted.rs".into(), "fn f() { debug_assert!(true) }".into());
    assert_eq!(with_debug_assertions(&sources), ["src/planted.rs"]);
}

#[test]
fn only_simd_is_unsafe() {
    assert_eq!(unsafe_files(&sources()), Vec::<String>::new());
}

#[test]
fn unsafe_code_and_target_features_outside_simd_are_found() {
    let planted = |path: &str, text: &str| {
        let mut sources = sources();
        sources.insert(path.into(), text.into());
        unsafe_files(&sources).len()
    };
    assert_eq!(planted("src/space/planted.rs", "fn f() { unsafe { g() } }"), 1);
    assert_eq!(planted("src/space/planted.rs", "#[target_feature(enable = \"avx2\")]\nfn f() {}"), 1);
    assert_eq!(planted("src/space/planted.rs", "#![allow(unsafe_code)]"), 1);
    assert_eq!(planted("src/space/planted.rs", "use std::arch::x86_64::*;"), 1);
    assert_eq!(planted("src/space/planted.rs", "// unsafe\nlet unsafe_pairs = 0;"), 0);
    assert_eq!(planted("src/simd/planted.rs", "fn f() { unsafe { g() } }"), 0);
    assert_eq!(planted("src/cli/planted.rs", "fn f() { unsafe { g() } }"), 1);
}

/// The trait of an allocator is unsafe (docs/decisions/025-refused-memory.md).
const ALLOCATOR: &str = "src/cli/allocator.rs";

/// Files outside `simd` with unsafe code, vector instructions or functions for some processors only.
fn unsafe_files(sources: &Sources) -> Vec<String> {
    let words = ["unsafe", "unsafe_code", "target_feature", "arch"];
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    let has_word = |text: &str| code(text).split(|c| !is_part(c)).any(|word| words.contains(&word));
    let may_be = |path: &str| module_of(path) == Some("simd") || path == ALLOCATOR;
    let outside = sources.iter().filter(|(path, _)| !may_be(path));
    outside.filter(|(_, text)| has_word(text)).map(|(path, _)| path.clone()).collect()
}

#[test]
fn elementary_functions_have_the_same_bits_on_every_system() {
    let mut sources = sources();
    assert_eq!(system_functions(&sources), Vec::<String>::new());
    for planted in
        ["fn f(x: f32) { x.sin() }", "fn f() { map(f64::exp) }", "fn f(x: f32) { x\n    .powf(2.0) }"]
    {
        sources.insert("src/planted.rs".into(), planted.into());
        assert_eq!(system_functions(&sources), ["src/planted.rs"], "{planted}");
    }
}

/// Files whose `exp` is that of lanes, which `simd` computes itself.
const LANE_EXPONENTIALS: [&str; 2] = ["src/sim/vortex/flow/gaussian_sums.rs", "src/sim/vortex/kernels.rs"];

/// Files that call functions of the system's mathematical library; `math::elementary` has them all.
fn system_functions(sources: &Sources) -> Vec<String> {
    let names = "sin cos tan sin_cos exp exp2 ln log10 log2 powf atan2 atan acos asin sinh cosh tanh cbrt hypot exp_m1 ln_1p \
                 asinh acosh atanh gamma ln_gamma erf erfc from_euler_angles angle_to slerp try_slerp";
    let is_one = |path: &str, name: &str| {
        names.split_whitespace().any(|one| one == name)
            && !(name == "exp" && LANE_EXPONENTIALS.contains(&path))
    };
    let calls = |path: &str, text: &str| {
        let text: String = code(text).split_whitespace().collect();
        let methods = text.split('.').skip(1).filter_map(|rest| rest.split_once('(')).map(|(name, _)| name);
        let paths = ["f32::", "f64::", "Rotation3::", "UnitQuaternion::"]
            .into_iter()
            .flat_map(|kind| text.split(kind).skip(1))
            .map(|rest| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next().unwrap_or_default());
        methods.chain(paths).any(|name| is_one(path, name))
    };
    let is_test = |path: &str| path.ends_with("tests.rs") || path.contains("/tests/");
    let outside = sources.iter().filter(|(path, _)| module_of(path) != Some("simd") && !is_test(path));
    outside.filter(|(path, text)| calls(path, text)).map(|(path, _)| path.clone()).collect()
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
    assert_eq!(
        planted("src/grid/planted.rs", "use crate::{math::Vec3, mesh::{Mesh, check}, cache::Lock};"),
        (2, 0)
    );
    assert_eq!(planted("src/grid/planted.rs", "fn f() { crate::sim::x() }"), (1, 0));
    assert_eq!(planted("src/grid/planted.rs", "use super::super::mesh::Mesh;"), (1, 0));
    assert_eq!(planted("src/grid/planted.rs", "// use crate::mesh::Mesh;\nuse crate::par;"), (0, 0));
    assert_eq!(planted("src/extra/mod.rs", ""), (0, 1));
    assert_eq!(planted("src/extra.rs", ""), (0, 1));
}

/// Every import of a module below the importing one.
fn back_edges(sources: &Sources) -> Vec<String> {
    let place = |path: &str| ORDER.iter().position(|&name| Some(name) == module_of(path));
    let mut found = Vec::new();
    for (path, targets) in imports(sources) {
        for target in targets {
            if place(&target) > place(&path) && place(&path).is_some() {
                found.push(format!("{path} imports {target}"));
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
    fn declaration(line: &str) -> Option<&str> {
        line.trim_start_matches("pub ").strip_prefix("mod ")?.strip_suffix(';')
    }
    let declared: Vec<&str> = library.lines().filter_map(declaration).collect();
    if declared != ORDER {
        found.push(format!("src/lib.rs declares {declared:?}"));
    }
    found
}

/// The module a source file belongs to; none for `lib.rs` and `main.rs`.
fn module_of(path: &str) -> Option<&str> {
    let inside = path.strip_prefix("src/")?;
    match inside.split_once('/') {
        Some((module, _)) => Some(module),
        None => inside.strip_suffix(".rs").filter(|name| !["lib", "main"].contains(name)),
    }
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

/// The largest number of existing source files that a new system may change.
const MAX_CHANGED_FILES: usize = 5;

#[test]
fn adding_a_system_changes_at_most_five_existing_source_files() {
    let path = root().join("docs/adding-a-system.patch");
    let patch = fs::read_to_string(&path).unwrap();
    let changed: Vec<&str> = patch
        .lines()
        .filter_map(|line| line.strip_prefix("--- a/"))
        .filter(|file| file.starts_with("src/"))
        .collect();
    assert!(!changed.is_empty() && changed.len() <= MAX_CHANGED_FILES, "{changed:?}");
    let guide = fs::read_to_string(root().join("docs/adding-a-system.md")).unwrap();
    for file in changed {
        assert!(guide.contains(&format!("| `{file}` |")), "docs/adding-a-system.md does not list {file}");
    }
    let applied = std::process::Command::new("git")
        .args(["apply", "--check"])
        .arg(&path)
        .current_dir(root())
        .output()
        .unwrap();
    let why = String::from_utf8_lossy(&applied.stderr).into_owned();
    assert!(applied.status.success(), "docs/adding-a-system.patch does not apply: {why}");
}
