//! Liquid, sheets and rigid bodies that push each other: momentum, weight, and the same bytes every time.

use super::*;
use meniscus::sim::{SetupError, rigid::BodyParams};

const SPACING: f64 = 0.025;

fn ball(radius: f32, density: f32, position: [f32; 3], velocity: [f32; 3]) -> BodyParams {
    let shape = Shape::Sphere { center: [0.0; 3], radius };
    BodyParams { position, velocity, friction: 0.4, ..BodyParams::new(shape, density) }
}

/// A cloth under a block of liquid, and bodies.
fn shot(gravity: f32, cloth: &str, source: &str, bodies: Vec<BodyParams>) -> (World, Systems) {
    let text = format!(
        "[liquid]\nspacing = {SPACING}\n{source}{}[sheets]\nfriction = 0.3\n[sheets.solver]\nintegrator = 'implicit'\n\
         [[coupling]]\nbetween = ['liquid', 'cloth']\nfriction = 0.3\n",
        sheet("cloth", 0.8, 0.0, 24, cloth)
    );
    (world(gravity, Vec::new()), Systems { bodies, ..systems(&text) })
}

fn start((world, systems): (World, Systems)) -> Simulation {
    Simulation::new(world, systems).unwrap_or_else(|error| panic!("{error}"))
}

fn mass(radius: f64, density: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3) * density
}

#[test]
fn all_three_exchange_momentum() {
    let falling = block([-0.15, -0.15, 0.05], [0.15, 0.15, 0.2], [0.0, 0.0, -1.0]);
    let cloth = "density = 2\nstiffness = [400, 400]\nshear = 80\nspring_damping = [0.01, 0.01]";
    for density in [100.0, 8000.0, 1000.0].into_iter().take(if crate::is_soak() { 3 } else { 2 }) {
        // One comes from below, against the liquid on the other side, and one is thrown into the liquid.
        let bodies = vec![
            ball(0.08, density, [0.03, 0.02, -0.1], [0.1, 0.0, 1.0]),
            ball(0.06, density, [-0.05, 0.0, 0.3], [0.0, 0.0, -2.0]),
        ];
        let masses = [0.08, 0.06].map(|radius| mass(radius, f64::from(density)));
        let mut simulation = start(shot(0.0, cloth, &falling, bodies));
        let total = |simulation: &Simulation| {
            let frame = state(simulation);
            let of = |stream: &str, mass: &dyn Fn(usize) -> f64| {
                let [x, v] = ["position", "velocity"].map(|name| channel(&frame, stream, name));
                let size: f64 = v.iter().enumerate().map(|(i, v)| v.norm() * mass(i)).sum();
                (momenta(mass, &x, &v)[0], size)
            };
            let all = [
                of("liquid", &|_| 1000.0 * SPACING.powi(3)),
                of("sheet.cloth", &point_mass(0.8, 24, 2.0)),
                of("bodies", &|i| masses[i]),
            ];
            all.iter().fold((Double::zeros(), 0.0), |(p, scale), (one, size)| (p + one, scale + size))
        };
        let (before, scale) = total(&simulation);
        let records = advance(&mut simulation, 6);
        let (after, _) = total(&simulation);
        let couplings: Vec<_> = records.iter().map(|record| record.coupling.clone().unwrap()).collect();
        let of_bodies: Vec<_> = couplings.iter().map(|coupling| coupling.bodies.clone().unwrap()).collect();
        let off = (after - before).norm() / scale;
        let v = channel(&state(&simulation), "bodies", "velocity");
        println!("{density}: off by {off:.1e}, {v:?}, {of_bodies:?}");
        assert!(off < 2e-5, "density {density}: {off}");
        assert!(of_bodies.iter().any(|record| record.contacts > 3), "{of_bodies:?}");
        assert!(of_bodies.iter().all(|record| record.penetration < 0.05), "{of_bodies:?}");
        assert!(couplings.iter().all(|coupling| coupling.liquid.as_ref().unwrap().crossed == 0));
        assert!((v[0].z - 1.0).abs() > 0.02, "the liquid is felt through the cloth: {v:?}");
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_cloth_bears_the_weight_of_water_and_of_what_floats_in_it() {
    let pool = block([-0.2, -0.2, 0.02], [0.2, 0.2, 0.12], [0.0; 3]);
    let cloth = format!(
        "density = 0.5\nstiffness = [4000, 4000]\nshear = 400\nrest = [1.1, 1.1]\n\
         damping = 2\nspring_damping = [0.05, 0.05]\npin = [{{ at = {{ points = {:?} }} }}]",
        border(24)
    );
    let lowest = |bodies: Vec<BodyParams>| {
        let mut simulation = start(shot(9.81, &cloth, &pool, bodies));
        advance(&mut simulation, 30);
        let (mut depth, mut height) = (0.0, Vec::new());
        for _ in 0..6 {
            let records = advance(&mut simulation, 1);
            let frame = state(&simulation);
            let all = channel(&frame, "sheet.cloth", "position");
            depth -= all.iter().map(|x| x.z).sum::<f64>() / all.len() as f64 / 6.0;
            let found = records[0].coupling.clone().unwrap();
            assert!(found.liquid.unwrap().crossed == 0);
            if let Some(stream) = frame.stream("bodies") {
                height.push(f64::from(stream.vec3("position").unwrap()[0].z));
                assert!(found.bodies.unwrap().penetration < 0.05);
            }
        }
        (depth, height.iter().sum::<f64>() / height.len().max(1) as f64)
    };
    let (without, _) = lowest(Vec::new());
    let (floating, high) = lowest(vec![ball(0.07, 300.0, [0.02, 0.0, 0.2], [0.0; 3])]);
    let (sunk, low) = lowest(vec![ball(0.07, 7000.0, [0.02, 0.0, 0.2], [0.0; 3])]);
    println!("mean depth {without}, {floating}, {sunk} m; heights {high}, {low} m");
    assert!(floating > without && sunk > floating + 0.003, "{without}, {floating}, {sunk}");
    assert!(high > low + 0.05, "{high}, {low}");
}

#[test]
fn the_bytes_are_the_same_on_any_threads_and_resumed_and_the_coupling_is_needed() {
    let scene = || {
        let falling = block([-0.1, -0.1, 0.05], [0.1, 0.1, 0.15], [0.0, 0.0, -1.0]);
        let bodies = vec![ball(0.07, 600.0, [0.0, 0.02, -0.09], [0.0, 0.0, 1.5])];
        shot(9.81, "density = 2\nstiffness = [400, 400]\npin = [{ at = 'corners' }]", &falling, bodies)
    };
    let run = || {
        let mut simulation = start(scene());
        advance(&mut simulation, 2);
        let middle = state(&simulation);
        let records = advance(&mut simulation, 2);
        (middle, state(&simulation), records.last().unwrap().coupling.clone())
    };
    let (middle, end, record) = meniscus::par::with_threads(1, run);
    assert!(record.as_ref().is_some_and(|record| record.bodies.as_ref().unwrap().contacts > 3), "{record:?}");
    let three = meniscus::par::with_threads(3, run);
    assert!(three.1 == end && three.2 == record, "3 threads");
    let (world, systems) = scene();
    let mut resumed = Simulation::restore(world.clone(), systems.clone(), &middle).unwrap();
    advance(&mut resumed, 2);
    assert!(state(&resumed) == end, "resumed");
    assert!(resumed.passes().contains(&"coupling_bodies"));
    let error = Simulation::new(world, Systems { couplings: Vec::new(), ..systems }).unwrap_err();
    assert!(matches!(error, SetupError::BodiesBetween), "{error}");
}

#[test]
fn a_ball_falls_into_a_cloth_before_the_liquid_comes() {
    let tap = "[[liquid.emitter]]\nshape = { disc = { center = [0, 0, 0.5], normal = [0, 0, -1], radius = 0.05 } }\n\
               rate = 0.002\non = [{ start = 50 }]\n";
    let cloth = format!(
        "density = 2\nstiffness = [1000, 1000]\ndamping = 2\npin = [{{ at = {{ points = {:?} }} }}]",
        border(24)
    );
    let scene = || shot(9.81, &cloth, tap, vec![ball(0.07, 600.0, [0.0, 0.02, 0.12], [0.0; 3])]);
    let (world, systems) = scene();
    let alone = Systems { liquid: None, couplings: Vec::new(), ..systems };
    let [with, without] = [scene(), (world, alone)].map(|scene| {
        let mut simulation = start(scene);
        let records = advance(&mut simulation, 8);
        let found: Vec<_> =
            records.iter().map(|record| record.coupling.clone().unwrap().bodies.unwrap()).collect();
        assert!(found.iter().any(|record| record.contacts > 3), "{found:?}");
        assert!(found.iter().all(|record| record.penetration < 0.02), "{found:?}");
        channel(&state(&simulation), "bodies", "position")[0]
    });
    println!("{with:?}, {without:?}");
    assert!((with - without).norm() < 0.02, "{with:?}, {without:?}");
}
