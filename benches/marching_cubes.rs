//! Nanoseconds a triangle of the passes from a signed distance to a checked mesh with normals, and of writing it.
//!
//! `cargo bench --bench marching_cubes`: the throughput line reads in triangles a second. The field is a torus on
//! a narrow band of bricks, about 200 000 triangles.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use meniscus::{
    export,
    frame::{Channel, Stream, StreamKind},
    grid::{BRICK, BRICK_NODES, Bricks, SparseGrid, offset},
    mesh::{
        ComponentParams, DecimationParams, SmoothingParams, check, decimate, marching_cubes,
        normals_from_field, remove_small, smooth, transfer,
    },
    par,
};
use std::{hint::black_box, time::Instant};

const VOXEL: f32 = 0.01;

/// Signed distance to a torus in the XY plane [m].
fn torus(x: [f32; 3]) -> f32 {
    (x[0].hypot(x[1]) - 0.6).hypot(x[2]) - 0.25
}

fn field() -> SparseGrid {
    let bricks = 12;
    let brick_size = BRICK as f32 * VOXEL;
    let mut coords = Vec::new();
    for z in -bricks..bricks {
        for y in -bricks..bricks {
            let near = |x: &i32| torus([*x, y, z].map(|i| (i as f32 + 0.5) * brick_size)).abs() < brick_size;
            coords.extend((-bricks..bricks).filter(near).map(|x| [x, y, z]));
        }
    }
    let mut grid = SparseGrid::new(VOXEL, Bricks::new(coords), 0.0);
    for brick in 0..grid.bricks.len() {
        let coord = grid.bricks.coords()[brick];
        for node in 0..BRICK_NODES {
            let local = [node % BRICK, node / BRICK % BRICK, node / (BRICK * BRICK)];
            let x = std::array::from_fn(|d| (coord[d] * BRICK as i32 + local[d] as i32) as f32 * VOXEL);
            grid.values[brick * BRICK_NODES + offset(local)] = torus(x);
        }
    }
    grid
}

fn surface(c: &mut Criterion) {
    let grid = field();
    let (mut mesh, _) = marching_cubes(&grid);
    let mut group = c.benchmark_group(format!("surface, {} triangles", mesh.triangles.len()));
    group.throughput(Throughput::Elements(mesh.triangles.len() as u64)).sample_size(20);
    let mut measure = |name: &str, threads: usize, pass: &(dyn Fn() + Sync)| {
        group.bench_function(format!("{name}, {threads} threads"), |b| {
            b.iter_custom(|times| {
                par::with_threads(threads, || {
                    let start = Instant::now();
                    (0..times).for_each(|_| pass());
                    start.elapsed()
                })
            });
        });
    };
    let particles = Stream::new("liquid", StreamKind::Particles, mesh.positions.len())
        .with("position", mesh.positions.clone())
        .with("velocity", mesh.positions.clone());
    for threads in [1, 2] {
        measure("marching cubes", threads, &|| drop(black_box(marching_cubes(&grid))));
        measure("normals", threads, &|| drop(black_box(normals_from_field(&mesh, &grid))));
        // The vertices stand in for particles: as dense as a surface gets.
        measure("velocity", threads, &|| {
            drop(black_box(transfer(&particles, None, &mesh.positions, 2.0 * VOXEL)));
        });
        measure("components", threads, &|| {
            drop(black_box(remove_small(&mut mesh.clone(), &ComponentParams::default(), 2.0 * VOXEL)));
        });
        measure("smoothing", threads, &|| {
            let weights = vec![1.0; mesh.positions.len()];
            _ = black_box(smooth(&mut mesh.clone(), &weights, &SmoothingParams::default(), 2.0 * VOXEL));
        });
        measure("decimation", threads, &|| {
            _ = black_box(decimate(&mut mesh.clone(), &DecimationParams::default(), 2.0 * VOXEL));
        });
        measure("check", threads, &|| _ = black_box(check(&mesh)));
    }
    mesh.normals = normals_from_field(&mesh, &grid).0;
    mesh.attributes.push(Channel { name: "velocity".into(), data: mesh.positions.clone().into() });
    let folder = std::env::temp_dir().join(format!("meniscus-bench-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("the folder for temporaries is writable");
    let path = folder.join("mesh.ply");
    let written = export::ply::write(&mesh, &path, &[]).expect("the temporary folder has space");
    group.throughput(Throughput::Bytes(written.bytes));
    group
        .bench_function("write PLY, synced", |b| b.iter(|| export::ply::write(black_box(&mesh), &path, &[])));
    group.finish();
    std::fs::remove_dir_all(&folder).expect("the bench's own folder can be removed");
}

criterion_group!(benches, surface);
criterion_main!(benches);
