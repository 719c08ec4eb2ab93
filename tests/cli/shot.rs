//! From preset to meshes in one command, and its messages.

use super::*;
use meniscus::mesh;

#[test]
fn one_command_goes_from_preset_to_meshes() {
    let desk = Desk::new();
    let (out, talk) = desk.run("shot small.toml", 0);
    let frames = |pattern: &str| (1..=5).map(|i| pattern.replace('#', &i.to_string())).collect::<Vec<_>>();
    assert_eq!(desk.names("small/cache"), frames("frame_000#.mcf"));
    assert_eq!(desk.names("small/mesh"), frames("liquid_000#.ply"));
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(desk.path("small/shot.json")).unwrap()).unwrap();
    assert_eq!(manifest["outputs"][0]["pattern"], "mesh/liquid_{:04}.ply");
    assert_eq!(manifest["outputs"][0]["frames"]["last"], 5);
    assert!(out.contains("5 frames simulated") && out.contains("5 frames meshed"), "{out}");
    assert!(
        talk.contains("Progress: 100%") && talk.contains("compression ") && talk.contains("dilation "),
        "{talk}"
    );
    assert!(
        !talk.to_lowercase().contains("error"),
        "the log of a run without errors has no word error:\n{talk}"
    );

    // The log has one line a computed frame (the first is the start).
    let log = fs::read_to_string(desk.path("small/log.jsonl")).unwrap();
    let frames: Vec<u64> = log
        .lines()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["frame"].as_u64().unwrap())
        .collect();
    assert_eq!(frames, [2, 3, 4, 5]);

    // The preset as run makes the same shot again.
    let (out, _) = desk.run("shot small/preset.toml -o small", 0);
    assert!(out.contains("5 up to date"), "{out}");
}

#[test]
fn compression_dilation_and_volume_are_reported_everywhere() {
    let desk = Desk::new();
    let (out, talk) = desk.run("shot small.toml", 0);
    let (info, _) = desk.run("info small", 0);
    for text in [&out, &info] {
        assert!(text.contains("density    compression 0.") && text.contains(" component"), "{text}");
    }
    assert!(info.contains("% against their particles"), "{info}");
    assert!(
        talk.contains("compression 0.0") && talk.contains("dilation 0.") && talk.contains("% of particles)"),
        "{talk}"
    );
    assert!(!talk.contains("volume is off") && !talk.contains("note: volume"), "{talk}");

    let log = fs::read_to_string(desk.path("small/log.jsonl")).unwrap();
    let line: serde_json::Value = serde_json::from_str(log.lines().last().unwrap()).unwrap();
    let json: serde_json::Value = serde_json::from_str(&desk.run("info small --json", 0).0).unwrap();
    for key in ["compression_avg", "dilation_avg", "volume", "volume_change", "isolated", "components"] {
        assert_eq!(json["frames"][4][key].as_f64(), line["liquid"][key].as_f64(), "{key}");
    }
    assert!((json["liquid_volume"]["volume"].as_f64().unwrap() - 0.512).abs() < 0.015);
    let meshes = fs::read_to_string(desk.path("small/mesh.jsonl")).unwrap();
    let mesh: serde_json::Value = serde_json::from_str(meshes.lines().last().unwrap()).unwrap();
    assert_eq!(mesh["particle_volume"], line["liquid"]["volume"]);

    let plan = desk.run("plan small.toml", 0).0;
    assert!(plan.contains("density     calibration: compression 0."), "{plan}");
}

#[test]
fn a_liquid_that_changes_its_volume_is_reported_once_with_the_parameter() {
    let desk = Desk::new();
    let squeezed = "--set liquid.iterations=1 --set liquid.min_substeps=1 --set liquid.cfl=2";
    let (_, talk) = desk.run(&format!("simulate small.toml {squeezed}"), 0);
    let notes: Vec<&str> = talk.lines().filter(|line| line.contains("volume is off by -")).collect();
    assert_eq!(notes.len(), 1, "{talk}");
    assert!(
        notes[0].contains("raise liquid.iterations (1)") && !talk.to_lowercase().contains("error"),
        "{talk}"
    );
    let (_, again) = desk.run(&format!("simulate small.toml {squeezed}"), 0);
    assert!(again.contains(notes[0]), "a run that keeps all frames reports it too:\n{again}");
    let (plan, _) = desk.run(&format!("plan small.toml {squeezed}"), 0);
    assert!(plan.contains("in the calibration, the liquid's volume is off by -"), "{plan}");
}

#[test]
fn a_second_run_keeps_everything() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    let before = (desk.bytes("small/cache"), desk.bytes("small/mesh"));
    let (out, _) = desk.run("shot small.toml", 0);
    assert!(out.contains("0 frames simulated") && out.contains("0 frames meshed"), "{out}");
    assert_eq!(before, (desk.bytes("small/cache"), desk.bytes("small/mesh")));

    // Another voxel meshes again and leaves the cache alone.
    let (out, _) = desk.run("shot small.toml --set surface.voxel=0.8", 0);
    assert!(out.contains("0 frames simulated") && out.contains("5 frames meshed"), "{out}");
    assert_eq!(before.0, desk.bytes("small/cache"));
    assert_ne!(before.1, desk.bytes("small/mesh"));
}

#[test]
fn only_requested_frames_are_stored() {
    let desk = Desk::new();
    desk.run("simulate small.toml -o all", 0);
    desk.run("simulate small.toml -o some --frames 2-5x2", 0);
    assert_eq!(desk.names("some/cache"), ["frame_0002.mcf", "frame_0004.mcf"]);
    let all = desk.bytes("all/cache");
    assert_eq!(desk.bytes("some/cache"), [all[1].clone(), all[3].clone()]);
}

#[test]
fn a_dry_run_prints_and_writes_nothing() {
    let desk = Desk::new();
    let (out, _) = desk.run("shot small.toml --dry-run", 0);
    assert!(out.contains("512") && out.contains("passes"), "{out}");
    assert!(!desk.path("small").exists());
    desk.run("shot small.toml --max-memory 1MiB", 33);
    assert!(!desk.path("small").exists());
    desk.run("shot small.toml --max-memory 4GiB --frames 1", 0);
}

#[test]
fn passes_that_the_preset_does_not_name_do_not_run() {
    let desk = Desk::new();
    let (with, _) = desk.run("shot small.toml --dry-run", 0);
    desk.write("bare.toml", SMALL.replace("[liquid.vorticity]", "").replace("[liquid.xsph]", ""));
    let (without, _) = desk.run("shot bare.toml --dry-run", 0);
    let passes =
        |text: &str| text.lines().find(|line| line.starts_with("passes")).unwrap().split(',').count();
    assert!(passes(&without) < passes(&with), "{with}\n{without}");
}

/// Every pass over a surface.
const CLEAN_UP: &str = "--set surface.components={} --set surface.smoothing={} --set surface.decimation={} \
                        --set surface.attributes=[\"velocity\",\"vorticity\",\"id\"]";

#[test]
fn built_in_presets_are_listed_shown_copied_and_run() {
    let desk = Desk::new();
    let (list, _) = desk.run("presets", 0);
    for name in [
        "crown-splash",
        "dam-break",
        "dam-break-rocks",
        "double-dam-break",
        "drop-in-pool",
        "ducks",
        "figure-bath",
        "figure-drop",
        "figure-splash",
        "filling-glass",
        "floating-crates",
        "fountain",
        "fruit-in-honey",
        "honey",
        "rain-on-pond",
        "sundae",
        "tipping-cup",
        "wading",
        "water-drop",
        "waterfall",
        "wave-machine",
        "zero-gravity-vortex",
    ] {
        assert!(list.contains(name), "{list}");
        let (text, _) = desk.run(&format!("presets show {name}"), 0);
        assert!(text.contains("[liquid]"));
        desk.run(&format!("presets copy {name}"), 0);
        assert_eq!(
            fs::read_to_string(desk.path(&format!("{name}.toml"))).unwrap().trim_end(),
            text.trim_end()
        );
        // Each runs, small: here those that differ in what they use.
        let different = [
            "dam-break",
            "figure-bath",
            "floating-crates",
            "fountain",
            "honey",
            "water-drop",
            "zero-gravity-vortex",
        ];
        if !super::is_soak() && !different.contains(&name) {
            continue;
        }
        // The distance to the figure's mesh takes most of the time of a draft.
        let coarse = if name == "figure-bath" && !super::is_soak() {
            " --set world.collider.1.shape.mesh.resolution=64"
        } else {
            ""
        };
        let line = format!("shot {name} --quality draft --frames 1-2{coarse} -o run-{name}");
        let (out, _) = desk.run(&line, 0);
        assert!(out.contains("2 frames meshed"), "{out}");
        // Its surfaces are sound as they were cut, and after every clean-up.
        let is_cleaned = super::is_soak() || ["dam-break", "figure-bath"].contains(&name);
        if is_cleaned {
            desk.run(&format!("mesh run-{name} -o clean-{name} {CLEAN_UP}"), 0);
        }
        for folder in ["run", "clean"].into_iter().take(1 + usize::from(is_cleaned)) {
            let path = desk.path(&format!("{folder}-{name}/mesh/liquid_0002.ply"));
            let found = mesh::check(&super::meshing::read_ply(&path));
            assert!(found.is_sound() && found.components > 0, "{name} {folder}: {found:?}");
        }
    }
    let (_, talk) = desk.run("presets copy dam-break", 1);
    assert!(talk.contains("does not exist yet"), "{talk}");
    desk.run("presets show dam-brake", 2);
}

#[test]
fn progress_comes_in_the_requested_form() {
    let desk = Desk::new();
    let (_, talk) = desk.run("simulate small.toml -o json --progress json", 0);
    let events: Vec<serde_json::Value> =
        talk.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(events.iter().any(|event| event["data"]["percent"] == 100.0), "{talk}");
    let (out, _) = desk.run("simulate small.toml -o openjd --progress openjd", 0);
    assert!(out.contains("openjd_progress: 100.0"), "{out}");
    let (_, talk) = desk.run("simulate small.toml -o none --progress none", 0);
    assert_eq!(talk, "");
    // What is wrong with the result is not progress.
    desk.write("beyond.toml", SMALL.replace("min = [0, 0, 0], max = [0.8", "min = [-0.4, 0, 0], max = [0.8"));
    let (_, talk) = desk.run("simulate beyond.toml --progress none", 0);
    assert!(talk.starts_with("note: ") && talk.contains("particles of the sources were skipped"), "{talk}");
    assert!(!talk.contains("Progress") && !talk.contains("frame 0002"), "{talk}");
}

#[test]
fn info_lists_the_folder() {
    let desk = Desk::new();
    desk.run("shot small.toml", 0);
    fs::remove_file(desk.path("small/cache/frame_0003.mcf")).unwrap();
    fs::remove_file(desk.path("small/mesh/liquid_0002.ply")).unwrap();
    let (out, _) = desk.run("info small --json", 0);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(info["frames"].as_array().unwrap().len(), 4);
    assert_eq!(info["frames"][0]["particles"], 512);
    assert_eq!(info["missing"], serde_json::json!([3]));
    assert_eq!(info["outputs"][0]["missing"], 1);
    let (out, _) = desk.run("info small/cache", 0);
    assert!(out.contains("1 missing (3)"), "{out}");
    let (out, why) = desk.run("verify small", 10);
    assert!(out.contains("cache      4 valid, 1 missing"), "{out}");
    assert!(why.contains("mesh/liquid_0002.ply: missing") && why.contains("meniscus mesh small"), "{why}");
}

// By a shell of Unix.
#[cfg(unix)]
#[test]
fn a_reader_of_the_log_that_goes_away_does_not_stop_the_job() {
    let desk = Desk::new();
    for style in ["plain", "json", "bar"] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let line = ["simulate", "small.toml", "-o", style, "--progress", style];
        let status = std::process::Command::new(assert_cmd::cargo::cargo_bin("meniscus"))
            .args(line)
            .current_dir(desk.path("."))
            .stdout(std::process::Stdio::null())
            .stderr(writer)
            .status();
        assert_eq!(status.unwrap().code(), Some(0), "{style}");
        assert_eq!(desk.names(&format!("{style}/cache")).len(), 5);
    }
}

/// The small preset with a coarse tier.
fn with_draft(desk: &Desk) {
    desk.write("small.toml", SMALL.to_owned() + "\n[quality.draft]\nliquid.spacing = 0.2\n");
}

#[test]
fn quality_tiers_have_folders_of_their_own() {
    let desk = Desk::new();
    with_draft(&desk);
    desk.run("shot small.toml", 0);
    let (out, _) = desk.run("shot small.toml --quality draft", 0);
    assert!(out.contains(&shown("small-draft/shot.json")), "{out}");
    assert_eq!(desk.names("small-draft/mesh").len(), 5);
    assert_ne!(desk.bytes("small/cache"), desk.bytes("small-draft/cache"));
    // Without a table `[quality.final]` that tier is the preset as written.
    let (out, _) = desk.run("shot small.toml --quality final", 0);
    assert!(out.contains("5 up to date") && !desk.path("small-final").exists(), "{out}");
    desk.write("small.toml", SMALL.to_owned() + "\n[quality.final]\nliquid.spacing = 0.2\n");
    desk.run("simulate small.toml --quality final --frames 1", 0);
    assert_eq!(desk.names("small-final/cache").len(), 1);
}

#[test]
fn a_cache_of_other_settings_is_refused_with_what_differs_and_remedies() {
    let desk = Desk::new();
    with_draft(&desk);
    desk.run("simulate small.toml --frames 1-2", 0);
    let before = desk.bytes("small/cache");
    let other = "simulate small.toml --frames 1-2 --set liquid.spacing=0.2 --set liquid.vorticity=none";
    let (_, talk) = desk.run(other, 14);
    for part in [
        "small: the cached frames were made with other settings",
        "\n  liquid.spacing: 0.1 in the folder, 0.2 now\n",
        "\n  liquid.vorticity: present in the folder, absent now\n",
        "--force deletes these frames",
        "-o DIR keeps these frames",
        "`meniscus shot small/preset.toml -o small` continues",
    ] {
        assert!(talk.contains(part), "{part}:\n{talk}");
    }
    assert_eq!(talk.matches(" in the folder, ").count(), 2, "only these two differ:\n{talk}");
    assert_eq!(desk.bytes("small/cache"), before);

    // The remedies in the message work.
    let (out, _) = desk.run("shot small/preset.toml -o small --frames 1-2", 0);
    assert!(out.contains("2 up to date"), "{out}");
    desk.run(&format!("{other} -o elsewhere"), 0);
    assert_eq!(desk.bytes("small/cache"), before);
    desk.run(&format!("{other} --force"), 0);
    assert_eq!(desk.bytes("small/cache"), desk.bytes("elsewhere/cache"));

    // A record that is not of these frames is not compared.
    let record = fs::read_to_string(desk.path("small/preset.toml")).unwrap();
    desk.write("small/preset.toml", record.replace("gravity", "garvity"));
    let (_, talk) = desk.run("simulate small.toml --frames 1-2", 14);
    assert!(talk.contains("does not hold") && !talk.contains("in the folder,"), "{talk}");
}

#[test]
fn a_preset_of_the_users_own_is_not_replaced() {
    let desk = Desk::new();
    desk.write("preset.toml", SMALL);
    let before = desk.names(".");
    for line in ["shot preset.toml -o .", "shot small.toml -o . --force"] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains("preset.toml: this preset is not a record of meniscus"), "{talk}");
        assert_eq!(fs::read_to_string(desk.path("preset.toml")).unwrap(), SMALL);
        assert_eq!(desk.names("."), before);
    }
    // Where there is none, the current folder is as good as any other, also a second time.
    fs::remove_file(desk.path("preset.toml")).unwrap();
    desk.run("simulate small.toml -o . --frames 1-2", 0);
    let (out, _) = desk.run("simulate preset.toml -o . --frames 1-2", 0);
    assert!(out.contains("2 up to date"), "{out}");
}

#[test]
fn plain_progress_is_a_line_a_frame() {
    let desk = Desk::new();
    let (_, talk) = desk.run("shot small.toml --progress plain", 0);
    let count = |start: &str| talk.lines().filter(|line| line.starts_with(start)).count();
    assert_eq!(count("frame 0002"), 2, "one simulated, one meshed:\n{talk}");
    // A job ends with one; between there are as many as eight seconds of silence.
    assert!((2..6).contains(&count("Progress: ")), "{talk}");
    assert_eq!(count("Progress: 100%"), 2, "{talk}");
}
