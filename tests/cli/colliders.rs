//! Colliders as files of a shot: meshes, motion, checksums.

use super::*;
use serde_json::Value;

/// A paddle that turns, a bowl of glass, and the tank, which is not written.
const SOLIDS: &str = r#"
[[world.collider]]
shape = { box = { min = [-0.05, -0.3, -0.3], max = [0.05, 0.3, 0.3] } }
keyframes = [{ frame = 2, position = [1.2, 0.4, 0.5] }, { frame = 4, position = [1.0, 0.4, 0.5], rotation = [0, 90, 0] }]

[[world.collider]]
shape = { torus = { center = [1.2, 0.4, 0.1], axis = [0, 0, 1], radius = 0.2, tube = 0.05 } }
look = "glass"

[liquid]"#;

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("solids.toml", SMALL.replacen("[liquid]", SOLIDS, 1));
    desk
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn collider_outputs(desk: &Desk, shot: &str) -> Vec<Value> {
    let manifest = json(&desk.path(shot).join("shot.json"));
    let outputs = manifest["outputs"].as_array().unwrap().iter();
    outputs.filter(|output| output["kind"] == "collider").cloned().collect()
}

#[test]
fn a_shot_has_its_colliders_with_their_motion_and_verify_judges_them() {
    let desk = desk();
    let (out, _) = desk.run("shot solids.toml", 0);
    assert!(out.contains("2 colliders written"), "{out}");
    assert_eq!(desk.names("solids/collider"), ["box.json", "box.ply", "torus.json", "torus.ply"]);
    let outputs = collider_outputs(&desk, "solids");
    assert_eq!(outputs.len(), 2);
    assert_eq!(outputs[0]["pattern"], "collider/box.json");
    assert_eq!(outputs[0]["rest"], "collider/box.ply");
    assert_eq!(outputs[0]["frames"], serde_json::json!({ "first": 2, "last": 4, "step": 1 }));
    let paddle = json(&desk.path("solids/collider/box.json"));
    assert_eq!((&paddle["look"], &paddle["first"]), (&"matte".into(), &2.into()));
    let half = 0.5_f64.sqrt();
    for (pose, expected) in [
        (0, [1.2, 0.4, 0.5, 1.0, 0.0, 0.0, 0.0]),
        (1, [1.1, 0.4, 0.5, (22.5_f64).to_radians().cos(), 0.0, (22.5_f64).to_radians().sin(), 0.0]),
        (2, [1.0, 0.4, 0.5, half, 0.0, half, 0.0]),
    ] {
        let found = paddle["poses"][pose].as_array().unwrap();
        for (found, expected) in found.iter().zip(expected) {
            assert!((found.as_f64().unwrap() - expected).abs() < 1e-6, "{paddle}");
        }
    }
    let bowl = json(&desk.path("solids/collider/torus.json"));
    assert_eq!((&bowl["look"], bowl["poses"].as_array().unwrap().len()), (&"glass".into(), 1));
    let before = desk.bytes("solids/collider");
    let (out, _) = desk.run("shot solids.toml", 0);
    assert!(out.contains("0 colliders written (0.0 MiB), 2 up to date"), "{out}");

    // Damage and loss are found, and the command that verify names repairs them.
    desk.run("verify solids", 0);
    for name in ["box.json", "torus.ply"] {
        let path = desk.path("solids/collider").join(name);
        let mut bytes = fs::read(&path).unwrap();
        let last = bytes.len() - 2;
        bytes[last] ^= 1;
        fs::write(&path, bytes).unwrap();
        let (_, talk) = desk.run("verify solids", 12);
        assert!(talk.contains(&format!("collider/{name}: corrupt")), "{talk}");
        assert!(talk.contains("meniscus colliders solids"), "{talk}");
        let (out, _) = desk.run("colliders solids", 0);
        assert!(out.contains("1 colliders written"), "{out}");
        desk.run("verify solids", 0);
    }
    fs::remove_file(desk.path("solids/collider/box.ply")).unwrap();
    desk.run("verify solids", 10);
    desk.run("colliders solids", 0);
    assert_eq!(desk.bytes("solids/collider"), before);
}

#[test]
fn a_look_changes_pictures_and_no_frame() {
    let desk = desk();
    desk.run("shot solids.toml", 0);
    let (frames, names) = (desk.bytes("solids/cache"), desk.names("solids/collider"));
    let text = SMALL.replacen("[liquid]", SOLIDS, 1);
    desk.write(
        "solids.toml",
        text.replace("\"glass\"", "\"hidden\"").replace("shape = { tank", "look = \"glass\"\nshape = { tank"),
    );
    let (out, _) = desk.run("shot solids.toml", 0);
    assert!(out.contains("0 frames simulated") && out.contains("2 colliders written (0"), "{out}");
    assert_eq!(desk.bytes("solids/cache"), frames);
    assert_eq!(collider_outputs(&desk, "solids").len(), 3);
    assert_eq!(json(&desk.path("solids/collider/torus.json"))["look"], "hidden");

    // What is not shown any more is not an output any more.
    desk.write("solids.toml", text);
    desk.run("shot solids.toml", 0);
    let patterns: Vec<Value> =
        collider_outputs(&desk, "solids").into_iter().map(|output| output["pattern"].clone()).collect();
    assert_eq!(patterns, ["collider/box.json", "collider/torus.json"]);
    assert_eq!(desk.names("solids/collider").len(), names.len() + 2, "no file is removed");
    desk.run("verify solids", 0);
}

#[test]
fn the_last_collider_that_is_not_shown_any_more_leaves_the_manifest() {
    let desk = Desk::new();
    let shown = SMALL.replacen("shape = { tank", "look = \"glass\"\nshape = { tank", 1);
    for command in ["shot small.toml", "colliders small"] {
        desk.write("small.toml", &shown);
        desk.run("shot small.toml", 0);
        let manifest = json(&desk.path("small/shot.json"));
        assert_eq!(collider_outputs(&desk, "small").len(), 1);
        desk.write("small.toml", SMALL);
        if command.starts_with("colliders") {
            desk.run("simulate small.toml", 0);
        }
        let (out, _) = desk.run(command, 0);
        assert!(out.contains("0 colliders written"), "{out}");
        assert_eq!(collider_outputs(&desk, "small"), Vec::<Value>::new());
        let after = json(&desk.path("small/shot.json"));
        assert_eq!(after["frames"], manifest["frames"]);
        assert_eq!(after["outputs"].as_array().unwrap().len(), 1, "{after}");
        desk.run("verify small", 0);
        let (out, _) = desk.run("shot small.toml", 0);
        assert!(!out.contains("collider"), "{out}");
    }
}

#[test]
fn colliders_are_refused_of_another_preset_and_of_shots_that_show_none() {
    let desk = desk();
    desk.run("shot solids.toml --frames 1-2", 0);
    let preset = desk.path("solids/preset.toml");
    let text = fs::read_to_string(&preset).unwrap();
    fs::write(&preset, text.replacen("radius = 0.2", "radius = 0.3", 1)).unwrap();
    let (_, talk) = desk.run("colliders solids", 2);
    assert!(talk.contains("other settings than those of the cached frames"), "{talk}");
    let (out, _) = desk.run("shot small.toml --frames 1-2", 0);
    assert!(!out.contains("collider") && !desk.path("small/collider").exists(), "{out}");
    let (_, talk) = desk.run("colliders small", 2);
    assert!(talk.contains("found 0 colliders and bodies that pictures show"), "{talk}");
    let (_, talk) = desk.run("colliders solids --max-memory 1KiB", 2);
    assert!(talk.contains("other settings"), "{talk}");
    fs::write(&preset, text).unwrap();
    desk.run("colliders solids --max-memory 1KiB", 33);
}

#[test]
fn colliders_that_cannot_be_written_are_refused_before_the_simulation() {
    let desk = Desk::new();
    let ball = "[[world.collider]]\nshape = { sphere = { center = [5, 5, 5], radius = 0.1 } }\n";
    let preset = |text: &str| SMALL.replacen("[liquid]", &format!("{text}\n[liquid]"), 1);
    desk.write("many.toml", preset(&ball.repeat(501)));
    let (_, talk) = desk.run("shot many.toml", 2);
    assert!(talk.contains("found 501 colliders and bodies to write, expected at most 500"), "{talk}");
    let keys = "keyframes = [{ frame = 1 }, { frame = 900000, position = [0, 0, 1] }]\n";
    let long = preset(&format!("{ball}{keys}"));
    desk.write("long.toml", long.replacen("1-5", "1-300000", 1));
    let (_, talk) = desk.run("shot long.toml", 2);
    assert!(talk.contains("`world.collider.1` moves in too many frames"), "{talk}");
    assert!(talk.contains("found a motion of 300000 frames, expected at most 250000"), "{talk}");
    assert!(!desk.path("many").exists() && !desk.path("long").exists());

    // Presets at the limit, and those without files, are accepted.
    for (name, text) in [
        ("limit", preset(&ball.repeat(500))),
        ("no-files", preset(&ball.repeat(501)).replacen("mesh = [\"ply\"]", "", 1)),
        ("frames", long),
    ] {
        desk.write(&format!("{name}.toml"), &text);
        desk.run(&format!("shot {name}.toml --dry-run"), 0);
    }

    // The memory of poses is estimated before they are evaluated.
    desk.run("shot frames.toml", 0);
    let (_, talk) = desk.run("colliders frames --frames 1-300000", 2);
    assert!(talk.contains("moves in 300000 frames"), "{talk}");
    desk.run("colliders frames --frames 1-300000 --max-memory 64MiB", 33);
}
