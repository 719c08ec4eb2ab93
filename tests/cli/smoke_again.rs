//! Smoke played again: faster, with everything that moves it, with other tracers.

use super::{
    smoke::{PLUME, grid},
    *,
};

type Fog = std::collections::BTreeMap<[i32; 3], f32>;

fn fog(desk: &Desk, folder: &str, frame: u32) -> Fog {
    grid(&desk.path(&format!("{folder}/volume/smoke_{frame:04}.vdb")), "density")
}

fn sum(fog: &Fog) -> f64 {
    fog.values().map(|&v| f64::from(v)).sum()
}

/// The plume with a ball that moves through it, simulated with all that shapes it: emitter, wind, heat, shedding, remeshing.
fn plume() -> Desk {
    let desk = Desk::new();
    let keys = "keyframes = [{ frame = 1, position = [-0.3, 0, 0] }, { frame = 7, position = [0.3, 0, 0] }]";
    let text = PLUME
        .replace("radius = 0.2 } }\n", &format!("radius = 0.2 }} }}\n{keys}\n"))
        .replace("[smoke.flow.remesh]", "[smoke.flow.remesh]\nstrain = 0.05");
    desk.write("plume.toml", text);
    desk.run("shot plume.toml --set volume.precision=float", 0);
    let log = fs::read_to_string(desk.path("plume/log.jsonl")).unwrap();
    let remeshed: u64 = log
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .map(|line| line["smoke"]["remeshed"].as_u64().unwrap())
        .sum();
    assert!(remeshed > 0, "vortons are exchanged between frames");
    desk
}

#[test]
fn faster_retiming_skips_frames() {
    let desk = plume();
    let (out, _) = desk.run("volume plume -o fast --retime 0.5 --set volume.precision=float", 0);
    assert!(out.contains("4 volumes written"), "{out}");
    for frame in 1..=4 {
        assert!(fog(&desk, "fast", frame) == fog(&desk, "plume", 2 * frame - 1), "frame {frame}");
    }
    // A pace that meets frames only now and then.
    let (out, _) = desk.run("volume plume -o odd --retime 0.8 --set volume.precision=float", 0);
    assert!(out.contains("5 volumes written"), "{out}");
    assert!(fog(&desk, "odd", 5) == fog(&desk, "plume", 6));
    let [a, b, c] =
        [fog(&desk, "plume", 3), fog(&desk, "odd", 3), fog(&desk, "plume", 4)].map(|fog| sum(&fog));
    assert!(a < b && b < c, "it is at frame 3.5: {a} {b} {c}");
}

#[test]
fn between_frames_smoke_comes_fades_and_keeps_out_of_solids() {
    let desk = plume();
    desk.run("volume plume -o slow --retime 2 --set volume.precision=float", 0);
    for frame in 1..=7 {
        assert!(fog(&desk, "slow", 2 * frame - 1) == fog(&desk, "plume", frame), "frame {frame}");
    }
    for frame in [2, 4, 6, 8, 10, 12] {
        let [a, b, c] = [frame - 1, frame, frame + 1].map(|frame| fog(&desk, "slow", frame));
        let part = (sum(&b) - sum(&a)) / (sum(&c) - sum(&a));
        assert!((0.35..0.65).contains(&part), "half of what comes from frame to frame has come: {part}");
        // The middle of the ball, which moves on by 5 cm from one of these to the next.
        let x = -0.3 + 0.1 * f64::from(frame - 1) / 2.0;
        let voxel = 0.5 * 0.04;
        let inside = b.keys().filter(|at| {
            let d = [f64::from(at[0]) * voxel - x, f64::from(at[1]) * voxel, f64::from(at[2]) * voxel - 0.6];
            d.iter().map(|d| d * d).sum::<f64>().sqrt() < 0.2 - 3.0 * 0.04
        });
        assert_eq!(inside.count(), 0, "smoke deep in the ball in frame {frame}");
    }
}

#[test]
fn other_tracers_come_fade_and_keep_out_of_solids_as_the_first_did() {
    let desk = plume();
    desk.run("volume plume -o fresh --set smoke.tracers=0.4 --set volume.precision=float", 0);
    for frame in [3, 5, 7] {
        let (old, new) = (fog(&desk, "plume", frame), fog(&desk, "fresh", frame));
        // Grids of another voxel: smoke is measured by volume.
        let ratio = sum(&new) * 0.8_f64.powi(3) / sum(&old);
        assert!((ratio - 1.0).abs() < 0.1, "frame {frame}: {ratio}");
        let mean = |fog: &Fog, voxel: f64| {
            let at = |axis: usize| fog.iter().map(|(at, &v)| f64::from(at[axis]) * f64::from(v)).sum::<f64>();
            [0, 1, 2].map(|axis| at(axis) / sum(fog) * voxel)
        };
        let (old, new) = (mean(&old, 0.02), mean(&new, 0.016));
        let off: f64 = (0..3).map(|axis| (old[axis] - new[axis]).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.02, "frame {frame}: {old:?} {new:?}");
    }
}

// Windows has no signals that a test could send.
#[cfg(unix)]
#[test]
fn tracers_that_drift_from_the_start_can_be_stopped_and_the_job_goes_on() {
    use std::{
        process::{Command, Stdio},
        time::{Duration, Instant},
    };
    let desk = Desk::new();
    desk.write("ring.toml", super::smoke::RING);
    desk.run("simulate ring.toml --frames 1-24", 0);
    // So many tracers that to drift to frame 24 takes some hundred times as long as to stop.
    let line = "volume ring -o fresh --set smoke.tracers=0.2 --frames 2,24";
    let mut child = Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
        .args(line.split(' '))
        .args(["--progress", "json"])
        .current_dir(desk.path("."))
        .stdout(Stdio::null())
        .stderr(fs::File::create(desk.path("talk")).unwrap())
        .spawn()
        .unwrap();
    // Then 22 cached frames are passed until the next requested one.
    let started = Instant::now();
    while !desk.path("fresh/volume/smoke_0002.vdb").exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended before the first volume");
        assert!(started.elapsed() < Duration::from_secs(120), "no volume after two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().unwrap().success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert_eq!(desk.names("fresh/volume"), ["smoke_0002.vdb"]);
    // It was on its way when it stopped, not at its end.
    let talk = fs::read_to_string(desk.path("talk")).unwrap();
    let part = |line: &str| {
        let event: serde_json::Value = serde_json::from_str(line).ok()?;
        event["data"]["percent"].as_f64().map(|percent| percent as u32)
    };
    let last = talk.lines().filter_map(part).max().unwrap();
    assert!((50..95).contains(&last), "{talk}");
    let manifest = fs::read_to_string(desk.path("fresh/shot.json")).unwrap();
    assert!(manifest.contains("volume/smoke_{:04}.vdb"), "what was finished is named: {manifest}");
    // It goes on, here to an earlier frame: all the way takes long.
    let (out, talk) = desk.run(&format!("{} --progress json", line.replace("2,24", "2,5")), 0);
    let parts: std::collections::BTreeSet<u32> = talk.lines().filter_map(part).collect();
    assert!(parts.range(51..99).count() >= 5, "drifting shows: {talk}");
    assert!(out.contains("1 volumes written") && out.contains("1 up to date"), "{out}");
    assert_eq!(desk.names("fresh/volume"), ["smoke_0002.vdb", "smoke_0005.vdb"]);
}
