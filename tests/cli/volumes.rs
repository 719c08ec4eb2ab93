//! Volume files of caches and of other solvers' particle files.

use super::{surfacing::ISOTROPIC, *};
use meniscus::{
    export::vdb,
    grid::{BRICK_NODES, Bricks},
};
use std::collections::BTreeMap;

/// The active nodes of a float grid and their values, read by another library.
fn grid(path: &Path, name: &str) -> BTreeMap<[i32; 3], f32> {
    let mut reader = vdb_rs::VdbReader::new(fs::File::open(path).unwrap()).unwrap();
    let grid = reader.read_grid::<f32>(name).unwrap();
    grid.iter().map(|(at, value, _)| ([at.x as i32, at.y as i32, at.z as i32], value)).collect()
}

/// The names of the grids in a file.
fn grids(path: &Path) -> Vec<String> {
    let mut names = vdb_rs::VdbReader::new(fs::File::open(path).unwrap())
        .unwrap()
        .grid_descriptors
        .into_keys()
        .collect::<Vec<_>>();
    names.sort();
    names
}

fn manifest(desk: &Desk, folder: &str) -> serde_json::Value {
    serde_json::from_slice(&fs::read(desk.path(&format!("{folder}/shot.json"))).unwrap()).unwrap()
}

/// A cube of particles on a seeding lattice, half a spacing inside the box from 0 to 1 m.
fn cube() -> String {
    (0..1000)
        .map(|i| [i % 10, i / 10 % 10, i / 100].map(|v| 0.05 + 0.1 * v as f32))
        .map(|[x, y, z]| format!("{x} {y} {z}\n"))
        .collect()
}

#[test]
fn a_cube_of_particles_becomes_fog_and_a_level_set() {
    let desk = Desk::new();
    desk.write("cube.xyz", cube());
    let line = "volume cube.xyz --spacing 0.1 -o out --precision float --fps 30";
    let (out, talk) = desk.run(line, 0);
    assert!(out.contains("1 volumes written") && talk.contains("no velocities"), "{out}{talk}");
    let path = desk.path("out/volume/particles_0001.vdb");
    assert_eq!(grids(&path), ["density", "surface"]);

    // The fog holds as much as the particles do, and more where they lack neighbours.
    let fog = grid(&path, "density");
    let voxel = 0.05_f32;
    let held: f64 = fog.values().map(|&v| f64::from(v) * f64::from(voxel).powi(3)).sum();
    assert!((1.0..1.12).contains(&held), "{held} m³");
    assert!(fog.values().all(|&v| v > 0.0 && v <= 1.0) && fog.values().any(|&v| v < 0.05));
    assert!((fog[&[10, 10, 10]] - 1.0).abs() < 0.05);

    // The distance is that to the box, which the particles fill.
    let distance = grid(&path, "surface");
    let worst = (-2..=2).map(|k| (distance[&[10, 10, k]] + voxel * k as f32).abs()).fold(0.0, f32::max);
    assert!(worst < 0.2 * voxel, "off by {worst} m");
    assert!(distance.values().all(|v| v.abs() < 3.0 * voxel && v.is_finite()));

    // A wider band reaches farther, and the order shows out there and not at the surface.
    let far = |order: &str| {
        desk.run(
            &format!("{line} --force --set surface.distance.band=7 --set surface.distance.order={order}"),
            0,
        );
        let wide = grid(&path, "surface");
        let farthest = wide.values().fold(0.0_f32, |most, v| most.max(v.abs()));
        assert!((6.5 * voxel..7.0 * voxel).contains(&farthest), "{farthest}");
        wide
    };
    let (first, second) = (far("first"), far("second"));
    let differs = |near: bool| {
        let nodes = first.iter().filter(|(_, v)| (v.abs() < 0.5 * voxel) == near);
        let differences = nodes.filter_map(|(node, v)| Some((v - second.get(node)?).abs() / voxel));
        differences.fold(0.0, f32::max)
    };
    assert!(differs(true) == 0.0 && differs(false) > 0.2, "{} {}", differs(true), differs(false));
    desk.run(&format!("{line} --force"), 0);
    let output = &manifest(&desk, "out")["outputs"][0];
    assert_eq!((&output["kind"], &output["format"]), (&"volume".into(), &"vdb".into()));
    assert_eq!(output["grids"], serde_json::json!(["density", "surface"]));
}

#[test]
fn a_cache_becomes_volumes_only_where_requested() {
    let desk = Desk::new();
    desk.run("simulate small.toml", 0);
    desk.run("volume small --frames 2-3", 0);
    assert_eq!(desk.names("small/volume"), ["liquid_0002.vdb", "liquid_0003.vdb"]);
    assert_eq!(grids(&desk.path("small/volume/liquid_0002.vdb")), ["density", "surface", "velocity"]);
    let (out, _) = desk.run("volume small", 0);
    assert!(out.contains("3 volumes written") && out.contains("2 up to date"), "{out}");
    let (out, _) = desk.run("volume small --force", 0);
    assert!(out.contains("5 volumes written"), "{out}");
    let whole = desk.bytes("small/volume");

    // Other settings make other files, the same ones the same bytes on any number of threads.
    for change in ["--precision float", "--compression zip", "--grid surface", "--voxel 0.8"] {
        desk.run("volume small", 0);
        let (out, _) = desk.run(&format!("volume small --frames 2 {change}"), 0);
        assert!(out.contains("1 volumes written"), "{change}: {out}");
        let grids =
            if change.contains("surface") { &["surface"][..] } else { &["density", "surface", "velocity"] };
        assert_eq!(manifest(&desk, "small")["outputs"][0]["grids"], serde_json::json!(grids), "{change}");
        assert_ne!(desk.bytes("small/volume"), whole);
    }
    // The manifest lists what all of them have.
    desk.run("volume small -o some --grid surface", 0);
    desk.run("volume small -o some --frames 2", 0);
    assert_eq!(manifest(&desk, "some")["outputs"][0]["grids"], serde_json::json!(["surface"]));

    // How a mesh is cleaned up is no matter of volumes.
    desk.run("volume small", 0);
    let (out, _) = desk.run("volume small --set surface.smoothing={} --set surface.attributes=[\"id\"]", 0);
    assert!(out.contains("5 up to date"), "{out}");
    for change in ["surface.anisotropy={}", "surface.kernel_radius=1.8", "surface.distance.band=4"] {
        desk.run("volume small -o other --frames 2", 0);
        let (out, _) = desk.run(&format!("volume small -o other --frames 2 --set {change}"), 0);
        assert!(out.contains("1 volumes written"), "{change}: {out}");
    }
    desk.run("volume small/cache --threads 1 -o one", 0);
    desk.run("volume small --threads 3 -o three", 0);
    assert_eq!(desk.bytes("one/volume"), whole);
    assert_eq!(desk.bytes("three/volume"), whole);
    assert!(desk.path("three/shot.json").exists());

    // Frames that are not there are named, the others stay.
    let (_, talk) = desk.run("volume small --frames 5-7", 3);
    assert!(talk.contains("frame 0006") && talk.contains("frame 0007"), "{talk}");
    let written = manifest(&desk, "small");
    assert_eq!(written["outputs"][0]["frames"], serde_json::json!({ "first": 1, "last": 5, "step": 1 }));
}

#[test]
fn volumes_of_files_are_kept_while_their_files_are_the_same() {
    let desk = Desk::new();
    for frame in [1, 2, 5] {
        desk.write(&format!("cube_{frame}.xyz"), cube());
    }
    let line = "volume cube_#.xyz --spacing 0.1 -o out";
    let (out, talk) = desk.run(line, 0);
    assert!(out.contains("3 volumes written") && talk.contains("2 frames are missing between 1 and 5: 3-4"));
    let key =
        |frame: u32| vdb::made_from(&desk.path(&format!("out/volume/particles_{frame:04}.vdb"))).unwrap().0;
    assert_eq!(key(1), key(2));
    fs::remove_file(desk.path("out/shot.json")).unwrap();
    assert!(desk.run(line, 0).0.contains("0 volumes written"));
    assert_eq!(manifest(&desk, "out")["outputs"][0]["grids"], serde_json::json!(["density", "surface"]));
    // What only later frames have is named by a run that keeps all, too.
    desk.write("mixed_1.xyz", cube());
    let moving: String = cube().lines().map(|line| format!("{line} 1 0 0\n")).collect();
    desk.write("mixed_2.xyz", format!("x y z vx vy vz\n{moving}"));
    for written in [2, 0] {
        let (out, _) = desk.run("volume mixed_#.xyz --spacing 0.1 -o mixed", 0);
        assert!(out.contains(&format!("{written} volumes written")), "{out}");
        let named = manifest(&desk, "mixed")["outputs"][0]["grids"].clone();
        assert_eq!(named, serde_json::json!(["density", "surface", "velocity"]));
    }
    desk.write("cube_2.xyz", cube() + "0.5 0.5 0.5\n");
    assert!(desk.run(line, 0).0.contains("1 volumes written"));
    assert_ne!(key(1), key(2), "the key depends on what a volume was made of");
    assert!(desk.run(&format!("{line} --force --frames 2,5"), 0).0.contains("2 volumes written"));
    let (_, talk) = desk.run(&format!("{line} --frames 3,5"), 3);
    assert!(talk.contains("frame 0003: no file") && talk.contains("1 up to date"), "{talk}");
}

#[test]
fn requests_that_make_no_volume_are_refused() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    desk.write("cube.xyz", cube());
    for (line, code) in [
        ("volume nothing", 10),
        ("volume small --spacing 0.1", 2),
        ("volume small --set liquid.spacing=0.2", 2),
        ("volume small --precision double", 2),
        ("volume small --compression lzma", 2),
        ("volume small --grid temperature", 2),
        ("volume small --max-memory 1MiB", 33),
        ("volume cube.xyz -o out", 2),
        ("volume cube.xyz --spacing 0.1", 2),
        ("volume cube.xyz --spacing 0.1 -o out --max-memory 1MiB", 33),
        ("volume cube.xyz --spacing 0.1 -o out --grid velocity", 3),
    ] {
        desk.run(line, code);
    }
    desk.run("volume small --max-memory 1GiB", 0);
    desk.write("wild.xyz", "0 0 0\n0 nan 0\n");
    let (_, talk) = desk.run("volume wild.xyz --spacing 0.1 -o out", 1);
    assert!(talk.contains("wild.xyz") && talk.contains("particle 1"), "{talk}");
}

#[test]
fn two_processes_do_not_write_the_same_volumes() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1-2", 0);
    desk.run("volume small --frames 1", 0);
    let lock = meniscus::cache::Lock::acquire(&desk.path("small/volume")).unwrap();
    desk.run("volume small --wait 1", 11);
    drop(lock);
    desk.run("volume small", 0);
}

#[test]
fn a_shot_writes_the_volumes_that_its_preset_names() {
    let desk = Desk::new();
    let volume = "mesh = [\"ply\"]\nvolume = [\"velocity\", \"density\"]\n[volume]\nprecision = \"float\"";
    desk.write("foggy.toml", SMALL.replace("mesh = [\"ply\"]", volume));
    let (out, _) = desk.run("shot foggy.toml --frames 1-3", 0);
    assert!(out.contains("3 frames meshed") && out.contains("3 volumes written"), "{out}");
    assert_eq!(desk.names("foggy/volume").len(), 3);
    assert_eq!(grids(&desk.path("foggy/volume/liquid_0001.vdb")), ["density", "velocity"]);
    let outputs = manifest(&desk, "foggy")["outputs"].as_array().unwrap().clone();
    assert_eq!((outputs.len(), &outputs[1]["kind"]), (2, &"volume".into()));
    let (out, _) = desk.run("shot foggy.toml --frames 1-3", 0);
    assert!(out.contains("0 volumes written") && out.contains("3 up to date"), "{out}");
    let (out, _) = desk.run("info foggy", 0);
    assert!(out.contains("volume/liquid_{:04}.vdb"), "{out}");

    // The verb makes what the preset names, too.
    let (out, _) = desk.run("volume foggy", 0);
    assert!(out.contains("3 up to date"), "{out}");
    let plan = super::plan::plan(&desk, "foggy.toml --frames 1-3");
    let size: f64 = desk.bytes("foggy/volume").iter().map(|(_, bytes)| bytes.len() as f64).sum();
    let volume =
        plan["products"].as_array().unwrap().iter().find(|product| product["name"] == "volume").unwrap();
    let forecast = volume["bytes"].as_f64().unwrap();
    assert!((forecast / size - 1.0).abs() < 0.25, "forecast {forecast}, measured {size}");
    desk.run("volume foggy --grid density", 0);
    assert_eq!(grids(&desk.path("foggy/volume/liquid_0001.vdb")), ["density"]);
}

#[test]
fn level_sets_of_any_program_become_meshes() {
    let desk = Desk::new();
    desk.write("cube.xyz", cube());
    desk.run("volume cube.xyz --spacing 0.1 -o out --precision float", 0);
    fs::copy(desk.path("out/volume/particles_0001.vdb"), desk.path("ball_3.vdb")).unwrap();
    fs::copy(desk.path("out/volume/particles_0001.vdb"), desk.path("ball_5.vdb")).unwrap();
    let (out, talk) = desk.run("mesh ball_#.vdb -o meshes --format ply,obj --fps 30", 0);
    assert!(out.contains("2 frames meshed") && talk.contains("1 components"), "{out}{talk}");
    let names = ["surface_0003.obj", "surface_0003.ply", "surface_0005.obj", "surface_0005.ply"];
    assert_eq!(desk.names("meshes/mesh"), names);
    assert_eq!(manifest(&desk, "meshes")["outputs"][0]["frames"]["last"], 5);

    // The level set gives the mesh that the particles give, but for what they carry.
    desk.run(
        &format!(
            "mesh cube.xyz --spacing 0.1 -o direct --format obj --set surface.distance={{}} {ISOTROPIC}"
        ),
        0,
    );
    let faces = |path: &str| {
        let text = fs::read_to_string(desk.path(path)).unwrap();
        text.lines().filter(|line| line.starts_with(['f', 'v'])).map(String::from).collect::<Vec<_>>()
    };
    let of_particles = faces("direct/mesh/particles_0001.obj");
    assert_eq!(faces("meshes/mesh/surface_0003.obj").len(), of_particles.len());
    let vertices =
        |lines: &[String]| lines.iter().filter(|line| line.starts_with("v ")).cloned().collect::<Vec<_>>();
    let same = vertices(&faces("meshes/mesh/surface_0003.obj")) == vertices(&of_particles);
    assert!(same, "the vertices differ");

    // They are kept while their bytes are the same, whatever their time.
    let line = "mesh ball_#.vdb -o meshes --format ply,obj --threads 4";
    assert!(desk.run(line, 0).0.contains("0 frames meshed"));
    desk.run("volume cube.xyz --spacing 0.1 -o other --precision float --voxel 0.8", 0);
    fs::copy(desk.path("other/volume/particles_0001.vdb"), desk.path("ball_5.vdb")).unwrap();
    fs::copy(desk.path("out/volume/particles_0001.vdb"), desk.path("ball_3.vdb")).unwrap();
    fs::copy(desk.path("out/volume/particles_0001.vdb"), desk.path("ball_4.vdb")).unwrap();
    let (out, _) = desk.run(line, 0);
    assert!(out.contains("2 frames meshed") && out.contains("1 up to date"), "{out}");
    assert_ne!(faces("meshes/mesh/surface_0005.obj").len(), of_particles.len());
    assert!(desk.run(&format!("{line} --force --frames 3"), 0).0.contains("1 frames meshed"));
    let (out, _) = desk.run(&line.replace("-o meshes", "-o alone").replace('4', "1"), 0);
    assert!(out.contains("3 frames meshed"), "{out}");
    assert!(desk.bytes("meshes/mesh") == desk.bytes("alone/mesh"), "on four threads as on one");
    // What one may take is held against the grid that it turns out to have.
    let (_, talk) = desk.run(&format!("{line} --force --max-memory 1MiB"), 33);
    assert!(talk.contains("3 of 3 frames failed") && talk.contains("ball_4.vdb: this needs"), "{talk}");
    desk.run(&format!("{line} --max-memory 1MiB"), 0);
    fs::remove_file(desk.path("ball_4.vdb")).unwrap();
    let (_, talk) = desk.run(line, 0);
    assert!(talk.contains("1 frames are missing between 3 and 5: 4"), "{talk}");

    // One that lacks nodes at its surface is meshed, and named each time.
    let values: Vec<f32> = (0..BRICK_NODES).map(|node| (node % 8) as f32 - 3.5).collect();
    let slab = vdb::Grid {
        name: "surface",
        class: vdb::Class::LevelSet { values: &values, half_width: 4.0, inside: &[] },
        voxel: 1.0,
        bricks: &Bricks::new(vec![[0, 0, 0]]),
        active: &[[u64::MAX; BRICK_NODES / 64]],
    };
    let float = vdb::VolumeParams { precision: vdb::Precision::Float, ..Default::default() };
    vdb::write(&[slab], &desk.path("slab.vdb"), &float, 1).unwrap();
    for _ in 0..2 {
        let (_, talk) = desk.run("mesh slab.vdb -o open", 3);
        assert!(talk.contains("slab.vdb: the mesh is written, but it is open"), "{talk}");
        assert!(talk.contains("1 frames meshed"), "{talk}");
    }

    desk.run("volume cube.xyz --spacing 0.1 -o half", 0);
    let (_, talk) = desk.run("mesh half/volume/particles_0001.vdb -o other", 1);
    assert!(talk.contains("half floats"), "{talk}");
    desk.run("mesh half/volume/particles_0001.vdb ball_3.vdb -o other", 3);
    for line in
        ["mesh ball_3.vdb", "mesh ball_3.vdb cube.xyz -o other", "mesh ball_3.vdb -o other --spacing 0.1"]
    {
        desk.run(line, 2);
    }
}
