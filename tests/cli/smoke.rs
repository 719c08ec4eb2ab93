//! Shots of smoke: from preset to volumes, resumed, retimed, and with what they are made of left out.

use super::*;
use std::collections::BTreeMap;

/// A ring of a few hundred vortons in still air.
pub(crate) const RING: &str = r#"
title = "Small ring"
frames = "1-5"

[smoke]
spacing = 0.05
[[smoke.ring]]
center = [0, 0, 0]
radius = 0.3
thickness = 0.1
circulation = 1

[surface]
voxel = 1

[output]
volume = ["density", "velocity", "temperature"]
"#;

/// Hot smoke that comes out under a ball.
pub(crate) const PLUME: &str = r#"
title = "Small plume"
frames = "1-7"

[[world.collider]]
shape = { sphere = { center = [0, 0, 0.6], radius = 0.2 } }

[smoke]
spacing = 0.08
cooling = 0.5
dissolve = 0.5
wind = [0.2, 0, 0]
[smoke.buoyancy]
[smoke.shedding]
[[smoke.emitter]]
shape = { sphere = { center = [0, 0, 0.1], radius = 0.15 } }
rate = 20
temperature = 300
velocity = [0, 0, 1]
[smoke.flow.remesh]
spacing = 0.08

[output]
volume = ["density"]
"#;

/// A mesh with edges that turns and travels above a plane, in wind, and sheds; and a wire.
const SPIN: &str = r#"
title = "Small spin"
frames = "1-7"

[[world.collider]]
shape = { mesh = { file = "block.obj" } }
keyframes = [
  { frame = 1, position = [0, 0, 0.3], rotation = [0, 0, 0] },
  { frame = 4, position = [0.1, 0, 0.3], rotation = [0, 0, 90] },
  { frame = 7, position = [0.1, 0, 0.4], rotation = [60, 0, 90] },
]
[[world.collider]]
shape = { capsule = { from = [0.5, -0.3, 0.2], to = [0.5, 0.3, 0.2], radius = 0.05 } }
[[world.collider]]
shape = { plane = { point = [0, 0, 0], normal = [0, 0, 1] } }

[smoke]
spacing = 0.06
wind = [1, 0, 0]
[smoke.shedding]
[[smoke.emitter]]
shape = { sphere = { center = [-0.5, 0, 0.3], radius = 0.1 } }
rate = 20
[smoke.flow]
viscosity = { nu = 1e-4, eddies = 0.2 }
[smoke.flow.remesh]
spacing = 0.06

[output]
volume = ["density"]
"#;

/// The active nodes of a float grid and their values, read by another library.
pub(crate) fn grid(path: &Path, name: &str) -> BTreeMap<[i32; 3], f32> {
    let mut reader = vdb_rs::VdbReader::new(fs::File::open(path).unwrap()).unwrap();
    let grid = reader.read_grid::<f32>(name).unwrap();
    grid.iter().map(|(at, value, _)| ([at.x as i32, at.y as i32, at.z as i32], value)).collect()
}

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("ring.toml", RING);
    desk.write("plume.toml", PLUME);
    desk.write("spin.toml", SPIN);
    let corner = |n: i32| {
        format!(
            "v {} {} {}\n",
            0.4 * f64::from(n & 1) - 0.2,
            0.2 * f64::from(n & 2) - 0.2,
            0.07 * f64::from(n & 4) - 0.14
        )
    };
    let faces = "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    desk.write("block.obj", (0..8).map(corner).collect::<String>() + faces);
    desk
}

#[test]
fn one_command_goes_from_a_ring_to_volumes() {
    let desk = desk();
    let (out, talk) = desk.run("shot ring.toml --set volume.precision=float", 0);
    assert!(out.contains("5 frames simulated") && out.contains("5 volumes written"), "{out}");
    assert!(talk.contains("vortons") && !talk.to_lowercase().contains("error"), "{talk}");
    assert!(!talk.contains("dilation"), "no liquid, nothing of one:\n{talk}");
    let names: Vec<String> = (1..=5).map(|i| format!("smoke_000{i}.vdb")).collect();
    assert_eq!(desk.names("ring/volume"), names);
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(desk.path("ring/shot.json")).unwrap()).unwrap();
    let output = &manifest["outputs"][0];
    assert_eq!((&output["kind"], &output["name"]), (&"volume".into(), &"smoke".into()));
    assert_eq!(output["grids"], serde_json::json!(["density", "velocity", "temperature"]));

    // The smoke keeps its amount and flies upwards, as fast as a thin ring of this size.
    let voxel = 0.025;
    let mean = |frame: u32| {
        let fog = grid(&desk.path(&format!("ring/volume/smoke_000{frame}.vdb")), "density");
        let sum: f64 = fog.values().map(|&v| f64::from(v)).sum();
        let height: f64 = fog.iter().map(|(at, &v)| f64::from(v) * f64::from(at[2]) * voxel).sum();
        (sum, height / sum)
    };
    let (first, last) = (mean(1), mean(5));
    assert!((last.0 / first.0 - 1.0).abs() < 5e-3, "{first:?} {last:?}");
    let speed = (last.1 - first.1) / (4.0 / 24.0);
    assert!((0.68..0.82).contains(&speed), "{speed} m/s");

    // What is there is kept, found and valid.
    let (out, _) = desk.run("shot ring.toml --set volume.precision=float", 0);
    assert!(out.contains("0 frames simulated") && out.contains("5 up to date"), "{out}");
    let (out, _) = desk.run("info ring", 0);
    assert!(out.contains("5 present") && out.contains("5 vdb files"), "{out}");
    desk.run("verify ring", 0);

    // The vector potential is written where it is named, from a cache and between its frames.
    for (line, frame) in [("-o potential", 5), ("-o slow --retime 2", 9)] {
        desk.run(&format!("volume ring {line} --grid vector_potential --grid density"), 0);
        let folder = line.split(' ').nth(1).unwrap();
        let file = desk.path(&format!("{folder}/volume/smoke_{frame:04}.vdb"));
        let reader = vdb_rs::VdbReader::new(fs::File::open(file).unwrap()).unwrap();
        let mut names: Vec<String> = reader.grid_descriptors.into_keys().collect();
        names.sort();
        assert_eq!(names, ["density", "vector_potential"]);
    }

    // Each line of the log has the invariants; the impulse is that of the ring, Γ π R² with what its core adds.
    let log = fs::read_to_string(desk.path("ring/log.jsonl")).unwrap();
    for line in log.lines() {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        assert!(line.get("liquid").is_none(), "{line}");
        let impulse = line["smoke"]["invariants"]["impulse"][2].as_f64().unwrap();
        assert!((impulse / (std::f64::consts::PI * 0.09) - 1.0).abs() < 0.1, "{impulse}");
    }
}

#[test]
fn a_shot_that_is_resumed_or_run_on_other_threads_has_the_same_bytes() {
    let desk = desk();
    for preset in ["spin", "plume"].into_iter().take(if super::is_soak() { 2 } else { 1 }) {
        let (whole, parts) = (format!("{preset}-whole"), format!("{preset}-parts"));
        let frames = if super::is_soak() { "1-7" } else { "1-5" };
        desk.run(&format!("shot {preset}.toml -o {whole} --frames {frames} --threads 1"), 0);
        desk.run(&format!("simulate {preset}.toml -o {parts} --frames 1-3 --threads 3"), 0);
        desk.run(&format!("shot {preset}.toml -o {parts} --frames {frames} --threads 2"), 0);
        // A retimed frame depends on its neighbours alone.
        let slow = "--retime 2 --frames 1-4";
        desk.run(&format!("volume {whole} -o {whole}-slow {slow} --threads 1"), 0);
        desk.run(&format!("volume {parts} -o {parts}-slow {slow} --threads 2"), 0);
        for folder in ["cache", "volume"] {
            let bytes = |shot: &str| desk.bytes(&format!("{shot}/{folder}"));
            assert!(bytes(&whole) == bytes(&parts), "{preset} {folder}");
        }
        assert!(
            desk.bytes(&format!("{whole}-slow/volume")) == desk.bytes(&format!("{parts}-slow/volume")),
            "{preset}"
        );
    }
}

#[test]
fn every_built_in_shot_of_smoke_runs() {
    let desk = Desk::new();
    // Without the long studies, one of rings and one with everything that smoke can meet.
    let names = [
        "plume",
        "smoke-ring",
        "colliding-rings",
        "leapfrog-rings",
        "ring-through-arch",
        "smoke-over-bear",
        "smoke-over-sphere",
        "walk-through-smoke",
    ];
    for name in names.into_iter().take(if super::is_soak() { names.len() } else { 2 }) {
        let (out, _) = desk.run(&format!("shot {name} --quality draft --frames 1-2"), 0);
        assert!(out.contains("2 volumes written"), "{out}");
        desk.run(&format!("verify {name}-draft"), 0);
    }
}

#[test]
fn only_what_is_named_runs() {
    let desk = desk();
    let passes = |line: &str| {
        let (out, _) = desk.run(&format!("simulate {line} --dry-run"), 0);
        out.lines().find(|line| line.starts_with("passes")).unwrap()[6..].trim().to_owned()
    };
    assert!(!passes("small.toml").contains("smoke"));
    assert_eq!(passes("ring.toml"), "smoke_move, smoke_account");
    assert_eq!(
        passes("plume.toml"),
        "smoke_move, smoke_emit, smoke_push, smoke_walls, smoke_fade, smoke_account"
    );
    // A frame has a stream a system.
    let ring = &RING[RING.find("[smoke]").unwrap()..RING.find("[surface]").unwrap()];
    // In the middle of the tank, whose walls have few panels then.
    let ring = ring.replace("spacing = 0.05", "spacing = 0.2").replace("[0, 0, 0]", "[0.8, 0.4, 0.6]");
    desk.write("both.toml", format!("{SMALL}\n{ring}"));
    desk.run("shot both.toml", 0);
    assert_eq!(desk.names("both/mesh").len(), 5, "the liquid is meshed, the smoke is not");
    desk.run("shot small.toml", 0);
    let mesh = |folder: &str| {
        desk.bytes(&format!("{folder}/mesh")).into_iter().map(|(_, b)| b.len()).collect::<Vec<_>>()
    };
    assert_eq!(mesh("both"), mesh("small"), "smoke does not change a liquid");
}

#[test]
fn settings_without_smoke_are_refused_at_their_line() {
    let desk = desk();
    let refused = |set: &str, words: &[&str]| {
        let (_, talk) = desk.run(&format!("simulate ring.toml {set} -o bad"), 2);
        for word in words {
            assert!(talk.contains(word), "{set}: no `{word}` in\n{talk}");
        }
    };
    refused("--set smoke.spacng=0.1", &["smoke.spacng", "spacing"]);
    refused("--set smoke.ring.0.radius=-1", &["radius", "above 0"]);
    refused("--set smoke.ring.0.thickness=0.2", &["closes its own hole"]);
    refused("--set smoke.ring.0.direction=[0,0,0]", &["gives no direction"]);
    refused("--set smoke.spacing=nan", &["smoke.spacing"]);
    refused("--set smoke.ring.0.circulation=inf", &["circulation"]);
    refused("--set smoke.spacing=1e-6", &["2³¹"]);
    refused("--set smoke.ring=[]", &["nothing seeds or emits smoke"]);
    refused(
        "--set output.mesh=[\"ply\"]",
        &["output.mesh", "needs particles", "expected none", "write `volume"],
    );
    refused(
        "--set output.volume=[\"surface\"]",
        &["output.volume", "no such grid", "found `surface`, expected some of"],
    );
    let plane = "{shape={plane={point=[0,0,0],normal=[0,0,1]}}}";
    refused(&format!("--set world.collider=[{plane},{plane}]"), &["one plane only"]);
    refused(
        "--set smoke.source=[{shape={plane={point=[0,0,0],normal=[0,0,1]}}}]",
        &["smoke.source.0", "cannot be filled"],
    );
    // Numbers that are valid one by one and cannot be computed together end the shot with a reason.
    assert!(!desk.path("bad").exists(), "nothing was begun");
    let (_, talk) = desk.run("simulate ring.toml --set smoke.ring.0.circulation=1e30 -o bad", 2);
    assert!(talk.contains("smoke cannot start") && talk.contains("strength"), "{talk}");
}

#[test]
fn a_cache_is_played_again_without_simulating() {
    let desk = desk();
    let float = "--set volume.precision=float";
    desk.run(&format!("shot ring.toml {float}"), 0);
    let cache = desk.bytes("ring/cache");
    let (out, _) = desk.run(&format!("volume ring -o slow --retime 2 {float}"), 0);
    assert!(out.contains("9 volumes written"), "{out}");
    let fog = |folder: &str, frame: u32| {
        grid(&desk.path(&format!("{folder}/volume/smoke_000{frame}.vdb")), "density")
    };
    let height = |fog: &BTreeMap<[i32; 3], f32>| {
        let sum: f64 = fog.values().map(|&v| f64::from(v)).sum();
        fog.iter().map(|(at, &v)| f64::from(v) * f64::from(at[2])).sum::<f64>() / sum
    };
    for frame in 1..=5 {
        assert!(fog("ring", frame) == fog("slow", 2 * frame - 1), "frame {frame} is passed as it is");
    }
    for between in [2, 4, 6, 8] {
        let [a, b, c] = [between - 1, between, between + 1].map(|frame| height(&fog("slow", frame)));
        assert!((b - 0.5 * (a + c)).abs() < 0.1 * (c - a), "{a} {b} {c}");
    }
    let (out, _) = desk.run(&format!("volume ring -o slow --retime 2 {float}"), 0);
    assert!(out.contains("0 volumes written") && out.contains("9 up to date"), "{out}");

    // More tracers of the same smoke are as much of it, at the same place.
    desk.run(&format!("volume ring -o fine --set smoke.tracers=0.25 --voxel 2 {float}"), 0);
    let (coarse, fine) = (fog("ring", 5), fog("fine", 5));
    let sum = |fog: &BTreeMap<[i32; 3], f32>| fog.values().map(|&v| f64::from(v)).sum::<f64>();
    assert!((sum(&fine) / sum(&coarse) - 1.0).abs() < 0.15, "{} {}", sum(&fine), sum(&coarse));
    assert!((height(&fine) - height(&coarse)).abs() < 0.3, "{} {}", height(&fine), height(&coarse));
    assert!(desk.bytes("ring/cache") == cache, "the cache is left as it was");

    let (_, talk) = desk.run("volume ring --retime 2", 2);
    assert!(talk.contains("-o"), "{talk}");
    let (_, talk) = desk.run("volume ring -o bad --retime 0", 2);
    assert!(talk.contains("0.001"), "{talk}");
    fs::remove_file(desk.path("ring/cache/frame_0003.mcf")).unwrap();
    let (_, talk) = desk.run("volume ring -o bad --retime 2", 2);
    assert!(talk.contains("no frame 3"), "{talk}");
}

#[test]
fn tracers_become_points_that_move() {
    let desk = desk();
    desk.run("simulate ring.toml", 0);
    let (out, _) = desk.run("export ring --frames 2-3", 0);
    assert!(out.contains("2 frames of points written"), "{out}");
    let text = fs::read(desk.path("ring/points/smoke_0002.ply")).unwrap();
    let head = String::from_utf8_lossy(&text[..600]).into_owned();
    for property in ["vx", "vy", "vz", "density", "temperature", "radius", "id"] {
        assert!(head.contains(&format!(" {property}\n")), "{head}");
    }
    let (out, _) = desk.run("export ring", 0);
    assert!(out.contains("3 frames of points written") && out.contains("2 up to date"), "{out}");
    desk.run("simulate small.toml", 0);
    let (_, talk) = desk.run("export small", 2);
    assert!(talk.contains("no sheets or tracers"), "{talk}");
}

#[test]
fn a_plan_estimates_what_smoke_needs() {
    let desk = desk();
    let (out, _) = desk.run("plan plume.toml", 0);
    for words in ["vortons", "tracers", "smoke_push", "smoke: about", "disk", "time"] {
        assert!(out.contains(words), "no `{words}` in\n{out}");
    }
    assert!(!out.contains("particles") && !out.contains("iterations"), "{out}");
    let plan = super::plan::plan(&desk, "plume.toml");
    let estimate = super::plan::number(super::plan::system(&plan, "smoke"), "tracers", "end");
    desk.run("simulate plume.toml", 0);
    let log = fs::read_to_string(desk.path("plume/log.jsonl")).unwrap();
    let last: serde_json::Value = serde_json::from_str(log.lines().last().unwrap()).unwrap();
    let there = last["smoke"]["tracers"].as_f64().unwrap();
    assert!((estimate / there).ln().abs() < 0.5, "estimate {estimate}, found {there}");
    desk.run("plan plume.toml --max-memory 1MiB", 33);
    desk.run("simulate plume.toml --max-memory 1MiB -o never", 33);
}

#[test]
fn smoke_that_calibration_runs_to_its_end_takes_what_was_estimated() {
    let desk = desk();
    let plan = super::plan::plan(&desk, "plume.toml");
    let smoke = super::plan::system(&plan, "smoke");
    desk.run("shot plume.toml -o plume", 0);
    let records: Vec<serde_json::Value> = fs::read_to_string(desk.path("plume/log.jsonl"))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    let steps: f64 = records.iter().map(|record| number(&record["smoke"]["substeps"])).sum();
    assert_eq!(number(&smoke["substeps"]), steps);
    let last = &records.last().unwrap()["smoke"];
    for name in ["vortons", "tracers"] {
        assert_eq!(super::plan::number(smoke, name, "end"), number(&last[name]), "{name}");
    }
    let size = |folder: &str| desk.bytes(folder).iter().map(|(_, bytes)| bytes.len() as f64).sum::<f64>();
    // The start is stored too, and only one volume of eight is made.
    for (estimate, found, part) in [
        (number(&plan["cache"]), size("plume/cache"), 0.25),
        (number(&plan["products"][0]["bytes"]), size("plume/volume"), 0.6),
    ] {
        assert!((estimate / found - 1.0).abs() < part, "estimate {estimate}, found {found}");
    }
    assert!(number(&plan["seconds"]) > 0.0 && plan["remarks"].as_array().unwrap().is_empty(), "{plan}");
}

#[test]
fn sums_that_keep_no_error_and_cores_that_are_too_narrow_are_reported() {
    let desk = desk();
    let line = "simulate ring.toml --frames 1-2 --set smoke.sample_every=1 --force -o r";
    let warns = |set: &str, words: &str| desk.run(&format!("{line} {set}"), 0).1.contains(words);
    let (inexact, narrow) = ("exceeds the requested", "narrower than the cores of vortons");
    assert!(!warns("", inexact) && !warns("", narrow));
    assert!(warns("--set smoke.flow.sum=grouping", inexact));
    assert!(warns("--set smoke.flow.sum=multigrid --set smoke.flow.kernel=gaussian", inexact));
    assert!(warns("--set smoke.ring.0.thickness=0.06", narrow));
    let (_, talk) = desk.run(&format!("{line} --set smoke.flow.sum=multigrid"), 2);
    assert!(talk.contains("has Gaussian cores only") && talk.contains("kernel = \"gaussian\""), "{talk}");
}
