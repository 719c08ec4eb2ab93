//! Speed against accuracy of sheets on a small shot.

use super::*;
use serde_json::Value;

/// A cloth of 49 points, hung at two corners.
const HUNG: &str = r#"
title = "Hung cloth"
frames = "1-6"

[[sheet]]
name = "cloth"
shape = { grid = { origin = [0, 0, 0], first = [0.6, 0, 0], second = [0, 0.6, 0], cells = [6, 6] } }
density = 0.2
stiffness = [100, 100]
shear = 20
damping = 1
pin = [{ at = { nearest = [0, 0.6, 0] } }, { at = { nearest = [0.6, 0.6, 0] } }]

[output]
sheet = ["pc2"]

[quality.draft]
sheets.solver.courant = 0.9
"#;

const LINE: &str = "tradeoff hung.toml --vary sheets.solver.courant=0.9,0.3 --frames 1-4 -o t";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("hung.toml", HUNG);
    desk
}

fn table(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.run(&format!("{line} --json"), 0).0).unwrap()
}

fn line(table: &Value, label: &str) -> Value {
    let lines = table["lines"].as_array().unwrap();
    lines.iter().find(|line| line["label"].as_str().unwrap().contains(label)).expect(label).clone()
}

fn distance(line: &Value, key: &str) -> f64 {
    line["apart"][key].as_f64().unwrap_or_else(|| panic!("{key}: {line}"))
}

#[test]
fn a_table_a_plot_and_a_preset_come_out_of_sheets() {
    let desk = desk();
    let (out, talk) = desk.run(&format!("{LINE} --dev 50% --write best.toml"), 0);
    for word in [
        "as written",
        "courant=0.9",
        "courant=0.3",
        "reference",
        "front",
        "certainty",
        "strain",
        "farthest",
        "use ",
    ] {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(talk.contains("Progress: 100%"), "{talk}");
    assert_eq!(fs::read_to_string(desk.path("t/tradeoff.csv")).unwrap().lines().count(), 1 + 3 + 2);
    assert!(fs::read_to_string(desk.path("t/tradeoff.html")).unwrap().contains("<svg"));
    desk.run("simulate best.toml --frames 1-2", 0);
    let best = fs::read_to_string(desk.path("best.toml")).unwrap();
    // Which of the three is the fastest is a matter of the clock; the preset that is written is the setting that it names.
    let setting = best.split_once("# Setting: ").unwrap().1.split(". distance ").next().unwrap();
    assert!(out.contains(setting), "{setting}\n{out}");
    let courant = setting.strip_prefix("courant=").map(|value| format!("\ncourant = {value}\n"));
    assert!(courant.map_or(setting == "as written", |line| best.contains(&line)), "{best}");

    // What is kept gives the same table to the last digit, and a further value runs alone.
    let first = table(&desk, LINE);
    assert_eq!(first, table(&desk, LINE));
    let (_, talk) = desk.run(&LINE.replace("0.9,0.3", "0.9,0.3,0.6"), 0);
    assert_eq!(talk.matches("was there").count(), 5, "{talk}");
}

#[test]
fn errors_grow_with_the_requested_tolerance() {
    let desk = desk();
    let vary = "sheets.solver.integrator+sheets.solver.substeps=symplectic+8,implicit+2,implicit+32";
    let found = table(&desk, &format!("tradeoff hung.toml --vary {vary} --frames 1-6 -o t"));
    let [exact, rough, fine] = ["as written", "substeps=2", "substeps=32"].map(|label| line(&found, label));
    for key in ["distance", "farthest", "energy"] {
        // First order: a sixteenth of the step has clearly less than a quarter of the error.
        assert!(distance(&fine, key) < 0.25 * distance(&rough, key), "{key}: {fine} {rough}");
        assert!(distance(&exact, key) < distance(&fine, key), "{key}: {exact} {fine}");
    }
    assert!(distance(&rough, "farthest") > distance(&rough, "distance"));
    assert!(rough["iterations"].as_f64().unwrap() > 1.0 && exact["iterations"].as_f64() == Some(0.0));
    let floor = &found["uncertainty"]["distance"].as_f64().unwrap();
    assert!(*floor < 0.5 * distance(&fine, "distance"), "{floor}");
    // What the integrator does not read makes no row of its own; what changes nothing is reported.
    let found = table(&desk, "tradeoff hung.toml --vary sheets.solver.substeps=8,16 --frames 1-2 -o t");
    assert_eq!(found["lines"].as_array().unwrap().len(), 1, "{found}");
    let found =
        table(&desk, "tradeoff hung.toml --vary sheets.solver.max_substeps=5000,6000 --frames 1-2 -o t");
    assert_eq!(found["lines"][2]["same_as"].as_u64(), Some(0), "{found}");
}

#[test]
fn cells_are_compared_at_the_same_points_of_the_cloth() {
    let desk = desk();
    let vary = "sheet.0.shape.grid.cells=[3,3],[6,6],[12,12]";
    let found = table(&desk, &format!("tradeoff hung.toml --vary {vary} --frames 1-6 -o t"));
    let [coarse, middle, fine] =
        ["cells=[3,3]", "cells=[6,6]", "cells=[12,12]"].map(|label| line(&found, label));
    assert_eq!(
        [&coarse, &middle, &fine].map(|line| line["points"].as_u64()),
        [Some(16), Some(49), Some(169)]
    );
    // Finer cells are nearer to the reference, which has one and a half times as many a side as the finest.
    let errors = [&coarse, &middle, &fine].map(|line| distance(line, "distance"));
    assert!(errors[1] < 0.7 * errors[0] && errors[2] < 0.7 * errors[1], "{errors:?}");
    assert_eq!(found["reference"]["points"].as_u64(), Some(19 * 19));
    assert_eq!(found["refined"]["points"].as_u64(), Some(28 * 28));
}

#[test]
fn every_knob_is_swept_by_itself_if_none_is_named() {
    let desk = desk();
    let (out, _) = desk.run("tradeoff hung.toml --dry-run --tiers", 0);
    for word in [
        "12 runs",
        "integrator=symplectic courant=0.25",
        "integrator=implicit substeps=32",
        "integrator=implicit tolerance=0.01",
        "cells=[3, 3]  (16 points)",
        "cells=[5, 5]  (36 points)",
        "sheets.solver.courant=0.125",
        "sheets.solver.max_substeps=1000000",
        "sheet.0.shape.grid.cells=[9, 9]",
        "sheet.0.shape.grid.cells=[14, 14]",
    ] {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(!desk.path("hung-tradeoff").exists());
    // Points that are named by number would be others.
    desk.write("hung.toml", HUNG.replace("{ nearest = [0, 0.6, 0] }", "{ points = [42] }"));
    assert!(!desk.run("tradeoff hung.toml --dry-run", 0).0.contains("cells="));
    for (line, word) in [
        ("tradeoff hung.toml --vary surface.voxel=0.5", "does not change a sheet"),
        ("tradeoff hung.toml --by density", "distance, farthest, energy"),
        ("tradeoff hung.toml --of smoke", "no smoke"),
        ("tradeoff small.toml --of sheets", "no sheets"),
        ("tradeoff small.toml --by farthest", "density, energy"),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains(word), "{line}: {talk}");
    }
}

#[test]
fn a_shot_with_a_liquid_compares_its_sheets_on_request() {
    let desk = desk();
    let sheet = &HUNG[HUNG.find("[[sheet]]").unwrap()..HUNG.find("[output]").unwrap()];
    desk.write("both.toml", SMALL.replace("[output]", &format!("{sheet}\n[output]")));
    let line = "tradeoff both.toml --of sheets --vary sheets.solver.courant=0.9 --frames 1-2 -o t";
    let (out, _) = desk.run(&format!("{line} --write new.toml --dev 100%"), 0);
    assert!(out.contains("strain") && out.contains("courant=0.9"), "{out}");
    assert!(fs::read_to_string(desk.path("new.toml")).unwrap().contains("[liquid]"));
    let (out, _) = desk.run("tradeoff both.toml --dry-run", 0);
    assert!(out.contains("iterations=") && !out.contains("courant"), "{out}");
}

#[test]
fn sheets_that_diverge_are_a_row() {
    let desk = desk();
    let vary = "--vary sheet.0.stiffness=[100,100],[1e9,1e9] --reference sheets.solver.courant=0.2";
    let (out, _) = desk.run(
        &format!("tradeoff hung.toml {vary} --set sheets.solver.max_substeps=2000 --frames 1-3 -o t"),
        0,
    );
    assert!(out.contains("diverged    2: frame 000") && out.contains("substeps"), "{out}");
}
