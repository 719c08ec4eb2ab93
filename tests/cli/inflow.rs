//! Emitters, outflows and open domains on the command line.

use super::*;

const TAP: &str = r#"
title = "Tap"
frames = "1-7"

[[world.collider]]
shape = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }

[liquid]
spacing = 0.05
channels = ["age", "source"]

[[liquid.emitter]]
shape = { disc = { center = [0, 0, 0.5], normal = [0, 0, -1], radius = 0.13 } }
rate = "60 L/s"
on = [{ start = 2, end = 5 }]

[liquid.domain]
min = [-0.3, -0.3, -0.1]
max = [0.3, 0.3, 1]
open = ["x_min", "x_max", "y_min"]

[output]
mesh = ["ply"]
"#;

#[test]
fn the_example_of_the_docs_runs() {
    let desk = Desk::new();
    let docs = include_str!("../../docs/liquid.md");
    let section = docs.split("## Inflow and outflow").nth(1).expect("the section is there");
    let example =
        section.split("```toml\n").nth(1).and_then(|text| text.split("```").next()).expect("an example");
    desk.write("tap.toml", example);
    let (_, talk) = desk.run("shot tap.toml -o tap", 0);
    assert!(!talk.contains("not emitted") && !talk.contains("not open"), "{talk}");
    let (out, _) = desk.run("info tap", 0);
    let line = out.lines().find(|line| line.starts_with("particles  0 at the start")).expect("the balance");
    assert!(line.contains(" emitted - ") && !line.contains("no balance"), "{line}");
    assert!(!line.contains("- 0 removed"), "the drain removes some: {line}");
}

#[test]
fn a_tap_resumes_in_the_middle_with_the_same_bytes_on_any_number_of_threads() {
    let desk = Desk::new();
    desk.write("tap.toml", TAP);
    desk.run("shot tap.toml -o whole --threads 1", 0);
    desk.run("simulate tap.toml -o parts --frames 1-3 --threads 3", 0);
    desk.run("shot tap.toml -o parts --threads 2", 0);
    assert_eq!(desk.bytes("whole/cache"), desk.bytes("parts/cache"));
    assert_eq!(desk.bytes("whole/mesh"), desk.bytes("parts/mesh"));
    // The first two frames have no particles, and a mesh all the same.
    assert_eq!(desk.names("whole/mesh").len(), 7);
    desk.run("verify whole", 0);
    let (out, _) = desk.run("info whole --json", 0);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    let flow = &info["liquid_flow"];
    let number = |key: &str| flow[key].as_u64().unwrap();
    assert_eq!(number("initial"), 0);
    assert_eq!(number("emitted"), number("removed") + number("left_by_accident") + number("present"));
    // 60 L/s for three frames.
    let litres = number("emitted") as f64 * 0.125;
    assert!((litres - 7.5).abs() < 1.5, "{litres} L");
}

#[test]
fn the_plan_counts_what_will_be_emitted() {
    let desk = Desk::new();
    desk.write("tap.toml", TAP);
    let (out, _) = desk.run("shot tap.toml -o none --dry-run", 0);
    assert!(out.contains("0 to ") || out.contains("particles"), "{out}");
    let (out, _) = desk.run("plan tap.toml --json", 0);
    let plan: serde_json::Value = serde_json::from_str(&out).unwrap();
    let count = &plan["systems"][0]["counts"][0];
    let end = count["end"].as_f64().unwrap();
    assert!(count["start"] == 0.0 && (50.0..75.0).contains(&end), "{count}");
}

#[test]
fn a_point_cache_of_a_liquid_is_refused() {
    let desk = Desk::new();
    desk.write("tap.toml", TAP);
    desk.run("simulate tap.toml -o tap", 0);
    let (_, talk) = desk.run("export tap --format pc2 -o out", 2);
    assert!(talk.contains("sheets"), "{talk}");
}

#[test]
fn faults_of_emitters_are_named_with_their_place() {
    let desk = Desk::new();
    let disc = "shape = { disc = { center = [0, 0, 0.5], normal = [0, 0, -1], radius = 0.13 } }";
    let ball = "shape = { sphere = { center = [0, 0, 0.5], radius = 0.13 } }";
    for (table, words) in [
        (disc.to_owned(), "has no flow"),
        (format!("{ball}\nrate = 1"), "has no direction"),
        (format!("{disc}\nvelocity = [0, 0, -1]\nrate = 1"), "exclude each other"),
        (format!("{disc}\nvelocity = [0, 0, -1]\ndirection = [0, 0, -1]"), "exclude each other"),
        (format!("{disc}\nvelocity = [0, 0, 0]"), "has length zero"),
        (format!("{disc}\nrate = -1"), "at least 0"),
        (format!("{disc}\nrate = nan"), "rate"),
        (format!("{disc}\nrate = 1\non = [{{ start = 5, end = 5 }}]"), "is empty"),
        (format!("{disc}\nrate = 1\non = [{{ start = 5 }}, {{ start = 8 }}]"), "overlap or do not ascend"),
        (
            format!("{disc}\nrate_keyframes = [{{ frame = 3, rate = 1 }}, {{ frame = 3, rate = 2 }}]"),
            "do not ascend",
        ),
        (
            "shape = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }\nvelocity = [0, 0, 1]".into(),
            "unbounded",
        ),
        ("shape = { mesh = { file = 'none.ply' } }\nvelocity = [0, 0, 1]".into(), "none.ply"),
        (format!("{disc}\nrate = 1e30"), "more than the solver can number"),
    ] {
        desk.write(
            "bad.toml",
            format!("title = 't'\nframes = '1-9'\n[liquid]\nspacing = 0.05\n[[liquid.emitter]]\n{table}\n"),
        );
        let (_, talk) = desk.run("simulate bad.toml -o bad", 2);
        assert!(talk.contains(words) && talk.contains("bad.toml"), "{table}: {talk}");
    }
    for (table, words) in [
        ("[[liquid.outflow]]\nshape = { box = { min = [0, 0, 0], max = [1, 0, 1] } }", "is not a shape"),
        (
            "[[liquid.outflow]]\nshape = { disc = { center = [0, 0, 0], normal = [0, 0, 1], radius = 1 } }",
            "thickness",
        ),
        ("[liquid.domain]\nmin = [0, 0, 0]\nmax = [1, -1, 1]", "`max` is not above `min` on the y axis"),
        ("[liquid.domain]\nmin = [0, 0, 0]\nmax = [1, 1, 1]\nopen = ['left']", "x_min"),
    ] {
        desk.write("bad.toml", format!("{TAP}\n").replace("[output]", &format!("{table}\n[output]")).replacen("[liquid.domain]\nmin = [-0.3, -0.3, -0.1]\nmax = [0.3, 0.3, 1]\nopen = [\"x_min\", \"x_max\", \"y_min\"]\n", "", 1));
        let (_, talk) = desk.run("simulate bad.toml -o bad", 2);
        assert!(talk.contains(words), "{table}: {talk}");
    }
}

#[test]
fn nozzles_that_cannot_deliver_are_reported_at_the_start_and_in_each_frame() {
    let desk = Desk::new();
    for (change, start, frame) in [
        (
            "shape = { sphere = { center = [0, 0, 0.5], radius = 0.3 } }",
            "the liquid of all its columns begins in a collider",
            "their place was in a solid",
        ),
        (
            "shape = { plane = { point = [0, 0, 0.46], normal = [0, 0, 1] } }",
            "directed at a collider",
            "left a nozzle early",
        ),
    ] {
        desk.write(
            "bad.toml",
            TAP.replacen("shape = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }", change, 1),
        );
        let (_, talk) = desk.run("simulate bad.toml -o bad --force", 0);
        assert!(talk.contains(start) && talk.contains(frame), "{change}: {talk}");
    }
    for (set, words) in [
        ("liquid.max_substeps=8 --set liquid.emitter.0.rate=6", "is faster"),
        ("liquid.emitter.0.shape.disc.radius=0.01", "in 1 particle,"),
        ("liquid.domain.max=[0.3,0.3,0.4]", "begins in an outflow or outside of the domain"),
    ] {
        desk.write("tap.toml", TAP);
        let (_, talk) = desk.run(&format!("simulate tap.toml -o {} --force --set {set}", words.len()), 0);
        assert!(talk.contains(words), "{set}: {talk}");
    }
}
