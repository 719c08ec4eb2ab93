//! Speed against accuracy of smoke on a small shot.

use super::*;
use serde_json::Value;

/// A ring of a few hundred vortons.
const RING: &str = r#"
title = "Small ring"
frames = "1-6"

[smoke]
spacing = 0.06
tracers = 0.5
[smoke.flow.remesh]
[[smoke.ring]]
center = [0, 0, 0]
radius = 0.3
thickness = 0.1
circulation = 1
wobble = 0.05

[surface]
voxel = 1

[output]
volume = ["density"]

[quality.draft]
smoke.spacing = 0.1
"#;

const LINE: &str = "tradeoff ring.toml --vary smoke.flow.error=1e-4,3e-2 --frames 1-3 -o t";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("ring.toml", RING);
    desk
}

fn table(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.run(&format!("{line} --json"), 0).0).unwrap()
}

fn line(table: &Value, label: &str) -> Value {
    let lines = table["lines"].as_array().unwrap();
    lines.iter().find(|line| line["label"].as_str().unwrap().contains(label)).expect(label).clone()
}

#[test]
fn a_table_a_plot_and_a_preset_come_out_of_smoke() {
    let desk = desk();
    let (out, talk) = desk.run(&format!("{LINE} --dev 50% --write best.toml"), 0);
    for word in [
        "as written",
        "flow.error=1e-4",
        "flow.error=3e-2",
        "reference",
        "front",
        "certainty",
        "velocity",
        "voxel",
        "use ",
    ] {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(talk.contains("Progress: 100%"), "{talk}");
    assert_eq!(fs::read_to_string(desk.path("t/tradeoff.csv")).unwrap().lines().count(), 1 + 3 + 2);
    assert!(fs::read_to_string(desk.path("t/tradeoff.html")).unwrap().contains("<svg"));
    desk.run("simulate best.toml --frames 1-2", 0);
    let best = fs::read_to_string(desk.path("best.toml")).unwrap();
    assert!(best.contains("sample_every = 10"), "the preset's own");
    assert_eq!(best.matches("\nspacing = 0.06\n").count(), 2, "the grid follows the smoke\n{best}");

    // What is kept gives the same table to the last digit, and another voxel simulates nothing.
    let first = table(&desk, LINE);
    assert_eq!(first, table(&desk, LINE));
    let (out, talk) = desk.run(&LINE.replace("smoke.flow.error=1e-4,3e-2", "surface.voxel=0.5,2"), 0);
    assert_eq!(talk.matches("was there").count(), 3, "only the references are others\n{talk}");
    assert!(out.contains("same        the same motion as 1: 2, 3"), "{out}");
}

#[test]
fn errors_grow_with_the_requested_error() {
    let desk = desk();
    let found = table(&desk, "tradeoff ring.toml --vary smoke.flow.error=1e-4,5e-2 --frames 1-6 -o t");
    let [fine, rough] = ["error=1e-4", "error=5e-2"].map(|label| line(&found, label));
    let of = |line: &Value, key: &str| line["apart"][key].as_f64().unwrap();
    let number = |line: &Value, key: &str| line[key].as_f64().unwrap();
    assert!(number(&fine, "velocity") < 1e-4 && number(&fine, "velocity") < 0.1 * number(&rough, "velocity"));
    for key in ["density", "energy"] {
        assert!(of(&fine, key) <= of(&rough, key), "{key}: {fine} {rough}");
    }
    assert!(found["uncertainty"]["density"].as_f64().unwrap() < 0.1, "{}", found["uncertainty"]);
    assert!(found["uncertainty"]["impulse"].as_f64().unwrap() < 0.01, "{}", found["uncertainty"]);
    assert!(fine["drift"]["impulse"].as_f64().unwrap() < 0.02, "{fine}");
    if !super::is_soak() {
        return;
    }

    // Coarser vortons put the smoke elsewhere by more than coarser steps or sums do; finer voxels lose less.
    let vary = "--vary smoke.spacing=0.06,0.12 --vary surface.voxel=0.5,2";
    let found = table(&desk, &format!("tradeoff ring.toml {vary} --frames 1-6 -o t"));
    let [fine, coarse, blurred] =
        ["spacing=0.06 surface.voxel=0.5", "spacing=0.12 surface.voxel=0.5", "spacing=0.06 surface.voxel=2"]
            .map(|label| line(&found, label));
    assert!(of(&coarse, "density") > 2.0 * of(&fine, "density"), "{coarse} {fine}");
    assert!(number(&blurred, "voxel") > 3.0 * number(&fine, "voxel"), "{blurred} {fine}");
    assert!(number(&blurred, "volume") < number(&fine, "volume"));
}

#[test]
fn every_knob_is_swept_by_itself_if_none_is_named() {
    let desk = desk();
    let (out, _) = desk.run("tradeoff ring.toml --dry-run --tiers", 0);
    for word in [
        "14 runs",
        "flow.error=0.003",
        "flow.sum=grid",
        "flow.sum=direct",
        "flow.strain=0.6 flow.displacement=2",
        "overlap=1.2 flow.remesh.core=1.2",
        "surface.voxel=0.7",
        "draft  (spacing 0.1 m)",
        "smoke.flow.sum=tree smoke.flow.error=0.00015",
        "smoke.flow.max_substeps=1000",
    ] {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(!desk.path("ring-tradeoff").exists());
    // A grid sum that cannot reach the error is left out, and refused by name.
    let (out, _) = desk.run("tradeoff ring.toml --dry-run --set smoke.flow.error=5e-5", 0);
    assert!(!out.contains("grid") && out.contains("smoke.flow.error=0.00001"), "{out}");
    for (line, word) in [
        ("tradeoff ring.toml --vary smoke.flow.sum=grid --set smoke.flow.error=5e-5", "0.0001"),
        ("tradeoff ring.toml --vary liquid.cfl=0.2", "does not change the smoke"),
        ("tradeoff ring.toml --by hausdorff", "velocity"),
        ("tradeoff small.toml --of smoke", "no smoke"),
        ("tradeoff small.toml --by voxel", "density, energy"),
        ("tradeoff ring.toml --of cloud", "possible values: liquid, smoke, sheets, surface"),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains(word), "{line}: {talk}");
    }
}

#[test]
fn the_smoke_of_a_shot_with_both_is_compared_alone() {
    let desk = desk();
    let smoke = &RING[RING.find("[smoke]").unwrap()..RING.find("[surface]").unwrap()];
    // Coarse: only the rows of the table are compared.
    let smoke = smoke.replace("spacing = 0.06", "spacing = 0.12");
    let both = SMALL.replace("[output]", &format!("{smoke}\n[output]"));
    desk.write("both.toml", &both);
    let (out, _) = desk.run(
        "tradeoff both.toml --of smoke --vary smoke.overlap=1.2 --frames 1-2 -o t --write new.toml --dev 100%",
        0,
    );
    assert!(out.contains("vortons") && out.contains("overlap=1.2"), "{out}");
    assert!(
        fs::read_to_string(desk.path("new.toml")).unwrap().contains("[liquid]"),
        "the preset keeps its liquid"
    );
    let (out, _) = desk.run("tradeoff both.toml --dry-run", 0);
    assert!(out.contains("liquid.density_dev") || out.contains("iterations="), "{out}");
}

#[test]
fn diverged_smoke_is_a_row() {
    let desk = desk();
    let vary = "--vary smoke.ring.0.circulation=1,3e10 --vary smoke.flow.max_substeps=1";
    let (out, _) = desk.run(&format!("tradeoff ring.toml {vary} --frames 1-4 -o t"), 0);
    assert!(out.contains("diverged    3: frame 000"), "{out}");
}
