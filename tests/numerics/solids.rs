//! Solids that move, and what they do to the liquid.

use meniscus::{
    frame::{Frame, FrameIndex},
    math::Vec3,
    par,
    sdf::{Triangles, from_triangles},
    sim::{
        Simulation, Unwatched, World,
        liquid::{LiquidParams, LiquidRecord},
    },
    solid::{Collider, Interpolation, Keyframe, MeshShape, Shape, Solid},
};
use std::sync::Arc;

const FPS: f64 = 24.0;

fn key(frame: u32, position: [f32; 3], rotation: [f32; 3]) -> Keyframe {
    Keyframe { frame, position, rotation, quaternion: None, scale: 1.0 }
}

fn moving(shape: Shape, keyframes: Vec<Keyframe>) -> Solid {
    let interpolation = Interpolation::Linear;
    Collider {
        shape,
        keyframes,
        interpolation,
        friction: None,
        restitution: None,
        contact_angle: None,
        look: None,
    }
    .solid(FPS, 1)
}

fn world(solids: Vec<Solid>) -> World {
    World { gravity: Vec3::new(0.0, 0.0, -9.81), solids }
}

fn tank(max: [f32; 3]) -> Solid {
    Solid::fixed(Shape::Tank { min: [0.0; 3], max })
}

fn water(spacing: f32, min: [f32; 3], max: [f32; 3], terms: &str) -> LiquidParams {
    let text = format!(
        "spacing = {spacing}\nsource = [{{ shape = {{ box = {{ min = {min:?}, max = {max:?} }} }} }}]\n{terms}"
    );
    crate::from_toml(&text)
}

fn simulation(world: World, params: LiquidParams) -> Simulation {
    Simulation::new(world, Some(params)).expect("the sources hold particles")
}

fn advance(simulation: &mut Simulation, frames: u32) -> Vec<LiquidRecord> {
    let frame = |_| simulation.advance(1.0 / FPS, &mut Unwatched).expect("it stays finite");
    (0..frames).map(frame).map(|record| record.liquid.expect("there is a liquid")).collect()
}

fn state(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(0))
}

fn positions(simulation: &Simulation) -> Vec<Vec3> {
    state(simulation).streams[0].vec3("position").expect("liquids have it").to_vec()
}

/// The box from `low` to `high` as a mesh.
pub(crate) fn cuboid(low: [f32; 3], high: [f32; 3], resolution: u32) -> MeshShape {
    filled(MeshShape::new("made here"), low, high, resolution)
}

/// A shape whose file is the box from `low` to `high`.
pub(crate) fn filled(mut shape: MeshShape, low: [f32; 3], high: [f32; 3], resolution: u32) -> MeshShape {
    let positions =
        (0..8_usize).map(|i| Vec3::from_fn(|a, _| if i >> a & 1 == 1 { high[a] } else { low[a] })).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let field = from_triangles(&Triangles { positions, triangles }, resolution).expect("a box").field;
    shape.fill(Arc::new(field));
    shape
}

/// A plate one spacing thick, as a box and as a mesh.
fn plates() -> [(&'static str, Shape); 2] {
    let (min, max) = ([-0.025, -0.1, -0.1], [0.025, 0.4, 0.9]);
    [("box", Shape::Box { min, max }), ("mesh", Shape::Mesh(cuboid(min, max, 80)))]
}

#[test]
fn a_thin_plate_sweeps_the_water_before_it() {
    for (name, plate) in plates() {
        // A metre a second along the whole tank, wall to wall; then half way back.
        let path = vec![
            key(1, [0.1, 0.0, 0.0], [0.0; 3]),
            key(13, [0.6, 0.0, 0.0], [0.0; 3]),
            key(19, [0.3, 0.0, 0.0], [0.0; 3]),
        ];
        let solids = vec![tank([1.2, 0.3, 0.8]), moving(plate, path)];
        let mut simulation = simulation(world(solids), water(0.05, [0.15, 0.0, 0.0], [1.2, 0.3, 0.3], ""));
        let mut work = 0.0;
        for frame in 2..=19 {
            let record = advance(&mut simulation, 1).remove(0);
            work += record.solid_work;
            assert_eq!(record.particles_inside_solids, 0, "{name}, frame {frame}");
            assert_eq!(record.clamps.energy, 0, "{name}, frame {frame}");
            let at = if frame <= 13 {
                0.1 + 0.5 * (frame as f32 - 1.0) / 12.0
            } else {
                0.6 - 0.05 * (frame as f32 - 13.0)
            };
            let behind = positions(&simulation).iter().filter(|x| x.x < at && x.z < 0.88).count();
            assert_eq!(behind, 0, "{name}, frame {frame}: leaked");
        }
        assert!(work > 5.0, "{name}: the plate did {work} J");
    }
}

#[test]
fn no_plate_is_too_fast_to_hold_the_water() {
    for (name, plate) in plates() {
        // 24 m/s, with substeps in which it moves ten times its thickness.
        let path = vec![key(1, [0.1, 0.0, 0.0], [0.0; 3]), key(2, [1.1, 0.0, 0.0], [0.0; 3])];
        let solids = vec![tank([2.0, 0.3, 0.8]), moving(plate, path)];
        let terms = "min_substeps = 2\nmax_substeps = 2\niterations = 4";
        let mut simulation = simulation(world(solids), water(0.05, [0.15, 0.0, 0.0], [1.2, 0.3, 0.2], terms));
        let record = advance(&mut simulation, 1).remove(0);
        assert!(record.cfl_capped > 0);
        assert_eq!(record.particles_inside_solids, 0, "{name}");
        let behind = positions(&simulation).iter().filter(|x| x.x < 1.1 && x.z < 0.88).count();
        assert_eq!(behind, 0, "{name}: leaked");
    }
}

#[test]
fn a_closing_piston_squeezes_the_water_out_next_to_it() {
    let (min, max) = ([0.1, 0.1, 0.0], [0.5, 0.5, 0.5]);
    for (name, piston) in [("box", Shape::Box { min, max }), ("mesh", Shape::Mesh(cuboid(min, max, 32)))] {
        // It comes down on the pool until half a spacing is left between it and the floor.
        let path = vec![key(1, [0.0, 0.0, 0.3], [0.0; 3]), key(13, [0.0, 0.0, 0.025], [0.0; 3])];
        let solids = vec![tank([0.6, 0.6, 1.5]), moving(piston, path)];
        let mut simulation = simulation(world(solids), water(0.05, [0.0; 3], [0.6, 0.6, 0.3], ""));
        let count = positions(&simulation).len();
        for record in advance(&mut simulation, 16) {
            assert_eq!(record.particles_inside_solids, 0, "{name}");
        }
        let end = positions(&simulation);
        assert_eq!(end.len(), count);
        let under =
            end.iter().filter(|x| x.z < 0.02 && (0.1..0.5).contains(&x.x) && (0.1..0.5).contains(&x.y));
        println!("{name}: {} of {count} are left below the piston", under.count());
    }
}

#[test]
fn a_paddle_stirs_a_pool_at_rest_with_the_work_it_does() {
    let paddle = Shape::Box { min: [-0.3, -0.025, -0.15], max: [0.3, 0.025, 0.15] };
    let spin = vec![key(1, [0.5, 0.5, 0.2], [0.0; 3]), key(49, [0.5, 0.5, 0.2], [0.0, 0.0, 720.0])];
    let solids = vec![tank([1.0, 1.0, 1.0]), moving(paddle, spin)];
    let mut simulation = simulation(world(solids), water(0.05, [0.0; 3], [1.0, 1.0, 0.3], "xsph = {}"));
    let start = 300.0 * 9.81 * 0.15;
    // After half a turn: 79 J of 172 J, and 0.09 m²/s.
    let records = advance(&mut simulation, if crate::is_soak() { 24 } else { 12 });
    let work: f64 = records.iter().map(|record| record.solid_work).sum();
    let last = records.last().unwrap();
    println!("work {work:.1} J, kinetic {:.1} J", last.kinetic_energy);
    assert!(last.kinetic_energy > 10.0, "{} J", last.kinetic_energy);
    assert!(last.kinetic_energy < work, "{} J of {work} J", last.kinetic_energy);
    let mut granted = start + 300.0 * 9.81 * 0.05;
    for record in &records {
        granted += record.solid_work;
        assert!(record.kinetic_energy + record.potential_energy < granted * 1.01, "{record:?}");
        assert_eq!(record.particles_inside_solids, 0);
    }
    // It turns with the paddle.
    let frame = state(&simulation);
    let (x, v) = (frame.streams[0].vec3("position").unwrap(), frame.streams[0].vec3("velocity").unwrap());
    let turning = |(x, v): (&Vec3, &Vec3)| (x.x - 0.5) * v.y - (x.y - 0.5) * v.x;
    let turning = x.iter().zip(v).map(turning).sum::<f32>() / x.len() as f32;
    println!("turning {turning:.4} m²/s");
    assert!(turning > 0.05, "{turning} m²/s");
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_smooth_ball_that_spins_in_place_does_no_work() {
    for speed in [720.0, 1500.0] {
        let ball = Shape::Sphere { center: [0.0; 3], radius: 0.1 };
        let spin = vec![key(1, [0.2, 0.2, 0.1], [0.0; 3]), key(25, [0.2, 0.2, 0.1], [0.0, 0.0, speed])];
        let solids = vec![tank([0.4, 0.4, 1.0]), moving(ball, spin)];
        let mut simulation = simulation(world(solids), water(0.02, [0.0; 3], [0.4, 0.4, 0.3], ""));
        let records = advance(&mut simulation, 12);
        let work = records.iter().map(|record| record.solid_work.abs()).sum::<f64>();
        println!("{speed} degrees a second: {work:.1e} J");
        assert!(work < 1e-3, "{speed} degrees a second: {work} J");
    }
}

#[test]
fn a_lifted_tank_lifts_its_water() {
    let lift = vec![key(1, [0.0; 3], [0.0; 3]), key(25, [0.0, 0.0, 1.0], [0.0; 3])];
    let shape = Shape::Tank { min: [0.0; 3], max: [0.4, 0.4, 1.0] };
    let mut simulation =
        simulation(world(vec![moving(shape, lift)]), water(0.05, [0.0; 3], [0.4, 0.4, 0.3], ""));
    let records = advance(&mut simulation, 30);
    let mass = 48.0;
    let (end, work) = (records.last().unwrap(), records.iter().map(|r| r.solid_work).sum::<f64>());
    let gained = end.potential_energy - mass * 9.81 * 0.15;
    println!("work {work:.1} J, gained {gained:.1} J");
    assert!((gained / (mass * 9.81) - 1.0).abs() < 0.05, "{gained} J");
    // The start is a blow that gives every particle the tank's speed; half of its work is lost.
    assert!(work > gained && work < 1.3 * gained, "{work} J for {gained} J");
    assert!(records.iter().all(|record| record.clamps.energy == 0 && record.particles_inside_solids == 0));
}

#[test]
fn moving_solids_give_the_same_bits_on_any_number_of_threads_and_after_a_restart() {
    let blade = Shape::Mesh(cuboid([-0.25, -0.03, -0.1], [0.25, 0.03, 0.1], 40));
    let spin = vec![
        key(1, [0.4, 0.3, 0.2], [0.0; 3]),
        key(4, [0.4, 0.3, 0.15], [0.0, 10.0, 130.0]),
        key(12, [0.4, 0.3, 0.2], [0.0, 0.0, 400.0]),
    ];
    let world = world(vec![tank([0.8, 0.6, 0.8]), moving(blade, spin)]);
    let params = water(0.05, [0.0; 3], [0.8, 0.6, 0.25], "vorticity = {}\nxsph = {}");
    let run = || {
        let mut simulation = simulation(world.clone(), params.clone());
        advance(&mut simulation, 3);
        let middle = state(&simulation);
        advance(&mut simulation, 4);
        (middle, state(&simulation))
    };
    let (middle, end) = par::with_threads(1, run);
    for &threads in crate::thread_counts() {
        assert!(par::with_threads(threads, run) == (middle.clone(), end.clone()), "{threads} threads");
    }
    let mut resumed = Simulation::restore(world, Some(params), &middle).expect("the frame has a state");
    advance(&mut resumed, 4);
    assert!(state(&resumed) == end);
}

#[test]
fn a_mesh_is_filled_with_liquid() {
    let mut params = water(0.02, [0.0; 3], [1.0; 3], "");
    let mut shape = MeshShape::new("made here");
    (shape.scale, shape.rotate, shape.translate) = (0.5, [0.0, 0.0, 90.0], [0.1, 0.2, 0.3]);
    let shape = filled(shape, [0.0; 3], [1.0, 0.6, 0.4], 64);
    params.source[0].shape = Shape::Mesh(shape);
    let space = World { gravity: Vec3::zeros(), solids: Vec::new() };
    let x = positions(&simulation(space, params));
    let volume = x.len() as f32 * 0.02_f32.powi(3);
    assert!((volume / 0.03 - 1.0).abs() < 0.02, "{volume}");
    let low = x.iter().fold(Vec3::repeat(9.0), |low, x| low.inf(x));
    let high = x.iter().fold(Vec3::repeat(-9.0), |high, x| high.sup(x));
    assert!((low - Vec3::new(-0.19, 0.21, 0.31)).amax() < 0.011, "{low:?}");
    assert!((high - Vec3::new(0.09, 0.69, 0.49)).amax() < 0.011, "{high:?}");
}

/// Layers of a column at rest: their mean heights over the floor, by the histogram's troughs.
#[test]
fn no_layers_stack_at_walls() {
    let spacing = 0.05;
    let mesh_floor = cuboid([-0.2, -0.2, -0.4], [0.6, 0.6, 0.0], 48);
    for (name, floor) in [("tank", None), ("mesh", Some(Solid::fixed(Shape::Mesh(mesh_floor))))] {
        let mut solids = vec![tank([0.4, 0.4, 2.0])];
        if let Some(floor) = floor {
            solids[0] = Solid::fixed(Shape::Tank { min: [0.0, 0.0, -1.0], max: [0.4, 0.4, 2.0] });
            solids.push(floor);
        }
        let terms = "density_dev = 0.002\nxsph = { strength = 0.05 }";
        let mut simulation = simulation(world(solids), water(spacing, [0.0; 3], [0.4, 0.4, 0.8], terms));
        advance(&mut simulation, 24);
        let mut z: Vec<f32> = positions(&simulation).iter().map(|x| x.z).collect();
        z.sort_by(f32::total_cmp);
        // Sixty-four particles are a layer, from the floor up: where layers stay apart, these are their means.
        let layers: Vec<f32> = z.chunks(64).map(|layer| layer.iter().sum::<f32>() / 64.0).collect();
        let first = (layers[1] - layers[0]) / spacing;
        let bulk = (layers[8] - layers[2]) / 6.0 / spacing;
        println!(
            "{name}: first two layers {first:.3}, bulk {bulk:.3}, floor layer at {:.3}",
            layers[0] / spacing
        );
        assert!((first / bulk - 1.0).abs() < 0.05, "{name}: {first} of {bulk}");
        assert!((layers[0] / spacing - 0.5).abs() < 0.05, "{name}: {}", layers[0]);
    }
}
