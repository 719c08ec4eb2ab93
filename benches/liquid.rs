//! Times the parts of the liquid solver on a dam break of 100 000 particles.
//!
//! `cargo bench --bench liquid`; `MENISCUS_THREADS=1` sets the threads. One iteration is the difference between
//! frames of 12 and of 2 iterations a substep, over their number.

use criterion::Criterion;
use meniscus::{
    frame::FrameIndex,
    math::Vec3,
    par,
    sim::{Simulation, Unwatched, World, liquid::LiquidParams},
    solid::{Shape, Solid},
    space::{CellGrid, Neighbours},
};
use std::{hint::black_box, time::Duration};

const SPACING: f32 = 0.0215;
const FRAME: f64 = 1.0 / 24.0;

fn world() -> World {
    let tank = Shape::Tank { min: [0.0; 3], max: [3.2, 1.0, 2.0] };
    World { gravity: Vec3::new(0.0, 0.0, -9.81), solids: vec![Solid::fixed(tank)] }
}

fn params(iterations: u32) -> LiquidParams {
    let text = format!(
        "spacing = {SPACING}\niterations = {iterations}\n\
         [[source]]\nshape = {{ box = {{ min = [0, 0, 0], max = [1, 1, 1] }} }}"
    );
    toml::from_str(&text).expect("the preset is valid")
}

/// The dam break after four frames, after it has left the seeding lattice.
fn broken() -> meniscus::frame::Frame {
    let mut simulation = Simulation::new(world(), Some(params(4))).expect("the sources hold particles");
    for _ in 0..4 {
        simulation.advance(FRAME, &mut Unwatched).expect("the dam break stays finite");
    }
    simulation.frame(FrameIndex(4))
}

fn main() {
    let threads = std::env::var("MENISCUS_THREADS").map_or(0, |n| n.parse().expect("a number of threads"));
    par::with_threads(threads, || {
        let mut criterion = Criterion::default().configure_from_args();
        liquid(&mut criterion);
        criterion.final_summary();
    });
}

fn liquid(criterion: &mut Criterion) {
    let start = broken();
    let positions = start.streams[0].vec3("position").expect("liquids have positions");
    let title = format!("{} particles, {} threads", positions.len(), par::threads());
    let mut group = criterion.benchmark_group(title);
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(5));
    let reach = 2.0 * SPACING;
    group.bench_function("sort into cells", |b| b.iter(|| black_box(CellGrid::new(positions, reach))));
    let grid = CellGrid::new(positions, reach);
    group.bench_function("list neighbours", |b| {
        b.iter(|| black_box(Neighbours::build(&grid, positions, reach)));
    });
    for iterations in [2, 12] {
        group.bench_function(format!("frame, {iterations} iterations a substep"), |b| {
            b.iter(|| {
                let mut simulation =
                    Simulation::restore(world(), Some(params(iterations)), &start).expect("it has a state");
                simulation.advance(FRAME, &mut Unwatched).expect("the dam break stays finite")
            });
        });
    }
    group.finish();
}
