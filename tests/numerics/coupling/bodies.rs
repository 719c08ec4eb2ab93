//! Rigid bodies and sheets in contact: momentum, rest, friction, and the same bytes every time.

use super::*;
use meniscus::sim::{coupling::BodySheetRecord, rigid::BodyParams};

const INTEGRATORS: [&str; 2] = ["symplectic", "implicit"];

/// A cloth of 0.8 m at the origin, and bodies.
fn shot(gravity: [f32; 3], integrator: &str, terms: &str, bodies: Vec<BodyParams>) -> (World, Systems) {
    let cloth = sheet("cloth", 0.8, 0.0, 16, &format!("density = 0.4\nshear = 100\n{terms}"));
    let solver =
        format!("[sheets]\nfriction = 0.5\n[sheets.solver]\nintegrator = '{integrator}'\nsubsteps = 16\n");
    let world = World { gravity: gravity.into(), solids: Vec::new() };
    (world, Systems { bodies, ..systems(&(cloth + &solver)) })
}

fn start((world, systems): (World, Systems)) -> Simulation {
    Simulation::new(world, systems).unwrap_or_else(|error| panic!("{error}"))
}

fn ball(radius: f32, density: f32, position: [f32; 3], velocity: [f32; 3]) -> BodyParams {
    let shape = Shape::Sphere { center: [0.0; 3], radius };
    BodyParams { position, velocity, ..BodyParams::new(shape, density) }
}

fn contact(record: &FrameRecord) -> BodySheetRecord {
    record.coupling.as_ref().and_then(|coupling| coupling.bodies.clone()).expect("they are coupled")
}

fn energy(record: &FrameRecord) -> f64 {
    let (sheets, bodies) = (record.sheets.as_ref().unwrap(), record.bodies.as_ref().unwrap());
    [sheets.kinetic_energy, sheets.elastic_energy, sheets.potential_energy].iter().sum::<f64>()
        + bodies.kinetic_energy
        + bodies.potential_energy
}

#[test]
fn a_thrown_ball_and_a_free_cloth_exchange_momentum() {
    let (radius, speed) = (0.1_f32, 2.0_f64);
    let cloth = point_mass(0.8, 16, 0.4);
    let volume = 4.0 / 3.0 * std::f64::consts::PI * f64::from(radius).powi(3);
    for integrator in INTEGRATORS {
        for ratio in [1e-3, 1.0, 1e3] {
            let mass = ratio * 0.4 * 0.64;
            let thrown = BodyParams {
                angular_velocity: [0.0, 0.0, 500.0],
                friction: 0.5,
                ..ball(radius, (mass / volume) as f32, [0.1, 0.05, 0.12], [0.3, 0.0, -speed as f32])
            };
            let mut simulation = start(shot([0.0; 3], integrator, "stiffness = [300, 300]", vec![thrown]));
            let of = |simulation: &Simulation| {
                let frame = state(simulation);
                let [p, l] = momenta(
                    &cloth,
                    &channel(&frame, "sheet.cloth", "position"),
                    &channel(&frame, "sheet.cloth", "velocity"),
                );
                let [x, v, spin] = ["position", "velocity", "angular_velocity"]
                    .map(|name| channel(&frame, "bodies", name)[0]);
                let inertia = 0.4 * mass * f64::from(radius).powi(2);
                ([p + v * mass, l + x.cross(&v) * mass + spin * inertia], v)
            };
            let ([p, l], _) = of(&simulation);
            let records = advance(&mut simulation, 6);
            let ([p_end, l_end], v) = of(&simulation);
            let (off, turned) = ((p_end - p).norm() / p.norm(), (l_end - l).norm() / p.norm());
            let touching = records.iter().map(|record| contact(record).contacts).max().unwrap();
            let depth = records.iter().map(|record| contact(record).penetration).fold(0.0, f64::max);
            println!(
                "{integrator} {ratio}: momentum off by {off}, angular by {turned} m, {v:?}, {touching} contacts, {depth} m"
            );
            assert!(off < 1e-4 && turned < 2e-3, "{integrator}, ratio {ratio}: {off}, {turned}");
            assert!(touching > 0 && depth < 0.02, "{integrator}, ratio {ratio}: {touching}, {depth}");
            let energies: Vec<f64> = records.iter().map(energy).collect();
            let first =
                0.5 * mass * (speed * speed + 0.09) + 0.2 * mass * 0.01 * 500.0_f64.to_radians().powi(2);
            println!("  {first}: {energies:?}");
            assert!(
                energies.iter().all(|e| *e < 1.001 * first),
                "{integrator}, ratio {ratio}: {energies:?} of {first}"
            );
            match ratio {
                1e-3 => assert!(v.z > -0.1 * speed, "a light ball stops: {v:?}"),
                1.0 => assert!(v.z > -0.9 * speed, "{v:?}"),
                _ => assert!(v.z < -0.99 * speed, "a heavy one takes the cloth with it: {v:?}"),
            }
        }
    }
}

#[test]
fn a_ball_rests_in_a_cloth_whatever_the_integrator() {
    let pins = format!(
        "stiffness = [500, 500]\nspring_damping = [0.005, 0.005]\npin = [{{ at = {{ points = {:?} }} }}]",
        border(16)
    );
    let heights = INTEGRATORS.map(|integrator| {
        let heavy = ball(0.1, 125.0, [0.0, 0.0, 0.101], [0.0; 3]);
        let mut simulation = start(shot([0.0, 0.0, -9.81], integrator, &pins, vec![heavy]));
        advance(&mut simulation, 33);
        // It still swings: the place about which it does.
        let (mut mean, frames) = (Double::zeros(), 15);
        for _ in 0..frames {
            let records = advance(&mut simulation, 1);
            let found = contact(&records[0]);
            assert!(
                found.penetration < 0.01 && found.contacts > 3 && found.unconverged == 0,
                "{integrator}: {found:?}"
            );
            mean += channel(&state(&simulation), "bodies", "position")[0] / f64::from(frames);
        }
        let v = channel(&state(&simulation), "bodies", "velocity")[0];
        println!("{integrator}: at {mean:?} with {v:?}");
        assert!(v.norm() < 0.3 && mean.xy().norm() < 0.01, "{integrator}: {mean:?}, {v:?}");
        mean.z
    });
    // The cloth sags by a tenth of a metre more.
    assert!((-0.03..-0.01).contains(&heights[0]) && (heights[0] - heights[1]).abs() < 0.003, "{heights:?}");
}

#[test]
fn friction_holds_a_box_on_a_taut_slope() {
    let pins = format!(
        "stiffness = [2000, 2000]\nrest = [0.9, 0.9]\ndamping = 4\npin = [{{ at = {{ points = {:?} }} }}]",
        border(16)
    );
    let slope = 20.0_f64.to_radians();
    for integrator in INTEGRATORS {
        for friction in [0.0_f32, 0.02, 0.98] {
            let shape = Shape::Ellipsoid { center: [0.0; 3], radii: [0.1, 0.1, 0.03] };
            let on = BodyParams { position: [-0.15, 0.0, 0.031], friction, ..BodyParams::new(shape, 200.0) };
            let gravity = [9.81 * slope.sin() as f32, 0.0, -9.81 * slope.cos() as f32];
            let mut simulation = start(shot(gravity, integrator, &pins, vec![on]));
            advance(&mut simulation, 10);
            let [x, v] = ["position", "velocity"].map(|name| channel(&state(&simulation), "bodies", name)[0]);
            // √(0.5 μ): 0, 0.1, 0.7.
            let mu = (0.5 * f64::from(friction)).sqrt();
            let accelerated = 9.81 * (slope.sin() - mu * slope.cos()).max(0.0) * 10.0 * FRAME;
            println!("{integrator}, {mu}: at {x:?} with {v:?}, {accelerated} m/s on a plane");
            if friction > 0.5 {
                assert!(v.x.abs() < 0.1 && (x.x + 0.15).abs() < 0.02, "{integrator}: it stays: {x:?} {v:?}");
            } else {
                assert!(
                    (v.x / accelerated - 1.0).abs() < 0.1,
                    "{integrator}, {mu}: {v:?}, not {accelerated}"
                );
            }
        }
    }
}

#[test]
fn bodies_and_sheets_have_the_same_bytes_on_any_threads_and_resumed() {
    for integrator in INTEGRATORS {
        let scene = || {
            let bodies = vec![
                ball(0.1, 300.0, [0.0, 0.02, 0.15], [0.0, 0.0, -1.0]),
                ball(0.08, 900.0, [0.1, 0.0, 0.4], [0.0, 0.0, -3.0]),
            ];
            shot([0.0, 0.0, -9.81], integrator, "stiffness = [500, 500]\npin = [{ at = 'corners' }]", bodies)
        };
        let run = || {
            let mut simulation = start(scene());
            advance(&mut simulation, 2);
            let middle = state(&simulation);
            let records = advance(&mut simulation, 3);
            (middle, state(&simulation), records.iter().map(contact).collect::<Vec<_>>())
        };
        let (middle, end, records) = meniscus::par::with_threads(1, run);
        assert!(records.iter().any(|record| record.contacts > 8), "they touch: {records:?}");
        let two = meniscus::par::with_threads(2, run);
        assert!(two.1 == end && two.2 == records, "{integrator}: 2 threads");
        let (world, systems) = scene();
        let mut resumed = Simulation::restore(world, systems, &middle).unwrap();
        advance(&mut resumed, 3);
        assert!(state(&resumed) == end, "{integrator}: resumed");
    }
}

#[test]
fn a_body_on_a_cloth_on_a_floor_is_held_by_friction_alone() {
    for integrator in INTEGRATORS {
        for friction in [0.0_f32, 0.9] {
            let half = [0.1, 0.1, 0.05];
            let shape = Shape::Box { min: half.map(|h: f32| -h), max: half };
            let crate_ = BodyParams {
                position: [0.0, 0.0, 0.054],
                velocity: [0.5, 0.0, 0.0],
                friction,
                ..BodyParams::new(shape, 500.0)
            };
            let (mut world, systems) =
                shot([0.0, 0.0, -9.81], integrator, "stiffness = [1000, 1000]", vec![crate_]);
            let floor = Shape::Plane { point: [0.0, 0.0, -0.003], normal: [0.0, 0.0, 1.0] };
            world.solids = vec![Solid::fixed(floor)];
            let mut simulation = start((world, systems));
            let records = advance(&mut simulation, 12);
            let [x, v] = ["position", "velocity"].map(|name| channel(&state(&simulation), "bodies", name)[0]);
            let deepest = records.iter().map(|record| contact(record).penetration).fold(0.0, f64::max);
            println!("{integrator}, {friction}: at {x:?} with {v:?}, {deepest} deep");
            assert!((x.z - 0.05 + 0.003).abs() < 0.001, "{integrator}: it lies on the cloth: {x:?}");
            if friction > 0.0 {
                assert!(v.norm() < 0.02, "{integrator}: it comes to rest: {v:?}");
            } else {
                assert!((v.x - 0.5).abs() < 0.01, "{integrator}: it glides: {v:?}");
            }
        }
    }
}

#[test]
fn a_stick_lies_on_the_pinned_border_of_a_cloth() {
    for integrator in INTEGRATORS {
        let pins = format!("stiffness = [500, 500]\npin = [{{ at = {{ points = {:?} }} }}]", border(16));
        let shape = Shape::Capsule { from: [-0.2, 0.0, 0.0], to: [0.2, 0.0, 0.0], radius: 0.03 };
        let stick = BodyParams { position: [0.0, -0.4, 0.04], ..BodyParams::new(shape, 500.0) };
        let mut simulation = start(shot([0.0, 0.0, -9.81], integrator, &pins, vec![stick]));
        advance(&mut simulation, 6);
        let x = channel(&state(&simulation), "bodies", "position")[0];
        println!("{integrator}: {x:?}");
        assert!((x.z - 0.03).abs() < 1e-3, "{integrator}: it is half in the cloth: {x:?}");
    }
}

/// In long substeps a taut cloth would cross the ball, and its points are then beyond the centre.
#[test]
fn energy_falls_where_a_heavy_ball_meets_a_taut_cloth_in_long_substeps() {
    let (speed, height) = (3.0_f32, 0.11_f32);
    for (stiffness, mass) in [(1e4, 8.0), (1e5, 8.0), (1e5, 80.0)] {
        let terms = format!(
            "stiffness = [{stiffness:?}, {stiffness:?}]\npin = [{{ at = {{ points = {:?} }} }}]",
            border(16)
        );
        for substeps in [8, 32] {
            let density = mass / (4.0 / 3.0 * std::f32::consts::PI * 0.1_f32.powi(3));
            let heavy = BodyParams {
                angular_velocity: [0.0, 300.0, 0.0],
                friction: 0.5,
                ..ball(0.1, density, [0.0, 0.0, height], [0.0, 0.0, -speed])
            };
            let (world, mut systems) = shot([0.0, 0.0, -9.81], "implicit", &terms, vec![heavy]);
            systems.sheets.as_mut().unwrap().params.common.solver.substeps = substeps;
            let mut simulation = start((world, systems));
            let spin =
                |simulation: &Simulation| channel(&state(simulation), "bodies", "angular_velocity")[0].y;
            let inertia = 0.4 * f64::from(mass) * 0.01;
            let (first_spin, mut counted) = (spin(&simulation), 0);
            let mut last =
                f64::from(mass * (0.5 * speed * speed + 9.81 * height)) + 0.5 * inertia * first_spin.powi(2);
            for frame in 0..12 {
                let record = &advance(&mut simulation, 1)[0];
                let (energy, found, spin) = (energy(record), contact(record), spin(&simulation));
                let sheets = record.sheets.as_ref().unwrap();
                println!(
                    "{stiffness} N/m, {mass} kg, {substeps}: {energy} J, {spin} 1/s, {found:?}, {} gained",
                    sheets.overshot_energy
                );
                let case = format!("{stiffness} N/m, {mass} kg, {substeps}, frame {frame}");
                assert!(energy < 1.0001 * last, "{case}: {energy} of {last} J");
                assert!(found.penetration < 0.015, "{case}: {found:?}");
                assert!(
                    spin.abs() < 1.001 * first_spin,
                    "friction slows it down, {case}: {spin} of {first_spin}"
                );
                (last, counted) = (energy, counted + sheets.overshot);
            }
            // What springs gain by the linearisation, because the ball pushes them, is counted; other springs are at rest.
            assert_eq!(counted > 0, stiffness == 1e5 && mass == 8.0 && substeps == 8, "{counted}");
        }
    }
}
