//! Commands of documents that are not run, with the reason, and what is checked of them instead.

use super::{
    block::{Command, root, words},
    reader::Reader,
};
use std::fs;

/// What is checked of a command that is not run.
#[derive(Clone, Copy, Debug)]
pub(super) enum Check {
    /// The program runs it with `--dry-run`: the preset, its keys and the arguments are right.
    DryRun,
    /// The program parses it: verb, flags and values are right.
    Parse,
    /// The script is there, and names the flags.
    Script,
    /// Cargo's profile, benchmark, example or test is there; what follows `--` is run with `--dry-run`.
    Cargo,
    /// The files that it names are there.
    Files,
}

/// Commands of a document that are not run.
pub(super) struct Checked {
    pub(super) document: &'static str,
    /// How the commands begin.
    pub(super) start: &'static str,
    /// How many there are.
    pub(super) count: usize,
    pub(super) check: Check,
    pub(super) why: &'static str,
}

const fn checked(
    document: &'static str,
    start: &'static str,
    count: usize,
    check: Check,
    why: &'static str,
) -> Checked {
    Checked { document, start, count, check, why }
}

const MILLION: &str = "simulates a million particles: half an hour";
const AS_WRITTEN: &str = "simulates as many particles as the preset has as written: minutes";
const SEVERAL_RUNS: &str = "runs the shot once for each setting: minutes";
const BENCH: &str = "measures: minutes to hours, on an idle machine";
const BUILD: &str = "compiles for minutes";

/// Every command of README.md and docs/ that is not run.
pub(super) const CHECKED: &[Checked] = &[
    checked("README.md", "cargo install", 1, Check::Cargo, BUILD),
    checked("README.md", "meniscus tradeoff", 1, Check::DryRun, SEVERAL_RUNS),
    checked("docs/adding-a-system.md", "git apply", 1, Check::Files, "tools/soak/adding_a_system runs it"),
    checked(
        "docs/adding-a-system.md",
        "MENISCUS_BLESS=1 cargo",
        1,
        Check::Cargo,
        "tools/soak/adding_a_system runs it",
    ),
    checked("docs/adding-a-system.md", "cargo run", 1, Check::Cargo, "tools/soak/adding_a_system runs it"),
    checked("docs/benchmarks.md", "tools/bench/", 3, Check::Script, BENCH),
    checked("docs/build.md", "cargo build", 3, Check::Cargo, BUILD),
    checked("docs/build.md", "tools/test", 1, Check::Script, "runs these tests"),
    checked("docs/build.md", "tools/soak/run", 1, Check::Script, "runs for hours"),
    checked("docs/eikonal.md", "tools/bench/", 1, Check::Script, BENCH),
    checked("docs/eikonal.md", "meniscus tradeoff", 1, Check::DryRun, SEVERAL_RUNS),
    checked("docs/eikonal.md", "cargo bench", 1, Check::Cargo, BENCH),
    checked("docs/gallery.md", "meniscus shot figure-drop", 1, Check::DryRun, MILLION),
    checked("docs/gallery.md", "meniscus shot crown-splash", 1, Check::DryRun, MILLION),
    checked("docs/liquid.md", "meniscus shot dam-break", 2, Check::DryRun, AS_WRITTEN),
    checked("docs/paper.md", "tools/bench/", 2, Check::Script, BENCH),
    checked("docs/paper.md", "meniscus simulate", 29, Check::DryRun, AS_WRITTEN),
    checked("docs/stability.md", "cargo build", 1, Check::Cargo, BUILD),
    checked("docs/stability.md", "python3 tools/bench/", 1, Check::Script, BENCH),
    checked("docs/tiers.md", "meniscus shot", 2, Check::DryRun, AS_WRITTEN),
    checked("docs/tiers.md", "meniscus tradeoff", 1, Check::DryRun, SEVERAL_RUNS),
    checked("docs/tradeoff.md", "meniscus tradeoff", 24, Check::DryRun, SEVERAL_RUNS),
    checked("docs/vortices.md", "cargo bench", 1, Check::Cargo, BENCH),
    checked("docs/vortices.md", "tools/bench/", 1, Check::Script, BENCH),
    checked("docs/vortices.md", "meniscus tradeoff", 1, Check::DryRun, SEVERAL_RUNS),
];

/// The entry of a command that is not run.
pub(super) fn find(document: &str, command: &Command) -> Option<usize> {
    CHECKED.iter().position(|entry| entry.document == document && command.text.starts_with(entry.start))
}

/// Checks a command that is not run.
pub(super) fn check(reader: &Reader, place: &str, command: &str, check: Check) {
    match check {
        Check::DryRun => {
            let flag = if command.ends_with(" --dry-run") { "" } else { " --dry-run" };
            reader.expect(place, &format!("{command}{flag}"), 0);
        }
        Check::Parse => drop(reader.expect(place, &format!("{command} --help"), 0)),
        Check::Script => check_script(place, &words(command)),
        Check::Cargo => check_cargo(reader, place, &words(command)),
        Check::Files => {
            let words = words(command);
            let files = words.iter().filter(|word| word.contains('/'));
            assert!(files.clone().count() > 0, "{place}: no file in {command}");
            files.for_each(|file| assert!(root().join(file).exists(), "{place}: {file} is missing"));
        }
    }
}

/// The script is there, and its text has the flags.
fn check_script(place: &str, words: &[String]) {
    let script =
        words.iter().position(|word| word.starts_with("tools/")).expect("a script of the repository");
    let text = fs::read_to_string(root().join(&words[script])).unwrap_or_else(|why| panic!("{place}: {why}"));
    for flag in words[script + 1..].iter().filter(|word| word.starts_with("--")) {
        let flag = flag.split('=').next().expect("it has a start");
        let is_known = [format!("\"{flag}\""), format!(" {flag} "), format!("{flag})")]
            .iter()
            .any(|at| text.contains(at));
        assert!(is_known, "{place}: {} has no {flag}", words[script]);
    }
}

/// The verb is one of cargo's, and what it names is in Cargo.toml; arguments of the program are right.
fn check_cargo(reader: &Reader, place: &str, words: &[String]) {
    let manifest = fs::read_to_string(root().join("Cargo.toml")).unwrap();
    let cargo = words.iter().position(|word| word == "cargo").expect("cargo");
    let own = words.iter().position(|word| word == "--").unwrap_or(words.len());
    let verb = words[cargo + 1].as_str();
    assert!(["bench", "build", "doc", "install", "run", "test"].contains(&verb), "{place}: cargo {verb}");
    let mut own_words = words[cargo + 2..own].iter();
    while let Some(word) = own_words.next() {
        let mut value = || own_words.next().unwrap_or_else(|| panic!("{place}: {word} has no value"));
        match word.as_str() {
            "--release" | "--open" => {}
            "--path" => drop(value()),
            "--profile" => {
                let heading = format!("[profile.{}]", value());
                assert!(manifest.contains(&heading), "{place}: Cargo.toml has no {heading}");
            }
            "--bench" | "--example" => {
                let folder = if word == "--bench" { "benches" } else { "examples" };
                let file = format!("{folder}/{}.rs", value());
                assert!(root().join(&file).exists(), "{place}: {file} is missing");
            }
            filter => assert!(verb == "test" && !filter.starts_with('-'), "{place}: cargo {verb} {filter}"),
        }
    }
    if own < words.len() {
        let arguments: Vec<String> = words[own + 1..].iter().map(|word| format!("'{word}'")).collect();
        check(reader, place, &format!("meniscus {}", arguments.join(" ")), Check::Parse);
    }
}
