//! Couplings: conservation of momentum, no crossings, and independence of order, threads and restarts.

mod bodies;
mod bodies_liquid;
mod combined;
mod liquid;
mod smoke;

use meniscus::{
    frame::{Frame, FrameIndex},
    math::Vec3,
    sim::{
        FrameRecord, Simulation, Systems, Unwatched, World,
        coupling::Coupling,
        sheet::{SheetsParams, Shot},
    },
    solid::{Shape, Solid},
};
use serde::Deserialize;

const FRAME: f64 = 1.0 / 24.0;

type Double = nalgebra::Vector3<f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    liquid: Option<meniscus::sim::liquid::LiquidParams>,
    smoke: Option<meniscus::sim::smoke::SmokeParams>,
    #[serde(default)]
    sheet: Vec<meniscus::sim::sheet::SheetParams>,
    #[serde(default)]
    sheets: meniscus::sim::sheet::SheetsCommon,
    #[serde(default)]
    coupling: Vec<Coupling>,
}

/// The systems of a preset.
fn systems(text: &str) -> Systems {
    let Text { liquid, smoke, sheet, sheets, coupling } = crate::from_toml(text);
    let (fps, first) = (24.0, 1);
    let smoke = smoke.map(|params| meniscus::sim::smoke::Smoke { params, fps, first });
    let params = SheetsParams { sheet, common: sheets };
    let sheets = (!params.sheet.is_empty()).then_some(Shot { params, fps, first });
    Systems { liquid, smoke, sheets, couplings: coupling, ..Systems::default() }
}

fn world(gravity: f32, shapes: Vec<Shape>) -> World {
    World { gravity: Vec3::new(0.0, 0.0, -gravity), solids: shapes.into_iter().map(Solid::fixed).collect() }
}

fn simulation(world: World, text: &str) -> Simulation {
    Simulation::new(world, systems(text)).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn advance(simulation: &mut Simulation, frames: u32) -> Vec<FrameRecord> {
    (0..frames)
        .map(|k| simulation.advance(FRAME, &mut Unwatched).unwrap_or_else(|stop| panic!("frame {k}: {stop}")))
        .collect()
}

fn state(simulation: &Simulation) -> Frame {
    simulation.frame(FrameIndex(0))
}

fn channel(frame: &Frame, stream: &str, name: &str) -> Vec<Double> {
    let stream = frame.stream(stream).unwrap_or_else(|| panic!("there is a {stream}"));
    stream.vec3(name).expect("streams of points have it").iter().map(|x| x.cast()).collect()
}

/// Σ m v and Σ m x×v.
fn momenta(mass: impl Fn(usize) -> f64, x: &[Double], v: &[Double]) -> [Double; 2] {
    let each = x.iter().zip(v).enumerate();
    each.fold([Double::zeros(); 2], |[p, l], (i, (x, v))| [p + v * mass(i), l + x.cross(v) * mass(i)])
}

/// A sheet in the plane z = `height`, `side` [m] wide about the origin.
fn sheet(name: &str, side: f32, height: f32, cells: u32, terms: &str) -> String {
    let half = 0.5 * side;
    format!(
        "[[sheet]]\nname = '{name}'\nshape = {{ grid = {{ origin = [{}, {}, {height}], first = [{side}, 0, 0], \
         second = [0, {side}, 0], cells = [{cells}, {cells}] }} }}\n{terms}\n",
        -half, -half
    )
}

/// Indices of the points on the border of a grid.
fn border(cells: u32) -> Vec<u32> {
    let n = cells + 1;
    (0..n * n).filter(|i| i % n == 0 || i % n == cells || i / n == 0 || i / n == cells).collect()
}

/// Mass of a point of a square grid [kg].
fn point_mass(side: f64, cells: u32, density: f64) -> impl Fn(usize) -> f64 {
    let (n, cell) = (cells as usize + 1, side / f64::from(cells));
    move |i| {
        let half = |at: usize| if at == 0 || at == n - 1 { 0.5 } else { 1.0 };
        density * cell * cell * half(i % n) * half(i / n)
    }
}

fn block(min: [f32; 3], max: [f32; 3], velocity: [f32; 3]) -> String {
    format!(
        "[[liquid.source]]\nshape = {{ box = {{ min = {min:?}, max = {max:?} }} }}\nvelocity = {velocity:?}\n"
    )
}
