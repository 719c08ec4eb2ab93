//! Branches: a shot goes on from a frame of another with other settings.

use super::*;
use meniscus::{
    cache::{read_frame, read_header},
    frame::Stream,
};

fn frame(desk: &Desk, shot: &str, index: u32) -> PathBuf {
    desk.path(&format!("{shot}/cache/frame_{index:04}.mcf"))
}

fn streams(desk: &Desk, shot: &str, index: u32) -> Vec<Stream> {
    read_frame(&frame(desk, shot, index)).unwrap().0.streams
}

fn parent() -> Desk {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk
}

#[test]
fn a_branch_shares_the_frames_before_it_and_goes_on_with_other_settings() {
    let desk = parent();
    let thick = "simulate small --from 3 --set liquid.viscosity.dynamic=50 -o thick";
    let (out, talk) = desk.run(thick, 0);
    assert!(talk.contains("branches from frame 0003 of small: 2 frames before it are shared"), "{talk}");
    assert!(out.contains("2 frames simulated") && out.contains("3 up to date"), "{out}");
    // Rust's library does not give the number of a file on Windows.
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let file = |shot: &str, index| fs::metadata(frame(&desk, shot, index)).unwrap().ino();
        for index in 1..=2 {
            assert_eq!(file("small", index), file("thick", index), "frame {index} is one file");
        }
    }
    // The branch starts with the state of its first frame, which has a key of its own.
    let key = |shot: &str, index| read_header(&frame(&desk, shot, index)).unwrap().key;
    assert!(streams(&desk, "small", 3) == streams(&desk, "thick", 3));
    assert!(key("small", 3) != key("thick", 3) && key("thick", 3) == key("thick", 5));
    assert!(streams(&desk, "small", 5) != streams(&desk, "thick", 5));
    // Lines of the log about shared frames are there too.
    assert_eq!(fs::read_to_string(desk.path("thick/log.jsonl")).unwrap().lines().count(), 4);

    // The same command, or the branch's own preset, goes on where it stopped, with the same bytes.
    let whole = desk.bytes("thick/cache");
    fs::remove_file(frame(&desk, "thick", 5)).unwrap();
    let (out, _) = desk.run(thick, 0);
    assert!(out.contains("1 frames simulated"), "{out}");
    fs::remove_file(frame(&desk, "thick", 4)).unwrap();
    fs::remove_file(frame(&desk, "thick", 5)).unwrap();
    desk.run("simulate thick/preset.toml -o thick", 0);
    assert_eq!(whole, desk.bytes("thick/cache"));
    let (out, _) = desk.run("simulate thick/preset.toml -o thick --force", 0);
    assert!(out.contains("2 frames simulated") && whole == desk.bytes("thick/cache"), "{out}");

    // Everything that reads caches takes both kinds of frames.
    desk.run("verify thick", 0);
    desk.run("mesh thick", 0);
    assert_eq!(desk.names("thick/mesh").len(), 5);
    desk.run("volume thick --frames 2,4", 0);
    desk.run("simulate small.toml", 0);
    // A frame of neither simulation is found.
    fs::remove_file(frame(&desk, "thick", 3)).unwrap();
    fs::copy(frame(&desk, "small", 3), frame(&desk, "thick", 3)).unwrap();
    let (_, talk) = desk.run("verify thick", 14);
    assert!(talk.contains("frame_0003.mcf: foreign"), "{talk}");
}

#[test]
fn a_branch_without_changes_goes_on_as_the_shot_itself_and_branches_again() {
    let desk = parent();
    let (_, talk) = desk.run("shot small --from 2", 0);
    assert!(talk.contains("1 frames before it are shared"), "{talk}");
    for index in 1..=5 {
        assert!(streams(&desk, "small", index) == streams(&desk, "small-from-2", index), "frame {index}");
    }
    assert_eq!(desk.bytes("small-from-2/mesh").len(), 5);
    desk.run("simulate small-from-2 --from 4 --set world.gravity=[0,0,5] -o up", 0);
    let keys: Vec<u64> = (1..=5).map(|index| read_header(&frame(&desk, "up", index)).unwrap().key).collect();
    assert!(
        keys[0] != keys[1] && keys[1] == keys[2] && keys[2] != keys[3] && keys[3] == keys[4],
        "{keys:x?}"
    );
    desk.run("verify up", 0);
    // From before the first branch there is one again.
    desk.run("simulate up --from 3 --set world.gravity=[0,0,1] --frames 1-4 -o earlier", 0);
    let preset = fs::read_to_string(desk.path("earlier/preset.toml")).unwrap();
    assert_eq!(preset.matches("[[branch]]").count(), 2, "{preset}");
    desk.run("verify earlier", 0);
}

#[test]
fn what_gravity_and_tension_add_is_not_taken_for_an_error_of_the_solver() {
    let desk = parent();
    let clamps = |shot: &str| {
        let log = fs::read_to_string(desk.path(&format!("{shot}/log.jsonl"))).unwrap();
        let lines = log.lines().map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap());
        lines.map(|line| line["liquid"]["clamps"]["energy"].as_u64().unwrap()).sum::<u64>()
    };
    let before = clamps("small");
    // Three times as heavy: all potential energy is above that of the start.
    desk.run("simulate small --from 3 --set world.gravity=[0,0,-30] -o heavy", 0);
    assert_eq!(clamps("heavy"), before);
    desk.run("simulate small --from 3 --set world.gravity=[0,0,30] -o up", 0);
    assert_eq!(clamps("up"), before);
    let height = |shot: &str| {
        let all = streams(&desk, shot, 5);
        all[0].vec3("velocity").unwrap().iter().map(|v| v.z).sum::<f32>() / all[0].len() as f32
    };
    // Two frames at 30 m/s² in place of two at -9.81 m/s².
    let gained = height("up") - height("small");
    assert!((1.5..4.0).contains(&gained), "{gained} m/s");
    desk.run("simulate small --from 3 --set liquid.surface_tension.coefficient=20 -o tense", 0);
    assert_eq!(clamps("tense"), before);
}

#[test]
fn what_cannot_change_in_the_middle_is_refused() {
    let desk = parent();
    let refused = |line: &str, words: &[&str]| {
        let (_, talk) = desk.run(line, 2);
        assert!(words.iter().all(|word| talk.contains(word)), "{talk}");
        assert!(!desk.path("bad").exists());
    };
    refused(
        "simulate small --from 3 --set liquid.spacing=0.2 --set liquid.xsph.strength=0.1 -o bad",
        &["liquid.spacing: 0.1 in the folder, 0.2 now", "cannot change in the middle"],
    );
    refused("simulate small --from 3 --set fps=30 -o bad", &["fps: 24.0 in the folder, 30.0 now"]);
    refused("simulate small --from 3 --set liquid.source.0.jitter=0.25 -o bad", &["liquid.source.0.jitter"]);
    refused(
        "simulate small --from 3 --set liquid.source.0.velocity=[1,0,0] -o bad",
        &["liquid.source.0.velocity"],
    );
    refused("simulate small --from 1 -o bad", &["after the shot's first frame, 1"]);
    refused("simulate small --from 9 -o bad", &["no such cached frame; the nearest is frame 5"]);
    refused("simulate small.toml --from 3 -o bad", &["found no preset.toml in small.toml"]);
    refused("simulate small --from 3 --quality draft -o bad", &["--quality"]);
    let (_, talk) = desk.run("simulate small --from 3 -o small", 2);
    assert!(talk.contains("needs a folder of its own"), "{talk}");
    // Rotation of particles is state that the frame does not have.
    let (_, talk) = desk.run(
        "simulate small --from 3 --set liquid.vorticity=none --set liquid.micropolar={} -o micropolar",
        2,
    );
    assert!(talk.contains("microrotation") && talk.contains("from its start"), "{talk}");
    assert!(
        desk.names("micropolar/cache").is_empty(),
        "nothing is linked before the branch is known to start"
    );
    // Frames of other settings are kept, unless they are given up, also where only later ones are there.
    desk.run("simulate small.toml --set liquid.iterations=3 --frames 5 -o later", 0);
    let later = desk.bytes("later/cache");
    desk.run("simulate small --from 3 --set liquid.iterations=9 -o later", 14);
    assert_eq!(later, desk.bytes("later/cache"));
    desk.run("simulate small.toml --set liquid.iterations=3 -o other", 0);
    let before = desk.bytes("other/cache");
    desk.run("simulate small --from 3 --set liquid.iterations=9 -o other", 14);
    assert_eq!(before, desk.bytes("other/cache"));
    let rotating = "--set liquid.vorticity=none --set liquid.micropolar={}";
    desk.run(&format!("simulate small --from 3 {rotating} -o other --force"), 2);
    assert_eq!(before, desk.bytes("other/cache"));
    desk.run("mesh other", 0);
    // A frame that the shot does not have is given up as well.
    fs::remove_file(frame(&desk, "small", 1)).unwrap();
    let (out, _) =
        desk.run("simulate small --from 3 --set liquid.iterations=9 -o other --force --frames 2-5", 0);
    assert!(out.contains("2 frames simulated"), "{out}");
    assert_eq!(desk.names("other/cache").len(), 4);
    let manifest = fs::read_to_string(desk.path("other/shot.json")).unwrap();
    assert!(!manifest.contains(".ply"), "meshes of what was given up are not listed: {manifest}");
    let line = |shot: &str| {
        let log = fs::read_to_string(desk.path(&format!("{shot}/log.jsonl"))).unwrap();
        let lines = log.lines().filter(|line| line.starts_with("{\"frame\":2,"));
        lines.map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(line("small"), line("other"));
    assert!(streams(&desk, "small", 2) == streams(&desk, "other", 2));
    desk.run("verify other", 0);
}

#[test]
fn a_branch_without_its_first_frame_is_not_simulated_from_the_seeds() {
    let desk = parent();
    desk.run("simulate small --from 3 --set liquid.iterations=9 -o other --frames 1-4", 0);
    for index in 3..=4 {
        fs::remove_file(frame(&desk, "other", index)).unwrap();
    }
    let (_, talk) = desk.run("simulate other/preset.toml -o other", 2);
    assert!(talk.contains("found no valid frame 0003") && talk.contains("branch again"), "{talk}");
    // Frames before it belong to the other shot.
    desk.run("simulate small --from 3 --set liquid.iterations=9 -o other", 0);
    fs::remove_file(frame(&desk, "other", 2)).unwrap();
    let (_, talk) = desk.run("simulate other/preset.toml -o other", 0);
    assert!(talk.contains("1 frames before the branch at frame 0003 are not there (first: 0002)"), "{talk}");

    let preset = fs::read_to_string(desk.path("other/preset.toml")).unwrap();
    desk.write("bad.toml", preset.replace("frame = 3", "frame = 1"));
    let (_, talk) = desk.run("simulate bad.toml", 2);
    assert!(talk.contains("found 1, expected a frame after 1"), "{talk}");
    let cut = preset.find("before = \"").unwrap() + 10;
    desk.write("bad.toml", format!("{}zz{}", &preset[..cut], &preset[cut + 2..]));
    let (_, talk) = desk.run("simulate bad.toml", 2);
    assert!(talk.contains("expected 16 hexadecimal digits"), "{talk}");
}

#[test]
fn what_sheets_and_smoke_cannot_change_is_refused() {
    let desk = Desk::new();
    desk.write("ring.toml", super::smoke::RING);
    desk.run("simulate ring.toml --frames 1-3", 0);
    for set in ["smoke.ring.0.circulation=2", "smoke.spacing=0.06", "smoke.tracers=0.3"] {
        let (_, talk) = desk.run(&format!("simulate ring --from 2 --set {set} -o bad"), 2);
        assert!(talk.contains("cannot change in the middle"), "{talk}");
    }
    let (out, _) = desk.run("simulate ring --from 2 --set smoke.wind=[1,0,0] --frames 1-3 -o windy", 0);
    assert!(out.contains("1 frames simulated") && out.contains("2 up to date"), "{out}");
    desk.run("simulate falling-sheets --quality draft --frames 1-2", 0);
    for set in ["sheet.0.pin=[{at={points=[0]}}]", "sheet.0.velocity=[0,0,2]"] {
        let (_, talk) = desk.run(&format!("simulate falling-sheets-draft --from 2 --set {set} -o bad"), 2);
        assert!(talk.contains("cannot change in the middle") && talk.contains("sheet.0."), "{talk}");
    }
    desk.run(
        "simulate falling-sheets-draft --from 2 --set sheet.0.stiffness=[50,50] --frames 1-3 -o soft",
        0,
    );
}
