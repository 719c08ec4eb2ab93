//! Particles → density → seeds → sweeps, timed. `cargo bench --bench surface_field`.
//!
//! Throughput is in particles a second for the density, and in nodes (cells) a second for the rest.

use criterion::{Criterion, SamplingMode, Throughput, criterion_group, criterion_main};
use meniscus::field::{DensityParams, density};
use meniscus::grid::SparseGrid;
use meniscus::math::Vec3;
use meniscus::par::with_threads;
use meniscus::sdf::{SdfParams, seeds, sweep};
use std::hint::black_box;
use std::time::Duration;

/// A cube of particles, `n` along an edge, spacing 1.
fn block(n: usize) -> Vec<Vec3> {
    (0..n * n * n).map(|i| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / (n * n)) as f32)).collect()
}

/// A ball in a box of `nodes`³ nodes: the field whose level 1 is the sphere.
fn ball(nodes: usize) -> SparseGrid {
    let half = nodes as f32 / 2.0;
    SparseGrid::sample(1.0, Vec3::repeat(-half), Vec3::repeat(half - 1.0), |x| {
        1.0 + (0.7 * half - x.norm()) / half
    })
}

fn densities(c: &mut Criterion) {
    let positions = block(47);
    let params =
        DensityParams { spacing: 1.0, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: false };
    let mut group = c.benchmark_group("density_104k");
    group.sampling_mode(SamplingMode::Flat).sample_size(10).measurement_time(Duration::from_secs(4));
    group.throughput(Throughput::Elements(positions.len() as u64));
    for threads in [1, 2] {
        group.bench_function(format!("{threads}_threads"), |b| {
            with_threads(threads, || b.iter(|| density(black_box(&positions), &params)));
        });
    }
    group.finish();
}

fn distances(c: &mut Criterion) {
    let field = ball(256);
    for (name, band) in [("band_3", 3.0), ("full", f32::INFINITY)] {
        let params = SdfParams { band, ..SdfParams::default() };
        let mut group = c.benchmark_group(format!("sdf_256_{name}"));
        group.sampling_mode(SamplingMode::Flat).sample_size(10).measurement_time(Duration::from_secs(4));
        let found = seeds(&field, 1.0, &params);
        group.throughput(Throughput::Elements(field.values.len() as u64));
        for threads in [1, 2] {
            group.bench_function(format!("seeds_{threads}_threads"), |b| {
                with_threads(threads, || b.iter(|| seeds(black_box(&field), 1.0, &params)));
            });
        }
        group.throughput(Throughput::Elements(found.distance.len() as u64));
        for threads in [1, 2] {
            group.bench_function(format!("sweeps_{threads}_threads"), |b| {
                with_threads(threads, || {
                    b.iter(|| sweep(black_box(&found.bricks), &found.distance, band, 1))
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, densities, distances);
criterion_main!(benches);
