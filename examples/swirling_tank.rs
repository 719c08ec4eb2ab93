//! What eddies in a tank keep, by the terms of `[liquid]`: the table of docs/decisions/021-micropolar.md.
//! `cargo run --release --example swirling_tank -- [--seconds 3] [--spacing 0.02] [NAME=TERMS ...]`, where `TERMS` are lines of
//! `[liquid]` with `;` between them.
//!
//! A square tank of 0.6 m with 0.48 m of water, at rest for half a second; then it gets the velocity of one eddy or of four,
//! U (sin kx cos ky, −cos kx sin ky, 0), a steady flow of a liquid without viscosity. *Eddy* is the energy of the motion
//! along that velocity; *enstrophy* is Σ |∇×v|², with gradients by least squares over four spacings, which the jitter of single
//! particles hardly enters; these, the kinetic energy and the angular momentum about the tank's axis are fractions of their first values.
//! *Spin* is the energy of the microrotation over the first kinetic energy; *bound*, the share of substeps in which a bound
//! reduced the term or the velocities.

use meniscus::{
    frame::{Frame, FrameIndex, Stream},
    math::Vec3,
    par,
    sim::{Simulation, Unwatched, World, liquid::LiquidParams},
    solid::{Shape, Solid},
    space::CellGrid,
};
use std::{env, error::Error, f32::consts::PI};

const SIDE: f32 = 0.6;
const DEPTH: f32 = 0.48;
const FRAME: f64 = 1.0 / 24.0;
const GRAVITY: f64 = 9.81;
/// Frames at rest before the start: particles leave the seeding lattice.
const SETTLING: u32 = 12;
/// Largest speed at the start [m/s].
const SPEED: f32 = 1.0;

const ROWS: [(&str, &str); 8] = [
    ("none", ""),
    ("XSPH 0.01", "xsph.strength = 0.01"),
    ("confinement 0.5", "vorticity.strength = 0.5"),
    ("confinement 0.5, XSPH 0.01 (presets)", "vorticity.strength = 0.5\nxsph.strength = 0.01"),
    ("micropolar 0.25", "micropolar.transfer = 0.25"),
    ("micropolar 0.5", "micropolar.transfer = 0.5"),
    ("micropolar 1", "micropolar.transfer = 1"),
    ("micropolar 0.5, XSPH 0.01", "micropolar.transfer = 0.5\nxsph.strength = 0.01"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let (mut seconds, mut spacing, mut rows) = (3_u32, 0.02_f32, Vec::new());
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or("a value is missing");
        match argument.as_str() {
            "--seconds" => seconds = value()?.parse()?,
            "--spacing" => spacing = value()?.parse()?,
            _ => {
                let (name, terms) =
                    argument.split_once('=').ok_or("a row is NAME=TERMS, with ; between terms")?;
                rows.push((name.to_owned(), terms.replace(';', "\n")));
            }
        }
    }
    if rows.is_empty() {
        rows = ROWS.map(|(name, terms)| (name.into(), terms.into())).into();
    }
    let mut settled = Simulation::new(world(), Some(liquid("", spacing)?))?;
    for _ in 0..SETTLING {
        settled.advance(FRAME, &mut Unwatched)?;
    }
    let settled = settled.frame(FrameIndex(0));
    for eddies in [1, 2] {
        println!("\n{} in the tank, {spacing} m\n", if eddies == 1 { "One eddy" } else { "Four eddies" });
        println!(
            "| terms | seconds | kinetic | eddy | enstrophy | angular momentum | spin | bound | ns a particle and substep | of them the terms |"
        );
        println!("|---|---|---|---|---|---|---|---|---|---|");
        for (name, terms) in &rows {
            run(name, liquid(terms, spacing)?, &settled, eddies, seconds)?;
        }
    }
    Ok(())
}

/// Velocity at the start.
fn eddy(x: Vec3, eddies: u32) -> Vec3 {
    let k = PI * eddies as f32 / SIDE;
    Vec3::new((k * x.x).sin() * (k * x.y).cos(), -(k * x.x).cos() * (k * x.y).sin(), 0.0) * SPEED
}

fn world() -> World {
    let tank = Shape::Tank { min: [0.0; 3], max: [SIDE, SIDE, 2.0 * DEPTH] };
    World { gravity: Vec3::new(0.0, 0.0, -GRAVITY as f32), solids: vec![Solid::fixed(tank)] }
}

fn liquid(terms: &str, spacing: f32) -> Result<LiquidParams, toml::de::Error> {
    toml::from_str(&format!(
        "spacing = {spacing}\n{terms}\n[[source]]\nshape = {{ box = {{ min = [0, 0, 0], max = [{SIDE}, {SIDE}, {DEPTH}] }} }}"
    ))
}

/// Prints the rows of the terms of `params`, one a second.
fn run(
    name: &str,
    params: LiquidParams,
    settled: &Frame,
    eddies: u32,
    seconds: u32,
) -> Result<(), Box<dyn Error>> {
    let spacing = params.spacing;
    let mass = f64::from(params.density) * f64::from(spacing).powi(3);
    let mut start = swirling(settled, eddies, mass);
    if params.micropolar.is_some() {
        let stream = start.streams.remove(0);
        let zero = vec![Vec3::zeros(); stream.len()];
        start.streams.push(stream.with("microrotation", zero));
    }
    let mut simulation = Simulation::restore(world(), Some(params), &start)?;
    let first = Figures::of(&simulation, eddies, spacing);
    let (mut nanoseconds, mut own, mut substeps, mut bounded) = (0.0, 0.0, 0.0, 0);
    for frame in 1..=24 * seconds {
        let record = simulation.advance(FRAME, &mut Unwatched)?;
        let liquid = record.liquid.ok_or("there is a liquid")?;
        substeps += f64::from(liquid.substeps);
        bounded += liquid.clamps.energy + liquid.clamps.confinement + liquid.clamps.micropolar;
        for (pass, seconds) in &record.seconds {
            nanoseconds += 1e9 * seconds;
            if ["vorticity", "micropolar", "xsph"].contains(&pass.as_ref()) {
                own += 1e9 * seconds;
            }
        }
        if frame % 24 == 0 {
            let now = Figures::of(&simulation, eddies, spacing);
            let per = 1.0 / (substeps * now.count);
            println!(
                "| {name} | {} | {:.3} | {:.3} | {:.3} | {} | {:.4} | {:.0} % | {:.0} | {:.0} |",
                frame / 24,
                now.kinetic / first.kinetic,
                (now.mode / first.mode).powi(2),
                now.enstrophy / first.enstrophy,
                if eddies == 1 { format!("{:.3}", now.angular / first.angular) } else { "–".into() },
                liquid.microrotation_energy / (mass * first.kinetic),
                100.0 * bounded as f64 / substeps,
                nanoseconds * per,
                own * per,
            );
        }
    }
    Ok(())
}

/// The frame with the velocity of the eddies, and with its energy as the first.
fn swirling(frame: &Frame, eddies: u32, mass: f64) -> Frame {
    let still = &frame.streams[0];
    let x = still.vec3("position").unwrap_or_default();
    let v: Vec<Vec3> = x.iter().map(|&x| eddy(x, eddies)).collect();
    let energy =
        |(v, x): (&Vec3, &Vec3)| mass * (0.5 * f64::from(v.norm_squared()) + GRAVITY * f64::from(x.z));
    let first_energy = v.iter().zip(x).map(energy).sum::<f64>();
    let mut stream = Stream::new(&still.name, still.kind, still.len());
    for channel in still.channels() {
        let data = if channel.name == "velocity" { v.clone().into() } else { channel.data.clone() };
        stream = stream.with(&channel.name, data);
    }
    stream.scalars = still.scalars.clone();
    for (name, value) in &mut stream.scalars {
        if name == "first_energy" {
            *value = first_energy;
        }
    }
    Frame { streams: vec![stream], ..frame.clone() }
}

/// Sums over the particles.
struct Figures {
    count: f64,
    /// Σ v²/2 [m²/s²].
    kinetic: f64,
    /// Σ v·v₀ [m²/s²].
    mode: f64,
    /// Σ |∇×v|² [1/s²].
    enstrophy: f64,
    /// Σ x v_y − y v_x about the tank's axis [m²/s].
    angular: f64,
}

impl Figures {
    fn of(simulation: &Simulation, eddies: u32, spacing: f32) -> Self {
        let frame = simulation.frame(FrameIndex(0));
        let column = |name| frame.streams[0].vec3(name).unwrap_or_default();
        let (x, v) = (column("position"), column("velocity"));
        let grid = CellGrid::new(x, 4.0 * spacing);
        let middle = 0.5 * SIDE;
        let sum = |f: &(dyn Fn(usize) -> f32 + Sync)| par::sum(x.len(), |i| f64::from(f(i)));
        Self {
            count: x.len() as f64,
            kinetic: sum(&|i| 0.5 * v[i].norm_squared()),
            mode: sum(&|i| v[i].dot(&eddy(x[i], eddies))),
            enstrophy: sum(&|i| curl(&grid, x, v, i, 4.0 * spacing).norm_squared()),
            angular: sum(&|i| (x[i].x - middle) * v[i].y - (x[i].y - middle) * v[i].x),
        }
    }
}

/// ∇×v by least squares over the particles within `radius` [1/s].
fn curl(grid: &CellGrid, x: &[Vec3], v: &[Vec3], i: usize, radius: f32) -> Vec3 {
    let (mut moments, mut products) = (nalgebra::Matrix3::zeros(), nalgebra::Matrix3::zeros());
    grid.for_each_within(x, x[i], radius, |j, r2| {
        let weight = (1.0 - r2 / (radius * radius)).powi(2);
        let d = (x[j] - x[i]) / radius;
        moments += d * d.transpose() * weight;
        products += (v[j] - v[i]) * d.transpose() * weight;
    });
    let Some(inverse) = moments.try_inverse().filter(|_| moments.determinant() > 1e-4) else {
        return Vec3::zeros();
    };
    let gradient = products * inverse / radius;
    Vec3::new(
        gradient[(2, 1)] - gradient[(1, 2)],
        gradient[(0, 2)] - gradient[(2, 0)],
        gradient[(1, 0)] - gradient[(0, 1)],
    )
}
