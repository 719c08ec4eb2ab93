//! Pins and joints.

use super::*;

/// One point of 0.2 kg.
fn point(terms: &str) -> String {
    square([0, 0], 0.0, &format!("density = 0.2\nstiffness = [1.0, 1.0]\n{terms}"))
}

#[test]
fn a_soft_pin_yields_by_eq_8_at_any_resolution() {
    for cells in [[0, 0], [1, 1], [4, 4]] {
        // All points are pinned, so each pin supports the weight of one point: k per point.
        let count = ((cells[0] + 1) * (cells[1] + 1)) as f32;
        let all: Vec<u32> = (0..count as u32).collect();
        let terms = format!(
            "density = 0.2\nstiffness = [1000.0, 1000.0]\nshear = 1000.0\nbending = 100.0\ndamping = 6.0\n\
             pin = [{{ at = {{ points = {all:?} }}, stiffness = {} }}]",
            20.0 / count
        );
        let mut sheets = sheets(&square(cells, 0.0, &terms), &world(9.81, vec![]));
        run(&mut sheets, 0, 72).unwrap();
        let mean: f32 = sheets.positions().iter().map(|x| x.z).sum::<f32>() / count;
        assert!((mean + 0.2 * 9.81 / 20.0).abs() < 2e-3, "{cells:?}: {mean}");
    }
}

#[test]
fn an_exact_pin_follows_its_keyframes_and_lets_go() {
    let terms = "[[sheet.pin]]\nat = 'center'\nrelease = 13\n\
                 keyframes = [{ frame = 1 }, { frame = 13, position = [1.0, 0.0, 0.0] }]\n";
    for integrator in ["symplectic", "implicit"] {
        let mut sheets = sheets(
            &format!("{}[sheets.solver]\nintegrator = '{integrator}'", point(terms)),
            &world(9.81, vec![]),
        );
        run(&mut sheets, 0, 6).unwrap();
        assert!((sheets.positions()[0] - Vec3::new(0.5, 0.0, 0.0)).norm() < 1e-6, "{:?}", sheets.positions());
        run(&mut sheets, 6, 6).unwrap();
        assert!((sheets.positions()[0] - Vec3::new(1.0, 0.0, 0.0)).norm() < 1e-6);
        // Released, the point keeps the speed of its path: 2 m/s.
        run(&mut sheets, 12, 12).unwrap();
        let x = sheets.positions()[0];
        assert!((x.x - 2.0).abs() < 1e-4 && (x.z + 0.5 * 9.81 * 0.25).abs() < 0.15, "{integrator}: {x:?}");
    }
}

#[test]
fn a_pin_moves_with_its_collider_or_along_a_path() {
    use meniscus::solid::{Collider, Interpolation, Keyframe};
    let key = |frame, turn| Keyframe {
        frame,
        position: [0.0; 3],
        rotation: [0.0, 0.0, turn],
        quaternion: None,
        scale: 1.0,
    };
    let collider = Collider {
        shape: Shape::Sphere { center: [9.0, 9.0, 9.0], radius: 0.5 },
        keyframes: vec![key(1, 90.0), key(25, 180.0)],
        interpolation: Interpolation::Linear,
        friction: None,
        restitution: None,
        contact_angle: None,
        look: None,
    };
    let world = World { gravity: Vec3::zeros(), solids: vec![collider.solid(24.0, 1)] };
    let text = grid(
        [1.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0, 0],
        "density = 1.0\nstiffness = [1.0, 1.0]\npin = [{ at = 'center', collider = 0 }]",
    );
    let mut sheets = sheets(&text, &world);
    run(&mut sheets, 0, 24).unwrap();
    assert!((sheets.positions()[0] - Vec3::y()).norm() < 1e-5, "a quarter turn: {:?}", sheets.positions());

    let text = text.replace(
        "collider = 0",
        "place = [0, 0, 2], keyframes = [{ frame = 1 }, { frame = 25, position = [3, 0, 0] }]",
    );
    let mut led = super::sheets(&text, &world);
    run(&mut led, 0, 12).unwrap();
    assert!((led.positions()[0] - Vec3::new(1.5, 0.0, 2.0)).norm() < 1e-5, "{:?}", led.positions());
    assert!(try_sheets(&text.replace("at =", "collider = 7, at ="), &world).is_err());
}

fn two(joint: &str, solver: &str) -> String {
    two_at(1.5, joint, solver)
}

/// Sheets of 1 m, the second of which starts at `x`. Point 5 of the first and 3 of the second are the middles
/// of the sides that face each other.
fn two_at(x: f32, joint: &str, solver: &str) -> String {
    let sheet = |name: &str, x: f32, mass: f32| {
        grid(
            [x, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [2, 2],
            &format!(
                "density = {mass}\nstiffness = [50.0, 50.0]\nshear = 20.0\nspring_damping = [0.02, 0.02]"
            ),
        )
        .replace("'cloth'", &format!("'{name}'"))
    };
    format!(
        "{}{}[[sheets.joint]]\nsheets = ['a', 'b']\nat = [{{ points = [5] }}, {{ points = [3] }}]\n{joint}\n{solver}",
        sheet("a", 0.0, 0.2),
        sheet("b", x, 0.4)
    )
}

#[test]
fn a_joint_pulls_points_of_two_sheets_together_and_conserves_momentum() {
    for (solver, bound) in [("", 1e-5), ("[sheets.solver]\nintegrator = 'implicit'\ntolerance = 1e-6", 1e-4)]
    {
        let text = two("stiffness = 30.0", solver).replace("spring_damping", "damping = 0.0\nspring_damping");
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        let center = |sheets: &Sheets| {
            let sum: Vec3 = sheets.positions().iter().enumerate().map(|(i, x)| x * sheets.mass(i)).sum();
            sum / (0..sheets.len()).map(|i| sheets.mass(i)).sum::<f32>()
        };
        let before = center(&sheets);
        let gap = |sheets: &Sheets| (sheets.positions()[9 + 3] - sheets.positions()[5]).norm();
        assert!((gap(&sheets) - 0.5).abs() < 1e-6);
        let mut closest = gap(&sheets);
        for k in 0..48 {
            run(&mut sheets, k, 1).unwrap();
            closest = closest.min(gap(&sheets));
        }
        assert!(closest < 0.1, "{closest}");
        assert!((center(&sheets) - before).norm() < bound, "{:?}", center(&sheets) - before);
    }
    let let_go = two("stiffness = 30.0\nrelease = 1", "");
    let mut sheets = sheets(&let_go, &world(0.0, vec![]));
    run(&mut sheets, 0, 10).unwrap();
    assert!((sheets.positions()[12] - Vec3::new(1.5, 0.5, 0.0)).norm() < 1e-6);
}

#[test]
fn a_joint_with_a_direction_turns_an_edge_into_it() {
    let text = format!(
        "{}[[sheets.joint]]\nsheets = ['cloth', 'cloth']\nat = [{{ points = [0] }}, {{ points = [1] }}]\nstiffness = 5.0\ndirection = [0, 1, 1]\n",
        square([1, 0], 0.0, "density = 0.5\nstiffness = [500.0, 0.0]\ndamping = 5.0")
    );
    for integrator in ["symplectic", "implicit"] {
        let mut sheets =
            sheets(&format!("{text}[sheets.solver]\nintegrator = '{integrator}'"), &world(0.0, vec![]));
        run(&mut sheets, 0, 120).unwrap();
        let x = sheets.positions();
        let edge = x[1] - x[0];
        assert!(
            (edge - Vec3::new(0.0, 0.5_f32.sqrt(), 0.5_f32.sqrt())).norm() < 5e-3,
            "{integrator}: {edge:?}"
        );
        assert!((0.5 * (x[0] + x[1]) - Vec3::new(0.5, 0.0, 0.0)).norm() < 1e-4);
    }
}

fn center(sheets: &Sheets) -> Vec3 {
    let sum: Vec3 = sheets.positions().iter().enumerate().map(|(i, x)| x * sheets.mass(i)).sum();
    sum / (0..sheets.len()).map(|i| sheets.mass(i)).sum::<f32>()
}

const SOLVERS: [&str; 2] = ["", "[sheets.solver]\nintegrator = 'implicit'\ntolerance = 1e-6"];

#[test]
fn exactly_joined_points_move_as_one_and_conserve_momentum() {
    for solver in SOLVERS {
        let text = two_at(1.0, "release = 25", solver).replacen(
            "stiffness = [50",
            "velocity = [0.3, 0.0, 2.0]\nstiffness = [50",
            1,
        );
        let mut sheets = sheets(&text, &world(0.0, vec![]));
        let start = center(&sheets);
        let speed = |sheets: &Sheets| {
            let sum: Vec3 = sheets.velocities().iter().enumerate().map(|(i, v)| v * sheets.mass(i)).sum();
            sum / (0..sheets.len()).map(|i| sheets.mass(i)).sum::<f32>()
        };
        let first = speed(&sheets);
        for k in 0..24 {
            run(&mut sheets, k, 1).unwrap();
            let x = sheets.positions();
            assert_eq!(x[5], x[9 + 3], "{solver} frame {k}");
        }
        let off = center(&sheets) - start - first;
        assert!((speed(&sheets) - first).norm() < 2e-5 && off.norm() < 2e-5, "{solver} {off:?}");
        // The point that moved is slowed by the other.
        assert!(sheets.velocities()[9 + 4].norm() > 0.2, "{solver} {:?}", sheets.velocities()[9 + 4]);
        run(&mut sheets, 24, 6).unwrap();
        let x = sheets.positions();
        assert!((x[5] - x[12]).norm() > 1e-3, "{solver}: let go");
    }
}

#[test]
fn points_joined_exactly_to_a_pinned_point_follow_it() {
    let pin = "pin = [{ at = { points = [5] }, keyframes = [{ frame = 1 }, { frame = 13, position = [0.0, 0.5, 0.2] }] }]\n\
               density = 0.2";
    for solver in SOLVERS {
        let text = two_at(1.0, "", solver).replacen("density = 0.2", pin, 1);
        let mut sheets = sheets(&text, &world(9.81, vec![]));
        run(&mut sheets, 0, 6).unwrap();
        let x = sheets.positions();
        assert!((x[5] - Vec3::new(1.0, 0.75, 0.1)).norm() < 1e-5, "{solver} {:?}", x[5]);
        assert_eq!(x[5], x[12], "{solver}");
        run(&mut sheets, 6, 6).unwrap();
        let x = sheets.positions();
        assert!((x[12] - Vec3::new(1.0, 1.0, 0.2)).norm() < 1e-5, "{solver} {:?}", x[12]);
    }
}

#[test]
fn a_pair_with_an_exact_direction_only_changes_length() {
    // One end hangs on a spring; without the joint the other would swing down about it.
    let text = |joint: &str| {
        format!(
            "{}[[sheets.joint]]\nsheets = ['cloth', 'cloth']\nat = [{{ points = [0] }}, {{ points = [1] }}]\n{joint}\n",
            square(
                [1, 0],
                0.0,
                "density = 0.5\nstiffness = [20.0, 0.0]\nvelocity = [0.0, 0.0, 0.0]\npin = [{ at = { points = [0] }, stiffness = 40.0 }]"
            )
        )
    };
    for solver in SOLVERS {
        let mut sheets = sheets(&format!("{}{solver}", text("direction = [2, 0, 0]")), &world(9.81, vec![]));
        // The joint conserves the momentum of both ends. They swing together, to at most twice the
        // equilibrium of the spring.
        let deepest = 2.0 * (sheets.mass(0) + sheets.mass(1)) * 9.81 / 40.0;
        for k in 0..24 {
            run(&mut sheets, k, 1).unwrap();
            let x = sheets.positions();
            let edge = x[1] - x[0];
            assert!(edge.yz().norm() < 1e-6 && edge.x > 0.5, "{solver} {edge:?}");
            assert!(x[0].z > -1.02 * deepest, "{solver} {} {deepest}", x[0].z);
        }
        // The spring supports the weight of both.
        let lowest = sheets.positions()[0].z;
        assert!(lowest < -0.02, "{solver} {lowest}");
    }
    let mut loose = sheets(&text("stiffness = 1e-3\ndirection = [2, 0, 0]"), &world(9.81, vec![]));
    run(&mut loose, 0, 24).unwrap();
    assert!(
        (loose.positions()[1] - loose.positions()[0]).z.abs() > 0.1,
        "only the joint keeps the direction"
    );
}

#[test]
fn a_pair_swings_once_its_direction_joint_lets_go() {
    // One end is pinned; without the joint the other would swing down about it.
    let text = |joint: &str, solver: &str| {
        let terms = "density = 0.5\nstiffness = [20.0, 0.0]\npin = [{ at = { points = [0] } }]";
        format!(
            "{}[[sheets.joint]]\nsheets = ['cloth', 'cloth']\nat = [{{ points = [0] }}, {{ points = [1] }}]\n{joint}\n{solver}",
            square([1, 0], 0.0, terms)
        )
    };
    for solver in SOLVERS {
        // With a spring it hangs m g/k lower.
        for (joint, low) in [("", 1e-6), ("stiffness = 1000.0\n", 2.5 * 0.25 * 9.81 / 1000.0)] {
            let joint = format!("{joint}direction = [1, 0, 0]\nrelease = 13");
            let mut sheets = sheets(&text(&joint, solver), &world(9.81, vec![]));
            for k in 0..12 {
                run(&mut sheets, k, 1).unwrap();
                let end = sheets.positions()[1];
                assert!(end.z.abs() <= low && (end.x - 1.0).abs() < 0.01, "{solver} {joint} {k}: {end:?}");
            }
            // Nothing else supports a level spring: the end falls, at first freely, by ½ g t² (1 + 1/n) in n
            // substeps.
            let substeps: u32 = run(&mut sheets, 12, 3).unwrap().iter().map(|record| record.substeps).sum();
            let fallen = 0.5 * 9.81 * (3.0 / 24.0_f32).powi(2) * (1.0 + 1.0 / substeps as f32);
            let fallen = sheets.positions()[1].z + fallen;
            println!("{solver} {joint}: {fallen}");
            // A spring of 20 N/m stretches and reduces the fall by a tenth.
            assert!(fallen.abs() < 0.01, "{solver} {joint}: {fallen}");
        }
    }
}

#[test]
fn contradicting_exact_pins_and_joints_are_refused() {
    let refused = |text: &str, part: &str| {
        let error = try_sheets(text, &world(0.0, vec![])).expect_err(part).to_string();
        assert!(error.contains(part), "{error}");
    };
    refused(&two_at(1.5, "", ""), "5.00e-1 m apart");
    refused(
        &two_at(
            1.0,
            "direction = [0, 1, 0]\nstiffness = 2.0\n[[sheets.joint]]\nsheets = ['a', 'a']\nat = [{ points = [0] }, { points = [1] }]\ndirection = [0, 1, 0]",
            "",
        ),
        "5.00e-1 m off its direction",
    );
    let pin = "pin = [{ at = { points = [3, 5] } }]\ndensity";
    let both = two_at(1.0, "", "").replace("density", pin);
    refused(&both, "joined exactly are held exactly by one pin at most");
    let chain = "direction = [1, 0, 0]\n[[sheets.joint]]\nsheets = ['a', 'b']\nat = [{ points = [5] }, { points = [3] }]";
    let pair = two_at(1.0, chain, "").replacen("['a', 'b']", "['a', 'a']", 1).replacen(
        "points = [5]",
        "points = [4]",
        1,
    );
    let pair = pair.replacen(
        "at = [{ points = [4] }, { points = [3] }]",
        "at = [{ points = [4] }, { points = [5] }]",
        1,
    );
    refused(&pair, "keeps a direction exactly has no other exact joint");
}

#[test]
fn the_implicit_integrator_takes_pins_at_the_end_of_the_substep() {
    let pin = "keyframes = [{ frame = 1 }, { frame = 25, position = [2.0, 0.0, 0.0] }]";
    let solver = "[sheets.solver]\nintegrator = 'implicit'";
    let soft = format!("[[sheet.pin]]\nat = 'center'\nstiffness = 1e6\n{pin}\n");
    let mut led = sheets(&format!("{}{solver}", point(&soft)), &world(0.0, vec![]));
    run(&mut led, 0, 12).unwrap();
    assert!((led.positions()[0].x - 1.0).abs() < 1e-4, "{:?}", led.positions());

    // A pin alone moves the point: there is no force and no velocity, and so the right side is zero.
    let exact = format!(
        "{}[[sheet.pin]]\nat = 'corners'\n{pin}\n{solver}",
        square([4, 4], 0.0, "density = 0.2\nstiffness = [50.0, 50.0]")
    );
    let mut moved = sheets(&exact, &world(0.0, vec![]));
    let record = run(&mut moved, 0, 1).unwrap().remove(0);
    assert!(record.iterations < 200 && record.unconverged == 0 && record.residual <= 1e-4, "{record:?}");
}
