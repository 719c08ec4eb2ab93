//! Contact between liquid and sheets.

use super::*;

const SPACING: f64 = 0.025;

fn colliding_block(integrator: &str) -> String {
    let cloth = sheet(
        "cloth",
        0.6,
        0.0,
        24,
        "density = 4\nstiffness = [400, 400]\nshear = 80\nbending = 1e-4\nvelocity = [0.3, 0, 0]",
    );
    format!(
        "[liquid]\nspacing = {SPACING}\n{}{cloth}[sheets.solver]\nintegrator = '{integrator}'\n\
         [[coupling]]\nbetween = ['liquid', 'cloth']\nfriction = 0.3\n",
        block([-0.1, -0.05, 0.05], [0.1, 0.15, 0.2], [0.0, 0.0, -2.0])
    )
}

#[test]
fn a_collision_in_free_flight_conserves_momentum() {
    for integrator in ["symplectic", "implicit"] {
        let mut shot = simulation(world(0.0, Vec::new()), &colliding_block(integrator));
        let all = |shot: &Simulation| {
            let frame = state(shot);
            let of = |stream, name| channel(&frame, stream, name);
            let liquid =
                momenta(|_| 1000.0 * SPACING.powi(3), &of("liquid", "position"), &of("liquid", "velocity"));
            let points = [of("sheet.cloth", "position"), of("sheet.cloth", "velocity")];
            let sheets = momenta(point_mass(0.6, 24, 4.0), &points[0], &points[1]);
            ([liquid[0] + sheets[0], liquid[1] + sheets[1]], liquid[0], sheets[0])
        };
        let (before, liquid, _) = all(&shot);
        let records = advance(&mut shot, 4);
        let (after, then, sheets) = all(&shot);
        let couplings: Vec<_> =
            records.iter().map(|record| record.coupling.clone().unwrap().liquid.unwrap()).collect();
        assert!(
            couplings.iter().all(|coupling| coupling.crossed == 0 && coupling.projected_back == 0),
            "{couplings:?}"
        );
        let lost = (after[0] - before[0]).norm() / before[0].norm();
        let angular = (after[1] - before[1]).norm() / before[0].norm() / 0.1;
        println!(
            "{integrator}: momentum {lost:.1e}, angular {angular:.1e} of 0.1 m times it; {liquid:?} to {then:?} and {sheets:?}"
        );
        assert!((then - liquid).norm() > 0.05 * liquid.norm(), "they touched");
        assert!(lost < 1e-5, "{integrator}: {lost}");
        // Contacts act along the normal at the start of a substep, and both sides slide meanwhile.
        assert!(angular < 1e-2, "{integrator}: {angular}");
    }
}

const HELD: u32 = 12;

fn block_on_held_sheet(integrator: &str) -> String {
    let cloth = sheet(
        "cloth",
        1.0,
        0.0,
        HELD,
        &format!(
            "density = 0.5\nstiffness = [2000, 2000]\nshear = 300\ndamping = 5\n\
             pin = [{{ at = {{ points = {:?} }} }}]",
            border(HELD)
        ),
    );
    format!(
        "[liquid]\nspacing = 0.04\nxsph = {{ strength = 0.05 }}\n{}{cloth}[sheets.solver]\nintegrator = '{integrator}'\n\
         [[coupling]]\nbetween = ['cloth', 'liquid']\n",
        block([-0.2, -0.2, 0.06], [0.2, 0.2, 0.3], [0.0, 0.0, 0.0])
    )
}

/// Force of the springs of the grid of [`block_on_held_sheet`] on its pins, downwards [N].
fn pin_force(x: &[Double]) -> f64 {
    let (n, h) = (HELD + 1, 1.0 / f64::from(HELD));
    let pinned = border(HELD);
    let mut sum = 0.0;
    for (i, j) in (0..n * n).map(|k| (k % n, k / n)) {
        for (di, dj, stiffness) in [(1, 0, 2000.0), (0, 1, 2000.0), (1, 1, 300.0), (-1, 1, 300.0)] {
            let (a, b) = (i as i32 + di, j as i32 + dj);
            if !(0..n as i32).contains(&a) || b >= n as i32 {
                continue;
            }
            let ends = [i + n * j, a as u32 + n * b as u32];
            let [p, q] = ends.map(|end| pinned.contains(&end));
            if p == q {
                continue;
            }
            let d = x[ends[1] as usize] - x[ends[0] as usize];
            let rest = h * f64::from(di * di + dj * dj).sqrt();
            let pull = stiffness * (d.norm() - rest) / d.norm() * d.z;
            sum += if p { -pull } else { pull };
        }
    }
    sum
}

#[test]
#[ignore = "long: tools/soak/run"]
fn a_held_sheet_stops_a_block_and_supports_its_weight() {
    let lowest = ["symplectic", "implicit"].map(|integrator| {
        let mut shot = simulation(world(9.81, Vec::new()), &block_on_held_sheet(integrator));
        let mut records = advance(&mut shot, 24);
        let middle = state(&shot);
        records.extend(advance(&mut shot, 24));
        let couplings: Vec<_> =
            records.iter().map(|record| record.coupling.clone().unwrap().liquid.unwrap()).collect();
        let projected_back: u64 = couplings.iter().map(|coupling| coupling.projected_back).sum();
        assert!(couplings.iter().all(|coupling| coupling.crossed == 0), "{integrator}: nothing crosses the sheet");
        let frame = state(&shot);
        assert_eq!(below(&frame, HELD as usize, 0.5), 0, "{integrator}");
        let x = channel(&frame, "liquid", "position");
        assert!(x.iter().all(|x| x.x.abs() < 0.5 && x.y.abs() < 0.5), "{integrator}: none ran over the border");

        // Contact force over the second second: weight, and change of momentum, for it still bounces.
        let mass = 1000.0 * 0.04_f64.powi(3);
        let up = |frame: &Frame, stream: &str, mass: &dyn Fn(usize) -> f64| {
            momenta(mass, &channel(frame, stream, "position"), &channel(frame, stream, "velocity"))[0].z
        };
        let liquid = |frame: &Frame| up(frame, "liquid", &|_| mass);
        let weight = 9.81 * mass * x.len() as f64;
        let expected = weight + liquid(&frame) - liquid(&middle);
        let force = couplings[24..].iter().map(|coupling| -coupling.impulse[2]).sum::<f64>();

        // Force on the pins over the third second.
        let points = point_mass(1.0, HELD, 0.5);
        let free = 9.81 * 0.5 * (1.0 - 1.0 / f64::from(HELD)).powi(2);
        let (mut pins, mut lowest) = (0.0, 0.0);
        for _ in 0..48 {
            shot.advance(FRAME / 2.0, &mut Unwatched).expect("it rests");
            let points = channel(&state(&shot), "sheet.cloth", "position");
            pins += pin_force(&points) / 48.0;
            lowest += points.iter().map(|y| y.z).fold(0.0, f64::min) / 48.0;
        }
        let gained = |frame: &Frame| liquid(frame) + up(frame, "sheet.cloth", &points);
        let held = weight + free + gained(&state(&shot)) - gained(&frame);
        println!(
            "{integrator}: contact {force:.1} of {expected:.1} N, pins {pins:.1} of {held:.1} N, lowest {lowest:.4}, projected back {projected_back}"
        );
        assert!((force / expected - 1.0).abs() < 0.02, "{integrator}: {force} of {expected}");
        assert!((pins / held - 1.0).abs() < 0.02, "{integrator}: {pins} of {held}");
        lowest
    });
    assert!((lowest[0] / lowest[1] - 1.0).abs() < 0.08, "both integrators sag equally: {lowest:?}");
}

/// A block of 6 × 6 × 3 particles that moves towards a wider sheet.
fn moving_block(density: f32, stiffness: f32, integrator: &str) -> String {
    let terms = format!("density = {density}\nstiffness = [{stiffness}, {stiffness}]\nshear = 10");
    format!(
        "[liquid]\nspacing = 0.02\n{}{}[sheets.solver]\nintegrator = '{integrator}'\n\
         [[coupling]]\nbetween = ['liquid', 'cloth']\n",
        block([-0.06, -0.06, 0.02], [0.06, 0.06, 0.08], [0.0, 0.0, -1.0]),
        sheet("cloth", 0.2, 0.0, 8, &terms)
    )
}

/// Mean velocities of liquid and sheet along z after the collision.
fn collision_velocities(density: f32) -> [f64; 2] {
    let mut shot = simulation(world(0.0, Vec::new()), &moving_block(density, 50.0, "symplectic"));
    advance(&mut shot, 3);
    let frame = state(&shot);
    ["liquid", "sheet.cloth"].map(|stream| {
        let v = channel(&frame, stream, "velocity");
        v.iter().map(|v| v.z).sum::<f64>() / v.len() as f64
    })
}

#[test]
fn a_heavy_sheet_stops_the_liquid_and_a_light_one_moves_with_it() {
    // 1.6 kg of water; sheets of 40 g/m² and 400 t/m²: 1e-3 and 1e4 times as heavy.
    let [liquid, sheets] = collision_velocities(4e5);
    assert!(liquid > -0.05 && sheets.abs() < 1e-3, "a heavy sheet stops the liquid: {liquid}, {sheets}");
    let [liquid, sheets] = collision_velocities(4e-3);
    assert!((liquid + 1.0).abs() < 0.02, "a light sheet does not slow it: {liquid}");
    assert!(sheets < -0.2, "the light sheet moves with the liquid: {sheets}");
}

#[test]
fn a_fast_jet_does_not_cross_a_sheet() {
    let cloth = sheet(
        "cloth",
        0.8,
        0.0,
        16,
        &format!(
            "density = 0.3\nstiffness = [3000, 3000]\nshear = 300\npin = [{{ at = {{ points = {:?} }} }}]",
            border(16)
        ),
    );
    let text = format!(
        "[liquid]\nspacing = 0.02\nmax_substeps = 30\n{}{cloth}[sheets.solver]\nintegrator = 'implicit'\n\
         [[coupling]]\nbetween = ['liquid', 'cloth']\n",
        block([-0.04, -0.04, 0.1], [0.04, 0.04, 0.3], [2.0, 0.0, -20.0])
    );
    let mut shot = simulation(world(9.81, Vec::new()), &text);
    let mut capped = 0;
    for frame in 0..8 {
        let record = advance(&mut shot, 1).remove(0);
        let couplings = record.coupling.clone().unwrap().liquid.unwrap();
        capped += record.liquid.unwrap().cfl_capped;
        assert_eq!(couplings.crossed, 0, "frame {frame}");
        assert_eq!(below(&state(&shot), 16, 0.4), 0, "frame {frame}");
    }
    assert!(capped > 0, "the jet exceeds the CFL limit");
}

/// Particles under a sheet that is a square grid about the origin, pinned at its border: below its lowest corner in the cell that they are in
/// by their own x and y.
fn below(frame: &Frame, cells: usize, half: f64) -> usize {
    let (x, y) = (channel(frame, "liquid", "position"), channel(frame, "sheet.cloth", "position"));
    let lowest = y.iter().map(|y| y.z).fold(f64::INFINITY, f64::min);
    let n = cells + 1;
    let under = |x: &&Double| {
        if x.x.abs() > half || x.y.abs() > half {
            return false;
        }
        // A cell may have moved sideways by its own width, so its neighbours count too.
        let near = |y: &&Double| (y.x - x.x).hypot(y.y - x.y) < 3.0 * half / cells as f64;
        let floor = y.iter().filter(near).map(|y| y.z).fold(f64::INFINITY, f64::min);
        x.z < if floor.is_finite() { floor } else { lowest }
    };
    assert_eq!(y.len(), n * n);
    x.iter().filter(under).count()
}

#[test]
fn results_do_not_depend_on_threads_order_or_restarts() {
    let both = |order: &str, integrator: &str| {
        let text = colliding_block(integrator);
        let other = sheet("other", 0.3, -0.1, 6, "density = 0.2\nstiffness = [50, 50]");
        let coupled = "[[coupling]]\nbetween = ['other', 'liquid']\n";
        match order {
            "as is" => format!("{text}{coupled}{other}"),
            "reordered" => {
                let text = text.replace("['liquid', 'cloth']", "['cloth', 'liquid']");
                let (before, after) = text.split_once("[[coupling]]").unwrap();
                format!("{before}{coupled}[[coupling]]{after}{other}")
            }
            _ => unreachable!(),
        }
    };
    let (integrators, frames) = if crate::is_soak() { (2, 3) } else { (1, 2) };
    for integrator in ["implicit", "symplectic"].into_iter().take(integrators) {
        let run = |order: &str| {
            let mut shot = simulation(world(9.81, Vec::new()), &both(order, integrator));
            advance(&mut shot, frames);
            let middle = state(&shot);
            let records = advance(&mut shot, frames);
            let couplings = records.iter().map(|record| record.coupling.clone()).collect::<Vec<_>>();
            (middle, state(&shot), couplings)
        };
        let one = meniscus::par::with_threads(1, || run("as is"));
        assert!(
            one.2.iter().flatten().any(|coupling| coupling.liquid.as_ref().unwrap().contacts > 0),
            "they touch"
        );
        for &threads in crate::thread_counts() {
            assert!(
                meniscus::par::with_threads(threads, || run("as is")) == one,
                "{integrator}, {threads} threads"
            );
        }
        assert!(run("reordered") == one, "{integrator}: the order of couplings and of their sides");
        let systems = systems(&both("as is", integrator));
        let mut resumed = Simulation::restore(world(9.81, Vec::new()), systems, &one.0).unwrap();
        advance(&mut resumed, frames);
        assert!(state(&resumed) == one.1, "{integrator}: resumed");
    }
}

#[test]
fn without_a_coupling_systems_do_not_interact() {
    let text = colliding_block("symplectic");
    let (alone, _) = text.split_once("[[coupling]]").unwrap();
    let run = |systems: Systems| {
        let mut shot = Simulation::new(world(9.81, Vec::new()), systems).unwrap();
        let records = advance(&mut shot, 4);
        assert!(records.iter().all(|record| record.coupling.is_none()));
        (shot.passes(), state(&shot))
    };
    let (passes, both) = run(systems(alone));
    let (liquid_passes, liquid) = run(Systems { sheets: None, ..systems(alone) });
    let (sheet_passes, cloth) = run(Systems { liquid: None, ..systems(alone) });
    assert_eq!(passes, [liquid_passes, sheet_passes].concat());
    assert!(!passes.iter().any(|pass| pass.starts_with("coupling")));
    assert!(both.streams == [liquid.streams, cloth.streams].concat());
    let coupled = simulation(world(9.81, Vec::new()), &text);
    assert_eq!(coupled.passes()[passes.len()..], ["coupling_search", "coupling"]);
}

#[test]
fn an_invalid_coupling_is_refused() {
    let text = colliding_block("symplectic").replace("['liquid', 'cloth']", "['liquid', 'cloths']");
    let error = Simulation::new(world(0.0, Vec::new()), systems(&text)).unwrap_err();
    assert!(error.to_string().contains("no system or sheet 'cloths'; there is 'liquid', 'cloth'"), "{error}");
}

#[test]
fn contact_solves_at_their_iteration_limit_are_counted() {
    // Sweeps converge slowly where the sheet is lighter than the liquid, conjugate gradients where its springs are stiff.
    for (integrator, density, stiffness) in [("symplectic", 4e-3, 50.0), ("implicit", 0.5, 5e4)] {
        let mut shot = simulation(world(0.0, Vec::new()), &moving_block(density, stiffness, integrator));
        let couplings: Vec<_> = advance(&mut shot, 3)
            .into_iter()
            .map(|record| record.coupling.unwrap().liquid.unwrap())
            .collect();
        assert!(
            couplings.iter().map(|coupling| coupling.unconverged).sum::<u64>() > 0,
            "{integrator}: {couplings:?}"
        );
        assert!(couplings.iter().all(|coupling| coupling.crossed == 0), "{integrator}: {couplings:?}");
    }
}

#[test]
#[ignore = "long: tools/soak/run"]
fn an_overloaded_sheet_throws_the_water_back() {
    // 384 kg on a square metre of 2000 N/m, which sags by a metre.
    let cells = 16;
    let cloth = sheet(
        "cloth",
        1.0,
        0.0,
        cells,
        &format!(
            "density = 0.5\nstiffness = [2000, 2000]\nshear = 300\ndamping = 5\n\
             pin = [{{ at = {{ points = {:?} }} }}]",
            border(cells)
        ),
    );
    let text = format!(
        "[liquid]\nspacing = 0.1\n{}{cloth}[sheets.solver]\nintegrator = 'implicit'\n\
         [[coupling]]\nbetween = ['liquid', 'cloth']\n",
        block([-0.4, -0.4, 0.3], [0.4, 0.4, 0.9], [0.0; 3])
    );
    let mut shot = simulation(world(9.81, Vec::new()), &text);
    let start = 384.0 * 9.81 * 0.6;
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for frame in 1..=40 {
        let record = advance(&mut shot, 1).remove(0).liquid.unwrap();
        let state = state(&shot);
        let mean = |name| channel(&state, "liquid", name).into_iter().sum::<Double>() / 384.0;
        let speed = channel(&state, "liquid", "velocity").iter().map(|v| v.norm()).sum::<f64>() / 384.0;
        let energy = record.kinetic_energy + record.potential_energy;
        assert!(frame < 3 || speed > 0.5, "frame {frame}: the water hangs in mid-air, {speed} m/s");
        // The overloaded sheet, too fast for one linearisation, gives back a tenth more than it took.
        assert!(energy < 1.2 * start, "frame {frame}: {energy} J of {start} J");
        let height = mean("position").z;
        lowest = height.min(lowest);
        highest = if height > lowest { height.max(highest) } else { f64::NEG_INFINITY };
    }
    println!("down to {lowest:.3} m and up to {highest:.3} m");
    assert!(lowest < -0.8 && highest > 0.2, "down to {lowest} m and up to {highest} m");
}
