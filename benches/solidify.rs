//! Sampling the distance to a mesh of a million triangles.

use criterion::{Criterion, criterion_group, criterion_main};
use meniscus::{
    math::Vec3,
    sdf::{Triangles, from_triangles},
};
use std::{f32::consts::TAU, hint::black_box};

/// A torus with a rippled surface of 2 · nu · nv triangles.
fn torus(nu: u32, nv: u32) -> Triangles {
    let mut mesh = Triangles::default();
    for j in 0..nv {
        for i in 0..nu {
            let (a, b) = (TAU * i as f32 / nu as f32, TAU * j as f32 / nv as f32);
            let tube = 0.35 + 0.02 * (9.0 * a).sin() * (5.0 * b).cos();
            let r = 1.0 + tube * b.cos();
            mesh.positions.push(Vec3::new(r * a.cos(), r * a.sin(), tube * b.sin()));
            let corner = |i: u32, j: u32| i % nu + nu * (j % nv);
            let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

fn solidify(c: &mut Criterion) {
    let mut group = c.benchmark_group("solidify");
    group.sample_size(10);
    for (name, nu, nv) in [("20 000 triangles, 128", 200, 50), ("1 000 000 triangles, 128", 1000, 500)] {
        let mesh = torus(nu, nv);
        group.bench_function(name, |b| b.iter(|| from_triangles(black_box(&mesh), 128)));
    }
    group.finish();
}

criterion_group!(benches, solidify);
criterion_main!(benches);
