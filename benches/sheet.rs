//! Benchmarks of sheets: a substep of grids and meshes of 1e3 to 1e6 points with various terms, and the
//! implicit substep.
//!
//! `cargo bench --bench sheet`; `MENISCUS_THREADS=1` sets the threads. With `-- threads` it only compares one
//! thread with two, in alternation. Criterion's elements are springs, counted once a substep: structural ones
//! and diagonals, not the terms of plates, although both ends of a spring compute it.

use criterion::{Criterion, Throughput};
use meniscus::{
    math::Vec3,
    par,
    sim::{
        World,
        sheet::{SheetMesh, SheetShape, Sheets, SheetsParams, Shot},
    },
};
use std::time::{Duration, Instant};

/// Terms of the sheets of a group.
struct Case {
    name: &'static str,
    terms: &'static str,
    shear: bool,
    mesh: bool,
}

const CASES: [Case; 5] = [
    Case { name: "structural", terms: "", shear: false, mesh: false },
    Case { name: "and shear", terms: "shear = 20.0", shear: true, mesh: false },
    Case { name: "and shear, bending", terms: "shear = 20.0\nbending = 1e-5", shear: true, mesh: false },
    Case {
        name: "and shear, bending, damping",
        terms: "shear = 20.0\nbending = 1e-5\ndamping = 1.0\nspring_damping = [1e-5, 1e-5]",
        shear: true,
        mesh: false,
    },
    Case { name: "triangles", terms: "", shear: false, mesh: true },
];

/// A square of `side`² points, pinned at two corners.
fn sheets(side: u32, terms: &str, mesh: bool) -> Sheets {
    let text = format!(
        "[[sheet]]\nname = 'cloth'\ndensity = 0.2\nstiffness = [50.0, 50.0]\npin = [{{ at = {{ points = [0, {}] }} }}]\n\
         shape = {{ grid = {{ origin = [0, 0, 0], first = [1, 0, 0], second = [0, 1, 0], cells = [{n}, {n}] }} }}\n{terms}",
        side * side - 1,
        n = side - 1
    );
    let mut params: SheetsParams = toml::from_str(&text).expect("the preset is valid");
    if mesh {
        params.sheet[0].shape = SheetShape::Mesh(triangles(side));
    }
    let world = World { gravity: Vec3::new(0.0, 0.0, -9.81), solids: Vec::new() };
    Sheets::new(Shot { params, fps: 24.0, first: 1 }, &world).expect("the sheets are valid")
}

/// A square of triangles, row by row.
fn triangles(side: u32) -> SheetMesh {
    let step = 1.0 / (side - 1) as f32;
    let at = |i: u32, j: u32| i + side * j;
    let all = |n: u32| (0..n).flat_map(move |j| (0..n).map(move |i| (i, j)));
    let point = |(i, j): (u32, u32)| [i as f32 * step, j as f32 * step, 0.0];
    let two = |(i, j)| {
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c, c], [a, c, d, d]]
    };
    SheetMesh {
        points: all(side).map(point).collect(),
        faces: all(side - 1).flat_map(two).collect(),
        ..SheetMesh::default()
    }
}

const IMPLICIT: &str = "[sheets.solver]\nintegrator = \"implicit\"\nsubsteps = 1";

/// Measurements with one and with two threads: short and many, so that some are undisturbed.
const MEASUREMENTS: usize = 100;

/// Prints the speed-up by two threads: the ratio of the best measurements, and the median over pairs of one
/// measurement each.
fn by_threads() {
    println!("| terms | points | 1 thread, ms | 2 threads, ms | ratio of the best | median of pairs |");
    println!("|---|--:|--:|--:|--:|--:|");
    for case in CASES {
        for side in [32, 65, 100, 178, 316, 562, 1000] {
            let sheets = sheets(side, case.terms, case.mesh);
            let dt = 0.4 * sheets.max_stable_step();
            row(case.name, side, 1_000_000 / side.pow(2), sheets, dt);
        }
    }
    for side in [65, 100, 316, 1000] {
        // As long as eight substeps of the symplectic integrator, so that the number of iterations does not
        // depend on the points.
        let dt = 8.0 * 0.4 * sheets(side, "", false).max_stable_step();
        row("implicit, an iteration", side, 50_000 / side.pow(2), sheets(side, IMPLICIT, false), dt);
    }
}

/// Prints a row: milliseconds a substep, or an iteration of the conjugate gradients. Either number of threads
/// is measured first equally often.
fn row(name: &str, side: u32, steps: u32, mut sheets: Sheets, dt: f64) {
    let steps = steps.clamp(1, 500);
    let mut measure = |threads: usize| {
        par::with_threads(threads, || {
            let mut step = || sheets.step(0.0, dt).expect("it is stable");
            step();
            let start = Instant::now();
            let iterations: u32 = (0..steps).map(|_| step().iterations.max(1)).sum();
            1e3 * start.elapsed().as_secs_f64() / f64::from(iterations)
        })
    };
    let mut pairs: Vec<[f64; 2]> = (0..MEASUREMENTS)
        .map(|k| {
            let first = measure(1 + k % 2);
            let second = measure(2 - k % 2);
            if k % 2 == 0 { [first, second] } else { [second, first] }
        })
        .collect();
    let [one, two] = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).fold(f64::INFINITY, f64::min));
    pairs.sort_by(|a, b| (a[0] / a[1]).total_cmp(&(b[0] / b[1])));
    let [a, b] = pairs[MEASUREMENTS / 2];
    println!("| {name} | {} | {one:.3} | {two:.3} | {:.2}× | {:.2}× |", side * side, one / two, a / b);
}

fn main() {
    if std::env::args().any(|word| word == "threads") {
        return by_threads();
    }
    let threads = std::env::var("MENISCUS_THREADS").map_or(0, |n| n.parse().expect("a number of threads"));
    par::with_threads(threads, || {
        let mut criterion = Criterion::default().configure_from_args();
        steps(&mut criterion);
        criterion.final_summary();
    });
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group(format!("sheets, {} threads", par::threads()));
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2));
    for case in CASES {
        for side in [32, 100, 316, 1000] {
            let n = u64::from(side);
            let structural = 2 * n * (n - 1) + if case.mesh { (n - 1).pow(2) } else { 0 };
            let springs = structural + if case.shear { 2 * (n - 1).pow(2) } else { 0 };
            group.throughput(Throughput::Elements(springs));
            // Built only if the filter selects it: a million points take seconds.
            let mut built = None;
            group.bench_function(format!("{}, {side}² points", case.name), |b| {
                let (sheets, dt) = built.get_or_insert_with(|| {
                    let sheets = sheets(side, case.terms, case.mesh);
                    let dt = 0.4 * sheets.max_stable_step();
                    (sheets, dt)
                });
                b.iter(|| sheets.step(0.0, *dt).expect("it is stable"));
            });
        }
    }
    let mut built = None;
    group.bench_function("implicit, 316² points", |b| {
        let sheets = built.get_or_insert_with(|| sheets(316, IMPLICIT, false));
        b.iter(|| sheets.step(0.0, 1.0 / 192.0).expect("it is stable"));
    });
    group.finish();
}
