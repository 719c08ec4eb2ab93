//! Wedges: a shot folder for every combination of settings, compared on a sheet and in tables.

use super::*;

const LINE: &str =
    "wedge small.toml --set liquid.spacing=0.1,0.16 --set liquid.iterations=3,6 --frames 1-3 -o wedges";

#[test]
fn every_combination_is_a_shot_and_the_sheet_shows_all() {
    let desk = Desk::new();
    let (out, talk) = desk.run(LINE, 0);
    assert!(talk.contains("wedge 4 of 4: liquid.spacing=0.16  liquid.iterations=6"), "{talk}");
    for name in ["contact-sheet.png", "wedges.csv", "wedges.html"] {
        assert!(out.contains(name) && desk.path("wedges").join(name).is_file(), "{out}");
    }
    let csv = fs::read_to_string(desk.path("wedges/wedges.csv")).unwrap();
    let lines: Vec<&str> = csv.lines().collect();
    let head = "number,folder,liquid.spacing,liquid.iterations,frames,requested_frames,seconds,particles,";
    assert!(lines.len() == 5 && lines[0].starts_with(head), "{csv}");
    assert!(
        lines[2].starts_with("2,spacing-0p1_iterations-6,0.1,6,3,3,") && lines[2].contains(",512,"),
        "{csv}"
    );
    desk.run("verify wedges/spacing-0p16_iterations-3", 0);
    // A wedge is the shot that the command line would make.
    desk.run("shot small.toml --set liquid.spacing=0.16 --set liquid.iterations=3 --frames 1-3 -o alone", 0);
    assert_eq!(desk.bytes("wedges/spacing-0p16_iterations-3/cache"), desk.bytes("alone/cache"));
    assert_eq!(desk.bytes("wedges/spacing-0p16_iterations-3/mesh"), desk.bytes("alone/mesh"));

    // Again: nothing is simulated, and the sheet has the same bytes for any number of threads.
    let sheet = fs::read(desk.path("wedges/contact-sheet.png")).unwrap();
    let (out, _) = desk.run(&format!("{LINE} --threads 1"), 0);
    assert!(out.contains("3 up to date"), "{out}");
    assert_eq!(fs::read(desk.path("wedges/contact-sheet.png")).unwrap(), sheet);
    desk.run("wedge wedges --threads 3", 0);
    assert_eq!(fs::read(desk.path("wedges/contact-sheet.png")).unwrap(), sheet);
    desk.run("wedge wedges --at 1", 0);
    assert_ne!(fs::read(desk.path("wedges/contact-sheet.png")).unwrap(), sheet);
    let (_, talk) = desk.run("wedge wedges --at 1-13", 2);
    assert!(talk.contains("at most 12"), "{talk}");
    let (_, talk) = desk.run("wedge wedges --force", 2);
    assert!(talk.contains("--force"), "{talk}");
}

#[test]
fn prepared_wedges_are_tasks_of_a_farm() {
    let desk = Desk::new();
    let line = "wedge small.toml --set liquid.iterations=3,6 -o wedges --prepare";
    let (out, _) = desk.run(line, 0);
    assert!(out.contains("2 wedges prepared") && !desk.path("wedges/iterations-3/cache").exists(), "{out}");
    let (_, talk) = desk.run("wedge wedges", 2);
    assert!(talk.contains("found no frames"), "{talk}");
    desk.run("farm openjd wedges --chunk 5", 0);
    let text = fs::read_to_string(desk.path("wedges/farm.openjd.json")).unwrap();
    let template: serde_json::Value = serde_json::from_str(&text).unwrap();
    let steps = template["steps"].as_array().unwrap();
    assert_eq!(steps.last().unwrap()["name"], "compare");
    let shots = &steps[0]["parameterSpace"]["taskParameterDefinitions"][0];
    assert_eq!(shots["range"], serde_json::json!(["iterations-3", "iterations-6"]));
    desk.run("farm slurm wedges", 0);
    assert!(
        fs::read_to_string(desk.path("wedges/farm.slurm.sh"))
            .unwrap()
            .contains("shots='iterations-3 iterations-6'")
    );
    // One job has the frames and outputs of all.
    desk.run("wedge small.toml --set frames=\"1-3\",\"1-4\" -o other --prepare", 0);
    let (_, talk) = desk.run("farm openjd other", 2);
    assert!(talk.contains("another `frames`"), "{talk}");
    // A list that names a folder elsewhere is not followed.
    let list = fs::read_to_string(desk.path("wedges/wedges.json")).unwrap();
    desk.write("wedges/wedges.json", list.replace("iterations-3", "../small"));
    for verb in ["wedge wedges", "farm openjd wedges"] {
        let (_, talk) = desk.run(verb, 1);
        assert!(talk.contains("../small"), "{talk}");
    }
}

#[test]
fn a_wedge_that_fails_leaves_the_others() {
    let desk = Desk::new();
    let line = "wedge small.toml --set liquid.spacing=0.1,0.01 --frames 1-2 --max-memory 100MiB -o wedges";
    let (out, talk) = desk.run(line, 33);
    assert!(talk.contains("1 of 2 wedges failed") && talk.contains("wedge 2, liquid.spacing=0.01"), "{talk}");
    assert!(out.contains("contact-sheet.png"), "{out}");
    desk.run("verify wedges/spacing-0p1", 0);
    let (_, talk) = desk.run("wedge small.toml --set liquid.spacing=0.1,0.10 -o same", 2);
    assert!(talk.contains("same shot") && !desk.path("same").exists(), "{talk}");
}

#[test]
fn wedges_that_are_not_what_the_list_names_are_no_success() {
    let desk = Desk::new();
    desk.run("wedge small.toml --set liquid.iterations=3,6 --frames 1-3 -o wedges", 0);
    let [three, six] = ["wedges/iterations-3", "wedges/iterations-6"].map(|folder| desk.path(folder));
    let compare = |code: i32, expected: &str| {
        let (out, talk) = desk.run("wedge wedges", code);
        assert!(out.contains("contact-sheet.png") && talk.contains(expected), "{talk}");
        let page = fs::read_to_string(desk.path("wedges/wedges.html")).unwrap();
        (talk, page)
    };
    // Folders that were exchanged, and one frame of another wedge, which has the same number of particles.
    let aside = desk.path("aside");
    fs::rename(&three, &aside).unwrap();
    fs::rename(&six, &three).unwrap();
    fs::rename(&aside, &six).unwrap();
    let (talk, page) = compare(14, "2 of 2 wedges failed");
    assert!(
        talk.contains("preset.toml has other values") && page.contains("preset.toml has other values"),
        "{talk}"
    );
    let csv = fs::read_to_string(desk.path("wedges/wedges.csv")).unwrap();
    assert!(csv.lines().nth(1).unwrap().starts_with("1,iterations-3,3,0,0,0.000,0,"), "{csv}");
    fs::rename(&three, &aside).unwrap();
    fs::rename(&six, &three).unwrap();
    fs::rename(&aside, &six).unwrap();
    compare_is_sound(&desk);
    let frame = |folder: &std::path::Path| folder.join("cache/frame_0002.mcf");
    let own = fs::read(frame(&three)).unwrap();
    fs::copy(frame(&six), frame(&three)).unwrap();
    compare(14, "a frame of another simulation");
    // A byte that only reading the whole frame shows, a frame that is missing, and no frame at all.
    let mut damaged = own.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(frame(&three), damaged).unwrap();
    compare(12, "wedge 1, liquid.iterations=3");
    fs::remove_file(frame(&three)).unwrap();
    let (_, page) = compare(3, "missing frames: 2");
    assert!(page.contains("missing frames: 2"), "{page}");
    // Of two faults the gravest counts.
    let third = three.join("cache/frame_0003.mcf");
    let whole = fs::read(&third).unwrap();
    let mut damaged = whole.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    fs::write(&third, damaged).unwrap();
    compare(12, "wedge 1, liquid.iterations=3");
    fs::write(&third, whole).unwrap();
    fs::write(frame(&three), own).unwrap();
    compare_is_sound(&desk);
    // Without its manifest nothing shows whose frames they are.
    let manifest = fs::read(three.join("shot.json")).unwrap();
    fs::remove_file(three.join("shot.json")).unwrap();
    compare(10, "shot.json is missing");
    fs::write(three.join("shot.json"), manifest).unwrap();
    compare_is_sound(&desk);
    fs::remove_dir_all(&six).unwrap();
    compare(3, "wedge 2, liquid.iterations=6: not simulated");
}

#[test]
fn settings_within_a_setting_that_varies_are_those_of_the_wedge() {
    let desk = Desk::new();
    let line = "wedge small.toml --set world.gravity=[0,0,-9],[0,0,-5] --set world.gravity.0=1 --frames 1-2 -o wedges";
    desk.run(line, 0);
    compare_is_sound(&desk);
}

fn compare_is_sound(desk: &Desk) {
    let (_, talk) = desk.run("wedge wedges", 0);
    assert!(!talk.contains("failed"), "{talk}");
}

#[test]
fn what_every_wedge_failed_of_is_reported_although_there_is_nothing_to_compare() {
    let desk = Desk::new();
    let (_, talk) = desk.run(&format!("{LINE} --max-memory 1MiB"), 33);
    assert!(talk.contains("wedge 4") && !talk.contains("--prepare"), "{talk}");
}

// Windows lets administrators alone make symbolic links.
#[cfg(unix)]
#[test]
fn wedges_and_presets_behind_links_that_lead_out_are_refused() {
    let desk = Desk::new();
    desk.run("wedge small.toml --set liquid.iterations=3,6 -o wedges --prepare", 0);
    fs::rename(desk.path("wedges/iterations-3"), desk.path("elsewhere")).unwrap();
    std::os::unix::fs::symlink("../elsewhere", desk.path("wedges/iterations-3")).unwrap();
    for line in ["wedge wedges", "farm slurm wedges"] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains("iterations-3: found a link that leads out"), "{line}: {talk}");
    }
    fs::rename(desk.path("elsewhere/preset.toml"), desk.path("preset.toml")).unwrap();
    std::os::unix::fs::symlink("../preset.toml", desk.path("elsewhere/preset.toml")).unwrap();
    let (_, talk) = desk.run("farm slurm elsewhere", 2);
    assert!(talk.contains("preset.toml: found a link that leads out"), "{talk}");
}
