//! Sheets: closed forms, conservation, refinement, reproducibility, and extremes.

mod contact;
mod extremes;
mod hold;
mod keep;
mod material;
mod moving;
mod solids;
mod statics;

use meniscus::{
    math::Vec3,
    sim::{
        Diverged, Stop, Unwatched, World,
        sheet::{SheetError, SheetRecord, Sheets, SheetsParams, Shot},
    },
    solid::{Shape, Solid},
};

const FRAME: f64 = 1.0 / 24.0;

fn shot(text: &str) -> Shot {
    // Not by way of JSON, which has no NaN.
    let params: SheetsParams = toml::from_str(text).unwrap_or_else(|error| panic!("{error}\n{text}"));
    Shot { params, fps: 24.0, first: 1 }
}

fn world(gravity: f32, shapes: Vec<Shape>) -> World {
    World { gravity: Vec3::new(0.0, 0.0, -gravity), solids: shapes.into_iter().map(Solid::fixed).collect() }
}

fn sheets(text: &str, world: &World) -> Sheets {
    try_sheets(text, world).expect("the sheets are valid")
}

fn try_sheets(text: &str, world: &World) -> Result<Sheets, SheetError> {
    Sheets::new(shot(text), world)
}

/// A square of 1 m in the plane z = `height`, from the origin.
fn square(cells: [u32; 2], height: f32, terms: &str) -> String {
    grid([0.0, 0.0, height], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], cells, terms)
}

fn grid(origin: [f32; 3], first: [f32; 3], second: [f32; 3], cells: [u32; 2], terms: &str) -> String {
    format!(
        "[[sheet]]\nname = 'cloth'\nshape = {{ grid = {{ origin = {origin:?}, first = {first:?}, \
         second = {second:?}, cells = {cells:?} }} }}\n{terms}\n"
    )
}

fn run(sheets: &mut Sheets, from: u32, frames: u32) -> Result<Vec<SheetRecord>, Diverged> {
    run_at(sheets, from, frames, FRAME)
}

fn run_at(sheets: &mut Sheets, from: u32, frames: u32, frame: f64) -> Result<Vec<SheetRecord>, Diverged> {
    (from..from + frames)
        .map(|k| match sheets.advance(f64::from(k) * frame, frame, &mut Unwatched) {
            Ok((record, _)) => Ok(record),
            Err(Stop::Diverged(found)) => Err(found),
            Err(Stop::Interrupted) => unreachable!("this watch never interrupts"),
        })
        .collect()
}

/// The same sheets with other positions and velocities.
fn placed(text: &str, world: &World, change: impl Fn(usize, Vec3, Vec3) -> (Vec3, Vec3)) -> Sheets {
    placed_shot(&shot(text), world, change)
}

fn placed_shot(shot: &Shot, world: &World, change: impl Fn(usize, Vec3, Vec3) -> (Vec3, Vec3)) -> Sheets {
    let start = Sheets::new(shot.clone(), world).expect("the sheets are valid");
    let points = start.streams().into_iter().filter(|stream| stream.vec3("position").is_some());
    let streams = points.map(|stream| {
        let (x, v) = (stream.vec3("position").unwrap(), stream.vec3("velocity").unwrap());
        let both = x.iter().zip(v).enumerate().map(|(i, (x, v))| change(i, *x, *v));
        let (x, v): (Vec<Vec3>, Vec<Vec3>) = both.unzip();
        meniscus::frame::Stream::new(stream.name.clone(), stream.kind, x.len())
            .with("position", x)
            .with("velocity", v)
    });
    let streams: Vec<_> = streams.collect();
    Sheets::restore(shot.clone(), world, &streams, 0.0).expect("the streams are complete")
}

/// Σ m v and Σ m x × v, each with the sum of the magnitudes.
fn momenta(sheets: &Sheets) -> [(nalgebra::Vector3<f64>, f64); 2] {
    let (x, v) = (sheets.positions(), sheets.velocities());
    let mut out = [(nalgebra::Vector3::zeros(), 0.0); 2];
    for i in 0..sheets.len() {
        let p = v[i].cast::<f64>() * f64::from(sheets.mass(i));
        for (sum, part) in out.iter_mut().zip([p, x[i].cast::<f64>().cross(&p)]) {
            sum.0 += part;
            sum.1 += part.norm();
        }
    }
    out
}
