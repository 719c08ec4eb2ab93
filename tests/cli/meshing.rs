//! Meshes of caches and of other solvers' particle files.

use super::*;
use meniscus::{math::Vec3, mesh, mesh::Mesh};
use ply_rs_bw::{
    parser::Parser,
    ply::{DefaultElement, Property},
};

/// A ball of particles on a seeding lattice.
pub(super) fn ball(spacing: f32, radius: f32, center: [f32; 3]) -> Vec<[f32; 3]> {
    let n = (radius / spacing).ceil() as i32;
    let axis = || -n..=n;
    let points = axis().flat_map(|i| axis().flat_map(move |j| axis().map(move |k| [i, j, k])));
    points
        .map(|point| point.map(|v| v as f32 * spacing))
        .filter(|p| p.iter().map(|v| v * v).sum::<f32>() < radius * radius)
        .map(|p| [p[0] + center[0], p[1] + center[1], p[2] + center[2]])
        .collect()
}

pub(super) fn xyz(points: &[[f32; 3]]) -> String {
    points.iter().map(|[x, y, z]| format!("{x} {y} {z}\n")).collect()
}

/// Legacy VTK as SPlisHSPlasH writes it: binary, big-endian.
pub(super) fn vtk(points: &[[f32; 3]]) -> Vec<u8> {
    let mut file = b"# vtk DataFile Version 4.1\nparticles\nBINARY\nDATASET UNSTRUCTURED_GRID\n".to_vec();
    file.extend(format!("POINTS {} float\n", points.len()).bytes());
    file.extend(points.iter().flatten().flat_map(|v| v.to_be_bytes()));
    file.extend(format!("\nCELLS {} {}\n", points.len(), 2 * points.len()).bytes());
    file.extend((0..points.len() as i32).flat_map(|i| [1, i]).flat_map(i32::to_be_bytes));
    file.extend(format!("\nCELL_TYPES {}\n", points.len()).bytes());
    file.extend(points.iter().flat_map(|_| 1_i32.to_be_bytes()));
    file
}

/// Positions, normals if it has any, and triangles of a PLY file, read by the library's own generic reader. Positions in double
/// precision are relative to the first vertex.
pub(crate) fn read_ply(path: &Path) -> Mesh {
    let ply = Parser::<DefaultElement>::new().read_ply(&mut fs::File::open(path).unwrap()).unwrap();
    let coordinate = |vertex: &DefaultElement, name: &str| match vertex[name] {
        Property::Float(value) => f64::from(value),
        Property::Double(value) => value,
        ref other => panic!("{name} is {other:?}"),
    };
    let corners = |face: &DefaultElement| match &face["vertex_indices"] {
        Property::ListUInt(list) => <[u32; 3]>::try_from(list.as_slice()).unwrap(),
        Property::ListInt(list) => <[i32; 3]>::try_from(list.as_slice()).unwrap().map(|v| v as u32),
        other => panic!("vertex_indices is {other:?}"),
    };
    let vertices = &ply.payload["vertex"];
    let is_double = |v: &DefaultElement| matches!(v["x"], Property::Double(_));
    let first = vertices.first().filter(|v| is_double(v));
    let origin = first.map_or([0.0; 3], |v| ["x", "y", "z"].map(|axis| coordinate(v, axis)));
    let vectors = |axes: [&str; 3], origin: [f64; 3]| -> Vec<Vec3> {
        let place = |v| [0, 1, 2].map(|axis| (coordinate(v, axes[axis]) - origin[axis]) as f32);
        vertices.iter().map(|v| Vec3::from(place(v))).collect()
    };
    let has_normals = vertices.first().is_some_and(|v| v.contains_key("nx"));
    Mesh {
        positions: vectors(["x", "y", "z"], origin),
        normals: if has_normals { vectors(["nx", "ny", "nz"], [0.0; 3]) } else { Vec::new() },
        triangles: ply.payload["face"].iter().map(corners).collect(),
        ..Mesh::default()
    }
}

#[test]
fn particle_files_become_closed_meshes() {
    let desk = Desk::new();
    let points = ball(0.1, 0.5, [3.0, -2.0, 1.0]);
    desk.write("ball.xyz", xyz(&points));
    desk.write("ball.vtk", vtk(&points));
    for file in ["ball.xyz", "ball.vtk"] {
        let (out, _) = desk.run(&format!("mesh {file} --spacing 0.1 -o {file}.out --format ply,obj"), 0);
        assert!(out.contains("1 frames meshed"), "{out}");
        assert_eq!(desk.names(&format!("{file}.out/mesh")).len(), 2);
    }
    // Of what file a mesh was made stands in its key, and nowhere else.
    let ply = |file: &str| {
        let mut bytes = fs::read(desk.path(&format!("{file}.out/mesh/particles_0001.ply"))).unwrap();
        let key = bytes.windows(13).position(|window| window == b"meniscus key ").unwrap() + 13;
        bytes.drain(key..key + 16);
        bytes
    };
    assert!(ply("ball.xyz") == ply("ball.vtk"), "the same particles give the same bytes");
    let check = mesh::check(&read_ply(&desk.path("ball.xyz.out/mesh/particles_0001.ply")));
    assert!(check.is_sound() && check.components == 1, "{check:?}");
    let exact = points.len() as f64 * 1e-3;
    assert!((check.volume / exact - 1.0).abs() < 0.1, "volume {} of {exact}", check.volume);
}

#[test]
fn sequences_keep_their_numbers() {
    let desk = Desk::new();
    for frame in [3, 4, 10] {
        desk.write(&format!("splash_{frame}.xyz"), xyz(&ball(0.1, 0.3, [0.1 * frame as f32, 0.0, 0.0])));
    }
    let (_, talk) = desk.run("mesh splash_*.xyz --spacing 0.1 -o out", 0);
    assert_eq!(
        desk.names("out/mesh"),
        ["particles_0003.ply", "particles_0004.ply", "particles_0010.ply"],
        "{talk}"
    );
}

#[test]
fn a_cache_is_meshed_again_only_where_requested() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("mesh small --frames 2-3", 0);
    assert_eq!(desk.names("small/mesh"), ["liquid_0002.ply", "liquid_0003.ply"]);
    let (out, _) = desk.run("mesh small", 0);
    assert!(out.contains("3 frames meshed") && out.contains("2 up to date"), "{out}");
    let (out, _) = desk.run("mesh small/cache -o elsewhere --voxel 0.8 --format obj", 0);
    assert!(out.contains("5 frames meshed"), "{out}");
    assert!(desk.path("elsewhere/shot.json").exists());
    let (_, talk) = desk.run("mesh small --frames 5-7", 3);
    assert!(talk.contains("frame 0006") && talk.contains("frame 0007"), "{talk}");
    desk.run("mesh small --spacing 0.1", 2);
}

#[test]
fn clean_up_runs_where_its_table_is_and_nowhere_else() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("mesh small --frames 2", 0);
    let plain = fs::read(desk.path("small/mesh/liquid_0002.ply")).unwrap();

    // Small components go to a file of points that the manifest names, with every requested attribute.
    let all = "--set surface.components.smallest=3 --set surface.smoothing={} --set surface.decimation.fraction=0.25 \
               --set surface.attributes=[\"velocity\",\"id\"]";
    let (out, _) = desk.run(&format!("mesh small -o clean {all}"), 0);
    assert!(out.contains("5 frames meshed"), "{out}");
    let names = desk.names("clean/mesh");
    assert!(names.len() == 10 && names.contains(&"liquid_points_0005.ply".to_owned()), "{names:?}");
    let manifest: serde_json::Value =
        serde_json::from_slice(&fs::read(desk.path("clean/shot.json")).unwrap()).unwrap();
    let [mesh, points] = [0, 1].map(|i| &manifest["outputs"][i]);
    assert_eq!((&mesh["kind"], &points["kind"]), (&"mesh".into(), &"points".into()));
    assert_eq!(mesh["attributes"]["id"], serde_json::json!(["id"]));
    assert_eq!(points["attributes"]["radius"], serde_json::json!(["radius"]));
    let cleaned = fs::read(desk.path("clean/mesh/liquid_0002.ply")).unwrap();
    assert!(cleaned.len() < plain.len() / 2);
    assert!(String::from_utf8_lossy(&cleaned[..500]).contains("property uint id"));

    // The same again is there; without the points it is not.
    let (out, _) = desk.run(&format!("mesh small -o clean {all}"), 0);
    assert!(out.contains("0 frames meshed"), "{out}");
    fs::remove_file(desk.path("clean/mesh/liquid_points_0003.ply")).unwrap();
    let (out, _) = desk.run(&format!("mesh small -o clean {all}"), 0);
    assert!(out.contains("1 frames meshed"), "{out}");
    // What files carry stands in them, should the manifest be gone.
    fs::remove_file(desk.path("clean/shot.json")).unwrap();
    assert!(desk.run(&format!("mesh small -o clean {all}"), 0).0.contains("0 frames meshed"));
    let again: serde_json::Value =
        serde_json::from_slice(&fs::read(desk.path("clean/shot.json")).unwrap()).unwrap();
    for (old, new) in [(mesh, &again["outputs"][0]), (points, &again["outputs"][1])] {
        assert_eq!(old["attributes"], new["attributes"]);
        assert!(new["attributes"]["velocity"].is_array(), "{new}");
    }
    desk.run("mesh small -o clean", 0);
    assert_eq!(fs::read(desk.path("clean/mesh/liquid_0002.ply")).unwrap(), plain);
    // The points that are in the meshes again are no longer named.
    let outputs = || -> Vec<[String; 2]> {
        let text = fs::read(desk.path("clean/shot.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let outputs = manifest["outputs"].as_array().unwrap();
        outputs
            .iter()
            .map(|output| ["kind", "format"].map(|key| output[key].as_str().unwrap().to_owned()))
            .collect()
    };
    let named = |pairs: &[[&str; 2]]| pairs.iter().map(|pair| pair.map(String::from)).collect::<Vec<_>>();
    assert_eq!(outputs(), named(&[["mesh", "ply"]]));
    // A format is named as long as it shows the same surface as the others.
    desk.run("mesh small -o clean --format obj", 0);
    assert_eq!(outputs(), named(&[["mesh", "ply"], ["mesh", "obj"]]));
    desk.run("mesh small -o clean --frames 3 --voxel 0.8", 0);
    assert_eq!(outputs(), named(&[["mesh", "ply"]]));
    // Also where all of its own frames are there already.
    desk.run("mesh small -o clean --format obj --voxel 0.9", 0);
    assert_eq!(outputs(), named(&[["mesh", "obj"]]));
    assert!(desk.run("mesh small -o clean --frames 1,2", 0).0.contains("0 frames meshed"));
    assert_eq!(outputs(), named(&[["mesh", "ply"]]));

    // Attributes that particles do not have are reported with those that they have.
    let (_, talk) = desk.run("mesh small --frames 2 --force --set surface.attributes=[\"heat\"]", 3);
    assert!(talk.contains("`heat`") && talk.contains("velocity"), "{talk}");
}

#[test]
fn a_mesh_that_pops_is_reported() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    let (out, _) = desk.run("mesh small", 0);
    assert!(!out.contains("jump"), "{out}");
    // One frame of another voxel stands out from the others.
    let (out, _) = desk.run("mesh small --frames 3 --voxel 2 --force", 0);
    assert!(out.contains("jump: frame 0003 of liquid: volume goes from"), "{out}");
    let (out, _) = desk.run("info small", 0);
    assert!(out.contains("m³ of 5 meshes") && out.contains("jump       frame 0004 of liquid"), "{out}");
    let (out, _) = desk.run("info small --json", 0);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(info["meshes"].as_array().unwrap().len(), 5);
    assert_eq!(info["jumps"][0]["frame"], 3);
    // Made as the others, it does not.
    let (out, _) = desk.run("mesh small", 0);
    assert!(!out.contains("jump") && !desk.run("info small", 0).0.contains("jump"), "{out}");
}

/// The same particles as a block, but for one frame as a sheet: more area than the frames around suggest.
#[test]
fn an_area_that_jumps_is_reported() {
    let desk = Desk::new();
    let [block, sheet] = [[6, 6, 6], [18, 12, 1]].map(|[nx, ny, nz]: [i32; 3]| -> Vec<[f32; 3]> {
        let place = |i: i32| [i % nx, i / nx % ny, i / (nx * ny)].map(|i| 0.1 * i as f32);
        (0..nx * ny * nz).map(place).collect()
    });
    for frame in 1..=9 {
        let drift = 0.003 * frame as f32;
        let points = if frame == 5 { &sheet } else { &block };
        let moved: Vec<[f32; 3]> = points.iter().map(|&[x, y, z]| [x + drift, y, z]).collect();
        desk.write(&format!("block_{frame}.xyz"), xyz(&moved));
    }
    let (out, _) = desk.run("mesh block_#.xyz --spacing 0.1 -o out", 0);
    assert!(out.contains("of particles: area goes from"), "{out}");
    let (out, _) = desk.run("info out --json", 0);
    let info: serde_json::Value = serde_json::from_str(&out).unwrap();
    let is_area = |jump: &&serde_json::Value| jump["what"] == "area" && jump["frame"] == 5;
    let jump = info["jumps"].as_array().unwrap().iter().find(is_area).expect("the area of frame 5 jumps");
    for (key, frame) in [("before", 4), ("after", 5)] {
        let mesh = read_ply(&desk.path(&format!("out/mesh/particles_000{frame}.ply")));
        let area = mesh::check(&mesh).area;
        assert!((jump[key].as_f64().unwrap() / area - 1.0).abs() < 1e-6, "{jump} {area}");
    }
}

#[test]
fn a_lone_particle_becomes_a_point_in_its_file() {
    let desk = Desk::new();
    let lone = [2.0, -1.0, 0.5];
    let mut points = ball(0.1, 0.5, [0.0; 3]);
    points.push(lone);
    desk.write("ball.xyz", xyz(&points));
    desk.run("mesh ball.xyz --spacing 0.1 -o out --set surface.components.smallest=4", 0);
    let names = desk.names("out/mesh");
    let file = names.iter().find(|name| name.contains("points")).expect("a file of points");
    let bytes = fs::read(desk.path(&format!("out/mesh/{file}"))).unwrap();
    let end = bytes.windows(11).position(|part| part == b"end_header\n").unwrap() + 11;
    let header = String::from_utf8_lossy(&bytes[..end]).into_owned();
    assert!(header.contains("element vertex 1\n"), "{header}");
    let floats: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    assert_eq!(floats, ["x", "y", "z", "radius"]);
    let numbers: Vec<f32> =
        bytes[end..].chunks(4).map(|number| f32::from_le_bytes(number.try_into().unwrap())).collect();
    assert_eq!(numbers.len(), 4);
    assert!(lone.iter().zip(&numbers).all(|(a, b)| (a - b).abs() < 0.02), "{numbers:?}");
    // As much as the particle's volume, or little less.
    let volume = 4.0 / 3.0 * std::f32::consts::PI * numbers[3].powi(3);
    assert!((0.3..2.0).contains(&(volume / 1e-3)), "{numbers:?}");
}

/// Frames of the first output in the manifest of `folder`: first, last, step.
fn named(desk: &Desk, folder: &str) -> [u64; 3] {
    let text = fs::read(desk.path(&format!("{folder}/shot.json"))).unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&text).unwrap();
    ["first", "last", "step"].map(|key| manifest["outputs"][0]["frames"][key].as_u64().unwrap_or_default())
}

#[test]
fn the_manifest_names_every_mesh_that_is_there_and_no_other() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("mesh small --frames 1-5x2", 0);
    assert_eq!(named(&desk, "small"), [1, 5, 2]);
    desk.run("mesh small --frames 3", 0);
    assert_eq!(named(&desk, "small"), [1, 5, 2], "meshing one frame again does not hide the others");
    desk.run("mesh small --frames 4-9", 3);
    assert_eq!(named(&desk, "small"), [1, 5, 1], "frames that failed are not named");
    desk.run("simulate small.toml --frames 2", 0);
    assert_eq!(named(&desk, "small"), [1, 5, 1]);
    let manifest = fs::read_to_string(desk.path("small/shot.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!(manifest["frames"]["last"], 5, "frames that are there stay in the range");

    // Meshes of another simulation are not those of this one.
    desk.run("simulate small.toml --set liquid.iterations=7 --force --frames 1-2", 0);
    assert_eq!(named(&desk, "small"), [0, 0, 0]);
    let (out, _) = desk.run("mesh small", 0);
    assert!(out.contains("2 frames meshed"), "{out}");
    assert_eq!(named(&desk, "small"), [1, 2, 1]);
}

#[test]
fn frames_meshed_before_an_early_end_are_named() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    // A folder in the place of the fourth file ends the job.
    fs::create_dir_all(desk.path("small/mesh/liquid_0004.ply")).unwrap();
    let (_, talk) = desk.run("mesh small --threads 2", 1);
    assert!(talk.contains("liquid_0004.ply"), "{talk}");
    assert_eq!(named(&desk, "small"), [1, 3, 1]);
}

#[test]
fn a_sequence_may_start_before_its_liquid() {
    let desk = Desk::new();
    desk.write("splash_1.vtk", vtk(&[]));
    desk.write("splash_2.vtk", vtk(&ball(0.1, 0.3, [0.0; 3])));
    let (_, talk) = desk.run("mesh splash_*.vtk --spacing 0.1 -o out", 0);
    assert!(talk.contains("splash_1.vtk: no particles"), "{talk}");
    assert_eq!(desk.names("out/mesh"), ["particles_0001.ply", "particles_0002.ply"]);
    assert!(read_ply(&desk.path("out/mesh/particles_0001.ply")).triangles.is_empty());
    assert_eq!(named(&desk, "out"), [1, 2, 1]);

    // A file that was cut off, or not written at all, is no empty frame.
    desk.write("splash_1.vtk", "");
    let (_, talk) = desk.run("mesh splash_*.vtk --spacing 0.1 -o other", 3);
    assert!(talk.contains("splash_1.vtk: found an empty file"), "{talk}");
    assert_eq!(named(&desk, "other"), [2, 2, 1]);

    // More of the sequence, later: the range grows.
    desk.write("splash_7.vtk", vtk(&ball(0.1, 0.3, [0.0; 3])));
    desk.run("mesh splash_2.vtk splash_7.vtk --spacing 0.1 -o other --fps 30", 0);
    let manifest = fs::read_to_string(desk.path("other/shot.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_str(&manifest).unwrap();
    assert_eq!((&manifest["frames"]["last"], &manifest["fps"]), (&7.into(), &30.0.into()));
}

#[test]
fn two_processes_do_not_write_the_same_meshes() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    let lock = meniscus::cache::Lock::acquire(&desk.path("small/mesh")).unwrap();
    let under_way = desk.path("small/mesh/.liquid_0001.ply.1-0.meniscus-tmp");
    fs::write(&under_way, "").unwrap();
    let (_, talk) = desk.run("mesh small --wait 1", 11);
    assert!(talk.contains(&shown("small/mesh")), "{talk}");
    assert!(under_way.exists(), "the other process is still writing it");
    drop(lock);
    desk.run("mesh small", 0);
    assert!(!under_way.exists());
}

#[test]
fn settings_that_change_no_mesh_are_refused() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    for line in ["--set liquid.spacing=0.2", "--fps 30"] {
        let (_, talk) = desk.run(&format!("mesh small {line}"), 2);
        assert!(talk.contains(line.split(['=', ' ']).next().unwrap()), "{talk}");
    }
    desk.run("mesh small --set surface.voxel=0.8", 0);
}
