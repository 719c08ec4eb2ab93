//! Force fields on the command line.

use super::*;

const BALL: &str = r#"
title = "Ball"
frames = "1-3"

[world]
gravity = [0, 0, 0]

[liquid]
spacing = 0.05

[[liquid.source]]
shape = { sphere = { center = [0, 0, 0], radius = 0.15 } }

[output]
mesh = ["ply"]
"#;

fn with(tables: &str) -> String {
    format!("{BALL}{tables}\n")
}

#[test]
fn work_is_reported_and_a_shot_continues_with_the_same_bytes() {
    let desk = Desk::new();
    desk.write(
        "ball.toml",
        with("[[force]]\nkind = { turbulence = { strength = 20, scale = 0.3, period = 0.5 } }\n[[force]]\nkind = { uniform = { acceleration = [3, 0, 0] } }"),
    );
    desk.run("simulate ball.toml -o whole", 0);
    desk.run("simulate ball.toml -o halves --frames 1-2", 0);
    desk.run("simulate ball.toml -o halves", 0);
    let (info, _) = desk.run("info whole", 0);
    assert!(info.contains("forces") && info.contains("0 accelerations limited"), "{info}");
    let last = |folder: &str| fs::read(desk.path(&format!("{folder}/cache/frame_0003.mcf")));
    assert!(last("whole").unwrap() == last("halves").unwrap());
    // Other forces make other frames: the folder is refused.
    desk.run("simulate ball.toml -o whole --set force.1.kind.uniform.acceleration=[4,0,0]", 14);
}

#[test]
fn a_force_that_substeps_do_not_resolve_is_limited_and_named() {
    let desk = Desk::new();
    desk.write("ball.toml", with("[[force]]\nkind = { uniform = { acceleration = [1e6, 0, 0] } }"));
    let (_, talk) = desk.run("simulate ball.toml -o ball --frames 1-2 --set liquid.max_substeps=64", 0);
    assert!(talk.contains("accelerations by forces limited, most by force.0"), "{talk}");
    assert!(talk.contains("liquid.max_substeps"), "{talk}");
}

#[test]
fn faults_of_forces_are_named_with_their_place() {
    let desk = Desk::new();
    let up = "kind = { uniform = { acceleration = [0, 0, 1] } }";
    let vortex = "kind = { vortex = { center = [0, 0, 0], axis = [0, 0, 0], strength = 1, radius = 1 } }";
    let ball = "shape = { sphere = { center = [0, 0, 0], radius = 1 } }";
    for (table, words) in [
        ("kind = { uniform = { acceleration = [2e6, 0, 0] } }".to_owned(), "at most 1e6 m/s²"),
        ("kind = { uniform = { acceleration = [nan, 0, 0] } }".into(), "acceleration"),
        ("kind = { drag = { rate = -1 } }".into(), "rate"),
        ("kind = { drag = { rate = 1, velocity = [0, 1e9, 0] } }".into(), "at most 1e5 m/s"),
        ("kind = { turbulence = { strength = 1e7, scale = 1 } }".into(), "strength"),
        (format!("kind = {{ turbulence = {{ strength = 1, scale = 1 }} }}\n{ball}"), "no `falloff`"),
        (vortex.into(), "gives no direction"),
        (format!("{up}\nfalloff = 1"), "needs a shape"),
        (format!("{up}\n{ball}\nfalloff = 0"), "falloff"),
        (format!("{up}\nsystems = ['sheets']"), "does not have"),
        (format!("{up}\nsystems = ['smoke']"), "feels forces"),
        (
            format!("{up}\nstrength_keyframes = [{{ frame = 3, factor = 1 }}, {{ frame = 3, factor = 0 }}]"),
            "do not ascend",
        ),
        (format!("{up}\nstrength_keyframes = [{{ frame = 3, factor = 1.5 }}]"), "factor"),
        (format!("{up}\nshape = {{ mesh = {{ file = 'none.ply' }} }}"), "none.ply"),
    ] {
        desk.write("bad.toml", with(&format!("[[force]]\n{table}")));
        let (_, talk) = desk.run("simulate bad.toml -o bad", 2);
        assert!(talk.contains(words) && talk.contains("bad.toml"), "{table}: {talk}");
    }
    let ring = "title = 't'\nframes = '1-2'\n[smoke]\nspacing = 0.1\n[[smoke.ring]]\ncenter = [0, 0, 0]\nradius = 1\nthickness = 0.3\ncirculation = 1\n";
    desk.write("smoke.toml", format!("{ring}[[force]]\n{up}\n"));
    let (_, talk) = desk.run("simulate smoke.toml -o smoke", 2);
    assert!(talk.contains("forces act on nothing in this preset"), "{talk}");
    let liquid = &BALL[BALL.find("[world]").unwrap()..BALL.find("[output]").unwrap()];
    desk.write("both.toml", format!("{ring}{liquid}[[force]]\n{up}\n"));
    let (_, talk) = desk.run("simulate both.toml -o both", 2);
    assert!(talk.contains("does not act on smoke"), "{talk}");
}
