//! Nanoseconds a node of the Eikonal solves, and the error that they buy. `cargo bench --bench eikonal`.
//!
//! A ball of a fifth of the side in a box of 256³ nodes; for some rows seven balls off its middle. Criterion's throughput is in nodes a second, compared with the plain
//! serial sweep. Before that, a table of error against time for orders, seeds, bands and blocks is printed: each row is the
//! mean of as many solves as fill a second, in CPU time of the whole process, so other work on the machine hardly shows.

#[path = "reference/balls.rs"]
mod balls;
#[path = "reference/dense.rs"]
mod dense;

use balls::seven_balls;
use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use dense::{DenseGrid, DenseParams, Pins, pin_band, pin_surface, solve};
use meniscus::{
    grid::{BRICK_NODES, SparseGrid, node_of},
    math::Vec3,
    par,
    sdf::{
        self, Order, SdfParams, SeedRule,
        dense::{BLOCK, sweep_in_order},
    },
};
use std::{hint::black_box, time::Instant};

const NODES: usize = 256;
const RADIUS: f32 = 0.2 * NODES as f32;
const FULL: f32 = f32::INFINITY;

/// The distance to the ball [voxels], about a middle that is no node.
fn exact(x: Vec3) -> f32 {
    (x - Vec3::new(0.31, -0.17, 0.05)).norm() - RADIUS
}

/// A field whose level 1 is the ball.
fn density(x: Vec3) -> f32 {
    (-exact(x) / RADIUS).exp()
}

const HALF: i32 = NODES as i32 / 2;

fn sampled(f: impl Fn(Vec3) -> f32 + Sync) -> DenseGrid {
    DenseGrid::sample(1.0, [-HALF; 3], [NODES; 3], f)
}

/// CPU seconds of this process, user and system, where the system reports them; else wall seconds.
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

/// Mean and largest error [voxels] over nodes that have a distance below `band`.
fn errors(found: impl Iterator<Item = (f32, f32)>, band: f32) -> (usize, f64, f32) {
    let (mut count, mut sum, mut worst) = (0, 0.0, 0.0_f32);
    for (value, exact) in found {
        if value.abs() < band {
            let error = (value.abs() - exact.abs()).abs();
            count += 1;
            sum += f64::from(error);
            worst = worst.max(error);
        }
    }
    (count, sum / count as f64, worst)
}

/// Prints a row: CPU and wall time a node with a distance, and the errors.
fn row<T>(name: &str, band: f32, mut run: impl FnMut() -> T, judge: impl Fn(T) -> (usize, f64, f32)) {
    // The system counts in hundredths of a second: a single short solve would be all rounding.
    let start = Instant::now();
    let before = cpu_seconds(start);
    let (mut found, mut times, mut cpu) = (None, 0, 0.0);
    while cpu < 1.0 {
        drop(found.take());
        found = Some(black_box(run()));
        times += 1;
        cpu = cpu_seconds(start) - before;
    }
    let wall = start.elapsed().as_secs_f64();
    let (count, mean, worst) = judge(found.expect("it was solved"));
    let each = 1e9 / (count as f64 * f64::from(times));
    println!(
        "| {name} | {band} | {count} | {:.1} | {:.1} | {mean:.4} | {worst:.3} |",
        cpu * each,
        wall * each
    );
}

fn table(_: &mut Criterion) {
    let level = sampled(exact);
    let field = sampled(density);
    let judge = |found: sdf::Swept, band: f32| {
        errors(found.distance.into_iter().zip(level.values.iter().copied()), band)
    };
    println!(
        "| grid, order, seed, block, threads | band [voxels] | nodes | CPU ns | wall ns | mean error [voxels] | largest |"
    );
    println!("|---|---|---|---|---|---|---|");
    let band_pins = pin_band(&level, 3.0);
    row(
        "dense, first, exact band, plain serial sweep, 1",
        FULL,
        || sweep_in_order(level.nodes, &band_pins.distance, FULL),
        |found| judge(found, FULL),
    );
    let dense = |name: &str, pins: &Pins, order: Order, block: [usize; 3], band: f32, threads: usize| {
        let params = DenseParams { order, block, band };
        row(
            &format!("dense, {order:?}, {name}, {block:?}, {threads}"),
            band,
            || par::with_threads(threads, || solve(level.nodes, pins, &params)),
            |found| judge(found, band),
        );
    };
    let plane = pin_surface(&field, 1.0, SeedRule::Plane);
    let edge = pin_surface(&field, 1.0, SeedRule::NearestEdge);
    for order in [Order::First, Order::Second] {
        dense("exact band", &band_pins, order, BLOCK, FULL, 1);
        dense("exact band", &band_pins, order, BLOCK, FULL, 2);
        dense("plane", &plane, order, BLOCK, FULL, 1);
        dense("nearest edge", &edge, order, BLOCK, FULL, 1);
        for block in [[8; 3], [16; 3], [32; 3], [64; 3], [128, 16, 16], [256, 8, 8]] {
            dense("exact band", &band_pins, order, block, FULL, 1);
        }
        for band in [3.0, 6.0, 12.0, 24.0] {
            dense("plane", &plane, order, BLOCK, band, 1);
        }
    }
    // A field as the density of particles: 1 inside, 0 outside, and a ramp of four voxels between them.
    let ramp = sampled(|x| (0.5 - exact(x) / 4.0).clamp(0.0, 1.0));
    for rule in [SeedRule::Plane, SeedRule::NearestEdge, SeedRule::DensityRatio] {
        let pins = pin_surface(&ramp, 0.5, rule);
        for order in [Order::First, Order::Second] {
            for band in [3.0, FULL] {
                dense(&format!("ramp, {rule:?}"), &pins, order, BLOCK, band, 1);
            }
        }
    }
    drop((field, ramp));
    // Inside overlapping balls the smallest distance is not that to the surface, so errors are of the nodes outside.
    let balls = sampled(|x| seven_balls(x, NODES));
    let band_pins = pin_band(&balls, 3.0);
    for (order, threads) in [(Order::First, 1), (Order::First, 2), (Order::Second, 1), (Order::Second, 2)] {
        let params = DenseParams { order, ..DenseParams::default() };
        row(
            &format!("dense, {order:?}, seven balls, exact band, {BLOCK:?}, {threads}"),
            FULL,
            || par::with_threads(threads, || solve(balls.nodes, &band_pins, &params)),
            |found| {
                let pairs = found.distance.into_iter().zip(balls.values.iter().copied());
                let (_, mean, worst) = errors(pairs.filter(|(_, exact)| *exact > 0.0), FULL);
                (balls.values.len(), mean, worst)
            },
        );
    }
    let bricks =
        SparseGrid::sample(1.0, Vec3::repeat(-HALF as f32), Vec3::repeat(HALF as f32 - 1.0), density);
    for order in [Order::First, Order::Second] {
        for band in [3.0, 6.0, 12.0, 24.0, FULL] {
            let params = SdfParams { order, band, ..SdfParams::default() };
            row(
                &format!("bricks, {order:?}, plane, seeds included, 1"),
                band,
                || par::with_threads(1, || sdf::from_density(&bricks, 1.0, &params)),
                |found| {
                    let coords = found.grid.bricks.coords();
                    let node = |i: usize| node_of(coords[i / BRICK_NODES], i % BRICK_NODES);
                    let pair = |(i, value): (usize, &f32)| (*value, exact(found.grid.position(node(i))));
                    errors(found.grid.values.iter().enumerate().map(pair), band)
                },
            );
        }
    }
}

fn solves(c: &mut Criterion) {
    let level = sampled(exact);
    let pins = pin_band(&level, 3.0);
    let mut group = c.benchmark_group("eikonal, 256³ from a band");
    group.sampling_mode(SamplingMode::Flat).sample_size(10);
    group.throughput(Throughput::Elements(pins.distance.len() as u64));
    group.bench_function("first order, plain serial sweep", |b| {
        b.iter(|| sweep_in_order(level.nodes, black_box(&pins.distance), FULL));
    });
    for order in [Order::First, Order::Second] {
        for threads in [1, 2] {
            let params = DenseParams { order, ..DenseParams::default() };
            group.bench_function(format!("{order:?} order, {threads} threads"), |b| {
                b.iter_custom(|times| {
                    par::with_threads(threads, || {
                        let start = Instant::now();
                        (0..times).for_each(|_| drop(black_box(solve(level.nodes, &pins, &params))));
                        start.elapsed()
                    })
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, table, solves);
criterion_main!(benches);
