//! Marching cubes, checks and vertex attributes against closed forms and random fields.

use meniscus::{
    control::CancelToken,
    frame::{ChannelData, Column, Columns, Stream, StreamKind},
    grid::{BRICK, BRICK_NODES, Bricks, SparseGrid, offset},
    math::Vec3,
    mesh::{
        Contour, DistanceParams, Interpolation, MARGIN, Mesh, MeshCheck, SurfaceError, SurfaceParams, check,
        marching_cubes, normals_from_field, reconstruct, transfer,
    },
    par,
};
use std::{f64::consts::PI, time::Instant};

/// A grid on the bricks `keep` of a box of nodes, with the values of `f` at its nodes [m].
fn sampled(
    voxel: f32,
    low: [i32; 3],
    high: [i32; 3],
    keep: impl Fn([i32; 3]) -> bool,
    f: impl Fn([i32; 3]) -> f32,
) -> SparseGrid {
    let brick = BRICK as i32;
    let range = |axis: usize| low[axis].div_euclid(brick)..=high[axis].div_euclid(brick);
    let mut coords = Vec::new();
    for z in range(2) {
        for y in range(1) {
            coords.extend(range(0).map(|x| [x, y, z]).filter(|&c| keep(c)));
        }
    }
    let bricks = Bricks::new(coords);
    let mut grid = SparseGrid::new(voxel, bricks, 0.0);
    for b in 0..grid.bricks.len() {
        let coord = grid.bricks.coords()[b];
        for z in 0..BRICK {
            for y in 0..BRICK {
                for x in 0..BRICK {
                    let local = [x, y, z];
                    let node = std::array::from_fn(|d| coord[d] * brick + local[d] as i32);
                    grid.values[b * BRICK_NODES + offset(local)] = f(node);
                }
            }
        }
    }
    grid
}

/// A signed distance on all bricks of a cube of half edge `extent` [m] around the origin.
pub(crate) fn distance(voxel: f32, extent: f32, f: impl Fn([f64; 3]) -> f64) -> SparseGrid {
    let n = (extent / voxel).ceil() as i32 + 1;
    let at = |node: [i32; 3]| f(node.map(|i| f64::from(i) * f64::from(voxel))) as f32;
    sampled(voxel, [-n; 3], [n; 3], |_| true, at)
}

/// The centre of the shapes: not on a node, so that nothing is symmetric by chance.
const CENTRE: [f64; 3] = [0.013, -0.021, 0.0071];

fn ball(radius: f64, centre: [f64; 3]) -> impl Fn([f64; 3]) -> f64 + Copy {
    move |x| (0..3).map(|d| (x[d] - centre[d]).powi(2)).sum::<f64>().sqrt() - radius
}

pub(crate) fn torus(major: f64, minor: f64) -> impl Fn([f64; 3]) -> f64 {
    move |x| {
        let [x, y, z] = std::array::from_fn(|d| x[d] - CENTRE[d]);
        (x.hypot(y) - major).hypot(z) - minor
    }
}

fn extract<'a>(contour: impl Into<Contour<'a>>) -> (Mesh, MeshCheck) {
    let (mesh, stats) = marching_cubes(contour);
    assert_eq!(stats.cut_cells, 0);
    let found = check(&mesh);
    assert!(found.is_sound() && found.unused_vertices == 0, "{found:?}");
    (mesh, found)
}

/// The order p in error ∝ voxel^p, from errors at halved voxels.
fn orders(errors: &[f64]) -> Vec<f64> {
    errors.windows(2).map(|pair| (pair[0] / pair[1]).log2()).collect()
}

/// Prints errors at halved voxels and their orders.
fn show(name: &str, errors: &[f64]) {
    let text: Vec<_> = errors.iter().map(|e| format!("{e:.2e}")).collect();
    println!("{name}: errors {}, orders {:.2?}", text.join(" "), orders(errors));
}

#[test]
fn a_ball_converges_with_second_order() {
    let radius = 0.7;
    let mut errors: [Vec<f64>; 4] = Default::default();
    for voxel in [0.1_f32, 0.05, 0.025] {
        let grid = distance(voxel, 0.9, ball(radius, CENTRE));
        let contour = Contour { interpolation: Interpolation::Cubic, ..Contour::from(&grid) };
        let (mesh, found) = extract(contour);
        assert_eq!((found.components, found.euler), (1, 2));
        let (normals, replaced) = normals_from_field(&mesh, &grid);
        assert_eq!(replaced, 0);
        let offset = |x: &Vec3| x.cast::<f64>() - nalgebra::Vector3::from(CENTRE);
        let hausdorff_of = |mesh: &Mesh| {
            mesh.positions.iter().map(|x| (offset(x).norm() - radius).abs()).fold(0.0, f64::max)
        };
        let hausdorff = hausdorff_of(&mesh);
        // A chord over an edge of the grid leaves the ball by h²/8R; a moved vertex by MARGIN · h more.
        let h = f64::from(voxel);
        let linear = hausdorff_of(&extract(&grid).0);
        assert!(
            linear < h * h / (8.0 * radius) * 1.5 + MARGIN * h && linear > hausdorff,
            "{linear} at {voxel}"
        );
        let tilt = std::iter::zip(&mesh.positions, &normals)
            .map(|(x, n)| n.cast::<f64>().cross(&offset(x).normalize()).norm())
            .fold(0.0, f64::max);
        errors[0].push((found.volume / (4.0 / 3.0 * PI * radius.powi(3)) - 1.0).abs());
        errors[1].push((found.area / (4.0 * PI * radius.powi(2)) - 1.0).abs());
        errors[2].push(hausdorff);
        errors[3].push(tilt);
        // Vertices are on the ball, unless they are moved away from a node.
        assert!(hausdorff < MARGIN * h, "{hausdorff} at {voxel}");
    }
    for (name, errors) in std::iter::zip(["volume", "area", "distance", "normal"], &errors) {
        show(&format!("ball {name}"), errors);
    }
    for errors in [&errors[0], &errors[1], &errors[3]] {
        assert!(orders(errors).iter().all(|p| (1.7..2.6).contains(p)), "{errors:?}: {:?}", orders(errors));
    }
}

#[test]
fn a_torus_has_one_hole_and_converges() {
    let (major, minor) = (0.6, 0.25);
    let exact = (2.0 * PI * PI * major * minor * minor, 4.0 * PI * PI * major * minor);
    let mut errors: [Vec<f64>; 2] = Default::default();
    for voxel in [0.1_f32, 0.05, 0.025] {
        let (_, found) = extract(&distance(voxel, 0.95, torus(major, minor)));
        assert_eq!((found.components, found.euler), (1, 0));
        errors[0].push((found.volume / exact.0 - 1.0).abs());
        errors[1].push((found.area / exact.1 - 1.0).abs());
    }
    for (name, errors) in std::iter::zip(["volume", "area"], &errors) {
        show(&format!("torus {name}"), errors);
        assert!(orders(errors).iter().all(|p| (1.6..2.6).contains(p)), "{name} {errors:?}");
    }
    assert!(errors[0][2] < 5e-3 && errors[1][2] < 5e-3, "{errors:?}");
}

#[test]
fn shells_and_pairs_of_balls_have_the_right_components() {
    let voxel = 0.05;
    let shell = distance(voxel, 0.9, |x| {
        let r = ball(0.0, CENTRE)(x);
        (r - 0.8).max(0.5 - r).min(r - 0.3)
    });
    let (_, found) = extract(&shell);
    assert_eq!((found.components, found.euler), (3, 6));
    let exact = 4.0 / 3.0 * PI * (0.8_f64.powi(3) - 0.5_f64.powi(3) + 0.3_f64.powi(3));
    assert!((found.volume / exact - 1.0).abs() < 0.02, "{}", found.volume / exact);

    for (gap, components) in [(-0.1, Some(1)), (0.0, None), (0.1, Some(2))] {
        for slant in [[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [0.48, 0.6, 0.64]] {
            let centre =
                |side: f64| std::array::from_fn(|d| CENTRE[d] + side * (0.35 + gap / 2.0) * slant[d]);
            let (a, b) = (ball(0.35, centre(-1.0)), ball(0.35, centre(1.0)));
            let (_, found) = extract(&distance(voxel, 0.9, |x| a(x).min(b(x))));
            assert_eq!(found.euler, 2 * found.components as i64, "no hole between the balls");
            assert!(components.is_none_or(|expected| expected == found.components), "gap {gap}: {found:?}");
        }
    }
}

/// Random bits, keyed by a counter.
pub(crate) fn hash(seed: u64, i: u64) -> u64 {
    let mut z = (seed << 32 ^ i).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Noise in a box of 7³ inner nodes across eight bricks, positive around it.
pub(crate) fn noise(seed: u64, value: impl Fn(u64) -> f32) -> SparseGrid {
    noise_at(seed, 0.1, [4, -3, 5], value)
}

/// The same with its lowest inner node at `low`.
fn noise_at(seed: u64, voxel: f32, low: [i32; 3], value: impl Fn(u64) -> f32) -> SparseGrid {
    let high = low.map(|i| i + 6);
    sampled(
        voxel,
        low.map(|i| i - 1),
        high.map(|i| i + 1),
        |_| true,
        |node| {
            if (0..3).all(|d| (low[d]..=high[d]).contains(&node[d])) {
                let i = (0..3).map(|d| ((node[d] - low[d]) as u64) << (8 * d)).sum();
                value(hash(seed, i))
            } else {
                1.0
            }
        },
    )
}

/// Five voxel sizes, from near the origin to 8000 voxels away from it.
#[test]
fn a_thousand_random_fields_give_sound_meshes() {
    let mut triangles = 0;
    for seed in 0..1000 {
        let voxel = [0.1, 1e-4, 0.013, 3.7, 250.0][seed as usize % 5];
        let low = [[4, -3, 5], [7993, -7999, 7990], [-4001, 3, 5001]][seed as usize % 3];
        let random = |bits: u64| (bits >> 40) as f32 / (1 << 23) as f32 - 1.0;
        let (mesh, found) = extract(&noise_at(seed, voxel, low, random));
        assert!(found.euler % 2 == 0 && found.volume > 0.0 && found.components > 0);
        triangles += mesh.triangles.len();
    }
    assert!(triangles > 500_000, "the fields are rough: {triangles}");
}

#[test]
fn values_at_and_near_zero_give_no_degenerate_triangle() {
    let values = [0.0, -0.0, 1e-30, -1e-30, f32::MIN_POSITIVE, -1e-45, 1e-9, -1.0, 1.0];
    let mut moved = 0;
    for seed in 0..300 {
        let grid = noise(seed, |bits| values[bits as usize % values.len()]);
        moved += marching_cubes(&grid).1.moved_vertices;
        extract(&grid);
    }
    assert!(moved > 10_000, "{moved}");

    // A box whose faces lie exactly in planes of nodes: a core of inner nodes, with slabs, half-filled edges and
    // corner pyramids around it, one voxel less MARGIN thick.
    let edge = |x: [f64; 3]| (0..3).map(|d| x[d].abs() - 0.5).fold(f64::MIN, f64::max);
    let grid = distance(0.125, 0.8, edge);
    let (mesh, found) = extract(&grid);
    let (_, stats) = marching_cubes(&grid);
    assert_eq!(stats.moved_vertices, mesh.positions.len());
    let (core, h) = (0.75_f64, 0.125 * (1.0 - MARGIN));
    let exact = core.powi(3) + 6.0 * core * core * h + 6.0 * core * h * h + 8.0 / 6.0 * h.powi(3);
    assert!((found.volume - exact).abs() < 1e-6, "{} instead of {exact}", found.volume);
}

#[test]
fn a_surface_far_from_the_origin_keeps_its_shape() {
    let at = [8000.0, -7900.0, 8100.0];
    let near = |node: [i32; 3]| ball(10.0, at.map(|c| c + 0.5))(node.map(f64::from)) as f32;
    let low = at.map(|c| c as i32 - 12);
    let grid = sampled(0.01, low, low.map(|i| i + 25), |_| true, near);
    let (_, found) = extract(&grid);
    assert_eq!((found.components, found.euler), (1, 2));
    assert!((found.volume / (4.0 / 3.0 * PI * 1e-3) - 1.0).abs() < 0.02);
}

#[test]
fn a_drifting_ball_does_not_pop() {
    let found: Vec<MeshCheck> = (0..20)
        .map(|step| {
            let drift = f64::from(step) * 0.05 / 20.0;
            let centre = [CENTRE[0] + drift, CENTRE[1] + 0.3 * drift, CENTRE[2] - 0.7 * drift];
            extract(&distance(0.05, 0.7, ball(0.5, centre))).1
        })
        .collect();
    let spread = |value: fn(&MeshCheck) -> f64| {
        let values = || found.iter().map(value);
        values().fold(f64::MIN, f64::max) / values().fold(f64::MAX, f64::min) - 1.0
    };
    println!("drift: volume {:.1e}, area {:.1e}", spread(|c| c.volume), spread(|c| c.area));
    assert!(spread(|c| c.volume) < 5e-4 && spread(|c| c.area) < 5e-4);
}

#[test]
fn threads_and_bricks_without_surface_do_not_change_a_byte() {
    let (voxel, f) = (0.04_f32, torus(0.6, 0.25));
    let value = |node: [i32; 3]| f(node.map(|i| f64::from(i) * f64::from(voxel))) as f32;
    let near = |c: [i32; 3]| {
        let middle = c.map(|i| (f64::from(i * 8) + 3.5) * f64::from(voxel));
        f(middle).abs() < 9.0 * f64::from(voxel)
    };
    let narrow = sampled(voxel, [-24; 3], [24; 3], near, value);
    let full = sampled(voxel, [-40; 3], [40; 3], |_| true, value);
    assert!(narrow.bricks.len() < full.bricks.len() / 2);
    let run = |grid: &SparseGrid| {
        let (mut mesh, _) = extract(grid);
        mesh.normals = normals_from_field(&mesh, grid).0;
        mesh
    };
    let expected = par::with_threads(1, || run(&narrow));
    for &threads in crate::thread_counts() {
        assert!(par::with_threads(threads, || run(&narrow)) == expected, "{threads} threads");
    }
    let other = run(&full);
    assert!(other.positions == expected.positions && other.triangles == expected.triangles);

    // The same bricks, named in another order.
    let mut coords = narrow.bricks.coords().to_vec();
    coords.sort_unstable_by_key(|c| hash(7, (c[0] * 10_000 + c[1] * 100 + c[2]) as u64));
    let mut shuffled = SparseGrid::new(voxel, Bricks::new(coords.clone()), 0.0);
    for coord in coords {
        let (to, from) = (shuffled.bricks.find(coord).unwrap(), narrow.bricks.find(coord).unwrap());
        shuffled.values[to * BRICK_NODES..][..BRICK_NODES]
            .copy_from_slice(&narrow.values[from * BRICK_NODES..][..BRICK_NODES]);
    }
    assert!(run(&shuffled) == expected);
}

#[test]
fn a_missing_brick_is_counted_and_leaves_no_stray_vertex() {
    let grid = sampled(
        0.05,
        [-16; 3],
        [15; 3],
        |c| c != [0, 0, 1],
        |node| ball(0.5, CENTRE)(node.map(|i| f64::from(i) * 0.05)) as f32,
    );
    let (mesh, stats) = marching_cubes(&grid);
    let found = check(&mesh);
    assert!(stats.cut_cells > 0 && !found.closed && found.unused_vertices == 0, "{found:?}");
    assert!(found.manifold && found.oriented && found.degenerate_triangles == 0, "{found:?}");
}

/// Wherever bricks are missing, above, below or at a side: every cell with known corners on both sides that lacks one.
#[test]
fn every_cell_next_to_a_missing_brick_is_counted() {
    let inside = |node: [i32; 3]| ball(0.5, CENTRE)(node.map(|i| f64::from(i) * 0.05)) as f32;
    let cut_cells = |keep: &dyn Fn([i32; 3]) -> bool| {
        let grid = sampled(0.05, [-16; 3], [15; 3], keep, inside);
        let mut expected = 0;
        for cell in (0..34_i32.pow(3)).map(|i| [i % 34 - 17, i / 34 % 34 - 17, i / 34 / 34 - 17]) {
            let corner = |i: i32| grid.get(std::array::from_fn(|d| cell[d] + (i >> d & 1)));
            let corners: Vec<bool> = (0..8).filter_map(corner).map(|value| value < 0.0).collect();
            expected += usize::from(corners.len() < 8 && corners.contains(&true) && corners.contains(&false));
        }
        let (mesh, stats) = marching_cubes(&grid);
        assert_eq!(stats.cut_cells, expected);
        assert_eq!(stats.cut_cells == 0, check(&mesh).closed);
        stats.cut_cells
    };
    assert_eq!(cut_cells(&|_| true), 0);
    for axis in 0..3 {
        assert!(cut_cells(&|c| c[axis] >= 0) > 50, "the lower half is missing along {axis}");
        assert!(cut_cells(&|c| c[axis] < 0) > 50, "the upper half is missing along {axis}");
    }
    for seed in 0..20 {
        cut_cells(&|c| hash(seed, c.iter().fold(0, |sum, &i| 4 * sum + (i + 2) as u64)) >> 62 > 0);
    }
}

#[test]
fn unreached_nodes_are_counted() {
    let mut grid = noise(3, |bits| if bits % 4 == 0 { f32::NEG_INFINITY } else { 0.5 });
    grid.values.iter_mut().filter(|v| **v == 1.0).for_each(|v| *v = f32::INFINITY);
    let (mesh, found) = extract(&grid);
    assert!(found.volume > 0.0);
    assert_eq!(marching_cubes(&grid).1.unbounded_vertices, mesh.positions.len());
}

#[test]
fn faces_decide_where_the_distance_has_no_usable_gradient() {
    let grid = distance(0.05, 0.8, ball(0.5, CENTRE));
    let (mesh, _) = extract(&grid);
    let (expected, replaced) = normals_from_field(&mesh, &grid);
    assert_eq!(replaced, 0);

    // No slope, one that points inward, and none that is a number.
    let [mut flat, mut inward, mut endless] = [grid.clone(), grid.clone(), grid];
    flat.values.fill(1.0);
    inward.values.iter_mut().for_each(|v| *v = -*v);
    endless.values.iter_mut().for_each(|v| *v = v.signum() * f32::INFINITY);
    for grid in [&flat, &inward, &endless] {
        let (normals, replaced) = normals_from_field(&mesh, grid);
        assert_eq!(replaced, mesh.positions.len());
        assert!(std::iter::zip(&normals, &expected).all(|(a, b)| a.dot(b) > 0.8));
    }
}

/// What vertices take of a vector that every particle has, and how many take it from the nearest.
fn interpolate(vertices: &[Vec3], particles: &[Vec3], values: &[Vec3]) -> (Vec<Vec3>, usize) {
    let stream = Stream::new("liquid", StreamKind::Particles, particles.len())
        .with("position", particles.to_vec())
        .with("velocity", values.to_vec());
    let (mut channels, count) = transfer(&stream, None, vertices, 0.25).unwrap();
    match channels.remove(0).data {
        ChannelData::Vec3(values) => (values, count),
        other => panic!("velocities are vectors: {other:?}"),
    }
}

#[test]
fn interpolation_reproduces_constants_and_smooths_the_rest() {
    let particles: Vec<Vec3> = (0..1000_i32)
        .map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.1)
        .collect();
    let vertices: Vec<Vec3> = (0..500)
        .map(|i| Vec3::from_fn(|d, _| (hash(1, i * 3 + d as u64) >> 40) as f32 / (1 << 24) as f32 * 0.9))
        .collect();
    let constant = vec![Vec3::new(1.0, -2.0, 0.25); particles.len()];
    let (values, far) = interpolate(&vertices, &particles, &constant);
    assert_eq!(far, 0);
    assert!(values.iter().all(|v| (v - constant[0]).norm() < 1e-5));

    // Inside, a linear field comes back up to a part of the spacing.
    let linear: Vec<Vec3> = particles.iter().map(|x| Vec3::new(x.z, x.x, 2.0 * x.y)).collect();
    let inner: Vec<Vec3> =
        vertices.iter().copied().filter(|x| x.iter().all(|&x| (0.25..0.65).contains(&x))).collect();
    let (values, _) = interpolate(&inner, &particles, &linear);
    assert!(!inner.is_empty());
    for (x, v) in std::iter::zip(&inner, &values) {
        assert!((v - Vec3::new(x.z, x.x, 2.0 * x.y)).norm() < 0.02);
    }

    // Far from all particles, the nearest one counts.
    let far = [Vec3::new(5.0, 0.02, -3.0), Vec3::new(f32::NAN, 0.0, 0.0), Vec3::new(-3e8, 0.0, 0.0)];
    let (values, count) = interpolate(&far, &particles, &particles);
    assert_eq!(count, 3);
    assert_eq!(values[..2], [particles[9], Vec3::zeros()]);
    assert!(particles.contains(&values[2]));
    assert_eq!(interpolate(&far, &[], &[]), (vec![Vec3::zeros(); 3], 3));
}

/// Jittered particles on a seeding lattice of spacing 1/10 m where `keep` holds, turning around the z axis.
fn seeding_lattice(keep: impl Fn(Vec3) -> bool) -> Stream {
    let jitter = |i: u64| ((hash(11, i) >> 40) as f32 / (1 << 24) as f32 - 0.5) * 0.03;
    let n = 12_u64;
    let mut positions = Vec::new();
    for node in 0..(2 * n).pow(3) {
        let place = [node % (2 * n), node / (2 * n) % (2 * n), node / (4 * n * n)];
        let x = Vec3::from_fn(|d, _| (place[d] as f32 - n as f32 + 0.5) * 0.1);
        if keep(x) {
            positions.push(x + Vec3::from_fn(|d, _| jitter(node * 3 + d as u64)));
        }
    }
    let velocities: Vec<Vec3> = positions.iter().map(|x| turning(*x)).collect();
    Stream::new("liquid", StreamKind::Particles, positions.len())
        .with("position", positions)
        .with("velocity", velocities)
}

/// The velocity of a rigid turn about the z axis with 3 rad/s.
fn turning(x: Vec3) -> Vec3 {
    Vec3::new(0.0, 0.0, 3.0).cross(&x)
}

#[test]
fn particles_become_a_sound_surface_of_their_volume() {
    let params = SurfaceParams::default();
    let ball = seeding_lattice(|x| x.norm() < 0.8);
    let surface = reconstruct(&ball, 0.1, &params, &CancelToken::new()).unwrap();
    let (mesh, check, stats) = (&surface.mesh, &surface.check, &surface.stats);
    assert!(check.is_sound() && check.first_fault.is_none(), "{check:?}");
    assert_eq!((check.components, check.euler), (1, 2));
    assert_eq!((stats.particles, stats.contour.cut_cells, stats.attributes_from_nearest), (ball.len(), 0, 0));
    assert_eq!((stats.vertices, stats.triangles), (mesh.positions.len(), mesh.triangles.len()));
    let ratio = check.volume / (ball.len() as f64 * 1e-3);
    println!("ball of {} particles: {} triangles, volume × {ratio:.3}", ball.len(), stats.triangles);
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");

    // Normals look outward and the velocity is that of the particles around.
    let velocities = match &mesh.attributes[0].data {
        meniscus::frame::ChannelData::Vec3(values) => values,
        other => panic!("velocity is {other:?}"),
    };
    for ((x, n), v) in mesh.positions.iter().zip(&mesh.normals).zip(velocities) {
        assert!((n.norm() - 1.0).abs() < 1e-5 && n.dot(&x.normalize()) > 0.5, "{n} at {x}");
        assert!((v - turning(*x)).norm() < 0.3, "{v} at {x}");
    }
    assert!(stats.normals_from_faces * 100 < stats.vertices, "{stats:?}");

    // Borrowed columns give the same, and are read where they are.
    let (positions, velocity) = (ball.vec3("position").unwrap(), ball.vec3("velocity").unwrap());
    let borrowed = Columns::new(ball.len())
        .with("position", Column::Vec3(positions))
        .with("velocity", Column::Vec3(velocity));
    assert_eq!(borrowed.vec3("position").unwrap().as_ptr(), positions.as_ptr());
    let again = reconstruct(&borrowed, 0.1, &params, &CancelToken::new()).unwrap();
    assert!(again.mesh == surface.mesh && again.check == surface.check);

    // The same bytes for any number of threads.
    for threads in [1, 2, 3, 8] {
        let again =
            par::with_threads(threads, || reconstruct(&ball, 0.1, &params, &CancelToken::new()).unwrap());
        assert!(again.mesh == surface.mesh && again.check == surface.check, "{threads} threads");
    }
}

#[test]
fn sprays_of_particles_give_sound_surfaces() {
    let params = SurfaceParams::default();
    for seed in 0..20 {
        let unit = |i: u64| (hash(100 + seed, i) >> 40) as f32 / (1 << 24) as f32;
        let positions: Vec<Vec3> = (0..500)
            .map(|i| Vec3::from_fn(|d, _| unit(3 * i + d as u64) * [2.0, 1.0, 1.5][d] - 0.3))
            .collect();
        let spray = Stream::new("liquid", StreamKind::Particles, positions.len()).with("position", positions);
        let surface = reconstruct(&spray, 0.1, &params, &CancelToken::new()).unwrap();
        assert!(
            surface.check.is_sound() && surface.stats.contour.cut_cells == 0,
            "{seed}: {:?}",
            surface.check
        );
        assert!(surface.check.components > 10 && surface.mesh.attributes.is_empty());
    }
}

#[test]
fn no_particle_one_particle_and_broken_particles() {
    let params = SurfaceParams::default();
    let at = |positions: Vec<Vec3>| {
        let velocity = vec![Vec3::new(1.0, 2.0, 3.0); positions.len()];
        let stream = Stream::new("liquid", StreamKind::Particles, positions.len())
            .with("position", positions)
            .with("velocity", velocity);
        reconstruct(&stream, 0.1, &params, &CancelToken::new())
    };
    let nothing = at(vec![]).unwrap();
    assert!(
        nothing.check.is_sound() && nothing.mesh.positions.is_empty() && nothing.mesh.attributes.len() == 1
    );

    let drop = at(vec![Vec3::new(0.513, -3.02, 7.77)]).unwrap();
    assert!(drop.check.is_sound(), "{:?}", drop.check);
    assert_eq!((drop.check.components, drop.check.euler), (1, 2));
    println!("one particle: volume × {:.2}", drop.check.volume / 1e-3);

    let broken = at(vec![Vec3::zeros(), Vec3::new(0.0, f32::NAN, 0.0)]);
    assert_eq!(broken.unwrap_err(), SurfaceError::NotFinite { particle: 1 });
    let nameless =
        reconstruct(&Stream::new("liquid", StreamKind::Particles, 0), 0.1, &params, &CancelToken::new());
    assert_eq!(nameless.unwrap_err(), SurfaceError::NoPositions);
}

#[test]
fn a_cancelled_reconstruction_gives_no_surface() {
    let ball = seeding_lattice(|x| x.norm() < 0.3);
    let params = SurfaceParams { distance: Some(DistanceParams::default()), ..SurfaceParams::default() };
    let (start, token) = (Instant::now(), CancelToken::new());
    reconstruct(&ball, 0.1, &params, &token).unwrap();
    let seconds = start.elapsed();
    // Deadlines fall into every pass; the last ones may be after the end.
    for part in 0..16 {
        let deadline = token.with_deadline(Instant::now() + seconds * part / 16);
        let ended = reconstruct(&ball, 0.1, &params, &deadline);
        match ended {
            Ok(_) => assert!(part > 0),
            Err(why) => assert!(why == SurfaceError::Interrupted && deadline.is_cancelled()),
        }
    }
    token.cancel();
    assert!(reconstruct(&ball, 0.1, &params, &token).is_err_and(|why| why == SurfaceError::Interrupted));
}

#[test]
#[should_panic(expected = "column velocity has the length of the others")]
fn borrowed_columns_have_one_length() {
    let x = [Vec3::zeros(); 2];
    let _ = Columns::new(2).with("position", Column::Vec3(&x)).with("velocity", Column::Vec3(&x[..1]));
}
