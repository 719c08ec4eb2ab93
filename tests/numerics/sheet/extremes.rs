//! Sheets at their limits: every case stays finite and bounded, or ends with an error that names the reason.

use super::{
    statics::{mesh, with_mesh},
    *,
};
use meniscus::sim::sheet::SheetMesh;

const INTEGRATORS: [&str; 2] = ["symplectic", "implicit"];

fn solver(integrator: &str) -> String {
    format!("[sheets.solver]\nintegrator = '{integrator}'\n")
}

/// Runs, and asserts that all points are finite and within `bound` [m] of the origin.
fn survive(name: &str, text: &str, world: &World, frames: u32, bound: f32) -> Vec<SheetRecord> {
    survive_at(name, text, world, frames, FRAME, bound)
}

fn survive_at(
    name: &str,
    text: &str,
    world: &World,
    frames: u32,
    frame: f64,
    bound: f32,
) -> Vec<SheetRecord> {
    let mut sheets = sheets(text, world);
    let records = run_at(&mut sheets, 0, frames, frame).unwrap_or_else(|error| panic!("{name}: {error}"));
    for x in sheets.positions() {
        assert!(x.amax() <= bound, "{name}: {x:?}"); // false for NaN
    }
    records
}

fn hung(cells: [u32; 2], stiffness: f32, integrator: &str) -> String {
    let terms =
        format!("density = 0.2\nstiffness = [{stiffness}, {stiffness}]\npin = [{{ at = 'corners' }}]");
    format!("{}{}", square(cells, 0.0, &terms), solver(integrator))
}

#[test]
fn stiffness_from_a_thousandth_to_a_thousand_million() {
    let world = world(9.81, vec![]);
    for power in -3..=9 {
        let stiffness = 10_f32.powi(power);
        // Sheets with the softest springs fall freely: ½ g t² (1 + 1/n) in n substeps, of half a second. The
        // corners stay.
        let fallen = 0.5 * 9.81 * 0.25 * (1.0 + 1.0 / 96.0);
        survive("implicit", &hung([6, 6], stiffness, "implicit"), &world, 12, 1.001 * fallen);
        if power <= 6 {
            let records = survive("symplectic", &hung([6, 6], stiffness, "symplectic"), &world, 2, 1.001);
            let total = |r: &SheetRecord| r.kinetic_energy + r.elastic_energy + r.potential_energy;
            // Released from rest: the gain of kinetic and elastic energy equals the loss of potential energy.
            assert!(records.iter().all(|r| total(r).abs() < 0.05), "{stiffness}: {records:?}");
        }
    }
    // Above the limit of substeps of a frame it is an error.
    let mut sheets = sheets(&hung([6, 6], 1e12, "symplectic"), &world);
    let error = run(&mut sheets, 0, 1).unwrap_err();
    assert!(error.to_string().contains("substeps") && error.try_next.contains("implicit"), "{error}");
}

#[test]
fn the_limit_of_substeps_is_an_error() {
    let text = format!("{}max_substeps = 3\n", hung([20, 20], 1e5, "symplectic"));
    let error = run(&mut sheets(&text, &world(9.81, vec![])), 0, 1).unwrap_err();
    assert!(error.what.contains("'cloth'") && error.try_next.contains("max_substeps"), "{error}");
}

#[test]
fn the_stability_bound_holds_and_not_far_beyond_it_a_sheet_diverges_with_an_error() {
    let sheet = |terms: &str, courant: f64| {
        let terms = format!("density = 0.2\nstiffness = [50.0, 50.0]\n{terms}");
        let rough = |i: usize| 1e-5 * Vec3::new((i as f32 * 1.7).sin(), (i as f32 * 2.3).sin(), 0.0);
        let mut sheets =
            placed(&square([12; 2], 0.0, &terms), &world(0.0, vec![]), |i, x, v| (x + rough(i), v));
        let dt = sheets.max_stable_step() * courant;
        (0..4000).try_for_each(|k| sheets.step(f64::from(k) * dt, dt).map(|_| ())).map(|()| sheets)
    };
    for terms in
        ["", "shear = 20.0\nbending = 0.01\nspring_damping = [0.001, 0.001]", "spring_damping = [0.01, 0.01]"]
    {
        let stable = sheet(terms, 0.95).unwrap_or_else(|error| panic!("{terms}: {error}"));
        let moved = stable.velocities().iter().map(|v| v.norm()).fold(0.0, f32::max);
        assert!(moved < 0.1, "{terms}: {moved} m/s");
    }
    // The fastest wave of a slack grid is stable up to √2 of the bound.
    let beyond =
        sheet("", 1.6).map(|sheets| sheets.velocities().iter().map(|v| v.norm()).fold(0.0, f32::max));
    assert!(beyond.as_ref().map_or(true, |&speed| speed > 1.0), "{beyond:?}");
    let thrown = Vec3::new(1e9, 0.0, 0.0);
    let text = square([2, 2], 0.0, "density = 0.2\nstiffness = [50.0, 50.0]");
    let mut thrown = placed(&text, &world(0.0, vec![]), |_, x, _| (x, thrown));
    let error = run(&mut thrown, 0, 1).unwrap_err();
    assert!(error.system == "sheet" && !error.what.is_empty() && error.substep == 1, "{error}");
}

#[test]
fn rest_length_zero_and_points_in_one_place() {
    let world = world(0.0, vec![]);
    for integrator in INTEGRATORS {
        let film = format!(
            "{}{}",
            square([8, 8], 0.0, "density = 0.1\nstiffness = [5.0, 5.0]\nrest = [0.0, 0.0]\nshear = 2.0"),
            solver(integrator)
        );
        // It contracts, and no point leaves the initial extent.
        survive("soap film", &film, &world, 48, 1.001);
        let text = format!(
            "{}{}",
            square([8, 8], 0.0, "density = 0.1\nstiffness = [5.0, 5.0]\nbending = 0.001"),
            solver(integrator)
        );
        let mut crumpled = placed(&text, &world, |_, _, v| (Vec3::new(0.3, 0.3, 0.3), v));
        let records = run(&mut crumpled, 0, 12).unwrap();
        assert_eq!(records[0].folded, 2 * 8 * 9, "{integrator}: all springs are counted");
        assert!(crumpled.positions().iter().all(|x| x.amax() < 1.0));
        let mut creased =
            placed(&text, &world, |i, x, v| (if i % 2 == 0 { x } else { Vec3::new(0.2, 0.2, 0.0) }, v));
        run(&mut creased, 0, 48).unwrap();
        assert!(creased.positions().iter().all(|x| x.amax() < 10.0), "{integrator}");
    }
}

#[test]
fn one_point_one_row_and_one_column() {
    for integrator in INTEGRATORS {
        for cells in [[0, 0], [1, 0], [0, 1], [7, 0], [0, 7], [1, 1]] {
            let text = hung(cells, 30.0, integrator).replace("pin =", "shear = 3.0\nbending = 0.001\npin =");
            let records = survive(&format!("{integrator} {cells:?}"), &text, &world(9.81, vec![]), 24, 1.001);
            assert_eq!(records[0].points, u64::from((cells[0] + 1) * (cells[1] + 1)));
        }
    }
}

#[test]
fn a_mass_ratio_of_a_million() {
    for integrator in INTEGRATORS {
        let region =
            "region = [{ shape = { sphere = { center = [0.5, 0.5, 0.0], radius = 0.2 } }, density = 1e6 }]";
        let text = hung([8, 8], 1e4, integrator)
            .replace("density = 0.2", "density = 1e-3")
            .replace("pin =", &format!("{region}\npin ="));
        let mut sheets = sheets(&text, &world(9.81, vec![]));
        let records = run(&mut sheets, 0, 6).unwrap();
        // The heavy region falls freely, in n substeps, and the light one hangs between it and the corners.
        let substeps: u32 = records.iter().map(|record| record.substeps).sum();
        let fallen = 0.5 * 9.81 * 0.0625 * (1.0 + 1.0 / substeps as f32);
        let z = || sheets.positions().into_iter().map(|x| x.z);
        let (low, high) = (z().fold(f32::MAX, f32::min), z().fold(f32::MIN, f32::max));
        let aside = sheets.positions().iter().map(|x| (x.xy().add_scalar(-0.5)).amax()).fold(0.0, f32::max);
        println!("{integrator}: {low} {fallen} {high} {aside}");
        assert!(
            (low / -fallen - 1.0).abs() < 3e-3 && high <= 1e-6 && aside < 0.5 + 1e-4,
            "{low} {fallen} {high} {aside}"
        );
    }
}

#[test]
fn frames_a_hundred_times_as_long() {
    let ball = Shape::Sphere { center: [0.5, 0.5, -0.6], radius: 0.3 };
    for integrator in INTEGRATORS {
        let text = hung([8, 8], 50.0, integrator).replace("pin =", "damping = 1.0\npin =");
        let records =
            survive_at(integrator, &text, &world(9.81, vec![ball.clone()]), 3, 100.0 * FRAME, 1.001);
        assert!(records.iter().all(|r| r.inside_solids == 0));
    }
}

#[test]
fn a_substep_a_hundred_times_too_long() {
    let world = world(9.81, vec![]);
    let after = |integrator: &str, times: f64| {
        let text = hung([8, 8], 500.0, integrator).replace("pin =", "shear = 50.0\npin =");
        let rough = |i: usize| 1e-4 * Vec3::new((i as f32 * 1.7).sin(), (i as f32 * 2.3).sin(), 0.0);
        let mut sheets = placed(&text, &world, |i, x, v| (x + rough(i), v));
        let dt = times * sheets.max_stable_step();
        (0..100).try_for_each(|k| sheets.step(f64::from(k) * dt, dt).map(|_| ())).map(|()| sheets.positions())
    };
    // The implicit integrator continues, the symplectic one names the diverged point.
    let held = after("implicit", 100.0).unwrap();
    assert!(held.iter().all(|x| x.amax() < 5.0), "{held:?}");
    let error = after("symplectic", 100.0).unwrap_err();
    assert!(error.what.contains("'cloth'") && error.try_next.contains("courant"), "{error}");
    assert!(after("symplectic", 0.9).unwrap().iter().all(|x| x.amax() < 5.0));
}

#[test]
fn energy_gained_by_the_linearisation_is_reported() {
    let world = world(0.0, vec![]);
    // Springs turn quickly, and every point has its own velocity.
    let spin = |i: usize, x: Vec3, _| {
        let rough = Vec3::new((i as f32 * 1.7).sin(), (i as f32 * 2.3).sin(), (i as f32 * 3.1).sin());
        (x, 3.0 * Vec3::new(-x.y, x.x, 0.0) + rough)
    };
    for (substeps, overshoots) in [(20_000, false), (2000, false), (10, true), (1, true)] {
        let terms = "density = 0.2\nstiffness = [1e6, 1e6]\nshear = 1e5\nbending = 0.01";
        let text = square([8, 8], 0.0, terms) + &solver("implicit") + "substeps = 1\ntolerance = 1e-6\n";
        let mut sheets = placed(&text, &world, spin);
        let dt = 1.0 / f64::from(substeps);
        let records = run_at(&mut sheets, 0, substeps.clamp(10, 40), dt).unwrap();
        let energy = |r: &SheetRecord| r.kinetic_energy + r.elastic_energy;
        // No external work: energy grows by the reported gain, and by less than a hundredth if none is
        // reported.
        for pair in records.windows(2) {
            let [before, after] = [&pair[0], &pair[1]].map(energy);
            let gain = pair[1].overshot_energy;
            assert!(
                after < 1.011 * before + 1.001 * gain,
                "{substeps}: {before} J to {after} J, reported {gain} J"
            );
        }
        assert_eq!(records.iter().any(|r| r.overshot > 0), overshoots, "{substeps}: {records:?}");
    }
}

#[test]
fn all_points_pinned_stay() {
    for integrator in INTEGRATORS {
        let all: Vec<u32> = (0..25).collect();
        let text = hung([4, 4], 30.0, integrator).replace("'corners'", &format!("{{ points = {all:?} }}"));
        let world = world(9.81, vec![]);
        let mut held = sheets(&text, &world);
        let before = held.positions();
        run(&mut held, 0, 12).unwrap();
        assert_eq!(before, held.positions(), "{integrator}");
    }
}

#[test]
fn a_pin_that_teleports() {
    for integrator in INTEGRATORS {
        for stiffness in ["", "stiffness = 500.0, "] {
            let pin = format!(
                "pin = [{{ at = {{ points = [0] }}, {stiffness}keyframes = [{{ frame = 1 }}, {{ frame = 2 }}, {{ frame = 3, position = [100, 0, 0] }}] }}]"
            );
            let text = hung([6, 6], 200.0, integrator).replace("pin = [{ at = 'corners' }]", &pin);
            let records = survive(integrator, &text, &world(9.81, vec![]), 24, 250.0);
            // The corner has two springs of 100 N/m. Moving it by d = 100 m does at most the work ½ k d², as
            // if all else stayed. A soft pin is in series with these springs and may overshoot to twice the
            // displacement.
            let k = if stiffness.is_empty() { 200.0 } else { 500.0 };
            let total: Vec<f64> =
                records.iter().map(|r| r.kinetic_energy + r.elastic_energy + r.potential_energy).collect();
            println!("{integrator} {stiffness}: {total:?}");
            assert!(
                total.iter().all(|&energy| energy < 0.5 * k * 100.0_f64.powi(2)),
                "{integrator}: {total:?}"
            );
            // Afterwards there is no external work.
            if stiffness.is_empty() {
                let steady = |pair: &[f64]| match integrator {
                    "symplectic" => (pair[1] / total[2] - 1.0).abs() < 0.05,
                    _ => pair[1] < pair[0] * 1.001,
                };
                assert!(total[2..].windows(2).all(steady), "{integrator}: {total:?}");
            }
        }
    }
}

#[test]
fn an_obstacle_that_starts_inside_the_sheet_or_fills_its_hole() {
    for integrator in INTEGRATORS {
        for shape in [
            Shape::Sphere { center: [0.5, 0.5, 0.0], radius: 0.3 },
            Shape::Torus { center: [0.5, 0.5, -0.1], axis: [0.0, 0.0, 1.0], radius: 0.21, tube: 0.2 },
        ] {
            let text = format!(
                "{}[sheets.repulsion]\nenergy = 0.1\nrange = 0.01\n",
                hung([6, 6], 100.0, integrator).replace("pin = [{ at = 'corners' }]", "")
            );
            let world = world(9.81, vec![shape.clone()]);
            let mut sheets = sheets(&text, &world);
            // Points inside are projected to the surface at once, which stretches springs. Their energy is
            // all there is, in addition to the potential c of repulsion over the whole sheet.
            let out = |_, x, v| {
                let (distance, out) = shape.contact(x);
                (x - out * distance.min(0.0), v)
            };
            let drawn = run_at(&mut placed(&text, &world, out), 0, 1, 1e-9).unwrap()[0].elastic_energy;
            let records = run(&mut sheets, 0, 24).unwrap();
            let total = |r: &SheetRecord| r.kinetic_energy + r.elastic_energy + r.potential_energy;
            let largest = records.iter().map(total).fold(f64::MIN, f64::max);
            println!("{integrator} {shape:?}: {largest} J of {drawn} J");
            assert!(largest < 1.1 * drawn + 0.1, "{integrator}: {largest} J of {drawn} J");
            // It moves no further than this energy allows.
            let fastest = (2.0 * (largest + 10.0) / 0.2).sqrt() as f32;
            assert!(sheets.positions().iter().all(|x| x.norm() < 1.5 + fastest), "{integrator}: {fastest}");
            assert!(records.iter().all(|r| r.inside_solids == 0), "{integrator}");
        }
    }
}

#[test]
fn invalid_parameters_are_refused_by_key() {
    let world = world(9.81, vec![]);
    let good = hung([4, 4], 10.0, "symplectic");
    for (from, to, key) in [
        ("density = 0.2", "density = nan", "sheet.0.density"),
        ("density = 0.2", "density = -1.0", "sheet.0.density"),
        ("stiffness = [10, 10]", "stiffness = [inf, 1.0]", "sheet.0.stiffness"),
        ("origin = [0.0, 0.0, 0.0]", "origin = [nan, 0.0, 0.0]", "sheet.0.shape.grid.origin"),
        ("second = [0.0, 1.0, 0.0]", "second = [2.0, 0.0, 0.0]", "sheet.0.shape.grid"),
        ("cells = [4, 4]", "cells = [4000000, 4000000]", "points"),
        ("'corners'", "{ points = [25] }", "sheet.0.pin.0.at"),
        ("'corners'", "{ inside = { sphere = { center = [9, 9, 9], radius = 1 } } }", "sheet.0.pin.0.at"),
        ("integrator", "courant = 1.0\nintegrator", "solver.courant"),
        ("'corners'", "'corners', place = [0, nan, 0]", "sheet.0.pin.0.place is NaN"),
        (
            "'corners'",
            "'corners', keyframes = [{ frame = 1 }, { frame = 9, position = [inf, 0, 0] }]",
            "sheet.0.pin.0.keyframes.1.position is inf",
        ),
        (
            "'corners'",
            "'corners', keyframes = [{ frame = 1, rotation = [0, 0, nan] }]",
            "keyframes.0.rotation is NaN",
        ),
        (
            "'corners'",
            "'corners', keyframes = [{ frame = 1, quaternion = [nan, 0, 0, 1] }]",
            "keyframes.0.quaternion is NaN",
        ),
    ] {
        let text = good.replace(from, to);
        assert_ne!(text, good, "{from}");
        let error = try_sheets(&text, &world).map(|_| ()).unwrap_err().to_string();
        assert!(error.contains(key), "{to}: {error}");
    }
    assert!(
        try_sheets(
            &format!("{}{good}", square([1, 1], 0.0, "density = 1.0\nstiffness = [1.0, 1.0]")),
            &world
        )
        .is_err()
    );
    // An invalid state is detected in the first substep.
    let mut broken = placed(&good, &world, |i, x, v| (if i == 12 { Vec3::repeat(f32::NAN) } else { x }, v));
    let error = run(&mut broken, 0, 1).unwrap_err();
    assert!(error.system == "sheet" && error.what.contains("NaN"), "{error}");
}

#[test]
fn meshes_with_a_zero_length_edge_or_a_loose_point_are_refused() {
    let error = |change: &dyn Fn(&mut SheetMesh)| {
        let mut mesh = mesh(3, true);
        change(&mut mesh);
        let shot = with_mesh(mesh, "density = 1.0\nstiffness = [1.0, 1.0]");
        Sheets::new(shot, &world(0.0, vec![])).map(|_| ()).unwrap_err()
    };
    let key = || "sheet.0.shape.mesh".to_owned();
    assert_eq!(error(&|mesh| mesh.points[1] = mesh.points[0]), SheetError::Flat { key: key(), point: 0 });
    assert_eq!(error(&|mesh| mesh.faces.push([4, 5, 5, 5])), SheetError::Flat { key: key(), point: 5 });
    assert_eq!(error(&|mesh| mesh.points.push([2.0; 3])), SheetError::Loose { key: key(), point: 16 });
    assert_eq!(
        error(&|mesh| mesh.faces.push([4, 5, 99, 99])),
        SheetError::NoSuchPoint { key: key(), point: 99, count: 16 }
    );
}

/// ½ g t² (1 + 1/n) in n equal substeps, with either integrator.
#[test]
fn a_free_point_falls_freely() {
    for integrator in INTEGRATORS {
        for cells in [[0, 0], [1, 0], [3, 2]] {
            let text = hung(cells, 30.0, integrator)
                .replace("pin = [{ at = 'corners' }]", "velocity = [1.0, 0.0, 0.0]");
            let mut sheets = sheets(&text, &world(9.81, vec![]));
            let start = sheets.positions();
            let substeps: u32 = run(&mut sheets, 0, 24).unwrap().iter().map(|record| record.substeps).sum();
            let fallen = 0.5 * 9.81 * (1.0 + 1.0 / substeps as f32);
            for ((x, v), start) in sheets.positions().iter().zip(sheets.velocities()).zip(start) {
                let off = (x - start - Vec3::new(1.0, 0.0, -fallen)).norm();
                assert!(
                    off < 2e-5 && (v - Vec3::new(1.0, 0.0, -9.81)).norm() < 2e-5,
                    "{integrator} {cells:?}: {off} {v:?}"
                );
            }
        }
    }
}

#[test]
fn an_empty_list_of_sheets_runs() {
    let records = survive("nothing", "sheet = []", &world(9.81, vec![]), 2, 0.0);
    assert_eq!((records[0].points, records[0].kinetic_energy), (0, 0.0));
}
