//! Speed against accuracy on a small shot.

use super::*;
use serde_json::Value;

const LINE: &str = "tradeoff small.toml --vary liquid.iterations=1,4 --frames 1-4 -o t";

#[test]
fn a_table_a_plot_and_a_preset_come_out() {
    let desk = Desk::new();
    let (out, talk) = desk.run(&format!("{LINE} --dev 50% --write best.toml"), 0);
    for word in
        ["as written", "iterations=1", "iterations=4", "reference", "front", "certainty", "horizon", "use "]
    {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(talk.contains("Progress: 100%") && !talk.contains("error"), "{talk}");
    let csv = fs::read_to_string(desk.path("t/tradeoff.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 3 + 2, "{csv}");
    assert!(fs::read_to_string(desk.path("t/tradeoff.svg")).unwrap().ends_with("</svg>\n"));
    assert!(fs::read_to_string(desk.path("t/tradeoff.html")).unwrap().contains("<svg"));
    // Only figures and a sample of the particles stay of a run.
    let rows: Vec<_> =
        fs::read_dir(desk.path("t/rows")).unwrap().map(|entry| entry.unwrap().path()).collect();
    let runs: Vec<_> = rows.iter().filter(|path| path.is_dir()).collect();
    assert_eq!(runs.len(), 5);
    assert!(runs.iter().all(|run| run.join("row.json").exists() && !run.join("cache").exists()));
    // The preset runs as it is, and is not written over.
    desk.run("simulate best.toml --frames 1-2", 0);
    let (_, talk) = desk.run(&format!("{LINE} --write best.toml"), 1);
    assert!(talk.contains("best.toml"), "{talk}");
}

#[test]
fn rows_are_run_once_and_kept_when_others_join() {
    let desk = Desk::new();
    let table =
        |line: &str| -> Value { serde_json::from_str(&desk.run(&format!("{line} --json"), 0).0).unwrap() };
    let first = table(LINE);
    let (_, talk) = desk.run(LINE, 0);
    assert_eq!(talk.matches("was there").count(), 5, "{talk}");
    assert_eq!(first, table(LINE), "what is kept gives the same table to the last digit");
    let (_, talk) = desk.run(&LINE.replace("=1,4", "=1,2,4"), 0);
    assert_eq!(talk.matches("was there").count(), 5, "{talk}");
    assert_eq!(first["lines"].as_array().unwrap().len(), 3);

    // A row whose run was cut off is run again with the same figures, but for its time.
    let rows = fs::read_dir(desk.path("t/rows")).unwrap().map(|entry| entry.unwrap().path());
    rows.filter(|path| path.is_dir()).for_each(|path| fs::remove_file(path.join("row.json")).unwrap());
    let again = table(LINE);
    for (a, b) in first["lines"].as_array().unwrap().iter().zip(again["lines"].as_array().unwrap()) {
        for key in ["label", "density_dev_avg", "volume_change", "apart", "particles"] {
            assert_eq!(a[key], b[key]);
        }
    }
    let repeated = table(&format!("{LINE} --repeats 3"));
    let spread = &repeated["lines"][0]["seconds"];
    let [min, median, max] = ["min", "median", "max"].map(|key| spread[key].as_f64().unwrap());
    assert!(min <= median && median <= max && min < max, "{spread}");
}

#[test]
fn more_iterations_come_nearer_to_the_reference() {
    let desk = Desk::new();
    let line = "tradeoff small.toml --vary liquid.iterations=1,4,16 --frames 1-5 --by energy -o t --json";
    let table: Value = serde_json::from_str(&desk.run(line, 0).0).unwrap();
    let line = |label: &str| {
        let lines = table["lines"].as_array().unwrap();
        lines.iter().find(|line| line["label"].as_str().unwrap().contains(label)).unwrap().clone()
    };
    let (few, many) = (line("iterations=1"), line("iterations=16"));
    for key in ["energy", "observable", "position"] {
        let [few, many] = [&few, &many].map(|line| line["apart"][key].as_f64().unwrap());
        assert!(many < few, "{key}: {few} with 1 iteration, {many} with 16");
    }
    assert!(many["density_dev_avg"].as_f64() < few["density_dev_avg"].as_f64());
    assert!(
        table["uncertainty"]["energy"].as_f64().unwrap() > 0.0 && table["horizon"].as_u64().unwrap() >= 2
    );
}

#[test]
fn settings_out_of_the_bounds_are_marked_and_not_recommended() {
    let desk = Desk::new();
    let line = "tradeoff small.toml --set liquid.min_substeps=2 --set liquid.cfl=2 --frames \
                1-5 -o t";
    let (out, _) = desk.run(&format!("{line} --vary liquid.iterations=1,40 --dev 90%"), 0);
    assert!(out.contains("iterations=1 ") && out.contains("outside     2: density"), "{out}");
    assert!(out.contains("(±3 %)") && !out.contains("use         2"), "{out}");
    let lost = format!("{line} --set liquid.iterations=1 --vary liquid.softening=0.01,0.02");
    let (out, _) = desk.run(&lost, 0);
    assert!(out.contains("use         none: every setting is out of the bounds"), "{out}");
    let (_, talk) = desk.run(&format!("{lost} --dev 90%"), 1);
    assert!(
        talk.contains("the bounds of the table (density at most 2 %, volume ±3 %, energy at most 10 %)"),
        "{talk}"
    );
    let (_, talk) = desk.run(&format!("{lost} --write best.toml"), 2);
    assert!(
        talk.contains("every setting is out of the bounds") && !desk.path("best.toml").exists(),
        "{talk}"
    );
}

#[test]
fn the_observable_of_the_preset_decides_by_default() {
    let desk = Desk::new();
    desk.write("named.toml", SMALL.to_owned() + "[tradeoff]\nobservable = \"front_x\"\n");
    let by = |line: &str| -> Value {
        let table = format!("{} --vary liquid.iterations=1,4 --frames 1-3 --json -o t", line);
        serde_json::from_str::<Value>(&desk.run(&table, 0).0).unwrap()["by"].clone()
    };
    assert_eq!(by("tradeoff named.toml"), "observable");
    assert_eq!(by("tradeoff named.toml --by energy"), "energy");
    assert_eq!(by("tradeoff small.toml"), "density");
}

#[test]
fn diverged_settings_are_rows() {
    let desk = Desk::new();
    let vary = "--vary liquid.source.0.velocity=[0,0,0],[1e38,1e38,1e38]";
    let (out, _) = desk.run(&format!("tradeoff small.toml {vary} --frames 1-3 -o t"), 0);
    assert!(out.contains("diverged    2: frame 0002"), "{out}");
    assert!(fs::read_to_string(desk.path("t/tradeoff.csv")).unwrap().contains("frame 0002"));
    let (_, talk) =
        desk.run(&format!("tradeoff small.toml {vary} --frames 1-3 -o t --time 1d --dev 0.0001%"), 1);
    assert!(talk.contains("no setting") && talk.contains("--vary"), "{talk}");
}

#[test]
fn mistakes_are_found_before_anything_runs() {
    let desk = Desk::new();
    for (line, word) in [
        ("tradeoff small.toml --vary liquid.cfll=0.1", "cfl"),
        ("tradeoff small.toml --vary liquid.cfl", "KEY=VALUE"),
        ("tradeoff small.toml --vary liquid.cfl=-1,0.4", "above 0"),
        ("tradeoff small.toml --frames 1", "1-24"),
        ("tradeoff small.toml --time soon", "10min"),
        ("tradeoff small.toml --repeats 0", "repeats"),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains(word), "{line}: {talk}");
    }
    let (out, _) = desk.run("tradeoff small.toml --dry-run --tiers", 0);
    assert!(
        out.contains("20 runs") && out.contains("min_substeps=16") && out.contains("iterations=24"),
        "{out}"
    );
    assert!(!desk.path("small-tradeoff").exists());
}
