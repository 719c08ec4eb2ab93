//! Materials: regions, painted meshes, directions, triangles.

use super::{
    statics::{mesh, with_mesh},
    *,
};
use meniscus::{import::parse_sheet, sim::sheet::SheetMesh};
use std::path::Path;

const CELLS: u32 = 8;

/// Stiffness, rest length and damping of the two directions, and stiffness against shear.
const YARN: [[f64; 2]; 3] = [[30.0, 12.0], [0.9, 1.05], [0.02, 0.005]];
const SHEAR: f64 = 5.0;

fn terms(more: &str) -> String {
    let [stiffness, rest, damping] = YARN;
    format!(
        "density = 0.3\nstiffness = {stiffness:?}\nrest = {rest:?}\nspring_damping = {damping:?}\nshear = {SHEAR:?}\n{more}"
    )
}

/// Factors of stiffness, rest length and damping in a column of points.
type Factors = fn(u32) -> [f64; 3];

/// Reference springs of the square: the columns of the ends, the direction in cells, stiffness, rest length,
/// damping.
fn springs(is_mesh: bool, factors: Factors) -> Vec<([f64; 2], [f64; 3])> {
    let ([[y1, y2], [r1, r2], [t1, t2]], h) = (YARN, 1.0 / f64::from(CELLS));
    let slack = if is_mesh { 0.5 * 2.0_f64.sqrt() * (r1 + r2) } else { r1.hypot(r2) };
    let half = |k: u32| if k == 0 || k == CELLS { 0.5 } else { 1.0 };
    let mut out = Vec::new();
    for j in 0..=CELLS {
        for i in 0..=CELLS {
            let along = (i < CELLS).then_some(([1.0, 0.0], i + 1, y1 * half(j), r1, t1));
            let across = (j < CELLS).then_some(([0.0, 1.0], i, y2 * half(i), r2, t2));
            let both = i < CELLS && j < CELLS;
            let shear = |from, to, side| (from, ([side, 1.0], to, SHEAR, slack, 0.5 * (t1 + t2)));
            let diagonals = [shear(i, i + 1, 1.0), shear(i + 1, i, -1.0)].into_iter().filter(|_| both);
            let straight = [along, across].into_iter().flatten().map(|spring| (i, spring));
            for (from, (direction, to, k, rest, time)) in straight.chain(diagonals) {
                let [a, b] = [factors(from), factors(to)];
                let mean: [f64; 3] = std::array::from_fn(|what| 0.5 * (a[what] + b[what]));
                let k = k * mean[0];
                out.push((direction.map(|w| w * h), [k, rest * mean[1] * h, time * k * mean[2]]));
            }
        }
    }
    out
}

/// Factors as a region of the half x ≤ ½: inside, outside.
const HALVES: Factors = |i| if i <= CELLS / 2 { [3.0, 0.8, 2.5] } else { [1.0; 3] };

const REGION: &str = "region = [{ shape = { box = { min = [-1, -1, -1], max = [0.51, 2, 1] } }, stiffness = 3, rest = 0.8, damping = 2.5 }]";

/// Factors as painted: from column to column.
const PAINT: Factors = |i| [1.0 + 0.25 * i as f64, 1.1 - 0.04 * i as f64, 0.5 + 0.1 * i as f64];

fn painted(factors: Factors) -> SheetMesh {
    let mut mesh = mesh(CELLS, false);
    let column =
        |what: usize| (0..mesh.points.len() as u32).map(move |i| factors(i % (CELLS + 1))[what] as f32);
    let [stiffness, rest, damping] = [0, 1, 2].map(|what| column(what).collect());
    (mesh.stiffness, mesh.rest, mesh.damping) = (stiffness, rest, damping);
    mesh
}

/// The square with a region, with a painted mesh, and with both.
fn shots(more: &str) -> [(&'static str, Shot, bool, Factors); 3] {
    let region = terms(&format!("{REGION}\n{more}"));
    let both: Factors = |i| [0, 1, 2].map(|what| HALVES(i)[what] * PAINT(i)[what]);
    [
        ("region", shot(&square([CELLS; 2], 0.0, &region)), false, HALVES),
        ("paint", with_mesh(painted(PAINT), &terms(more)), true, PAINT),
        ("both", with_mesh(painted(PAINT), &region), true, both),
    ]
}

#[test]
fn regions_and_paint_change_stiffness_and_rest_lengths() {
    let world = world(0.0, vec![]);
    for (name, shot, is_mesh, factors) in shots("") {
        // Stretched along x and compressed along y.
        let by = [1.1, 0.95];
        let place = |_, x: Vec3, v| (Vec3::new(x.x * by[0] as f32, x.y * by[1] as f32, x.z), v);
        let mut sheets = placed_shot(&shot, &world, place);
        let expected: f64 = springs(is_mesh, factors)
            .iter()
            .map(|([x, y], [k, rest, _])| 0.5 * k * ((x * by[0]).hypot(y * by[1]) - rest).powi(2))
            .sum();
        let found = run_at(&mut sheets, 0, 1, 1e-9).unwrap()[0].elastic_energy;
        println!("{name}: {found} J, {expected} J");
        assert!((found / expected - 1.0).abs() < 1e-5, "{name}: {found}, {expected}");
    }
}

/// Springs dissipate the power of their dampers in a steady stretch: Σ c (rate of length)².
#[test]
fn regions_paint_and_directions_change_the_damping_of_springs() {
    let world = world(0.0, vec![]);
    for (name, shot, is_mesh, factors) in shots("") {
        for rate in [[1.0, 0.0], [0.0, 1.0], [0.6, -0.8]] {
            let mut shot = shot.clone();
            let mut yarn = springs(is_mesh, factors);
            // Springs at rest length exert no other force.
            shot.params.sheet[0].rest = [1.0; 2];
            shot.params.sheet[0].region.iter_mut().for_each(|region| region.rest = 1.0);
            if let meniscus::sim::sheet::SheetShape::Mesh(mesh) = &mut shot.params.sheet[0].shape {
                mesh.rest.clear();
            }
            let flow = |_, x: Vec3, _| (x, Vec3::new(rate[0] as f32 * x.x, rate[1] as f32 * x.y, 0.0));
            let mut sheets = placed_shot(&shot, &world, flow);
            let v = sheets.velocities();
            let before: f64 = (0..v.len())
                .map(|i| 0.5 * f64::from(sheets.mass(i)) * v[i].cast::<f64>().norm_squared())
                .sum();
            let dt = 1e-5;
            let after = run_at(&mut sheets, 0, 1, dt).unwrap()[0].kinetic_energy;
            let longer = |[x, y]: [f64; 2]| (x * x * rate[0] + y * y * rate[1]) / x.hypot(y);
            let power: f64 = yarn.drain(..).map(|(direction, [_, _, c])| c * longer(direction).powi(2)).sum();
            let found = (before - after) / dt;
            println!("{name} {rate:?}: {found} W, {power} W");
            assert!((found / power - 1.0).abs() < 5e-3, "{name} {rate:?}: {found}, {power}");
        }
    }
}

/// v ← v/(1 + Δt c) a substep; a sheet without springs takes one substep a frame.
#[test]
fn regions_and_paint_change_drag() {
    for (name, mut shot, _, factors) in shots("damping = 1.5\nvelocity = [2.0, 0.0, 0.0]") {
        (shot.params.sheet[0].stiffness, shot.params.sheet[0].shear) = ([0.0; 2], None);
        let mut sheets = Sheets::new(shot, &world(0.0, vec![])).unwrap();
        let records = run(&mut sheets, 0, 12).unwrap();
        assert!(records.iter().all(|record| record.substeps == 1));
        for (i, v) in sheets.velocities().into_iter().enumerate() {
            let rate = 1.5 * factors(i as u32 % (CELLS + 1))[2];
            let expected = 2.0 * (1.0 + rate * FRAME).powi(-12);
            assert!((f64::from(v.x) / expected - 1.0).abs() < 1e-5, "{name} {i}: {} {expected}", v.x);
        }
    }
}

/// A strip of columns without weft, from a painted file, hangs by its own weight; its lower half is three
/// times as dense. Each row supports what is below it, with its painted properties.
#[test]
fn a_painted_mesh_from_a_file_hangs_by_its_painted_properties() {
    let (columns, rows, h) = (4_u32, 10_u32, 0.1_f64);
    let factors = |j: u32| [1.0 + 0.1 * f64::from(j), 1.2 - 0.03 * f64::from(j), 1.0 + f64::from(j % 2)];
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property float rest\nproperty float damping\nproperty float stiffness\nelement face {}\n\
         property list uchar int vertex_indices\nend_header\n",
        (columns + 1) * (rows + 1),
        columns * rows
    );
    for j in 0..=rows {
        let [stiffness, rest, damping] = factors(j);
        for i in 0..=columns {
            let (x, z) = (0.1 * f64::from(i), -h * f64::from(j));
            text += &format!("{x} 0 {z} {rest} {damping} {stiffness}\n");
        }
    }
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let a = i + (columns + 1) * j;
        text += &format!("4 {a} {} {} {}\n", a + columns + 1, a + columns + 2, a + 1);
    }
    let found = parse_sheet(Path::new("strip.ply"), text.as_bytes()).unwrap();
    let points = found.positions.iter().map(|&x| x.into()).collect();
    let [stiffness, rest, damping] = found.painted;
    let mesh = SheetMesh { points, faces: found.faces, stiffness, rest, damping, ..SheetMesh::default() };

    let (density, y) = (0.2, 30.0);
    let top: Vec<u32> = (0..=columns).collect();
    let terms = format!(
        "density = {density:?}\nstiffness = [{y:?}, 0.0]\ngrain = [0, 0, -2]\ndamping = 3.0\n\
         region = [{{ shape = {{ box = {{ min = [-1, -1, -2], max = [2, 1, -0.49] }} }}, density = 3.0 }}]\n\
         pin = [{{ at = {{ points = {top:?} }} }}]\n\
         [sheets.solver]\nintegrator = 'implicit'\nsubsteps = 2\ntolerance = 1e-6\nmax_iterations = 3000\n"
    );
    let mut sheets = Sheets::new(with_mesh(mesh, &terms), &world(9.81, vec![])).unwrap();
    let last = run(&mut sheets, 0, 200).unwrap().pop().unwrap();
    assert!(last.kinetic_energy < 1e-9, "at rest: {last:?}");
    let weight = |j: u32| {
        let share = if j == rows { 0.5 } else { 1.0 };
        9.81 * density * h * share * if j >= 5 { 3.0 } else { 1.0 }
    };
    let mut z = 0.0;
    for j in 0..=rows {
        for i in 0..=columns {
            let found = f64::from(sheets.positions()[(i + (columns + 1) * j) as usize].z);
            assert!((found - z).abs() < 1e-4, "{i} {j}: {found} m, {z} m");
        }
        let supported: f64 = (j + 1..=rows).map(weight).sum();
        let mean: Vec<f64> = (0..3).map(|what| 0.5 * (factors(j)[what] + factors(j + 1)[what])).collect();
        z -= h * (mean[1] + supported / (y * mean[0]));
    }
    println!("the lowest row hangs {z} m down");
}

#[test]
fn invalid_painted_factors_are_refused() {
    let error = |change: &dyn Fn(&mut SheetMesh)| {
        let mut mesh = painted(PAINT);
        change(&mut mesh);
        Sheets::new(with_mesh(mesh, &terms("")), &world(0.0, vec![])).map(|_| ()).unwrap_err().to_string()
    };
    assert!(error(&|mesh| mesh.rest[7] = f32::NAN).contains("sheet.0.shape.mesh.rest is NaN"));
    assert!(error(&|mesh| mesh.damping[0] = -1.0).contains("sheet.0.shape.mesh.damping is -1"));
    assert!(
        error(&|mesh| mesh.stiffness.truncate(3)).contains("sheet.0.shape.mesh.stiffness selects 3 points")
    );
    let wrong = terms(&REGION.replace("rest = 0.8", "rest = nan"));
    let error = try_sheets(&square([1, 1], 0.0, &wrong), &world(0.0, vec![])).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("sheet.0.region.0.rest is NaN"), "{error}");
}

/// Rows of equilateral triangles of the edge `h`, every other row half an edge to the right.
fn equilateral(columns: u32, rows: u32, h: f64) -> SheetMesh {
    let at = |i: u32, j: u32| i + (columns + 1) * j;
    let mut mesh = SheetMesh::default();
    for j in 0..=rows {
        for i in 0..=columns {
            let x = f64::from(i) + 0.5 * f64::from(j % 2);
            mesh.points.push([(h * x) as f32, (h * 0.75_f64.sqrt() * f64::from(j)) as f32, 0.0]);
        }
    }
    for (j, i) in (0..rows).flat_map(|j| (0..columns).map(move |i| (j, i))) {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
        mesh.faces.extend(if j % 2 == 0 {
            [[a, b, c, c], [b, d, c, c]]
        } else {
            [[a, b, d, d], [a, d, c, c]]
        });
    }
    mesh
}

/// Energy over ½ ε² A of a flat sheet stretched by ε at an angle to x, without the part odd in ε.
fn modulus(shot: &Shot, area: f64, degrees: f32) -> f64 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let n = Vec3::new(cos, sin, 0.0);
    let energy = |strain: f32| {
        let stretch = |_, x: Vec3, v| (x + n * (strain * n.dot(&x)), v);
        let mut sheets = placed_shot(shot, &world(0.0, vec![]), stretch);
        run_at(&mut sheets, 0, 1, 1e-9).unwrap()[0].elastic_energy
    };
    0.5 * (energy(0.01) + energy(-0.01)) / (0.5 * 1e-4 * area)
}

/// Y/(1 − ν²) with ν = 1/3, in all directions: springs along equilateral triangles are an isotropic membrane.
#[test]
fn equilateral_triangles_are_a_membrane_of_the_stated_stiffness() {
    let (y, h) = (30.0, 0.1);
    for cells in [[4, 2], [10, 7]] {
        let shot = with_mesh(
            equilateral(cells[0], cells[1], h),
            &format!("density = 1.0\nstiffness = [{y:?}, {y:?}]"),
        );
        let area = f64::from(2 * cells[0] * cells[1]) * 0.75_f64.sqrt() / 2.0 * h * h;
        for degrees in [0.0, 20.0, 50.0, 90.0] {
            let found = modulus(&shot, area, degrees);
            println!("{cells:?} {degrees}: {found}");
            assert!((found / (y * 9.0 / 8.0) - 1.0).abs() < 1e-3, "{cells:?} {degrees}: {found}");
        }
    }
}

/// A strip of equilateral triangles, free apart from a load at both ends: strain = load/Y, and a third of it
/// across.
#[test]
fn a_strip_of_equilateral_triangles_has_the_strain_of_its_load() {
    let (columns, rows, h, y, load) = (12_u32, 6_u32, 0.05_f64, 30.0, 0.15);
    let terms = format!(
        "density = 0.2\nstiffness = [{y:?}, {y:?}]\ndamping = 8.0\n\
         [sheets.solver]\nintegrator = 'implicit'\nsubsteps = 1\ntolerance = 1e-6\nmax_iterations = 3000"
    );
    let shot = with_mesh(equilateral(columns, rows, h), &terms);
    let mut sheets = Sheets::new(shot, &world(0.0, vec![])).unwrap();
    let (start, at) = (sheets.positions(), |i: u32, j: u32| (i + (columns + 1) * j) as usize);
    let mut forces = vec![Vec3::zeros(); start.len()];
    for j in 0..=rows {
        // Nodal forces of a uniform stress at the zigzag of the end.
        let share = if j == 0 || j == rows { 0.5 } else { 1.0 };
        let force = (load * share * 0.75_f64.sqrt() * h) as f32;
        (forces[at(0, j)].x, forces[at(columns, j)].x) = (-force, force);
    }
    sheets.set_external_forces(forces);
    run(&mut sheets, 0, 200).unwrap();
    let x = sheets.positions();
    let strain =
        |a: usize, b: usize, axis: usize| f64::from((x[b] - x[a])[axis] / (start[b] - start[a])[axis]) - 1.0;
    for (a, b) in [(at(0, 3), at(columns, 3)), (at(4, 0), at(5, 0)), (at(1, 6), at(2, 6))] {
        let found = strain(a, b, 0);
        // Springs turn a little: an effect of second order in a strain of 0.005.
        assert!((found / (load / y) - 1.0).abs() < 0.01, "{a} {b}: {found}");
    }
    let across = strain(at(6, 0), at(6, 6), 1);
    println!("{} along, {across} across", strain(at(0, 3), at(columns, 3), 0));
    assert!((across / (-load / y / 3.0) - 1.0).abs() < 0.03, "{across}");
}

/// Springs at an angle θ to the grain have the stiffness Y₁ cos²θ + Y₂ sin²θ.
#[test]
fn stiffness_and_rest_lengths_of_meshes_follow_the_grain() {
    let (y1, y2) = (40.0, 7.0);
    let terms = |grain: &str, rest: &str| {
        format!("density = 1.0\nstiffness = [{y1:?}, {y2:?}]\n{rest}\ngrain = {grain}")
    };
    let quads = |grain: &str| with_mesh(mesh(6, false), &terms(grain, ""));
    let triangles = |grain: &str| with_mesh(equilateral(10, 7, 0.1), &terms(grain, ""));
    let area = 140.0 * 0.75_f64.sqrt() / 2.0 * 0.01;
    // In equilateral triangles a class of edges contributes Y(θ) cos⁴ of its angle to the stretch.
    for (name, shot, area, along, across) in [
        ("quads", quads("[5, 0, 0]"), 1.0, y1, y2),
        ("quads, turned", quads("[0, -0.1, 0]"), 1.0, y2, y1),
        ("quads, between", quads("[1, 1, 0]"), 1.0, 0.5 * (y1 + y2), 0.5 * (y1 + y2)),
        (
            "triangles",
            triangles("[1, 0, 0]"),
            area,
            y1 + 0.125 * (0.25 * y1 + 0.75 * y2),
            1.125 * (0.25 * y1 + 0.75 * y2),
        ),
        (
            "triangles, turned",
            triangles("[0, 1, 0]"),
            area,
            y2 + 0.125 * (0.25 * y2 + 0.75 * y1),
            1.125 * (0.25 * y2 + 0.75 * y1),
        ),
    ] {
        for (degrees, expected) in [(0.0, along), (90.0, across)] {
            let found = modulus(&shot, area, degrees);
            println!("{name} {degrees}: {found} {expected}");
            assert!((found / expected - 1.0).abs() < 2e-3, "{name} {degrees}: {found} {expected}");
        }
    }
    // Rest lengths a tenth shorter along the grain alone: ½ Y₁ 0.1².
    for grain in ["[1, 0, 0]", "[0, 1, 0]"] {
        let shot = with_mesh(mesh(6, false), &terms(grain, "rest = [0.9, 1.0]"));
        let mut sheets = Sheets::new(shot, &world(0.0, vec![])).unwrap();
        let found = run_at(&mut sheets, 0, 1, 1e-9).unwrap()[0].elastic_energy;
        assert!((found / (0.5 * y1 * 0.01) - 1.0).abs() < 1e-4, "{grain}: {found}");
    }
}
