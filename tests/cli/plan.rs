//! What a plan says, and that it comes true.

use super::*;
use serde_json::Value;

fn plan(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.run(&format!("plan {line} --json --progress none"), 0).0).unwrap()
}

#[test]
fn a_plan_tells_what_the_shot_then_takes() {
    let desk = Desk::new();
    desk.write("shot.toml", SMALL.replace("spacing = 0.1", "spacing = 0.05"));
    let told = plan(&desk, "shot.toml");
    assert!(!desk.path("shot").exists());
    desk.run("shot shot.toml", 0);
    assert_eq!(told["particles"], 4096);
    let size = |folder: &str| desk.bytes(folder).iter().map(|(_, bytes)| bytes.len() as f64).sum::<f64>();
    let near = |name: &str, real: f64, part: f64| {
        let told = told[name].as_f64().unwrap();
        assert!((told / real - 1.0).abs() < part, "{name}: told {told}, found {real}");
    };
    near("cache", size("shot/cache"), 0.25);
    near("meshes", size("shot/mesh"), 0.25);
    let log = fs::read_to_string(desk.path("shot/log.jsonl")).unwrap();
    let sum = |key: &str| {
        log.lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap()["liquid"][key].as_f64().unwrap())
            .sum::<f64>()
    };
    near("substeps", sum("substeps"), 0.25);
    near("iterations", sum("iterations"), 0.25);
    for name in ["seconds", "bricks", "uncertainty", "calibration_seconds"] {
        assert!(told[name].as_f64().unwrap() > 0.0, "{name}: {told}");
    }
}

#[test]
fn a_job_shorter_than_the_clock_tells_has_figures_all_the_same() {
    let desk = Desk::new();
    for frames in ["1", "1-2"] {
        let told = plan(&desk, &format!("small.toml --frames {frames}"));
        for name in ["seconds", "surface_seconds", "uncertainty", "cache", "substeps"] {
            assert!(told[name].as_f64().is_some_and(f64::is_finite), "{frames}: {name} in {told}");
        }
    }
}

#[test]
fn the_bound_counts_the_samples_of_meshes() {
    let (told, _) = Desk::new().run("shot figure-bath --quality draft --dry-run", 0);
    let words = told.lines().find_map(|line| line.strip_prefix("memory     at most about ")).unwrap();
    let bound: f64 = words.trim_end_matches(" MiB").parse().unwrap();
    // Its simulation alone takes 45 MiB, most of it before there is a particle; without the mesh it would be 15.
    assert!((45.0..90.0).contains(&bound), "{told}");
    let (told, _) = Desk::new().run("simulate figure-bath --quality draft --dry-run", 0);
    assert!(told.contains("at most about") && !told.contains("surface"), "{told}");
}

#[test]
fn what_the_preset_does_not_name_is_told_not_to_run() {
    let desk = Desk::new();
    let bare = SMALL.replace("[liquid.vorticity]", "").replace("mesh = [\"ply\"]", "");
    desk.write("bare.toml", bare);
    let (text, talk) = desk.run("plan bare.toml", 0);
    let line = |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    assert!(line("does not").contains("liquid.vorticity") && !line("runs").contains("vorticity"), "{text}");
    assert!(line("surface").contains("none") && line("particles").ends_with("512"), "{text}");
    assert!(line("time").contains("threads") && talk.contains("Progress: 100%"), "{text}{talk}");
    assert_eq!(plan(&desk, "bare.toml")["meshes"], 0.0);
}

#[test]
fn too_much_memory_is_refused_before_the_start() {
    let desk = Desk::new();
    desk.run("simulate small.toml -o there --frames 1-2", 0);
    desk.write("points.xyz", "0 0 0\n0.1 0 0\n0 0.1 0\n");
    for line in [
        "plan small.toml",
        "shot small.toml",
        "simulate small.toml",
        "mesh there",
        "mesh points.xyz --spacing 0.1 -o out",
    ] {
        let (out, talk) = desk.run(&format!("{line} --max-memory 1MiB"), 33);
        assert!(out.is_empty() && talk.contains("--max-memory"), "{line}: {out}{talk}");
        desk.run(&format!("{line} --max-memory 1GiB"), 0);
    }
    assert!(desk.path("small/mesh").exists() && desk.path("there/mesh").exists());
}

#[test]
fn plans_of_what_cannot_run_say_so() {
    let desk = Desk::new();
    desk.run("plan nothing", 2);
    desk.run("plan small.toml --frames 0-3", 2);
    desk.run("plan small.toml --set liquid.source.0.velocity=[1e38,1e38,1e38]", 20);
    // A sheet thinner than the pilot's spacing is calibrated at its own.
    desk.write(
        "sheet.toml",
        SMALL.replace("spacing = 0.1", "spacing = 0.01").replace(
            "min = [0, 0, 0], max = [0.8, 0.8, 0.8]",
            "min = [0.1, 0.1, 0.3], max = [0.7, 0.7, 0.31]",
        ),
    );
    assert_eq!(plan(&desk, "sheet.toml --frames 1-2")["particles"], 3600);
}

/// The model of src/run/plan/memory.rs against real peaks, at the size of a preview.
#[cfg(target_os = "linux")]
#[test]
fn the_memory_model_is_near_the_real_peak() {
    let desk = Desk::new();
    let preset = "dam-break --quality preview --frames 1-4";
    let told = plan(&desk, preset)["memory"].as_f64().unwrap();
    let found = peak(&desk, &format!("shot {preset} -o shot"));
    println!("told {:.1} MiB, found {:.1} MiB", told / f64::from(1 << 20), found / f64::from(1 << 20));
    assert!((0.75..1.5).contains(&(told / found)), "told {told}, found {found}");
}

/// The peak of resident memory while the tool runs [bytes].
#[cfg(target_os = "linux")]
pub(super) fn peak(desk: &Desk, line: &str) -> f64 {
    let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args(line.split(' '))
        .current_dir(desk.path("."))
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let mut peak = 0.0;
    while child.try_wait().unwrap().is_none() {
        let status = fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        if let Some(kib) = line.and_then(|line| line.trim().strip_suffix(" kB")) {
            peak = 1024.0 * kib.trim().parse::<f64>().unwrap();
        }
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    peak
}
