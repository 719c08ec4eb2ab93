//! Seconds and errors of what vortons induce. `cargo bench --bench vortex`.
//!
//! Four clouds of vortons whose cores are one and a half spacings: a ring of radius 1 m and a tenth of that thick; a cube of
//! random strengths, the worst case, because little is left of what is far; a thin wavy sheet; thirty blobs, dense in the middle.
//! Before criterion measures, tables are printed of the error that was asked for, the one reached (relative L2 of the velocity at
//! 400 vortons against the sum over all pairs), and the time: each row is the mean of as many evaluations as fill a second, in CPU
//! time of the whole process on one thread.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use meniscus::{
    math::Vec3,
    par,
    sim::vortex::{Kernel, Method, Quantity, Targets, Vortons, induced, sampled_error},
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

/// CPU seconds of this process, user and system, where the system tells; else wall seconds.
fn cpu_seconds(start: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(") ").next().unwrap_or_default();
    let ticks: Option<Vec<f64>> =
        after_name.split(' ').skip(11).take(2).map(|field| field.parse().ok()).collect();
    match ticks.as_deref() {
        Some([user, system]) => (user + system) / 100.0, // Linux counts hundredths here
        _ => start.elapsed().as_secs_f64(),
    }
}

/// The velocities, and the mean CPU seconds of as many evaluations as fill a second.
fn timed(vortons: &Vortons, quantity: Quantity, kernel: Kernel, method: Method) -> (Vec<Vec3>, f64) {
    let start = Instant::now();
    let (before, mut runs) = (cpu_seconds(start), 0.0);
    loop {
        let found = induced(vortons, Targets::Vortons, quantity, kernel, method).expect("they are fit");
        runs += 1.0;
        let spent = cpu_seconds(start) - before;
        if spent > 1.0 {
            return (found.velocity, spent / runs);
        }
    }
}

fn row(name: &str, vortons: &Vortons, quantity: Quantity, kernel: Kernel, method: Method) {
    let (velocity, seconds) = timed(vortons, quantity, kernel, method);
    let error = match velocity.is_empty() {
        true => f64::NAN,
        false => sampled_error(vortons, Targets::Vortons, kernel, &velocity, 400).expect("they are fit"),
    };
    let count = vortons.len();
    println!("| {name} | {count} | {kernel:?} | {quantity:?} | {method:?} | {seconds:.4} | {error:.1e} |");
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
        row(name, &vortons, Velocity, kernel, Method::Nested);
        for kernel in [Kernel::Ball, Kernel::RosenheadMoore, Kernel::Gaussian] {
            row(name, &vortons, Velocity, kernel, Method::Tree { error: 1e-3 });
        }
    }
    for count in [1000, 2000, 4000, 10_000, 100_000] {
        let vortons = cloud("cube", count);
        row("cube", &vortons, Velocity, kernel, Method::Direct);
        for error in [1e-3, 1e-4] {
            row("cube", &vortons, Velocity, kernel, Method::Tree { error });
        }
    }
    row("cube", &cloud("cube", 1_000_000), Velocity, kernel, Method::Tree { error: 1e-3 });
    row("ring", &cloud("ring", 1_000_000), Velocity, kernel, Method::Tree { error: 1e-3 });
}

fn bench(criterion: &mut Criterion) {
    par::with_threads(1, tables);
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
