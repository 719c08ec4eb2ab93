//! Equilibria against closed forms, and refinement.

use super::*;
use meniscus::sim::sheet::{SheetMesh, SheetParams, SheetShape};

/// Lets a sheet come to rest with implicit Euler in long substeps.
fn settled(text: &str, world: &World, frames: u32) -> Sheets {
    let text = format!(
        "{text}\n[sheets.solver]\nintegrator = 'implicit'\nsubsteps = 2\ntolerance = 1e-6\nmax_iterations = 3000\n"
    );
    let mut sheets = sheets(&text, world);
    let last = run(&mut sheets, 0, frames).unwrap().pop().unwrap();
    assert!(last.kinetic_energy < 1e-9, "at rest: {last:?}");
    sheets
}

/// Sag of an elastic catenary, by integration along it: span 1 m, length 1.3 m, weight W, tension per strain
/// `ea`.
fn catenary_sag(weight: f64, ea: f64) -> f64 {
    let (length, steps) = (1.3, 20_000);
    let along = |h: f64| {
        let (mut x, mut z) = (0.0, 0.0);
        for k in 0..steps {
            let s = (f64::from(k) + 0.5) / f64::from(steps) * 0.5 * length;
            let v = weight * (0.5 - s / length);
            let t = h.hypot(v);
            let ds = (1.0 + t / ea) * 0.5 * length / f64::from(steps);
            x += ds * h / t;
            z += ds * v / t;
        }
        (x, z)
    };
    let (mut low, mut high) = (1e-6, 10.0 * weight);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if along(middle).0 < 0.5 { low = middle } else { high = middle }
    }
    along(low).1
}

#[test]
fn a_chain_hangs_as_the_elastic_catenary() {
    let stiffness = 20.0;
    let expected = catenary_sag(0.1 * 9.81, 1.3 * stiffness);
    let error = |cells: u32| {
        let terms = format!(
            "density = 0.1\nstiffness = [{stiffness}, 0.0]\nrest = [1.3, 1.0]\ndamping = 4.0\n\
             pin = [{{ at = 'corners' }}]"
        );
        // A bend gives the slack chain an initial downward direction.
        let sheets = settled(&square([cells, 0], 0.0, &terms), &world(9.81, vec![]), 400);
        let lowest = sheets.positions().iter().map(|x| x.z).fold(0.0, f32::min);
        (f64::from(-lowest) / expected - 1.0).abs()
    };
    let errors = [8, 16, 32].map(error);
    assert!(errors[2] < 2e-3, "{errors:?} of {expected} m");
    assert!(errors[0] / errors[1] > 3.0 && errors[1] / errors[2] > 3.0, "second order: {errors:?}");
}

#[test]
#[ignore = "long: tools/soak/run"]
fn the_sag_of_a_sheet_converges_as_it_is_refined() {
    // Patches of fixed size hold the corners: a single point would pull through an ever finer sheet.
    let sag = |cells: u32| {
        let mut pins = String::new();
        for (x, y) in [(0.0, 0.0), (0.0, 1.0), (1.0, 0.0), (1.0, 1.0)] {
            let (low, high) = ([x - 0.2501, y - 0.2501, -1.0], [x + 0.2501, y + 0.2501, 1.0]);
            pins += &format!(
                "[[sheet.pin]]\nat = {{ inside = {{ box = {{ min = {low:?}, max = {high:?} }} }} }}\n"
            );
        }
        let terms = format!("density = 0.2\nstiffness = [40.0, 40.0]\nshear = 15.0\ndamping = 3.0\n{pins}");
        let sheets = settled(&square([cells; 2], 0.0, &terms), &world(9.81, vec![]), 250);
        let middle = (cells / 2 * (cells + 1) + cells / 2) as usize;
        f64::from(-sheets.positions()[middle].z)
    };
    let [a, b, c] = [8, 16, 32].map(sag);
    assert!(a > 0.01 && (b - a).abs() < 0.05 * b, "{a} {b} {c}");
    assert!((c - b).abs() < 0.65 * (b - a).abs(), "{a} {b} {c}");
}

/// A strip of 1 m by `width`, pinned at its first column and loaded at its last with `load` [N].
fn pulled(cells: [u32; 2], terms: &str, load: f32) -> f64 {
    let width = 0.5_f32;
    let text = grid(
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, width, 0.0],
        cells,
        &format!(
            "density = 0.2\ndamping = 8.0\n{terms}\n[[sheet.pin]]\nat = {{ inside = {{ box = {{ min = [-0.01, -1, -1], max = [0.01, 2, 1] }} }} }}\n\
         [sheets.solver]\nintegrator = 'implicit'\nsubsteps = 1\ntolerance = 1e-6\nmax_iterations = 3000"
        ),
    );
    let mut sheets = sheets(&text, &world(0.0, vec![]));
    let [n, m] = cells.map(|c| c + 1);
    let mut forces = vec![Vec3::zeros(); sheets.len()];
    for j in 0..m {
        let share = if j == 0 || j == m - 1 { 0.5 } else { 1.0 } / (m - 1) as f32;
        forces[(n - 1 + n * j) as usize].x = load * share;
    }
    sheets.set_external_forces(forces);
    run(&mut sheets, 0, 240).unwrap();
    let x = sheets.positions();
    f64::from(x[(n - 1 + n * (m / 2)) as usize].x) - 1.0
}

#[test]
fn strain_is_load_over_stiffness_at_any_resolution() {
    for cells in [[4, 2], [8, 4], [20, 6]] {
        let strain = pulled(cells, "stiffness = [30.0, 7.0]", 1.5);
        assert!((strain / (1.5 / 0.5 / 30.0) - 1.0).abs() < 1e-3, "{cells:?}: {strain}");
    }
    // With diagonals on square cells, away from the clamp: Y + G − G²/(Y + G).
    let strain = pulled([32, 16], "stiffness = [30.0, 30.0]\nshear = 10.0", 0.15);
    let expected = 0.3 / (40.0 - 100.0 / 40.0);
    assert!((strain / expected - 1.0).abs() < 0.03, "{strain} {expected}");
}

/// Two corners of every face moved, one substep: Eq. 7 evaluated by hand.
#[test]
fn grid_points_have_spring_forces_of_their_four_three_or_two_neighbours() {
    let terms = "density = 1.0\nstiffness = [3.0, 5.0]\nrest = [0.8, 1.1]";
    let cells = [10_u32, 4];
    let bend = |i: usize, x: Vec3| {
        x + Vec3::new((i as f32).sin(), (2.0 * i as f32).cos(), (3.0 * i as f32).sin()) * 0.03
    };
    let text = square(cells, 0.0, terms);
    let mut sheets = placed(&text, &world(0.0, vec![]), |i, x, v| (bend(i, x), v));
    let x: Vec<nalgebra::Vector3<f64>> = sheets.positions().iter().map(|x| x.cast()).collect();
    let dt = 1e-4;
    run_at(&mut sheets, 0, 1, dt).unwrap();
    let (n, m) = (cells[0] as i32 + 1, cells[1] as i32 + 1);
    let (h1, h2) = (0.1, 0.25);
    for j in 0..m {
        for i in 0..n {
            let half = |on: bool| if on { 0.5 } else { 1.0 };
            let (w1, w2) = (h1 * half(i == 0 || i == n - 1), h2 * half(j == 0 || j == m - 1));
            let mut f = nalgebra::Vector3::zeros();
            for (di, dj) in [(-1, 0), (1, 0), (0, -1), (0, 1)] {
                let (a, b) = (i + di, j + dj);
                if a < 0 || b < 0 || a >= n || b >= m {
                    continue;
                }
                let (k, rest) = if dj == 0 { (3.0 * w2 / h1, 0.8 * h1) } else { (5.0 * w1 / h2, 1.1 * h2) };
                let d = x[(a + n * b) as usize] - x[(i + n * j) as usize];
                f += k * (d - rest * d / d.norm());
            }
            let expected = f / (w1 * w2);
            let found = sheets.velocities()[(i + n * j) as usize].cast::<f64>() / dt;
            assert!(
                (found - expected).norm() < 2e-4 * (1.0 + expected.norm()),
                "{i} {j}: {found} {expected}"
            );
        }
    }
}

/// A triangulated or quadrangulated unit square of n × n cells.
pub(super) fn mesh(n: u32, triangles: bool) -> SheetMesh {
    let at = |i: u32, j: u32| i + (n + 1) * j;
    let points = (0..=n).flat_map(|j| (0..=n).map(move |i| [i as f32 / n as f32, j as f32 / n as f32, 0.0]));
    let mut faces = Vec::new();
    for j in 0..n {
        for i in 0..n {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            match (triangles, (i + j) % 2) {
                (false, _) => faces.push([a, b, c, d]),
                (true, 0) => faces.extend([[a, b, c, c], [a, c, d, d]]),
                (true, _) => faces.extend([[a, b, d, d], [b, c, d, d]]),
            }
        }
    }
    SheetMesh { points: points.collect(), faces, ..SheetMesh::default() }
}

pub(super) fn with_mesh(mesh: SheetMesh, terms: &str) -> Shot {
    let mut shot = shot(&square([1, 1], 0.0, terms));
    shot.params.sheet = vec![SheetParams { shape: SheetShape::Mesh(mesh), ..shot.params.sheet.remove(0) }];
    shot
}

/// Energy of a square rolled onto a cylinder of 0.5 m about the y axis, over ½ D κ² A.
fn rolled(make: &dyn Fn() -> Sheets, restore: &dyn Fn(&[meniscus::frame::Stream]) -> Sheets) -> f64 {
    let radius = 0.5_f32;
    let start = make();
    let x = start.positions().into_iter().map(|x| {
        let angle = x.x / radius;
        Vec3::new(radius * angle.sin(), x.y, radius * (1.0 - angle.cos()))
    });
    let count = start.len();
    let stream = meniscus::frame::Stream::new("sheet.cloth", meniscus::frame::StreamKind::MeshPoints, count)
        .with("position", x.collect::<Vec<_>>())
        .with("velocity", vec![Vec3::zeros(); count]);
    let record = run_at(&mut restore(&[stream]), 0, 1, 1e-9).unwrap().remove(0);
    record.elastic_energy / (0.5 * 0.01 / f64::from(radius * radius))
}

#[test]
fn bending_energy_is_that_of_the_curvature_at_any_resolution() {
    let terms = "density = 1.0\nstiffness = [0.0, 0.0]\nbending = 0.01";
    let world = world(0.0, vec![]);
    for (name, shots) in [
        ("grid", [16, 32].map(|n| shot(&square([n; 2], 0.0, terms)))),
        ("triangles", [16, 32].map(|n| with_mesh(mesh(n, true), terms))),
        ("quads", [16, 32].map(|n| with_mesh(mesh(n, false), terms))),
    ] {
        let [coarse, fine] = shots.map(|shot| {
            let make = || Sheets::new(shot.clone(), &world).unwrap();
            rolled(&make, &|streams| Sheets::restore(shot.clone(), &world, streams, 0.0).unwrap())
        });
        // A border without curvature of its own is one cell wide.
        assert!(
            (fine - 1.0).abs() < 0.08 && (fine - 1.0).abs() < 0.7 * (coarse - 1.0).abs(),
            "{name}: {coarse} {fine}"
        );
    }
}

#[test]
fn meshes_have_the_mass_and_stiffness_of_grids() {
    let terms = "density = 0.4\nstiffness = [30.0, 30.0]";
    let world = world(0.0, vec![]);
    for triangles in [true, false] {
        let sheets = Sheets::new(with_mesh(mesh(8, triangles), terms), &world).unwrap();
        let mass: f32 = (0..sheets.len()).map(|i| sheets.mass(i)).sum();
        assert!((mass - 0.4).abs() < 1e-5);
    }
    // Stretched by 1 % along x, a quad mesh has the energy of the grid: ½ Y ε² A.
    let shot = with_mesh(mesh(8, false), terms);
    let start = Sheets::new(shot.clone(), &world).unwrap();
    let x: Vec<Vec3> = start.positions().iter().map(|x| Vec3::new(1.01 * x.x, x.y, x.z)).collect();
    let stream =
        meniscus::frame::Stream::new("sheet.cloth", meniscus::frame::StreamKind::MeshPoints, x.len())
            .with("velocity", vec![Vec3::zeros(); x.len()])
            .with("position", x);
    let mut stretched = Sheets::restore(shot, &world, &[stream], 0.0).unwrap();
    let energy = run_at(&mut stretched, 0, 1, 1e-9).unwrap()[0].elastic_energy;
    assert!((energy / (0.5 * 30.0 * 1e-4) - 1.0).abs() < 2e-3, "{energy}");
}

#[test]
fn both_integrators_find_the_same_equilibrium() {
    let terms =
        "density = 0.2\nstiffness = [60.0, 60.0]\nshear = 20.0\ndamping = 3.0\npin = [{ at = 'corners' }]";
    let text = square([10, 10], 0.0, terms);
    let implicit = settled(&text, &world(9.81, vec![]), 250);
    let mut symplectic = sheets(&text, &world(9.81, vec![]));
    run(&mut symplectic, 0, 250).unwrap();
    let pairs = implicit.positions().into_iter().zip(symplectic.positions());
    let difference = pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f32::max);
    assert!(difference < 1e-3, "{difference} m");
}
