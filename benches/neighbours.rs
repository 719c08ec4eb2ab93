//! Times the neighbour search on disordered blocks of 100 000 and of 1 000 000 particles, on 1 and on 2 threads.
//!
//! `cargo bench --bench neighbours`. Particles are jittered from a regular arrangement, sorted as the solver sorts them once a
//! frame, and moved a little since; lists reach 1.1 h, h = 2 spacings, which gives about 42 entries a particle.

use criterion::{BenchmarkId, Criterion, Throughput};
use meniscus::{
    math::Vec3,
    par,
    space::{CellGrid, Neighbours},
};
use std::{hint::black_box, time::Duration};

const SPACING: f32 = 0.01;
const REACH: f32 = 2.2 * SPACING;

/// A number in -1..1 without order in `i`.
fn noise(i: u64) -> f32 {
    let mut x = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (x >> 40) as f32 / (1 << 23) as f32 - 1.0
}

/// A cube of `n` particles along an edge.
fn block(n: usize) -> Vec<Vec3> {
    let jittered = |k: usize| {
        let at = [k % n, k / n % n, k / (n * n)];
        Vec3::from_fn(|axis, _| (at[axis] as f32 + 0.5 + 0.4 * noise((3 * k + axis) as u64)) * SPACING)
    };
    let positions: Vec<Vec3> = (0..n * n * n).map(jittered).collect();
    let grid = CellGrid::new(&positions, 2.0 * SPACING);
    let moved = |(k, &i): (usize, &u32)| {
        positions[i as usize]
            .map_with_location(|axis, _, x| x + 0.15 * SPACING * noise(7_000_000_000 + (3 * k + axis) as u64))
    };
    grid.order().iter().enumerate().map(moved).collect()
}

fn main() {
    for n in [46, 100] {
        let positions = block(n);
        for threads in [1, 2] {
            par::with_threads(threads, || {
                let mut criterion = Criterion::default().configure_from_args();
                search(&mut criterion, &positions, threads);
                criterion.final_summary();
            });
        }
    }
}

fn search(criterion: &mut Criterion, positions: &[Vec3], threads: usize) {
    let mut group = criterion.benchmark_group(format!("{} particles", positions.len()));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(5));
    group.throughput(Throughput::Elements(positions.len() as u64));
    let mut grid = CellGrid::default();
    group.bench_function(BenchmarkId::new("sort into cells", threads), |b| {
        b.iter(|| grid.rebuild(black_box(positions), REACH));
    });
    let mut lists = Neighbours::default();
    group.bench_function(BenchmarkId::new("list neighbours", threads), |b| {
        b.iter(|| lists.rebuild(&grid, black_box(positions), REACH));
    });
    group.finish();
}
