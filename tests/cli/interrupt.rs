//! Ctrl-C: stops soon, keeps what is finished, and the same command goes on.
//!
//! Signals are SIGTERM: a shell ignores SIGINT for jobs in its background, and the tests with it.

use super::*;
use std::{
    process::{Command, Stdio},
    time::{Duration, Instant},
};

#[test]
fn an_interrupt_keeps_finished_frames_and_the_run_continues() {
    let desk = Desk::new();
    let line = ["simulate", "small.toml", "-o", "shot", "--frames", "1-400", "--progress", "none"];
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args(line)
        .current_dir(desk.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let started = Instant::now();
    while !desk.path("shot/cache/frame_0003.mcf").exists() {
        assert!(started.elapsed() < Duration::from_secs(60), "no third frame after a minute");
        std::thread::sleep(Duration::from_millis(5));
    }
    let signal = Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap();
    assert!(signal.success());
    let stopped = Instant::now();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(stopped.elapsed() < Duration::from_secs(5));

    let frames = desk.names("shot/cache").len();
    assert!((3..400).contains(&frames), "{frames} frames");
    let (_, why) = desk.run("verify shot", 10);
    assert!(why.contains("missing") && !why.contains("corrupt"), "{why}");
    let more = frames + 1;
    let (_, talk) = desk.run(&format!("simulate small.toml -o shot --frames 1-{more}"), 0);
    assert!(talk.contains("continuing after frame"), "{talk}");
    desk.run(&format!("simulate small.toml -o whole --frames 1-{more}"), 0);
    assert_eq!(desk.bytes("shot/cache"), desk.bytes("whole/cache"));
}

#[test]
fn an_interrupt_keeps_finished_volumes_and_the_job_continues() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-8", 0);
    // Fine enough that eight frames are not done before the signal comes.
    let line = ["volume", "small", "--voxel", "0.12", "--progress", "none"];
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args(line)
        .current_dir(desk.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let started = Instant::now();
    // They are made side by side, and the second may be done first.
    let is_there = |frame: u32| desk.path(&format!("small/volume/liquid_{frame:04}.vdb")).exists();
    while !(is_there(1) && is_there(2)) {
        assert!(started.elapsed() < Duration::from_secs(120), "no two volumes after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));

    let made = desk.names("small/volume").len();
    assert!((2..8).contains(&made), "{made} volumes");
    let manifest = fs::read_to_string(desk.path("small/shot.json")).unwrap();
    assert!(manifest.contains("volume/liquid_{:04}.vdb"), "what was finished is named: {manifest}");
    let (out, _) = desk.run("volume small --voxel 0.12", 0);
    assert!(out.contains(&format!("{made} up to date")), "{out}");
    assert_eq!(desk.names("small/volume").len(), 8);
}
