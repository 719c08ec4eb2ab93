//! Rigid bodies on the command line.

use super::*;
use serde_json::Value;

/// A crate that falls into a small pool.
const CRATE: &str = r#"
[[body]]
shape = { box = { min = [-0.2, -0.2, -0.2], max = [0.2, 0.2, 0.2] } }
density = 500
position = [1.2, 0.4, 0.6]
rotation = [0, 0, 30]
"#;

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("crate.toml", format!("{SMALL}{CRATE}"));
    desk
}

/// The poses of a body in the files of a shot.
fn poses(desk: &Desk, file: &str) -> Vec<Vec<f64>> {
    let motion: Value = serde_json::from_slice(&fs::read(desk.path(file)).unwrap()).unwrap();
    assert_eq!(motion["first"], 1);
    serde_json::from_value(motion["poses"].clone()).unwrap()
}

#[test]
fn a_shot_has_its_bodies_with_a_pose_in_every_frame() {
    let desk = desk();
    let (out, _) = desk.run("shot crate.toml", 0);
    assert!(out.contains("1 colliders written"), "{out}");
    assert_eq!(desk.names("crate/collider"), ["box.json", "box.ply"]);
    let whole = poses(&desk, "crate/collider/box.json");
    assert_eq!(whole.len(), 5);
    let half = 15.0_f64.to_radians();
    for (found, expected) in whole[0].iter().zip([1.2, 0.4, 0.6, half.cos(), 0.0, 0.0, half.sin()]) {
        assert!((found - expected).abs() < 1e-6, "{whole:?}");
    }
    // It falls freely in the first frame: by g t (t + Δt) / 2 with substeps of Δt.
    let fallen = whole[0][2] - whole[1][2];
    let free = 9.81 / 2.0 / 24.0 / 24.0;
    assert!((free..2.0 * free).contains(&fallen), "{fallen} for {free}");
    let (info, _) = desk.run("info crate", 0);
    assert!(info.contains("bodies"), "{info}");

    // A shot in two parts has the same frames and files, and a pose for each frame that is there.
    desk.run("shot crate.toml -o parts --frames 1-3", 0);
    assert_eq!(poses(&desk, "parts/collider/box.json"), whole[..3]);
    desk.run("shot crate.toml -o parts", 0);
    assert_eq!(desk.bytes("crate/cache"), desk.bytes("parts/cache"));
    assert_eq!(desk.bytes("crate/collider"), desk.bytes("parts/collider"));
    desk.run("verify crate", 0);

    // Other bodies are another simulation; how pictures show them is not.
    desk.run("simulate crate.toml -o crate --set body.0.density=400", 14);
    desk.run("shot crate.toml --set body.0.look=hidden", 0);

    // The files have the poses of all cached frames, whichever were requested last.
    desk.run("shot crate.toml -o last --frames 1-3", 0);
    desk.run("shot crate.toml -o last --frames 4-5", 0);
    assert_eq!(poses(&desk, "last/collider/box.json"), whole);

    // Other bodies in the preset than in the frames are refused.
    let preset = fs::read_to_string(desk.path("crate/preset.toml")).unwrap();
    desk.write("crate/preset.toml", format!("{preset}{CRATE}"));
    let (_, talk) = desk.run("colliders crate", 2);
    assert!(talk.contains("other settings than those of the cached frames"), "{talk}");
}

#[test]
fn bodies_without_liquid_fall_and_collide() {
    let desk = Desk::new();
    let start = &SMALL[..SMALL.find("[liquid]").unwrap()];
    desk.write("alone.toml", format!("{start}{CRATE}").replacen("1-5", "1-24", 1));
    desk.run("simulate alone.toml", 0);
    desk.run("colliders alone", 0);
    let poses = poses(&desk, "alone/collider/box.json");
    let height = poses[23][2];
    assert!((height - 0.2).abs() < 0.005, "it lies on the floor at {height}");
    let (log, _) = desk.run("info alone", 0);
    assert!(log.contains("bodies     1"), "{log}");
    // Its pictures show the fall.
    desk.run("preview alone --frames 1,24 --size 96x54", 0);
    let picture = |frame: u32| fs::read(desk.path(&format!("alone/preview/frame_{frame:04}.png"))).unwrap();
    assert!(picture(1) != picture(24));
}

#[test]
fn a_body_falls_into_a_cloth_and_the_shot_reports_and_resumes_it() {
    let desk = Desk::new();
    let names = "balls-in-cloth --quality draft --set sheet.0.shape.grid.cells=[24,24]";
    desk.run(&format!("simulate {names} --frames 1-12 -o whole --threads 1"), 0);
    desk.run(&format!("simulate {names} --frames 1-10 -o parts"), 0);
    desk.run(&format!("simulate {names} --frames 1-12 -o parts"), 0);
    for frame in [10, 11, 12] {
        let [whole, parts] = ["whole", "parts"]
            .map(|shot| std::fs::read(desk.path(&format!("{shot}/cache/frame_{frame:04}.mcf"))).unwrap());
        assert!(whole == parts, "frame {frame} of the resumed shot on other threads");
    }
    let (text, _) = desk.run("info whole --json", 0);
    let info: serde_json::Value = serde_json::from_str(&text).unwrap();
    let found = &info["bodies_on_sheets"];
    println!("{found}");
    assert!(
        found["contacts"].as_u64() > Some(20)
            && found["penetration"].as_f64().is_some_and(|depth| depth < 0.1),
        "{info}"
    );
    assert!(info["bodies"]["max_speed"].as_f64() > Some(1.0), "{info}");
    let (text, _) = desk.run(&format!("plan {names} --frames 1-3"), 0);
    assert!(text.contains("coupling_bodies"), "{text}");
}

#[test]
fn faults_of_bodies_are_named_with_their_place() {
    let desk = Desk::new();
    let body = |from: &str, to: &str| {
        assert!(CRATE.contains(from), "{from}");
        format!("{SMALL}{}", CRATE.replacen(from, to, 1))
    };
    let cube = "box = { min = [-0.2, -0.2, -0.2], max = [0.2, 0.2, 0.2] }";
    for (text, words) in [
        (body("density = 500", "density = 0"), "density"),
        (body("density = 500", "density = 29"), "of the liquid's"),
        (body("density = 500", "density = 2e9"), "of the liquid's"),
        (body("density = 500", "density = 500\nrestitution = 1.5"), "restitution"),
        (body("density = 500", "density = 500\nfriction = -1"), "friction"),
        (body("density = 500", "density = 500\ncontact_angle = 60"), "needs a liquid with surface tension"),
        (body("position = [1.2", "position = [nan"), "position"),
        (body(cube, "plane = { point = [0, 0, 0], normal = [0, 0, 1] }"), "bounded"),
        (body(cube, "tank = { min = [0, 0, 0], max = [1, 1, 1] }"), "bounded"),
        (
            body(cube, "disc = { center = [0, 0, 0], normal = [0, 0, 1], radius = 0.1 }"),
            "`thickness` is not above zero",
        ),
        (body(cube, "mesh = { file = 'none.ply' }"), "none.ply"),
        (format!("{SMALL}{}", CRATE.repeat(1001)), "too many bodies"),
        (
            format!("{SMALL}{CRATE}").replacen("1-5", "1-300000", 1),
            "found 300000 frames, expected at most 250000",
        ),
        (format!("{SMALL}{}", CRATE.repeat(501)), "found 501 colliders and bodies to write"),
    ] {
        desk.write("bad.toml", &text);
        let (_, talk) = desk.run("simulate bad.toml -o bad", 2);
        assert!(talk.contains(words) && talk.contains("bad.toml"), "{words}: {talk}");
    }
    let ring = "[smoke]\nspacing = 0.1\n[[smoke.ring]]\ncenter = [0, 0, 0]\nradius = 1\nthickness = 0.3\ncirculation = 1\n";
    desk.write("smoke.toml", format!("title = 't'\nframes = '1-2'\n{ring}{CRATE}"));
    let (_, talk) = desk.run("simulate smoke.toml", 2);
    assert!(talk.contains("`[[body]]` and `smoke` do not act on each other"), "{talk}");

    let cloth = "[[sheet]]\nname = 'cloth'\ndensity = 0.3\nstiffness = [100, 100]\n\
                 shape = { grid = { origin = [0, 0, 1], first = [1, 0, 0], second = [0, 1, 0], cells = [4, 4] } }\n";
    desk.write("three.toml", format!("{SMALL}{CRATE}{cloth}"));
    let (_, talk) = desk.run("simulate three.toml", 2);
    assert!(talk.contains("if both are coupled") && talk.contains("found all three without"), "{talk}");
    let coupling = "[[coupling]]\nbetween = ['liquid', 'cloth']\n";
    desk.write("coupled.toml", format!("{SMALL}{CRATE}{cloth}{coupling}"));
    let (out, _) = desk.run("simulate coupled.toml --frames 1-2", 0);
    assert!(out.contains("coupling   bodies:"), "{out}");
    desk.write(
        "layers.toml",
        format!("title = 't'\nframes = '1'\n{CRATE}{cloth}[sheets.contact]\nthickness = 0.01\n"),
    );
    let (_, talk) = desk.run("simulate layers.toml", 2);
    assert!(talk.contains("does not know rigid bodies yet"), "{talk}");
    desk.write(
        "through.toml",
        format!("title = 't'\nframes = '1'\n{}{cloth}", CRATE.replacen("1.2, 0.4", "0.5, 0.5", 1)),
    );
    let (_, talk) = desk.run("simulate through.toml --set body.0.position=[0.5,0.5,1]", 0);
    assert!(talk.contains("points of sheets start inside rigid bodies"), "{talk}");

    let viscous = SMALL.replacen("[liquid.xsph]", "[liquid.viscosity]\ndynamic = 100", 1);
    desk.write("viscous.toml", format!("{viscous}{CRATE}"));
    let (_, talk) = desk.run("simulate viscous.toml --frames 1", 0);
    assert!(talk.contains("which hold bodies of up to twice its density"), "{talk}");
    let (_, talk) = desk.run("simulate viscous.toml -o wide --frames 1 --set liquid.kernel_radius=2.5", 0);
    assert!(!talk.contains("which hold bodies"), "{talk}");

    // The box of 40 cm is inside the source of 80 cm.
    desk.write("submerged.toml", format!("{SMALL}{}", CRATE.replacen("1.2, 0.4, 0.6", "0.4, 0.4, 0.4", 1)));
    let (_, talk) = desk.run("simulate submerged.toml --frames 1", 0);
    assert!(talk.contains("body.0 starts inside the liquid. Its inner radius is 2 spacings"), "{talk}");
    assert!(talk.contains("Write liquid.kernel_radius = 2.2"), "{talk}");

    // Bodies that start inside the tank's walls or each other are counted.
    desk.write("overlap.toml", format!("{SMALL}{CRATE}{}", CRATE.replacen("1.2, 0.4", "1.5, 0.4", 1)));
    let (_, talk) = desk.run("simulate overlap.toml --frames 1", 0);
    assert!(talk.contains("2 bodies start inside a collider or another body"), "{talk}");

    // What a file of poses cannot hold is refused.
    let alone = format!("title = 't'\nframes = '1'\n{}", CRATE.replacen("1.2, 0.4", "5e9, 0.4", 1));
    desk.write("far.toml", alone);
    desk.run("simulate far.toml", 0);
    let (_, talk) = desk.run("colliders far", 2);
    assert!(talk.contains("farther than 1e9 m from the origin"), "{talk}");
}
