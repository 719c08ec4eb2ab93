//! Shots of sheets: from preset to point caches and meshes, resumed, repeated, and with damaged frames.

use super::{meshing::read_ply, *};
use meniscus::{math::Vec3, mesh::Mesh};

/// A cloth of two materials that falls onto a ball, and a flag on a pole that moves; coarse.
pub(crate) const CLOTH: &str = r#"
title = "Small cloth"
frames = "1-9"

[[world.collider]]
shape = { sphere = { center = [0, 0, 0], radius = 0.2 } }

[[sheet]]
name = "cloth"
shape = { grid = { origin = [-0.3, -0.3, 0.22], first = [0.6, 0, 0], second = [0, 0.6, 0], cells = [12, 12] } }
density = 0.2
stiffness = [60, 60]
shear = 10
bending = 1e-5
damping = 1
region = [{ shape = { box = { min = [-1, -1, 0], max = [0, 1, 1] } }, stiffness = 2 }]

[[sheet]]
name = "flag"
shape = { mesh = { file = "flag.obj" } }
density = 0.1
stiffness = [40, 40]
pin = [{ at = { points = [0, 3] }, keyframes = [{ frame = 1, position = [0, 0, 0] }, { frame = 9, position = [0.2, 0, 0] }] }]

[sheets]
friction = 0.3
repulsion = { energy = 0.05, range = "4 mm" }

[output]
sheet = ["pc2"]
"#;

/// A quad and a triangle.
pub(crate) const FLAG: &str =
    "v 1 0 0\nv 1.4 0 0\nv 1.4 0 0.3\nv 1 0 0.3\nv 1.7 0 0.15\nf 1 2 3 4\nf 2 5 3\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.write("cloth.toml", CLOTH);
    desk.write("flag.obj", FLAG);
    desk
}

/// The samples of a point cache.
pub(crate) fn samples(path: &Path) -> Vec<Vec<[f32; 3]>> {
    let bytes = fs::read(path).unwrap();
    let whole = |at: usize| i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let number = |i: usize| f32::from_le_bytes(bytes[32 + 4 * i..36 + 4 * i].try_into().unwrap());
    let (points, count) = (whole(16), whole(28));
    assert_eq!(bytes.len(), 32 + 12 * points * count);
    let point = |i: usize| [0, 1, 2].map(|k| number(3 * i + k));
    (0..count).map(|s| (0..points).map(|i| point(s * points + i)).collect()).collect()
}

#[test]
fn one_command_goes_from_sheets_to_point_caches() {
    let desk = desk();
    let (out, talk) = desk.run("shot cloth.toml -o shot", 0);
    assert!(out.contains("2 sheets of 9 frames written") && talk.contains("strain at most"), "{out}{talk}");
    assert_eq!(desk.names("shot/sheet"), ["cloth.pc2", "cloth.ply", "flag.pc2", "flag.ply"]);
    let cloth = samples(&desk.path("shot/sheet/cloth.pc2"));
    assert_eq!((cloth.len(), cloth[0].len(), cloth[0][0]), (9, 169, [-0.3, -0.3, 0.22]));
    // It falls, and the ball supports its middle; no point is inside.
    assert!(cloth[8][0][2] < 0.1 && cloth[8][84][2] > 0.199, "{:?}", cloth[8]);
    let depth = |x: &[f32; 3]| 0.2 - x.iter().map(|c| c * c).sum::<f32>().sqrt();
    assert!(cloth.iter().flatten().all(|x| depth(x) < 1e-5));
    // Half of it is twice as stiff, so the other half hangs lower.
    assert!(cloth[8][12 * 13 + 12][2] < cloth[8][12 * 13][2] - 1e-3);
    let flag = samples(&desk.path("shot/sheet/flag.pc2"));
    assert!((flag[8][0][0] - 1.2).abs() < 1e-5 && flag[8][4][2] < 0.1, "{:?}", flag[8]);
    let text = fs::read_to_string(desk.path("shot/shot.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&text).unwrap();
    let output = &manifest["outputs"][0];
    assert_eq!((output["kind"].as_str(), output["format"].as_str()), (Some("sheet"), Some("pc2")));
    assert_eq!(
        (output["pattern"].as_str(), output["rest"].as_str()),
        (Some("sheet/cloth.pc2"), Some("sheet/cloth.ply"))
    );
    assert_eq!(output["frames"], serde_json::json!({ "first": 1, "last": 9, "step": 1 }));

    // Existing frames are kept, another selection is written anew, and sheets are not meshed as a liquid.
    let again = desk.run("shot cloth.toml -o shot", 0).0;
    assert!(
        again.contains("9 up to date")
            && again.contains("0 sheets of 9 frames written")
            && again.contains("2 up to date"),
        "{again}"
    );
    let few = desk.run("export shot --frames 1-9x2", 0).0;
    assert!(few.contains("2 sheets of 5 frames written"), "{few}");
    assert_eq!(samples(&desk.path("shot/sheet/cloth.pc2"))[1], cloth[2]);
    let none = desk.run("mesh shot", 2).1;
    assert!(none.contains("no particles in this cache"), "{none}");
    let message = desk.run("info shot", 0).0;
    assert!(message.contains("sheet/cloth.pc2"), "{message}");
}

#[test]
fn a_resumed_shot_has_the_same_bytes_and_any_number_of_threads() {
    let desk = desk();
    desk.run("simulate cloth.toml -o whole --threads 1", 0);
    desk.run("simulate cloth.toml -o parts --frames 1-4 --threads 3", 0);
    desk.run("simulate cloth.toml -o parts --threads 2", 0);
    for frame in [1, 4, 5, 9] {
        let name = format!("cache/frame_{frame:04}.mcf");
        let read = |folder: &str| fs::read(desk.path(folder).join(&name)).unwrap();
        assert!(read("whole") == read("parts"), "frame {frame}");
    }
}

#[test]
fn meshes_a_frame_have_velocities_and_a_thickness() {
    let desk = desk();
    desk.run("simulate cloth.toml -o shot --frames 1-3", 0);
    let out = desk.run("export shot --format ply,pc2 --thickness 0.01", 0).0;
    assert!(out.contains("6 frames meshed") && out.contains("2 sheets of 3 frames written"), "{out}");
    let text = fs::read(desk.path("shot/sheet/cloth_0002.ply")).unwrap();
    let head = String::from_utf8_lossy(&text[..600]).into_owned();
    // Two sides of 169 points, 288 triangles each, and two along each of 48 edges.
    assert!(
        head.contains("element vertex 338") && head.contains("element face 672") && head.contains("vz"),
        "{head}"
    );
    assert_eq!(samples(&desk.path("shot/sheet/cloth.pc2"))[0].len(), 338);
    let thin = desk.run("export shot --format obj", 0).0;
    assert!(thin.contains("6 frames meshed"), "{thin}");
    assert!(fs::read_to_string(desk.path("shot/sheet/flag_0003.obj")).unwrap().contains("f "));
}

/// Asserts that each point has the unit normal of the faces around it.
fn assert_normals(path: &Path) -> Mesh {
    let mesh = read_ply(path);
    assert_eq!(mesh.normals.len(), mesh.positions.len(), "{}", path.display());
    let mut sums = vec![Vec3::zeros(); mesh.positions.len()];
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|i| mesh.positions[i as usize]);
        corners.iter().for_each(|&i| sums[i as usize] += (b - a).cross(&(c - a)));
    }
    for (n, sum) in mesh.normals.iter().zip(sums) {
        assert!((n - sum.normalize()).norm() < 1e-3, "{}: {n:?} {sum:?}", path.display());
    }
    mesh
}

#[test]
fn written_sheets_have_the_normals_of_their_faces() {
    let desk = desk();
    desk.run("shot cloth.toml -o shot", 0);
    // At the start it is level, and its normals point up.
    let rest = assert_normals(&desk.path("shot/sheet/cloth.ply"));
    assert!(rest.normals.iter().all(|n| (n - Vec3::z()).norm() < 1e-6));
    desk.run("export shot --format ply", 0);
    for sheet in ["cloth", "flag"] {
        assert_normals(&desk.path(&format!("shot/sheet/{sheet}_0009.ply")));
    }
    // As a shell of 1 cm: one side points up, the other down.
    desk.run("export shot --format ply --thickness 0.01", 0);
    let mesh = assert_normals(&desk.path("shot/sheet/cloth_0001.ply"));
    let level = mesh.normals.iter().map(|n| n.z).filter(|z| z.abs() > 0.99);
    let (up, down): (Vec<f32>, Vec<f32>) = level.partition(|&z| z > 0.0);
    assert!(up.len() > 100 && up.len() == down.len(), "{} {}", up.len(), down.len());
}

/// Vertex properties of a file reach the simulation: a half with shorter rest lengths contracts.
#[test]
fn vertex_properties_of_a_file_shape_its_sheet() {
    let desk = Desk::new();
    let (columns, h) = (10_u32, 0.1_f32);
    let rest = |i: u32| if i < 5 { 0.8_f32 } else { 1.0 };
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float rest\nproperty float stiffness\nproperty float damping\nelement face {columns}\n\
         property list uchar int vertex_indices\nend_header\n",
        2 * (columns + 1)
    );
    for (j, i) in (0..2).flat_map(|j| (0..=columns).map(move |i| (j, i))) {
        text += &format!("{} {} 0 {} {} {}\n", h * i as f32, h * j as f32, rest(i), 1 + i, 1 + i % 2);
    }
    for i in 0..columns {
        text += &format!("4 {i} {} {} {}\n", i + 1, i + columns + 2, i + columns + 1);
    }
    desk.write("hem.ply", text);
    desk.write(
        "hem.toml",
        "title = \"Hem\"\nframes = \"1-100\"\n[world]\ngravity = [0, 0, 0]\n[[sheet]]\nname = \"hem\"\n\
         shape = { mesh = { file = \"hem.ply\" } }\ndensity = 0.2\nstiffness = [30, 0]\ndamping = 6\n\
         [sheets.solver]\nintegrator = \"implicit\"\ntolerance = 1e-6\n[output]\nsheet = [\"pc2\"]\n",
    );
    desk.run("shot hem.toml -o hem", 0);
    let last = samples(&desk.path("hem/sheet/hem.pc2")).pop().unwrap();
    for i in 0..columns as usize {
        let expected = h * 0.5 * (rest(i as u32) + rest(i as u32 + 1));
        for row in [0, columns as usize + 1] {
            let found = last[row + i + 1][0] - last[row + i][0];
            assert!((found - expected).abs() < 1e-4, "{row} {i}: {found} {expected}");
        }
    }
    let log = fs::read_to_string(desk.path("hem/log.jsonl")).unwrap();
    assert!(log.lines().count() == 99 && log.contains("\"elastic_energy\""));
}

#[test]
fn invalid_sheet_meshes_are_refused_with_the_reason() {
    let desk = desk();
    for (file, message) in [
        (FLAG.replace("v 1.4 0 0\n", "v 1 0 0\n"), "an edge without length at point 0"),
        (FLAG.replace("f 2 5 3\n", ""), "no face at point 4"),
        (FLAG.replace("f 2 5 3\n", "f 2 5 5\n"), "an edge without length at point 4"),
        (FLAG.replace("v 1.7 0 0.15", "v 1.7 nan 0.15"), "vertex 4"),
    ] {
        assert_ne!(file, FLAG);
        desk.write("flag.obj", &file);
        let output = desk.tool("simulate cloth.toml -o wrong").output().unwrap();
        let talk = String::from_utf8_lossy(&output.stderr);
        println!("{:?} {talk}", output.status.code());
        assert!(!output.status.success() && talk.contains(message), "{message}: {talk}");
        assert!(!desk.path("wrong/cache/frame_0002.mcf").exists());
    }
}

#[test]
fn a_diverged_sheet_ends_the_shot_with_its_own_exit_code_and_is_named() {
    let desk = desk();
    // The second sheet needs more substeps than are allowed.
    desk.write("stiff.toml", CLOTH.replace("stiffness = [40, 40]", "stiffness = [4e12, 4e12]"));
    let talk = desk.run("simulate stiff.toml -o stiff", 20).1;
    assert!(
        talk.contains("frame 0002")
            && talk.contains("sheet 'flag'")
            && talk.contains("sheets.solver.max_substeps"),
        "{talk}"
    );
    assert!(desk.path("stiff/cache/frame_0001.mcf").exists(), "earlier frames stay");
    // A pin moves so fast that no number of substeps suffices next to a solid.
    desk.write("far.toml", CLOTH.replace("position = [0.2, 0, 0]", "position = [9e9, 0, 0]"));
    let talk = desk.run("simulate far.toml -o far", 20).1;
    assert!(talk.contains("sheet 'flag'") && talk.contains("to not pass through solids"), "{talk}");
}

#[test]
fn a_damaged_frame_is_named_and_the_frame_before_replaces_it() {
    let desk = desk();
    desk.run("simulate cloth.toml -o shot --frames 1-5", 0);
    let path = desk.path("shot/cache/frame_0003.mcf");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).unwrap();
    let talk = desk.run("export shot", 12).1;
    assert!(talk.contains("frame 0003") && talk.contains("before it stands in its place"), "{talk}");
    let cloth = samples(&desk.path("shot/sheet/cloth.pc2"));
    assert!(cloth.len() == 5 && cloth[2] == cloth[1] && cloth[3] != cloth[2]);
}

#[test]
fn errors_in_sheet_parameters_name_their_key() {
    let desk = desk();
    for (from, to, message) in [
        ("name = \"flag\"", "name = \"cloth\"", "sheet.1.name"),
        ("name = \"flag\"", "name = \"a b\"", "cannot be the name of a file"),
        ("stiffness = [60, 60]", "stiffness = [60, -1]", "sheet.0.stiffness"),
        ("flag.obj", "gone.obj", "the mesh `gone.obj` is not there"),
        ("cells = [12, 12]", "cels = [12, 12]", "cells"),
        ("friction = 0.3", "frictoin = 0.3", "friction"),
        ("second = [0, 0.6, 0]", "second = [0.6, 0, 0]", "has no area"),
    ] {
        let text = CLOTH.replace(from, to);
        assert_ne!(text, CLOTH, "{from}");
        desk.write("wrong.toml", &text);
        let talk = desk.run("simulate wrong.toml -o wrong", 2).1;
        assert!(talk.contains(message), "{to}: {talk}");
        assert!(!desk.path("wrong/cache/frame_0002.mcf").exists());
    }
}

#[test]
fn only_the_passes_of_present_systems_are_listed() {
    let desk = desk();
    let cloth = desk.run("shot cloth.toml --dry-run", 0).0;
    assert!(
        cloth.contains("sheet_step, sheet_solids, sheet_account") && cloth.contains("174 points"),
        "{cloth}"
    );
    let falling = desk.run("shot falling-sheets --dry-run", 0).0;
    assert!(falling.contains("sheet_solids, sheet_search, sheet_contact, sheet_account"), "{falling}");
    let dam = desk.run("shot small.toml --dry-run", 0).0;
    assert!(!dam.contains("sheet"), "{dam}");
    let plan = desk.run("plan cloth.toml", 0).0;
    assert!(plan.contains("174 points") && plan.contains("sheets: about"), "{plan}");
}

#[test]
fn outputs_that_a_shot_cannot_have_are_refused_before_it_is_simulated() {
    let desk = desk();
    for (output, message) in [
        ("mesh = [\"ply\"]", "`output.mesh` needs particles"),
        ("volume = [\"density\"]", "`output.volume` needs particles or tracers"),
    ] {
        desk.write("wrong.toml", CLOTH.replace("sheet = [\"pc2\"]", output));
        let talk = desk.run("shot wrong.toml -o wrong", 2).1;
        assert!(talk.contains(message) && talk.contains("[output]"), "{talk}");
    }
    desk.write("wrong.toml", SMALL.replace("mesh = [\"ply\"]", "sheet = [\"pc2\"]"));
    let talk = desk.run("shot wrong.toml -o wrong", 2).1;
    assert!(talk.contains("`output.sheet` needs sheets"), "{talk}");
    assert!(!desk.path("wrong/cache").exists());
}
