//! Meshes and moving colliders, from the preset to the shot folder.

use super::*;

/// A closed box from -0.5 to 0.5, as OBJ.
const BOX: &str = "v -0.5 -0.5 -0.5\nv 0.5 -0.5 -0.5\nv -0.5 0.5 -0.5\nv 0.5 0.5 -0.5\nv -0.5 -0.5 0.5\n\
    v 0.5 -0.5 0.5\nv -0.5 0.5 0.5\nv 0.5 0.5 0.5\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";

/// The small shot with a mesh that turns in the tank, and a mesh to fill.
fn with_meshes(desk: &Desk) {
    fs::create_dir_all(desk.path("models")).unwrap();
    desk.write("models/box.obj", BOX);
    let mesh = |keys: &str| format!("{{ mesh = {{ file = \"models/box.obj\", resolution = 24, {keys} }} }}");
    let solids = format!(
        "[[world.collider]]\nshape = {}\nkeyframes = [ {{ frame = 1, position = [1.2, 0.4, 0.3] }}, \
         {{ frame = 9, position = [1.0, 0.4, 0.3], rotation = [0, 0, 90] }} ]\n\n[liquid]",
        mesh("scale = 0.4")
    );
    let source = format!(
        "[[liquid.source]]\nshape = {}\n\n[output]",
        mesh("scale = \"20 %\", translate = [1.2, 0.4, 0.9]")
    );
    desk.write("mesh.toml", SMALL.replacen("[liquid]", &solids, 1).replacen("[output]", &source, 1));
}

#[test]
fn a_mesh_is_sampled_once_and_its_samples_are_verified() {
    let desk = Desk::new();
    with_meshes(&desk);
    let (_, talk) = desk.run("simulate mesh.toml --frames 1-3", 0);
    assert!(!talk.contains("sampled again"), "{talk}");
    let samples = desk.bytes("mesh/sdf");
    assert_eq!(samples.len(), 1, "one file and one resolution");

    // The next run reads them; damage is named and fixed.
    let path = desk.path("mesh/sdf").join(&samples[0].0);
    let mut damaged = samples[0].1.clone();
    let middle = damaged.len() / 2;
    damaged[middle] ^= 4;
    fs::write(&path, damaged).unwrap();
    let (_, talk) = desk.run("simulate mesh.toml", 0);
    assert!(talk.contains("models/box.obj is sampled again") && talk.contains("checksum"), "{talk}");
    assert_eq!(desk.bytes("mesh/sdf"), samples);

    // So is what cannot be read, as a link out of the folder or a pipe of that name.
    #[cfg(unix)]
    for plant in ["ln -s ../../small.toml", "mkfifo"] {
        fs::remove_file(&path).unwrap();
        let line = format!("{plant} {}", path.display());
        assert!(std::process::Command::new("sh").args(["-c", &line]).status().unwrap().success());
        let (_, talk) = desk.run("simulate mesh.toml", 0);
        assert!(talk.contains("models/box.obj is sampled again"), "{talk}");
        assert_eq!(desk.bytes("mesh/sdf"), samples, "{plant}");
    }

    // A resumed run has the bytes of an uninterrupted one, and so has the preset as run, which finds the mesh.
    desk.run("simulate mesh.toml -o whole", 0);
    desk.run("simulate whole/preset.toml -o again --threads 1", 0);
    assert_eq!(desk.bytes("mesh/cache"), desk.bytes("whole/cache"));
    assert_eq!(desk.bytes("again/cache"), desk.bytes("whole/cache"));

    // Another mesh under the same name is another shot.
    desk.write("models/box.obj", BOX.replace("0.5 0.5 0.5\n", "0.5 0.5 0.6\n"));
    let (_, talk) = desk.run("simulate mesh.toml", 14);
    assert!(talk.contains("other settings"), "{talk}");
}

#[test]
fn meshes_that_cannot_be_used_are_named() {
    let desk = Desk::new();
    with_meshes(&desk);
    let set = "--set world.collider.1.shape.mesh.file";
    let cases = [
        ("models/bax.obj", 2, "the mesh `models/bax.obj` is not there"),
        ("../box.obj", 2, "leads out of the preset's folder"),
        ("/box.obj", 2, "leads out of the preset's folder"),
        ("models/box.stl", 2, "ends in .ply or .obj"),
    ];
    for (file, code, words) in cases {
        let (_, talk) = desk.run(&format!("simulate mesh.toml {set}={file}"), code);
        assert!(talk.contains(words), "{file}: {talk}");
    }
    desk.write("models/box.obj", BOX.replace("f 2 4 8 6", "f 2 4 8 9"));
    let (_, talk) = desk.run("simulate mesh.toml", 1);
    assert!(talk.contains(&shown("models/box.obj: line 14: found f 2 4 8 9")), "{talk}");
    desk.write("models/box.obj", &BOX[..BOX.find("f 5").unwrap()]);
    let (_, talk) = desk.run("simulate mesh.toml", 1);
    assert!(talk.contains("encloses nothing"), "{talk}");
}

/// A prism over the letter L, whose caps have six corners each, the first of which does not see all others.
const LETTER: &str = "v 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 0 0 0\n\
    v 2 0 1\nv 2 1 1\nv 1 1 1\nv 1 2 1\nv 0 2 1\nv 0 0 1\nf 6 5 4 3 2 1\nf 7 8 9 10 11 12\n\
    f 1 2 8 7\nf 2 3 9 8\nf 3 4 10 9\nf 4 5 11 10\nf 5 6 12 11\nf 6 1 7 12\n";

#[test]
fn faces_of_many_corners_and_crossing_parts_are_counted() {
    let desk = Desk::new();
    with_meshes(&desk);
    desk.write("models/box.obj", LETTER);
    let (_, talk) = desk.run("simulate mesh.toml -o letter --frames 1", 0);
    assert!(talk.contains("found 2 faces of five and more corners, cut into triangles"), "{talk}");
    assert!(!talk.contains("pass through others"), "{talk}");

    // A second one, moved by half of its width, passes through the first.
    let moved = LETTER.lines().filter_map(|line| line.strip_prefix("v ")).map(|place| {
        let [x, y, z] = [0, 1, 2].map(|axis| place.split(' ').nth(axis).unwrap().parse::<f32>().unwrap());
        format!("v {} {} {}\n", x + 0.5, y + 0.25, z + 0.3)
    });
    let faces = LETTER.lines().filter_map(|line| line.strip_prefix("f ")).map(|corners| {
        let corners = corners.split(' ').map(|corner| format!(" {}", corner.parse::<u32>().unwrap() + 12));
        format!("f{}\n", corners.collect::<String>())
    });
    desk.write("models/box.obj", LETTER.to_owned() + &moved.chain(faces).collect::<String>());
    let (_, talk) = desk.run("simulate mesh.toml -o two --frames 1", 0);
    assert!(
        talk.contains("4 faces of five") && talk.contains("triangles that pass through others"),
        "{talk}"
    );

    // A face that crosses itself is cut all the same, and reported.
    desk.write("models/box.obj", LETTER.replace("f 6 5 4 3 2 1", "f 6 3 5 4 1 2"));
    let (_, talk) = desk.run("simulate mesh.toml -o folded --frames 1", 0);
    assert!(talk.contains("1 faces that cross themselves"), "{talk}");
}
