//! Sheets in the wind of smoke.

use super::*;
use meniscus::frame::Stream;

/// Smoke too far away and with too little circulation to act, so that only the wind does.
fn air(wind: [f32; 3]) -> String {
    format!(
        "[smoke]\nspacing = 0.2\nwind = {wind:?}\n[[smoke.source]]\nshape = {{ sphere = {{ center = [50, 50, 50], radius = 0.3 }} }}\n"
    )
}

#[test]
fn a_falling_sheet_reaches_terminal_velocity() {
    for integrator in ["symplectic", "implicit"] {
        let cloth = sheet("cloth", 1.0, 0.0, 4, "density = 0.2\nstiffness = [20, 20]");
        let text = format!(
            "{}{cloth}[sheets.solver]\nintegrator = '{integrator}'\n[[coupling]]\nbetween = ['smoke', 'cloth']\ndrag = {{ density = 1.2, across = 1.5 }}\n",
            air([0.0; 3])
        );
        let mut shot = simulation(world(9.81, Vec::new()), &text);
        let couplings = advance(&mut shot, 48).pop().unwrap().coupling.unwrap().smoke.unwrap();
        let speed = (2.0 * 0.2 * 9.81 / (1.2 * 1.5_f64)).sqrt();
        for v in channel(&state(&shot), "sheet.cloth", "velocity") {
            assert!((v.z / -speed - 1.0).abs() < 0.01, "{integrator}: {v:?}, balance {speed}");
        }
        assert!(
            (couplings.impulse[2] / (0.2 * 9.81 * FRAME) - 1.0).abs() < 0.01 && couplings.limited == 0,
            "{couplings:?}"
        );
        assert_eq!(couplings.faces, 16);
    }
}

#[test]
fn a_flag_in_the_wind_is_inclined_by_drag_and_weight() {
    // A stiff, damped flag held along its upper edge is a plate that swings: m g sin a = ½ ρ C w² cos² a.
    let (cells, wind) = (8, 3.0);
    let n = cells + 1;
    let held: Vec<u32> = (0..n).collect();
    let text = format!(
        "{}[[sheet]]\nname = 'flag'\nshape = {{ grid = {{ origin = [0, 0, 0], first = [0, 0.5, 0], second = [0, 0, -0.5], cells = [{cells}, {cells}] }} }}\n\
         density = 0.3\nstiffness = [2000, 2000]\nshear = 500\nbending = 0.05\nspring_damping = [0.002, 0.002]\ndamping = 0.5\npin = [{{ at = {{ points = {held:?} }} }}]\n\
         [sheets.solver]\nintegrator = 'implicit'\nsubsteps = 16\n[[coupling]]\nbetween = ['flag', 'smoke']\ndrag = {{ across = 1.2, along = 0 }}\n",
        air([wind, 0.0, 0.0])
    );
    let mut shot = simulation(world(9.81, Vec::new()), &text);
    advance(&mut shot, 144);
    let x = channel(&state(&shot), "sheet.flag", "position");
    let lower = &x[x.len() - n as usize..];
    let edge = lower.iter().sum::<Double>() / f64::from(n);
    let found = edge.x.atan2(-edge.z);
    let lift = 0.5 * 1.2 * 1.2 * f64::from(wind).powi(2) / (0.3 * 9.81);
    // The root of sin a = lift cos² a.
    let a = ((-1.0 + (1.0 + 4.0 * lift * lift).sqrt()) / (2.0 * lift)).asin();
    println!("angle {:.2}°, balance {:.2}°", found.to_degrees(), a.to_degrees());
    assert!((found / a - 1.0).abs() < 0.05, "{found}, balance {a}");
}

/// A smoke ring that moves towards a cloth.
fn ring(coupled: bool, reordered: bool) -> String {
    let smoke = "[smoke]\nspacing = 0.06\n[[smoke.ring]]\ncenter = [0, 0, -0.3]\nradius = 0.2\nthickness = 0.08\ncirculation = 1.5\ndirection = [0, 0, 1]\n";
    let cloth = sheet("cloth", 0.6, 0.0, 10, "density = 0.05\nstiffness = [50, 50]\nshear = 10");
    let sides = if reordered { "'smoke', 'cloth'" } else { "'cloth', 'smoke'" };
    let coupling = format!("[[coupling]]\nbetween = [{sides}]\n");
    let coupling = if coupled { coupling.as_str() } else { "" };
    if reordered { format!("{cloth}{coupling}{smoke}") } else { format!("{smoke}{cloth}{coupling}") }
}

#[test]
fn a_ring_pushes_a_cloth_and_is_not_affected() {
    let run = |text: &str| {
        let mut shot = simulation(world(0.0, Vec::new()), text);
        advance(&mut shot, 3);
        let middle = state(&shot);
        let records = advance(&mut shot, 3);
        (middle, state(&shot), records.last().unwrap().coupling.clone())
    };
    let one = meniscus::par::with_threads(1, || run(&ring(true, false)));
    for &threads in crate::thread_counts() {
        assert!(meniscus::par::with_threads(threads, || run(&ring(true, false))) == one, "{threads} threads");
    }
    assert!(run(&ring(true, true)) == one, "the order of tables and sides");
    let mut resumed =
        Simulation::restore(world(0.0, Vec::new()), systems(&ring(true, false)), &one.0).unwrap();
    advance(&mut resumed, 3);
    assert!(state(&resumed) == one.1, "resumed");

    // The air moved the cloth; the smoke is the same as without a cloth.
    let fastest = channel(&one.1, "sheet.cloth", "velocity").iter().map(|v| v.z).fold(0.0, f64::max);
    assert!(fastest > 0.05, "{fastest}");
    let alone = run(&ring(false, false));
    let smoke = |frame: &Frame| {
        frame.streams.iter().filter(|s| s.name.starts_with("smoke")).cloned().collect::<Vec<Stream>>()
    };
    assert!(smoke(&alone.1) == smoke(&one.1));
    assert!(channel(&alone.1, "sheet.cloth", "velocity").iter().all(|v| *v == Double::zeros()));
}
