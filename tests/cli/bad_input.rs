//! Bad input: place, finding, expectation and next step; nothing that was computed is lost.

use super::*;
use meniscus::cache::Lock;

/// Runs the tool, expects `code`, and every word on stderr.
fn expect(desk: &Desk, line: &str, code: i32, words: &[&str]) {
    let (_, talk) = desk.run(line, code);
    let flat = talk.split_whitespace().collect::<Vec<_>>().join(" ");
    for word in words {
        assert!(
            flat.contains(word) || flat.contains(&shown(word)),
            "meniscus {line}: {word:?} is missing in\n{talk}"
        );
    }
}

#[test]
fn presets_that_are_not_there_or_not_right() {
    let desk = Desk::new();
    expect(&desk, "shot dam-brake", 2, &["dam-brake", "dam-break"]);
    expect(&desk, "shot nowhere/shot.toml", 2, &["nowhere/shot.toml"]);
    desk.write("bad.toml", SMALL.replace("iterations = 6", "iteratons = 6"));
    expect(&desk, "shot bad.toml", 2, &["bad.toml:10:1", "iteratons", "iterations"]);
    expect(&desk, "shot small.toml --set liquid.spacing=-1", 2, &["--set", "spacing", "above 0"]);
    expect(&desk, "shot small.toml --frames :", 2, &["1-96"]);
    expect(&desk, "shot small.toml --frames 9-2", 2, &["9-2"]);
    assert!(!desk.path("small").exists() && !desk.path("bad").exists());
}

#[test]
fn programs_get_problems_with_their_place() {
    let desk = Desk::new();
    let error = |line: &str| {
        let (_, talk) = desk.run(line, 2);
        let event: serde_json::Value = serde_json::from_str(talk.trim()).unwrap();
        assert_eq!(event["event"], "error", "{talk}");
        event["data"].clone()
    };
    let found = error("simulate small.toml --set liquid.cfl=99 --progress json");
    assert_eq!(found["text"], "`liquid.cfl` is out of range");
    let problem = &found["problems"][0];
    let place = [&problem["key"], &problem["file"], &problem["line"], &problem["column"]];
    assert_eq!(place, [&"liquid.cfl".into(), &"--set".into(), &serde_json::json!(1), &serde_json::json!(12)]);
    assert!(problem["label"].as_str().unwrap().starts_with("found 99, expected"), "{problem}");
    let found = error("simulate nope --progress json");
    assert_eq!(found["problems"].as_array().unwrap().len(), 0);
    assert!(found["help"].as_str().unwrap().contains("`dam-break`"), "{found}");
}

#[test]
fn a_cache_of_other_settings_is_refused_until_forced() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-3", 0);
    let before = desk.bytes("small/cache");
    expect(&desk, "simulate small.toml --set liquid.iterations=7", 14, &["--force", "-o"]);
    assert_eq!(before, desk.bytes("small/cache"));
    desk.run("simulate small.toml --set liquid.iterations=7 --force --frames 1-3", 0);
    assert_ne!(before, desk.bytes("small/cache"));
}

#[test]
fn a_damaged_frame_is_named_and_refused() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let path = desk.path("small/cache/frame_0003.mcf");
    let whole = fs::read(&path).unwrap();
    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    for damaged in [&whole[..whole.len() - 1], &whole[..100], &flipped] {
        fs::write(&path, damaged).unwrap();
        expect(&desk, "mesh small", 12, &["frame 0003", "frame_0003.mcf"]);
        expect(&desk, "verify small", 12, &["frame_0003.mcf: corrupt", "meniscus simulate"]);
        assert_eq!(desk.names("small/mesh").len(), 4, "the other frames are meshed");
        fs::remove_dir_all(desk.path("small/mesh")).unwrap();
    }
}

#[test]
fn no_cache_a_locked_one_and_one_of_another_version() {
    let desk = Desk::new();
    expect(&desk, "mesh nowhere.dir/cache -o out", 10, &["nowhere.dir/cache"]);
    fs::create_dir(desk.path("hollow")).unwrap();
    expect(&desk, "mesh hollow", 10, &["hollow"]);
    expect(&desk, "info hollow", 10, &["hollow"]);
    desk.run("simulate small.toml --frames 1-2", 0);
    let lock = Lock::acquire(&desk.path("small/cache")).unwrap();
    expect(&desk, "simulate small.toml", 11, &["small/cache"]);
    drop(lock);
    let path = desk.path("small/cache/frame_0002.mcf");
    let mut newer = fs::read(&path).unwrap();
    newer[VERSION_AT] += 1;
    fs::write(&path, newer).unwrap();
    expect(&desk, "simulate small.toml", 13, &["frame_0002.mcf", "version"]);
    expect(&desk, "mesh small", 13, &["frame_0002.mcf", "version"]);
}

/// Where the format version stands in a frame, see docs/formats/cache.md.
const VERSION_AT: usize = 8;

#[test]
fn a_folder_that_cannot_be_written() {
    let desk = Desk::new();
    desk.write("file", "");
    expect(&desk, "simulate small.toml -o file/shot", 1, &["file/shot", "-o"]);
    desk.run("simulate small.toml --frames 1-2", 0);
    expect(&desk, "mesh small -o file/out", 1, &["file/out", "-o"]);
}

#[test]
fn a_simulation_that_diverges_is_reported_and_existing_frames_stay() {
    let desk = Desk::new();
    let line = "simulate small.toml --set liquid.source.0.velocity=[1e38,1e38,1e38]";
    expect(&desk, line, 20, &["frame 0002", "liquid", "particle 0", "try"]);
    expect(&desk, "verify small", 10, &["4 missing"]);
    assert_eq!(desk.names("small/cache"), ["frame_0001.mcf"]);
}

#[test]
fn a_fall_that_diverges_keeps_every_frame_before_it_with_either_solver() {
    let desk = Desk::new();
    // Through nothing at 10⁹ m/s²: beyond 10⁸ m/s a tenth of a second later.
    desk.write("fall.toml", SMALL.replace("tank = { min = [0, 0, 0], max = [1.6, 0.8, 1.2] }", FAR_COLLIDER));
    for solver in ["accelerated", "jacobi"] {
        let line = format!(
            "simulate fall.toml -o {solver} --set liquid.solver={solver} --set world.gravity=[0,0,-1e9]"
        );
        let words =
            ["frame 0004", "liquid diverged in substep", "particle", "velocity of", "liquid.max_substeps"];
        expect(&desk, &line, 20, &words);
        expect(&desk, &format!("verify {solver}"), 10, &["2 of 5 files are not valid"]);
        let kept = desk.names(&format!("{solver}/cache"));
        assert_eq!(kept, ["frame_0001.mcf", "frame_0002.mcf", "frame_0003.mcf"]);
    }
}

/// A collider that the liquid does not meet.
const FAR_COLLIDER: &str = "box = { min = [100, 0, 0], max = [101, 1, 1] }";

#[test]
fn particle_files_that_are_not_right() {
    let desk = Desk::new();
    desk.write("good_1.xyz", "0 0 0\n0.1 0 0\n0 0.1 0\n");
    desk.write("nan_2.xyz", "0 0 0\n0.1 nan 0\n");
    desk.write("empty_3.xyz", "");
    let line = |file: &str| format!("mesh {file} --spacing 0.1 -o out");
    expect(&desk, &line("nan_2.xyz"), 1, &["nan_2.xyz", "particle 1"]);
    expect(&desk, &line("empty_3.xyz"), 1, &["empty_3.xyz"]);
    expect(&desk, &format!("{} --fps 0", line("good_1.xyz")), 2, &["--fps"]);
    expect(&desk, &format!("{} --frames 7", line("good_1.xyz")), 3, &["frame 0007", "no file"]);
    desk.write("none_4.xyz", "0\n");
    expect(&desk, &line("none_4.xyz"), 1, &["none_4.xyz", "no particles"]);
    expect(&desk, &line("absent.xyz"), 1, &["absent.xyz"]);
    expect(&desk, &line("good_1.xyz nan_2.xyz"), 3, &["nan_2.xyz", "particle 1"]);
    assert_eq!(desk.names("out/mesh").len(), 1, "the good file is meshed");
    expect(&desk, "mesh good_1.xyz -o out", 2, &["--spacing"]);
    expect(&desk, "mesh good_1.xyz --spacing 0.1", 2, &["-o DIR"]);
    expect(&desk, "mesh good_1.xyz --spacing nan -o out", 2, &["--spacing"]);
    expect(&desk, "mesh good_1.xyz --spacing 0.1 --voxel -2 -o out", 2, &["voxel"]);
    expect(&desk, "mesh good_1.xyz --spacing 0.1 --voxel 0.001 -o out", 2, &["voxel", "0.05"]);
}

#[cfg(target_os = "linux")]
#[test]
fn results_that_cannot_be_written_are_not_passed_over() {
    let desk = Desk::new();
    for line in ["shot small.toml --frames 1-2", "info small --json", "verify small", "presets"] {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let child = std::process::Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
            .args(line.split(' '))
            .current_dir(desk.path("."))
            .stdout(full)
            .output()
            .unwrap();
        assert_eq!(child.status.code(), Some(28), "{line}");
        assert!(String::from_utf8_lossy(&child.stderr).contains("standard output"), "{line}");
    }
    desk.run("verify small", 0);
}
