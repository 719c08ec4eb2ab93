//! Speed against accuracy of surfaces, on the particles of a small shot.

use super::*;
use serde_json::Value;

const LINE: &str = "tradeoff small --of surface --vary surface.voxel=0.5,1 --frames 2,5 -o t";

fn table(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.run(&format!("{line} --json"), 0).0).unwrap()
}

fn line<'a>(table: &'a Value, label: &str) -> &'a Value {
    let mut lines = table["lines"].as_array().unwrap().iter();
    lines.find(|line| line["label"].as_str().unwrap().contains(label)).unwrap()
}

fn rows(desk: &Desk) -> Vec<PathBuf> {
    let rows = fs::read_dir(desk.path("t/rows")).unwrap().map(|entry| entry.unwrap().path());
    rows.filter(|path| path.is_dir()).collect()
}

#[test]
fn a_table_a_plot_and_a_preset_come_out() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let (out, talk) = desk.run(&format!("{LINE} --dev 100% --write best.toml"), 0);
    for word in [
        "as written = voxel=0.5",
        "voxel=1",
        "reference",
        "front",
        "certainty",
        "use ",
        "meniscus mesh small",
    ] {
        assert!(out.contains(word), "{word} is missing in\n{out}");
    }
    assert!(talk.contains("Progress: 100%") && !talk.contains("error"), "{talk}");
    assert_eq!(fs::read_to_string(desk.path("t/tradeoff.csv")).unwrap().lines().count(), 1 + 2 + 2);
    assert!(fs::read_to_string(desk.path("t/tradeoff.svg")).unwrap().ends_with("</svg>\n"));
    assert!(fs::read_to_string(desk.path("t/tradeoff.html")).unwrap().contains("where the time goes"));
    // Four settings; no mesh stays, and the cache is as it was.
    assert_eq!(rows(&desk).len(), 4);
    assert!(rows(&desk).iter().all(|row| desk.names(row.to_str().unwrap()) == ["row.json"]));
    assert!(!desk.path("small/mesh").exists());
    // The preset meshes as it is.
    desk.run("shot best.toml --frames 1-2", 0);
    let (_, talk) = desk.run(&format!("{LINE} --write best.toml"), 1);
    assert!(talk.contains("best.toml"), "{talk}");
}

#[test]
fn a_finer_voxel_comes_nearer_and_a_higher_order_makes_better_distances() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let found = table(
        &desk,
        "tradeoff small --of surface --vary surface.voxel=1.5,3 --set surface.voxel=1.5 -o coarse",
    );
    assert_eq!(found["frames"], serde_json::json!([1, 3, 5]), "three of what is there, the last among them");
    let frames = if super::is_soak() { "1,3,5" } else { "5" };
    let found = table(
        &desk,
        &format!(
            "tradeoff small --of surface --vary surface.voxel=0.4,0.9 --vary surface.distance.order=first,second \
             --set surface.distance={{}} --frames {frames} -o t"
        ),
    );
    let [fine, coarse] =
        ["voxel=0.4 distance.order=first", "voxel=0.9 distance.order=first"].map(|label| line(&found, label));
    for key in ["distance", "hausdorff", "normals"] {
        let [fine, coarse] = [fine, coarse].map(|line| line["apart"][key].as_f64().unwrap());
        assert!(fine < 0.8 * coarse, "{key}: {fine} at 0.4, {coarse} at 0.9");
    }
    let distances = &fine["apart"];
    let [beyond, missing, both] =
        ["beyond", "missing", "hausdorff"].map(|key| distances[key].as_f64().unwrap());
    assert!(beyond.max(missing) == both && distances["distance"].as_f64().unwrap() < both);
    assert!(fine["triangles"].as_f64() > coarse["triangles"].as_f64() && fine["unsound"] == 0);
    let second = line(&found, "voxel=0.4 distance.order=second");
    let error = |line: &Value| line["field"]["mean"].as_f64().unwrap();
    assert!(error(second) < error(fine), "{} and {}", error(second), error(fine));
    assert!(found["uncertainty"]["distance"].as_f64().unwrap() > 0.0);
    // Where the surface lies, the order does not change.
    assert_eq!(second["apart"]["distance"], fine["apart"]["distance"]);
    assert_ne!(second["apart"]["normals"], fine["apart"]["normals"]);
}

#[test]
fn rows_are_made_once_and_compared_anew_when_the_reference_changes() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let first = table(&desk, LINE);
    let (_, talk) = desk.run(LINE, 0);
    assert_eq!(talk.matches("was there").count(), 4, "{talk}");
    assert_eq!(first, table(&desk, LINE), "what is kept gives the same table to the last digit");
    // A coarser row joins: the reference is the same, and only the new one is made, and the reference's mesh.
    let (_, talk) = desk.run(&LINE.replace("=0.5,1", "=0.5,1,2"), 0);
    assert_eq!(talk.matches("was there").count(), 3, "{talk}");
    // A finer one changes the reference, so all are compared with the new one.
    let finer = table(&desk, &LINE.replace("=0.5,1", "=0.4,0.5,1"));
    let distance = |table: &Value| line(table, "voxel=1")["apart"]["distance"].as_f64().unwrap();
    assert!(distance(&finer) != distance(&first) && (distance(&finer) / distance(&first) - 1.0).abs() < 0.5);
    assert!(rows(&desk).iter().all(|row| desk.names(row.to_str().unwrap()) == ["row.json"]));
    let repeated = table(&desk, &format!("{LINE} --repeats 3"));
    let spread = &repeated["lines"][0]["seconds"];
    let [min, median, max] = ["min", "median", "max"].map(|key| spread[key].as_f64().unwrap());
    assert!(min <= median && median <= max && min < max, "{spread}");
    assert_eq!(repeated["lines"][0]["apart"], first["lines"][0]["apart"]);
}

#[test]
fn blocks_show_nothing_and_narrow_bands_only_in_the_normals() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let line = "tradeoff small --of surface --vary surface.distance.block=1,4 --vary surface.distance.band=3,9 --by field --set surface.distance={} --frames 5 -o t";
    let found = table(&desk, line);
    let lines = found["lines"].as_array().unwrap();
    let same: Vec<_> = lines.iter().map(|line| line["same_as"].as_u64()).collect();
    assert_eq!(same, [None, Some(0), Some(0), Some(0)], "{same:?}");
    let error = |place: usize| lines[place]["field"]["mean"].as_f64().unwrap();
    assert_eq!(lines[1]["label"], "distance.block=1 distance.band=9");
    assert!(error(1) > error(0) && error(1) == error(3), "first order errs more farther out");
    let found = table(
        &desk,
        "tradeoff small --of surface --vary surface.distance.band=1 --set surface.distance={} --frames 5 -o t",
    );
    let [wide, narrow] = [0, 1].map(|place| found["lines"][place]["apart"].clone());
    assert_eq!(wide["hausdorff"], narrow["hausdorff"]);
    assert!(narrow["normals"].as_f64() > wide["normals"].as_f64(), "{narrow} {wide}");
}

#[test]
fn presets_and_particle_files_are_compared_too() {
    let desk = Desk::new();
    let vary = "--vary surface.voxel=0.6,1";
    let (out, _) = desk.run(&format!("tradeoff small.toml --of surface {vary} -o t --frames 3 --time 1d"), 0);
    assert!(out.contains("use ") && out.contains("meniscus shot small.toml"), "{out}");
    assert!(desk.path("t/shot/cache/frame_0003.mcf").exists());
    desk.run(
        &format!("tradeoff small.toml --of surface {vary} -o t --frames 3 --set liquid.spacing=0.15"),
        14,
    );

    let points: Vec<_> = (0..216).map(|i| [i % 6, i / 6 % 6, i / 36].map(|v| 0.1 * v as f32)).collect();
    desk.write("ball_1.xyz", meshing::xyz(&points));
    desk.write("ball_2.xyz", meshing::xyz(&points[..100]));
    // A liquid at rest has frames of the same bytes.
    desk.write("ball_3.xyz", meshing::xyz(&points));
    let line = format!("tradeoff ball_*.xyz --of surface --spacing 0.1 {vary}");
    let (out, _) = desk.run(&format!("{line} --dev 100%"), 0);
    assert!(out.contains("frames 1,2,3"), "{out}");
    assert!(
        out.contains("mesh ball_*.xyz --spacing 0.1") && desk.path("ball_1-tradeoff/tradeoff.svg").exists()
    );
    let found = table(&desk, &line);
    assert_eq!(found["particles"].as_f64().unwrap().round(), 177.0);
}

#[test]
fn a_surface_that_vanishes_is_on_no_front() {
    let desk = Desk::new();
    desk.write("drop.xyz", "0.05 0.05 0.05\n");
    // A lone particle between the nodes of so coarse a grid is not seen.
    let line = "tradeoff drop.xyz --of surface --spacing 0.1 --vary surface.voxel=0.5,9 -o t";
    let (out, _) = desk.run(line, 0);
    assert!(out.contains("2: a surface is empty"), "{out}");
    let found = table(&desk, line);
    assert_eq!(
        (&found["lines"][1]["apart"]["distance"], &found["lines"][1]["front"]),
        (&Value::Null, &Value::Bool(false))
    );
}

#[test]
fn mistakes_are_found_before_anything_runs() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    desk.write("a.xyz", "0 0 0\n");
    for (line, word) in [
        ("tradeoff small --of surface --vary liquid.cfl=0.2,0.4", "surface."),
        ("tradeoff small --of surface --vary surface.voxl=1", "voxel"),
        ("tradeoff small --of surface --vary surface.voxel=0,1", "0.05 to 10"),
        ("tradeoff small --of surface --frames 9", "1 to 2"),
        ("tradeoff small --of surface --set liquid.cfl=0.2", "surface"),
        ("tradeoff small --of surface --by energy", "hausdorff"),
        ("tradeoff small --of surface --spacing 0.1", "--spacing"),
        ("tradeoff small --of surface --quality draft", "--quality"),
        ("tradeoff small.toml --by normals", "--of surface"),
        ("tradeoff small", "--of surface"),
        ("tradeoff small.toml --spacing 0.1", "--of surface"),
        ("tradeoff a.xyz a.xyz", "--of surface"),
        ("tradeoff a.xyz --of surface", "--spacing"),
        ("tradeoff a.xyz --of surface --spacing 0.1 --write b.toml", "preset"),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains(word), "{line}: {talk}");
    }
    let (out, _) = desk.run("tradeoff small --of surface --dry-run", 0);
    assert!(out.contains("24 surfaces") && out.contains("MiB") && out.contains("distance={}"), "{out}");
    let (_, talk) = desk.run("tradeoff small --of surface --max-memory 1MiB", 33);
    assert!(talk.contains("--max-memory"), "{talk}");
    desk.run("tradeoff nowhere --of surface", 2);
}
