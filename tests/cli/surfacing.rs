//! What `meniscus mesh` takes: tiers of surfaces, spacings with units, tables of particles, several shots.

use super::{meshing::xyz, *};
use meniscus::{
    math::Vec3,
    mesh::{self, Mesh, surface_distance},
    solid::Shape,
};

/// A drop of particles 0.1 m apart above a sheet of one layer.
fn drop_and_sheet() -> Vec<[f32; 3]> {
    let block = (0..216).map(|i| [i % 6, i / 6 % 6, i / 36 + 4].map(|v| 0.1 * v as f32));
    let sheet = (0..100).map(|i| [i % 10, i / 10, 0].map(|v| 0.1 * v as f32));
    block.chain(sheet).collect()
}

/// The defaults of `[surface]`.
pub(super) const ISOTROPIC: &str = "--set surface.anisotropy=none --set surface.smoothing=none";

#[test]
fn tiers_are_settings_that_set_changes() {
    let desk = Desk::new();
    desk.write("drop.xyz", xyz(&drop_and_sheet()));
    let mesh = |options: &str| {
        desk.run(&format!("mesh drop.xyz --spacing 0.1 -o out --force {options}"), 0);
        fs::read(desk.path("out/mesh/particles_0001.ply")).unwrap()
    };
    // The settings are in the key that a file holds, so equal bytes are equal settings.
    let [draft, preview, last] = ["draft", "preview", "final"].map(|tier| mesh(&format!("--quality {tier}")));
    assert!(mesh("") == last, "final is the default");
    assert!(draft != preview && preview != last && draft.len() < last.len());
    assert!(mesh(&format!("{ISOTROPIC} --voxel 0.75")) == draft);
    assert!(mesh("--quality draft --set surface.smoothing={} --voxel 0.5") == preview);
    assert!(mesh("--quality preview --set surface.anisotropy={}") == last);
    assert!(mesh("--quality draft --voxel 0.5") == mesh(ISOTROPIC), "and nothing else");
}

#[test]
fn tiers_are_for_particle_files() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1", 0);
    let (_, talk) = desk.run("mesh small --quality draft", 2);
    assert!(talk.contains("--quality draft is for particle files") && talk.contains("--set"), "{talk}");
    let (_, talk) = desk.run("mesh a.xyz --spacing 0.1 -o out --quality fine", 2);
    assert!(talk.contains("draft, preview, final"), "{talk}");
}

#[test]
fn a_spacing_may_have_a_unit() {
    let desk = Desk::new();
    desk.write("drop.xyz", xyz(&drop_and_sheet()));
    let mesh = |spacing: &str| {
        let mut tool = desk.tool("mesh drop.xyz -o out --force --quality draft --spacing");
        assert!(tool.arg(spacing).output().unwrap().status.success(), "{spacing}");
        fs::read(desk.path("out/mesh/particles_0001.ply")).unwrap()
    };
    let metres = mesh("0.1");
    for text in ["10 cm", "100mm", "0.1 m"] {
        assert!(mesh(text) == metres, "{text}");
    }
    let (_, talk) = desk.run("mesh drop.xyz -o out --spacing 3kg", 2);
    assert!(talk.contains("unit of length"), "{talk}");
}

#[test]
fn tables_of_particles_are_meshed_as_the_same_particles() {
    let desk = Desk::new();
    let points = drop_and_sheet();
    desk.write("drop_1.xyz", xyz(&points));
    let rows = |separator: &str| -> String {
        let row = |[x, y, z]: &[f32; 3]| [x, y, z].map(f32::to_string).join(separator) + "\n";
        points.iter().map(row).collect()
    };
    desk.write("drop_1.csv", format!("x,y,z\n{}", rows(",")));
    desk.write("drop_1.txt", rows("\t"));
    desk.write("drop_1.tsv", rows(";"));
    let mesh = |file: &str| {
        desk.run(&format!("mesh {file} --spacing 0.1 -o {file}.out --quality draft"), 0);
        meshing::read_ply(&desk.path(&format!("{file}.out/mesh/particles_0001.ply")))
    };
    let expected = mesh("drop_1.xyz");
    assert!(expected.triangles.len() > 1000);
    for file in ["drop_1.csv", "drop_1.txt", "drop_1.tsv"] {
        let found = mesh(file);
        assert!(found.positions == expected.positions && found.triangles == expected.triangles, "{file}");
    }
    // As a sequence, and what is wrong with its place.
    desk.write("drop_2.csv", "x,y,z\n0,0,0\n0,0\n");
    let (_, talk) = desk.run("mesh drop_*.csv --spacing 0.1 -o out", 3);
    assert!(talk.contains("drop_2.csv: line 3, particle 1: found 2 columns"), "{talk}");
}

#[test]
fn several_shots_are_meshed_by_one_command_and_a_failing_one_stops_no_other() {
    let desk = Desk::new();
    for shot in ["wedge_2", "wedge_10", "alone"] {
        desk.run(&format!("simulate small.toml --frames 1-2 -o {shot}"), 0);
    }
    fs::create_dir(desk.path("wedge_notes")).unwrap();
    let meshes = |shot: &str| desk.path(&format!("{shot}/mesh/liquid_0002.ply")).exists();
    let (out, talk) = desk.run("mesh wedge_* alone ./wedge_2 --voxel 1", 0);
    assert!(["wedge_2", "wedge_10", "alone"].into_iter().all(meshes), "{out}");
    assert_eq!(out.matches("2 frames meshed").count(), 3, "each shot once\n{out}");
    let order = ["shot 1 of 3: wedge_2", "shot 2 of 3: wedge_10", "shot 3 of 3: alone"];
    let places: Vec<_> = order.iter().map(|line| talk.find(line)).collect();
    assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{talk}");
    assert!(talk.contains("wedge_*: 1 folders without a shot and 0 files are left out"), "{talk}");

    // One is damaged, one lacks a frame: the code is that of the damaged one, and the last is made.
    let frame = desk.path("wedge_2/cache/frame_0002.mcf");
    let mut bytes = fs::read(&frame).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&frame, bytes).unwrap();
    fs::remove_file(desk.path("wedge_10/cache/frame_0002.mcf")).unwrap();
    let (out, talk) = desk.run("mesh wedge_# alone --voxel 0.9 --frames 1-2", 12);
    assert!(out.contains("2 frames meshed"), "{out}");
    assert!(
        talk.contains("2 of 3 shots failed") && talk.contains("  wedge_10: 1 of 2 frames failed"),
        "{talk}"
    );
    assert!(
        talk.find("wedge_2 failed").unwrap() < talk.find("shot 2 of 3").unwrap(),
        "reported at once: {talk}"
    );
    let (_, talk) = desk.run("mesh wedge_10 alone --frames 1-2 --voxel 0.9", 3);
    assert!(talk.contains("1 of 2 shots failed"), "{talk}");
    let (_, talk) = desk.run("mesh nowhere alone", 10);
    assert!(talk.contains("  nowhere: ") && !talk.contains("  alone: "), "{talk}");
}

#[test]
fn several_shots_have_folders_of_their_own() {
    let desk = Desk::new();
    desk.run("simulate small.toml --frames 1 -o a_1", 0);
    desk.run("simulate small.toml --frames 1 -o a_2", 0);
    desk.write("a_3.xyz", "0 0 0\n");
    for (line, word) in [
        ("mesh a_1 a_2 -o out", "-o: found 2 shots"),
        ("mesh a_1 a_3.xyz", "a_3.xyz: found no shot folder among shot folders"),
        ("mesh a_1 a_2 --spacing 0.1", "--spacing is for particle files"),
    ] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains(word), "{line}: {talk}");
    }
    // A pattern with one shot is that shot; volumes take several too.
    desk.run("mesh *_1 -o out", 0);
    assert_eq!(desk.names("out/mesh"), ["liquid_0001.ply"]);
    let (out, _) = desk.run("volume a_* --grid density", 0);
    assert!(out.contains(&shown("a_1/volume")) && out.contains(&shown("a_2/volume")), "{out}");
}

#[test]
fn kernels_scale_with_the_radius_of_each_particle() {
    let desk = Desk::new();
    // Lone particles: one of half the spacing, one of twice as much, one of a quarter.
    desk.write("three.csv", "x,y,z,pscale\n0,0,0,0.05\n2,0,0,0.1\n-2,0,0,0.025\n");
    let line = "mesh three.csv --spacing 0.1 -o out --force --voxel 0.1 --set surface.smoothing=none";
    for kernels in ["none", "{}"] {
        let mesh = |more: &str| {
            let (_, talk) = desk.run(&format!("{line} --set surface.anisotropy={kernels} {more}"), 0);
            (meshing::read_ply(&desk.path("out/mesh/particles_0001.ply")), talk)
        };
        let extent = |mesh: &Mesh, at: f32| {
            let near = mesh.positions.iter().filter(|x| (x.x - at).abs() < 1.0);
            near.map(|x| (x.x - at).abs()).fold(0.0, f32::max)
        };
        // Not unless it is requested.
        let (plain, _) = mesh("");
        let radius = extent(&plain, 0.0);
        assert!((extent(&plain, 2.0) / radius - 1.0).abs() < 0.02, "{kernels}");
        let (scaled, talk) = mesh("--set surface.radius=attribute");
        for (at, factor) in [(0.0, 1.0), (2.0, 2.0), (-2.0, 0.5)] {
            assert!((extent(&scaled, at) / radius - factor).abs() < 0.05, "{kernels} {at}");
        }
        assert!(!talk.contains("radii limited"), "{talk}");
    }
}

#[test]
fn volumes_scale_with_radii_too() {
    let desk = Desk::new();
    desk.write("two.csv", "x,y,z,pscale\n0,0,0,0.05\n2,0,0,0.1\n");
    let line = "volume two.csv --spacing 0.1 -o out --grid density";
    desk.run(line, 0);
    let plain = desk.bytes("out/volume");
    let (out, _) = desk.run(&format!("{line} --set surface.radius=attribute"), 0);
    assert!(out.contains("0 up to date"), "the radius is in the key: {out}");
    assert!(desk.bytes("out/volume") != plain);
    assert!(desk.run(line, 0).0.contains("0 up to date") && desk.bytes("out/volume") == plain);
}

#[test]
fn equal_radii_are_a_larger_spacing() {
    let desk = Desk::new();
    // A cube of particles 0.1 m apart, with the radius of that, meshed as if they were 0.08 m apart.
    let points: Vec<[f32; 3]> =
        (0..1728).map(|i| [i % 12, i / 12 % 12, i / 144].map(|v| 0.1 * v as f32)).collect();
    let rows = |radius: f32| -> String {
        points.iter().map(|[x, y, z]| format!("{x},{y},{z},{radius}\n")).collect()
    };
    desk.write("cube.csv", format!("x,y,z,radius\n{}", rows(0.05)));
    desk.write("odd.csv", format!("x,y,z,radius\n{}9,9,9,0\n", rows(0.05)));
    for kernels in ["none", "{}"] {
        let volume = |options: &str, file: &str| {
            let options =
                format!("{options} --set surface.anisotropy={kernels} --set surface.smoothing=none");
            let (out, _) = desk.run(&format!("mesh {file} -o out --force {options}"), 0);
            (mesh::check(&meshing::read_ply(&desk.path("out/mesh/particles_0001.ply"))), out)
        };
        let (exact, _) = volume("--spacing 0.1 --voxel 0.4", "cube.csv");
        let (found, out) = volume("--spacing 0.08 --voxel 0.5 --set surface.radius=attribute", "cube.csv");
        assert!(found.is_sound() && found.components == 1, "{found:?}");
        assert!(
            (found.volume / exact.volume - 1.0).abs() < 1e-3,
            "{kernels}: {} {}",
            found.volume,
            exact.volume
        );
        assert!(!out.contains("volume:"), "the particles' volume is that of their radii: {out}");
    }
    // Radii out of range are limited and reported; without the attribute the frame fails.
    let (_, talk) = desk.run("mesh odd.csv --spacing 0.1 -o odd --set surface.radius=attribute", 0);
    assert!(talk.contains("1 radii limited"), "{talk}");
    desk.write("none.xyz", "0 0 0\n");
    let (_, talk) = desk.run("mesh none.xyz --spacing 0.1 -o none --set surface.radius=attribute", 3);
    assert!(talk.contains("no attribute `radius` or `pscale`"), "{talk}");
}

#[test]
fn a_surface_is_moved_by_the_offset() {
    let desk = Desk::new();
    desk.write("ball.xyz", xyz(&meshing::ball(0.1, 0.5, [0.0; 3])));
    let mesh = |options: &str| {
        let (out, _) = desk.run(&format!("mesh ball.xyz --spacing 0.1 -o out --force {options}"), 0);
        assert!(!out.contains("volume:"), "{out}");
        let mesh = meshing::read_ply(&desk.path("out/mesh/particles_0001.ply"));
        assert!(mesh::check(&mesh).is_sound(), "{options}");
        mesh
    };
    // Vertices of the moved surface are as far from the other as requested.
    for (voxel, mean_bound, largest_bound) in [(0.5, 0.025, 0.15), (0.25, 0.01, 0.07)] {
        let options = format!("{ISOTROPIC} --voxel {voxel}");
        let own = mesh(&options);
        let target = surface_distance::Target::new(&own).unwrap();
        for offset in [-1.0_f32, 0.25, 2.0] {
            let moved = mesh(&format!("{options} --set surface.offset={offset}"));
            let error = |x: &Vec3| target.nearest(*x, 0).1 / 0.1 - offset.abs();
            let errors: Vec<f32> = moved.positions.iter().map(error).collect();
            let mean = errors.iter().map(|error| error.abs()).sum::<f32>() / errors.len() as f32;
            let largest = errors.iter().fold(0.0, |largest: f32, error| largest.max(error.abs()));
            println!("{voxel} {offset}: mean {mean}, largest {largest}");
            assert!(
                mean < mean_bound && largest < largest_bound,
                "{voxel} {offset}: {mean}, {largest} spacings"
            );
        }
    }
    // Attributes are those of where the surface was: beyond the kernels they would be of the nearest particle.
    let rows: String = meshing::ball(0.1, 0.5, [0.0; 3])
        .iter()
        .map(|[x, y, z]| format!("{x},{y},{z},{}\n", x.powi(2)))
        .collect();
    desk.write("heat.csv", format!("x,y,z,heat\n{rows}"));
    let options = "--spacing 0.1 -o heat --set surface.offset=2 --set surface.attributes=[\"heat\"]";
    let (_, talk) = desk.run(&format!("mesh heat.csv {options}"), 0);
    assert!(talk.contains("frame 0001") && !talk.contains("from the nearest particle"), "{talk}");
    // Outwards is outwards, and the smoothed surface moves alike.
    let volume = |offset: &str| mesh::check(&mesh(&format!("--set surface.offset={offset}"))).volume;
    let radius = |volume: f64| (0.75 * volume / std::f64::consts::PI).cbrt() / 0.1;
    let own = radius(volume("none"));
    for offset in [-1.0, 1.0] {
        let moved = radius(volume(&offset.to_string())) - own;
        assert!((moved - offset).abs() < 0.1, "{offset}: {moved}");
    }
    let (_, talk) = desk.run("mesh ball.xyz --spacing 0.1 -o out --set surface.offset=3", 2);
    assert!(talk.contains("-2 to 2"), "{talk}");
}

#[test]
fn bounds_are_printed_without_a_mesh() {
    let desk = Desk::new();
    desk.write("ball_1.xyz", xyz(&meshing::ball(0.1, 0.5, [1.0, 0.0, 0.0])));
    desk.write("ball_2.xyz", xyz(&meshing::ball(0.1, 0.5, [3.0, 0.0, 0.0])));
    let (out, _) = desk.run("mesh ball_#.xyz --bounds", 0);
    assert!(
        out.contains("frame 0001  particles  485 particles  box (0.6, -0.4, -0.4) to (1.4, 0.4, 0.4) m"),
        "{out}"
    );
    assert!(out.contains("spacing about 0.1 m  grid by that spacing 24 × 24 × 24 of 0.05 m"), "{out}");
    assert!(out.contains("all 2: box (0.6, -0.4, -0.4) to (3.4, 0.4, 0.4) m"), "{out}");
    let (out, _) = desk.run("mesh ball_1.xyz --bounds --spacing 0.2 --voxel 1", 0);
    assert!(out.contains("grid 8 × 8 × 8 of 0.2 m") && out.contains("MiB"), "{out}");
    desk.run("simulate small.toml --frames 1-2", 0);
    let (out, _) = desk.run("mesh small --bounds", 0);
    assert!(out.contains("frame 0002  liquid  512 particles") && out.contains("grid "), "{out}");
    assert!(!desk.path("small/mesh").exists() && !desk.path("out").exists());
    // What meshing refuses is refused here too, and a grid that is not sampled is a lower bound.
    let (_, talk) = desk.run("mesh ball_#.xyz --bounds --set surface.radius=attribute", 3);
    assert!(talk.contains("no attribute `radius`"), "{talk}");
    let row: Vec<[f32; 3]> = (0..40).map(|i| [7.0 * i as f32, 0.0, 0.0]).collect();
    desk.write("row.xyz", xyz(&row));
    let (out, _) = desk.run("mesh row.xyz --bounds --spacing 1 --max-memory 60kB", 0);
    assert!(out.contains("more than"), "{out}");
    desk.write("ball_2.xyz", "0 0\n");
    let (out, talk) = desk.run("mesh ball_#.xyz --bounds", 3);
    assert!(out.contains("frame 0001") && talk.contains("frame 0002"), "{out}{talk}");
}

/// A tub of 0.6 m, half full, which moves by 0.1 m each frame.
const TUB: &str = r#"
title = "Tub"
frames = "1-3"
fps = 24

[[world.collider]]
shape = { tank = { min = [-0.3, -0.3, 0], max = [0.3, 0.3, 2] } }
keyframes = [{ frame = 1 }, { frame = 3, position = [0.2, 0, 0] }]

[liquid]
spacing = 0.1

[[liquid.source]]
shape = { box = { min = [-0.3, -0.3, 0], max = [0.3, 0.3, 0.4] } }

[surface.smoothing]

[surface.contact]

[output]
mesh = ["ply"]
"#;

/// The colliders are where they were in each frame.
#[test]
fn surfaces_are_fitted_to_the_colliders_of_a_shot() {
    let desk = Desk::new();
    desk.write("tub.toml", TUB);
    desk.run("simulate tub.toml --frames 1-3", 0);
    let mesh = |options: &str| {
        let (_, talk) = desk.run(&format!("mesh tub {options}"), 0);
        let meshes =
            [1, 3].map(|frame| meshing::read_ply(&desk.path(&format!("tub/mesh/liquid_{frame:04}.ply"))));
        (meshes, talk)
    };
    // The part of the vertices near the walls that is a tenth of a voxel or less from them.
    let part = |mesh: &Mesh, moved: f32| {
        let tub = Shape::Tank { min: [moved - 0.3, -0.3, 0.0], max: [moved + 0.3, 0.3, 2.0] };
        let distance = |x: &&Vec3| tub.signed_distance(**x).abs();
        let near = mesh.positions.iter().filter(|x| distance(x) < 0.04).count();
        let met = mesh.positions.iter().filter(|x| distance(x) < 0.005).count();
        met as f32 / near as f32
    };
    let (free, _) = mesh("--set surface.contact=none");
    let (fitted, talk) = mesh("");
    assert!(talk.contains("frame 0003"), "a mesh depends on the setting: {talk}");
    for (mesh, moved) in fitted.iter().zip([0.0, 0.2]) {
        let parts = [part(&free[usize::from(moved > 0.0)], moved), part(mesh, moved)];
        println!("moved {moved}: {parts:?}");
        assert!(parts[0] < 0.6 && parts[1] > 0.9, "{parts:?}");
    }
    let (_, talk) = mesh("");
    assert!(!talk.contains("frame 0003"), "it is kept: {talk}");
    let log = fs::read_to_string(desk.path("tub/mesh.jsonl")).unwrap();
    assert!(log.lines().last().unwrap().contains("\"contact\":{\"displaced\":"), "{log}");

    // What is compared is what is made.
    let compare = "tradeoff tub --of surface --frames 3 --vary";
    let (json, _) = desk.run(&format!("{compare} surface.contact=none,{{}} -o compared --json"), 0);
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    let volume = |label: &str| {
        let mut lines = found["lines"].as_array().unwrap().iter();
        let line = lines.find(|line| line["label"].as_str().unwrap().contains(label));
        line.unwrap_or_else(|| panic!("{found}"))["volume"].as_f64().unwrap()
    };
    let volumes = [volume("contact=none"), volume("contact={}")];
    assert!(volumes[1] > 1.01 * volumes[0], "{volumes:?}");

    // Files have no colliders.
    desk.write("drop.xyz", xyz(&drop_and_sheet()));
    let line = "tradeoff drop.xyz --spacing 0.1 --of surface --set surface.contact={} -o t";
    let (_, talk) = desk.run(line, 2);
    assert!(talk.contains("surface.contact") && talk.contains("without a preset"), "{talk}");
    let (_, talk) = desk.run("mesh drop.xyz --spacing 0.1 -o out --set surface.contact={}", 2);
    assert!(talk.contains("surface.contact") && talk.contains("the folder of a shot"), "{talk}");
    let (_, talk) = desk.run("mesh tub --set surface.contact.gap=3", 2);
    assert!(talk.contains("-1 to 1"), "{talk}");
}

#[test]
fn smoothing_is_masked_by_an_attribute() {
    let desk = Desk::new();
    let points = drop_and_sheet();
    let rows: String =
        points.iter().map(|[x, y, z]| format!("{x},{y},{z},{}\n", u8::from(*z > 0.2))).collect();
    desk.write("drop.csv", format!("x,y,z,detail\n{rows}"));
    let mesh = |options: &str| {
        desk.run(&format!("mesh drop.csv --spacing 0.1 -o out --force {options}"), 0);
        meshing::read_ply(&desk.path("out/mesh/particles_0001.ply")).positions
    };
    let (rough, smooth) = (mesh("--set surface.smoothing=none"), mesh(""));
    let masked = mesh("--set surface.smoothing.mask.attribute=detail");
    let same = |of: &[Vec3], is_sheet: bool| {
        let pairs = masked.iter().zip(of).filter(|(_, x)| (x.z < 0.15) == is_sheet);
        pairs.filter(|(a, b)| a == b).count()
    };
    let sheet = rough.iter().filter(|x| x.z < 0.15).count();
    assert_eq!(same(&rough, true), sheet, "the sheet has the attribute 0");
    assert!(same(&rough, false) < 10 && same(&smooth, false) > 100);
    let (_, talk) =
        desk.run("mesh drop.csv --spacing 0.1 -o out --set surface.smoothing.mask.attribute=foam", 3);
    assert!(talk.contains("no channel `foam`") && talk.contains("detail"), "{talk}");
}

#[test]
fn cached_frames_are_meshed_by_their_files() {
    let desk = Desk::new();
    for shot in ["one", "two"] {
        desk.run(&format!("simulate small.toml --frames 1-4 -o show/{shot}"), 0);
    }
    let names = |shot: &str| match desk.path(&format!("show/{shot}/mesh")).exists() {
        true => desk.names(&format!("show/{shot}/mesh")),
        false => Vec::new(),
    };
    desk.run("mesh show/one/cache/frame_000[23].mcf", 0);
    assert_eq!(names("one"), ["liquid_0002.ply", "liquid_0003.ply"]);
    let whole = |shot: &str| fs::read(desk.path(&format!("show/{shot}/mesh/liquid_0002.ply"))).unwrap();
    let by_file = whole("one");
    desk.run("mesh show/one --force", 0);
    assert!(by_file == whole("one"), "the settings are those of the shot");

    // Of several shots, and with a whole one among them.
    fs::remove_file(desk.path("show/one/cache/frame_0004.mcf")).unwrap();
    let (_, talk) = desk.run("mesh show/*/cache/frame_###4.mcf", 0);
    assert_eq!(names("two"), ["liquid_0004.ply"], "{talk}");
    let (_, talk) = desk.run("mesh show/two/cache/frame_0001.mcf show/one --force", 0);
    assert!(talk.contains("shot 2 of 2"), "{talk}");
    assert_eq!(names("two"), ["liquid_0001.ply", "liquid_0004.ply"]);
    desk.run("volume show/two/cache/frame_0003.mcf", 0);
    assert_eq!(desk.names("show/two/volume"), ["liquid_0003.vdb"]);

    // A shot is one however it is named, and a whole one has all frames.
    let made = |line: &str| {
        fs::remove_dir_all(desk.path("show/two/mesh")).unwrap();
        let (_, talk) = desk.run(line, 0);
        (names("two").len(), talk)
    };
    assert_eq!(made("mesh show/two/cache/frame_0001.mcf ./show/two/cache/frame_0002.mcf").0, 2);
    assert_eq!(made("mesh show/two/cache/frame_0001.mcf show/two").0, 4);
    assert_eq!(made("mesh show/../show/two show/two/cache/frame_0001.mcf").0, 4);
    fs::write(desk.path("show/two/cache/notes.mcf"), "").unwrap();
    let (count, talk) = made("mesh show/two/cache/*.mcf");
    assert!(count == 4 && talk.contains("1 files are left out"), "{talk}");
    for (folder, line) in
        [("show/two", "mesh cache/frame_0001.mcf"), ("show/two/cache", "mesh frame_0001.mcf")]
    {
        fs::remove_dir_all(desk.path("show/two/mesh")).unwrap();
        assert!(desk.tool(line).current_dir(desk.path(folder)).output().unwrap().status.success(), "{line}");
        assert_eq!(names("two"), ["liquid_0001.ply"]);
    }

    for (line, words) in [
        ("mesh show/two/cache/frame_0009.mcf", "frame_0009.mcf"),
        ("mesh show/two/cache/frame_0001.mcf show/*/cache/frame_0099.mcf", "found no cached frame"),
        ("mesh show/two/cache/*.mcf --frames 1", "leave one of the two out"),
        ("mesh show/two/cache/*.mcf --spacing 0.1", "--spacing is for particle files"),
    ] {
        let output = desk.tool(line).output().unwrap();
        let talk = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && talk.contains(words), "{line}: {talk}");
    }
    fs::create_dir(desk.path("loose")).unwrap();
    fs::copy(desk.path("show/two/cache/frame_0001.mcf"), desk.path("loose/frame_0001.mcf")).unwrap();
    fs::create_dir_all(desk.path("lone/cache")).unwrap();
    fs::copy(desk.path("show/two/cache/frame_0001.mcf"), desk.path("lone/cache/frame_0001.mcf")).unwrap();
    for line in ["mesh loose/frame_0001.mcf", "mesh lone/cache/frame_0001.mcf"] {
        let (_, talk) = desk.run(line, 2);
        assert!(talk.contains("outside of a shot"), "{talk}");
    }
    let (_, talk) = desk.run("mesh lone --set surface.contact={}", 2);
    assert!(talk.contains("a cache without a preset"), "{talk}");
}
