//! The liquid against what is known of liquids, and at its limits.

use meniscus::{
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
    par,
    sim::{
        CancelToken, FrameRecord, SetupError, Simulation, Stop, Unwatched, Watch, World,
        liquid::{LiquidParams, LiquidRecord},
    },
    solid::{Shape, Solid},
};

use std::cell::Cell;

const FRAME: f64 = 1.0 / 24.0;

pub(super) fn params(text: &str) -> LiquidParams {
    crate::from_toml(text)
}

fn block(spacing: f32, min: [f32; 3], max: [f32; 3], terms: &str) -> LiquidParams {
    params(&format!(
        "spacing = {spacing}\nsource = [{{ shape = {{ box = {{ min = {min:?}, max = {max:?} }} }} }}]\n{terms}"
    ))
}

fn tank(gravity: f32, max: [f32; 3]) -> World {
    let shape = Shape::Tank { min: [0.0; 3], max };
    World { gravity: Vec3::new(0.0, 0.0, -gravity), solids: vec![Solid::fixed(shape)] }
}

pub(super) fn space() -> World {
    World { gravity: Vec3::zeros(), solids: Vec::new() }
}

pub(super) fn simulation(world: World, params: LiquidParams) -> Simulation {
    Simulation::new(world, Some(params)).expect("the sources hold particles")
}

fn advance(simulation: &mut Simulation, frames: u32) -> Vec<LiquidRecord> {
    (0..frames).map(|_| frame(simulation).liquid.expect("there is a liquid")).collect()
}

fn frame(simulation: &mut Simulation) -> FrameRecord {
    simulation.advance(FRAME, &mut Unwatched).expect("it stays finite")
}

pub(super) fn state(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(0))
}

pub(super) fn channel(frame: &Frame, name: &str) -> Vec<Vec3> {
    frame.streams[0].vec3(name).expect("liquids have it").to_vec()
}

fn top(positions: &[Vec3]) -> f32 {
    positions.iter().fold(f32::NEG_INFINITY, |top, x| top.max(x.z))
}

#[test]
fn a_filled_tank_without_gravity_stays_where_it_is() {
    let mut simulation =
        simulation(tank(0.0, [0.5; 3]), block(0.05, [0.0; 3], [0.5; 3], "constraint = 'equality'"));
    let before = channel(&state(&simulation), "position");
    let record = advance(&mut simulation, 3).pop().unwrap();
    let frame = state(&simulation);
    let ids = frame.streams[0].u32("id").unwrap();
    let moved = |(&id, x): (&u32, &Vec3)| f64::from((x - before[id as usize]).norm());
    let mean = ids.iter().zip(&channel(&frame, "position")).map(moved).sum::<f64>() / ids.len() as f64;
    // The wall's share is planar: in edges and corners it is up to 5 % off, and the particles yield a little.
    assert!(mean < 0.05 * 0.05, "moved by {mean} m in the mean");
    assert!(record.density_dev_max < 0.05, "{}", record.density_dev_max);
}

#[test]
fn a_drop_in_free_space_keeps_its_momentum() {
    for constraint in ["compression", "equality"] {
        let text = format!(
            "spacing = 0.05\nconstraint = '{constraint}'\nartificial_pressure = {{}}\nxsph = {{ strength = 0.1 }}\n\
             [[source]]\nvelocity = [3, 0, 0]\nshape = {{ sphere = {{ center = [0, 0, 0], radius = 0.25 }} }}\n\
             [[source]]\nvelocity = [-1, 0.5, 0]\nshape = {{ box = {{ min = [0.26, -0.2, -0.2], max = [0.66, 0.2, 0.2] }} }}"
        );
        let mut simulation = simulation(space(), params(&text));
        let mean = |simulation: &Simulation, name| {
            let values = channel(&state(simulation), name);
            values.iter().map(|v| v.cast::<f64>()).sum::<nalgebra::Vector3<f64>>() / values.len() as f64
        };
        // The surface of the seeding lattice is under rest density, and with equality contracts hard at first.
        advance(&mut simulation, 1);
        let (v, x) = (mean(&simulation, "velocity"), mean(&simulation, "position"));
        let shortened: u64 = advance(&mut simulation, 6).iter().map(|r| r.clamps.corrections).sum();
        // Shortening breaks momentum. The parts of the drop hit hard enough for a few under equality.
        let few = if constraint == "equality" { 40 } else { 0 };
        assert!(shortened <= few, "{constraint}: {shortened} shortened");
        assert!((mean(&simulation, "velocity") - v).norm() < 2e-4, "{constraint}");
        assert!((mean(&simulation, "position") - x - v * 6.0 * FRAME).norm() < 1e-4, "{constraint}");
    }
}

#[test]
fn a_common_velocity_changes_nothing() {
    let relative = |implicitness: f32, velocity: f32| {
        let text = format!(
            "spacing = 0.05\ncfl = 10\nmin_substeps = 8\nmax_substeps = 8\nxsph = {{}}\nvorticity = {{}}\n\
             surface_tension = {{ coefficient = 12 }}\nimplicitness = {implicitness}\n\
             [[source]]\nvelocity = [{}, 0, 0]\nshape = {{ box = {{ min = [0, 0, 0], max = [0.4, 0.4, 0.4] }} }}\n\
             [[source]]\nvelocity = [{}, 0, 0]\nshape = {{ box = {{ min = [0.4, 0, 0], max = [0.8, 0.4, 0.4] }} }}",
            velocity + 2.0,
            velocity - 2.0
        );
        let mut simulation = simulation(space(), params(&text));
        let first = channel(&state(&simulation), "position");
        advance(&mut simulation, 1);
        let frame = state(&simulation);
        let mut by_id = vec![Vec3::zeros(); first.len()];
        for (&id, x) in frame.streams[0].u32("id").unwrap().iter().zip(&channel(&frame, "position")) {
            by_id[id as usize] = x - Vec3::new(velocity * FRAME as f32, 0.0, 0.0);
        }
        // Free flight is 2 m/s.
        let stopped =
            by_id.iter().zip(&first).filter(|(a, b)| (*a - *b).x.abs() < 1.0 * FRAME as f32).count();
        assert!(stopped > first.len() / 8, "the blocks collide: {stopped} particles are slow");
        by_id
    };
    for implicitness in [0.1, 1.0] {
        let (still, moving) = (relative(implicitness, 0.0), relative(implicitness, 16.0));
        let difference = still.iter().zip(&moving).map(|(a, b)| (a - b).norm()).fold(0.0, f32::max);
        assert!(difference < 1e-4, "{implicitness}: {difference} m");
    }
}

#[test]
fn a_column_rests() {
    let spacing = 0.05;
    let params = block(spacing, [0.0; 3], [0.4, 0.4, 0.8], "density_dev = 0.005\nxsph = {}");
    let mut simulation = simulation(tank(9.81, [0.4, 0.4, 2.0]), params);
    let (first, before) =
        (top(&channel(&state(&simulation), "position")), state(&simulation).streams[0].len());
    let records = advance(&mut simulation, 24);
    let frame = state(&simulation);
    let positions = channel(&frame, "position");
    assert_eq!(positions.len(), before);
    let heights = positions.iter().map(|x| f64::from(x.z)).sum::<f64>() / before as f64;
    assert!((heights - 0.4).abs() < 0.5 * f64::from(spacing) * 0.5, "mean height {heights}");
    assert!((top(&positions) - first).abs() < spacing, "{} from {first}", top(&positions));
    for record in &records {
        assert!(record.density_dev_avg <= 0.0051 && record.particles_inside_solids == 0);
        assert!(record.bulk_dev_avg() < 0.02 && record.clamps.corrections == 0, "{record:?}");
    }
    // The first two layers keep their distance: nothing stacks on the floor.
    let layer = |low: f32, high: f32| {
        let inside: Vec<f32> = positions.iter().map(|x| x.z).filter(|z| (low..high).contains(z)).collect();
        inside.iter().sum::<f32>() / inside.len() as f32
    };
    let floor = layer(0.0, spacing);
    let count = positions.iter().filter(|x| x.z < spacing).count();
    assert!((floor / (0.5 * spacing) - 1.0).abs() < 0.15, "floor layer at {floor}");
    assert!((56..=76).contains(&count), "{count} particles in the floor layer of 64");
}

/// Front positions of [martin52] for a column twice as high as wide: (t √(2g/a), x/a).
const MARTIN_MOYCE: [(f64, f64); 6] =
    [(0.83, 1.22), (1.22, 1.47), (2.00, 2.29), (2.55, 3.00), (3.35, 4.13), (4.03, 4.94)];

/// Root mean square speed [m/s].
fn rms(simulation: &Simulation) -> f64 {
    let v = channel(&state(simulation), "velocity");
    (v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>() / v.len() as f64).sqrt()
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_pool_with_xsph_is_still_after_three_seconds() {
    let spacing = 1.0 / 32.0;
    // 0.2 to 0.7 mm/s. 2 mm/s if the last correction is not shortened, 7 if all of the deviation is corrected at once.
    let presets = "xsph = {}\nimplicitness = 0.25\nvorticity = {}\nsurface_tension = { coefficient = 4.8 }";
    let late = "xsph = {}\nvorticity = {}\nsurface_tension = { coefficient = 4.8 }";
    for terms in ["xsph = {}", "xsph = {}\ndensity_dev = 0.005", presets, late] {
        let pool = block(spacing, [0.0; 3], [0.5, 0.5, 10.0 * spacing], terms);
        let mut simulation = simulation(tank(9.81, [0.5, 0.5, 1.0]), pool);
        advance(&mut simulation, 72);
        println!("{:.5} m/s", rms(&simulation));
        assert!(rms(&simulation) < 0.001, "{} m/s with {terms}", rms(&simulation));
        // The surface is flat: heights of the particles that have none above them.
        let x = channel(&state(&simulation), "position");
        let above =
            |x: &Vec3, y: &Vec3| y.z > x.z + 0.5 * spacing && (y.xy() - x.xy()).norm() < 0.8 * spacing;
        let surface = x.iter().filter(|at| !x.iter().any(|other| above(at, other))).map(|x| x.z);
        let heights: Vec<f64> = surface.map(f64::from).collect();
        let mean = heights.iter().sum::<f64>() / heights.len() as f64;
        let deviation = heights.iter().map(|z| (z - mean).powi(2)).sum::<f64>() / heights.len() as f64;
        println!("flat to {:.3} spacings", deviation.sqrt() / f64::from(spacing));
        assert!(deviation.sqrt() < 0.075 * f64::from(spacing), "{} m with {terms}", deviation.sqrt());
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn deep_columns_rest() {
    // It is thrown up if all of the deviation is corrected at once, and by 1 % without the smaller deviations of the first substeps.
    // With surface tension, 64 layers are thrown up by a warm start of half of the pressures.
    let tension = "surface_tension = { coefficient = 2 }\nimplicitness = 0.25";
    for (layers, deviation, terms) in [(100, 0.003, ""), (100, 0.01, ""), (64, 0.003, tension)] {
        let text = format!("xsph = {{}}\ndensity_dev = {deviation}\n{terms}");
        let column = block(0.02, [0.0; 3], [0.2, 0.2, 0.02 * layers as f32], &text);
        let mut simulation = simulation(tank(9.81, [0.2, 0.2, 3.0]), column);
        let records = advance(&mut simulation, 30);
        assert!(records.iter().all(|record| record.clamps.energy == 0));
        println!("{layers} layers, {deviation}: {:.4} m/s", rms(&simulation));
        assert!(rms(&simulation) < 0.035, "{} m/s with {layers} layers at {deviation}", rms(&simulation));
    }
}

/// Fraction of the mechanical energy that a narrow dam break loses within a second.
fn dam_break_loss(implicitness: f32) -> f64 {
    let (spacing, width) = (1.0 / 24.0, 8.0 / 24.0);
    let text = format!("density_dev = 0.001\nimplicitness = {implicitness}");
    let dam = block(spacing, [0.0; 3], [0.8, width, 1.0], &text);
    let mut simulation = simulation(tank(9.81, [3.2, width, 2.0]), dam);
    let first = channel(&state(&simulation), "position");
    let height = first.iter().map(|x| f64::from(x.z)).sum::<f64>() / first.len() as f64;
    let record = advance(&mut simulation, 24).pop().expect("24 frames");
    assert_eq!(record.clamps.energy, 0);
    let mass = 1000.0 * f64::from(spacing).powi(3) * first.len() as f64;
    1.0 - (record.kinetic_energy + record.potential_energy) / (mass * 9.81 * height)
}

#[test]
fn a_dam_break_keeps_more_energy_with_early_directions() {
    let early = dam_break_loss(0.1);
    assert!(early > 0.0 && early < 0.14, "{early} lost");
    if !crate::is_soak() {
        return;
    }
    let late = dam_break_loss(1.0);
    assert!(late - early > 0.02, "{late} lost with late directions, {early} with early ones");
}

#[test]
fn a_dam_breaks_as_fast_as_it_was_measured() {
    let (a, spacing) = (0.4_f64, 0.025);
    let params = block(spacing, [0.0; 3], [0.4, 0.2, 0.8], "density_dev = 0.005");
    let mut simulation = simulation(tank(9.81, [4.0, 0.2, 2.0]), params);
    let mut time = 0.0;
    for (t, measured) in MARTIN_MOYCE {
        let until = t * (a / (2.0 * 9.81)).sqrt();
        simulation.advance(until - time, &mut Unwatched).expect("it stays finite");
        time = until;
        // Two rows of particles must have passed: single ones fly ahead of the water.
        let mut along: Vec<f32> = channel(&state(&simulation), "position").iter().map(|x| x.x).collect();
        along.sort_by(f32::total_cmp);
        let front = along[along.len() - 16];
        let reached = (f64::from(front) + 0.5 * f64::from(spacing)) / a;
        // The gate of the experiment takes time to leave, and its floor drags: with half the spacing, the front is at 5.74 at
        // T = 4.03.
        assert!((-0.1..0.8).contains(&(reached - measured)), "T = {t}: {reached:.3}, measured {measured}");
    }
}

#[test]
fn frames_have_the_same_bits_on_any_number_of_threads_and_after_a_restart() {
    for solver in ["accelerated", "jacobi"] {
        same_bits(&format!(
            "solver = '{solver}'\nconstraint = 'equality'\nartificial_pressure = {{}}\nxsph = {{}}"
        ));
        same_bits(&format!(
            "solver = '{solver}'\nsurface_tension = {{ coefficient = 20 }}\nvorticity = {{}}\nxsph = {{}}"
        ));
    }
    same_bits("micropolar = {}\nxsph = {}");
}

fn same_bits(terms: &str) {
    let params = block(0.05, [0.0; 3], [0.6, 0.5, 0.7], terms);
    let world = tank(9.81, [1.2, 0.5, 1.0]);
    let frames = if crate::is_soak() { 4 } else { 2 };
    let run = || {
        let mut simulation = simulation(world.clone(), params.clone());
        advance(&mut simulation, frames);
        let middle = state(&simulation);
        advance(&mut simulation, frames);
        (middle, state(&simulation))
    };
    let (middle, end) = par::with_threads(1, run);
    for &threads in crate::thread_counts() {
        assert!(par::with_threads(threads, run) == (middle.clone(), end.clone()), "{threads} threads");
    }
    let mut resumed = Simulation::restore(world, Some(params), &middle).expect("the frame has a state");
    advance(&mut resumed, frames);
    assert!(state(&resumed) == end);
}

#[test]
fn artificial_pressure_does_not_depend_on_iterations_or_substeps() {
    let separation = |iterations: u32, substeps: u32| {
        let terms = format!(
            "iterations = {iterations}\nmin_substeps = {substeps}\nmax_substeps = {substeps}\n\
             artificial_pressure = {{ strength = 0.1 }}"
        );
        // Two pairs too close, and too few to be compressed: only the repulsion acts.
        let text = format!(
            "spacing = 0.1\n{terms}\n[[source]]\nshape = {{ box = {{ min = [0, 0, 0], max = [0.1, 0.1, 0.1] }} }}\n\
             [[source]]\nshape = {{ box = {{ min = [0.092, 0, 0], max = [0.192, 0.1, 0.1] }} }}"
        );
        let mut simulation = simulation(space(), params(&text));
        advance(&mut simulation, 4);
        let x = channel(&state(&simulation), "position");
        (x[0] - x[1]).norm() - 0.092
    };
    let reference = separation(2, 40);
    assert!(reference > 1e-3, "the pair parts by {reference}");
    for iterations in [8, 32] {
        assert_eq!(separation(iterations, 40), reference, "{iterations} iterations");
    }
    for (substeps, bound) in [(20, 0.02), (80, 0.02)] {
        let parted = separation(2, substeps);
        assert!((parted / reference - 1.0).abs() < bound, "{substeps} substeps: {parted} of {reference}");
    }
}

/// Iterations, substeps above the target, height of the centre [m] and RMS speed [m/s] of a column let go at rest.
fn settled(solver: &str) -> (u32, u32, f64, f64) {
    let terms = format!("solver = '{solver}'\ndensity_dev = 0.001\nmax_iterations = 1000\nmin_substeps = 16");
    let params = block(0.03125, [0.0; 3], [0.125, 0.125, 1.0], &terms);
    let mut simulation = simulation(tank(9.81, [0.125, 0.125, 2.0]), params);
    let records = advance(&mut simulation, 8);
    let frame = state(&simulation);
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
    let height = mean(channel(&frame, "position").iter().map(|x| f64::from(x.z)).collect());
    let speed2 = mean(channel(&frame, "velocity").iter().map(|v| f64::from(v.norm_squared())).collect());
    let sum = |f: fn(&LiquidRecord) -> u32| records.iter().map(f).sum::<u32>();
    (sum(|r| r.iterations), sum(|r| r.unconverged), height, speed2.sqrt())
}

#[test]
fn the_accelerated_solver_reaches_a_tight_target_in_fewer_iterations() {
    let (jacobi, accelerated) = (settled("jacobi"), settled("accelerated"));
    assert_eq!((jacobi.1, accelerated.1), (0, 0), "substeps above the target");
    let found = format!("{accelerated:?}, Jacobi {jacobi:?}");
    assert!(3 * accelerated.0 < 2 * jacobi.0, "{found}");
    assert!((accelerated.2 - 0.5).abs() < 0.005 && (accelerated.2 - jacobi.2).abs() < 0.005, "{found}");
    assert!(accelerated.3 < 1.5 * jacobi.3 + 0.02, "{found}");
}

#[test]
fn momentum_that_runs_away_is_calmed_before_it_throws_a_falling_block_apart() {
    // A seeding lattice that falls to the floor from wall to wall: unguarded, thousands of corrections were shortened.
    for terms in ["kernel = 'poly6_spiky'\ndensity_dev = 0.01", "kernel_radius = 2.5\ndensity_dev = 0.001"] {
        let params = block(0.05, [0.0, 0.0, 0.3], [1.0, 1.0, 0.9], terms);
        let records = advance(&mut simulation(tank(9.81, [1.0, 1.0, 3.0]), params), 7);
        let calmed: u32 = records.iter().map(|r| r.clamps.momentum).sum();
        let shortened: u64 = records.iter().map(|r| r.clamps.corrections + r.clamps.energy).sum();
        // The first no longer diverges; the second shortens a few where it hits the floor.
        assert!(
            (calmed > 0 || terms.contains("poly6")) && shortened <= 100,
            "{terms}: calmed {calmed} times, shortened {shortened}"
        );
    }
}

#[test]
fn one_iteration_is_enough_where_nothing_is_to_be_done() {
    let params = block(0.05, [0.0; 3], [0.3; 3], "max_iterations = 1");
    let record = advance(&mut simulation(space(), params), 1).pop().unwrap();
    assert!(record.iterations == record.substeps && record.unconverged == 0, "{record:?}");
}

#[test]
fn a_solve_far_from_converged_makes_no_fountain() {
    let (s, gravity) = (0.03125, 9.81);
    let params = block(s, [0.0; 3], [0.25, 0.25, 1.0], "iterations = 3\nmin_substeps = 2\ncfl = 2.2");
    let mut simulation = simulation(tank(gravity, [0.25, 0.25, 4.0]), params);
    let mass = 1000.0 * 0.0625;
    let largest = mass * f64::from(gravity) * (0.5 + f64::from(s));
    let records = advance(&mut simulation, 16);
    for record in &records {
        // What moves all together is momentum, and is left alone.
        assert!(record.kinetic_energy + record.potential_energy < largest * 1.01, "{record:?}");
    }
    assert!(records.iter().any(|record| record.clamps.energy > 0), "the bound was needed and is counted");
}

#[test]
fn confinement_adds_energy_and_never_more_than_was_lost() {
    let run = |terms: &str| {
        let mut simulation =
            simulation(tank(9.81, [1.2, 0.3, 1.5]), block(0.05, [0.0; 3], [0.6, 0.3, 0.6], terms));
        let first = advance(&mut simulation, 1);
        [first, advance(&mut simulation, 35)].concat()
    };
    let mechanical = |record: &LiquidRecord| record.kinetic_energy + record.potential_energy;
    let without = run("");
    let start = mechanical(&without[0]);
    for strength in [0.2, 10.0] {
        let with = run(&format!("vorticity = {{ strength = {strength} }}"));
        assert!(with.iter().map(|r| r.confinement_energy).sum::<f64>() > 1e-3 * start);
        assert!(with.iter().all(|record| mechanical(record) < 1.1 * start), "strength {strength}");
    }
    assert!(without.iter().all(|record| record.confinement_energy == 0.0));
}

#[test]
fn passes_that_the_preset_does_not_name_do_not_run() {
    let box_of = |terms: &str| block(0.1, [0.0; 3], [0.3; 3], terms);
    let always = ["sort", "predict", "search", "solve", "velocity"];
    let mut plain = simulation(space(), box_of(""));
    assert_eq!(plain.passes(), always);
    let names =
        |record: &FrameRecord| record.seconds.iter().map(|(name, _)| name.to_string()).collect::<Vec<_>>();
    assert_eq!(names(&frame(&mut plain)), always);
    let mut all = simulation(space(), box_of("artificial_pressure = {}\nvorticity = {}\nxsph = {}"));
    let passes = all.passes();
    assert_eq!(passes[3], "artificial_pressure");
    assert_eq!(passes[6..], ["vorticity", "xsph"]);
    let record = frame(&mut all);
    assert_eq!(names(&record), passes);
    assert!(record.seconds.iter().all(|(_, seconds)| *seconds > 0.0));
}

#[test]
fn a_frame_without_its_state_is_refused() {
    let params = block(0.1, [0.0; 3], [0.4; 3], "");
    let empty = Frame { index: FrameIndex(1), time: 0.0, streams: Vec::new() };
    let refused = Simulation::restore(space(), Some(params), &empty).unwrap_err();
    assert_eq!(refused, SetupError::Missing { stream: "liquid", what: "particles" });
    assert_eq!(Simulation::new(space(), None).unwrap_err(), SetupError::NoSystem);
}

#[test]
fn a_token_cancels_the_run_between_iterations() {
    /// Cancels when its token is read for the `limit`th time.
    #[derive(Default)]
    struct Patience {
        limit: u32,
        reads: Cell<u32>,
        token: CancelToken,
        done: f64,
    }
    impl Watch for Patience {
        fn token(&self) -> Option<&CancelToken> {
            self.reads.set(self.reads.get() + 1);
            if self.reads.get() == self.limit {
                self.token.cancel();
            }
            Some(&self.token)
        }
        fn substep(&mut self, done: f64) {
            assert!(done > self.done && done <= 1.0);
            self.done = done;
        }
    }
    let mut simulation =
        simulation(tank(9.81, [0.4; 3]), block(0.05, [0.0; 3], [0.2, 0.4, 0.4], "iterations = 5"));
    let mut patient = Patience::default();
    simulation.advance(FRAME, &mut patient).expect("it is not cancelled");
    assert_eq!(patient.done, 1.0);
    let mut impatient = Patience { limit: 4, ..Patience::default() };
    assert_eq!(simulation.advance(FRAME, &mut impatient).unwrap_err(), Stop::Interrupted);
    assert_eq!(
        (impatient.reads.get(), impatient.done),
        (4, 0.0),
        "between the iterations of the first substep"
    );
}

/// The first stream with other positions and velocities.
fn rebuilt(frame: &Frame, positions: Vec<Vec3>, velocities: Vec<Vec3>) -> Frame {
    let old = &frame.streams[0];
    let mut stream = Stream::new("liquid", StreamKind::Particles, old.len())
        .with("position", positions)
        .with("velocity", velocities)
        .with("id", old.u32("id").unwrap().to_vec());
    stream.scalars = old.scalars.clone();
    Frame { streams: vec![stream], ..frame.clone() }
}

/// Positions by id.
fn by_id(frame: &Frame) -> Vec<Vec3> {
    let ids = frame.streams[0].u32("id").unwrap();
    let mut positions = vec![Vec3::zeros(); ids.len()];
    ids.iter().zip(channel(frame, "position")).for_each(|(&id, x)| positions[id as usize] = x);
    positions
}

/// What takes a position or a velocity to another scene.
type Map<'a> = &'a dyn Fn(Vec3) -> Vec3;

#[test]
fn a_scene_elsewhere_mirrored_or_turned_gives_the_same() {
    const FRAMES: u32 = 4;
    let size = [1.2, 0.3, 1.0];
    let turn = |x: Vec3| Vec3::new(-x.y, x.x, x.z);
    let mirror = |x: Vec3| Vec3::new(-x.x, x.y, x.z);
    let shift = |x: Vec3| x + Vec3::new(1000.0, 1000.0, 0.0);
    let moved: [(&str, Map, Map); 3] =
        [("1 km away", &shift, &|v| v), ("mirrored", &mirror, &mirror), ("turned", &turn, &turn)];
    for solver in ["accelerated", "jacobi"] {
        let spacing = 0.05;
        let params = block(spacing, [0.0; 3], [0.6, 0.3, 0.6], &format!("solver = '{solver}'"));
        let mut here = simulation(tank(9.81, size), params.clone());
        let start = state(&here);
        advance(&mut here, FRAMES);
        let expected = by_id(&state(&here));
        for (name, place, along) in moved {
            let (a, b) = (place(Vec3::zeros()), place(size.into()));
            let shape = Shape::Tank { min: a.inf(&b).into(), max: a.sup(&b).into() };
            let world = World { solids: vec![Solid::fixed(shape)], ..tank(9.81, size) };
            let positions = channel(&start, "position").into_iter().map(place).collect();
            let velocities = channel(&start, "velocity").into_iter().map(along).collect();
            let frame = rebuilt(&start, positions, velocities);
            let mut there = Simulation::restore(world, Some(params.clone()), &frame).unwrap();
            advance(&mut there, FRAMES);
            let found = by_id(&state(&there));
            let distance = |(x, y): (&Vec3, &Vec3)| f64::from((place(*x) - y).norm());
            let mean = expected.iter().zip(&found).map(distance).sum::<f64>()
                / found.len() as f64
                / f64::from(spacing);
            let middle = |x: &[Vec3]| {
                x.iter().map(|x| x.cast::<f64>()).sum::<nalgebra::Vector3<f64>>() / x.len() as f64
            };
            let centre = (middle(&expected.iter().map(|x| place(*x)).collect::<Vec<_>>()) - middle(&found))
                .norm()
                / f64::from(spacing);
            // In spacings: positions 1 km away resolve a thousandth, and a substep takes hundreds of them for velocity. The
            // accelerated solver has 0.154 and 0.129, since such positions do not reach the small targets of the first substeps, and
            // its 0.21 % are near the rounding of a density.
            let (each, all) = if name == "1 km away" { (0.2, 0.16) } else { (0.02, 0.006) };
            assert!(mean < each && centre < all, "{name}, {solver}: {mean} and {centre} spacings");
        }
    }
}

/// A guard against change, not a proof of the frequency: the seeding lattice is elastic, so that low waves are up to 14 % too fast with
/// this kernel radius (docs/liquid.md, "Known errors").
#[test]
fn water_sloshes_at_its_first_frequency() {
    use std::f32::consts::PI;
    let (length, depth, gravity) = (1.0_f32, 0.5_f32, 9.81_f32);
    for solver in ["accelerated", "jacobi"] {
        let params = block(0.05, [0.0; 3], [length, 0.2, depth], &format!("solver = '{solver}'"));
        let world = tank(gravity, [length, 0.2, 1.0]);
        let start = state(&simulation(world.clone(), params.clone()));
        // The first mode of linear theory, at the instant when the surface is flat.
        let k = PI / length;
        let mode = |x: &Vec3| {
            let (u, w) = ((k * x.x).sin() * (k * x.z).cosh(), -(k * x.x).cos() * (k * x.z).sinh());
            Vec3::new(u, 0.0, w) * (0.7 / (k * depth).cosh())
        };
        let positions = channel(&start, "position");
        let velocities = positions.iter().map(mode).collect();
        let frame = rebuilt(&start, positions, velocities);
        let mut simulation = Simulation::restore(world, Some(params), &frame).unwrap();
        let centre = |simulation: &Simulation| {
            let x = channel(&state(simulation), "position");
            x.iter().map(|x| f64::from(x.x)).sum::<f64>() / x.len() as f64 - 0.5 * f64::from(length)
        };
        let (mut crossings, mut last) = (Vec::new(), 0.0);
        for frame in 1..=66 {
            advance(&mut simulation, 1);
            let now = centre(&simulation);
            if last * now < 0.0 {
                crossings.push((f64::from(frame) - now / (now - last)) * FRAME);
            }
            last = now;
        }
        let period = crossings[2] - crossings[0];
        let omega2 = f64::from(PI * gravity / length * (PI * depth / length).tanh());
        let expected = 2.0 * std::f64::consts::PI / omega2.sqrt();
        assert!((period / expected - 1.0).abs() < 0.05, "{solver}: {period} s, expected {expected} s");
    }
}

/// The speed of the jet out of a slot of 0.08 m at a tank's floor over Torricelli's √(2 g (h − z)), h the water left in the
/// tank, z the middle of the jet: a mean from 0.5 s to 0.75 s.
fn outflow(spacing: f32) -> f64 {
    let (length, gravity) = (0.6_f32, 9.81_f32);
    let width = 6.0 * spacing;
    let mut world = tank(gravity, [3.0, width, 1.0]);
    world.solids.push(Solid::fixed(Shape::Box { min: [length, -1.0, 0.08], max: [0.7, 1.0, 1.2] }));
    let mut simulation = simulation(world, block(spacing, [0.0; 3], [length, width, 0.4], ""));
    advance(&mut simulation, 11);
    let mut ratios = Vec::new();
    for _ in 0..7 {
        advance(&mut simulation, 1);
        let frame = state(&simulation);
        let (positions, velocities) = (channel(&frame, "position"), channel(&frame, "velocity"));
        let inside = positions.iter().filter(|x| x.x < length).count() as f32;
        let height = inside * spacing.powi(3) / (length * width);
        let jet: Vec<usize> =
            (0..positions.len()).filter(|&i| (0.78..0.9).contains(&positions[i].x)).collect();
        let mean = |of: &dyn Fn(usize) -> f32| jet.iter().map(|&i| of(i)).sum::<f32>() / jet.len() as f32;
        let (speed, middle) = (mean(&|i| velocities[i].x), mean(&|i| positions[i].z));
        ratios.push(f64::from(speed / (2.0 * gravity * (height - middle)).sqrt()));
    }
    ratios.iter().sum::<f64>() / ratios.len() as f64
}

/// The error is of first order in the spacing (docs/liquid.md, "Known errors"): the order is tested in the soak only.
#[test]
#[ignore = "long: tools/soak/run"]
fn water_flows_out_by_torricellis_law() {
    let coarse = outflow(0.02);
    println!("{coarse:.3} with four particles in the slot");
    assert!((0.92..0.97).contains(&coarse), "{coarse:.3}");
    if !crate::is_soak() {
        return;
    }
    let fine = outflow(0.01);
    println!("{fine:.3} with eight");
    assert!((0.95..1.0).contains(&fine), "{fine:.3}");
    assert!(1.0 - fine < 0.7 * (1.0 - coarse), "{coarse:.3}, {fine:.3}");
}

/// First percentile of the distances to the nearest neighbour [m].
fn closest(positions: &[Vec3]) -> f32 {
    let nearest = |i: usize| {
        let others = positions.iter().enumerate().filter(|&(j, _)| j != i);
        others.map(|(_, y)| (y - positions[i]).norm_squared()).fold(f32::INFINITY, f32::min).sqrt()
    };
    let mut distances: Vec<f32> = (0..positions.len()).map(nearest).collect();
    distances.sort_by(f32::total_cmp);
    distances[distances.len() / 100]
}

#[test]
fn particles_at_the_surface_do_not_cluster() {
    let params = block(0.05, [0.0; 3], [0.6, 0.6, 0.4], "");
    let mut simulation = simulation(tank(9.81, [0.6, 0.6, 1.0]), params);
    advance(&mut simulation, 48);
    let closest = closest(&channel(&state(&simulation), "position")) / 0.05;
    assert!(closest > 0.8, "{closest} spacings");
}

#[test]
fn colliding_drops_keep_their_volume() {
    let text = "spacing = 0.05\nxsph = {}\nvorticity = {}\n\
         [[source]]\nvelocity = [0.4, 0, 0]\nshape = { sphere = { center = [0, 0, 0], radius = 0.3 } }\n\
         [[source]]\nvelocity = [-0.4, 0, 0]\nshape = { sphere = { center = [0.65, 0.2, 0], radius = 0.3 } }";
    let mut simulation = simulation(space(), params(text));
    for record in advance(&mut simulation, 12) {
        assert!(record.volume_change.abs() < 0.03 && record.dilation_avg < 0.02, "{record:?}");
    }
}

#[test]
fn a_ball_without_gravity_or_tension_does_not_drift_apart() {
    // It dilates by 15 % in two seconds if the corrections at the steps of its surface become velocities.
    let text =
        "spacing = 0.02\nxsph = {}\n[[source]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.149 } }";
    let mut simulation = simulation(space(), params(text));
    let records = advance(&mut simulation, 48);
    let last = records.last().expect("there are frames");
    println!("dilation {:.4}, {:.5} m/s", last.dilation_avg, rms(&simulation));
    assert!(last.dilation_avg < 0.01 && last.components == 1, "{last:?}");
    // From the seeded frame on it moves as from the seeds on, on any number of threads.
    let run = |frame: Option<&Frame>| {
        let world = space();
        let mut ball = match frame {
            Some(frame) => Simulation::restore(world, Some(params(text)), frame).expect("it has a state"),
            None => Simulation::new(world, Some(params(text))).expect("it has particles"),
        };
        let seeded = state(&ball);
        advance(&mut ball, 2);
        (seeded, state(&ball))
    };
    let (seeded, end) = par::with_threads(1, || run(None));
    assert!(par::with_threads(3, || run(Some(&seeded))).1 == end);
    assert!(rms(&simulation) < 5e-4, "{} m/s", rms(&simulation));
}

#[test]
fn liquid_at_walls_without_gravity_keeps_its_volume() {
    let mut simulation = simulation(
        tank(0.0, [2.0, 1.0, 1.0]),
        block(0.05, [0.0; 3], [0.6; 3], "implicitness = 0.25\nxsph = {}\nvorticity = {}"),
    );
    let changes: Vec<f64> = advance(&mut simulation, 24).iter().map(|record| record.volume_change).collect();
    assert!(changes.iter().all(|change| change.abs() < 0.01), "{changes:?}");
}
