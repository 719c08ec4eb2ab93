//! Clean-up of surfaces: removal of small components, smoothing, and attribute transfer.

use super::mesh::{distance, hash, noise};
use meniscus::{
    control::CancelToken,
    frame::{ChannelData, Stream, StreamKind},
    math::Vec3,
    mesh::{
        ComponentParams, DecimationParams, Mesh, SmoothingParams, Surface, SurfaceError, SurfaceParams,
        check, decimate, marching_cubes, normals_from_faces, reconstruct, remove_small, smooth, transfer,
    },
    par,
};
use std::f64::consts::PI;

pub(super) const SPACING: f32 = 0.1;

/// Particles on a seeding lattice where `keep` holds, each displaced by up to `jitter` spacings along each axis.
pub(super) fn particles(half: [i32; 3], jitter: f32, at: Vec3, keep: impl Fn(Vec3) -> bool) -> Stream {
    let mut positions = Vec::new();
    let mut i = 0;
    let mut random = || {
        i += 1;
        (hash(5, i) >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    for z in -half[2]..=half[2] {
        for y in -half[1]..=half[1] {
            for x in -half[0]..=half[0] {
                let x = Vec3::new(x as f32, y as f32, z as f32);
                if keep(x) {
                    positions.push((x + Vec3::from_fn(|_, _| random()) * jitter) * SPACING + at);
                }
            }
        }
    }
    Stream::new("liquid", StreamKind::Particles, positions.len()).with("position", positions)
}

pub(super) fn surface(particles: &Stream, params: &SurfaceParams) -> Surface {
    let found = reconstruct(particles, SPACING, params, &CancelToken::new()).unwrap();
    assert!(found.check.is_sound() && found.check.unused_vertices == 0, "{:?}", found.check);
    found
}

pub(super) fn smoothed() -> SurfaceParams {
    SurfaceParams { smoothing: Some(SmoothingParams::default()), ..SurfaceParams::default() }
}

pub(super) fn decimated(decimation: DecimationParams) -> SurfaceParams {
    SurfaceParams { decimation: Some(decimation), ..SurfaceParams::default() }
}

/// RMS of the radius around its mean [particle radii], and the mean angle of the normals from the radius [degrees].
pub(super) fn roughness(mesh: &Mesh) -> (f64, f64) {
    let n = mesh.positions.len() as f64;
    let radii = || mesh.positions.iter().map(|x| f64::from(x.norm()));
    let mean = radii().sum::<f64>() / n;
    let rms = (radii().map(|r| (r - mean).powi(2)).sum::<f64>() / n).sqrt();
    let lean: f64 = mesh.positions.iter().zip(&mesh.normals).map(|(x, n)| f64::from(x.angle(n))).sum();
    (rms / f64::from(0.5 * SPACING), (lean / n).to_degrees())
}

#[test]
fn smoothing_takes_the_particles_out_of_a_ball_and_keeps_its_volume() {
    let ball = particles([20; 3], 0.15, Vec3::zeros(), |x| x.norm() < 20.0);
    for voxel in [0.5, 0.25] {
        let plain = surface(&ball, &SurfaceParams { voxel, ..SurfaceParams::default() });
        for wavelength in [2.0, 4.0, 6.0, 8.0, 12.0].into_iter().step_by(if crate::is_soak() { 1 } else { 2 })
        {
            let smoothing = SmoothingParams { wavelength, ..SmoothingParams::default() };
            let found = surface(&ball, &SurfaceParams { voxel, smoothing: Some(smoothing), ..smoothed() });
            let stats = found.stats.smoothing.unwrap();
            let (before, after) = (roughness(&plain.mesh), roughness(&found.mesh));
            println!(
                "voxel {voxel}, wavelength {wavelength}: roughness, lean {before:.3?} -> {after:.3?}, {stats:?}"
            );
            assert!(stats.volume_error < 1e-5 && stats.volume_change < 3e-2);
            assert!((found.check.volume / plain.check.volume - 1.0).abs() < 1e-5);
            assert_eq!((found.check.components, found.check.euler), (1, 2));
            if wavelength >= 4.0 {
                assert!(after.0 < 0.8 * before.0 && after.1 < 0.6 * before.1);
            }
        }
    }
}

#[test]
fn smoothing_keeps_sheets_threads_and_droplets() {
    let shapes: [(&str, [i32; 3]); 4] =
        [("sheet", [15, 15, 0]), ("two layers", [15, 15, 1]), ("thread", [30, 0, 0]), ("droplet", [0, 0, 0])];
    for (name, half) in shapes {
        let stream =
            particles(half, 0.1, Vec3::new(0.013, 0.02, -0.031), |x| name != "two layers" || x.z >= 0.0);
        let params = SurfaceParams { voxel: 0.25, ..SurfaceParams::default() };
        let plain = surface(&stream, &params);
        let found =
            surface(&stream, &SurfaceParams { smoothing: Some(SmoothingParams::default()), ..params });
        let ratio = found.check.volume / plain.check.volume;
        println!(
            "{name}: {} -> {} components, volume x {ratio:.6}, {:?}",
            plain.check.components, found.check.components, found.stats.smoothing
        );
        assert_eq!((found.check.components, found.check.euler), (plain.check.components, plain.check.euler));
        assert!((ratio - 1.0).abs() < 1e-4, "{name}");
        let (thin, vertices) = (found.stats.smoothing.unwrap().thin_vertices, found.stats.vertices);
        if name == "two layers" {
            assert!(thin * 15 < vertices, "only the rim is thin: {thin} of {vertices}");
        } else {
            // At rims and ends the normal looks along the liquid.
            assert!(thin * 20 > 17 * vertices, "{name}: {thin} of {vertices} are thin");
        }
        let widest = |mesh: &Mesh| mesh.positions.iter().map(|x| x.z).fold(f32::MIN, f32::max);
        assert!((widest(&found.mesh) - widest(&plain.mesh)).abs() < 0.15 * SPACING, "{name}");
    }
}

/// The volume of every piece, in the order of their first vertices.
fn component_volumes(mesh: &Mesh) -> Vec<f64> {
    let mut piece: Vec<usize> = (0..mesh.positions.len()).collect();
    loop {
        let mut changed = false;
        for triangle in &mesh.triangles {
            let lowest = triangle.iter().map(|&v| piece[v as usize]).min().unwrap();
            for &v in triangle {
                changed |= std::mem::replace(&mut piece[v as usize], lowest) != lowest;
            }
        }
        if !changed {
            break;
        }
    }
    let mut volumes = vec![0.0; mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.positions[v as usize].cast::<f64>());
        volumes[piece[triangle[0] as usize]] += a.dot(&b.cross(&c)) / 6.0;
    }
    (0..piece.len()).filter(|&v| piece[v] == v).map(|v| volumes[v]).collect()
}

/// A large piece must not hide what small ones lose.
#[test]
fn smoothing_keeps_the_volume_of_every_piece() {
    let ball = particles([20; 3], 0.15, Vec3::zeros(), |x| x.norm() < 20.0);
    let droplets = [
        [2.6, 0.0, 0.0],
        [-2.7, 0.31, 0.2],
        [0.013, 2.81, 0.4],
        [0.7, -2.6, 0.11],
        [0.2, 0.33, 2.9],
        [0.02, 0.0, -2.7],
        [0.1, 0.0, -2.7],
    ];
    let all: Vec<Vec3> =
        ball.vec3("position").unwrap().iter().copied().chain(droplets.map(Vec3::from)).collect();
    let stream = Stream::new("liquid", StreamKind::Particles, all.len()).with("position", all);
    for thin in [0.2, 1.0] {
        let smoothing = SmoothingParams { thin, ..SmoothingParams::default() };
        let plain = component_volumes(&surface(&stream, &SurfaceParams::default()).mesh);
        let found =
            surface(&stream, &SurfaceParams { smoothing: Some(smoothing), ..SurfaceParams::default() });
        let now = component_volumes(&found.mesh);
        assert_eq!((plain.len(), now.len()), (7, 7));
        let errors: Vec<f64> =
            plain.iter().zip(&now).map(|(before, now)| (now / before - 1.0).abs()).collect();
        let stats = found.stats.smoothing.unwrap();
        println!("thin {thin}: {errors:?}, {stats:?}");
        let worst = errors.iter().copied().fold(0.0, f64::max);
        assert!(stats.longest_move < SPACING, "no vertex makes up for a whole piece: {}", stats.longest_move);
        assert!(worst < 1e-5, "{errors:?}");
        assert!(
            (worst - stats.worst_component).abs() < 1e-6,
            "{worst} is reported as {}",
            stats.worst_component
        );
        assert!(stats.volume_change > 1e-4);
    }
}

/// Far out single precision puts a whole droplet into one place, or two.
#[test]
fn coincident_vertices_pass_through_all_clean_up() {
    for at in [Vec3::repeat(3.0), Vec3::repeat(f32::NAN)] {
        let mut mesh = Mesh {
            positions: vec![at; 4],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..Mesh::default()
        };
        let stats = smooth(&mut mesh, &[1.0; 4], &SmoothingParams::default(), SPACING);
        assert_eq!((stats.degree, stats.longest_move), (0, 0.0));
    }
    let far = Stream::new("liquid", StreamKind::Particles, 1).with("position", vec![Vec3::repeat(1e6)]);
    let params = SurfaceParams {
        components: Some(ComponentParams { smallest: 0.0 }),
        decimation: Some(DecimationParams::default()),
        ..smoothed()
    };
    for spacing in [0.01, 0.1, 1.0] {
        let found = reconstruct(&far, spacing, &params, &CancelToken::new()).unwrap();
        println!("spacing {spacing}: {:?}, {:?}", found.stats.smoothing, found.check);
        assert_eq!(found.stats.too_far_particles, 0);
        assert!(found.mesh.positions.iter().flatten().all(|x| x.is_finite()));
    }
}

#[test]
fn thin_vertices_are_those_nearer_to_thin_than_to_all() {
    for (thin, expected) in [(0.0, 2), (0.6, 3), (1.0, 0)] {
        let (mut mesh, _) = marching_cubes(&noise(1, |_| -1.0));
        let mut weights = vec![1.0; mesh.positions.len()];
        weights[..3].copy_from_slice(&[0.1, 0.4, 0.75].map(|w: f32| w.max(thin)));
        let params = SmoothingParams { thin, ..SmoothingParams::default() };
        assert_eq!(smooth(&mut mesh, &weights, &params, SPACING).thin_vertices, expected, "{thin}");
    }
}

#[test]
fn vertices_of_weight_zero_do_not_move() {
    let (plain, _) = marching_cubes(&noise(1, |bits| (bits >> 40) as f32 / (1 << 23) as f32 - 1.0));
    let mut mesh = plain.clone();
    let stats = smooth(&mut mesh, &vec![0.0; plain.positions.len()], &SmoothingParams::default(), 0.2);
    assert_eq!(mesh, plain);
    assert_eq!((stats.thin_vertices, stats.restored_vertices), (plain.positions.len(), 0));
    assert_eq!((stats.volume_change, stats.longest_move), (0.0, 0.0));
}

/// Random fields have every sliver and saddle there is.
#[test]
fn clean_up_of_random_fields_keeps_meshes_sound() {
    let (mut restored, mut refused) = (0, 0);
    for seed in 0..200 {
        let (plain, _) = marching_cubes(&noise(seed, |bits| (bits >> 40) as f32 / (1 << 23) as f32 - 1.0));
        let before = check(&plain);
        let mut mesh = plain.clone();
        let smoothing = SmoothingParams { crease: 180.0, ..SmoothingParams::default() };
        restored += smooth(&mut mesh, &vec![1.0; plain.positions.len()], &smoothing, 0.1).restored_vertices;
        let after = check(&mesh);
        assert!(after.is_sound(), "{seed}: {after:?}");
        assert_eq!((after.components, after.euler), (before.components, before.euler));

        for mut mesh in [plain, mesh] {
            let params = DecimationParams { fraction: 0.3, ..DecimationParams::default() };
            let stats = decimate(&mut mesh, &params, 0.1);
            let after = check(&mesh);
            assert!(after.is_sound() && after.unused_vertices == 0, "{seed}: {after:?}");
            assert_eq!((after.components, after.euler), (before.components, before.euler), "{seed}");
            assert_eq!(stats.after, mesh.triangles.len());
            refused += stats.refused;
        }
    }
    println!("{restored} vertices restored, {refused} collapses refused");
    assert!(restored > 0 && refused > 0);
}

/// How far inside its upright edges the corners of a box's cross-sections stand, on average over slices [voxels].
fn worn_edges(mesh: &Mesh, middle: f64, half: f64, voxel: f64) -> f64 {
    let mut reach = [[f64::MIN; 8]; 4];
    for x in &mesh.positions {
        let [x, y, z] = [x.x, x.y, x.z].map(|x| f64::from(x) - middle);
        let slice = ((z + 0.4) / 0.1).floor();
        if (0.0..8.0).contains(&slice) {
            for (edge, [a, b]) in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]].into_iter().enumerate()
            {
                let reach = &mut reach[edge][slice as usize];
                *reach = reach.max((a * x + b * y) / 2_f64.sqrt());
            }
        }
    }
    (half * 2_f64.sqrt() - reach.iter().flatten().sum::<f64>() / 32.0) / voxel
}

#[test]
fn smoothing_keeps_creases() {
    let edge = |x: [f64; 3]| (0..3).map(|d| (x[d] - 0.013).abs() - 0.5).fold(f64::MIN, f64::max);
    let (plain, _) = marching_cubes(&distance(0.05, 0.8, edge));
    let worn = |crease: f32| {
        let mut mesh = plain.clone();
        let params = SmoothingParams { crease, ..SmoothingParams::default() };
        let stats = smooth(&mut mesh, &vec![1.0; plain.positions.len()], &params, 0.1);
        println!("crease {crease}: {stats:?}");
        worn_edges(&mesh, 0.013, 0.5, 0.05)
    };
    let creases = [30.0, 60.0, 90.0, 120.0, 180.0];
    let (before, after) = (worn_edges(&plain, 0.013, 0.5, 0.05), creases.map(worn));
    println!("edges are worn by {before:.3} voxels before, at creases {creases:?} by {after:.3?}");
    assert!(before < 0.5 && after[..3].iter().all(|after| after - before < 0.5) && after[4] > before + 0.5);
}

/// How far inside the upright edges of a box the surface stands there, on average [spacings].
fn rounded_edges(mesh: &Mesh, half: f64) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for x in &mesh.positions {
        let [x, y, z] = [x.x.abs(), x.y.abs(), x.z.abs()].map(|x| f64::from(x / SPACING));
        if z < 0.6 * half && (x - y).abs() < 0.5 && x + y > half {
            sum += half * 2_f64.sqrt() - (x + y) / 2_f64.sqrt();
            count += 1;
        }
    }
    sum / f64::from(count)
}

/// Before smoothing single particles bend the surface as much as edges do; only after smoothing can they be distinguished.
#[test]
fn smoothing_keeps_the_edges_of_a_box_of_particles() {
    let cube = particles([9; 3], 0.15, Vec3::zeros(), |_| true);
    for voxel in [0.5, 0.25] {
        let params = SurfaceParams { voxel, ..SurfaceParams::default() };
        let cut = rounded_edges(&surface(&cube, &params).mesh, 9.5);
        let worn = |crease: f32| {
            let smoothing = SmoothingParams { crease, ..SmoothingParams::default() };
            let found = surface(&cube, &SurfaceParams { smoothing: Some(smoothing), ..params.clone() });
            let stats = found.stats.smoothing.unwrap();
            let worn = (rounded_edges(&found.mesh, 9.5) - cut) / f64::from(voxel);
            println!("voxel {voxel}, {crease}: worn by {worn:.3} voxels, {stats:?}");
            (worn, stats.crease_vertices)
        };
        assert!(worn(90.0).0 < 0.5);
        let (without, creased) = worn(180.0);
        assert!(without > 0.5 && creased == 0);
    }
    // A ball has no edges, whatever its particles.
    let ball = particles([20; 3], 0.15, Vec3::zeros(), |x| x.norm() < 20.0);
    let smoothing = Some(SmoothingParams { crease: 90.0, ..SmoothingParams::default() });
    let found = surface(&ball, &SurfaceParams { smoothing, ..SurfaceParams::default() });
    let creased = found.stats.smoothing.unwrap().crease_vertices;
    assert!(
        100 * creased < found.stats.vertices,
        "{creased} of {} vertices are at edges",
        found.stats.vertices
    );
}

#[test]
fn components_without_volume_become_points_and_bubbles_are_filled() {
    let corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]].map(Vec3::from);
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    let mut mesh = Mesh::default();
    // A drop, a bubble, one flattened and one that rounding put into a single place.
    let flat = |x: Vec3| Vec3::new(x.x, x.y, 0.3 * x.x + 0.2 * x.y);
    let shapes: [&dyn Fn(Vec3) -> Vec3; 4] = [&|x| x, &|x| -x, &flat, &|_| Vec3::zeros()];
    for (i, shape) in (0..).zip(shapes) {
        mesh.positions.extend(corners.map(|x| shape(x) + Vec3::x() * i as f32));
        mesh.triangles.extend(faces.map(|triangle| triangle.map(|v| v + 4 * i)));
    }
    let (points, stats) = remove_small(&mut mesh, &ComponentParams::default(), SPACING);
    assert_eq!((stats.points, stats.bubbles, stats.triangles), (3, 1, 16));
    assert_eq!(points.positions[1..], [Vec3::x() * 2.0, Vec3::x() * 3.0]);
    assert!(points.radii[0] > 0.01 && points.radii[1..] == [0.0, 0.0]);
    assert!(
        (stats.points_volume * 6e3 - 1.0).abs() < 1e-5 && (stats.bubbles_volume * 6e3 - 1.0).abs() < 1e-5
    );
}

#[test]
fn small_components_become_points_of_their_volume() {
    // A ball of 1000 particles with a hole, and lone particles and pairs around it.
    let mut positions = particles([8; 3], 0.0, Vec3::zeros(), |x| x.norm() < 7.0 && x.norm() > 1.8);
    let lone = [[1.5, 0.0, 0.0], [-1.5, 0.03, 0.2], [0.0, 1.61, 0.0], [0.0, 1.69, 0.0]];
    let all: Vec<Vec3> =
        positions.vec3("position").unwrap().iter().copied().chain(lone.map(Vec3::from)).collect();
    let velocity: Vec<Vec3> = all.iter().map(|x| x * 2.0).collect();
    positions = Stream::new("liquid", StreamKind::Particles, all.len())
        .with("position", all)
        .with("velocity", velocity);
    let plain = surface(&positions, &SurfaceParams::default());
    assert_eq!((plain.check.components, plain.points.as_ref()), (5, None));
    let params = |smallest| SurfaceParams {
        components: Some(ComponentParams { smallest }),
        ..SurfaceParams::default()
    };

    let found = surface(&positions, &params(4.0));
    let (points, stats) = (found.points.unwrap(), found.stats.components.unwrap());
    assert_eq!((found.check.components, points.positions.len(), stats.points, stats.bubbles), (2, 3, 3, 0));
    let volumes: f64 = points.radii.iter().map(|&r| 4.0 / 3.0 * PI * f64::from(r).powi(3)).sum();
    assert!((volumes / stats.points_volume - 1.0).abs() < 1e-5);
    assert!((found.check.volume + stats.points_volume - plain.check.volume).abs() < 1e-9);
    assert_eq!(stats.triangles, plain.mesh.triangles.len() - found.mesh.triangles.len());
    let expected = [Vec3::new(-1.5, 0.03, 0.2), Vec3::new(1.5, 0.0, 0.0), Vec3::new(0.0, 1.65, 0.0)];
    for x in expected {
        let near = points.positions.iter().position(|y| (x - y).norm() < 0.03).unwrap();
        let ChannelData::Vec3(velocity) = &points.attributes[0].data else {
            panic!("velocities are vectors")
        };
        assert!((velocity[near] - x * 2.0).norm() < 0.1, "{}", velocity[near]);
    }

    // Large enough a bound fills the hole as well.
    let found = surface(&positions, &params(200.0));
    let stats = found.stats.components.unwrap();
    assert_eq!((found.check.components, stats.points, stats.bubbles), (1, 3, 1));
    let nothing = surface(&positions, &params(1e6));
    assert!(nothing.mesh.positions.is_empty() && nothing.points.unwrap().positions.len() == 4);
}

#[test]
fn clean_up_has_the_same_bytes_for_any_number_of_threads() {
    let ball = particles([9; 3], 0.2, Vec3::new(40.0, -30.0, 20.0), |x| x.norm() < 9.0 || x.x == 9.0);
    let ids: Vec<u32> = (0..ball.len() as u32).collect();
    let velocity: Vec<Vec3> = ball.vec3("position").unwrap().iter().map(|x| x.yzx()).collect();
    let ball = ball.with("velocity", velocity).with("id", ids);
    let params = SurfaceParams {
        components: Some(ComponentParams::default()),
        decimation: Some(DecimationParams::default()),
        attributes: Some(["velocity", "vorticity", "id"].map(String::from).into()),
        ..smoothed()
    };
    let expected = par::with_threads(1, || surface(&ball, &params));
    assert_eq!(expected.mesh.attributes.len(), 3);
    for &threads in crate::thread_counts() {
        let again = par::with_threads(threads, || surface(&ball, &params));
        assert!(again.mesh == expected.mesh && again.points == expected.points, "{threads} threads");
        assert_eq!(again.stats.smoothing, expected.stats.smoothing);
        assert_eq!(again.stats.decimation, expected.stats.decimation);
    }
}

#[test]
fn attributes_are_taken_by_name() {
    let turn = Vec3::new(0.3, -1.0, 2.0);
    let ball = particles([8; 3], 0.2, Vec3::new(1.0, 2.0, 3.0), |x| x.norm() < 8.0);
    let x: Vec<Vec3> = ball.vec3("position").unwrap().to_vec();
    let age: Vec<f32> = x.iter().map(|x| 2.0 * x.x - x.z).collect();
    let ball = ball
        .with("velocity", x.iter().map(|x| turn.cross(x)).collect::<Vec<_>>())
        .with("age", age)
        .with("id", (0..x.len() as u32).map(|i| i * 7).collect::<Vec<_>>());
    let vertices: Vec<Vec3> = surface(&ball, &SurfaceParams::default()).mesh.positions;
    let names = |names: &[&str]| Some(names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>());
    let requested = names(&["vorticity", "age", "id", "velocity"]);
    let (found, missing) = transfer(&ball, requested.as_deref(), &vertices, 2.0 * SPACING).unwrap();
    assert_eq!(missing, 0);
    let [
        ChannelData::Vec3(vorticity),
        ChannelData::F32(age),
        ChannelData::U32(id),
        ChannelData::Vec3(velocity),
    ] = [0, 1, 2, 3].map(|i| &found[i].data)
    else {
        panic!("channels keep their kinds")
    };
    for (v, at) in vertices.iter().enumerate() {
        assert!((vorticity[v] - turn * 2.0).norm() < 0.02, "{}", vorticity[v]);
        assert!((age[v] - (2.0 * at.x - at.z)).abs() < 0.2);
        assert!((velocity[v] - turn.cross(at)).norm() < 0.25);
        let nearest =
            (0..x.len()).min_by(|&i, &j| (x[i] - at).norm_squared().total_cmp(&(x[j] - at).norm_squared()));
        assert_eq!(id[v], 7 * nearest.unwrap() as u32);
    }
    // The default is velocity alone; an empty list gives no attributes; a missing name is an error.
    let plain = transfer(&ball, None, &vertices, 2.0 * SPACING).unwrap().0;
    assert!(plain.len() == 1 && plain[0] == found[3]);
    assert!(transfer(&ball, Some(&[]), &vertices, 2.0 * SPACING).unwrap().0.is_empty());
    let params = SurfaceParams { attributes: names(&["velocity", "heat"]), ..SurfaceParams::default() };
    let error = reconstruct(&ball, SPACING, &params, &CancelToken::new()).unwrap_err();
    assert!(matches!(&error, SurfaceError::NoChannel { name, .. } if name == "heat"), "{error}");
    assert!(error.to_string().contains("position, velocity, age, id"), "{error}");
}

/// Beyond the kernel the nearest particle gives every kind of value; a lone particle does not turn.
#[test]
fn attributes_beyond_the_kernel_are_the_nearest_particles() {
    let particles: Vec<Vec3> = (0..5).map(|i| Vec3::new(i as f32, 0.0, 0.0)).collect();
    let stream = Stream::new("liquid", StreamKind::Particles, 5)
        .with("velocity", particles.iter().map(|x| x.yxz() * 3.0).collect::<Vec<_>>())
        .with("age", vec![0.5, 1.5, 2.5, 3.5, 4.5])
        .with("id", vec![50_u32, 51, 52, 53, 54])
        .with("position", particles);
    let names = ["id", "age", "velocity", "vorticity"].map(String::from);
    let vertices = [Vec3::new(3.1, 0.0, 0.4), Vec3::new(-7.0, 2.0, 0.0), Vec3::new(2.0, 0.0, 0.1)];
    let (found, missing) = transfer(&stream, Some(&names), &vertices, 0.2).unwrap();
    assert_eq!(missing, 2);
    assert_eq!(found[0].data, vec![53_u32, 50, 52].into());
    assert_eq!(found[1].data, vec![3.5_f32, 0.5, 2.5].into());
    assert_eq!(found[2].data, vec![Vec3::new(0.0, 9.0, 0.0), Vec3::zeros(), Vec3::new(0.0, 6.0, 0.0)].into());
    assert_eq!(found[3].data, vec![Vec3::zeros(); 3].into());
    let nothing = Stream::new("liquid", StreamKind::Particles, 0)
        .with("position", Vec::<Vec3>::new())
        .with("age", Vec::<f32>::new())
        .with("id", Vec::<u32>::new());
    let (found, missing) = transfer(&nothing, Some(&names[..2]), &vertices, 0.2).unwrap();
    assert_eq!(
        (&found[0].data, &found[1].data, missing),
        (&vec![0_u32; 3].into(), &vec![0.0_f32; 3].into(), 3)
    );
}

/// The mesh of particles that only move together does not breathe.
#[test]
fn a_still_ball_moved_by_less_than_a_voxel_keeps_volume_and_area() {
    let smoothing = smoothed().smoothing;
    let decimation = Some(DecimationParams { fraction: 0.25, ..DecimationParams::default() });
    for (name, params) in [
        ("smoothed", SurfaceParams { smoothing: smoothing.clone(), ..SurfaceParams::default() }),
        ("plain", SurfaceParams::default()),
        ("decimated", SurfaceParams { decimation, ..SurfaceParams::default() }),
        ("smoothed and decimated", SurfaceParams { smoothing, decimation, ..SurfaceParams::default() }),
        ("fine", SurfaceParams { voxel: 0.25, ..SurfaceParams::default() }),
        ("coarse", SurfaceParams { voxel: 1.0, ..SurfaceParams::default() }),
    ] {
        let steps = if crate::is_soak() { 20 } else { 8 };
        let figures: Vec<[f64; 2]> = (0..steps)
            .map(|step| {
                let drift = step as f32 / steps as f32 * params.voxel * SPACING;
                let ball = particles([8; 3], 0.15, Vec3::new(1.0, 0.3, -0.7) * drift, |x| x.norm() < 8.0);
                let found = surface(&ball, &params);
                [found.check.volume, found.check.area]
            })
            .collect();
        let spread = |i: usize| {
            let values = || figures.iter().map(|pair| pair[i]);
            values().fold(f64::MIN, f64::max) / values().fold(f64::MAX, f64::min) - 1.0
        };
        println!("{name}: volume varies by {:.4} %, area by {:.4} %", 100.0 * spread(0), 100.0 * spread(1));
        let bounds = if name == "coarse" { [6e-3, 1.5e-2] } else { [3e-3, 3e-3] };
        assert!(spread(0) < bounds[0] && spread(1) < bounds[1], "{name}");
    }
}

#[test]
fn normals_of_faces_point_outward() {
    let ball = particles([6; 3], 0.0, Vec3::zeros(), |x| x.norm() < 6.0);
    let mesh = surface(&ball, &SurfaceParams::default()).mesh;
    let normals = normals_from_faces(&mesh);
    assert!(mesh.positions.iter().zip(&normals).all(|(x, n)| n.dot(&x.normalize()) > 0.7));
    assert_eq!(normals_from_faces(&Mesh { positions: vec![Vec3::zeros()], ..Mesh::default() }), [Vec3::z()]);
}
