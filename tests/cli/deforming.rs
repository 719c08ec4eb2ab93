//! Colliders that deform, from their files to the shot folder.

use super::*;
use serde_json::Value;

/// A box of 0.3 m whose upper corners rise by `lift`, as the corners of OBJ.
fn corners(lift: f32) -> Vec<[f32; 3]> {
    (0..8)
        .map(|i| {
            let at = |axis: usize| if i >> axis & 1 == 1 { 0.15 } else { -0.15 };
            [at(0) + 1.1, at(1) + 0.4, at(2) + 0.15 + if i >= 4 { lift } else { 0.0 }]
        })
        .collect()
}

fn obj(lift: f32) -> String {
    let vertices: String = corners(lift).iter().map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
    vertices + "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
}

/// A PC2 file with samples from frame 1 on, a frame apart.
fn pc2(lifts: &[f32]) -> Vec<u8> {
    let mut bytes = b"POINTCACHE2\0\x01\0\0\0\x08\0\0\0".to_vec();
    bytes.extend([1.0_f32, 1.0].iter().flat_map(|frame| frame.to_le_bytes()));
    bytes.extend((lifts.len() as i32).to_le_bytes());
    let numbers = lifts.iter().flat_map(|&lift| corners(lift)).flatten();
    bytes.extend(numbers.flat_map(f32::to_le_bytes));
    bytes
}

const LIFTS: [f32; 4] = [0.0, 0.05, 0.15, 0.2];

/// The small shot with a box that grows under the falling liquid, by a point cache and by a sequence.
fn desk() -> Desk {
    let desk = Desk::new();
    fs::create_dir_all(desk.path("grow")).unwrap();
    for (name, mesh) in [
        ("cached", "file = \"grow/box.obj\", point_cache = \"grow/box.pc2\""),
        ("listed", "file = \"grow/box_####.obj\""),
    ] {
        let resolution = if super::is_soak() { 24 } else { 12 };
        let solid = format!(
            "[[world.collider]]\nshape = {{ mesh = {{ {mesh}, resolution = {resolution} }} }}\n\n[liquid]"
        );
        desk.write(&format!("{name}.toml"), SMALL.replacen("[liquid]", &solid, 1));
    }
    desk.write("grow/box.obj", obj(0.0));
    fs::write(desk.path("grow/box.pc2"), pc2(&LIFTS)).unwrap();
    for (frame, lift) in (1..).zip(LIFTS) {
        desk.write(&format!("grow/box_{frame:04}.obj"), obj(lift));
    }
    desk
}

#[test]
fn point_caches_and_sequences_are_the_same_motion() {
    let desk = desk();
    let (out, _) = desk.run("shot cached.toml", 0);
    assert!(out.contains("1 colliders written"), "{out}");
    desk.run("shot listed.toml", 0);
    let positions = |shot: &str, frame: u32| {
        let frame = fs::read(desk.path(&format!("{shot}/cache/frame_{frame:04}.mcf"))).unwrap();
        // The keys of the headers differ, and so do the checksums at the end.
        frame[frame.len() / 2..frame.len() - 64].to_vec()
    };
    for frame in 1..=5 {
        assert_eq!(positions("cached", frame), positions("listed", frame), "{frame}");
    }
    // The box moves the liquid: without its motion other frames come out.
    desk.run("simulate cached.toml -o still --set world.collider.1.shape.mesh.file=grow/box.obj --set world.collider.1.shape.mesh.point_cache=grow/still.pc2", 2);
    fs::write(desk.path("grow/still.pc2"), pc2(&LIFTS[..1])).unwrap();
    desk.run("simulate cached.toml -o still --set world.collider.1.shape.mesh.point_cache=grow/still.pc2", 0);
    assert_ne!(positions("cached", 5), positions("still", 5));

    // What Blender plays: the mesh, and its vertices in each frame.
    assert_eq!(desk.names("cached/collider"), ["box.json", "box.pc2", "box.ply"]);
    let motion: Value =
        serde_json::from_slice(&fs::read(desk.path("cached/collider/box.json")).unwrap()).unwrap();
    assert_eq!(motion["point_cache_frames"], serde_json::json!([1, 4]));
    assert_eq!(fs::read(desk.path("cached/collider/box.pc2")).unwrap(), pc2(&LIFTS));
    assert_eq!(desk.names("listed/collider"), ["box_____.json", "box_____.pc2", "box_____.ply"]);

    // Frames are those of the header, and the shot's own end the motion.
    let mut later = pc2(&LIFTS);
    later[20..24].copy_from_slice(&3.0_f32.to_le_bytes());
    fs::write(desk.path("grow/later.pc2"), later).unwrap();
    let set = "--set world.collider.1.shape.mesh.point_cache=grow/later.pc2 --set fps=30";
    desk.run(&format!("shot cached.toml -o later {set}"), 0);
    let motion: Value =
        serde_json::from_slice(&fs::read(desk.path("later/collider/box.json")).unwrap()).unwrap();
    assert_eq!(motion["point_cache_frames"], serde_json::json!([3, 5]));
    assert_eq!(fs::read(desk.path("later/collider/box.pc2")).unwrap()[32..], pc2(&LIFTS[..3])[32..]);

    // The copy in the shot folder is complete, and a damaged file is found.
    desk.run("verify cached", 0);
    desk.run("simulate cached/preset.toml -o again", 0);
    assert_eq!(desk.bytes("again/cache"), desk.bytes("cached/cache"));
    desk.run("simulate listed/preset.toml -o listed-again --threads 1", 0);
    assert_eq!(desk.bytes("listed-again/cache"), desk.bytes("listed/cache"));
    fs::write(desk.path("cached/collider/box.pc2"), pc2(&LIFTS[..2])).unwrap();
    let (out, talk) = desk.run("verify cached", 12);
    assert!((out + &talk).contains("box.pc2"), "the damaged cache is named");
    desk.run("shot cached.toml", 0);
    desk.run("verify cached", 0);
}

#[test]
fn a_shot_goes_on_within_the_motion_with_the_same_bytes() {
    let desk = desk();
    desk.run("simulate cached.toml -o whole", 0);
    desk.run("simulate cached.toml --frames 1-3", 0);
    desk.run("simulate cached.toml --threads 1", 0);
    assert_eq!(desk.bytes("cached/cache"), desk.bytes("whole/cache"));
    // Another motion is another simulation.
    fs::write(desk.path("grow/box.pc2"), pc2(&[0.0, 0.1])).unwrap();
    desk.run("simulate cached.toml", 14);
}

/// Tracers above the box that grows, and one above a ball that does.
const SMOKE: &str = "title = \"s\"\nframes = \"1-5\"\n[[world.collider]]\n\
     shape = { mesh = { file = \"grow/box_####.obj\", resolution = 12 } }\n[[world.collider]]\n\
     shape = { sphere = { center = [0, 0, 0], radius = 0.1 } }\n\
     keyframes = [{ frame = 1, position = [3, 0.4, 0.15] }, { frame = 4, position = [3, 0.4, 0.15], scale = 2 }]\n\
     [smoke]\nspacing = 0.05\nsource = [{ shape = { box = { min = [1, 0.3, 0.32], max = [1.2, 0.5, 0.4] } } },\n\
     { shape = { box = { min = [2.95, 0.35, 0.27], max = [3.05, 0.45, 0.31] } } }]\n[smoke.shedding]\n";

#[test]
fn smoke_is_pushed_by_what_deforms_and_goes_on_with_the_same_bytes() {
    let desk = desk();
    let finer = |text: &str| {
        text.replace("resolution = 12", "resolution = 24").replace("0.05\nsource", "0.04\nsource")
    };
    desk.write("smoke.toml", if super::is_soak() { finer(SMOKE) } else { SMOKE.into() });
    let (_, talk) = desk.run("simulate smoke.toml -o whole", 0);
    assert!(!talk.contains("warning"), "{talk}");
    // Mean height of the tracers above the box, and above the ball.
    let heights = |shot: &str, frame: u32| {
        let file = desk.path(&format!("{shot}/cache/frame_{frame:04}.mcf"));
        let frame = meniscus::cache::read_frame(&file).unwrap().0;
        let points = frame.stream("smoke_tracers").and_then(|stream| stream.vec3("position")).unwrap();
        [0.0..2.0, 2.0..9.0].map(|side: std::ops::Range<f32>| {
            let all: Vec<f32> = points.iter().filter(|x| side.contains(&x[0])).map(|x| x[2]).collect();
            assert!(all.len() > 20, "{} tracers", all.len());
            all.iter().sum::<f32>() / all.len() as f32
        })
    };
    let ([box_start, ball_start], [box_end, ball_end]) = (heights("whole", 1), heights("whole", 5));
    // The top of the box rises by 0.2 m, that of the ball by 0.1 m from 0.04 m below its tracers; the air gives way to the sides.
    assert!((0.1..0.2).contains(&(box_end - box_start)), "{box_start} to {box_end}");
    assert!((0.04..0.09).contains(&(ball_end - ball_start)), "{ball_start} to {ball_end}");
    desk.run("simulate smoke.toml --frames 1-2", 0);
    desk.run("simulate smoke.toml --threads 1", 0);
    assert_eq!(desk.bytes("smoke/cache"), desk.bytes("whole/cache"));
    let (_, talk) = desk
        .run("simulate smoke.toml -o tank --set world.collider.0.shape={tank={min=[0,0,0],max=[9,9,9]}}", 2);
    assert!(talk.contains("changes its size next to smoke in a tank, whose air cannot leave"), "{talk}");
}

#[test]
fn motion_that_cannot_be_used_is_refused_in_words() {
    let desk = desk();
    let set = |keys: &str| format!("simulate cached.toml -o none --set world.collider.1.shape.mesh.{keys}");
    let refused = |line: &str, words: &str| {
        let (_, found) = desk.run(line, 2);
        assert!(found.contains(words), "{words}: {found}");
        assert!(!desk.path("none/cache").exists());
    };
    refused(&set("point_cache=grow/box.mdd"), "ends in .pc2");
    refused(&set("point_cache=../box.pc2"), "leads out of the preset's folder");
    refused(&set("point_cache=grow/gone.pc2"), "is not there");
    refused(&set("file=grow/box_####.obj"), "a sequence of files both give the motion");
    let listed =
        |file: &str| format!("simulate listed.toml -o none --set world.collider.1.shape.mesh.file={file}");
    refused(&listed("grow/ball_####.obj"), "found no file whose name has a number");
    refused(&listed("gr##/box_####.obj"), "one run of `#`");
    refused(&listed("../box_####.obj"), "leads out of the preset's folder");
    refused(
        "simulate cached.toml -o none --set liquid.source.0.shape={mesh={file=\"grow/box_####.obj\"}}",
        "deforms a shape that is no collider",
    );

    desk.write("grow/box_0003.obj", obj(0.1).replace("f 1 3 4 2\n", ""));
    let (_, talk) = desk.run("simulate listed.toml -o none", 1);
    assert!(talk.contains("box_0003.obj") && talk.contains("8 vertices and 10 triangles"), "{talk}");
    desk.write("grow/box_0003.obj", obj(400.0));
    let (_, talk) = desk.run("simulate listed.toml -o none", 2);
    assert!(talk.contains("sample 2 is 1334.3 times as large as the first"), "{talk}");
    fs::write(desk.path("grow/box.pc2"), &pc2(&LIFTS)[..200]).unwrap();
    let (_, talk) = desk.run("simulate cached.toml -o none", 1);
    assert!(talk.contains("box.pc2: header: found 4 samples in 168 bytes"), "{talk}");

    let pinned = CLOTH.replace("damping = 1", "damping = 1\npin = [{ at = { points = [0] }, collider = 0 }]");
    desk.write("pinned.toml", pinned);
    let (_, talk) = desk.run("simulate pinned.toml -o none", 2);
    assert!(talk.contains("follows a collider that deforms"), "{talk}");
}

#[test]
fn a_body_rises_with_what_grows_below_it_and_goes_on_with_the_same_bytes() {
    let desk = desk();
    // It stands on the box, without friction; a ball above it shrinks, and is not in its path.
    let body = "[[world.collider]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.2 } }\n\
        keyframes = [{ frame = 1, position = [1.1, 0.4, 0.9] }, { frame = 3, position = [1.1, 0.4, 0.9], scale = 0.3 }]\n\
        [[body]]\nshape = { box = { min = [-0.1, -0.1, -0.1], max = [0.1, 0.1, 0.1] } }\ndensity = 3000\n\
        position = [1.1, 0.4, 0.4]\nfriction = 0\n";
    desk.write("body.toml", fs::read_to_string(desk.path("listed.toml")).unwrap() + body);
    let (_, talk) = desk.run("shot body.toml -o whole", 0);
    assert!(!talk.contains("inner radius"), "{talk}");
    let heights: Vec<f32> = (1..=5)
        .map(|frame| {
            let file = desk.path(&format!("whole/cache/frame_{frame:04}.mcf"));
            let frame = meniscus::cache::read_frame(&file).unwrap().0;
            frame.stream("bodies").and_then(|stream| stream.vec3("position")).unwrap()[0].z
        })
        .collect();
    // In the fourth frame the box stops, and what it has thrown up by then flies on.
    for (frame, lift) in LIFTS.iter().enumerate().take(3) {
        assert!((heights[frame] - 0.4 - lift).abs() < 0.01, "{heights:?}");
    }
    desk.run("simulate body.toml --frames 1-3", 0);
    desk.run("simulate body.toml --threads 1", 0);
    assert_eq!(desk.bytes("body/cache"), desk.bytes("whole/cache"));
}

#[test]
fn files_of_another_run_do_not_become_frames_and_other_numbers_are_another_motion() {
    let desk = desk();
    desk.run("shot listed.toml", 0);
    let before = desk.bytes("listed/collider");
    fs::remove_file(desk.path("grow/box_0004.obj")).unwrap();
    let (_, talk) = desk.run("shot listed.toml --force", 2);
    assert!(talk.contains("box_0004.obj: found 1 files that a sequence"), "{talk}");
    // The same contents at other frames.
    fs::rename(desk.path("grow/box_0003.obj"), desk.path("grow/box_0005.obj")).unwrap();
    fs::remove_dir_all(desk.path("listed/grow")).unwrap();
    desk.run("shot listed.toml --force", 0);
    assert_ne!(before, desk.bytes("listed/collider"));
}

#[test]
fn unsound_meshes_and_other_units_are_reported_once() {
    let desk = desk();
    desk.write("grow/box.obj", obj(0.0).replace("f 1 3 4 2\n", "f 1 2 4 3\n"));
    let (_, talk) = desk.run("simulate cached.toml", 0);
    assert!(talk.contains("grow/box.obj: found 4 edges at which the faces turn"), "{talk}");
    let (_, talk) = desk.run("simulate cached.toml", 0);
    assert!(!talk.contains("faces turn"), "{talk}");
    let huge = "--set world.collider.1.shape.mesh.scale=1000";
    let (_, talk) = desk.run(&format!("simulate cached.toml -o huge {huge}"), 0);
    assert!(talk.contains("scale = 0.001 takes its unit for millimetres"), "{talk}");
}

// Windows lets administrators alone make symbolic links.
#[cfg(unix)]
#[test]
fn sequences_behind_links_out_of_the_folder_are_refused() {
    let desk = desk();
    let outside = Desk::new();
    outside.write("far.obj", obj(0.3));
    fs::remove_file(desk.path("grow/box_0002.obj")).unwrap();
    std::os::unix::fs::symlink(outside.path("far.obj"), desk.path("grow/box_0002.obj")).unwrap();
    let (_, talk) = desk.run("simulate listed.toml -o none", 2);
    assert!(talk.contains("box_0002.obj, a symbolic link out of the preset's folder"), "{talk}");
}

/// A cloth over the box, which lifts it.
const CLOTH: &str = r#"
title = "Lifted cloth"
frames = "1-8"

[[world.collider]]
shape = { mesh = { file = "grow/box.obj", point_cache = "grow/box.pc2", resolution = 32 } }

[[sheet]]
name = "cloth"
shape = { grid = { origin = [0.9, 0.2, 0.31], first = [0.4, 0, 0], second = [0, 0.4, 0], cells = [10, 10] } }
density = 0.2
stiffness = [200, 200]
shear = 40
damping = 1

[output]
sheet = ["pc2"]
"#;

#[test]
fn a_cloth_is_lifted_by_the_solid_below_it() {
    let desk = desk();
    desk.write("cloth.toml", CLOTH);
    desk.run("shot cloth.toml", 0);
    let cache = fs::read(desk.path("cloth/sheet/cloth.pc2")).unwrap();
    let number = |at: usize| f32::from_le_bytes(cache[at..at + 4].try_into().unwrap());
    // The point in the middle, over the box, in frames 1 to 8.
    let points = 11 * 11;
    let height = |frame: usize| number(32 + 12 * (points * (frame - 1) + 60) + 8);
    for (frame, lift) in (1..).zip(LIFTS) {
        let top = 0.3 + lift;
        // It is pushed with the speed of the box, and flies on for less than a frame.
        assert!((-1e-3..0.06).contains(&(height(frame) - top)), "{frame}: {} over {top}", height(frame));
    }
    assert!((-1e-3..0.3).contains(&(height(8) - 0.5)), "{}", height(8));
}

#[test]
fn a_collider_that_grows_is_written_with_its_sizes_and_others_keep_theirs() {
    let desk = Desk::new();
    let ball = |shape: &str, scale: &str| {
        let keys = format!("[{{ frame = 1 }}, {{ frame = 4, scale = {scale} }}]");
        format!("[[world.collider]]\nshape = {{ {shape} }}\nkeyframes = {keys}\n\n[liquid]")
    };
    let sphere = "sphere = { center = [0.9, 0.4, 0.2], radius = 0.1 }";
    desk.write("grow.toml", SMALL.replacen("[liquid]", &ball(sphere, "2"), 1));
    desk.run("shot grow.toml", 0);
    let file = fs::read(desk.path("grow/collider/sphere.json")).unwrap();
    let motion: Value = serde_json::from_slice(&file).unwrap();
    let scales: Vec<f64> = serde_json::from_value(motion["scales"].clone()).unwrap();
    assert_eq!(scales.len(), 4);
    assert!((scales[1] - 4.0 / 3.0).abs() < 1e-6 && scales[3] == 2.0, "{scales:?}");
    desk.run("simulate grow.toml -o parts --frames 1-3", 0);
    desk.run("simulate grow.toml -o parts --threads 1", 0);
    assert_eq!(desk.bytes("parts/cache"), desk.bytes("grow/cache"));
    for (shape, scale, words) in [
        (sphere, "0", "expected a number, 0.001 to 1000"),
        ("tank = { min = [-1, -1, -1], max = [2, 2, 2] }", "2", "keeps its size"),
        ("plane = { point = [0, 0, -1], normal = [0, 0, 1] }", "2", "keeps its size"),
    ] {
        desk.write("other.toml", SMALL.replacen("[liquid]", &ball(shape, scale), 1));
        let (_, talk) = desk.run("simulate other.toml -o none", 2);
        assert!(talk.contains(words), "{shape} {scale}: {talk}");
    }
}
