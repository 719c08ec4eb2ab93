//! The liquid at its limits: every case ends finite and bounded with all its particles, or reports the error.

use meniscus::{
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
    sim::{
        Diverged, Simulation, Stop, Unwatched, World,
        liquid::{LiquidParams, LiquidRecord},
    },
    solid::{Collider, Interpolation, Keyframe, Shape, Solid},
};

const FRAME: f64 = 1.0 / 24.0;

/// Every solver: both must pass every case.
const SOLVERS: [&str; 2] = ["accelerated", "jacobi"];

fn params(solver: &str, text: &str) -> LiquidParams {
    crate::from_toml(&format!("solver = '{solver}'\n{text}"))
}

fn block(spacing: f32, min: [f32; 3], max: [f32; 3], terms: &str) -> String {
    format!(
        "spacing = {spacing}\nsource = [{{ shape = {{ box = {{ min = {min:?}, max = {max:?} }} }} }}]\n{terms}"
    )
}

/// 512 particles just above the plate.
fn cube(terms: &str) -> String {
    block(0.1, [0.0, 0.0, 0.1], [0.8, 0.8, 0.9], terms)
}

/// 64 particles just above the plate.
fn small(terms: &str) -> String {
    block(0.1, [0.0, 0.0, 0.1], [0.4, 0.4, 0.5], terms)
}

fn world(gravity: f32, solids: Vec<Solid>) -> World {
    World { gravity: Vec3::new(0.0, 0.0, -gravity), solids }
}

fn plate(gravity: f32) -> World {
    world(gravity, vec![Solid::fixed(Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] })])
}

fn tank(gravity: f32, max: [f32; 3]) -> World {
    world(gravity, vec![Solid::fixed(Shape::Tank { min: [0.0; 3], max })])
}

fn state(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(0))
}

fn channel(frame: &Frame, name: &str) -> Vec<Vec3> {
    frame.streams[0].vec3(name).expect("liquids have it").to_vec()
}

/// The first stream with other positions and velocities.
fn rebuilt(frame: &Frame, positions: Vec<Vec3>, velocities: Vec<Vec3>) -> Frame {
    let old = &frame.streams[0];
    let mut stream = Stream::new("liquid", StreamKind::Particles, positions.len())
        .with("position", positions)
        .with("velocity", velocities)
        .with("id", old.u32("id").unwrap().to_vec());
    stream.scalars = old.scalars.clone();
    Frame { streams: vec![stream], ..frame.clone() }
}

/// A simulation of `params` whose particles `change` has moved or pushed.
fn changed(
    world: World,
    params: LiquidParams,
    change: impl Fn(&mut Vec<Vec3>, &mut Vec<Vec3>),
) -> Simulation {
    let start = state(&Simulation::new(world.clone(), Some(params.clone())).expect("there are particles"));
    let energy = |x: &[Vec3], v: &[Vec3]| {
        let of = |(x, v): (&Vec3, &Vec3)| 0.5 * f64::from(v.norm_squared()) - f64::from(world.gravity.dot(x));
        1000.0 * f64::from(params.spacing).powi(3) * x.iter().zip(v).map(of).sum::<f64>()
    };
    let (mut x, mut v) = (channel(&start, "position"), channel(&start, "velocity"));
    change(&mut x, &mut v);
    let mut frame = rebuilt(&start, x, v);
    // The energy that a shot may have is that of its start.
    let first = energy(&channel(&frame, "position"), &channel(&frame, "velocity"));
    let scalars = &mut frame.streams[0].scalars;
    scalars.iter_mut().find(|(name, _)| name == "first_energy").expect("it is stored").1 = first;
    Simulation::restore(world, Some(params), &frame).expect("the frame has a state")
}

/// Advances; after every frame the state is finite, nothing is lost, and no energy has come from nowhere.
fn survive(
    name: &str,
    simulation: &mut Simulation,
    frame: f64,
    frames: u32,
) -> Result<Vec<LiquidRecord>, Diverged> {
    let start = state(simulation);
    let count = start.streams[0].len();
    let first = start.streams[0].scalar("first_energy").unwrap();
    let (mut records, mut work) = (Vec::new(), 0.0);
    for _ in 0..frames {
        let record = match simulation.advance(frame, &mut Unwatched) {
            Ok(record) => record.liquid.expect("there is a liquid"),
            Err(Stop::Diverged(found)) => return Err(found),
            Err(Stop::Interrupted) => unreachable!("it is not interrupted"),
        };
        let now = state(simulation);
        let mut ids = now.streams[0].u32("id").unwrap().to_vec();
        ids.sort_unstable();
        assert!(ids.into_iter().eq(0..count as u32), "{name}: particles are lost");
        let finite = |name| channel(&now, name).iter().all(|v| v.iter().all(|c| c.abs() < 1e8));
        assert!(finite("position") && finite("velocity"), "{name}");
        assert!(
            record.density_dev_max.is_finite() && record.density_dev_avg.is_finite(),
            "{name}: {record:?}"
        );
        let energy = record.kinetic_energy + record.potential_energy + record.microrotation_energy;
        work += record.solid_work + record.confinement_energy;
        let slack = 1e-3 * (first.abs() + record.potential_energy.abs() + work.abs());
        let settle = now.streams[0].scalar("spacing").unwrap().powi(4) * 9.82e3 * count as f64;
        assert!(
            energy <= first + work + settle + slack,
            "{name}: {energy} J of {first} and {work}, {record:?}"
        );
        records.push(record);
    }
    Ok(records)
}

/// Runs three frames with both solvers, `times` as long as usual.
fn all_survive(cases: &[(&str, World, String, f64)]) {
    for solver in SOLVERS {
        for (name, world, text, times) in cases {
            let name = format!("{name}, {solver}");
            let mut simulation = Simulation::new(world.clone(), Some(params(solver, text))).expect(&name);
            let ended = survive(&name, &mut simulation, FRAME * times, 3);
            let records = ended.unwrap_or_else(|found| panic!("{name}: {found}"));
            assert_eq!(records.len(), 3);
        }
    }
}

#[test]
fn long_steps_and_any_gravity() {
    all_survive(&[
        ("a step of 4 s", plate(9.81), cube(""), 100.0),
        ("a step of 4 s in one substep", plate(9.81), cube("max_substeps = 1\nmin_substeps = 1"), 100.0),
        ("a thousand g", plate(9810.0), cube(""), 1.0),
        ("a thousand g for 4 s", plate(9810.0), cube(""), 100.0),
        ("no gravity", plate(0.0), cube(""), 1.0),
        ("no gravity for 4 s", tank(0.0, [0.8, 0.8, 2.0]), cube(""), 100.0),
    ]);
}

/// Pressure moves particles by more than a spacing in a substep that a surface wave takes through one.
#[test]
fn deep_liquid_of_small_particles_rests_at_24_frames_a_second() {
    let (spacing, depth) = (0.003, 0.12);
    let (side, frames) = if crate::is_soak() { (0.048, 4) } else { (0.03, 2) };
    for terms in ["", "viscosity = { dynamic = 5 }"] {
        let text = block(spacing, [0.0; 3], [side, side, depth], terms);
        let mut simulation =
            Simulation::new(tank(9.81, [side, side, 1.0]), Some(params("accelerated", &text)))
                .expect("it starts");
        for frame in 0..frames {
            let record = simulation.advance(FRAME, &mut Unwatched).expect("it stays finite").liquid.unwrap();
            let z = channel(&state(&simulation), "position").iter().map(|x| x.z).fold(0.0, f32::max);
            println!("{terms}, {frame}: {} substeps, up to {z} m, {:?}", record.substeps, record.clamps);
            assert!(
                record.unconverged == 0 && record.pressure_unconverged == 0,
                "{terms}, {frame}: {record:?}"
            );
            assert!(record.clamps.energy == 0, "{terms}, {frame}: {:?}", record.clamps);
            assert!((z - depth).abs() < spacing, "{terms}, {frame}: {z}");
        }
    }
}

#[test]
fn any_spacing_and_number_of_particles() {
    all_survive(&[
        ("1e-4 m", plate(9.81), block(1e-4, [0.0; 3], [8e-4; 3], ""), 1.0),
        ("1e-4 m in a tank", tank(9.81, [2e-3; 3]), block(1e-4, [0.0; 3], [8e-4; 3], ""), 1.0),
        ("10 m", plate(9.81), block(10.0, [0.0; 3], [80.0; 3], ""), 1.0),
        ("10 m in a tank", tank(9.81, [160.0; 3]), block(10.0, [0.0; 3], [80.0; 3], ""), 1.0),
        ("one particle", plate(9.81), block(0.1, [0.0; 3], [0.1; 3], ""), 1.0),
        (
            "one particle without softening",
            plate(9.81),
            block(0.1, [0.0; 3], [0.1; 3], "softening = 0\nconstraint = 'equality'"),
            1.0,
        ),
    ]);
}

#[test]
fn any_solver_setting() {
    let repulsion = "artificial_pressure = { strength = 10, reference = 0.9, exponent = 12 }";
    all_survive(&[
        ("no softening", plate(9.81), cube("softening = 0"), 1.0),
        ("no softening, equality", plate(9.81), cube("softening = 0\nconstraint = 'equality'"), 1.0),
        (
            "no softening, the paper's kernels",
            plate(9.81),
            cube("softening = 0\nkernel = 'poly6_spiky'"),
            1.0,
        ),
        ("one iteration", plate(9.81), cube("iterations = 1"), 1.0),
        ("1000 iterations", plate(9.81), small("iterations = 1000"), 1.0),
        ("1000 iterations, equality", plate(9.81), small("iterations = 1000\nconstraint = 'equality'"), 1.0),
        ("strong repulsion", plate(9.81), cube(repulsion), 1.0),
        ("strong confinement", plate(9.81), cube("vorticity = { strength = 10 }"), 1.0),
        ("strong exchange", plate(9.81), cube("micropolar = { transfer = 10, viscosity = 0 }"), 1.0),
        (
            "strong exchange, smoothed",
            plate(9.81),
            cube("micropolar = { transfer = 10, viscosity = 10 }"),
            1.0,
        ),
        ("no exchange", plate(9.81), cube("micropolar = { transfer = 0, viscosity = 10 }"), 1.0),
        (
            "strong exchange in long substeps",
            plate(9.81),
            cube("cfl = 10\nmin_substeps = 1\nmicropolar = { transfer = 10, viscosity = 10 }"),
            4.0,
        ),
    ]);
}

#[test]
fn a_block_at_500_m_per_s_stops_at_the_plate() {
    let fast = "spacing = 0.1\n[[source]]\nvelocity = [0, 0, -500]\nshape = { box = { min = [0, 0, 1], max = [0.8, 0.8, 1.8] } }";
    all_survive(&[
        ("500 m/s", plate(9.81), fast.into(), 1.0),
        ("500 m/s in one substep", plate(9.81), format!("max_substeps = 1\nmin_substeps = 1\n{fast}"), 1.0),
        ("500 m/s in a tank", tank(9.81, [0.8, 0.8, 3.0]), fast.into(), 1.0),
    ]);
}

/// A box of 512 particles under a lid that comes down to `height` [m] in four frames.
fn piston(height: f32) -> World {
    let key = |frame, z| Keyframe {
        frame,
        position: [0.0, 0.0, z],
        rotation: [0.0; 3],
        quaternion: None,
        scale: 1.0,
    };
    let shape = Shape::Box { min: [-1.0, -1.0, 0.0], max: [1.8, 1.8, 1.0] };
    let lid = Collider {
        shape,
        keyframes: vec![key(1, 1.0), key(5, height)],
        interpolation: Interpolation::Linear,
        friction: None,
        restitution: None,
        contact_angle: None,
        look: None,
    };
    let mut world = tank(9.81, [0.8, 0.8, 3.0]);
    world.solids.push(lid.solid(24.0, 1));
    world
}

#[test]
fn a_lid_that_closes_on_the_liquid_leaves_it_bounded_and_is_reported() {
    for solver in SOLVERS {
        // Onto half the liquid's height, and through the floor.
        for height in [0.3, -0.5].into_iter().skip(usize::from(!crate::is_soak())) {
            let name = format!("a lid at {height} m, {solver}");
            let text = block(0.1, [0.0; 3], [0.8, 0.8, 0.6], "max_iterations = 10\nmax_substeps = 40");
            let mut simulation = Simulation::new(piston(height), Some(params(solver, &text))).unwrap();
            let records =
                survive(&name, &mut simulation, FRAME, 6).unwrap_or_else(|found| panic!("{name}: {found}"));
            let reports =
                |r: &LiquidRecord| r.unconverged > 0 && r.clamps.corrections > 0 && r.density_dev_max > 0.3;
            assert!(records.iter().any(reports), "{name}: {records:?}");
        }
    }
}

#[test]
fn coincident_particles_part() {
    for solver in SOLVERS {
        let params = params(solver, &block(0.1, [0.0; 3], [0.8; 3], ""));
        let mut simulation = changed(world(0.0, vec![]), params, |x, _| x[300] = x[301]);
        survive(solver, &mut simulation, FRAME, 4).expect("it stays finite");
        let frame = state(&simulation);
        let ids = frame.streams[0].u32("id").unwrap();
        let at = |id: u32| channel(&frame, "position")[ids.iter().position(|&i| i == id).unwrap()];
        assert!((at(300) - at(301)).norm() > 0.02, "{solver}: {}", (at(300) - at(301)).norm());
    }
}

#[test]
fn hundreds_in_one_place_part_and_thousands_are_refused() {
    for solver in SOLVERS {
        let few = params(solver, &block(0.1, [0.0; 3], [0.6; 3], "max_iterations = 20"));
        let mut simulation = changed(tank(0.0, [2.0; 3]), few, |x, _| x.fill(Vec3::repeat(1.0)));
        survive("216 in one place", &mut simulation, FRAME, 6).unwrap_or_else(|found| panic!("{found}"));
        let x = channel(&state(&simulation), "position");
        let middle = x.iter().sum::<Vec3>() / x.len() as f32;
        let spread = x.iter().map(|x| (x - middle).norm()).fold(0.0, f32::max);
        assert!(spread > 0.2, "{solver}: {spread} m");

        let many = params(solver, &block(0.1, [0.0; 3], [2.0, 2.0, 2.5], ""));
        let mut simulation = changed(tank(9.81, [3.0; 3]), many, |x, _| x.fill(Vec3::repeat(1.0)));
        let found = survive("10 000 in one place", &mut simulation, FRAME, 1).expect_err("it is refused");
        assert_eq!((found.system, found.substep, found.particle), ("liquid", 1, 0));
        let text = found.to_string();
        assert!(text.contains("9999 others within") && text.contains("liquid.max_substeps"), "{text}");
    }
}

#[test]
fn particles_far_outside_are_simulated_or_named() {
    for solver in SOLVERS {
        let cube = || params(solver, &cube(""));
        for far in [1e3, 1e5, 1e7] {
            let away = Vec3::new(far, -far, far);
            let mut simulation = changed(plate(9.81), cube(), |x, _| x[5] = away);
            survive(&format!("{far} m, {solver}"), &mut simulation, FRAME, 3).expect("it is simulated");
        }
        let mut beyond = changed(plate(9.81), cube(), |x, _| x[5].x = 1e12);
        let found = survive("beyond", &mut beyond, FRAME, 1).expect_err("it is refused");
        assert_eq!((found.substep, found.particle), (0, 5));
        assert!(found.to_string().contains("position of"), "{found}");
    }
}

#[test]
fn divergence_is_reported_with_the_setting_to_change() {
    let many = block(0.1, [0.0; 3], [1.0; 3], "");
    for solver in SOLVERS {
        // More particles than a cell may hold end in the outermost one: the distance is the finding, not the crowd.
        for (gravity, text) in [(1e30, &cube("")), (1e30, &many), (-1e30, &many), (3e38, &cube(""))] {
            let mut simulation = Simulation::new(world(gravity, vec![]), Some(params(solver, text))).unwrap();
            let found = survive("falling", &mut simulation, FRAME, 1).expect_err("it is refused");
            assert_eq!((found.system, found.substep), ("liquid", 1), "{found}");
            let text = found.to_string();
            assert!(text.contains("has a position of") && text.contains("liquid.max_substeps"), "{text}");
        }
        // A plate holds it; the record counts substeps that are too long.
        for gravity in [1e30, 3e38] {
            let mut simulation = Simulation::new(plate(gravity), Some(params(solver, &cube("")))).unwrap();
            let records =
                survive("held", &mut simulation, FRAME, 1).unwrap_or_else(|found| panic!("{found}"));
            assert_eq!(records[0].cfl_capped, records[0].substeps);
        }
    }
}

#[test]
fn a_state_that_is_not_a_number_is_named() {
    for solver in SOLVERS {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let cube = || params(solver, &cube(""));
            let wrong_v = changed(plate(9.81), cube(), |_, v| v[17].y = value);
            let wrong_x = changed(plate(9.81), cube(), |x, _| x[17].z = value);
            for (mut simulation, what) in [(wrong_v, "velocity of"), (wrong_x, "position of")] {
                let found = survive(what, &mut simulation, FRAME, 1).expect_err("it is refused");
                assert_eq!((found.system, found.particle, found.substep), ("liquid", 17, 0));
                assert!(
                    found.to_string().contains(what) && found.to_string().contains("start state"),
                    "{found}"
                );
            }
        }
    }
}

#[test]
fn a_block_leaves_a_ceiling_in_one_piece() {
    // With tension at solids, too, it rings, and 52 of its 1000 particles leave it in the air.
    let ceiling = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, -1.0] };
    let text = block(0.02, [-0.1, -0.1, -0.2], [0.1, 0.1, 0.0], "");
    let mut simulation =
        Simulation::new(world(9.81, vec![Solid::fixed(ceiling)]), Some(params("accelerated", &text)))
            .expect("it has particles");
    for frame in 1..=8 {
        let record =
            simulation.advance(FRAME, &mut Unwatched).expect("it stays finite").liquid.expect("it is there");
        assert!(record.components == 1 && record.isolated == 0, "frame {frame}: {record:?}");
        assert!(record.volume_change < 0.015, "frame {frame}: {record:?}");
    }
}
