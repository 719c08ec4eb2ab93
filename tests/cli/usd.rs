//! USD stages of a shot: which layers are written, kept and refused. `tools/python/test_usd.py` reads them with OpenUSD.

use super::*;
use serde_json::{Value, json};

/// The small shot with a box that moves and one that is hidden.
fn desk() -> Desk {
    let desk = Desk::new();
    let colliders = "[[world.collider]]\nshape = { box = { min = [1.2, 0.2, 0], max = [1.4, 0.6, 0.3] } }\nkeyframes = [\n\
        { frame = 1, position = [0, 0, 0] }, { frame = 5, position = [0.1, 0, 0.2], rotation = [0, 0, 90] }]\n\n\
        [[world.collider]]\nlook = \"hidden\"\nshape = { sphere = { center = [1.0, 0.4, 0.1], radius = 0.1 } }\n\n\
        [camera]\nposition = [1, -4, 2]\ntarget = [0.8, 0.4, 0.4]\nfocal_length = 35\n\n[liquid]";
    desk.write("small.toml", SMALL.replacen("[liquid]", colliders, 1));
    desk.run("shot small.toml", 0);
    desk
}

fn manifest(desk: &Desk) -> Value {
    serde_json::from_slice(&fs::read(desk.path("small/shot.json")).unwrap()).unwrap()
}

/// Adds an output to the manifest that is like the one with this pattern, apart from some fields.
fn add_output(desk: &Desk, pattern: &str, fields: Value) {
    let mut shot = manifest(desk);
    let outputs = shot["outputs"].as_array_mut().unwrap();
    let mut output = outputs.iter().find(|output| output["pattern"] == pattern).unwrap().clone();
    output.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
    outputs.push(output);
    desk.write("small/shot.json", shot.to_string());
}

/// Writes a file of a product with a record, as the product does.
fn write_recorded(desk: &Desk, file: &str, bytes: &[u8]) {
    desk.write(&format!("small/{file}"), bytes);
    let log = format!("small/{}.jsonl", file.split('/').next().unwrap());
    let sum = format!("{:016x}", xxhash_rust::xxh3::xxh3_64(bytes));
    let files = json!([{ "file": file, "bytes": bytes.len(), "xxh3": sum }]);
    let line = json!({ "frame": 1, "name": file, "key": "0123456789abcdef", "files": files });
    let text = fs::read_to_string(desk.path(&log)).unwrap();
    desk.write(&log, format!("{text}{line}\n"));
}

fn root(desk: &Desk) -> String {
    fs::read_to_string(desk.path("small/usd/shot.usda")).unwrap()
}

#[test]
fn a_stage_has_a_layer_for_each_frame_and_is_kept() {
    let desk = desk();
    let (out, _) = desk.run("usd small --threads 2", 0);
    assert!(out.contains("8 layers written") && out.contains("0 up to date"), "{out}");
    let layers = (1..=5).map(|frame| format!("mesh-liquid_{frame:04}.usdc"));
    let others =
        ["collider-box.usdc", "collider-sphere.usdc", "manifest.usda", "shot.usda"].map(String::from);
    let mut expected: Vec<String> = layers.chain(others).collect();
    expected.sort();
    assert_eq!(desk.names("small/usd"), expected);
    let text = root(&desk);
    for part in [
        "startTimeCode = 1\n",
        "endTimeCode = 5\n",
        "timeCodesPerSecond = 24\n",
        "@./mesh-liquid_0005.usdc@",
        "@./collider-box.usdc@",
        "float focalLength = 0.35\n",
    ] {
        assert!(text.contains(part), "{part}\n{text}");
    }
    assert_eq!(text.matches("invisible").count(), 1, "the hidden collider");
    let shot = manifest(&desk);
    let root = shot["outputs"].as_array().unwrap().iter().find(|output| output["pattern"] == "usd/shot.usda");
    assert_eq!(root.unwrap()["frames"]["step"], 1, "the frames of all that it shows");
    let whole = desk.bytes("small/usd");
    let (out, _) = desk.run("usd small", 0);
    assert!(out.contains("0 layers written") && out.contains("8 up to date"), "{out}");
    for threads in [1, 3] {
        desk.run(&format!("usd small --force --threads {threads}"), 0);
        assert!(desk.bytes("small/usd") == whole, "{threads} threads");
    }
    let (out, _) = desk.run("verify small", 0);
    assert!(
        out.contains("usd        2 valid: usd/shot.usda") && out.contains("1 valid: usd/collider-box.usdc"),
        "{out}"
    );
    assert!(desk.run("info small", 0).0.contains("5 usdc files, 0 missing: usd/mesh-liquid_{:04}.usdc"));
}

#[test]
fn damaged_layers_are_found_and_made_again() {
    let desk = desk();
    desk.run("usd small", 0);
    let whole = desk.bytes("small/usd");
    for file in ["mesh-liquid_0003.usdc", "collider-box.usdc", "shot.usda"] {
        let path = desk.path(&format!("small/usd/{file}"));
        let mut bytes = fs::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(&path, bytes).unwrap();
        let (_, talk) = desk.run("verify small", 12);
        assert!(talk.contains(file) && talk.contains("meniscus usd small"), "{talk}");
        let (out, _) = desk.run("usd small", 0);
        assert!(out.contains("1 layers written") && out.contains("7 up to date"), "{file}: {out}");
        assert!(desk.bytes("small/usd") == whole, "{file}");
    }
}

#[test]
fn meshes_that_are_not_as_they_were_written_are_left_out() {
    let desk = desk();
    let path = desk.path("small/mesh/liquid_0003.ply");
    let mut bytes = fs::read(&path).unwrap();
    let last = bytes.len() - 20;
    bytes[last] ^= 1;
    fs::write(&path, bytes).unwrap();
    let (_, talk) = desk.run("usd small", 12);
    assert!(talk.contains("mesh/liquid_0003.ply: found other bytes than were written"), "{talk}");
    let text = root(&desk);
    assert!(text.contains("liquid_0002.usdc@") && !text.contains("liquid_0003.usdc@"), "{text}");
    desk.run("mesh small", 0);
    desk.run("usd small", 0);
    assert!(root(&desk).contains("liquid_0003.usdc@"));
    // Of a collider, whose other files are as they were.
    let mut motion = fs::read_to_string(desk.path("small/collider/box.json")).unwrap();
    motion.push(' ');
    desk.write("small/collider/box.json", motion);
    let (_, talk) = desk.run("usd small", 12);
    assert!(talk.contains("collider/box.json"), "{talk}");
    assert!(!root(&desk).contains("collider-box.usdc") && root(&desk).contains("collider-sphere.usdc"));
}

#[test]
fn a_broken_file_does_not_take_others_of_its_frame_with_it() {
    let desk = desk();
    for frame in 1..=5 {
        let bytes = fs::read(desk.path(&format!("small/mesh/liquid_{frame:04}.ply"))).unwrap();
        write_recorded(&desk, &format!("mesh/twin_{frame:04}.ply"), &bytes);
    }
    let fields = json!({ "name": "twin", "pattern": "mesh/twin_{:04}.ply" });
    add_output(&desk, "mesh/liquid_{:04}.ply", fields);
    write_recorded(&desk, "mesh/liquid_0003.ply", b"ply\nno such header\n");
    let (_, talk) = desk.run("usd small", 12);
    assert!(talk.contains("mesh/liquid_0003.ply"), "{talk}");
    let text = root(&desk);
    assert!(text.contains("mesh-twin_0003.usdc@") && !text.contains("mesh-liquid_0003.usdc@"), "{text}");
    assert!(text.contains("mesh-liquid_0004.usdc@"), "{text}");
}

#[test]
fn files_that_are_gone_or_not_shown_are_reported() {
    let desk = desk();
    desk.run("usd small", 0);
    // Its layer is up to date, and its columns are not known any more.
    desk.write("small/mesh/liquid_0002.ply", "ply");
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("1 frames of other files or settings are not in the stage"), "{talk}");
    fs::remove_file(desk.path("small/mesh/liquid_0003.ply")).unwrap();
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("mesh liquid: 1 of 5 frames have no file mesh/liquid_{:04}.ply"), "{talk}");
    (1..=5).filter(|&frame| frame != 3).for_each(|frame| {
        fs::remove_file(desk.path(&format!("small/mesh/liquid_{frame:04}.ply"))).unwrap();
    });
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("mesh liquid: 5 of 5 frames have no file"), "{talk}");
    // Meshes of what has a motion already, and a mesh of all frames.
    let fields = json!({ "format": "ply", "pattern": "collider/box_{:04}.ply", "rest": null });
    add_output(&desk, "collider/box.json", fields);
    add_output(
        &desk,
        "collider/box.json",
        json!({ "name": "rock", "format": "ply", "pattern": "collider/rock.ply", "rest": null }),
    );
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("collider box: its PLY files are not in the stage"), "{talk}");
    assert!(
        talk.contains("collider rock: not in the stage") && talk.contains("a file for each frame"),
        "{talk}"
    );
}

#[test]
fn layers_of_points_or_of_long_caches_are_refused() {
    let desk = desk();
    let header = |columns: &str, faces: &str| {
        let position = "property float x\nproperty float y\nproperty float z\n";
        format!(
            "ply\nformat binary_little_endian 1.0\nelement vertex 1\n{position}{columns}{faces}end_header\n"
        )
    };
    let faces = "element face 0\nproperty list uchar uint vertex_indices\n";
    let file = |columns: &str, faces: &str, numbers: usize| {
        [header(columns, faces).as_bytes(), &vec![0; 4 * numbers]].concat()
    };
    write_recorded(&desk, "collider/box.ply", &file("", "", 3));
    let (_, talk) = desk.run("usd small", 12);
    assert!(talk.contains("collider/box.ply: found points, expected a mesh"), "{talk}");
    write_recorded(&desk, "collider/box.ply", &file("property float wear\n", faces, 4));
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("collider/box.ply: not in the stage: the attributes wear"), "{talk}");
    // A point cache whose samples cost more than their bytes.
    let cache = |samples: i32| {
        let head = [1_i32, 1].map(i32::to_le_bytes).concat();
        let times = [1.0_f32, 1.0].map(f32::to_le_bytes).concat();
        let points = vec![0; 12 * samples as usize];
        [b"POINTCACHE2\0", &head[..], &times, &samples.to_le_bytes(), &points].concat()
    };
    write_recorded(&desk, "collider/flag.ply", &file("", faces, 3));
    let fields = json!({ "kind": "sheet", "name": "flag", "format": "pc2", "pattern": "collider/flag.pc2",
        "rest": "collider/flag.ply" });
    add_output(&desk, "collider/box.json", fields);
    write_recorded(&desk, "collider/flag.pc2", &cache(5));
    desk.run("usd small", 0);
    write_recorded(&desk, "collider/flag.pc2", &cache(250_001));
    let (_, talk) = desk.run("usd small", 12);
    assert!(talk.contains("collider/flag.pc2: found 250001 samples, expected at most 250000"), "{talk}");
}

#[test]
fn frames_of_other_settings_are_not_mixed() {
    let desk = desk();
    desk.run("usd small", 0);
    let (out, talk) = desk.run("usd small --up y --scale 100 --names maya --frames 2-3", 0);
    assert!(talk.contains("3 frames of other files or settings are not in the stage"), "{out}\n{talk}");
    assert!(talk.contains("2 sheets and colliders are made with all their frames"), "{talk}");
    let text = root(&desk);
    assert!(text.contains("upAxis = \"Y\"") && text.contains("metersPerUnit = 0.01\n"), "{text}");
    assert!(
        text.contains("active = [(2, 0), (3, 1)]") && text.contains("color3f[] primvars:velocityPV ("),
        "{text}"
    );
    assert!(text.contains("float focalLength = 35\n"), "{text}");
    desk.run("usd small --up y --scale 100 --names maya", 0);
    assert!(root(&desk).contains("active = [(1, 0), (2, 1), (3, 2), (4, 3), (5, 4)]"));
    desk.run("verify small", 0);
    // Into another folder, where it is alone.
    desk.run("usd small -o elsewhere --frames 1", 0);
    assert!(desk.names("elsewhere/usd").contains(&"mesh-liquid_0001.usdc".to_owned()));
    desk.run("verify elsewhere", 0);
    // A stage of fewer things leaves no output of the others in the manifest.
    let manifest = fs::read_to_string(desk.path("small/shot.json")).unwrap();
    assert!(manifest.contains("usd/collider-box.usdc"));
    let mut shot: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    let outputs = shot["outputs"].as_array_mut().unwrap();
    outputs.retain(|output| output["pattern"] != "collider/box.json");
    desk.write("small/shot.json", shot.to_string());
    desk.run("usd small", 0);
    assert!(!fs::read_to_string(desk.path("small/shot.json")).unwrap().contains("usd/collider-box.usdc"));
}

#[test]
fn what_cannot_be_a_stage_is_refused_with_the_next_step() {
    let desk = desk();
    fs::create_dir(desk.path("empty")).unwrap();
    let (_, talk) = desk.run("usd empty", 2);
    assert!(talk.contains("found no shot.json") && talk.contains("meniscus mesh"), "{talk}");
    for (arguments, part) in [
        ("--up x", "expected y or z"),
        ("--scale 0", "expected units in a metre"),
        ("--scale nan", "expected units in a metre"),
        ("--scale -1", "expected units in a metre"),
        ("--names softimage", "expected houdini or maya"),
        ("--frames 90", "no file of a mesh or of points has this number"),
    ] {
        let code = if arguments.contains("frames") { 3 } else { 2 };
        let (_, talk) = desk.run(&format!("usd small {arguments}"), code);
        assert!(talk.contains(part), "{arguments}: {talk}");
    }
    let (_, talk) = desk.run("usd small --force --max-memory 1MiB", 33);
    assert!(talk.contains("--max-memory"), "{talk}");
    desk.run("mesh small --format obj --set surface.voxel=1", 0);
    let (_, talk) = desk.run("usd small", 0);
    assert!(talk.contains("mesh liquid: not in the stage, since its files are obj"), "{talk}");
    assert!(!root(&desk).contains("mesh-liquid"));
    // Of colliders alone.
    let (_, talk) = desk.run("usd small --force --max-memory 1MiB", 33);
    assert!(talk.contains("--max-memory"), "{talk}");
}
