//! The micropolar model in whole runs: what eddies keep, what bodies in free space gain, and its state in frames.

use meniscus::{
    frame::{Frame, FrameIndex, Stream},
    math::Vec3,
    sim::{
        SetupError, Simulation, Unwatched, World,
        liquid::{LiquidParams, LiquidRecord},
    },
    solid::{Shape, Solid},
};
use std::f32::consts::PI;

const FRAME: f64 = 1.0 / 24.0;
const GRAVITY: f64 = 9.81;

fn params(text: &str) -> LiquidParams {
    crate::from_toml(text)
}

fn block(spacing: f32, max: [f32; 3], terms: &str) -> LiquidParams {
    params(&format!(
        "spacing = {spacing}\n{terms}\n[[source]]\nshape = {{ box = {{ min = [0, 0, 0], max = {max:?} }} }}"
    ))
}

fn tank(max: [f32; 3]) -> World {
    let shape = Shape::Tank { min: [0.0; 3], max };
    World { gravity: Vec3::new(0.0, 0.0, -GRAVITY as f32), solids: vec![Solid::fixed(shape)] }
}

fn advance(simulation: &mut Simulation, frames: u32) -> Vec<LiquidRecord> {
    let frame = |_| simulation.advance(FRAME, &mut Unwatched).expect("it stays finite").liquid.unwrap();
    (0..frames).map(frame).collect()
}

/// Positions and velocities.
fn particles(simulation: &Simulation) -> (Vec<Vec3>, Vec<Vec3>) {
    let frame = simulation.frame(FrameIndex(0));
    let column = |name| frame.streams[0].vec3(name).expect("liquids have it").to_vec();
    (column("position"), column("velocity"))
}

/// The frame with other velocities, whose energy becomes the shot's first.
fn pushed(frame: Frame, gravity: f64, params: &LiquidParams, v: impl Fn(Vec3) -> Vec3) -> Frame {
    let old = &frame.streams[0];
    let x = old.vec3("position").unwrap();
    let v: Vec<Vec3> = x.iter().map(|&x| v(x)).collect();
    let energy = |(x, v): (&Vec3, &Vec3)| 0.5 * f64::from(v.norm_squared()) + gravity * f64::from(x.z);
    let mass = f64::from(params.density) * f64::from(params.spacing).powi(3);
    let first = mass * x.iter().zip(&v).map(energy).sum::<f64>();
    let mut stream = Stream::new(&old.name, old.kind, old.len());
    for channel in old.channels() {
        let data = if channel.name == "velocity" { v.clone().into() } else { channel.data.clone() };
        stream = stream.with(&channel.name, data);
    }
    stream.scalars = old.scalars.clone();
    stream.scalars.iter_mut().find(|(name, _)| name == "first_energy").expect("it is stored").1 = first;
    Frame { streams: vec![stream], ..frame }
}

#[test]
fn an_eddy_keeps_more_of_its_energy() {
    let (side, spacing) = (0.48, 0.04);
    let eddy = |x: Vec3| {
        let k = PI / side;
        Vec3::new((k * x.x).sin() * (k * x.y).cos(), -(k * x.x).cos() * (k * x.y).sin(), 0.0)
    };
    let kept = |terms: &str| {
        let params = block(spacing, [side, side, 0.4], terms);
        let world = tank([side, side, 1.0]);
        let mut simulation = Simulation::new(world.clone(), Some(params.clone())).unwrap();
        advance(&mut simulation, 8);
        let start = pushed(simulation.frame(FrameIndex(0)), GRAVITY, &params, eddy);
        let mut simulation = Simulation::restore(world, Some(params), &start).unwrap();
        let along = |simulation: &Simulation| {
            let (x, v) = particles(simulation);
            x.iter().zip(&v).map(|(&x, v)| f64::from(v.dot(&eddy(x)))).sum::<f64>()
        };
        let before = along(&simulation);
        let records = advance(&mut simulation, 12);
        // The solver itself adds up to 4 %, when the velocity shears the seeding lattice at once.
        let first = start.streams[0].scalar("first_energy").unwrap();
        for record in &records {
            let sum = record.kinetic_energy + record.potential_energy + record.microrotation_energy;
            assert!(sum < 1.05 * first, "{terms}: {sum} of {first}");
        }
        (along(&simulation) / before).powi(2)
    };
    let [none, mild, strong] = ["", "micropolar.transfer = 0.25", "micropolar.transfer = 1"].map(kept);
    assert!(mild > 1.1 * none && strong > 1.1 * mild && strong < 1.0, "{none}, {mild}, {strong}");
}

#[test]
fn the_energy_of_a_dam_break_never_exceeds_its_first() {
    for transfer in [0.5, 10.0] {
        let terms = format!("micropolar.transfer = {transfer}");
        let mut simulation =
            Simulation::new(tank([1.2, 0.3, 1.5]), Some(block(0.05, [0.6, 0.3, 0.6], &terms))).unwrap();
        let first = simulation.frame(FrameIndex(0)).streams[0].scalar("first_energy").unwrap();
        let records = advance(&mut simulation, 30);
        for record in &records {
            let sum = record.kinetic_energy + record.potential_energy + record.microrotation_energy;
            assert!(sum < 1.02 * first, "{transfer}: {sum} of {first}");
        }
        let last = records.last().unwrap();
        assert!(last.microrotation_energy > 0.0 && last.kinetic_energy > 0.0, "{last:?}");
        assert!(records.iter().map(|r| r.micropolar_energy).sum::<f64>() > 1e-3 * first);
        assert!(transfer < 1.0 || records.iter().any(|r| r.clamps.micropolar > 0));
    }
}

/// What a free body of velocities `v` gains in six frames with a budget as large as its kinetic energy: momentum and angular
/// momentum over its mass, and kinetic energy over the first.
fn gains(terms: &str, v: impl Fn(Vec3) -> Vec3) -> [f64; 3] {
    let params = block(0.04, [0.4; 3], terms);
    let world = World { gravity: Vec3::zeros(), solids: Vec::new() };
    let still = Simulation::new(world.clone(), Some(params.clone())).unwrap().frame(FrameIndex(0));
    let mut start = pushed(still, 0.0, &params, v);
    let scalars = &mut start.streams[0].scalars;
    let first = &mut scalars.iter_mut().find(|(name, _)| name == "first_energy").expect("it is stored").1;
    let kinetic = std::mem::replace(first, 2.0 * *first);
    let mut simulation = Simulation::restore(world, Some(params), &start).unwrap();
    let momenta = |simulation: &Simulation| {
        let (x, v) = particles(simulation);
        let both = || x.iter().zip(&v).map(|(x, v)| (x.cast::<f64>(), v.cast::<f64>()));
        let linear = both().map(|(_, v)| v).sum::<nalgebra::Vector3<f64>>() / x.len() as f64;
        let angular = both().map(|(x, v)| x.cross(&v)).sum::<nalgebra::Vector3<f64>>() / x.len() as f64;
        (linear, angular)
    };
    let before = momenta(&simulation);
    let last = advance(&mut simulation, 6).pop().unwrap();
    let after = momenta(&simulation);
    [(after.0 - before.0).norm(), (after.1 - before.1).norm(), last.kinetic_energy / kinetic]
}

#[test]
fn a_body_that_rotates_rigidly_in_free_space_goes_on_as_it_is() {
    let rigid = |x: Vec3| Vec3::new(0.0, 0.0, 2.0).cross(&(x - Vec3::repeat(0.2)));
    // Confinement doubles its energy, as far as the budget goes.
    for transfer in [0.5, 1.0] {
        let [momentum, angular, kinetic] = gains(&format!("micropolar.transfer = {transfer}"), rigid);
        // 0.05 m²/s at the start.
        assert!(momentum < 5e-5 && angular < 5e-4, "{momentum} m/s, {angular} m²/s");
        assert!((kinetic - 1.0).abs() < 0.015, "{kinetic}");
    }
}

#[test]
fn layers_that_slide_in_free_space_hardly_gain_momentum() {
    let layers = |x: Vec3| Vec3::new(if x.y < 0.2 { 1.0 } else { -1.0 }, 0.0, 0.2 * (20.0 * x.x).sin());
    let [momentum, angular, kinetic] = gains("micropolar = {}", layers);
    // The form of the force as differences is not antisymmetric at surfaces; confinement gains 0.014 m/s.
    assert!(momentum < 4e-3 && angular < 0.012, "{momentum} m/s, {angular} m²/s");
    assert!(kinetic > 1.05 && kinetic < 1.4, "{kinetic}");
}

#[test]
fn a_frame_without_the_microrotation_is_refused() {
    let with = || block(0.1, [0.4; 3], "micropolar = {}");
    let world = || tank([1.0; 3]);
    let frame = |params| Simulation::new(world(), Some(params)).unwrap().frame(FrameIndex(0));
    let plain = frame(block(0.1, [0.4; 3], ""));
    assert!(plain.streams[0].channel("microrotation").is_none());
    let refused = Simulation::restore(world(), Some(with()), &plain).unwrap_err();
    assert_eq!(refused, SetupError::Missing { stream: "liquid", what: "microrotation" });
    let spins = frame(with()).streams[0].vec3("microrotation").expect("it is stored").to_vec();
    assert!(spins.len() == 64 && spins.iter().all(|spin| *spin == Vec3::zeros()));
}

/// The frame with another microrotation.
fn turned(frame: Frame, spin: Vec<Vec3>) -> Frame {
    let old = &frame.streams[0];
    let mut stream = Stream::new(&old.name, old.kind, old.len());
    for channel in old.channels() {
        let data = if channel.name == "microrotation" { spin.clone().into() } else { channel.data.clone() };
        stream = stream.with(&channel.name, data);
    }
    stream.scalars = old.scalars.clone();
    Frame { streams: vec![stream], ..frame }
}

#[test]
fn without_exchange_each_particle_keeps_its_microrotation() {
    let params = || block(0.05, [0.4, 0.3, 0.5], "micropolar = { transfer = 0, viscosity = 0 }");
    let world = || tank([1.0, 0.3, 1.0]);
    let frame = Simulation::new(world(), Some(params())).unwrap().frame(FrameIndex(0));
    let of = |id: u32| Vec3::new(1e-3 * id as f32, 1.0, 0.0);
    let spin = frame.streams[0].u32("id").unwrap().iter().map(|&id| of(id)).collect();
    let mut simulation = Simulation::restore(world(), Some(params()), &turned(frame, spin)).unwrap();
    advance(&mut simulation, 8);
    let end = simulation.frame(FrameIndex(0));
    let (ids, spins) = (end.streams[0].u32("id").unwrap(), end.streams[0].vec3("microrotation").unwrap());
    assert!(!ids.is_sorted(), "particles are sorted by cells");
    assert!(ids.iter().zip(spins).all(|(&id, &spin)| spin == of(id)));
}

#[test]
fn a_microrotation_that_is_not_a_number_is_named() {
    let params = || block(0.1, [0.4; 3], "micropolar = {}");
    let frame = Simulation::new(tank([1.0; 3]), Some(params())).unwrap().frame(FrameIndex(0));
    let mut spin = vec![Vec3::zeros(); 64];
    spin[17].y = f32::NAN;
    let mut simulation = Simulation::restore(tank([1.0; 3]), Some(params()), &turned(frame, spin)).unwrap();
    let stop = simulation.advance(FRAME, &mut Unwatched).expect_err("it is refused");
    assert!(format!("{stop:?}").contains("microrotation of"), "{stop:?}");
}
