//! Known errors of the liquid against closed forms, at three spacings: the tables of docs/liquid.md, "Known errors".
//! `cargo run --release --example known_errors -- [sloshing|jet|round|plate ...] [--finest N] [--terms TERMS]`; by default all
//! tables, `N` is 3, and `TERMS` are lines of `[liquid]` with `;` between them.
//!
//! *Sloshing*: a tank of 1 m with 0.5 m of water, eight spacings wide, in its first mode; the second period over that of linear
//! theory, ω² = g k tanh kH with k = π/L. *Jet*: water of 0.48 m flows out under a gate, through a slot of 0.08 m; its mean speed
//! between one and two slots behind the gate, from 0.5 s to 1 s, over √(2 g (H − t)), t the thickness of the jet (Torricelli and
//! hydrostatic pressure in the jet). *Round*: water at rest around a ball and a rod; particles within two spacings of the surface over
//! those that fill this shell at rest density. *Plate*: a plate between two bodies of water.

use meniscus::{
    frame::{Frame, FrameIndex, Stream},
    math::Vec3,
    sim::{Simulation, Unwatched, World, liquid::LiquidParams},
    solid::{Shape, Solid},
};
use std::{
    env,
    error::Error,
    f32::consts::PI,
    io::{Write, stdout},
};

const GRAVITY: f32 = 9.81;
const FRAME: f64 = 1.0 / 24.0;

fn main() -> Result<(), Box<dyn Error>> {
    let (mut finest, mut terms, mut tables) = (3_usize, String::new(), Vec::new());
    let mut arguments = env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--finest" => finest = arguments.next().ok_or("a value is missing")?.parse()?,
            "--terms" => terms = arguments.next().ok_or("a value is missing")?.replace(';', "\n"),
            table => tables.push(table.to_owned()),
        }
    }
    let wanted = |name: &str| tables.is_empty() || tables.iter().any(|table| table == name);
    if wanted("sloshing") {
        sloshing(finest, &terms)?;
    }
    if wanted("jet") {
        jet(finest, &terms)?;
    }
    if wanted("round") {
        round(finest, &terms)?;
    }
    if wanted("plate") {
        plate(finest, &terms)?;
    }
    Ok(())
}

/// Cell of a row, at once.
fn print(text: &str) -> Result<(), Box<dyn Error>> {
    print!("{text}");
    Ok(stdout().flush()?)
}

fn tank(max: [f32; 3]) -> World {
    let shape = Shape::Tank { min: [0.0; 3], max };
    World { gravity: Vec3::new(0.0, 0.0, -GRAVITY), solids: vec![Solid::fixed(shape)] }
}

fn liquid(spacing: f32, boxes: &[[[f32; 3]; 2]], terms: &str) -> Result<LiquidParams, Box<dyn Error>> {
    let source = |[min, max]: &[[f32; 3]; 2]| {
        format!("[[source]]\nshape = {{ box = {{ min = {min:?}, max = {max:?} }} }}\n")
    };
    let sources: String = boxes.iter().map(source).collect();
    Ok(toml::from_str(&format!("spacing = {spacing}\n{terms}\n{sources}"))?)
}

/// Positions and velocities.
fn particles(simulation: &Simulation) -> (Vec<Vec3>, Vec<Vec3>) {
    let frame = simulation.frame(FrameIndex(0));
    let column = |name| frame.streams[0].vec3(name).unwrap_or_default().to_vec();
    (column("position"), column("velocity"))
}

fn advance(simulation: &mut Simulation, frames: u32) -> Result<(), Box<dyn Error>> {
    for _ in 0..frames {
        simulation.advance(FRAME, &mut Unwatched)?;
    }
    Ok(())
}

fn mean(values: impl Iterator<Item = f32>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + f64::from(value), count + 1.0));
    sum / count
}

/// The frame with the velocities of `mode`, whose energy becomes the first.
fn in_motion(frame: &Frame, mode: impl Fn(&Vec3) -> Vec3, mass: f64) -> Frame {
    let still = &frame.streams[0];
    let x = still.vec3("position").unwrap_or_default();
    let v: Vec<Vec3> = x.iter().map(mode).collect();
    let energy = |(v, x): (&Vec3, &Vec3)| mass * f64::from(0.5 * v.norm_squared() + GRAVITY * x.z);
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

/// First mode of a tank of length 1 m along `axis`, with a largest speed of `speed` at the surface.
fn first_mode(x: &Vec3, axis: usize, depth: f32, speed: f32) -> Vec3 {
    let scale = speed / (PI * depth).cosh();
    let mut v = Vec3::z() * (-(PI * x[axis]).cos() * (PI * x.z).sinh() * scale);
    v[axis] = (PI * x[axis]).sin() * (PI * x.z).cosh() * scale;
    v
}

fn sloshing(finest: usize, terms: &str) -> Result<(), Box<dyn Error>> {
    println!("\nSloshing: period over that of linear theory\n");
    println!("| `kernel_radius` | wave height | {} |", spacings(&SLOSHING[..finest]));
    println!("|---|---|{}", "---|".repeat(finest));
    for radius in [2.0, 2.2, 2.5] {
        for speed in [0.2, 0.4, 0.7] {
            let omega = (PI * GRAVITY * (0.5 * PI).tanh()).sqrt();
            let height = 200.0 * speed * (0.5 * PI).tanh() / omega;
            print(&format!("| {radius} | {height:.0} cm |"))?;
            for spacing in &SLOSHING[..finest] {
                let terms = format!("kernel_radius = {radius}\n{terms}");
                print(&format!(" {:.3} |", period(*spacing, speed, &terms)?))?;
            }
            println!();
        }
    }
    Ok(())
}

const SLOSHING: [f32; 3] = [0.05, 0.025, 0.0125];
const JET: [f32; 3] = [0.02, 0.01, 0.005];

fn spacings(list: &[f32]) -> String {
    list.iter().map(|spacing| format!("{} cm", 100.0 * spacing)).collect::<Vec<_>>().join(" | ")
}

/// Second period of the first mode over 2π/ω, after a second at rest.
fn period(spacing: f32, speed: f32, terms: &str) -> Result<f64, Box<dyn Error>> {
    let (depth, width) = (0.5_f32, 8.0 * spacing);
    let params = liquid(spacing, &[[[0.0; 3], [1.0, width, depth]]], terms)?;
    let world = tank([1.0, width, 1.0]);
    let mut still = Simulation::new(world.clone(), Some(params.clone()))?;
    advance(&mut still, 24)?;
    let mass = f64::from(params.density) * f64::from(spacing).powi(3);
    let start = in_motion(&still.frame(FrameIndex(0)), |x| first_mode(x, 0, depth, speed), mass);
    let mut simulation = Simulation::restore(world, Some(params), &start)?;
    let (mut crossings, mut last) = (Vec::new(), 0.0);
    for frame in 1..=96 {
        advance(&mut simulation, 1)?;
        let now = mean(particles(&simulation).0.iter().map(|x| x.x)) - 0.5;
        if last * now < 0.0 {
            crossings.push((f64::from(frame) - now / (now - last)) * FRAME);
        }
        last = now;
    }
    let omega = f64::from(PI * GRAVITY * (PI * depth).tanh()).sqrt();
    let last = crossings.get(2).ok_or("the wave died within a period")?;
    Ok((last - crossings[0]) * omega / std::f64::consts::TAU)
}

fn jet(finest: usize, terms: &str) -> Result<(), Box<dyn Error>> {
    println!("\nJet out of a slot of 8 cm: speed over Torricelli's, discharge coefficient\n");
    println!("| terms | {} |", spacings(&JET[..finest]));
    println!("|---|{}", "---|".repeat(finest));
    for row in ["", "kernel_radius = 2.2", "implicitness = 1"] {
        print(&format!("| {} |", if row.is_empty() { "default" } else { row }))?;
        for spacing in &JET[..finest] {
            let (speed, discharge) = outflow(*spacing, &format!("{row}\n{terms}"))?;
            print(&format!(" {speed:.3}, {discharge:.2} |"))?;
        }
        println!();
    }
    Ok(())
}

/// Speed of the jet over √(2 g (H − t)), and its flow over that of the whole slot at √(2 g H).
fn outflow(spacing: f32, terms: &str) -> Result<(f64, f64), Box<dyn Error>> {
    let (length, depth, slot, thickness) = (1.2_f32, 0.48_f32, 0.08_f32, 0.08_f32);
    let width = 6.0 * spacing;
    let mut world = tank([length + 2.4, width, 1.0]);
    let gate = Shape::Box { min: [length, -1.0, slot], max: [length + thickness, 1.0, 1.2] };
    world.solids.push(Solid::fixed(gate));
    let params = liquid(spacing, &[[[0.0; 3], [length, width, depth]]], terms)?;
    let mut simulation = Simulation::new(world, Some(params))?;
    advance(&mut simulation, 12)?;
    let (mut speed, mut discharge) = (0.0, 0.0);
    for _ in 0..12 {
        advance(&mut simulation, 1)?;
        let (x, v) = particles(&simulation);
        let area = f64::from(spacing).powi(3) / f64::from(width);
        let level = x.iter().filter(|x| x.x < length).count() as f64 * area / f64::from(length);
        let probe = length + thickness + slot;
        let jet = || x.iter().zip(&v).filter(|(x, _)| (probe..probe + slot).contains(&x.x));
        let (mean, height) = (mean(jet().map(|(_, v)| v.x)), jet().count() as f64 * area / f64::from(slot));
        let fall = |height: f64| (2.0 * f64::from(GRAVITY) * height).sqrt();
        speed += mean / fall(level - height) / 12.0;
        discharge += mean * height / (f64::from(slot) * fall(level)) / 12.0;
    }
    Ok((speed, discharge))
}

fn round(finest: usize, terms: &str) -> Result<(), Box<dyn Error>> {
    println!(
        "\nWater around round solids: particles within two spacings of the surface over those at rest\n"
    );
    println!("| solid | {} |", spacings(&SLOSHING[..finest]));
    println!("|---|{}", "---|".repeat(finest));
    for (name, is_rod) in [("ball of 10 cm", false), ("rod of 10 cm", true)] {
        print(&format!("| {name} |"))?;
        for &spacing in &SLOSHING[..finest] {
            print(&format!(" {:.3} |", crowding(spacing, is_rod, terms)?))?;
        }
        println!();
    }
    Ok(())
}

/// Particles in the first two spacings around a ball or a rod of 0.1 m in a tank, over those that fill it.
fn crowding(spacing: f32, is_rod: bool, terms: &str) -> Result<f64, Box<dyn Error>> {
    let (radius, side, depth) = (0.1_f32, 0.6_f32, 0.6_f32);
    let mut world = tank([side, side, 1.0]);
    let center = [0.5 * side, 0.5 * side, 0.5 * depth];
    let ball = Shape::Sphere { center, radius };
    let rod = Shape::Capsule { from: [center[0], -1.0, center[2]], to: [center[0], 2.0, center[2]], radius };
    let shape = if is_rod { rod } else { ball };
    world.solids.push(Solid::fixed(shape.clone()));
    let params = liquid(spacing, &[[[0.0; 3], [side, side, depth]]], terms)?;
    let mut simulation = Simulation::new(world, Some(params))?;
    advance(&mut simulation, 24)?;
    let mut count = 0;
    for _ in 0..8 {
        advance(&mut simulation, 1)?;
        let (x, _) = particles(&simulation);
        // Away from the ends of the rod.
        let counts = |x: &&Vec3| !is_rod || (x.y - 0.5 * side).abs() < 0.2;
        count += x.iter().filter(counts).filter(|x| shape.signed_distance(**x) < 2.0 * spacing).count();
    }
    let outer = radius + 2.0 * spacing;
    let volume = if is_rod {
        0.4 * PI * (outer.powi(2) - radius.powi(2))
    } else {
        4.0 / 3.0 * PI * (outer.powi(3) - radius.powi(3))
    };
    Ok(f64::from(count as f32 / 8.0) / f64::from(volume / spacing.powi(3)))
}

fn plate(finest: usize, terms: &str) -> Result<(), Box<dyn Error>> {
    println!(
        "\nPlate between two bodies of water, XSPH 0.05: what a still one gains of the energy of a sloshing one in 1 s\n"
    );
    println!("| thickness in spacings | {} |", spacings(&SLOSHING[..finest]));
    println!("|---|{}", "---|".repeat(finest));
    let thicknesses = [0.25, 0.5, 0.75, 1.0, 2.0];
    for thickness in thicknesses {
        print(&format!("| {thickness} |"))?;
        for &spacing in &SLOSHING[..finest] {
            print(&format!(" {:.4} |", transfer(spacing, thickness * spacing, terms)?))?;
        }
        println!();
    }
    println!(
        "\nParticles in the first spacing at the plate over those at the opposite wall, water at rest\n"
    );
    println!("| thickness in spacings | water on both sides | on one side |");
    println!("|---|---|---|");
    for thickness in thicknesses {
        let both = layer(0.025, thickness * 0.025, true, terms)?;
        let one = layer(0.025, thickness * 0.025, false, terms)?;
        println!("| {thickness} | {both:.3} | {one:.3} |");
    }
    Ok(())
}

/// Water of 1 m along y on both sides of a plate or on one, eight spacings wide each, and where the plate begins.
fn divided(
    spacing: f32,
    thickness: f32,
    depths: [f32; 2],
    terms: &str,
) -> Result<(World, LiquidParams, f32), Box<dyn Error>> {
    let width = 8.0 * spacing;
    let mut world = tank([2.0 * width + thickness, 1.0, 1.0]);
    let plate = Shape::Box { min: [width, -1.0, -1.0], max: [width + thickness, 2.0, 2.0] };
    world.solids.push(Solid::fixed(plate));
    let boxes = [
        [[0.0; 3], [width, 1.0, depths[0]]],
        [[width + thickness, 0.0, 0.0], [2.0 * width + thickness, 1.0, depths[1]]],
    ];
    let count = if depths[1] > 0.0 { 2 } else { 1 };
    Ok((world, liquid(spacing, &boxes[..count], terms)?, width))
}

/// Largest kinetic energy of the still water over the first of the water that sloshes.
fn transfer(spacing: f32, thickness: f32, terms: &str) -> Result<f64, Box<dyn Error>> {
    let terms = format!("xsph.strength = 0.05\n{terms}");
    let (world, params, width) = divided(spacing, thickness, [0.3; 2], &terms)?;
    let mut still = Simulation::new(world.clone(), Some(params.clone()))?;
    advance(&mut still, 24)?;
    let mass = f64::from(params.density) * f64::from(spacing).powi(3);
    let mode = |x: &Vec3| if x.x < width { first_mode(x, 1, 0.3, 0.5) } else { Vec3::zeros() };
    let start = in_motion(&still.frame(FrameIndex(0)), mode, mass);
    let mut simulation = Simulation::restore(world, Some(params), &start)?;
    let energy = |simulation: &Simulation, is_moving: bool| -> f64 {
        let (x, v) = particles(simulation);
        let own = x.iter().zip(&v).filter(|(x, _)| (x.x < width) == is_moving);
        own.map(|(_, v)| f64::from(v.norm_squared())).sum()
    };
    let (first, mut largest) = (energy(&simulation, true), 0.0_f64);
    for _ in 0..24 {
        advance(&mut simulation, 1)?;
        largest = largest.max(energy(&simulation, false));
    }
    Ok(largest / first)
}

/// Particles within a spacing of the plate over those within one of the opposite wall, below 0.2 m.
fn layer(spacing: f32, thickness: f32, both: bool, terms: &str) -> Result<f64, Box<dyn Error>> {
    let (world, params, width) = divided(spacing, thickness, [0.4, if both { 0.2 } else { 0.0 }], terms)?;
    let mut simulation = Simulation::new(world, Some(params))?;
    advance(&mut simulation, 24)?;
    let mut counts = [0; 2];
    for _ in 0..12 {
        advance(&mut simulation, 1)?;
        for x in particles(&simulation).0.iter().filter(|x| x.z < 0.2) {
            counts[0] += u32::from(x.x < width && width - x.x < spacing);
            counts[1] += u32::from(x.x < spacing);
        }
    }
    Ok(f64::from(counts[0]) / f64::from(counts[1]))
}
