//! Sheets on sliding and turning solids: friction holds them below its limit, and they slip as predicted
//! above it.

use super::*;
use crate::solids::cuboid;
use meniscus::solid::{Interpolation, Keyframe, Motion};

const GRAVITY: f64 = 9.81;

/// Supports of a sheet on a plate: terms of the preset, and the distance from the plate [m].
fn supports() -> [(&'static str, f32); 2] {
    // ξ ln(c/(ξ ρ g)) of a sheet of 1 kg/m².
    let off = 0.02 * (50.0 / GRAVITY as f32).ln();
    [("", 0.0), ("[sheets.repulsion]\nenergy = 1.0\nrange = 0.02\n", off)]
}

/// Shapes with their top at z = 0.
fn plates() -> [Shape; 2] {
    let (min, max) = ([-2.0, -2.0, -0.4], [2.0, 2.0, 0.0]);
    [Shape::Box { min, max }, Shape::Mesh(cuboid(min, max, 60))]
}

const SOLVERS: [&str; 2] =
    ["integrator = 'symplectic'\ncourant = 0.1", "integrator = 'implicit'\nsubsteps = 40\ntolerance = 1e-6"];

/// Every support, on every plate, with each integrator.
fn cases() -> Vec<(Shape, &'static str, f32, &'static str)> {
    let mut out = Vec::new();
    for shape in plates() {
        for (terms, off) in supports() {
            out.extend(SOLVERS.map(|solver| (shape.clone(), terms, off, solver)));
        }
    }
    out
}

/// A sheet of 1 kg/m² with these sides and cells, centred at `x` on a plate.
fn lying(x: f32, side: f32, cells: u32, friction: f64, terms: &str, off: f32, solver: &str) -> String {
    let sheet = grid(
        [x - 0.5 * side, -0.5 * side, off],
        [side, 0.0, 0.0],
        [0.0, side, 0.0],
        [cells; 2],
        "density = 1.0\nstiffness = [500.0, 500.0]\nshear = 100.0",
    );
    format!("sheets.friction = {friction}\n{sheet}\n[sheets.solver]\n{solver}\n{terms}")
}

/// A world in which the plate moves from rest by `x` [m] or turns by `degrees` in a time [frames].
fn plate(shape: Shape, interpolation: Interpolation, frames: u32, x: f32, degrees: f32) -> World {
    let key = |frame, x, turn| Keyframe {
        frame,
        position: [x, 0.0, 0.0],
        rotation: [0.0, 0.0, turn],
        quaternion: None,
        scale: 1.0,
    };
    let mut world = world(GRAVITY as f32, vec![shape]);
    world.solids[0].motion =
        Motion::new(&[key(1, 0.0, 0.0), key(1 + frames, x, degrees)], interpolation, 24.0, 1);
    world
}

fn mean(of: &[Vec3]) -> nalgebra::Vector3<f64> {
    of.iter().map(|x| x.cast::<f64>()).sum::<nalgebra::Vector3<f64>>() / of.len() as f64
}

/// X (3 p² − 2 p³), p = t/T: the plate's acceleration starts at 6 X/T² and ends at −6 X/T².
#[test]
fn a_sliding_plate_takes_a_sheet_along_below_its_friction_and_slips_above() {
    let friction = 0.3;
    let held = friction * GRAVITY;
    for (shape, terms, off, solver) in cases() {
        let slid = |x: f64, frames: u32| {
            let world = plate(shape.clone(), Interpolation::Smooth, 24, x as f32, 0.0);
            let mut sheets = sheets(&lying(0.0, 0.2, 2, friction, terms, off, solver), &world);
            run(&mut sheets, 0, frames).unwrap();
            [mean(&sheets.positions()).x, mean(&sheets.velocities()).x]
        };
        // A fifth less than friction holds: the sheet moves with the plate, halfway and at the end.
        let x = 0.8 * held / 6.0;
        for (frames, expected, speed) in [(12, 0.5 * x, 1.5 * x), (28, x, 0.0)] {
            let [displacement, v] = slid(x, frames);
            println!("displacement: {displacement} {expected}, {v} {speed}");
            assert!(
                (displacement - expected).abs() < 1e-3 * x && (v - speed).abs() < 1e-2 * x,
                "{solver}{terms}: {displacement} {expected}, {v} {speed}"
            );
        }
        // Twice what friction holds. The sheet slips with μ g until half the time, sticks, and slips on from
        // three quarters to 9/8 of it.
        let x = 2.0 * held / 6.0;
        let t: f64 = 10.0 / 24.0;
        for (frames, expected, speed) in [
            (10, 0.5 * held * t * t, held * t),
            (16, x * (0.375 - 0.5 + 4.0 / 3.0 - 16.0 / 27.0), 6.0 * x * (2.0 / 9.0)),
            (30, x * (0.375 + 0.34375 + 0.2109375), 0.0),
        ] {
            let [displacement, v] = slid(x, frames);
            println!("slipping: {displacement} {expected}, {v} {speed}");
            // For a substep of 1 ms, of the second in which the plate accelerates and brakes.
            assert!(
                (displacement / expected - 1.0).abs() < 0.01 && (v - speed).abs() < 0.01 * x,
                "{solver}{terms}: {displacement} {expected}, {v} {speed}"
            );
        }
    }
}

/// Four points in the middle of a plate that turns with ω from the start: friction accelerates them with μ
/// g/r until they turn with it.
#[test]
fn a_turning_plate_spins_a_sheet_up_as_fast_as_friction_can() {
    let (friction, omega, side) = (0.1, 3.0_f64, 0.2_f64);
    let rise = friction * GRAVITY / (0.5_f64.sqrt() * side);
    for (shape, terms, off, solver) in cases() {
        let world = plate(shape, Interpolation::Linear, 48, 0.0, (2.0 * omega).to_degrees() as f32);
        let mut sheets = sheets(&lying(0.0, side as f32, 1, friction, terms, off, solver), &world);
        for (from, to) in [(0, 6), (6, 18)] {
            run(&mut sheets, from, to - from).unwrap();
            let [_, (turning, _)] = momenta(&sheets);
            let inertia: f64 = sheets
                .positions()
                .iter()
                .enumerate()
                .map(|(i, x)| f64::from(sheets.mass(i) * x.xy().norm_squared()))
                .sum();
            let expected = (rise * f64::from(to) / 24.0).min(omega);
            let found = turning.z / inertia;
            println!("{found} {expected}");
            assert!((found / expected - 1.0).abs() < 0.01, "{solver}{terms}: {found} {expected}");
        }
    }
}

/// A sheet off the axis that turns with the plate from the start: friction holds it while ω² r < μ g.
#[test]
#[ignore = "long: tools/soak/run"]
fn a_turning_plate_keeps_a_sheet_on_its_circle_below_its_friction_and_throws_it_off_above() {
    let (friction, radius) = (0.4, 0.5_f64);
    for (shape, terms, off, solver) in cases() {
        let thrown = |part: f64, frames: u32| {
            let omega = (part * friction * GRAVITY / radius).sqrt();
            let world =
                plate(shape.clone(), Interpolation::Linear, 48, 0.0, (2.0 * omega).to_degrees() as f32);
            let text = lying(radius as f32, 0.2, 0, friction, terms, off, solver);
            let turning = |_, x: Vec3, _| {
                let x = Vec3::new(radius as f32, 0.0, x.z);
                (x, Vec3::new(0.0, omega as f32 * x.x, 0.0))
            };
            let mut sheets = placed(&text, &world, turning);
            // A point has no springs that limit substeps.
            run_at(&mut sheets, 0, 20 * frames, FRAME / 20.0).unwrap();
            (sheets.positions()[0].cast::<f64>(), omega)
        };
        // Nine tenths of it: one second, on the circle.
        let (found, omega) = thrown(0.9, 24);
        let expected = nalgebra::Vector2::new(omega.cos(), omega.sin()) * radius;
        println!("held: {found} {expected}");
        assert!((found.xy() - expected).norm() < 2e-3, "{solver}{terms}: {found} {expected}");
        // A fifth more: outwards, like a point with friction on a disc.
        let (found, omega) = thrown(1.2, 12);
        let expected = with_friction(radius, omega, friction * GRAVITY, 0.5);
        println!("thrown: {found} {expected}, from {radius}");
        assert!(expected.norm() > radius + 0.05, "{expected}");
        assert!(
            (found.xy() - expected).norm() < 0.02 * (expected.norm() - radius),
            "{solver}{terms}: {found} {expected}"
        );
    }
}

/// Position after `time` [s] of a point that starts with the disc under it. The disc turns with `omega` [1/s]
/// and its friction exerts up to `held` [m/s²].
fn with_friction(radius: f64, omega: f64, held: f64, time: f64) -> nalgebra::Vector2<f64> {
    let (steps, mut x) = (200_000, nalgebra::Vector2::new(radius, 0.0));
    let mut v = nalgebra::Vector2::new(0.0, omega * radius);
    let dt = time / f64::from(steps);
    for _ in 0..steps {
        let slip = v - nalgebra::Vector2::new(-x.y, x.x) * omega;
        // At the start it slips outwards; friction is then μ g inwards.
        let displacement = slip.try_normalize(1e-12).unwrap_or_else(|| x.normalize());
        v -= displacement * (held * dt);
        x += v * dt;
    }
    x
}
