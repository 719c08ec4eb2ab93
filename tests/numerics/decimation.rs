//! Decimation: targets, errors, and where the mesh went.

use super::{
    cleanup::{SPACING, decimated, particles, roughness, smoothed, surface},
    mesh::{distance, noise, torus},
};
use meniscus::{
    frame::{Stream, StreamKind},
    math::Vec3,
    mesh::{DecimationParams, Mesh, SurfaceParams, check, decimate, marching_cubes},
};

#[test]
fn decimation_reaches_its_target_or_its_error() {
    let ball = particles([12; 3], 0.1, Vec3::zeros(), |x| x.norm() < 12.0);
    let plain = surface(&ball, &smoothed());
    for fraction in [0.5, 0.2, 0.05] {
        let params = SurfaceParams {
            smoothing: smoothed().smoothing,
            ..decimated(DecimationParams { fraction, ..DecimationParams::default() })
        };
        let found = surface(&ball, &params);
        let stats = found.stats.decimation.unwrap();
        let part = found.mesh.triangles.len() as f64 / plain.mesh.triangles.len() as f64;
        let volume = found.check.volume / plain.check.volume - 1.0;
        println!(
            "fraction {fraction}: {part:.4}, volume {volume:.1e}, {:?}, {stats:?}",
            roughness(&found.mesh)
        );
        assert!(part <= f64::from(fraction) && part > 0.98 * f64::from(fraction) && volume.abs() < 0.01);
        assert_eq!((found.check.components, found.check.euler), (1, 2));
    }
    for error in [0.01, 0.05] {
        let found = surface(
            &ball,
            &decimated(DecimationParams { fraction: 0.0, error: Some(error), ..DecimationParams::default() }),
        );
        let stats = found.stats.decimation.unwrap();
        println!("error {error}: {stats:?}");
        assert!(
            stats.largest_error <= f64::from(error * SPACING)
                && stats.after < stats.before
                && stats.after > 100
        );
    }
    let few =
        surface(&ball, &decimated(DecimationParams { triangles: Some(1000), ..DecimationParams::default() }));
    assert!((998..=1000).contains(&few.mesh.triangles.len()));
    let all = surface(&ball, &decimated(DecimationParams { fraction: 1.0, ..DecimationParams::default() }));
    assert_eq!(all.mesh, surface(&ball, &SurfaceParams::default()).mesh);
}

/// How far vertices and the middles of triangles are from a surface, root mean square and most.
fn distances(mesh: &Mesh, exact: impl Fn([f64; 3]) -> f64) -> (f64, f64) {
    let corner = |v: u32| mesh.positions[v as usize].cast::<f64>();
    let middles =
        mesh.triangles.iter().map(|t| t.iter().map(|&v| corner(v)).sum::<nalgebra::Vector3<f64>>() / 3.0);
    let all: Vec<f64> =
        (0..mesh.positions.len() as u32).map(corner).chain(middles).map(|x| exact(x.into()).abs()).collect();
    let mean = all.iter().map(|d| d * d).sum::<f64>() / all.len() as f64;
    (mean.sqrt(), all.iter().copied().fold(0.0, f64::max))
}

/// The bound is the tool's own figure; this is where the mesh went.
#[test]
fn decimation_stays_near_the_surface_and_halves_with_its_error() {
    let exact = torus(0.6, 0.25);
    let (plain, _) = marching_cubes(&distance(0.025, 0.95, torus(0.6, 0.25)));
    let own = distances(&plain, &exact);
    println!("{} triangles as cut: {own:?}", plain.triangles.len());
    let found: Vec<(f64, f64)> = [4e-3, 2e-3, 1e-3]
        .map(|error| {
            let mut mesh = plain.clone();
            let params =
                DecimationParams { fraction: 0.0, error: Some(error), ..DecimationParams::default() };
            let stats = decimate(&mut mesh, &params, 1.0);
            let (mean, most) = distances(&mesh, &exact);
            println!("error {error}: {} triangles, {mean:.1e} and {most:.1e}", stats.after);
            assert_eq!((check(&mesh).components, check(&mesh).euler, stats.over_target), (1, 0, 0));
            assert!(mean < 1.5 * f64::from(error) && most < 6.0 * f64::from(error), "{mean:e} {most:e}");
            (mean, most)
        })
        .into();
    for pair in found.windows(2) {
        assert!((1.4..3.0).contains(&(pair[0].0 / pair[1].0)), "{found:?}");
    }
}

#[test]
fn an_unreachable_target_is_reported() {
    let droplets: Vec<Vec3> =
        (0..30).map(|i| Vec3::new((i % 6) as f32, (i / 6) as f32, 0.03) * 0.5).collect();
    let stream = Stream::new("liquid", StreamKind::Particles, droplets.len()).with("position", droplets);
    let run = |triangles, error| {
        let found = surface(
            &stream,
            &decimated(DecimationParams { fraction: 1.0, triangles: Some(triangles), error }),
        );
        (found.mesh.triangles.len(), found.stats.decimation.unwrap().over_target)
    };
    let (left, over) = run(50, None);
    assert!(left >= 4 * 30, "a closed piece has four triangles or more: {left}");
    assert_eq!(over, left - 50);
    assert_eq!(run(50, Some(10.0)).1, 0, "the error decides");
    let plain = surface(&stream, &SurfaceParams::default()).mesh.triangles.len();
    assert_eq!(run(plain as u32 - 30, None), (plain - 30, 0));
}

#[test]
fn an_open_mesh_is_not_decimated() {
    let (mut mesh, _) = marching_cubes(&noise(1, |bits| (bits >> 40) as f32 / (1 << 23) as f32 - 1.0));
    mesh.triangles.pop();
    let before = mesh.clone();
    let stats = decimate(&mut mesh, &DecimationParams::default(), 0.1);
    assert!(stats.unsuitable && mesh == before && stats.before == stats.after);
}
