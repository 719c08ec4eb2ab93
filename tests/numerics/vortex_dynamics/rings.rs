//! Rings: their speed, and two that pass through each other.

use super::*;
use meniscus::sim::vortex::Kernel;

#[test]
fn a_thin_ring_travels_at_the_speed_of_its_kernel() {
    let euler = 0.577_215_664_901_532_9;
    let constants = [
        (Kernel::Ball, 2.0_f64.ln() - 1.0 / 3.0),
        (Kernel::RosenheadMoore, 1.0),
        (Kernel::WinckelmansLeonard, 0.5),
        (Kernel::Gaussian, 1.0 + (2.0_f64.ln() - euler) / 2.0),
    ];
    let core = 0.03;
    for (kernel, constant) in constants {
        // A ball has an edge, so it needs more vortons along its radius.
        let count = if kernel == Kernel::Ball { 1200 } else { 420 };
        let mut flow =
            flow(FlowParams { kernel, strain: 0.5, ..direct() }, &ring(count, 1.0, 0.0, 1.0, core), 1.0);
        let seconds = 0.1;
        advance(&mut flow, seconds);
        let speed = (center(&flow.vortons) - 0.0) / seconds;
        let exact = ((8.0 / core).ln() - constant) / (4.0 * PI);
        // What is left is of order (σ/R)² ln(R/σ).
        assert!((speed / exact - 1.0).abs() < 4e-3, "{kernel:?}: {speed} of {exact}");
        let radius = flow.vortons.position.iter().map(|x| x.xy().norm()).fold(0.0, f32::max);
        assert!((radius - 1.0).abs() < 1e-4, "{kernel:?}: {radius}");
    }
}

/// A ring of radius 1 and circulation 1 whose section is a disc of radius `reach` with the vorticity `omega(distance²)`.
fn thick(spacing: f64, reach: f64, core: f64, omega: impl Fn(f64) -> f64) -> Vortons {
    let n = (reach / spacing).ceil() as i32;
    let sections = (2.0 * PI / spacing).round() as usize;
    let mut points = Vec::new();
    for (i, j) in (-n..=n).flat_map(|i| (-n..=n).map(move |j| (i, j))) {
        // The part of the cell in the disc.
        let mut weight = 0.0;
        for k in 0..64 {
            let at = [i, j].map(f64::from);
            let (a, b) = (at[0] + (f64::from(k % 8) - 3.5) / 8.0, at[1] + (f64::from(k / 8) - 3.5) / 8.0);
            let r2 = (a * a + b * b) * spacing * spacing;
            weight += if r2 < reach * reach { omega(r2) / 64.0 } else { 0.0 };
        }
        if weight > 0.0 {
            points.push((f64::from(i) * spacing, f64::from(j) * spacing, weight));
        }
    }
    let whole: f64 = points.iter().map(|p| p.2).sum();
    points.iter().fold(Vortons::default(), |all, &(r, z, weight)| {
        joined(all, &ring(sections, 1.0 + r, z, weight / whole, core))
    })
}

#[test]
#[ignore = "long: tools/soak/run"]
fn thick_rings_travel_at_their_speeds() {
    let miss = |ring: &Vortons, kernel: Kernel, wide: f64, constant: f64| {
        let mut flow = flow(FlowParams { kernel, error: 1e-4, ..FlowParams::default() }, ring, 1.0);
        let (before, seconds) = (center(&flow.vortons), 0.1);
        advance(&mut flow, seconds);
        let speed = ((8.0 / wide).ln() - constant) / (4.0 * PI);
        1.0 - (center(&flow.vortons) - before) / seconds / speed
    };
    // [saffman70]: 0.558 of a Gaussian section ω ~ e^(−r²/a²), ¼ of a solid one; both are wider by their vortons' cores, the
    // Gaussian exactly, the solid by second moment.
    let gaussian = |spacing: f64| {
        let (a, core) = (2.5 * spacing, 1.2 * spacing);
        let ring = thick(spacing, 2.5 * a, core, |r2| (-r2 / (a * a)).exp());
        miss(&ring, Kernel::Gaussian, (a * a + 2.0 * core * core).sqrt(), 0.558)
    };
    let solid = |spacing: f64| {
        let (a, core) = (5.0 * spacing, 1.2 * spacing);
        let ring = thick(spacing, a, core, |_| 1.0);
        miss(&ring, Kernel::WinckelmansLeonard, (a * a + 2.0 * core * core).sqrt(), 0.25)
    };
    // What is left is of order (a/R)².
    let sections = [("Gaussian", [0.06, 0.03].map(gaussian)), ("solid", [0.05, 0.025].map(solid))];
    for (name, errors) in sections {
        let order = (errors[0] / errors[1]).log2();
        assert!(errors[1].abs() < 0.01 && (1.3..2.7).contains(&order), "{name}: {errors:?} {order}");
    }
}

/// Two coaxial rings as circles (radius, z): what the Winckelmans–Leonard kernel makes them do, in double precision.
fn circles(state: [f64; 4], core: f64) -> [f64; 4] {
    const AROUND: usize = 512;
    let mut rates = [0.0; 4];
    for target in 0..2 {
        let (r, z) = (state[2 * target], state[2 * target + 1]);
        for source in 0..2 {
            let (q, s) = (state[2 * source], state[2 * source + 1]);
            for k in 0..AROUND {
                let t = 2.0 * PI * (k as f64 + 0.5) / AROUND as f64;
                let (cos, length) = (t.cos(), q * 2.0 * PI / AROUND as f64);
                let d2 = r * r + q * q - 2.0 * r * q * cos + (z - s).powi(2) + core * core;
                let k = (d2 + 1.5 * core * core) * d2.powf(-2.5) * length / (4.0 * PI);
                rates[2 * target] += k * (z - s) * cos;
                rates[2 * target + 1] += k * (q - r * cos);
            }
        }
    }
    rates
}

/// The circles after `seconds`, by the classical scheme of fourth order.
fn followed(mut state: [f64; 4], core: f64, seconds: f64) -> [f64; 4] {
    let steps = (seconds / 0.005).ceil() as usize;
    let dt = seconds / steps as f64;
    for _ in 0..steps {
        let ahead = |k: [f64; 4], part: f64| std::array::from_fn(|i| state[i] + part * dt * k[i]);
        let k1 = circles(state, core);
        let k2 = circles(ahead(k1, 0.5), core);
        let k3 = circles(ahead(k2, 0.5), core);
        let k4 = circles(ahead(k3, 1.0), core);
        state = std::array::from_fn(|i| state[i] + dt / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
    }
    state
}

#[test]
#[ignore = "long: tools/soak/run"]
fn rings_leapfrog_as_circles_do() {
    let (count, core) = (160, 0.1);
    let mut state = [1.0, 0.0, 1.0, 0.5];
    let both =
        joined(ring(count, state[0], state[1], 1.0, core), &ring(count, state[2], state[3], 1.0, core));
    let mut flow = flow(direct(), &both, 1.0);
    let mut passes = 0;
    let mut ahead = false;
    let frame = 0.25;
    for _ in 0..24 {
        advance(&mut flow, frame);
        state = followed(state, core, frame);
        for k in 0..2 {
            let part = &flow.vortons.position[k * count..(k + 1) * count];
            let radius = part.iter().map(|x| f64::from(x.xy().norm())).sum::<f64>() / count as f64;
            let z = part.iter().map(|x| f64::from(x.z)).sum::<f64>() / count as f64;
            assert!((radius - state[2 * k]).abs() < 2e-3, "{radius} {state:?}");
            assert!((z - state[2 * k + 1]).abs() < 2e-3, "{z} {state:?}");
        }
        if (state[1] > state[3]) != ahead {
            (ahead, passes) = (!ahead, passes + 1);
        }
    }
    // The rear one goes through, and is overtaken in its turn.
    assert!(passes >= 2, "{passes} passes");
}
