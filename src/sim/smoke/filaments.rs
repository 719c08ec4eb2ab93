//! Vortons and tracers of rings and tubes.
//!
//! *Method*: a bundle of thin lines fills the core: the middle one, and circles of 6, 12, 18 … lines one distance apart. Each
//! carries the circulation of its part of a Gaussian core ω = Γ_c/(πa²) e^(−r²/a²), [winckelmans93], cut off at 2a and scaled so that
//! the lines sum to Γ_c exactly; each is cut into pieces of about one distance, Γ = Γ_line · Δs along the line.
//!
//! Symbols: Γ_c → `circulation` [m²/s], a → `thickness` [m], R → `radius` [m].

use super::{
    params::{Ring, Tube},
    tracers::Seeds,
};
use crate::{
    math::{Random, Vec3},
    sim::vortex::Vortons,
};
use std::f32::consts::{PI, TAU};

/// Waves along a ring that wobbles: what rings of the usual thickness break up into.
const WAVES: f32 = 7.0;

/// Where the vorticity ends, in core radii: e⁻⁴ of the middle's is left.
const CUT: f32 = 2.0;

/// A line of a bundle: where it passes through the cross-section [m], and its part of the area.
struct Line {
    offset: [f32; 2],
    area: f32,
}

/// Lines about `distance` apart that fill a disc of `radius`; at least the middle one.
fn bundle(radius: f32, distance: f32) -> Vec<Line> {
    let circles = (radius / distance - 0.5).round().max(0.0) as usize;
    let distance = radius / (circles as f32 + 0.5);
    let mut lines = vec![Line { offset: [0.0; 2], area: PI * (0.5 * distance).powi(2) }];
    for circle in 1..=circles {
        let (r, count) = (circle as f32 * distance, 6 * circle);
        let area = TAU * r * distance / count as f32;
        lines.extend((0..count).map(|k| {
            // Circles are turned against each other, so that lines do not stand in rows.
            let angle = TAU * (k as f32 + 0.5 * (circle % 2) as f32) / count as f32;
            Line { offset: [r * angle.cos(), r * angle.sin()], area }
        }));
    }
    lines
}

/// The lines of a core with their parts of its circulation, which sum to one.
fn shares(thickness: f32, spacing: f32) -> Vec<(Line, f32)> {
    let lines = bundle(CUT * thickness, spacing);
    let weight = |line: &Line| {
        let r2 = line.offset[0].powi(2) + line.offset[1].powi(2);
        f64::from(line.area) * f64::from(-r2 / thickness.powi(2)).exp()
    };
    let sum: f64 = lines.iter().map(weight).sum();
    lines
        .into_iter()
        .map(|line| {
            let share = (weight(&line) / sum) as f32;
            (line, share)
        })
        .collect()
}

/// A curve with a cross-section: where a point of it is, and the way along it [m per turn, or m].
struct Path<'a> {
    /// At the part `t` of the curve, 0 to 1, at an offset in the cross-section: position, and its derivative by t.
    at: &'a (dyn Fn(f32, [f32; 2]) -> (Vec3, Vec3) + Sync),
    /// Length of the middle line [m].
    length: f32,
}

/// Adds the vortons of a core along `path`.
fn add_vortons(path: &Path, thickness: f32, circulation: f32, spacing: f32, core: f32, out: &mut Vortons) {
    let pieces = (path.length / spacing).ceil().max(4.0) as usize;
    for (line, share) in shares(thickness, spacing) {
        for piece in 0..pieces {
            let (x, along) = (path.at)((piece as f32 + 0.5) / pieces as f32, line.offset);
            out.position.push(x);
            out.strength.push(along * (circulation * share / pieces as f32));
            out.core.push(core);
        }
    }
}

/// Adds the tracers that fill a core along `path`, each moved by up to half a distance so that no pattern shows.
fn add_tracers(path: &Path, thickness: f32, spacing: f32, smoke: [f32; 2], key: u32, out: &mut Seeds) {
    let random = Random::new([key, 1, 0]);
    let pieces = (path.length / spacing).ceil().max(4.0) as usize;
    let (lines, mut number) = (bundle(thickness, spacing), 0);
    for line in &lines {
        // What it stands for, over what a tracer is counted for.
        let share = line.area * path.length / pieces as f32 / spacing.powi(3);
        for piece in 0..pieces {
            let v = random.vector(number) - Vec3::repeat(0.5);
            let offset = [line.offset[0] + spacing * v.x, line.offset[1] + spacing * v.y];
            let (x, _) = (path.at)((piece as f32 + 0.5 + v.z) / pieces as f32, offset);
            out.add(x, smoke.map(|carried| carried * share));
            number += 1;
        }
    }
}

/// Seeds a ring; `key` is its number.
pub(super) fn ring(ring: &Ring, setting: Setting, key: u32, vortons: &mut Vortons, seeds: &mut Seeds) {
    let axis = Vec3::from(ring.direction).normalize();
    let (u, v) = across(axis);
    let center = Vec3::from(ring.center);
    // The offset is measured outwards and along the axis; lines keep their way around with the wave.
    let at = |t: f32, offset: [f32; 2]| {
        let (sin, cos) = (TAU * t).sin_cos();
        let (out, around) = (u * cos + v * sin, v * cos - u * sin);
        let wave = ring.radius * ring.wobble;
        let r = ring.radius + offset[0] + wave * (WAVES * TAU * t).cos();
        let slope = -wave * WAVES * (WAVES * TAU * t).sin();
        (center + out * r + axis * offset[1], (around * r + out * slope) * TAU)
    };
    let path = Path { at: &at, length: TAU * ring.radius };
    add_vortons(&path, ring.thickness, ring.circulation, setting.spacing, setting.core, vortons);
    if ring.density > 0.0 {
        add_tracers(&path, ring.thickness, setting.tracers, [ring.density, ring.temperature], key, seeds);
    }
}

/// Seeds a tube; `key` is its number.
pub(super) fn tube(tube: &Tube, setting: Setting, key: u32, vortons: &mut Vortons, seeds: &mut Seeds) {
    let (from, to) = (Vec3::from(tube.from), Vec3::from(tube.to));
    let way = to - from;
    let (u, v) = across(way.normalize());
    let at = |t: f32, [a, b]: [f32; 2]| (from + way * t + u * a + v * b, way);
    let path = Path { at: &at, length: way.norm() };
    add_vortons(&path, tube.thickness, tube.circulation, setting.spacing, setting.core, vortons);
    if tube.density > 0.0 {
        add_tracers(&path, tube.thickness, setting.tracers, [tube.density, tube.temperature], key, seeds);
    }
}

/// What seeding goes by [m].
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    /// Between vortons.
    pub(super) spacing: f32,
    /// σ of each.
    pub(super) core: f32,
    /// Between tracers.
    pub(super) tracers: f32,
}

/// Two unit vectors across `axis` and each other, right-handed with it.
fn across(axis: Vec3) -> (Vec3, Vec3) {
    let other = Vec3::ith(axis.iamin(), 1.0);
    let u = (other - axis * axis.dot(&other)).normalize();
    (u, axis.cross(&u))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ring_has_its_circulation_its_impulse_and_its_smoke() {
        let text =
            "center = [0.1, 0, 0]\ndirection = [0, 1, 1]\nradius = 0.4\nthickness = 0.06\ncirculation = 2";
        let params: Ring = toml::from_str(text).unwrap();
        for spacing in [0.05, 0.02] {
            let setting = Setting { spacing, core: 1.5 * spacing, tracers: 0.5 * spacing };
            let (mut vortons, mut seeds) = (Vortons::default(), Seeds::default());
            ring(&params, setting, 0, &mut vortons, &mut seeds);
            let sum: Vec3 = vortons.strength.iter().sum();
            assert!(sum.norm() < 1e-4, "{sum}");
            // ½ Σ (x − c) × Γ = Γ_c π (R² + ⟨r²⟩/2), along its way.
            let x = vortons.position.iter().map(|x| x - Vec3::from(params.center));
            let impulse: Vec3 = x.zip(&vortons.strength).map(|(x, g)| x.cross(g) * 0.5).sum();
            let exact = 2.0 * PI * (0.16 + 0.5 * 0.06 * 0.06 * 0.93);
            let along = impulse.dot(&Vec3::new(0.0, 1.0, 1.0).normalize());
            assert!(
                (along / exact - 1.0).abs() < 0.01 && (impulse.norm() - along).abs() < 1e-3,
                "{impulse} {exact}"
            );
            let smoke: f32 = seeds.smoke.iter().map(|[density, _]| density * setting.tracers.powi(3)).sum();
            let volume = 2.0 * PI * PI * 0.4 * 0.06 * 0.06;
            assert!((smoke / volume - 1.0).abs() < 0.01, "{smoke} of {volume}");
        }
    }
}
