//! Folders that strangers, other programs and faults have changed: nothing outside is written, nothing wrong is taken for valid.

use super::*;
use meniscus::{
    cache,
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
};

/// A cache with one frame, whose stream of particles has this name.
fn crafted(desk: &Desk, stream: &str) {
    let folder = desk.path("shot/cache");
    fs::create_dir_all(&folder).unwrap();
    let places: Vec<Vec3> =
        (0..64).map(|i| 0.1 * Vec3::new((i % 4) as f32, (i / 4 % 4) as f32, (i / 16) as f32)).collect();
    let mut stream = Stream::new(stream.to_owned(), StreamKind::Particles, 64).with("position", places);
    stream.scalars.push(("spacing".into(), 0.1));
    let frame = Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] };
    cache::write_frame(&folder, &frame, 7).unwrap();
}

#[test]
fn streams_named_like_paths_write_nothing() {
    let desk = Desk::new();
    for verb in ["mesh", "volume"] {
        for name in ["../../evil", "/tmp/evil", "a/b", "..", "x\ny"] {
            crafted(&desk, name);
            let (_, why) = desk.run(&format!("{verb} shot"), 3);
            assert!(why.contains("expected a name of which files can be called"), "{why}");
        }
    }
    assert!(!desk.path("evil_0001.ply").exists() && !desk.path("../evil_0001.ply").exists());
    crafted(&desk, "good");
    desk.run("mesh shot", 0);
}

// Windows lets administrators alone make symbolic links.
#[cfg(unix)]
#[test]
fn links_in_a_folder_lead_no_job_out_of_it() {
    use std::os::unix::fs::symlink;
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    desk.write("precious", "kept");
    fs::create_dir(desk.path("elsewhere")).unwrap();
    let plant = |place: &str, target: &str| {
        let path = desk.path(place);
        let _ = fs::remove_file(&path);
        symlink(desk.path(target), &path).unwrap();
        path
    };
    for (place, target, line) in [
        ("small/.lock", "precious", "mesh small"),
        ("small/cache/.lock", "precious", "simulate small.toml --frames 1-3"),
        ("small/mesh.jsonl", "precious", "mesh small"),
        ("small/mesh.jsonl", "absent", "mesh small"),
        ("small/mesh", "elsewhere", "mesh small"),
        ("small/volume", "elsewhere", "volume small"),
    ] {
        let _ = fs::remove_dir_all(desk.path("small/mesh"));
        let link = plant(place, target);
        let (_, why) = desk.run(line, 1);
        assert!(why.contains("found a symbolic link"), "{place}: {why}");
        fs::remove_file(link).unwrap();
    }
    // A log is replaced, not what a link in its place leads to.
    plant("small/log.jsonl", "precious");
    desk.write("elsewhere/.frame.9-0.meniscus-tmp", "under way");
    plant("small/sdf", "elsewhere");
    desk.run("simulate small.toml --frames 1-3", 0);
    assert_eq!(fs::read(desk.path("precious")).unwrap(), b"kept");
    assert!(!desk.path("absent").exists());
    assert_eq!(fs::read(desk.path("elsewhere/.frame.9-0.meniscus-tmp")).unwrap(), b"under way");
    assert_eq!(desk.names("elsewhere"), [""; 0]);
}

#[test]
fn damaged_exchanged_and_foreign_products_are_found_and_made_again() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    desk.run("volume small", 0);
    desk.run("verify small", 0);
    let good = (desk.bytes("small/mesh"), desk.bytes("small/volume"));
    let place = |name: &str| desk.path("small").join(name);
    let length = fs::metadata(place("mesh/liquid_0003.ply")).unwrap().len();
    let cut = fs::OpenOptions::new().write(true).open(place("mesh/liquid_0003.ply")).unwrap();
    cut.set_len(length - 100).unwrap();
    // Windows replaces no file that is open.
    drop(cut);
    let mut flipped = fs::read(place("volume/liquid_0002.vdb")).unwrap();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 1;
    fs::write(place("volume/liquid_0002.vdb"), flipped).unwrap();
    fs::copy(place("mesh/liquid_0001.ply"), place("mesh/liquid_0002.ply")).unwrap();
    fs::write(place("mesh/liquid_0005.ply"), "ply of another program").unwrap();
    fs::remove_file(place("volume/liquid_0004.vdb")).unwrap();
    let (out, why) = desk.run("verify small --json", 12);
    let found: serde_json::Value = serde_json::from_str(&out).unwrap();
    let faults: Vec<(String, String)> = found["stages"]
        .as_array()
        .unwrap()
        .iter()
        .flat_map(|stage| stage["faults"].as_array().unwrap())
        .map(|fault| {
            (fault["file"].as_str().unwrap().to_owned(), fault["state"].as_str().unwrap().to_owned())
        })
        .collect();
    let expected = [
        ("mesh/liquid_0002.ply", "foreign"),
        ("mesh/liquid_0003.ply", "corrupt"),
        ("mesh/liquid_0005.ply", "corrupt"),
        ("volume/liquid_0002.vdb", "corrupt"),
        ("volume/liquid_0004.vdb", "missing"),
    ];
    assert_eq!(faults, expected.map(|(file, state)| (file.to_owned(), state.to_owned())));
    assert!(why.contains("meniscus mesh small") && why.contains("meniscus volume small"), "{why}");
    let (out, _) = desk.run("mesh small", 0);
    assert!(out.contains("3 frames meshed") && out.contains("2 up to date"), "{out}");
    let (out, _) = desk.run("volume small", 0);
    assert!(out.contains("2 volumes written") && out.contains("3 up to date"), "{out}");
    assert!(good == (desk.bytes("small/mesh"), desk.bytes("small/volume")));
    desk.run("verify small", 0);
}

#[test]
fn frames_of_another_shot_or_number_are_recognised() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    desk.run("simulate small.toml --set liquid.iterations=7 -o other", 0);
    fs::copy(desk.path("other/cache/frame_0003.mcf"), desk.path("small/cache/frame_0003.mcf")).unwrap();
    let (out, why) = desk.run("verify small", 14);
    assert!(out.contains("4 valid, 1 foreign"), "{out}");
    assert!(why.contains("cache/frame_0003.mcf: foreign"), "{why}");
    let (out, why) = desk.run("info small", 14);
    assert!(out.contains("4 present") && why.contains("frame 0003"), "{out}{why}");
    let (_, why) = desk.run("mesh small --force", 14);
    assert!(why.contains("frame 0003") && why.contains("another simulation"), "{why}");
    fs::copy(desk.path("small/cache/frame_0002.mcf"), desk.path("small/cache/frame_0003.mcf")).unwrap();
    let (_, why) = desk.run("verify small", 14);
    assert!(why.contains("frame 2 under the name of frame 3"), "{why}");
    fs::remove_file(desk.path("small/cache/frame_0003.mcf")).unwrap();
    desk.run("shot small.toml", 0);
    desk.run("verify small", 0);
    // Meshes of a simulation that was replaced are stale.
    desk.run("simulate small.toml --set liquid.iterations=7 --force", 0);
    desk.write("small/shot.json", {
        let text = fs::read_to_string(desk.path("small/shot.json")).unwrap();
        let mesh = r#""outputs": [{"kind": "mesh", "name": "liquid", "format": "ply", "pattern": "mesh/liquid_{:04}.ply",
            "frames": {"first": 1, "last": 5, "step": 1}}]"#;
        text.replace("\"outputs\": []", mesh)
    });
    let (out, _) = desk.run("verify small", 14);
    assert!(out.contains("stale: mesh/liquid_{:04}.ply"), "{out}");
}

#[test]
fn a_cache_that_lost_frames_is_not_valid() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("verify small", 0);
    fs::remove_file(desk.path("small/cache/frame_0002.mcf")).unwrap();
    desk.run("verify small", 10);
    fs::remove_dir_all(desk.path("small/cache")).unwrap();
    let (out, _) = desk.run("verify small", 10);
    assert!(out.contains("0 valid, 5 missing"), "{out}");
}

#[test]
fn a_shot_that_lost_its_manifest_is_not_valid_and_what_else_is_lost_is_found() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-4", 0);
    for file in ["shot.json", "cache/frame_0002.mcf", "mesh/liquid_0003.ply"] {
        fs::remove_file(desk.path("small").join(file)).unwrap();
    }
    fs::write(desk.path("small/mesh/liquid_0004.ply"), "cut").unwrap();
    let (out, talk) = desk.run("verify small", 12);
    let named = [
        "shot.json: missing",
        "cache/frame_0002.mcf: missing",
        "liquid_0003.ply: missing",
        "liquid_0004.ply: corrupt",
    ];
    assert!(named.into_iter().all(|file| talk.contains(file)), "{out}{talk}");
    assert!(talk.contains("meniscus simulate"), "{talk}");
    // A product alone does not hide it: its manifest names no simulation.
    desk.run("mesh small", 0);
    let (_, talk) = desk.run("verify small", 10);
    assert!(talk.contains("shot.json: missing"), "{talk}");
    // What it advises helps.
    let advice = talk.lines().find_map(|line| line.split_once("meniscus simulate ")).unwrap().1;
    assert!(advice.ends_with("--frames 1-4"), "{advice}");
    desk.run(&format!("simulate {}", advice.replace('\'', "")), 0);
    desk.run("mesh small", 0);
    desk.run("verify small", 0);
    // A shot that lost both, and one whose log cannot be read.
    desk.run("simulate small.toml --frames 1-4 -o other", 0);
    fs::remove_file(desk.path("other/shot.json")).unwrap();
    fs::rename(desk.path("other/cache"), desk.path("aside")).unwrap();
    let (_, talk) = desk.run("verify other", 10);
    assert!(talk.contains("shot.json: missing") && talk.contains("cache/frame_0002.mcf: missing"), "{talk}");
    fs::rename(desk.path("aside"), desk.path("other/cache")).unwrap();
    fs::remove_file(desk.path("other/log.jsonl")).unwrap();
    fs::create_dir(desk.path("other/log.jsonl")).unwrap();
    let (out, talk) = desk.run("verify other", 12);
    assert!(out.contains("cache      4 valid") && talk.contains("log.jsonl: corrupt"), "{out}{talk}");
    // A cache alone, as the library writes it, has nothing to miss.
    crafted(&desk, "good");
    desk.run("verify shot", 0);
    // Records that cannot be read are a fault of their own.
    fs::remove_file(desk.path("small/mesh.jsonl")).unwrap();
    fs::create_dir(desk.path("small/mesh.jsonl")).unwrap();
    let (out, talk) = desk.run("verify small", 12);
    assert!(out.contains("cache      4 valid") && talk.contains("mesh.jsonl: corrupt"), "{out}{talk}");
}

#[test]
fn the_command_that_verify_advises_has_all_frames_in_order() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-4", 0);
    fs::remove_file(desk.path("small/cache/frame_0002.mcf")).unwrap();
    fs::write(desk.path("small/cache/frame_0004.mcf"), "damaged").unwrap();
    let (_, talk) = desk.run("verify small", 12);
    let advice = talk.lines().find_map(|line| line.split_once("meniscus simulate ")).unwrap().1;
    assert!(advice.ends_with("--frames 2,4"), "{advice}");
    desk.run(&format!("simulate {}", advice.replace('\'', "")), 0);
    desk.run("verify small", 0);
}

#[test]
fn a_preset_of_the_user_next_to_meshes_is_no_lost_shot() {
    let desk = Desk::new();
    crafted(&desk, "good");
    desk.write("shot/preset.toml", "title = \"by hand\"");
    desk.run("verify shot", 0);
}

#[test]
fn more_frames_than_a_job_takes_are_refused() {
    let desk = Desk::new();
    for verb in ["simulate", "plan", "shot"] {
        let (_, talk) = desk.run(&format!("{verb} small.toml --frames 1-2000000"), 2);
        assert!(talk.contains("expected at most 1000000"), "{talk}");
    }
}

#[test]
fn a_file_of_several_frames_is_valid_whichever_frame_it_begins_with() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-4", 0);
    let first = desk.path("small/cache/frame_0001.mcf");
    let bytes = fs::read(&first).unwrap();
    fs::write(&first, "damaged").unwrap();
    desk.run("preview small", 12);
    fs::write(&first, bytes).unwrap();
    desk.run("preview small", 0);
    desk.run("verify small", 0);
}

#[test]
fn frames_that_were_not_requested_are_not_missing() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1,2,4", 0);
    desk.run("verify small", 0);
    desk.run("mesh small", 0);
    let (_, why) = desk.run("mesh small --frames 1-6", 3);
    assert!(why.contains("frame 0003"), "{why}");
    let (out, _) = desk.run("verify small", 0);
    assert!(out.contains("3 valid: cache") && out.contains("3 valid: mesh"), "{out}");
    fs::remove_file(desk.path("small/cache/frame_0002.mcf")).unwrap();
    fs::remove_file(desk.path("small/mesh/liquid_0004.ply")).unwrap();
    let (_, why) = desk.run("verify small", 10);
    let simulate = why.find(&shown("meniscus simulate small/preset.toml -o small --frames 2")).unwrap();
    assert!(simulate < why.find("meniscus mesh small").unwrap(), "the cache comes first: {why}");
    desk.run("simulate small/preset.toml -o small --frames 2", 0);
    desk.run("mesh small", 0);
    desk.run("verify small", 0);
}

#[test]
fn files_of_the_user_are_not_replaced_by_copies_of_meshes() {
    let desk = Desk::new();
    let collider = "[[world.collider]]\nshape = { mesh = { file = \"rock.ply\" } }\n[liquid]";
    desk.write("rock.ply", TETRAHEDRON);
    desk.write("own.toml", SMALL.replacen("[liquid]", collider, 1));
    fs::create_dir(desk.path("out")).unwrap();
    desk.write("out/rock.ply", "another model");
    let (_, why) = desk.run("simulate own.toml -o out", 2);
    assert!(why.contains(&shown("out/rock.ply: found another file")), "{why}");
    assert_eq!(fs::read(desk.path("out/rock.ply")).unwrap(), b"another model");
}

#[test]
fn logs_with_bytes_that_are_no_text_are_read() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-3", 0);
    for log in ["log.jsonl", "mesh.jsonl"] {
        let path = desk.path("small").join(log);
        let mut bytes = fs::read(&path).unwrap();
        bytes.extend(b"\xff\xfe\n{\"frame\": 2, \"cut");
        fs::write(&path, bytes).unwrap();
    }
    for line in
        ["info small", "verify small", "mesh small", "simulate small.toml --frames 1-4", "shot small.toml"]
    {
        desk.run(line, 0);
    }
    let text = fs::read_to_string(desk.path("small/log.jsonl")).unwrap();
    assert_eq!(text.lines().count(), 4, "one line for each frame that was computed");
}

#[test]
fn a_damaged_manifest_is_kept_and_reported_and_one_of_a_later_version_is_refused() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-3", 0);
    let good = fs::read_to_string(desk.path("small/shot.json")).unwrap();
    desk.write("small/shot.json", &good[..good.len() / 2]);
    let (_, talk) = desk.run("shot small.toml --frames 1-3", 0);
    assert!(talk.contains("shot.json.damaged"), "{talk}");
    assert_eq!(fs::read_to_string(desk.path("small/shot.json")).unwrap(), good);
    assert_eq!(fs::read_to_string(desk.path("small/shot.json.damaged")).unwrap(), good[..good.len() / 2]);
    desk.write("small/shot.json", good.replace("\"version\": 1", "\"version\": 2"));
    for line in ["shot small.toml --frames 1-3", "mesh small", "info small"] {
        let (_, why) = desk.run(line, 13);
        assert!(why.contains("shot.json: format version 2, expected 1"), "{why}");
    }
}

#[test]
fn chunks_of_one_batch_share_a_folder() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-8", 0);
    let start = |frames: &str| {
        let line = ["mesh", "small", "--frames", frames, "--progress", "none", "--threads", "1"];
        std::process::Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
            .args(line)
            .current_dir(desk.path("."))
            .spawn()
            .unwrap()
    };
    // Another chunk is under way, whether or not these overlap.
    let folder = desk.path("small/mesh");
    fs::create_dir(&folder).unwrap();
    let under_way = fs::OpenOptions::new().create(true).append(true).open(folder.join(".lock")).unwrap();
    under_way.try_lock_shared().unwrap();
    for mut child in ["1-3", "4-6", "7-8"].map(start) {
        assert!(child.wait().unwrap().success());
    }
    desk.run("verify small", 0);
    let chunks = (desk.bytes("small/mesh"), fs::read_to_string(desk.path("small/shot.json")).unwrap());
    let frames = fs::read_to_string(desk.path("small/mesh.jsonl")).unwrap().lines().count();
    desk.run("mesh small --force", 0);
    assert_eq!(frames, 8);
    assert!(chunks == (desk.bytes("small/mesh"), fs::read_to_string(desk.path("small/shot.json")).unwrap()));
}

#[test]
fn what_crashed_jobs_left_is_removed_everywhere() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    let left = ["small/.shot.json.7-0.meniscus-tmp", "small/cache/.frame_0002.mcf.7-0.meniscus-tmp"];
    left.iter().for_each(|name| desk.write(name, "part"));
    desk.run("simulate small.toml --frames 1-3", 0);
    assert!(left.iter().all(|name| !desk.path(name).exists()));
    let left = ["small/.shot.json.7-0.meniscus-tmp", "small/mesh/.liquid_0001.ply.7-0.meniscus-tmp"];
    fs::create_dir(desk.path("small/mesh")).unwrap();
    left.iter().for_each(|name| desk.write(name, "part"));
    desk.run("mesh small", 0);
    assert!(left.iter().all(|name| !desk.path(name).exists()));
}

#[test]
fn meshes_are_not_copied_among_the_files_of_a_shot() {
    let desk = Desk::new();
    fs::create_dir(desk.path("mesh")).unwrap();
    desk.write("mesh/liquid_0001.ply", TETRAHEDRON);
    let collider = r#"[[world.collider]]
shape = { mesh = { file = "mesh/liquid_0001.ply" } }
[liquid]"#;
    desk.write("own.toml", SMALL.replacen("[liquid]", collider, 1));
    let (_, why) = desk.run("simulate own.toml", 2);
    assert!(why.contains("mesh/liquid_0001.ply") && why.contains("another name"), "{why}");
    assert_eq!(fs::read(desk.path("mesh/liquid_0001.ply")).unwrap(), TETRAHEDRON.as_bytes());
}

/// A mesh that encloses a volume.
const TETRAHEDRON: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 4\nproperty list uchar int vertex_indices\nend_header\n2 0 0\n3 0 0\n2 1 0\n2 0 1\n\
    3 0 2 1\n3 0 1 3\n3 1 2 3\n3 0 3 2\n";

// Windows lets administrators alone make symbolic links.
#[cfg(unix)]
#[test]
fn meshes_behind_links_out_of_the_folder_of_the_preset_are_refused() {
    use std::os::unix::fs::symlink;
    let desk = Desk::new();
    fs::create_dir(desk.path("received")).unwrap();
    desk.write("secret.ply", TETRAHEDRON);
    symlink(desk.path("secret.ply"), desk.path("received/rock.ply")).unwrap();
    let collider = "[[world.collider]]\nshape = { mesh = { file = \"rock.ply\" } }\n[liquid]";
    desk.write("received/own.toml", SMALL.replacen("[liquid]", collider, 1));
    let (_, why) = desk.run("simulate received/own.toml -o shot", 2);
    assert!(why.contains("leads out of the preset's folder") && why.contains("symbolic link"), "{why}");
    fs::remove_file(desk.path("received/rock.ply")).unwrap();
    fs::rename(desk.path("secret.ply"), desk.path("received/stone.ply")).unwrap();
    symlink("stone.ply", desk.path("received/rock.ply")).unwrap();
    desk.run("simulate received/own.toml -o shot --frames 1-1", 0);
}

#[test]
fn products_are_not_made_into_another_shot() {
    let desk = Desk::new();
    desk.run("shot small.toml --frames 1-2", 0);
    desk.run("simulate small.toml --frames 1-2 -o other --set liquid.iterations=7", 0);
    let before = (desk.bytes("small/mesh"), fs::read(desk.path("small/shot.json")).unwrap());
    let (_, why) = desk.run("mesh other -o small", 2);
    assert!(why.contains("small: found another shot"), "{why}");
    assert!(before == (desk.bytes("small/mesh"), fs::read(desk.path("small/shot.json")).unwrap()));
    desk.run("mesh other -o meshes", 0);
    desk.run("mesh other -o meshes --force", 0);
}

/// Runs a command of the shell in the desk's folder, with the tool as `$MENISCUS`; returns its exit code and stderr.
#[cfg(unix)]
fn shell(desk: &Desk, line: &str) -> (Option<i32>, String) {
    let output = std::process::Command::new("sh")
        .args(["-c", line])
        .env("MENISCUS", assert_cmd::cargo::cargo_bin("meniscus"))
        .current_dir(desk.path("."))
        .output()
        .unwrap();
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

// By a shell of Unix.
#[cfg(unix)]
#[test]
fn a_limit_of_the_size_of_files_is_a_full_disk() {
    let desk = Desk::new();
    let (code, why) = shell(&desk, "ulimit -f 4; $MENISCUS simulate small.toml --frames 1-3");
    assert_eq!(code, Some(28), "{why}");
    assert!(why.contains("frame_000") && why.contains("ulimit -f"), "{why}");
    let parts = fs::read_dir(desk.path("small/cache")).unwrap().flatten();
    assert!(!parts.into_iter().any(|part| part.file_name().to_string_lossy().ends_with("-tmp")));
    desk.run("simulate small.toml --frames 1-3", 0);
    let (code, why) = shell(&desk, "ulimit -f 8; $MENISCUS mesh small");
    assert_eq!(code, Some(28), "{why}");
    desk.run("mesh small", 0);
    desk.run("verify small", 0);
}

#[cfg(unix)]
#[test]
fn a_whitewater_frame_that_does_not_fit_ends_as_a_full_disk() {
    let desk = whitewater::desk();
    desk.run("simulate white.toml", 0);
    let (code, why) = shell(&desk, "ulimit -f 4; $MENISCUS whitewater white");
    assert_eq!(code, Some(28), "{why}");
    assert!(why.contains("whitewater/") && why.contains("ulimit -f"), "{why}");
    desk.run("whitewater white", 0);
    desk.run("verify white", 0);
}

#[cfg(target_os = "linux")]
#[test]
fn a_limit_of_memory_names_the_frames_under_way() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2 --set liquid.spacing=0.04", 0);
    // Half of what the meshes take, and more than threads take addresses for as they start: each 64 MiB.
    let mesh = "$MENISCUS mesh small --set surface.voxel=0.05 --threads 2 --progress none";
    let (code, why) = shell(&desk, &format!("ulimit -v 220000; {mesh} --max-memory 1TiB"));
    assert_eq!(code, Some(33), "{why}");
    assert!(why.contains("refused") && why.contains("while frames 1, 2"), "{why}");
    assert!(why.contains("were under way") && why.contains("ulimit -v"), "{why}");
    desk.run("mesh small", 0);
    let (code, why) =
        shell(&desk, "ulimit -v 200000; $MENISCUS simulate small.toml -o big --set liquid.spacing=0.005");
    assert_eq!(code, Some(33), "{why}");
    // Twice the program with its built-in meshes, and far less than the stacks of 1000 threads.
    let (code, why) = shell(&desk, "ulimit -v 60000; $MENISCUS verify small --threads 1000");
    assert_eq!(code, Some(2), "{why}");
    assert!(why.contains("1000 threads") && why.contains("ulimit -v"), "{why}");
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_is_moved_while_a_job_runs_is_an_error_in_words() {
    let desk = Desk::new();
    let job = "$MENISCUS shot small.toml --frames 1-300 --progress none";
    let started = "while ! [ -e small/cache/frame_0003.mcf ]; do sleep 0.01; done";
    let (code, why) = shell(&desk, &format!("{job} & pid=$!; {started}; mv small gone; wait $pid"));
    assert_eq!(code, Some(10), "{why}");
    assert!(why.contains("small/") && why.contains("nothing there"), "{why}");
    assert!(!desk.path("small").exists());
    desk.run("verify gone", 10);
}

#[cfg(target_os = "linux")]
#[test]
fn signals_that_were_ignored_stay_ignored() {
    let desk = Desk::new();
    let job = "$MENISCUS simulate small.toml --frames 1-60 --progress none";
    let started = "while ! [ -e small/cache/frame_0003.mcf ]; do sleep 0.01; done";
    for signal in ["HUP", "INT"] {
        let line = format!("trap '' {signal}; {job} & pid=$!; {started}; kill -{signal} $pid; wait $pid");
        let (code, why) = shell(&desk, &line);
        assert_eq!(code, Some(0), "{signal}: {why}");
        fs::remove_dir_all(desk.path("small")).unwrap();
    }
    let (code, _) = shell(&desk, &format!("{job} & pid=$!; {started}; kill -TERM $pid; wait $pid"));
    assert_eq!(code, Some(130));
}

#[cfg(target_os = "linux")]
#[test]
fn a_job_whose_output_cannot_be_printed_is_done_all_the_same() {
    let desk = Desk::new();
    let (code, why) = shell(&desk, "$MENISCUS shot small.toml --frames 1-2 > /dev/full");
    assert_eq!(code, Some(28), "{why}");
    assert!(why.contains("standard output"), "{why}");
    assert_eq!(desk.names("small/mesh").len(), 2);
    let (code, _) = shell(&desk, "$MENISCUS shot small.toml --frames 1-3 >&- 2>&-");
    assert_eq!((code, desk.names("small/mesh").len()), (Some(0), 3));
}

#[test]
fn more_threads_than_any_machine_has_are_refused() {
    let desk = Desk::new();
    let (_, why) = desk.run("simulate small.toml --threads 100000", 2);
    assert!(why.contains("100000"), "{why}");
}

// Windows has no pipes among files.
#[cfg(unix)]
#[test]
fn pipes_and_folders_named_like_frames_keep_nothing_else_from_being_listed() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    fs::remove_file(desk.path("small/cache/frame_0002.mcf")).unwrap();
    assert_eq!(shell(&desk, "mkfifo small/cache/frame_0002.mcf").0, Some(0));
    fs::remove_file(desk.path("small/cache/frame_0004.mcf")).unwrap();
    fs::create_dir(desk.path("small/cache/frame_0004.mcf")).unwrap();
    let (out, why) = desk.run("info small", 3);
    assert!(out.contains("3 present"), "{out}");
    assert!(why.contains("frame 0002") && why.contains("pipe") && why.contains("a folder"), "{why}");
    let (out, _) = desk.run("verify small", 12);
    assert!(out.contains("3 valid, 2 corrupt: cache"), "{out}");
    desk.run("mesh small --force --frames 1,3", 0);
    fs::remove_file(desk.path("small/shot.json")).unwrap();
    assert_eq!(shell(&desk, "mkfifo small/shot.json").0, Some(0));
    desk.run("info small", 1);
}
