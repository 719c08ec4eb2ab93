//! What a command line owes its users: help, completions, man pages, a report on the machine.

use super::*;

#[test]
fn completions_know_every_verb() {
    let place = Desk::new();
    for (shell, flag) in [("bash", "--max-memory"), ("zsh", "--max-memory"), ("fish", "max-memory")] {
        let (script, talk) = place.run(&format!("completions {shell}"), 0);
        assert!(talk.is_empty(), "{talk}");
        for word in ["tradeoff", "whitewater", "doctor", flag] {
            assert!(script.contains(word), "{shell}: {word}");
        }
    }
    let (_, talk) = place.run("completions tcsh", 2);
    assert!(talk.contains("possible values: bash"), "{talk}");
}

#[test]
fn man_pages_are_written_for_every_verb() {
    let place = Desk::new();
    let (page, _) = place.run("man", 0);
    assert!(page.contains(".TH meniscus 1") && page.contains("130 interrupted"), "{page}");
    place.run("man -o man/man1", 0);
    let names = place.names("man/man1");
    for name in ["meniscus.1", "meniscus-mesh.1", "meniscus-presets-copy.1"] {
        assert!(names.iter().any(|known| known == name), "{names:?}");
    }
    let mesh = String::from_utf8(fs::read(place.path("man/man1/meniscus-mesh.1")).unwrap()).unwrap();
    assert!(mesh.contains("By default all that are present"), "the long help: {mesh}");
    assert!(
        mesh.contains("\\fBmeniscus mesh\\fR") || mesh.contains("meniscus mesh"),
        "what is typed: {mesh}"
    );
    place.write("file", "");
    let (_, talk) = place.run("man -o file", 1);
    assert!(talk.contains("file") && talk.contains("name a folder"), "{talk}");
}

#[test]
fn the_doctor_reports_the_machine_and_refuses_a_folder_without_writing() {
    let place = Desk::new();
    let (report, _) = place.run("doctor", 0);
    for line in ["program", "processor", "memory", "limits", "disk", "terminal", "problems"] {
        assert!(report.lines().any(|text| text.starts_with(line)), "{line}: {report}");
    }
    assert!(fs::read_dir(place.path(".")).unwrap().count() == 1, "the preset alone: {:?}", place.names("."));
    let (json, _) = place.run("doctor --json --threads 1", 0);
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(found["processor"]["threads"], 1);
    assert!(found["folder"]["write_speed"].as_f64().unwrap() > 0.0 && found["problems"].is_array(), "{json}");

    let (report, talk) = place.run("doctor absent", 1);
    assert!(report.contains("stops every shot") && talk.contains("cannot be written"), "{report}\n{talk}");
}

#[test]
fn the_environment_sets_the_threads_and_is_checked() {
    let place = Desk::new();
    let threads = |value: &str| {
        let output = place.tool("doctor --json").env("MENISCUS_THREADS", value).output().unwrap();
        (output.status.code(), output)
    };
    let (code, output) = threads("1");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((code, &found["processor"]["threads"]), (Some(0), &1.into()));
    let (code, output) = threads("many");
    let talk = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(code == Some(2) && talk.contains("--threads"), "{talk}");
}

#[test]
fn the_short_help_leaves_out_what_the_long_one_explains() {
    let place = Desk::new();
    let (short, _) = place.run("-h", 0);
    let (long, _) = place.run("--help", 0);
    assert!(!short.contains("Exit codes") && long.contains("Exit codes"), "{short}");
    for verb in ["shot", "mesh", "volume", "tradeoff", "wedge"] {
        let lines = |flag| place.run(&format!("{verb} {flag}"), 0).0.lines().count();
        assert!(lines("-h") * 2 <= lines("--help"), "{verb}: {} and {}", lines("-h"), lines("--help"));
    }
}
