//! Times sheets: the step of a grid with structural springs, points from 1e3 to 1e6, and the implicit step.
//!
//! `cargo bench --bench sheet`; `MENISCUS_THREADS=1` sets the threads. A frame here is one substep.

use criterion::{Criterion, Throughput};
use meniscus::{
    math::Vec3,
    par,
    sim::{
        World,
        sheet::{Sheets, Shot},
    },
};
use std::time::Duration;

/// A square of `side`² points with corners held, after some substeps.
fn sheets(side: u32, terms: &str) -> Sheets {
    let text = format!(
        "[[sheet]]\nname = 'cloth'\ndensity = 0.2\nstiffness = [50.0, 50.0]\npin = [{{ at = 'corners' }}]\n\
         shape = {{ grid = {{ origin = [0, 0, 0], first = [1, 0, 0], second = [0, 1, 0], cells = [{n}, {n}] }} }}\n{terms}",
        n = side - 1
    );
    let params = toml::from_str(&text).expect("the preset is valid");
    let world = World { gravity: Vec3::new(0.0, 0.0, -9.81), solids: Vec::new() };
    Sheets::new(Shot { params, fps: 24.0, first: 1 }, &world).expect("the preset has a meaning")
}

fn main() {
    let threads = std::env::var("MENISCUS_THREADS").map_or(0, |n| n.parse().expect("a number of threads"));
    par::with_threads(threads, || {
        let mut criterion = Criterion::default().configure_from_args();
        steps(&mut criterion);
        criterion.final_summary();
    });
}

fn steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group(format!("sheets, {} threads", par::threads()));
    group.sample_size(10).warm_up_time(Duration::from_millis(500)).measurement_time(Duration::from_secs(3));
    for (name, terms) in [("structural", ""), ("shear and bending", "shear = 20.0\nbending = 1e-5")] {
        for side in [32, 100, 316, 1000] {
            let mut sheets = sheets(side, terms);
            let dt = 0.4 * sheets.longest_stable();
            let springs = 2 * u64::from(side) * u64::from(side - 1);
            group.throughput(Throughput::Elements(springs));
            group.bench_function(format!("{name}, {side}² points, springs a step"), |b| {
                b.iter(|| sheets.step(0.0, dt).expect("it is stable"));
            });
        }
    }
    let mut sheets = sheets(316, "[sheets.solver]\nintegrator = \"implicit\"\nsubsteps = 1");
    group.bench_function("implicit, 316² points", |b| {
        b.iter(|| sheets.step(0.0, 1.0 / 192.0).expect("it is stable"));
    });
    group.finish();
}
