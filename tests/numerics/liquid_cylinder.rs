//! Break-up of a cylinder of liquid by its surface tension, against the theory of [rayleigh78].
//!
//! A wave of the radius with the wavenumber k grows or swings between two smooth planes, half a wavelength apart. Their contact angle is
//! 90°, so that they mirror the liquid: ends that retract, and waves of other lengths, do not enter.

use meniscus::{
    frame::{Frame, FrameIndex, Stream, StreamKind},
    math::Vec3,
    sim::{Simulation, Unwatched, World, liquid::LiquidParams},
    solid::{Shape, Solid},
};
use std::f64::consts::{PI, TAU};

const SPACING: f32 = 0.001;
const TENSION: f64 = 0.072;
/// Radius in spacings. At 5 a wave is 12 % slower, and one of half the amplitude does not grow: the arrangement of the particles holds it.
const RADIUS: f64 = 7.0;
/// Amplitudes at the start and at the end, over the radius.
const START: f64 = 0.08;
const END: f64 = 0.25;

/// A wave on the cylinder.
struct Wave {
    /// Wavenumber times the radius.
    ka: f64,
    /// Amplitudes over the radius, every tenth of the capillary time √(ρ a³/σ).
    amplitudes: Vec<f64>,
}

impl Wave {
    /// Simulates a wave of about the wavenumber `ka` until it is large, for at most `tenths` of the capillary time.
    fn simulate(ka: f64, tenths: u32) -> Self {
        let length = (PI * RADIUS / ka).round();
        let k = PI / length;
        let x = cylinder(length, k);
        let radius = (x.len() as f64 / (PI * length)).sqrt();
        let height = length as f32 * SPACING;
        let text = format!(
            "spacing = {SPACING}\nkernel_radius = 2.5\nsurface_tension = {{ coefficient = {TENSION} }}\n\
             source = [{{ shape = {{ sphere = {{ center = [0.0, 0.0, {}], radius = {} }} }} }}]",
            0.5 * height,
            3.0 * SPACING
        );
        let params: LiquidParams = crate::from_toml(&text);
        let plane = |z: f32, normal: f32| {
            Solid::fixed(Shape::Plane { point: [0.0, 0.0, z], normal: [0.0, 0.0, normal] })
        };
        let world = World { gravity: Vec3::zeros(), solids: vec![plane(0.0, 1.0), plane(height, -1.0)] };
        let seeded =
            Simulation::new(world.clone(), Some(params.clone())).expect("the source holds particles");
        let resting = |x: Vec<Vec3>| {
            let frame = at_rest(&seeded.frame(FrameIndex(0)), x);
            Simulation::restore(world.clone(), Some(params.clone()), &frame).expect("the frame has a state")
        };
        // Particles leave the seeding lattice before the start.
        let time = (1000.0 * (radius * f64::from(SPACING)).powi(3) / TENSION).sqrt();
        let mut simulation = resting(x);
        for _ in 0..10 {
            simulation.advance(0.05 * time, &mut Unwatched).expect("it stays finite");
            simulation = resting(positions(&simulation));
        }
        // The volume within dz is π a² (1 + 2 ε cos kz) dz.
        let amplitude = |simulation: &Simulation| {
            let x = positions(simulation);
            x.iter().map(|x| (k * f64::from(x.z / SPACING)).cos()).sum::<f64>() / x.len() as f64
        };
        let mut amplitudes = vec![amplitude(&simulation)];
        for _ in 0..tenths {
            simulation.advance(0.1 * time, &mut Unwatched).expect("it stays finite");
            amplitudes.push(amplitude(&simulation));
            if amplitudes.last().is_some_and(|&last| last.abs() >= END) {
                break;
            }
        }
        Self { ka: k * radius, amplitudes }
    }

    /// Rate of growth γ times the capillary time: a wave that starts at rest grows with cosh γt.
    fn growth(&self) -> f64 {
        let reached = |&k: &usize| self.amplitudes[k].abs() >= END;
        let end = (1..self.amplitudes.len()).find(reached).expect("the wave grows");
        (self.amplitudes[end] / self.amplitudes[0]).abs().acosh() / (0.1 * end as f64)
    }
}

/// Particles of half a wave of `length` spacings, at random displacements from the seeding lattice.
fn cylinder(length: f64, k: f64) -> Vec<Vec3> {
    let random = |k: u32| f64::from(k.wrapping_mul(2_654_435_761) >> 16) / 65536.0 - 0.5;
    let reach = (1.2 * RADIUS) as i32 + 1;
    let mut x = Vec::new();
    for layer in 0..length as u32 {
        let z = f64::from(layer) + 0.5;
        let radius = RADIUS * (1.0 + START * (k * z).cos()) / (1.0 + 0.5 * START * START).sqrt();
        for column in (-reach..reach).flat_map(|i| (-reach..reach).map(move |j| [i, j])) {
            let [px, py] = column.map(|i| f64::from(i) + 0.5);
            if px.hypot(py) < radius {
                let id = 3 * x.len() as u32;
                let jitter = [0, 1, 2].map(|axis| 0.2 * random(id + axis));
                let at = [px + jitter[0], py + jitter[1], z + jitter[2]];
                x.push(Vec3::from(at.map(|at| at as f32)) * SPACING);
            }
        }
    }
    x
}

/// A frame of particles at rest; the energy at the start of the shot is large, so that it bounds nothing.
fn at_rest(frame: &Frame, x: Vec<Vec3>) -> Frame {
    let count = x.len();
    let mut stream = Stream::new("liquid", StreamKind::Particles, count)
        .with("position", x)
        .with("velocity", vec![Vec3::zeros(); count])
        .with("id", (0..count as u32).collect::<Vec<_>>());
    stream.scalars = frame.streams[0].scalars.clone();
    for (name, value) in &mut stream.scalars {
        if name == "first_energy" {
            *value = 1.0;
        }
    }
    Frame { streams: vec![stream], ..frame.clone() }
}

fn positions(simulation: &Simulation) -> Vec<Vec3> {
    simulation.frame(FrameIndex(0)).streams[0].vec3("position").expect("liquids have it").to_vec()
}

#[test]
#[ignore = "long: tools/soak/run"]
fn waves_on_a_cylinder_grow_as_in_rayleighs_theory() {
    let [b, c] = [0.7, 0.9].map(|ka| Wave::simulate(ka, 170)).map(|wave| [wave.ka, wave.growth()]);
    println!("ka and growth: {b:?} {c:?}");
    // The theory has 0.343 and 0.27; their ratio shifts with the fastest wave.
    assert!((0.27..0.36).contains(&b[1]), "{b:?}");
    assert!((0.6..0.85).contains(&(c[1] / b[1])), "{b:?}, {c:?}");
    if !crate::is_soak() {
        return;
    }
    let long = Wave::simulate(0.5, 170);
    let a = [long.ka, long.growth()];
    // The maximum of the parabola through the three.
    let slope = |p: [f64; 2], q: [f64; 2]| (q[1] - p[1]) / (q[0] - p[0]);
    let (left, right) = (slope(a, b), slope(b, c));
    let fastest = 0.5 * (a[0] + b[0]) + 0.5 * (c[0] - a[0]) * left / (left - right);
    let wavelength = TAU / fastest;
    println!("fastest: {wavelength:.2} radii");
    assert!((wavelength / 9.02 - 1.0).abs() < 0.2, "{wavelength} radii");
}

#[test]
#[ignore = "long: tools/soak/run"]
fn waves_shorter_than_the_circumference_of_a_cylinder_do_not_grow() {
    let wave = Wave::simulate(1.1, 60);
    let largest = wave.amplitudes.iter().fold(0.0_f64, |largest, amplitude| largest.max(amplitude.abs()));
    println!("largest {largest:.4} of {:.4}", wave.amplitudes[0]);
    assert!(largest < 1.1 * wave.amplitudes[0], "{:?}", wave.amplitudes);
    assert!(
        wave.amplitudes.last().is_some_and(|last| *last < 0.7 * wave.amplitudes[0]),
        "{:?}",
        wave.amplitudes
    );
}
