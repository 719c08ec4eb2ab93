//! Wall time of the Eikonal sweeps against the size of blocks, on one and on two threads. `cargo bench --bench eikonal_blocks`.
//!
//! *Case*: first-order solves of every node about seven balls, on a dense grid of 256³ nodes and on bricks of 128³, from an exact
//! band of three voxels. Wall times are the smallest of nine repetitions; one and two threads alternate.
//!
//! *Scheduling* is the time of as many wavefronts over the same blocks that do nothing. *Model*: all blocks cost the same, and
//! P threads take those of one diagonal plane after the other, so the efficiency is N / (P Σ ⌈n/P⌉) of N blocks with n in a plane.

#[path = "reference/balls.rs"]
mod balls;
#[allow(dead_code, reason = "this bench needs the grid and its pinned band alone")]
#[path = "reference/dense.rs"]
mod dense;

use balls::seven_balls;
use dense::{DenseGrid, pin_band};
use meniscus::{
    grid::{BRICK, BRICK_NODES, Bricks, node_of},
    par,
    sdf::{
        self, Swept,
        dense::{BLOCK, Layout, sweep},
    },
};
use std::{hint::black_box, time::Instant};

const REPETITIONS: usize = 9;
const FULL: f32 = f32::INFINITY;

/// Smallest wall seconds of `run` on one and on two threads, and what it returned.
fn wall_seconds<T: Send>(run: impl Fn() -> T + Sync) -> ([f64; 2], T) {
    let mut best = [f64::INFINITY; 2];
    let mut found = None;
    for _ in 0..REPETITIONS {
        for threads in [1, 2] {
            let (seconds, out) = par::with_threads(threads, || {
                let start = Instant::now();
                let out = black_box(run());
                (start.elapsed().as_secs_f64(), out)
            });
            best[threads - 1] = best[threads - 1].min(seconds);
            found = Some(out);
        }
    }
    (best, found.expect("it ran"))
}

/// Part of the time for which `threads` threads have work.
fn model_efficiency(layout: &Layout, threads: usize) -> f64 {
    let size = layout.size(0);
    let mut planes = Vec::new();
    for block in 0..layout.block_count() {
        let first = layout.first(block);
        let plane: usize = (0..3).map(|axis| first[axis] / size[axis]).sum();
        planes.resize(planes.len().max(plane + 1), 0_usize);
        planes[plane] += 1;
    }
    let steps: usize = planes.iter().map(|count| count.div_ceil(threads)).sum();
    layout.block_count() as f64 / (threads * steps) as f64
}

/// Prints a row for a solve whose blocks are those of `layout`.
fn row(name: &str, block: [usize; 3], layout: &Layout, solve: impl Fn() -> Swept + Sync) {
    let ([one, two], swept) = wall_seconds(solve);
    let ([idle_one, idle_two], ()) =
        wall_seconds(|| (0..swept.sweeps).for_each(|_| layout.wavefront([1; 3], |_| ())));
    let milliseconds = |seconds: f64| seconds * 1e3;
    let [x, y, z] = block;
    print!("| {name} | {x} × {y} × {z} | {} ", layout.block_count());
    print!(
        "| {:.0} | {:.0} | {:.2} | {:.0} % ",
        milliseconds(one),
        milliseconds(two),
        one / two,
        50.0 * one / two
    );
    print!("| {:.1} | {:.1} ", milliseconds(idle_one), milliseconds(idle_two));
    let efficiency =
        [2, 4, 8, 16].map(|threads| format!("{:.0} %", 100.0 * model_efficiency(layout, threads)));
    println!("| {} |", efficiency.join(" | "));
}

fn main() {
    println!(
        "| solver | block | blocks | 1 thread [ms] | 2 threads [ms] | speed-up | efficiency | scheduling, 1 [ms] | scheduling, 2 [ms] | model, 2 | 4 | 8 | 16 |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    let nodes = 256;
    let level =
        DenseGrid::sample(1.0, [-(nodes / 2); 3], [nodes as usize; 3], |x| seven_balls(x, nodes as usize));
    let pins = pin_band(&level, 3.0);
    for block in [[8; 3], [16; 3], [32, 16, 16], BLOCK, [128, 16, 16], [32; 3], [64; 3], [128; 3]] {
        let layout = Layout::new(level.nodes, block);
        row("dense", block, &layout, || sweep(level.nodes, &pins.distance, FULL, block));
    }

    let side = 128 / BRICK as i32;
    let coord = |i: i32| [i % side, i / side % side, i / (side * side)].map(|c| c - side / 2);
    let bricks = Bricks::new((0..side.pow(3)).map(coord).collect());
    let mut seeds = vec![FULL; bricks.len() * BRICK_NODES];
    par::fill(&mut seeds, |slot| {
        let node = node_of(bricks.coords()[slot / BRICK_NODES], slot % BRICK_NODES);
        let distance = seven_balls(node.map(|c| c as f32).into(), 128).abs();
        if distance < 3.0 { -distance.max(1e-6) } else { FULL }
    });
    for edge in [1, 2, 4, 8, 16] {
        let block = [edge * BRICK; 3];
        let layout = Layout::new([128; 3], block);
        row("bricks", block, &layout, || sdf::sweep(&bricks, &seeds, FULL, edge));
    }
}
