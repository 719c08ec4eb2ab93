//! Jobs of render farms: what is written, and frames made behind a running simulation. The engines themselves run in `tools/farm`.

use super::*;
use serde_json::Value;
use std::{
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

/// The tool, started in the folder of a desk.
fn start(desk: &Desk, line: &str) -> Child {
    Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args(line.split_whitespace())
        .current_dir(desk.path("."))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

fn wait_for(what: &str, condition: impl Fn() -> bool) {
    let started = Instant::now();
    while !condition() {
        assert!(started.elapsed() < Duration::from_secs(120), "{what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

fn json(desk: &Desk, file: &str) -> Value {
    serde_json::from_slice(&fs::read(desk.path(file)).unwrap()).unwrap()
}

#[test]
fn a_template_of_open_job_description_has_chunks_and_no_paths() {
    let desk = Desk::new();
    desk.write(
        "small.toml",
        SMALL.replace("mesh = [\"ply\"]", "mesh = [\"ply\", \"obj\"]\nvolume = [\"density\"]"),
    );
    desk.run("farm openjd shot --preset small.toml --chunk 2 --max-memory 1GiB --threads 3", 0);
    let template = json(&desk, "shot/farm.openjd.json");
    let steps = template["steps"].as_array().unwrap();
    let names: Vec<&str> = steps.iter().map(|step| step["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["simulate", "mesh", "volume", "verify"]);
    let mesh = &steps[1];
    let words: Vec<&str> = mesh["script"]["actions"]["onRun"]["args"]
        .as_array()
        .unwrap()
        .iter()
        .map(|w| w.as_str().unwrap())
        .collect();
    let expected = "mesh {{Param.Folder}} --format ply,obj --frames {{Task.Param.Frames}} --max-memory 1073741824B \
                    --threads 3 --progress openjd";
    assert_eq!(words.join(" "), expected);
    assert_eq!(
        mesh["parameterSpace"]["taskParameterDefinitions"],
        serde_json::json!([{ "name": "Frames", "type": "STRING", "range": ["1-2", "3-4", "5"] }])
    );
    assert_eq!(mesh["dependencies"], serde_json::json!([{ "dependsOn": "simulate" }]));
    assert_eq!(mesh["hostRequirements"]["amounts"][1]["min"], 1280);
    let text = fs::read_to_string(desk.path("shot/farm.openjd.json")).unwrap();
    assert!(!text.contains(desk.path(".").parent().unwrap().to_str().unwrap()), "{text}");

    // The folder is ready: its commands, run here, give what a local run gives.
    for line in [
        "simulate shot/preset.toml -o shot --frames 1-5",
        "mesh shot --format ply,obj --frames 3-4",
        "mesh shot --format ply,obj --frames 1-2",
        "mesh shot --format ply,obj --frames 5",
        "volume shot --grid density --frames 1-5",
        "verify shot",
    ] {
        desk.run(line, 0);
    }
    desk.run("shot small.toml -o local", 0);
    for folder in ["cache", "mesh", "volume"] {
        assert_eq!(desk.bytes(&format!("shot/{folder}")), desk.bytes(&format!("local/{folder}")));
    }
    for file in ["shot.json", "preset.toml"] {
        assert_eq!(
            fs::read(desk.path("shot").join(file)).unwrap(),
            fs::read(desk.path("local").join(file)).unwrap()
        );
    }
}

// Slurm runs on Linux, and its script in a shell.
#[cfg(unix)]
#[test]
fn a_script_for_slurm_quotes_every_text_and_runs_a_killed_command_again() {
    let desk = Desk::new();
    let odd = "it's $HOME `x` %A \"q\"";
    // In place of the program: it counts its runs, and a signal ends the first.
    desk.write(
        "fake tool's",
        "#!/bin/sh\necho \"$@\" >>\"$DESK/calls\"\n[ $(wc -l <\"$DESK/calls\") -gt 1 ] || kill -9 $$\n",
    );
    let tool = desk.path("fake tool's");
    Command::new("chmod").arg("+x").arg(&tool).status().unwrap();
    let mut farm = desk.tool("farm slurm");
    farm.arg(odd).args(["--preset", "small.toml", "--chunk", "2", "--command"]).arg(&tool);
    let written = farm.output().unwrap();
    assert!(written.status.success(), "{written:?}");
    let task = |step: &str, number: &str| {
        fs::create_dir_all(desk.path(odd).join("farm-log")).unwrap();
        let status = Command::new("sh")
            .args(["./farm.slurm.sh", "task", step, "."])
            .current_dir(desk.path(odd))
            .env("DESK", desk.path("."))
            .envs([("SLURM_JOB_ID", "7"), ("SLURM_ARRAY_TASK_ID", number)])
            .status()
            .unwrap();
        status.code()
    };
    assert_eq!(task("mesh", "2"), Some(0));
    assert_eq!(task("verify", "0"), Some(0));
    let calls = fs::read_to_string(desk.path("calls")).unwrap();
    let mesh = "mesh . --format ply --frames 3-4 --progress plain";
    assert_eq!(calls.lines().collect::<Vec<_>>(), [mesh, mesh, "verify . --progress plain"]);
    let log = fs::read_to_string(desk.path(odd).join("farm-log/mesh-7-2.log")).unwrap();
    assert!(log.contains("ended by signal 9; attempt 2 of 3"), "{log}");
    // One that always dies ends after three attempts.
    desk.write("fake tool's", "#!/bin/sh\necho x >>\"$DESK/calls\"\nkill -9 $$\n");
    assert_eq!(task("mesh", "1"), Some(137));
    assert_eq!(fs::read_to_string(desk.path("calls")).unwrap().lines().count(), 6);
}

#[test]
fn what_an_engine_cannot_express_is_refused() {
    let desk = Desk::new();
    let (_, talk) = desk.run("farm openjd nothing", 2);
    assert!(talk.contains("no preset.toml") && talk.contains("--preset"), "{talk}");
    let (_, talk) = desk.run("farm flamenco {shot} --preset small.toml", 2);
    assert!(talk.contains("takes for a variable"), "{talk}");
    let (_, talk) = desk.run("farm slurm shot --preset small.toml --frames 1-5000 --chunk 4", 2);
    assert!(talk.contains("found 1250 chunks") && talk.contains("--chunk 5 or more"), "{talk}");
    let (_, talk) = desk.run("farm slurm shot --set fps=25", 2);
    assert!(talk.contains("--preset"), "{talk}");
    // Files of the user, and frames of other settings, stay.
    desk.write("shot/farm.openjd.json", "{}");
    let (_, talk) = desk.run("farm openjd shot", 2);
    assert!(talk.contains("rename the file"), "{talk}");
    desk.run("simulate small.toml -o shot --frames 1-2", 0);
    let (_, talk) = desk.run("farm slurm shot --preset small.toml --set liquid.cfl=0.3", 14);
    assert!(talk.contains("liquid.cfl"), "{talk}");
    desk.run("farm slurm shot --preset small.toml", 0);
}

#[test]
fn meshes_follow_a_running_simulation() {
    let desk = Desk::new();
    // Both at once: neither folder nor frames are there when the meshing begins.
    let mut meshing = start(&desk, "mesh shot --follow --frames 1-5");
    desk.run("simulate small.toml -o shot", 0);
    assert!(meshing.wait().unwrap().success());
    desk.run("verify shot", 0);
    assert_eq!(desk.names("shot/mesh").len(), 5);
    // Without --frames those that were requested of the simulation.
    let (out, _) = desk.run("mesh shot --follow", 0);
    assert!(out.contains("5 up to date"), "{out}");
    desk.run("shot small.toml -o local", 0);
    assert_eq!(desk.bytes("shot/mesh"), desk.bytes("local/mesh"));
    let (_, talk) = desk.run("mesh x.xyz --follow --spacing 1 -o y", 2);
    assert!(talk.contains("--follow is for"), "{talk}");
}

#[test]
fn a_simulation_that_dies_ends_what_follows_it() {
    let desk = Desk::new();
    let mut simulating = start(&desk, "simulate small.toml -o shot --frames 1-4000");
    wait_for("no third frame", || desk.path("shot/cache/frame_0003.mcf").exists());
    let meshing = start(&desk, "mesh shot --follow --wait 1");
    wait_for("no mesh", || desk.path("shot/mesh/liquid_0002.ply").exists());
    simulating.kill().unwrap();
    simulating.wait().unwrap();
    let ended = meshing.wait_with_output().unwrap();
    let talk = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(ended.status.code(), Some(3), "{talk}");
    assert!(
        talk.contains("no process has simulated there for 1 s") && talk.contains("what was made is kept"),
        "{talk}"
    );
    // Every cached frame was made, and the manifest names them.
    assert_eq!(desk.names("shot/mesh").len(), desk.names("shot/cache").len());
    assert!(fs::read_to_string(desk.path("shot/shot.json")).unwrap().contains("mesh/liquid_{:04}.ply"));
    // Nothing to follow at all.
    let (_, talk) = desk.run("mesh nowhere --follow --wait 0", 3);
    assert!(talk.contains("shot.json is not there"), "{talk}");
}

// Windows has no signals that a test could send.
#[cfg(unix)]
#[test]
fn a_signal_ends_what_waits_for_a_frame() {
    let desk = Desk::new();
    let mut meshing = start(&desk, "mesh nowhere --follow --wait 600");
    std::thread::sleep(Duration::from_millis(300));
    let signalled = Instant::now();
    assert!(Command::new("kill").args(["-TERM", &meshing.id().to_string()]).status().unwrap().success());
    assert_eq!(meshing.wait().unwrap().code(), Some(130));
    assert!(signalled.elapsed() < Duration::from_secs(3));
}
