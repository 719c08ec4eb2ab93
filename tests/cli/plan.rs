//! What a plan forecasts, and that it comes true.

use super::*;
use serde_json::Value;

pub(super) fn plan(desk: &Desk, line: &str) -> Value {
    serde_json::from_str(&desk.run(&format!("plan {line} --json --progress none"), 0).0).unwrap()
}

/// The system of a plan.
pub(super) fn system<'a>(plan: &'a Value, name: &str) -> &'a Value {
    plan["systems"].as_array().unwrap().iter().find(|system| system["name"] == name).unwrap()
}

/// Number of elements of a kind in a system, at the start.
fn count(system: &Value, name: &str) -> f64 {
    number(system, name, "start")
}

/// Number of elements of a kind in a system at the shot's `start` or `end`.
pub(super) fn number(system: &Value, name: &str, when: &str) -> f64 {
    let counts = system["counts"].as_array().unwrap();
    counts.iter().find(|count| count["name"] == name).unwrap()[when].as_f64().unwrap()
}

#[test]
fn a_plan_forecasts_what_the_shot_then_takes() {
    let desk = Desk::new();
    desk.write("shot.toml", SMALL.replace("spacing = 0.1", "spacing = 0.05"));
    let plan = plan(&desk, "shot.toml");
    assert!(!desk.path("shot").exists());
    desk.run("shot shot.toml", 0);
    let liquid = system(&plan, "liquid");
    assert_eq!(count(liquid, "particles"), 4096.0);
    let size = |folder: &str| desk.bytes(folder).iter().map(|(_, bytes)| bytes.len() as f64).sum::<f64>();
    let near = |name: &str, forecast: &Value, measured: f64| {
        let forecast = forecast.as_f64().unwrap();
        assert!((forecast / measured - 1.0).abs() < 0.25, "{name}: forecast {forecast}, measured {measured}");
    };
    let mesh = &plan["products"][0];
    assert_eq!(mesh["name"], "mesh");
    near("cache", &plan["cache"], size("shot/cache"));
    near("mesh", &mesh["bytes"], size("shot/mesh"));
    near("disk", &plan["disk"], size("shot/cache") + size("shot/mesh"));
    let log = fs::read_to_string(desk.path("shot/log.jsonl")).unwrap();
    let sum = |key: &str| {
        log.lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap()["liquid"][key].as_f64().unwrap())
            .sum::<f64>()
    };
    near("substeps", &liquid["substeps"], sum("substeps"));
    near("iterations", &liquid["iterations"], sum("iterations"));
    for name in ["seconds", "memory", "uncertainty", "calibration_seconds"] {
        assert!(plan[name].as_f64().unwrap() > 0.0, "{name}: {plan}");
    }
}

#[test]
fn systems_have_forecasts_of_one_shape() {
    let desk = Desk::new();
    let mut keys = Vec::new();
    for (preset, name, elements) in [
        ("dam-break", "liquid", "particles"),
        ("smoke-ring", "smoke", "vortons"),
        ("cloth-over-ellipsoid", "sheets", "points"),
    ] {
        let plan = plan(&desk, &format!("{preset} --quality draft --frames 1-3"));
        let system = system(&plan, name);
        assert!(count(system, elements) > 0.0, "{plan}");
        keys.push(system.as_object().unwrap().keys().cloned().collect::<Vec<_>>());
        for figure in ["seconds", "cache", "memory", "disk"] {
            assert!(plan[figure].as_f64().unwrap() > 0.0, "{preset}: {figure} in {plan}");
        }
    }
    assert!(keys[0] == keys[1] && keys[1] == keys[2], "{keys:?}");
}

#[test]
fn sheets_that_share_the_liquids_substeps_are_forecast_once() {
    let desk = Desk::new();
    let plan = plan(&desk, "water-on-cloth --quality draft --frames 1-2");
    let [liquid, sheets] = ["liquid", "sheets"].map(|name| system(&plan, name));
    assert!(count(liquid, "particles") > 0.0 && count(sheets, "points") > 0.0, "{plan}");
    assert!(liquid["seconds"].as_f64().unwrap() > 0.0 && sheets["seconds"] == 0.0, "{plan}");
}

#[test]
fn a_job_shorter_than_a_tick_of_the_clock_has_finite_figures() {
    let desk = Desk::new();
    for frames in ["1", "1-2"] {
        let plan = plan(&desk, &format!("small.toml --frames {frames}"));
        let mut figures = vec![&plan["seconds"], &plan["uncertainty"], &plan["cache"]];
        figures.extend([&plan["products"][0]["seconds"], &system(&plan, "liquid")["substeps"]]);
        assert!(figures.iter().all(|figure| figure.as_f64().is_some_and(f64::is_finite)), "{plan}");
    }
}

#[test]
fn the_bound_counts_the_samples_of_meshes() {
    let (text, _) = Desk::new().run("shot figure-bath --quality draft --dry-run", 0);
    let words = text.lines().find_map(|line| line.strip_prefix("memory     at most about ")).unwrap();
    let bound: f64 = words.trim_end_matches(" MiB").parse().unwrap();
    // Its simulation without tension takes 45 MiB, most of it before there is a particle; without the mesh it would be 15.
    assert!((45.0..110.0).contains(&bound), "{text}");
    let (text, _) = Desk::new().run("simulate dam-break --quality draft --dry-run", 0);
    assert!(text.contains("at most about") && !text.contains("mesh"), "{text}");
}

#[test]
fn tables_that_the_preset_lacks_are_listed_as_absent() {
    let desk = Desk::new();
    let bare = SMALL.replace("[liquid.vorticity]", "").replace("mesh = [\"ply\"]", "");
    desk.write("bare.toml", bare);
    let (text, log) = desk.run("plan bare.toml", 0);
    let line = |name: &str| text.lines().find(|line| line.starts_with(name)).unwrap().to_owned();
    assert!(line("does not").contains("liquid.vorticity") && !line("runs").contains("vorticity"), "{text}");
    assert!(line("products").contains("none") && line("liquid").ends_with("512 particles"), "{text}");
    assert!(line("time").contains("threads") && log.contains("Progress: 100%"), "{text}{log}");
    assert!(plan(&desk, "bare.toml")["products"].as_array().unwrap().is_empty());
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
        let (out, log) = desk.run(&format!("{line} --max-memory 1MiB"), 33);
        assert!(out.is_empty() && log.contains("--max-memory"), "{line}: {out}{log}");
        desk.run(&format!("{line} --max-memory 1GiB"), 0);
    }
    assert!(desk.path("small/mesh").exists() && desk.path("there/mesh").exists());
}

#[test]
fn shots_that_cannot_run_are_refused() {
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
    let plan = plan(&desk, "sheet.toml --frames 1-2");
    assert_eq!(count(system(&plan, "liquid"), "particles"), 3600.0);
}

/// The model of src/run/plan/memory.rs against real peaks, at the size of a preview.
#[cfg(target_os = "linux")]
#[test]
fn the_memory_model_is_near_the_real_peak() {
    let desk = Desk::new();
    let preset = "dam-break --quality preview --frames 1-2";
    let estimate = plan(&desk, preset)["memory"].as_f64().unwrap();
    let measured = peak(&desk, &format!("shot {preset} -o shot"));
    assert!((0.75..1.5).contains(&(estimate / measured)), "estimated {estimate}, measured {measured} bytes");
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

#[test]
fn sources_without_particles_are_named_by_plan_and_by_simulate() {
    let desk = Desk::new();
    let drop = |x: f64, radius: f64| {
        format!(
            "[[liquid.source]]\nshape = {{ sphere = {{ center = [{x}, 0.5, 0.9], radius = {radius} }} }}\n"
        )
    };
    desk.write("shot.toml", format!("{SMALL}{}{}", drop(0.3, 0.07), drop(0.6, 0.03)));
    let plan = plan(&desk, "shot.toml");
    let remarks = plan["remarks"].to_string();
    // The drop of 1.4 particles is one, the drop of a tenth of a particle none.
    assert!(
        remarks.contains("liquid.source.2 holds no particle") && !remarks.contains("source.1"),
        "{remarks}"
    );
    assert_eq!(count(system(&plan, "liquid"), "particles"), 513.0);
    for line in
        ["simulate shot.toml --dry-run", "shot shot.toml --dry-run", "simulate shot.toml --frames 1-2"]
    {
        let (out, messages) = desk.run(line, 0);
        let named = "liquid.source.2 holds no particle: its volume is that of 0.11 particles";
        assert!(out.contains(named) || messages.contains(named), "{line}: {out}{messages}");
    }
}
