//! Whitewater of a cached liquid: equal bytes, continuing, checksums, what is refused.

use super::*;
use serde_json::Value;

/// A dam break with whitewater of a low threshold: drops are slow here.
const WHITE: &str = r#"
[whitewater]
trapped_air_speed = [0.1, 1]
speed = [0.3, 1.5]
wave_crest_curvature = [0.3, 2]
trapped_air = 2000
wave_crests = 2000

[output]"#;

pub(crate) fn desk() -> Desk {
    let desk = Desk::new();
    let text = SMALL.replacen("[output]", WHITE, 1).replacen("\"1-5\"", "\"1-16\"", 1);
    desk.write("white.toml", text.replacen("mesh = [\"ply\"]", "", 1));
    desk
}

/// The numbers of particles in the PLY files of a folder.
fn counts(desk: &Desk, folder: &str) -> Vec<usize> {
    let points = desk.bytes(folder).into_iter().filter(|(name, _)| name.ends_with(".ply"));
    let count = |bytes: Vec<u8>| {
        let head = String::from_utf8_lossy(&bytes[..bytes.len().min(600)]).into_owned();
        let line = head.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap().to_owned();
        line.parse().unwrap()
    };
    points.map(|(_, bytes)| count(bytes)).collect()
}

#[test]
fn whitewater_has_the_same_bytes_for_any_threads_and_wherever_it_continues() {
    let desk = desk();
    let (out, _) = desk.run("shot white.toml --threads 2", 0);
    assert!(out.contains("16 frames of whitewater written"), "{out}");
    let found = counts(&desk, "white/whitewater");
    assert_eq!(found[0], 0, "nothing is emitted before time passes");
    assert!(found[15] > 300, "{found:?}");
    let whole = desk.bytes("white/whitewater");
    let head = String::from_utf8_lossy(&whole[31].1[..400]).into_owned();
    for property in ["x", "radius", "vx", "id", "kind", "age"] {
        assert!(head.contains(&format!(" {property}\n")), "{head}");
    }
    desk.run("verify white", 0);
    for threads in [1, 3] {
        desk.run(&format!("whitewater white --force --threads {threads}"), 0);
        assert!(desk.bytes("white/whitewater") == whole, "{threads} threads");
    }
    // Continued in the middle, and requested for a single frame.
    let log = fs::read_to_string(desk.path("white/whitewater.jsonl")).unwrap();
    fs::remove_dir_all(desk.path("white/whitewater")).unwrap();
    desk.run("whitewater white --frames 1-7", 0);
    desk.run("whitewater white --frames 12", 0);
    let (out, _) = desk.run("whitewater white", 0);
    assert!(out.contains("8 frames of whitewater written") && out.contains("8 up to date"), "{out}");
    assert!(desk.bytes("white/whitewater") == whole);
    assert_eq!(fs::read_to_string(desk.path("white/whitewater.jsonl")).unwrap(), log);
    // A frame that is damaged is computed again.
    let path = desk.path("white/whitewater/frame_0009.mcf");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).unwrap();
    fs::remove_file(desk.path("white/whitewater/whitewater_0009.ply")).unwrap();
    let (_, talk) = desk.run("whitewater white", 0);
    assert!(talk.contains("frame 0009 is computed again"), "{talk}");
    assert!(desk.bytes("white/whitewater") == whole);
}

#[test]
fn another_amount_up_to_the_largest_selects_from_what_is_computed() {
    let desk = desk();
    desk.run("simulate white.toml", 0);
    let set = |amount: f32| {
        format!("whitewater white --set whitewater.amount={amount} --set whitewater.max_amount=2")
    };
    desk.run(&set(2.0), 0);
    let many = counts(&desk, "white/whitewater");
    let frames: Vec<_> =
        desk.bytes("white/whitewater").into_iter().filter(|(name, _)| name.ends_with(".mcf")).collect();
    desk.run(&set(1.0), 0);
    let few = counts(&desk, "white/whitewater");
    let same: Vec<_> =
        desk.bytes("white/whitewater").into_iter().filter(|(name, _)| name.ends_with(".mcf")).collect();
    assert!(frames == same, "nothing is computed again");
    let (few, many) = (few[15] as f64, many[15] as f64);
    assert!((few / many - 0.5).abs() < 3.0 / many.sqrt(), "{few} of {many}");
    desk.run("whitewater white --set whitewater.amount=1", 0);
    assert_eq!(counts(&desk, "white/whitewater")[15] as f64, few, "the same particles as by themselves");
}

/// The number of particles emitted until a frame, and those of each kind in it.
fn emitted_and_kinds(desk: &Desk, shot: &str, frame: u32) -> [f64; 4] {
    let log = fs::read_to_string(desk.path(shot).join("whitewater.jsonl")).unwrap();
    let lines: Vec<Value> = log.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let number = |line: &Value, key: &str| line[key].as_f64().unwrap();
    let sum = |line: &Value| {
        ["emitted_spray", "emitted_foam", "emitted_bubbles"].map(|key| number(line, key)).iter().sum::<f64>()
    };
    let last = lines.iter().find(|line| line["frame"] == frame).unwrap();
    let [spray, foam, bubbles] = ["spray", "foam", "bubbles"].map(|key| number(last, key));
    [lines.iter().map(sum).sum(), spray, foam, bubbles]
}

#[test]
fn frames_a_second_and_steps_hardly_change_what_is_emitted() {
    let desk = desk();
    let text = fs::read_to_string(desk.path("white.toml")).unwrap();
    // Of the same simulation, every frame, every second and every third are cached.
    desk.write("fine.toml", text.replacen("frames = \"1-16\"", "frames = \"1-37\"\nfps = 60", 1));
    let amount = "--set whitewater.amount=20";
    let mut found = Vec::new();
    let cases: &[(&str, &str, &[u32])] = match super::is_soak() {
        true => &[("every", "1-37", &[4, 15]), ("second", "1-37x2", &[4, 15]), ("third", "1-37x3", &[4, 15])],
        false => &[("every", "1-37", &[4]), ("third", "1-37x3", &[15])],
    };
    for (name, frames, steps) in cases {
        desk.run(&format!("simulate fine.toml --frames {frames} -o {name}"), 0);
        for steps in *steps {
            desk.run(&format!("whitewater {name} {amount} --set whitewater.substeps={steps} --force"), 0);
            found.push(emitted_and_kinds(&desk, name, 37));
        }
    }
    for other in &found {
        for (kind, (&a, &b)) in found[0].iter().zip(other).enumerate() {
            let bound = 0.05 * a + 4.0 * a.sqrt();
            assert!((a - b).abs() < bound, "{kind}: {found:?}");
        }
    }
    assert!(found[0][0] > 5000.0, "{found:?}");
}

#[test]
fn what_cannot_be_made_is_refused_in_words() {
    let desk = desk();
    desk.run("simulate white.toml --frames 1-4", 0);
    for (set, expected) in [
        ("whitewater.speed=[2,1]", "`whitewater.speed` is no range"),
        ("whitewater.max_amount=0.5", "`amount` is above `max_amount`"),
        ("whitewater.foam.lifetime=0", "above 0"),
        ("whitewater.max_particles=0", "1 to 100000000"),
    ] {
        let (_, talk) = desk.run(&format!("whitewater white --set {set}"), 2);
        assert!(talk.contains(expected), "{set}: {talk}");
    }
    let (_, talk) = desk.run("whitewater white --set liquid.spacing=0.2", 2);
    assert!(talk.contains("simulated already"), "{talk}");
    // More than allowed is counted, and not emitted.
    let (_, talk) = desk.run("whitewater white --set whitewater.max_particles=3", 0);
    assert!(talk.contains("above `whitewater.max_particles`"), "{talk}");
    assert!(counts(&desk, "white/whitewater").iter().all(|&count| count <= 3));
    // A cache that has lost a frame in between: another chain, and no frame of the old one in it.
    desk.run("whitewater white", 0);
    fs::remove_file(desk.path("white/cache/frame_0003.mcf")).unwrap();
    let (out, _) = desk.run("whitewater white", 0);
    assert!(out.contains("1 frames of whitewater written") && out.contains("2 up to date"), "{out}");
    let (_, talk) = desk.run("whitewater white --frames 1-4", 3);
    assert!(talk.contains("0003") && talk.contains("not in the cache"), "{talk}");
    let log: Vec<Value> = fs::read_to_string(desk.path("white/whitewater.jsonl"))
        .unwrap()
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    assert!(!log.is_empty() && log.iter().all(|line| line["emitted_spray"].is_u64()), "{log:?}");
    // A preset without a liquid has none.
    desk.run("simulate smoke-ring --quality draft --frames 1-2 -o ring", 0);
    let (_, talk) = desk.run("whitewater ring", 2);
    assert!(talk.contains("no particles in this cache"), "{talk}");
}

#[test]
fn volumes_and_arrays_hold_what_the_points_hold() {
    let desk = desk();
    desk.run("simulate white.toml", 0);
    let files = "whitewater white --frames 1-16 --set whitewater.files=[\"ply\",\"vdb\",\"npz\"]";
    let (out, _) = desk.run(files, 0);
    assert!(out.contains("16 frames of whitewater written"), "{out}");
    let names = desk.names("white/whitewater");
    let of = |ending: &str| names.iter().filter(|name| name.ends_with(ending)).count();
    assert_eq!(["mcf", "ply", "vdb", "npz"].map(of), [16; 4], "{names:?}");
    let (out, _) = desk.run(files, 0);
    assert!(out.contains("0 frames of whitewater written") && out.contains("16 up to date"), "{out}");
    desk.run("verify white", 0);
    let (info, _) = desk.run("info white", 0);
    assert!(info.contains("whitewater ") && info.contains("particles in frame 0016"), "{info}");

    // Equal arrays: particles of both files make the same mesh.
    let meshed = |extension: &str| {
        let line = format!("mesh white/whitewater/whitewater_0016.{extension} --spacing 0.02 -o {extension}");
        desk.run(&line, 0);
        desk.bytes(&format!("{extension}/mesh")).into_iter().map(|(_, bytes)| bytes[400..].to_vec()).next()
    };
    assert!(meshed("npz").is_some_and(|mesh| !mesh.is_empty()));
    assert_eq!(meshed("npz"), meshed("ply"));

    // A coarser volume is another file; the points stay.
    let before = desk.bytes("white/whitewater");
    let (out, _) = desk.run(&format!("{files} --set whitewater.voxel=0.3"), 0);
    assert!(out.contains("16 frames of whitewater written"), "{out}");
    let after = desk.bytes("white/whitewater");
    let changed: Vec<&String> =
        before.iter().zip(&after).filter(|(a, b)| a != b).map(|(_, (name, _))| name).collect();
    assert!(changed.iter().any(|name| name.ends_with("_0016.vdb")), "{changed:?}");
    assert!(changed.iter().all(|name| name.ends_with(".vdb")), "{changed:?}");
    desk.run("verify white", 0);

    // Files that are not requested stay in the list as long as they show the same.
    let listed = |amount: &str| {
        desk.run(&format!("whitewater white --set whitewater.amount={amount}"), 0);
        let manifest: Value =
            serde_json::from_slice(&fs::read(desk.path("white/shot.json")).unwrap()).unwrap();
        let outputs = manifest["outputs"].as_array().unwrap().clone();
        outputs.iter().map(|output| output["format"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(listed("1").iter().filter(|format| *format != "ply").count(), 2);
    assert_eq!(listed("0.5"), ["ply"]);
    desk.run("verify white", 0);
    desk.run(files, 0);

    for wrong in ["[]", "[\"ply\",\"ply\"]", "[\"obj\"]"] {
        let (_, talk) = desk.run(&format!("whitewater white --set whitewater.files={wrong}"), 2);
        assert!(talk.contains("whitewater.files"), "{wrong}: {talk}");
    }
    fs::write(desk.path("white/whitewater/whitewater_0016.npz"), b"other").unwrap();
    let (out, talk) = desk.run("verify white", 12);
    assert!((out + &talk).contains("whitewater_0016.npz"), "a damaged file is found");
}

#[test]
fn no_file_is_written_whose_record_could_not_name_its_liquid() {
    let desk = desk();
    desk.run("shot white.toml --frames 1-4", 0);
    let frame = desk.path("white/cache/frame_0003.mcf");
    let [good, records] =
        [frame.clone(), desk.path("white/whitewater.jsonl")].map(|path| fs::read(path).unwrap());
    // Its whitewater is stored, so that nothing but the record needs the liquid.
    fs::write(&frame, "damaged").unwrap();
    fs::remove_file(desk.path("white/whitewater/whitewater_0003.ply")).unwrap();
    let (_, talk) = desk.run("whitewater white", 12);
    assert!(talk.contains("frame_0003.mcf"), "{talk}");
    assert!(!desk.path("white/whitewater/whitewater_0003.ply").exists());
    fs::write(&frame, good).unwrap();
    desk.run("whitewater white", 0);
    assert_eq!(fs::read(desk.path("white/whitewater.jsonl")).unwrap(), records);
    desk.run("verify white", 0);
}
