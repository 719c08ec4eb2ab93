//! Vortons in motion: closed forms, orders of convergence, what is kept, and limits.

mod extremes;
mod grid;
mod invariants;
mod remeshing;
mod rings;
mod sphere;
mod viscosity;

use meniscus::{
    math::Vec3,
    sim::{
        Unwatched,
        vortex::{
            Method, OutOfRange, Quantity, Targets, Vortons,
            flow::{
                ExternalEffects, Flow, FlowParams, FlowReport, Medium, NoExternalEffects, Rates, Stage,
                SubstepLimits, Sum,
            },
            induced,
        },
    },
};
use nalgebra::Vector3;
use std::f64::consts::PI;

/// A number in 0..1 without order in `i`.
fn noise(i: usize) -> f64 {
    let mut x = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// Sums over all pairs, so that what is measured is the motion and not the tree.
fn direct() -> FlowParams {
    FlowParams { sum: Sum::Direct, ..FlowParams::default() }
}

fn flow(params: FlowParams, vortons: &Vortons, volume: f32) -> Flow {
    let mut flow = Flow::new(params);
    flow.add(vortons, &vec![volume; vortons.len()]);
    flow
}

/// Advances without anything outside.
fn advance(flow: &mut Flow, seconds: f64) -> FlowReport {
    flow.advance(seconds, &mut [], &mut NoExternalEffects, &mut Unwatched).unwrap()
}

/// A ring about the z axis, one line of vortons.
fn ring(count: usize, radius: f64, z: f64, circulation: f64, core: f64) -> Vortons {
    let mut ring = Vortons { core: vec![core as f32; count], ..Vortons::default() };
    for i in 0..count {
        let t = 2.0 * PI * i as f64 / count as f64;
        ring.position.push(Vector3::new(radius * t.cos(), radius * t.sin(), z).cast());
        let length = circulation * 2.0 * PI * radius / count as f64;
        ring.strength.push((Vector3::new(-t.sin(), t.cos(), 0.0) * length).cast());
    }
    ring
}

/// The vortons of both.
fn joined(mut a: Vortons, b: &Vortons) -> Vortons {
    a.position.extend(&b.position);
    a.strength.extend(&b.strength);
    a.core.extend(&b.core);
    a
}

/// Where the impulse along z is: Σ z (x × Γ)_z / Σ (x × Γ)_z.
fn center(vortons: &Vortons) -> f64 {
    let (mut moment, mut whole) = (0.0, 0.0);
    for (x, g) in vortons.position.iter().zip(&vortons.strength) {
        let impulse = x.cast::<f64>().cross(&g.cast()).z;
        moment += f64::from(x.z) * impulse;
        whole += impulse;
    }
    moment / whole
}

/// Vortons on a seeding lattice of `spacing` in a box of ± `half`, of the vorticity `omega` at each node; all-zero ones too.
fn seeding_lattice(
    spacing: f64,
    half: [f64; 3],
    core: f64,
    omega: impl Fn(Vector3<f64>) -> Vector3<f64>,
) -> Vortons {
    let counts = half.map(|h| (h / spacing).round() as i32);
    let mut vortons = Vortons::default();
    for k in -counts[2]..=counts[2] {
        for j in -counts[1]..=counts[1] {
            for i in -counts[0]..=counts[0] {
                let x = Vector3::new(i, j, k).map(f64::from) * spacing;
                vortons.position.push(x.cast());
                vortons.strength.push((omega(x) * spacing.powi(3)).cast());
                vortons.core.push(core as f32);
            }
        }
    }
    vortons
}

/// A cloud in a cube of 1 m with strengths of all directions and overlapping cores.
fn cloud(count: usize) -> Vortons {
    let mut vortons = Vortons::default();
    for i in 0..count {
        let r = |k: usize| noise(16 * i + k) as f32;
        vortons.position.push(Vec3::new(r(0), r(1), r(2)));
        vortons.strength.push(Vec3::new(r(3) - 0.5, r(4) - 0.5, r(5) - 0.5) / count as f32);
        vortons.core.push(1.5 * (count as f32).cbrt().recip());
    }
    vortons
}

fn is_finite(flow: &Flow) -> bool {
    let vectors = flow.vortons.position.iter().chain(&flow.vortons.strength);
    vectors.flatten().all(|c| c.is_finite()) && flow.vortons.core.iter().all(|c| c.is_finite())
}
