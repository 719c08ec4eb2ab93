//! Forces against closed forms: the fields themselves, and the motion, work and restart of liquids and sheets under them.

use super::{ForceParams, ForceRecord, field::Forces};
use crate::{
    frame::{Frame, FrameIndex},
    math::{Vec3, elementary::exp_m1},
    par,
    sim::{
        FrameRecord, Simulation, Systems, Timeline, Unwatched, World,
        liquid::LiquidParams,
        sheet::{SheetsParams, Shot},
    },
};
use serde::Deserialize;

const FPS: f64 = 24.0;

/// A ball of liquid with a radius of 6 cm at the origin.
const BALL: &str = "spacing = 0.02\n[[source]]\nshape = { sphere = { center = [0, 0, 0], radius = 0.06 } }";

/// A square of 1 m without pins.
const CLOTH: &str = "[[sheet]]\nname = 'cloth'\ndensity = 0.3\nstiffness = [50, 50]\n\
    shape = { grid = { origin = [0, 0, 0], first = [1, 0, 0], second = [0, 1, 0], cells = [6, 6] } }";

const UNIFORM: &str = "kind = { uniform = { acceleration = [3, 0, 0] } }";

fn forces(tables: &[&str]) -> Vec<ForceParams> {
    #[derive(Deserialize)]
    struct Table {
        force: Vec<ForceParams>,
    }
    let text: String = tables.iter().map(|table| format!("[[force]]\n{table}\n")).collect();
    crate::from_toml::<Table>(&text).force
}

/// The acceleration of a point at rest [m/s²].
fn acceleration(table: &str, x: [f32; 3], time: f64) -> Vec3 {
    let forces = Forces::on("liquid", &forces(&[table]), Timeline { fps: FPS, first: 1 }).unwrap();
    let snapshot = forces.at(time);
    let sample = snapshot.sample(Vec3::from(x));
    snapshot.uniform + sample.acceleration + sample.pull
}

#[track_caller]
fn assert_close(found: Vec3, expected: [f32; 3], tolerance: f32) {
    let difference = (found - Vec3::from(expected)).norm();
    assert!(difference <= tolerance, "found {found:?}, expected {expected:?}");
}

fn systems(liquid: Option<&str>, sheets: Option<&str>, tables: &[&str]) -> Systems {
    let liquid = liquid.map(crate::from_toml::<LiquidParams>);
    let sheets = sheets.map(|text| {
        let params: SheetsParams = crate::from_toml(text);
        Shot { params, fps: FPS, first: 1 }
    });
    let timeline = Timeline { fps: FPS, first: 1 };
    Systems { liquid, sheets, forces: forces(tables), timeline, ..Systems::default() }
}

fn without_gravity() -> World {
    World { gravity: Vec3::zeros(), solids: Vec::new() }
}

/// The last frame and the records of all.
fn run(systems: Systems, frames: u32) -> (Frame, Vec<FrameRecord>) {
    let mut simulation = Simulation::new(without_gravity(), systems).unwrap();
    let records = (0..frames)
        .map(|_| simulation.advance(1.0 / FPS, &mut Unwatched).unwrap_or_else(|stop| panic!("{stop}")));
    let records = records.collect();
    (simulation.frame(FrameIndex(1)), records)
}

fn mean(values: &[Vec3]) -> Vec3 {
    values.iter().sum::<Vec3>() / values.len() as f32
}

fn on_liquid(records: &[FrameRecord]) -> ForceRecord {
    let mut sum = ForceRecord::default();
    records.iter().for_each(|record| sum.unite(record.liquid.as_ref().unwrap().forces.as_ref().unwrap()));
    sum
}

#[test]
fn point_and_vortex_have_their_closed_forms() {
    // At r = 0.4, with R = 0.3, ρ is 0.5.
    let point = |power: f32| {
        format!("kind = {{ point = {{ center = [1, 0, 0], strength = 2, radius = 0.3, power = {power} }} }}")
    };
    for (power, factor) in [(0.0, 1.0), (1.0, 0.6), (2.0, 0.36)] {
        let found = acceleration(&point(power), [1.0, 0.4, 0.0], 0.0);
        assert_close(found, [0.0, -2.0 * factor * 0.8, 0.0], 1e-6);
    }
    assert_close(acceleration(&point(2.0), [1.0, 0.0, 0.0], 0.0), [0.0; 3], 0.0);
    let vortex = "kind = { vortex = { center = [0, 0, 5], axis = [0, 0, 2], strength = 2, radius = 0.3 } }";
    // Around the axis by the right-hand rule, whatever the height.
    assert_close(acceleration(vortex, [0.4, 0.0, 0.0], 0.0), [0.0, 2.0 * 0.6 * 0.8, 0.0], 1e-6);
    assert_close(acceleration(vortex, [0.0, 0.4, 9.0], 0.0), [-2.0 * 0.6 * 0.8, 0.0, 0.0], 1e-6);
}

#[test]
fn strengths_shapes_and_places_follow_their_keyframes() {
    let keys = format!(
        "{UNIFORM}\nstrength_keyframes = [{{ frame = 1, factor = 0 }}, {{ frame = 25, factor = 1 }}, \
         {{ frame = 26, factor = 0 }}]"
    );
    for (time, factor) in [(0.0, 0.0), (0.25, 0.25), (1.0, 1.0), (25.0 / 24.0, 0.0), (9.0, 0.0)] {
        assert_close(acceleration(&keys, [0.0; 3], time), [3.0 * factor, 0.0, 0.0], 1e-5);
    }
    let shape = "shape = { sphere = { center = [0, 0, 0], radius = 1 } }";
    let falloff = format!("{UNIFORM}\n{shape}\nfalloff = 0.5");
    for (distance, factor) in [(0.9, 1.0), (1.125, 27.0 / 32.0), (1.25, 0.5), (1.5, 0.0), (7.0, 0.0)] {
        assert_close(acceleration(&falloff, [0.0, distance, 0.0], 0.0), [3.0 * factor, 0.0, 0.0], 1e-5);
    }
    let moved = format!(
        "{UNIFORM}\n{shape}\nkeyframes = [{{ frame = 1 }}, {{ frame = 25, position = [4, 0, 0], rotation = [0, 0, 90] }}]"
    );
    assert_close(acceleration(&moved, [4.0, 0.0, 0.0], 0.0), [0.0; 3], 0.0);
    assert_close(acceleration(&moved, [4.0, 0.0, 0.0], 1.0), [0.0, 3.0, 0.0], 1e-5);
}

#[test]
fn turbulence_has_no_divergence_its_rms_and_a_seed() {
    let table = |seed: u32, window: &str| {
        format!(
            "kind = {{ turbulence = {{ strength = 2, scale = 0.5, period = 1, seed = {seed} }} }}\n{window}"
        )
    };
    let window = "shape = { sphere = { center = [0, 0, 0], radius = 0.3 } }\nfalloff = 0.6";
    for window in ["", window] {
        let table = table(7, window);
        let all = Forces::on("liquid", &forces(&[&table]), Timeline { fps: FPS, first: 1 }).unwrap();
        let snapshot = all.at(0.3);
        let at = |x: Vec3| snapshot.sample(x).acceleration;
        let (step, mut divergences, mut slopes, mut squares) = (4e-3_f32, 0.0, 0.0, 0.0);
        let places: Vec<Vec3> = (0..400_u32)
            .map(|i| Vec3::new((i % 7) as f32 - 3.0, (i % 11) as f32 - 5.0, (i % 13) as f32 - 6.0) * 0.08)
            .collect();
        for &x in &places {
            let slope = |axis: usize| {
                let offset = Vec3::from_fn(|i, _| if i == axis { step } else { 0.0 });
                (at(x + offset)[axis] - at(x - offset)[axis]) / (2.0 * step)
            };
            let slopes_here = [0, 1, 2].map(slope);
            divergences += f64::from(slopes_here.iter().sum::<f32>()).powi(2);
            slopes += slopes_here.iter().map(|&slope| f64::from(slope).powi(2)).sum::<f64>();
            squares += f64::from(at(x).norm_squared());
        }
        // What is left is the error of the differences, (2π h/λ)²/6 of the slopes.
        let ratio = (divergences / slopes).sqrt();
        assert!(ratio < 2e-3, "divergence is {ratio} of the slopes, window {window:?}");
        if window.is_empty() {
            let rms = (squares / places.len() as f64).sqrt();
            assert!((rms - 2.0).abs() < 0.4, "RMS {rms}");
        }
    }
    let at = |seed: u32, time: f64| acceleration(&table(seed, ""), [0.1, 0.2, 0.3], time);
    assert_eq!(at(7, 0.5), at(7, 0.5));
    assert!((at(7, 0.5) - at(8, 0.5)).norm() > 0.1 && (at(7, 0.5) - at(7, 1.0)).norm() > 0.1);
}

#[test]
fn a_ball_under_a_uniform_force_follows_half_a_t_squared_and_work_is_its_energy() {
    let liquid = format!("min_substeps = 16\n{BALL}");
    let (start, _) = run(systems(Some(&liquid), None, &[UNIFORM]), 0);
    let (frame, records) = run(systems(Some(&liquid), None, &[UNIFORM]), 12);
    let liquid = &frame.streams[0];
    let moved = mean(liquid.vec3("position").unwrap()) - mean(start.streams[0].vec3("position").unwrap());
    assert_close(moved, [0.5 * 3.0 * 0.25, 0.0, 0.0], 0.01 * 0.375);
    let v = liquid.vec3("velocity").unwrap();
    let energy = 0.5 * 1000.0 * 0.02_f64.powi(3) * v.iter().map(|v| f64::from(v.norm_squared())).sum::<f64>();
    let sum = on_liquid(&records);
    assert!((sum.work / energy - 1.0).abs() < 0.01, "work {} J, energy {energy} J", sum.work);
    // The energy that the liquid may have rises by the work, and nothing was slowed down.
    let allowed = liquid.scalar("first_energy").unwrap() - start.streams[0].scalar("first_energy").unwrap();
    assert!((allowed / sum.work - 1.0).abs() < 1e-6, "{allowed} J of {} J", sum.work);
    assert!(records.iter().all(|record| record.liquid.as_ref().unwrap().clamps.energy == 0));
    assert_eq!((sum.limited, sum.strongest), (0, None));
    assert!((sum.max_acceleration - 3.0).abs() < 1e-3);
}

#[test]
fn drag_decays_exponentially_towards_its_velocity() {
    let drag = "kind = { drag = { rate = 5, velocity = [1, 0, 0] } }";
    for substeps in [1, 16] {
        let liquid = format!("min_substeps = {substeps}\n{BALL}");
        let (frame, _) = run(systems(Some(&liquid), None, &[drag]), 6);
        let expected = -exp_m1(-5.0 * 6.0 / 24.0);
        assert_close(mean(frame.streams[0].vec3("velocity").unwrap()), [expected, 0.0, 0.0], 0.01 * expected);
    }
    // Any rate is stable, and the work is the kinetic energy, gained and lost.
    let stiff = "kind = { drag = { rate = 1e6, velocity = [1, 0, 0] } }";
    let (frame, records) = run(systems(Some(BALL), None, &[stiff]), 2);
    let v = frame.streams[0].vec3("velocity").unwrap();
    assert_close(mean(v), [1.0, 0.0, 0.0], 0.01);
    let energy = 0.5 * 1000.0 * 0.02_f64.powi(3) * v.len() as f64;
    let sum = on_liquid(&records);
    assert!((sum.work / energy - 1.0).abs() < 0.01 && sum.limited == 0, "{sum:?}, energy {energy} J");
    // From 3 m/s to rest, and back against the motion.
    let fast = format!("{BALL}\nvelocity = [3, 0, 0]");
    for (velocity, gained) in [(0.0, -9.0), (-3.0, 0.0)] {
        let stop = format!("kind = {{ drag = {{ rate = 1e6, velocity = [{velocity}, 0, 0] }} }}");
        let (_, records) = run(systems(Some(&fast), None, &[&stop]), 1);
        let sum = on_liquid(&records);
        assert!((sum.work / energy - gained).abs() < 0.1 && sum.limited == 0, "{sum:?}, expected {gained}");
    }
}

#[test]
fn nothing_moves_outside_the_shape_and_other_systems_feel_nothing() {
    let two = format!(
        "min_substeps = 8\n{BALL}\n[[source]]\nshape = {{ sphere = {{ center = [0, 1, 0], radius = 0.06 }} }}"
    );
    let shaped = format!("{UNIFORM}\nshape = {{ box = {{ min = [-9, -0.5, -9], max = [9, 0.5, 9] }} }}");
    let (frame, _) = run(systems(Some(&two), None, &[&shaped]), 6);
    let liquid = &frame.streams[0];
    let (x, v) = (liquid.vec3("position").unwrap(), liquid.vec3("velocity").unwrap());
    let of = |is_far: bool| {
        let chosen = x.iter().zip(v).filter(|(x, _)| (x.y > 0.5) == is_far);
        mean(&chosen.map(|(_, v)| *v).collect::<Vec<_>>())
    };
    assert_close(of(false), [0.75, 0.0, 0.0], 0.01);
    assert_close(of(true), [0.0; 3], 1e-4);
    // A force for one system leaves the other alone.
    let named = format!("{UNIFORM}\nsystems = ['sheets']");
    let (frame, records) = run(systems(Some(BALL), Some(CLOTH), &[&named]), 2);
    assert_close(mean(frame.streams[0].vec3("velocity").unwrap()), [0.0; 3], 1e-4);
    assert_eq!(records[1].liquid.as_ref().unwrap().forces, None);
    assert!(records[1].sheets.as_ref().unwrap().forces.unwrap().work > 0.0);
}

#[test]
fn frames_have_the_same_bits_after_a_restart_and_on_any_number_of_threads() {
    let tables = [
        "kind = { turbulence = { strength = 8, scale = 0.1, period = 0.2 } }",
        "kind = { vortex = { center = [0, 0, 0], axis = [0, 1, 1], strength = 5, radius = 0.1 } }\n\
         strength_keyframes = [{ frame = 1, factor = 0 }, { frame = 4, factor = 1 }]",
        "kind = { drag = { rate = 2 } }\nshape = { sphere = { center = [0, 0, 0], radius = 0.05 } }\nfalloff = 0.05",
    ];
    let all = || systems(Some(BALL), Some(CLOTH), &tables);
    let advance = |simulation: &mut Simulation| {
        simulation.advance(1.0 / FPS, &mut Unwatched).unwrap_or_else(|stop| panic!("{stop}"))
    };
    let whole = |threads: usize| {
        par::with_threads(threads, || {
            let mut simulation = Simulation::new(without_gravity(), all()).unwrap();
            let half =
                [(); 2].map(|()| advance(&mut simulation)).last().map(|_| simulation.frame(FrameIndex(1)));
            let last = [(); 2].map(|()| advance(&mut simulation));
            (half.unwrap(), simulation.frame(FrameIndex(1)), last.map(|record| record.liquid))
        })
    };
    let (half, end, records) = whole(1);
    assert!(whole(3) == (half.clone(), end.clone(), records.clone()), "threads change bits");
    let mut again = Simulation::restore(without_gravity(), all(), &half).unwrap();
    let last = [(); 2].map(|()| advance(&mut again).liquid);
    assert!(again.frame(FrameIndex(1)) == end && last == records, "a restart changes bits");
}

#[test]
fn a_force_of_a_million_is_limited_counted_and_named() {
    let huge = "kind = { uniform = { acceleration = [0, 0, 1e6] } }";
    let drag = "kind = { drag = { rate = 0.1 } }";
    // A thousand substeps resolve the acceleration, but not the speed.
    let fine = format!("max_substeps = 1000\n{BALL}");
    let (_, records) = run(systems(Some(&fine), None, &[drag, huge]), 1);
    assert_eq!(on_liquid(&records).limited, 0);
    assert!(records[0].liquid.as_ref().unwrap().cfl_capped > 0);
    let (frame, records) = run(systems(Some(&format!("max_substeps = 64\n{BALL}")), None, &[drag, huge]), 2);
    let sum = on_liquid(&records);
    assert!(sum.limited > 0 && sum.strongest == Some(1), "{sum:?}");
    assert!((sum.max_acceleration / 1e6 - 1.0).abs() < 0.01, "{sum:?}");
    let x = frame.streams[0].vec3("position").unwrap();
    assert!(x.iter().all(|x| x.amax().is_finite()) && sum.work.is_finite() && sum.work > 0.0);
    assert!(records.iter().all(|record| record.liquid.as_ref().unwrap().cfl_capped > 0));
    let sheets = format!("{CLOTH}\n[sheets.solver]\nmax_substeps = 50");
    let (frame, records) = run(systems(None, Some(&sheets), &[drag, huge]), 1);
    let record = records[0].sheets.as_ref().unwrap().forces.unwrap();
    assert!(record.limited > 0 && record.strongest == Some(1), "{record:?}");
    assert!(frame.streams[0].vec3("position").unwrap().iter().all(|x| x.amax().is_finite()));
}

#[test]
fn a_sheet_falls_under_a_uniform_force_as_under_gravity() {
    let down = "kind = { uniform = { acceleration = [0, 0, -9.81] } }";
    for solver in ["integrator = 'symplectic'", "integrator = 'implicit'\nsubsteps = 64"] {
        let sheets = format!("{CLOTH}\n[sheets.solver]\n{solver}");
        let (frame, records) = run(systems(None, Some(&sheets), &[down]), 12);
        let fallen = mean(frame.streams[0].vec3("position").unwrap()).z;
        assert!((fallen / (-0.5 * 9.81 * 0.25) - 1.0).abs() < 0.01, "{solver}: {fallen} m");
        let work: f64 =
            records.iter().map(|record| record.sheets.as_ref().unwrap().forces.unwrap().work).sum();
        let energy = 0.5 * 0.3 * (9.81_f64 * 0.5).powi(2);
        assert!((work / energy - 1.0).abs() < 0.01, "{solver}: work {work} J, energy {energy} J");
    }
}
