//! What goes wrong with shots of smoke: damaged frames, outputs that nothing can give, more than can be had.

use super::{
    smoke::{PLUME, RING},
    *,
};
use meniscus::{
    cache,
    frame::{ChannelData, Stream},
    math::Vec3,
};

/// A simulated ring in the folder of its preset.
fn ring() -> Desk {
    let desk = Desk::new();
    desk.write("ring.toml", RING);
    desk.run("simulate ring.toml", 0);
    desk
}

/// Puts frame 3 of the ring back with streams that `change` spoils, its bytes sound.
fn spoil(desk: &Desk, change: impl Fn(&Stream) -> Stream) {
    let (mut frame, info) = cache::read_frame(&desk.path("ring/cache/frame_0003.mcf")).unwrap();
    frame.streams = frame.streams.iter().map(change).collect();
    cache::write_frame(&desk.path("ring/cache"), &frame, info.key).unwrap();
}

/// A copy of a stream whose channels are changed, or left out.
fn changed(stream: &Stream, change: impl Fn(&str, &ChannelData) -> Option<ChannelData>) -> Stream {
    let mut copy = Stream::new(stream.name.clone(), stream.kind, stream.len());
    for channel in stream.channels() {
        if let Some(data) = change(&channel.name, &channel.data) {
            copy = copy.with(channel.name.clone(), data);
        }
    }
    copy.scalars = stream.scalars.clone();
    copy
}

/// Runs `line` on a damaged cache: frame 3 is named with `words`, `made` files exist, and the exit code is `code`.
fn left_out(desk: &Desk, line: &str, code: i32, made: (&str, usize), words: &str) {
    let (_, talk) = desk.run(line, code);
    assert!(talk.contains("frame 0003") && talk.contains(words), "{line}: no `{words}` in\n{talk}");
    assert!(!talk.contains("cannot start"), "{line}:\n{talk}");
    assert_eq!(desk.names(made.0).len(), made.1, "{line}:\n{talk}");
}

#[test]
fn a_frame_whose_bytes_are_damaged_is_named_and_the_others_are_made() {
    let desk = ring();
    let path = desk.path("ring/cache/frame_0003.mcf");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    fs::write(&path, bytes).unwrap();
    left_out(&desk, "volume ring", 12, ("ring/volume", 4), "frame_0003.mcf");
    left_out(&desk, "export ring", 12, ("ring/points", 4), "frame_0003.mcf");
    // Neighbouring frames are made.
    left_out(&desk, "volume ring -o slow --retime 2", 12, ("slow/volume", 6), "frame_0003.mcf");
    assert_eq!(
        desk.names("slow/volume"),
        [1, 2, 3, 7, 8, 9].map(|frame| format!("smoke_000{frame}.vdb")),
        "those that need frame 3 are left out"
    );
    // Tracers that drift from the start do not come past it, and none of the cache's are shown in their place.
    let (_, talk) = desk.run("volume ring -o fresh --set smoke.tracers=0.4", 12);
    assert_eq!(desk.names("fresh/volume").len(), 2, "{talk}");
}

#[test]
fn a_frame_that_cannot_be_computed_is_named_and_the_others_are_made() {
    let desk = ring();
    let wild = |stream: &Stream| {
        changed(stream, |name, data| match data {
            ChannelData::Vec3(values) if name == "strength" => {
                let mut values = values.clone();
                values[7] = Vec3::repeat(f32::NAN);
                Some(ChannelData::Vec3(values))
            }
            data => Some(data.clone()),
        })
    };
    spoil(&desk, wild);
    left_out(&desk, "volume ring", 3, ("ring/volume", 4), "number 7 of the vortons");
    left_out(&desk, "export ring", 3, ("ring/points", 4), "number 7 of the vortons");
    left_out(&desk, "volume ring -o slow --retime 2", 3, ("slow/volume", 6), "number 7 of the vortons");

    let desk = ring();
    spoil(&desk, |stream| changed(stream, |name, data| (name != "core").then(|| data.clone())));
    left_out(&desk, "volume ring", 3, ("ring/volume", 4), "no 'core'");
    left_out(&desk, "export ring", 3, ("ring/points", 4), "no 'core'");
    left_out(&desk, "volume ring -o slow --retime 2", 3, ("slow/volume", 6), "no 'core'");
    // Smoke alone needs no air, but between frames.
    for (line, made) in [("volume ring -o fog", 5), ("volume ring -o fast --retime 0.5", 3)] {
        let (out, _) = desk.run(&format!("{line} --grid density --grid temperature"), 0);
        assert!(out.contains(&format!("{made} volumes written")), "{line}:\n{out}");
    }
}

#[test]
fn grids_that_smoke_lacks_are_refused_and_its_own_are_named() {
    let desk = ring();
    for (line, words) in [
        ("mesh ring", ["no particles", "meniscus volume"]),
        ("volume ring --grid surface", ["surface", "temperature"]),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(words.iter().all(|word| talk.contains(word)), "{line}:\n{talk}");
    }
    assert!(!desk.path("ring/mesh").exists() && !desk.path("ring/volume").exists(), "nothing is left behind");
    // Among other grids it is left out, as velocities are that a liquid does not have.
    let (out, _) = desk.run("volume ring --grid surface --grid density --frames 1", 0);
    assert!(out.contains("1 volumes written"), "{out}");
}

#[test]
fn leakage_through_solids_is_reported() {
    let desk = Desk::new();
    // A plate thinner than a panel cannot stop the wind; a plane stops it by leaving it out.
    let plate = "[[world.collider]]\nshape = { box = { min = [-0.01, -0.4, -0.4], max = [0.01, 0.4, 0.4] } }";
    let plane = "[[world.collider]]\nshape = { plane = { point = [0, 0, -1], normal = [0, 0, 1] } }";
    let wind = |collider: &str, wind: &str| {
        RING.replace("[smoke]\n", &format!("{collider}\n[smoke]\nwind = {wind}\n"))
            .replace("center = [0, 0, 0]", "center = [1.5, 0, 0]")
    };
    desk.write("plate.toml", wind(plate, "[1, 0, 0]"));
    let (_, talk) = desk.run("simulate plate.toml --frames 1-2", 0);
    assert!(talk.contains("at world.collider.0 leaks through it (lower smoke.spacing)"), "{talk}");
    desk.write("plane.toml", wind(plane, "[1, 0, -0.5]"));
    let (_, talk) = desk.run("simulate plane.toml --frames 1-2", 0);
    assert!(talk.contains("0.500 m/s") && talk.contains("plane"), "{talk}");
    desk.write("along.toml", wind(plane, "[1, 0, 0]"));
    let (_, talk) = desk.run("simulate along.toml --frames 1-2", 0);
    assert!(!talk.contains("m/s normal to a plane") && !talk.contains("goes through"), "{talk}");
    // A ball does keep it out.
    desk.write("ball.toml", PLUME);
    let (_, talk) = desk.run("simulate ball.toml --frames 1-4", 0);
    assert!(!talk.contains("goes through"), "{talk}");
}

#[test]
fn losses_of_remeshing_and_solids_too_small_are_reported_once() {
    let desk = Desk::new();
    let balls = [(1.0, 0.3), (2.0, 0.002)].map(|(x, radius)| {
        format!("[[world.collider]]\nshape = {{ sphere = {{ center = [{x}, 0, 0], radius = {radius} }} }}\n")
    });
    let remeshing = "[smoke.flow.remesh]\nstrain = 0.2\nweak = 0.1\n";
    // Coarse and short: it is run eight times.
    let text = RING.replace("[smoke]\n", &format!("{}\n[smoke]\nwind = [1, 0, 0]\n", balls.concat()));
    let text = text.replace("spacing = 0.05", "spacing = 0.07").replace("1-5", "1-3");
    desk.write("balls.toml", text.replace("[surface]", &format!("{remeshing}[surface]")));
    let count = |line: &str, words: &str| {
        let (_, talk) = desk.run(line, 0);
        talk.matches(words).count()
    };
    let (bare, redistributed) =
        ("air goes through world.collider.1:", "of total circulation was redistributed");
    assert_eq!(count("simulate balls.toml", bare), 1);
    assert_eq!(count("simulate balls.toml --set world.collider.1.shape.sphere.radius=0.2 -o large", bare), 0);
    // The sum over the shot is that of its log, however often it was stopped.
    assert_eq!(count("simulate balls.toml -o redistributed", redistributed), 1);
    assert_eq!(count("simulate balls.toml -o parts --frames 1-2", redistributed), 1);
    assert_eq!(count("simulate balls.toml -o parts", redistributed), 1);
    let last = |folder: &str| {
        let (_, talk) = desk.run(&format!("simulate balls.toml -o {folder} --frames 1-4"), 0);
        talk.lines().find(|line| line.contains(redistributed)).unwrap().to_owned()
    };
    assert_eq!(last("parts"), last("redistributed"));
    assert_eq!(count("simulate balls.toml --set smoke.flow.remesh.weak=1e-3 -o fine", redistributed), 0);
}

#[test]
fn more_tracers_from_a_mesh_than_can_be_counted_are_refused_before_any_is_made() {
    let desk = Desk::new();
    let corners = (0..8).map(|i| format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2));
    let faces =
        ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"].map(|face| format!("f {face}\n"));
    desk.write("cube.obj", corners.chain(faces).collect::<String>());
    let emitter = "[[smoke.emitter]]\nrate = 10\nshape = { mesh = { file = \"cube.obj\", resolution = 16 } }";
    desk.write("cube.toml", RING.replace("[surface]", &format!("{emitter}\n[surface]")));
    desk.run("simulate cube.toml --dry-run", 0);
    for what in ["simulate cube.toml", "simulate cube.toml --dry-run", "plan cube.toml"] {
        let fine = "--set smoke.tracers=0.05 --set smoke.emitter.0.shape.mesh.scale=40";
        let line = if what.starts_with("plan") {
            format!("{what} {fine}")
        } else {
            format!("{what} {fine} -o fine")
        };
        let (_, talk) = desk.run(&line, 2);
        assert!(talk.contains("2³¹") && talk.contains("smoke.tracers"), "{what}:\n{talk}");
    }
}
