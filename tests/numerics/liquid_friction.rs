//! Coulomb friction and restitution of colliders against closed forms, and a puddle that comes to rest.

use meniscus::{
    frame::{Frame, FrameIndex},
    math::Vec3,
    par,
    sim::{
        Simulation, Unwatched, World,
        liquid::{LiquidParams, LiquidRecord},
    },
    solid::{Interpolation, Keyframe, Motion, Shape, Solid},
};

const FRAME: f64 = 1.0 / 24.0;
const SPACING: f64 = 0.02;
const G: f64 = 9.81;

/// Gravity turned by `slope` [°] in a world whose floor is level: the floor then slopes down along x.
fn world(slope: f64, solids: Vec<Solid>) -> World {
    let slope = slope.to_radians();
    World { gravity: Vec3::new((G * slope.sin()) as f32, 0.0, (-G * slope.cos()) as f32), solids }
}

fn floor(friction: f32, restitution: f32) -> Solid {
    let plane = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
    Solid { friction, restitution, ..Solid::fixed(plane) }
}

/// A solid that moves from the first to the second position (and angle about z) in two seconds.
fn moving(solid: Solid, positions: [[f32; 3]; 2], turn: f32) -> Solid {
    let key = |frame, position, turn| Keyframe {
        frame,
        position,
        rotation: [0.0, 0.0, turn],
        quaternion: None,
        scale: 1.0,
    };
    let keys = [key(0, positions[0], 0.0), key(48, positions[1], turn)];
    Solid { motion: Motion::new(&keys, Interpolation::Linear, 24.0, 0), ..solid }
}

fn block(world: World, low: [f64; 3], high: [f64; 3], speed: f64, terms: &str) -> Simulation {
    let text = format!(
        "spacing = {SPACING}\n{terms}\n[[source]]\nvelocity = [{speed}, 0, 0]\n\
         shape = {{ box = {{ min = {low:?}, max = {high:?} }} }}"
    );
    let params: LiquidParams = crate::from_toml(&text);
    Simulation::new(world, Some(params)).expect("the source holds particles")
}

/// A slab of 0.4 × 0.4 m on the floor.
fn slab(world: World, layers: f64, speed: f64) -> Simulation {
    block(world, [0.0; 3], [0.4, 0.4, layers * SPACING], speed, "")
}

fn advance(simulation: &mut Simulation, frames: u32) -> Vec<LiquidRecord> {
    let frame = |_| simulation.advance(FRAME, &mut Unwatched).expect("it stays finite").liquid.unwrap();
    (0..frames).map(frame).collect()
}

fn state(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(0))
}

fn column(simulation: &Simulation, name: &str) -> Vec<Vec3> {
    state(simulation).streams[0].vec3(name).expect("liquids have it").to_vec()
}

fn mean_speed_along_x(simulation: &Simulation) -> f64 {
    let v = column(simulation, "velocity");
    v.iter().map(|v| f64::from(v.x)).sum::<f64>() / v.len() as f64
}

fn rms_speed(simulation: &Simulation) -> f64 {
    let v = column(simulation, "velocity");
    (v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>() / v.len() as f64).sqrt()
}

#[test]
fn a_sliding_slab_is_decelerated_by_friction_times_its_weight() {
    // The layers above the floor slip, so that the mean velocity is what the floor's friction changes. After a few frames the
    // lowest of three layers is slow, and static friction is smaller.
    for (layers, friction, slope, frames, bound) in
        [(1.0, 0.3, 0.0, 7, 0.01), (3.0, 0.3, 0.0, 4, 0.04), (2.0, 0.2, 30.0, 6, 0.04)]
    {
        let mut simulation = slab(world(slope, vec![floor(friction as f32, 0.0)]), layers, 2.0);
        advance(&mut simulation, 1);
        let before = mean_speed_along_x(&simulation);
        let mut dissipated = 0.0;
        for record in advance(&mut simulation, frames) {
            dissipated += record.friction_dissipation;
            assert!(record.clamps.energy == 0 && record.solid_work == 0.0, "{record:?}");
        }
        let found = (mean_speed_along_x(&simulation) - before) / (f64::from(frames) * FRAME);
        let angle = f64::to_radians(slope);
        let expected = G * (angle.sin() - friction * angle.cos());
        println!("{layers} layers, {slope}°: {found:.3} m/s², expected {expected:.3}; {dissipated:.3} J");
        assert!((found / expected - 1.0).abs() < bound, "{found}, expected {expected}");
        if layers == 1.0 {
            let v = mean_speed_along_x(&simulation);
            let lost = 0.5 * 3.2 * (before * before - v * v);
            assert!((dissipated / lost - 1.0).abs() < 0.01, "{dissipated} of {lost} J");
        }
    }
}

#[test]
fn friction_above_the_slope_holds_a_film_in_its_place() {
    let mut simulation = slab(world(20.0, vec![floor(0.5, 0.0)]), 1.0, 0.0);
    advance(&mut simulation, 3);
    let place = |simulation: &Simulation| column(simulation, "position").iter().map(|x| x.x).sum::<f32>();
    let before = place(&simulation);
    advance(&mut simulation, 24);
    let moved = (place(&simulation) - before) / 400.0;
    println!("moved by {moved} m in 1 s");
    assert!(
        moved.abs() < 0.02 * SPACING as f32 && rms_speed(&simulation) < 1e-3,
        "{moved} m, {}",
        rms_speed(&simulation)
    );
}

#[test]
fn a_particle_bounces_to_the_square_of_the_restitution() {
    let fall = 0.5;
    for restitution in [0.0, 0.3, 0.5, 0.8, 1.0] {
        let solid = floor(0.2, restitution);
        let (low, high) = ([0.0, 0.0, fall], [SPACING, SPACING, fall + SPACING]);
        let mut simulation = block(world(0.0, vec![solid]), low, high, 0.0, "");
        let mut top: Option<f64> = None;
        // Up to the summit of the first bounce, twice the fall's time at most, and from the first rise on.
        for _ in 0..104 {
            simulation.advance(0.00625, &mut Unwatched).expect("it stays finite");
            let (x, v) = (column(&simulation, "position")[0], column(&simulation, "velocity")[0]);
            if v.z > 0.01 {
                top = Some(top.unwrap_or(0.0).max(f64::from(x.z)));
            } else if top.is_some() {
                break;
            }
        }
        let height = top.map_or(0.0, |top| (top - 0.5 * SPACING) / fall);
        let expected = f64::from(restitution * restitution);
        println!("e = {restitution}: {height:.4} of the height, expected {expected:.4}");
        assert!((height - expected).abs() < 0.006, "{restitution}: {height}, expected {expected}");
    }
}

#[test]
fn a_rough_solid_that_touches_nothing_changes_no_bits() {
    let run = |rough: f32| {
        let tank = Shape::Tank { min: [0.0; 3], max: [0.4, 0.3, 1.0] };
        let far = Shape::Sphere { center: [0.2, 0.15, 0.9], radius: 0.05 };
        let far = Solid { friction: rough, restitution: rough, ..Solid::fixed(far) };
        let solids = vec![Solid::fixed(tank), far];
        let mut simulation = block(world(0.0, solids), [0.0; 3], [0.2, 0.3, 0.2], 0.5, "");
        advance(&mut simulation, 4);
        (simulation.passes().contains(&"friction"), state(&simulation))
    };
    let ((rough, changed), (smooth, unchanged)) = (run(0.5), run(0.0));
    assert!(rough && !smooth);
    assert!(changed == unchanged);
}

#[test]
fn a_conveyor_drags_the_liquid_up_to_its_speed() {
    for layers in [1.0, 4.0] {
        let belt = moving(floor(0.5, 0.0), [[0.0; 3], [2.0, 0.0, 0.0]], 0.0);
        let mut simulation = slab(world(0.0, vec![belt]), layers, 0.0);
        let records = advance(&mut simulation, 3);
        if layers == 1.0 {
            let v = mean_speed_along_x(&simulation);
            let expected = 0.5 * G * 3.0 * FRAME;
            assert!((v / expected - 1.0).abs() < 0.01, "{v} m/s, expected {expected}");
        }
        let records: Vec<_> = records.into_iter().chain(advance(&mut simulation, 25)).collect();
        let v = mean_speed_along_x(&simulation);
        let sum = |value: fn(&LiquidRecord) -> f64| records.iter().map(value).sum::<f64>();
        let (work, dissipated) = (sum(|record| record.solid_work), sum(|record| record.friction_dissipation));
        println!("{layers} layers: {v:.4} m/s; work {work:.3} J, dissipated {dissipated:.3} J");
        assert!((v - 1.0).abs() < 0.01, "{v} m/s");
        assert!(records.iter().all(|record| record.clamps.energy == 0));
        // The belt's work is its force times its path: m u², of which sliding dissipates half.
        let mass = 3.2 * layers;
        assert!((work / mass - 1.0).abs() < 0.02, "{work} J for {mass} kg");
        assert!(layers > 1.0 || (dissipated / mass - 0.5).abs() < 0.02, "{dissipated} J for {mass} kg");
    }
}

#[test]
fn a_rough_ball_that_spins_stirs_the_liquid_with_its_work() {
    let kinetic = |friction: f32| {
        let tank = Solid::fixed(Shape::Tank { min: [-0.2, -0.2, 0.0], max: [0.2, 0.2, 1.0] });
        let ball = Solid::fixed(Shape::Sphere { center: [0.0; 3], radius: 0.1 });
        let spin = moving(Solid { friction, ..ball }, [[0.0, 0.0, 0.1]; 2], 1440.0);
        let (low, high) = ([-0.2, -0.2, 0.0], [0.2, 0.2, 0.3]);
        let mut simulation = block(world(0.0, vec![tank, spin]), low, high, 0.0, "");
        let records = advance(&mut simulation, 12);
        assert!(records.iter().all(|record| record.clamps.energy == 0));
        let work = records.iter().map(|record| record.solid_work).sum::<f64>();
        let (x, v) = (column(&simulation, "position"), column(&simulation, "velocity"));
        let turning = x.iter().zip(&v).map(|(x, v)| x.x * v.y - x.y * v.x).sum::<f32>() / x.len() as f32;
        println!("friction {friction}: work {work:.3} J, turning {turning:.5} m²/s");
        (work, turning)
    };
    let rough = kinetic(0.5);
    assert!(rough.0 > 4.0 && rough.1 > 0.005, "{rough:?}");
    if !crate::is_soak() {
        return;
    }
    let smooth = kinetic(0.0);
    assert!(rough.0 > smooth.0 + 4.0, "{rough:?} {smooth:?}");
    assert!(rough.1 > 0.005 && rough.1 > 5.0 * smooth.1.abs(), "{rough:?} {smooth:?}");
}

#[test]
fn a_spilled_puddle_comes_to_rest_as_connected_liquid() {
    let spilled = |friction: f32, seconds: u32| {
        let terms = "kernel_radius = 2.5\nsurface_tension = { coefficient = 8 }";
        let solids = vec![floor(friction, 0.0)];
        let mut simulation = block(world(0.0, solids), [-0.1, -0.1, 0.0], [0.1, 0.1, 0.2], 0.0, terms);
        let record = advance(&mut simulation, 24 * seconds).pop().unwrap();
        let (x, rms) = (column(&simulation, "position"), rms_speed(&simulation));
        let radius = x.iter().map(|x| x.x.hypot(x.y)).fold(0.0, f32::max);
        println!("friction {friction}: {rms:.4} m/s, {} components, radius {radius:.3} m", record.components);
        (rms, record.components, radius)
    };
    let (rms, components, radius) = spilled(0.5, 3);
    assert!(rms < 0.03 && components == 1 && radius < 0.45, "{rms} m/s, {components} components");
    let (rms, components, radius) = spilled(0.0, 3);
    assert!(rms > 0.2 && components > 10 && radius > 1.0, "it spreads without end on a smooth floor");
}

#[test]
fn rough_frames_have_the_same_bits_on_any_number_of_threads_and_after_a_restart() {
    let all = "viscosity = { dynamic = 2 }\nsurface_tension = { coefficient = 8 }\nvorticity = {}";
    let separate =
        ["", "viscosity = { dynamic = 2 }\nsurface_tension = { coefficient = 8 }", "vorticity = {}"];
    let (frames, depth) = if crate::is_soak() { (2, 0.2) } else { (1, 0.14) };
    for terms in [all].into_iter().chain(separate).take(if crate::is_soak() { 4 } else { 1 }) {
        let tank = Shape::Tank { min: [0.0; 3], max: [0.4, 0.4, 1.0] };
        let paddle = Solid::fixed(Shape::Box { min: [-0.12, -0.02, -0.06], max: [0.12, 0.02, 0.06] });
        let paddle = moving(
            Solid { friction: 0.4, restitution: 0.5, ..paddle },
            [[0.2, 0.2, 0.1], [0.2, 0.2, 0.12]],
            720.0,
        );
        let solids = vec![Solid { friction: 0.3, restitution: 0.2, ..Solid::fixed(tank) }, paddle];
        let world = world(5.0, solids);
        let text = format!(
            "spacing = 0.02\n{terms}\n[[source]]\nshape = {{ box = {{ min = [0, 0, 0], max = [0.4, 0.4, {depth}] }} }}"
        );
        let params: LiquidParams = crate::from_toml(&text);
        let run = || {
            let mut simulation = Simulation::new(world.clone(), Some(params.clone())).unwrap();
            advance(&mut simulation, frames);
            let middle = state(&simulation);
            let work = advance(&mut simulation, frames).iter().map(|record| record.solid_work).sum::<f64>();
            (middle, state(&simulation), work)
        };
        let (middle, end, work) = par::with_threads(1, run);
        assert!(work != 0.0);
        assert!(par::with_threads(3, run) == (middle.clone(), end.clone(), work), "{terms}");
        let mut resumed = Simulation::restore(world, Some(params), &middle).expect("the frame has a state");
        advance(&mut resumed, frames);
        assert!(state(&resumed) == end, "{terms}");
    }
}
