//! Meshes of particles that are few, coincident, far away or far apart, and of grids much finer or coarser than they.

use super::{
    meshing::{read_ply, xyz},
    surfacing::ISOTROPIC,
    *,
};
use meniscus::mesh;

/// Meshes particles that rest 0.1 m apart and returns what the mesh is.
fn meshed(desk: &Desk, points: &[[f32; 3]], options: &str) -> mesh::MeshCheck {
    desk.write("points.xyz", xyz(points));
    desk.run(&format!("mesh points.xyz --spacing 0.1 -o out --force {options}"), 0);
    mesh::check(&read_ply(&desk.path("out/mesh/particles_0001.ply")))
}

/// A block of n³ particles from a corner on.
fn block(n: i32, corner: f32) -> Vec<[f32; 3]> {
    (0..n * n * n).map(|i| [i % n, i / n % n, i / n / n].map(|v| corner + 0.1 * v as f32)).collect()
}

#[test]
fn no_particle_one_and_two() {
    let desk = Desk::new();
    // No particle is an error by itself, and an empty frame among others.
    desk.write("none_1.xyz", "# x y z\n");
    let (_, talk) = desk.run("mesh none_1.xyz --spacing 0.1 -o out", 1);
    assert!(talk.contains("no particles"), "{talk}");
    desk.write("none_2.xyz", "0 0 0\n");
    let (_, talk) = desk.run("mesh none_#.xyz --spacing 0.1 -o out", 0);
    assert!(talk.contains("none_1.xyz: no particles, so its mesh is empty"), "{talk}");
    assert!(read_ply(&desk.path("out/mesh/particles_0001.ply")).triangles.is_empty());

    let one = meshed(&desk, &[[0.3, 0.2, 0.1]], "");
    assert!(one.is_sound() && one.components == 1 && one.volume > 0.0, "{one:?}");
    let near = meshed(&desk, &[[0.3, 0.2, 0.1], [0.4, 0.2, 0.1]], "");
    assert!(near.is_sound() && near.components == 1 && near.volume > one.volume, "{near:?}");
    let far = meshed(&desk, &[[0.3, 0.2, 0.1], [0.3, 0.2, 7.1]], "");
    assert!(far.is_sound() && far.components == 2, "{far:?}");
}

#[test]
fn coincident_particles() {
    let desk = Desk::new();
    let once = meshed(&desk, &[[0.3, 0.2, 0.1]], "");
    for count in [2, 3000] {
        let many = meshed(&desk, &vec![[0.3, 0.2, 0.1]; count], "");
        assert!(many.is_sound() && many.components == 1, "{count}: {many:?}");
        assert!(many.volume.is_finite() && many.volume >= 0.9 * once.volume, "{count}: {many:?} {once:?}");
    }
    let twice = [block(8, 0.0), block(8, 0.0)].concat();
    let (single, double) = (meshed(&desk, &block(8, 0.0), ""), meshed(&desk, &twice, ""));
    assert!(double.is_sound() && double.components == 1, "{double:?}");
    assert!((double.volume / single.volume - 1.0).abs() < 0.15, "{} {}", double.volume, single.volume);
}

#[test]
fn grids_a_tenth_of_the_spacing_and_five_times_it() {
    let desk = Desk::new();
    let fine = meshed(&desk, &block(6, 0.0), "--voxel 0.1");
    let usual = meshed(&desk, &block(6, 0.0), "");
    assert!(fine.is_sound() && fine.components == 1, "{fine:?}");
    assert!((fine.volume / usual.volume - 1.0).abs() < 0.05, "{} {}", fine.volume, usual.volume);
    // Nodes are half a metre apart: those inside of a block of 3 m are enough to detect it.
    let coarse = meshed(&desk, &block(30, 0.0), "--voxel 5");
    assert!(coarse.is_sound() && coarse.components == 1, "{coarse:?}");
    assert!((coarse.volume / 27.0 - 1.0).abs() < 0.4, "{}", coarse.volume);
    // What is between all nodes is counted.
    desk.write("lost.xyz", xyz(&[[0.25, 0.25, 0.25]]));
    let (_, talk) = desk.run("mesh lost.xyz --spacing 0.1 -o lost --voxel 5", 0);
    assert!(talk.contains("1 particles between grid nodes, without effect (surface.voxel)"), "{talk}");
}

#[test]
fn a_thousand_kilometres_from_the_origin() {
    let desk = Desk::new();
    // Single precision resolves 0.0625 m there: particles rest a metre apart.
    let far: Vec<[f32; 3]> = block(8, 0.0).iter().map(|x| x.map(|v| 1e6 + 10.0 * v)).collect();
    let here: Vec<[f32; 3]> = far.iter().map(|x| x.map(|v| v - 1e6)).collect();
    desk.write("far.xyz", xyz(&far));
    desk.write("here.xyz", xyz(&here));
    let check = |name: &str| {
        let (_, talk) = desk.run(&format!("mesh {name}.xyz --spacing 1 -o {name} {ISOTROPIC}"), 0);
        assert_eq!(
            talk.contains("positions of particles are rounded to 0.12 spacings"),
            name == "far",
            "{talk}"
        );
        mesh::check(&read_ply(&desk.path(&format!("{name}/mesh/particles_0001.ply"))))
    };
    let (far, here) = (check("far"), check("here"));
    assert!(far.is_sound() && far.components == 1, "{far:?}");
    assert!((far.volume / here.volume - 1.0).abs() < 0.02, "{} {}", far.volume, here.volume);
}

/// Vertices are 1 mm apart there in single precision, and edges as short.
#[test]
fn ten_kilometres_from_the_origin_every_triangle_has_an_area() {
    let desk = Desk::new();
    // Positions that single precision has in both places.
    let here: Vec<[f32; 3]> =
        block(12, 0.0).iter().map(|x| x.map(|v| (v * 0.3 * 1024.0).round() / 1024.0)).collect();
    let far: Vec<[f32; 3]> = here.iter().map(|[x, y, z]| [x + 1e4, y - 9984.0, *z]).collect();
    let mesh = |name: &str, points: &[[f32; 3]]| {
        desk.write(&format!("{name}.xyz"), xyz(points));
        let line = format!("mesh {name}.xyz --spacing 0.03 -o {name} --voxel 0.32 --format ply,obj");
        let (_, talk) = desk.run(&line, 0);
        let mesh = read_ply(&desk.path(&format!("{name}/mesh/particles_0001.ply")));
        let text = fs::read_to_string(desk.path(&format!("{name}/mesh/particles_0001.obj"))).unwrap();
        let first = text.lines().find_map(|line| line.strip_prefix("v ")).unwrap().to_owned();
        (mesh::check(&mesh), talk, first)
    };
    let ((near, quiet, _), (found, talk, vertex)) = (mesh("here", &here), mesh("far", &far));
    assert!(found.is_sound() && found.components == near.components, "{found:?} {near:?}");
    assert!((found.volume / near.volume - 1.0).abs() < 1e-3, "{} {}", found.volume, near.volume);
    assert!(talk.contains("0.04 spacings") && talk.contains("in double precision"), "{talk}");
    assert!(!quiet.contains("double precision"), "{quiet}");
    // OBJ has the digits too.
    let x: f64 = vertex.split(' ').next().unwrap().parse().unwrap();
    assert!((x - 1e4).abs() < 2.0 && f64::from(x as f32) != x, "{vertex}");
}

#[test]
fn a_spacing_far_off_is_reported_with_one_that_fits() {
    let desk = Desk::new();
    desk.write("block.xyz", xyz(&block(10, 0.0)));
    for (spacing, word) in [("10", "too large"), ("0.001", "too small"), ("0.1", "")] {
        let (out, talk) = desk.run(&format!("mesh block.xyz --spacing {spacing} -o out --force"), 0);
        let log = format!("{out}{talk}");
        assert_eq!(log.contains("--spacing 0.1 would fit a liquid"), !word.is_empty(), "{log}");
        assert!(log.contains(word), "{log}");
    }
    // No figure has more digits than it can mean.
    let (out, talk) = desk.run("mesh block.xyz --spacing 1e6 -o out --force", 0);
    let digits = |word: &str| word.chars().all(|c| c.is_ascii_digit()) && word.len() > 12;
    assert!(!out.split(' ').chain(talk.split(' ')).any(digits), "{out}{talk}");
    for spacing in ["1e-30", "1e30"] {
        let (_, talk) = desk.run(&format!("mesh block.xyz --spacing {spacing} -o out --force"), 2);
        assert!(talk.contains("spacing"), "{talk}");
    }
}

#[test]
fn a_dense_cluster_is_thinned_and_counted() {
    let desk = Desk::new();
    let place = |i: i32| [0.3, 0.2, 0.1].map(|at| at + 1e-3 * (i % 97) as f32 / 97.0);
    let cluster: Vec<[f32; 3]> = (0..20_000).map(place).collect();
    desk.write("cluster.xyz", xyz(&[block(6, 1.0), cluster].concat()));
    let (out, talk) = desk.run("mesh cluster.xyz --spacing 0.1 -o out", 0);
    assert!(format!("{out}{talk}").contains("particles left out of clusters"), "{out}{talk}");
    let check = mesh::check(&read_ply(&desk.path("out/mesh/particles_0001.ply")));
    assert!(check.is_sound() && check.components == 2, "{check:?}");
}

/// Estimates that refuse a frame are near the memory that it takes, whether the particles are a body, a sheet or spray.
#[cfg(target_os = "linux")]
#[test]
fn memory_is_refused_by_estimates_near_the_real_peak() {
    let desk = Desk::new();
    let body = block(22, 0.0);
    let sheet = (0..150 * 150).map(|i| [(i % 150) as f32 * 0.1, (i / 150) as f32 * 0.1, 0.0]).collect();
    let place = |i: u32, prime: u32| (i * prime % 9973) as f32 / 9973.0 * 40.0;
    let spray = (0..6000).map(|i| [place(i, 613), place(i, 3347), place(i, 811)]).collect();
    let cases = [
        ("distances", block(22, 0.0), "--voxel 0.25 --set surface.distance={}"),
        ("spray", spray, "--voxel 0.5"),
        ("body", body, "--voxel 0.125"),
        ("sheet", sheet, "--voxel 0.25"),
    ];
    for (name, points, options) in cases.into_iter().take(if super::is_soak() { 4 } else { 2 }) {
        desk.write(&format!("{name}.xyz"), xyz(&points));
        let line = format!("mesh {name}.xyz --spacing 0.1 -o {name} --progress none {options}");
        let measured = plan::peak(&desk, &line);
        // So little that it is refused, and so much that the coarse nodes are sampled.
        let allowed = 0.6 * measured;
        let (_, log) = desk.run(&format!("{line} --force --max-memory {allowed:.0}B"), 33);
        let mib = log.split_whitespace().zip(log.split_whitespace().skip(1)).find(|(_, unit)| *unit == "MiB");
        let estimate = mib.unwrap().0.parse::<f64>().unwrap() * f64::from(1 << 20);
        println!("{name}: estimated {estimate}, measured {measured} bytes");
        assert!((0.7..1.3).contains(&(estimate / measured)), "{name}: {estimate}, measured {measured} bytes");
    }
}

/// Memory follows the particles, not the box around them.
#[cfg(target_os = "linux")]
#[test]
fn spray_ten_kilometres_wide() {
    let desk = Desk::new();
    let spray = |width: f32| -> Vec<[f32; 3]> {
        let place = |i: u32, prime: u32| (i * prime % 1009) as f32 / 1009.0 * width;
        (0..1000).map(|i| [place(i, 613), place(i, 347), place(i, 811)]).collect()
    };
    let peak = |width: f32, name: &str| {
        desk.write(&format!("{name}.xyz"), xyz(&spray(width)));
        let found = plan::peak(&desk, &format!("mesh {name}.xyz --spacing 0.1 -o {name} --progress none"));
        let check = mesh::check(&read_ply(&desk.path(&format!("{name}/mesh/particles_0001.ply"))));
        assert!(check.closed && check.manifold && check.oriented && check.components == 1000, "{check:?}");
        found
    };
    let (narrow, wide) = (peak(100.0, "narrow"), peak(10_000.0, "wide"));
    println!("{narrow} and {wide} bytes");
    assert!(wide < 1.5 * narrow, "{narrow} and {wide} bytes");
}

#[test]
fn numbers_that_are_none_are_named_by_file_and_particle() {
    let desk = Desk::new();
    desk.write("good.xyz", "0 0 0\n");
    for word in ["nan", "inf", "-inf", "1e300"] {
        desk.write("bad.xyz", format!("0 0 0\n1 1 1\n2 {word} 2\n"));
        for verb in ["mesh", "volume"] {
            let (_, talk) = desk.run(&format!("{verb} bad.xyz --spacing 0.1 -o out"), 1);
            assert!(talk.contains("bad.xyz: particle 2: found (2, "), "{talk}");
        }
    }
}
