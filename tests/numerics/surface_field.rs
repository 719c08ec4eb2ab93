//! Particles → density → distance: normals, volume, sameness.

use meniscus::control::CancelToken;
use meniscus::field::{Anisotropy, DensityParams, density};
use meniscus::frame::{Stream, StreamKind};
use meniscus::grid::{BRICK_NODES, SparseGrid, node_of};
use meniscus::math::Vec3;
use meniscus::mesh::{DistanceParams, Surface, SurfaceParams, reconstruct};
use meniscus::par::with_threads;
use meniscus::sdf::{SdfParams, SeedRule, SignedDistance, from_density};

/// A ball of particles, spacing 1, each moved by up to `jitter` along each axis.
fn ball(radius: f32, jitter: f32, center: Vec3) -> Vec<Vec3> {
    let mut state = 7_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    let n = radius.ceil() as i32;
    let mut positions = Vec::new();
    for z in -n..=n {
        for y in -n..=n {
            for x in -n..=n {
                let at = Vec3::new(x as f32, y as f32, z as f32);
                if at.norm() <= radius {
                    positions.push(at + Vec3::new(random(), random(), random()) * jitter + center);
                }
            }
        }
    }
    positions
}

const PARAMS: DensityParams =
    DensityParams { spacing: 1.0, kernel_radius: 2.0, voxel: 0.5, anisotropy: None, whole: true };

/// The gradient at a node by central differences.
fn gradient(grid: &SparseGrid, node: [i32; 3]) -> Vec3 {
    let at = |axis: usize, step: i32| {
        let mut other = node;
        other[axis] += step;
        grid.get(other).unwrap_or(0.0)
    };
    Vec3::from([0, 1, 2].map(|axis| at(axis, 1) - at(axis, -1)))
}

/// Mean and root mean square angle [degrees] between the outward direction from the origin and the normals of the
/// field and of the distance, at the distance's zeros.
fn angles(field: &SparseGrid, sdf: &SignedDistance) -> [(f32, f32); 2] {
    let mut sums = [(0.0_f64, 0.0_f64); 2];
    let mut count = 0.0;
    for (i, &value) in sdf.grid.values.iter().enumerate() {
        let node = node_of(sdf.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
        for axis in 0..3 {
            let mut next = node;
            next[axis] += 1;
            let Some(other) = sdf.grid.get(next) else { continue };
            if (value < 0.0) == (other < 0.0) {
                continue;
            }
            let along = value / (value - other);
            let x = sdf.grid.position(node).lerp(&sdf.grid.position(next), along);
            for (grid, sign, sum) in [(field, -1.0, 0), (&sdf.grid, 1.0, 1)] {
                let normal = (gradient(grid, node).lerp(&gradient(grid, next), along) * sign).normalize();
                let angle = f64::from(normal.cross(&x.normalize()).norm().atan2(normal.dot(&x.normalize())));
                sums[sum].0 += angle.to_degrees();
                sums[sum].1 += angle.to_degrees().powi(2);
            }
            count += 1.0;
        }
    }
    sums.map(|(mean, square)| ((mean / count) as f32, (square / count).sqrt() as f32))
}

#[test]
fn normals_point_outward() {
    for (jitter, bound) in [(0.0, 11.0), (0.25, 15.0)] {
        let particles = ball(20.0, jitter, Vec3::zeros());
        let found = density(&particles, &PARAMS);
        for band in [2.0, 3.0] {
            let sdf = from_density(&found.grid, found.threshold, &SdfParams { band, ..Default::default() });
            let [field, distance] = angles(&found.grid, &sdf);
            println!(
                "jitter {jitter} band {band}: mean, rms angle of field {field:.2?}, of distance {distance:.2?}"
            );
            assert!(distance.0 < 0.9 * field.0 && distance.0 < bound);
        }

        // The mesh carries the better of the two.
        let stream =
            Stream::new("liquid", StreamKind::Particles, particles.len()).with("position", particles);
        let params = SurfaceParams { distance: Some(DistanceParams::default()), ..SurfaceParams::default() };
        let mesh = reconstruct(&stream, 1.0, &params, &CancelToken::new()).unwrap().mesh;
        let angles =
            mesh.positions.iter().zip(&mesh.normals).map(|(x, n)| f64::from(x.angle(n)).to_degrees());
        let mean = angles.sum::<f64>() / mesh.positions.len() as f64;
        println!("jitter {jitter}: mean angle of the mesh {mean:.2}");
        assert!(mean < f64::from(bound));
    }
}

#[test]
fn zeros_of_the_distance_lie_where_the_density_crosses() {
    for jitter in [0.0, 0.25] {
        let found = density(&ball(12.0, jitter, Vec3::new(0.1, 0.2, 0.3)), &PARAMS);
        for seed in [SeedRule::Plane, SeedRule::NearestEdge] {
            let sdf = from_density(&found.grid, found.threshold, &SdfParams { seed, ..Default::default() });
            let (mut sum, mut worst, mut count) = (0.0, 0.0_f32, 0);
            for (i, &value) in sdf.grid.values.iter().enumerate() {
                let node = node_of(sdf.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
                for axis in 0..3 {
                    let mut next = node;
                    next[axis] += 1;
                    let Some(other) = sdf.grid.get(next) else { continue };
                    if (value < 0.0) != (other < 0.0) {
                        let at = |node| found.grid.get(node).unwrap_or(0.0);
                        let crossing = (found.threshold - at(node)) / (at(next) - at(node));
                        let off = (value / (value - other) - crossing).abs();
                        sum += f64::from(off);
                        worst = worst.max(off);
                        count += 1;
                    }
                }
            }
            let mean = sum / f64::from(count);
            println!("jitter {jitter} {seed:?}: mean {mean:.4}, worst {worst:.4} voxel along {count} edges");
            assert!(mean < 0.03 && worst < 0.5);
        }
    }
}

/// The volume inside, each node's cell counted by how much of it the distance puts inside.
fn volume(sdf: &SignedDistance, inside_elsewhere: f64) -> f64 {
    let h = sdf.grid.voxel;
    let near: f64 = sdf.grid.values.iter().map(|&d| f64::from((0.5 - d / h).clamp(0.0, 1.0))).sum();
    (near + inside_elsewhere) * f64::from(h).powi(3)
}

#[test]
fn a_ball_that_moves_by_less_than_a_voxel_keeps_its_volume() {
    let mut volumes = Vec::new();
    let exact = ball(10.0, 0.0, Vec3::zeros()).len() as f64;
    for step in 0..20 {
        let center = Vec3::new(0.031, 0.017, 0.023) * step as f32;
        let found = density(&ball(10.0, 0.0, center), &PARAMS);
        let sdf = from_density(&found.grid, found.threshold, &SdfParams::default());
        // Bricks of the field that the distance leaves out are inside or outside as a whole.
        let left_out = |i: usize| sdf.grid.bricks.find(found.grid.bricks.coords()[i / BRICK_NODES]).is_none();
        let filled = found.grid.values.iter().enumerate();
        let filled = filled.filter(|(i, v)| **v >= found.threshold && left_out(*i)).count();
        volumes.push(volume(&sdf, filled as f64));
    }
    let (low, high) = volumes.iter().fold((f64::INFINITY, 0.0_f64), |(a, b), &v| (a.min(v), b.max(v)));
    println!("volume {low:.2} to {high:.2} over 20 steps, {exact} particles");
    assert!((high - low) / exact < 2e-3);
    assert!((low / exact - 1.0).abs() < 0.03);
}

#[test]
fn density_and_distance_have_the_same_bytes_on_any_number_of_threads() {
    let positions = ball(9.0, 0.4, Vec3::new(100.0, -3.0, 0.7));
    let run = |threads: usize| {
        with_threads(threads, || {
            let found = density(&positions, &PARAMS);
            from_density(&found.grid, found.threshold, &SdfParams::default())
        })
    };
    let one = run(1);
    assert!(one.pinned > 1000 && one.unreached < one.grid.values.len());
    for &threads in crate::thread_counts() {
        let other = run(threads);
        assert_eq!(one.grid.bricks.coords(), other.grid.bricks.coords());
        assert!(one.grid.values.iter().zip(&other.grid.values).all(|(a, b)| a.to_bits() == b.to_bits()));
        assert_eq!((one.pinned, one.unreached, one.sweeps), (other.pinned, other.unreached, other.sweeps));
    }
}

/// A surface with kernels that follow their neighbourhoods, at a quarter of a spacing.
fn anisotropic(positions: Vec<Vec3>) -> Surface {
    let stream = Stream::new("liquid", StreamKind::Particles, positions.len()).with("position", positions);
    let params =
        SurfaceParams { voxel: 0.25, anisotropy: Some(Anisotropy::default()), ..SurfaceParams::default() };
    reconstruct(&stream, 1.0, &params, &CancelToken::new()).unwrap()
}

/// A block of the seeding lattice, each particle moved by up to 0.15 spacings along each axis, turned so that no plane of it lies
/// along the grid.
fn turned_block(counts: [i32; 3]) -> Vec<Vec3> {
    let mut state = 3_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.15 * ((state >> 40) as f32 / (1 << 23) as f32 - 1.0)
    };
    let turn = nalgebra::Rotation3::from_euler_angles(0.4, 0.3, 0.7);
    (0..counts.iter().product())
        .map(|i| [i % counts[0], i / counts[0] % counts[1], i / (counts[0] * counts[1])])
        .map(|at| turn * (Vec3::from(at.map(|v| v as f32)) + Vec3::from([(); 3].map(|()| random()))))
        .collect()
}

#[test]
fn anisotropic_sheets_filaments_and_drops_stay_in_one_piece() {
    for (name, counts, volume) in [
        ("sheet of one", [40, 40, 1], 0.9..1.1),
        ("sheet of two", [40, 40, 2], 0.85..1.0),
        ("filament", [40, 1, 1], 0.9..1.3),
        ("particle", [1, 1, 1], 0.8..1.2),
        ("two particles", [2, 1, 1], 0.8..1.4),
    ] {
        let found = anisotropic(turned_block(counts));
        let share = found.check.volume / f64::from(counts.iter().product::<i32>());
        println!("{name}: {} components, volume × {share:.3}", found.check.components);
        assert!(found.check.is_sound(), "{name}: {:?}", found.check);
        assert_eq!((found.check.components, found.check.euler), (1, 2), "{name}");
        assert!(volume.contains(&share), "{name}: {share}");
    }
}

#[test]
fn anisotropic_kernels_stand_what_is_degenerate() {
    assert_eq!(anisotropic(Vec::new()).check.components, 0);
    // In one place, on a line, in a plane, and a thousand kilometres away where places are a sixteenth of a metre apart.
    for particles in [
        vec![Vec3::zeros(); 200],
        (0..200).map(|i| Vec3::new(0.03 * i as f32, 0.0, 0.0)).collect(),
        (0..900).map(|i| Vec3::new(0.2 * (i % 30) as f32, 0.2 * (i / 30) as f32, 0.0)).collect(),
        turned_block([8; 3]).into_iter().map(|x| x + Vec3::repeat(1e6)).collect(),
    ] {
        let found = anisotropic(particles);
        let check = &found.check;
        assert!(
            check.closed && check.manifold && check.oriented && check.non_finite_vertices == 0,
            "{check:?}"
        );
        assert!(check.components >= 1 && found.mesh.normals.iter().all(|n| (n.norm() - 1.0).abs() < 1e-3));
    }
}

#[test]
fn anisotropic_surfaces_have_the_same_bytes_on_any_number_of_threads() {
    let run = |threads: usize| with_threads(threads, || anisotropic(turned_block([14, 13, 9])).mesh);
    let one = run(1);
    assert!(one.triangles.len() > 5000);
    for &threads in crate::thread_counts() {
        assert!(run(threads) == one, "{threads} threads");
    }
}
