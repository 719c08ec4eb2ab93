//! Seconds and errors of velocities that vortons induce. `cargo bench --bench vortex`; with `-- threads` the last table
//! alone, with `-- kept` the errors over the requested ones, with `-- fields` what a ring induces in two planes, for
//! `tools/bench/vortex_figure.py`.
//!
//! Four clouds of vortons whose cores are one and a half spacings: a ring of radius 1 m and a tenth of that thick; a cube of
//! random strengths, the worst case, because distant contributions cancel; a thin wavy sheet; thirty blobs, dense in the
//! middle. Before criterion measures, tables are printed of the requested error, the one reached (relative L2 of the
//! velocity at 400 vortons against the sum over all pairs), and the time: each row is the minimum of up to five batches of
//! as many evaluations as fill a fifth of a second, in CPU time of the whole process on one thread. Then the time against
//! the number of vortons, the Poisson equation by itself, and wall seconds by number of threads.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use meniscus::{
    math::Vec3,
    par,
    sim::vortex::{
        Kernel, Method, Quantity, Targets, UniformGrid, VectorField, Vortons, boundary_values, choose_grid,
        grid_errors, induced, multigrid_poisson, poisson, sampled_error,
    },
};
use std::{f64::consts::PI, hint::black_box, time::Instant};

/// A number in 0..1 without order in `i`.
fn noise(i: usize) -> f64 {
    let mut x = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

type Double = nalgebra::Vector3<f64>;

/// A cloud by name.
fn cloud(name: &str, count: usize) -> Vortons {
    let volume: f64 = match name {
        "ring" => 2.0 * PI * PI * 0.01,
        "cube" => 1.0,
        "sheet" => 0.02,
        _ => 0.05,
    };
    let mut vortons =
        Vortons { core: vec![(1.5 * (volume / count as f64).cbrt()) as f32; count], ..Vortons::default() };
    for i in 0..count {
        let (x, strength) = vorton(name, |k| noise(16 * i + k));
        vortons.position.push(x.cast());
        vortons.strength.push((strength / count as f64).cast());
    }
    vortons
}

/// Place and direction of a vorton, from its numbers in 0..1.
fn vorton(name: &str, r: impl Fn(usize) -> f64) -> (Double, Double) {
    let any = Double::new(r(3) - 0.5, r(4) - 0.5, r(5) - 0.5);
    match name {
        "ring" => {
            let (t, p, a) = (2.0 * PI * r(0), 2.0 * PI * r(1), 0.1 * r(2).sqrt());
            let around = Double::new(t.cos(), t.sin(), 0.0);
            (around * (1.0 + a * p.cos()) + Double::z() * (a * p.sin()), Double::z().cross(&around))
        }
        "cube" => (Double::new(r(0), r(1), r(2)), any),
        "sheet" => {
            let z = 0.2 * (6.0 * r(0)).sin() * (4.0 * r(1)).cos() + 0.02 * (r(2) - 0.5);
            (Double::new(r(0), r(1), z), Double::new((6.0 * r(1)).sin(), (5.0 * r(0)).cos(), 0.2))
        }
        _ => {
            let blob = 7 * (r(0) * 30.0) as usize + 900_000_000;
            let middle = Double::new(noise(blob), noise(blob + 1), noise(blob + 2));
            (middle + any.normalize() * 0.15 * r(1).powi(2), Double::new(r(6) - 0.5, r(7) - 0.5, r(8) - 0.5))
        }
    }
}

/// CPU seconds of this process, where the system reports them; else wall seconds.
fn cpu_seconds(start: Instant) -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let of = |thread: std::fs::DirEntry| -> Option<u64> {
        std::fs::read_to_string(thread.path().join("schedstat")).ok()?.split(' ').next()?.parse().ok()
    };
    let nanoseconds: u64 = threads.filter_map(of).sum();
    if nanoseconds > 0 { nanoseconds as f64 * 1e-9 } else { start.elapsed().as_secs_f64() }
}

/// The result of a job, and its CPU seconds: the minimum of five batches, each of as many runs as the system's clock of some
/// milliseconds resolves; of fewer batches where they fill a second.
fn repeated<T>(mut job: impl FnMut() -> T) -> (T, f64) {
    let start = Instant::now();
    let (mut found, mut runs) = (None, 1);
    let mut batch = |runs: u32| {
        let before = cpu_seconds(start);
        (0..runs).for_each(|_| found = Some(job()));
        cpu_seconds(start) - before
    };
    let mut fastest = batch(runs);
    while fastest < 0.2 {
        runs *= 2;
        fastest = batch(runs);
    }
    let mut whole = fastest;
    for _ in 1..5 {
        if whole < 1.0 {
            let spent = batch(runs);
            (fastest, whole) = (fastest.min(spent), whole + spent);
        }
    }
    (found.expect("it ran"), fastest / f64::from(runs))
}

/// The velocities, and their CPU seconds.
fn timed(vortons: &Vortons, quantity: Quantity, kernel: Kernel, method: Method) -> (Vec<Vec3>, f64) {
    let (found, seconds) =
        repeated(|| induced(vortons, Targets::Vortons, quantity, kernel, method).expect("they are fit"));
    (found.velocity, seconds)
}

fn row(name: &str, vortons: &Vortons, quantity: Quantity, kernel: Kernel, method: Method) {
    let found = timed(vortons, quantity, kernel, method);
    print_row(name, vortons, kernel, &format!("{quantity:?} | {method:?}"), found);
}

/// Prints the velocities, if there are any, as an error, and their CPU seconds.
fn print_row(name: &str, vortons: &Vortons, kernel: Kernel, method: &str, found: (Vec<Vec3>, f64)) {
    let (velocity, seconds) = found;
    let error = match velocity.is_empty() {
        true => f64::NAN,
        false => sampled_error(vortons, Targets::Vortons, kernel, &velocity, 400).expect("they are fit"),
    };
    let count = vortons.len();
    println!("| {name} | {count} | {kernel:?} | {method} | {seconds:.4} | {error:.1e} |");
}

/// Prints the reached over the requested error, by cloud, size, kernel and method.
fn kept() {
    println!(
        "| cloud | vortons | kernel | tree, 1e-2 | tree, 1e-3 | tree, 1e-4 | tree, 1e-5 | grid, 1e-2 | grid, 1e-3 |\n|---|---|---|---|---|---|---|---|---|"
    );
    for count in [8000, 30_000, 100_000, 300_000] {
        for name in ["ring", "cube", "sheet", "blobs"] {
            let vortons = cloud(name, count);
            for kernel in [Kernel::WinckelmansLeonard, Kernel::Ball, Kernel::RosenheadMoore, Kernel::Gaussian]
            {
                let missed = |error: f32, method| {
                    let found = induced(&vortons, Targets::Vortons, Quantity::Velocity, kernel, method);
                    let velocity = found.expect("they are fit").velocity;
                    let missed = sampled_error(&vortons, Targets::Vortons, kernel, &velocity, 200);
                    missed.expect("they are fit") / f64::from(error)
                };
                print!("| {name} | {count} | {kernel:?}");
                for error in [1e-2, 1e-3, 1e-4, 1e-5] {
                    print!(" | {:.2}", missed(error, Method::Tree { error }));
                }
                for error in [1e-2, 1e-3] {
                    match grid_errors(kernel).contains(&error) {
                        true => print!(" | {:.2}", missed(error, Method::Grid { error })),
                        false => print!(" | "),
                    }
                }
                println!(" |");
            }
        }
    }
}

/// Prints the tables.
fn tables() {
    use Quantity::{Potential, Velocity, VelocityAndGradient};
    println!(
        "| cloud | vortons | kernel | quantity | method | CPU s | error |\n|---|---|---|---|---|---|---|"
    );
    let kernel = Kernel::default();
    for name in ["ring", "cube", "sheet", "blobs"] {
        let vortons = cloud(name, 100_000);
        for error in [1e-1, 1e-2, 1e-3, 1e-4, 1e-5] {
            row(name, &vortons, Velocity, kernel, Method::Tree { error });
        }
        row(name, &vortons, VelocityAndGradient, kernel, Method::Tree { error: 1e-3 });
        row(name, &vortons, Potential, kernel, Method::Tree { error: 1e-3 });
        row(name, &vortons, Velocity, kernel, Method::Grouping);
        for kernel in [Kernel::Ball, Kernel::RosenheadMoore, Kernel::Gaussian] {
            row(name, &vortons, Velocity, kernel, Method::Tree { error: 1e-3 });
        }
    }
    for name in ["ring", "cube"] {
        let vortons = cloud(name, 100_000);
        for error in [1e-1, 1e-2, 1e-3] {
            row(name, &vortons, Velocity, kernel, Method::Grid { error });
        }
        row(name, &vortons, VelocityAndGradient, kernel, Method::Grid { error: 1e-2 });
        for error in [1e-2, 1e-3] {
            row(name, &vortons, Velocity, Kernel::Gaussian, Method::Grid { error });
        }
        row(name, &vortons, Velocity, Kernel::Gaussian, Method::Multigrid);
        row(name, &vortons, Velocity, Kernel::Gaussian, Method::Tree { error: 1e-2 });
    }
    row("cube", &cloud("cube", 1_000_000), Velocity, kernel, Method::Tree { error: 1e-3 });
}

/// Prints the time of the three methods against the number of vortons.
fn crossovers() {
    println!(
        "\n| cloud | kernel | vortons | all pairs | tree, 1e-2 | grid, 1e-2 | cells | tree, 1e-3 | grid, 1e-3 | cells |"
    );
    println!("|---|---|--:|--:|--:|--:|---|--:|--:|---|");
    for (name, kernel) in [
        ("ring", Kernel::WinckelmansLeonard),
        ("cube", Kernel::WinckelmansLeonard),
        ("ring", Kernel::Gaussian),
        ("cube", Kernel::Gaussian),
    ] {
        for count in [1000, 3000, 10_000, 30_000, 100_000, 300_000, 1_000_000] {
            let vortons = cloud(name, count);
            let seconds = |method| format!("{:.4}", timed(&vortons, Quantity::Velocity, kernel, method).1);
            let pairs = if count > 100_000 { "".into() } else { seconds(Method::Direct) };
            let mut cells = format!("| {name} | {kernel:?} | {count} | {pairs} ");
            for error in [1e-2, 1e-3] {
                let tree = seconds(Method::Tree { error });
                let (grid, taken) = match choose_grid(&vortons, count, kernel, error) {
                    Some(grid) => {
                        (seconds(Method::Grid { error }), grid.cells.map(|n| n.to_string()).join("×"))
                    }
                    None => ("".into(), "the tree serves".into()),
                };
                cells += &format!("| {tree} | {grid} | {taken} ");
            }
            println!("{cells}|");
        }
    }
}

/// Prints the time of the Poisson equation with boundary values of a ring of 100 000 vortons, and its error
/// on a ring of 48.
fn equations() {
    println!(
        "\n| cells | solver | boundary values, CPU s | equation, CPU s | A missed |\n|---|---|--:|--:|--:|"
    );
    for n in [64, 128, 256] {
        let low = Vec3::new(-1.8, -1.8, -1.8);
        let grid = UniformGrid { low, spacing: 3.6 / n as f32, cells: [n; 3] };
        let (large, small) = (cloud("ring", 100_000), wide_ring());
        let mut field = VectorField::new(grid);
        let (_, boundary) = repeated(|| {
            boundary_values(&mut field, &large, Kernel::default(), 1e-4).expect("they are fit");
        });
        fill(&mut field, &small);
        boundary_values(&mut field, &small, Kernel::default(), 1e-4).expect("they are fit");
        type NamedSolver = (&'static str, fn(&mut VectorField));
        let solvers: [NamedSolver; 2] = [("sines", poisson), ("multigrid", multigrid_poisson)];
        for (solver, solve) in solvers {
            // Every run starts from the same field; its copy is timed too.
            let (solved, seconds) = repeated(|| {
                let mut field = field.clone();
                solve(&mut field);
                field
            });
            let nodes: Vec<[usize; 3]> =
                (0..400).map(|i| [3, 5, 7].map(|k| 1 + (noise(k * i) * (n - 1) as f64) as usize)).collect();
            let points: Vec<Vec3> = nodes.iter().map(|&at| grid.node(at)).collect();
            let at = Targets::Points(&points);
            let exact = induced(&small, at, Quantity::Potential, Kernel::default(), Method::Direct)
                .expect("they are fit");
            let (mut missed, mut whole) = (0.0, 0.0);
            for (&at, exact) in nodes.iter().zip(&exact.potential) {
                missed += f64::from((solved.at(at) - exact).norm_squared());
                whole += f64::from(exact.norm_squared());
            }
            println!(
                "| {n}³ | {solver} | {boundary:.3} | {seconds:.3} | {:.1e} |",
                f64::sqrt(missed / whole)
            );
        }
    }
}

/// Forty-eight vortons with cores of a fifth of the ring's radius.
fn wide_ring() -> Vortons {
    let mut ring = Vortons { core: vec![0.2; 48], ..Vortons::default() };
    for i in 0..48 {
        let t = (2.0 * PI * f64::from(i) / 48.0) as f32;
        ring.position.push(Vec3::new(t.cos(), t.sin(), 0.0));
        ring.strength.push(Vec3::new(-t.sin(), t.cos(), 0.0));
    }
    ring
}

/// The vorticity of Winckelmans and Leonard's cores at every node: 15/(8π σ³) (ρ² + 1)^-7/2.
fn fill(field: &mut VectorField, vortons: &Vortons) {
    let grid = field.grid;
    for z in 0..=grid.cells[2] {
        for y in 0..=grid.cells[1] {
            for x in 0..=grid.cells[0] {
                let at = grid.node([x, y, z]);
                let vorticity = (0..vortons.len()).map(|i| {
                    let s2 = vortons.core[i].powi(2);
                    let q = 1.0 / ((at - vortons.position[i]).norm_squared() / s2 + 1.0);
                    vortons.strength[i] * (0.596_831 * q * q * q * q.sqrt() / (s2 * vortons.core[i]))
                });
                field.set([x, y, z], vorticity.sum());
            }
        }
    }
}

/// Prints wall seconds by number of threads: the minimum of five.
fn by_threads() {
    let ring = cloud("ring", 100_000);
    println!(
        "\n| threads | all pairs, 10 000 | potential, tree 1e-3 | velocity, tree 1e-3 | velocity, grid 1e-2 |"
    );
    println!("|--:|--:|--:|--:|--:|");
    for threads in [1, 2, 4] {
        let fastest = |vortons: &Vortons, quantity, method| {
            let runs = (0..5).map(|_| {
                let start = Instant::now();
                par::with_threads(threads, || {
                    black_box(
                        induced(vortons, Targets::Vortons, quantity, Kernel::default(), method).expect("fit"),
                    )
                });
                start.elapsed().as_secs_f64()
            });
            runs.fold(f64::INFINITY, f64::min)
        };
        let pairs = fastest(&cloud("ring", 10_000), Quantity::Velocity, Method::Direct);
        let potential = fastest(&ring, Quantity::Potential, Method::Tree { error: 1e-3 });
        let tree = fastest(&ring, Quantity::Velocity, Method::Tree { error: 1e-3 });
        let grid = fastest(&ring, Quantity::Velocity, Method::Grid { error: 1e-2 });
        println!("| {threads} | {pairs:.4} | {potential:.4} | {tree:.4} | {grid:.4} |");
    }
}

/// Prints vorticity, potential and velocity of a ring in the plane of the ring and in one through its axis:
/// the plane's number, two coordinates, and nine components.
fn fields() {
    let ring = cloud("ring", 20_000);
    let mut points = Vec::new();
    for plane in 0..2 {
        for j in 0..49 {
            for i in 0..49 {
                let (u, v) = (-1.6 + i as f32 / 15.0, -1.6 + j as f32 / 15.0);
                points.push(if plane == 0 { Vec3::new(u, v, 0.0) } else { Vec3::new(u, 0.0, v) });
            }
        }
    }
    let find = |quantity| {
        let method = Method::Tree { error: 1e-4 };
        induced(&ring, Targets::Points(&points), quantity, Kernel::default(), method).expect("they are fit")
    };
    let (potential, both) = (find(Quantity::Potential).potential, find(Quantity::VelocityAndGradient));
    for (i, (x, a)) in points.iter().zip(&potential).enumerate() {
        let (u, g) = (both.velocity[i], both.gradient[i]);
        let w = Vec3::new(g[(2, 1)] - g[(1, 2)], g[(0, 2)] - g[(2, 0)], g[(1, 0)] - g[(0, 1)]);
        let plane = i / (49 * 49);
        println!(
            "{plane} {} {} {} {} {} {} {} {} {} {} {} {}",
            x.x, x.y, x.z, w.x, w.y, w.z, a.x, a.y, a.z, u.x, u.y, u.z
        );
    }
}

fn bench(criterion: &mut Criterion) {
    let has_arg = |what: &str| std::env::args().any(|word| word == what);
    if has_arg("fields") {
        return fields();
    }
    if has_arg("kept") {
        return kept();
    }
    if has_arg("threads") {
        return by_threads();
    }
    par::with_threads(1, || {
        tables();
        crossovers();
        equations();
    });
    by_threads();
    let mut group = criterion.benchmark_group("vortons");
    group.sample_size(10).sampling_mode(SamplingMode::Flat).throughput(Throughput::Elements(100_000));
    for name in ["ring", "cube"] {
        let vortons = cloud(name, 100_000);
        for threads in [1, 2] {
            group.bench_function(format!("{name}, {threads} threads"), |b| {
                par::with_threads(threads, || {
                    let method = Method::Tree { error: 1e-3 };
                    let find =
                        || induced(&vortons, Targets::Vortons, Quantity::Velocity, Kernel::default(), method);
                    b.iter(|| black_box(find()));
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
