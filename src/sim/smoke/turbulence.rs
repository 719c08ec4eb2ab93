//! Random turbulence.
//!
//! *Method*: ω = ∇ × (w P): a potential P of random waves with wavelengths about `scale`, under a window w that falls to zero at
//! the shape's surface. As a curl it has no divergence, whatever the window. Vortons lie on a seeding lattice; their strengths
//! are scaled so that the RMS of the velocity they induce at themselves is the requested one.
//!
//! Symbols: k → `wave` [1/m], P → `potential` [m²/s, before scaling], w → `window` [–].

use super::params::{SmokeParams, Turbulence};
use crate::math::elementary::{cos, powf, sin};
use crate::{
    math::{Random, Vec3},
    par,
    sim::vortex::{OutOfRange, Vortons, flow::Flow},
};
use std::f32::consts::TAU;

/// Number of waves in the sum. A few tens look random; fewer show stripes.
const WAVES: u64 = 48;

/// Width of the window's rise from the surface inwards, as a part of `scale`.
const RIM: f32 = 0.5;

/// A wave of the potential: a sin(k·x + φ).
struct Wave {
    amplitude: Vec3,
    wave: Vec3,
    phase: f32,
}

/// Adds the vortons of `turbulence` on the seeding lattice of `params`.
///
/// # Errors
/// If the velocities that the vortons induce cannot be found.
pub(super) fn seed(
    turbulence: &Turbulence,
    params: &SmokeParams,
    out: &mut Vortons,
) -> Result<(), OutOfRange> {
    let (spacing, core) = (params.spacing, params.core());
    let Some((low, high)) = turbulence.shape.bounds() else { return Ok(()) };
    let waves: Vec<Wave> = (0..WAVES).map(|k| wave(turbulence, k)).collect();
    let first = low.map(|v| (v / spacing).ceil() as i64);
    let counts = high.zip_map(&first, |v, first| ((v / spacing).floor() as i64 - first + 1).max(0) as u64);
    let rows = par::map((counts.y * counts.z) as usize, |row| {
        let (j, k) = (row as u64 % counts.y, row as u64 / counts.y);
        let points = (0..counts.x).filter_map(|i| {
            let x = Vec3::new(i as f32, j as f32, k as f32) + first.map(|v| v as f32);
            let x = x * spacing;
            let omega = vorticity(turbulence, &waves, x)?;
            Some((x, omega * spacing.powi(3)))
        });
        points.collect::<Vec<_>>()
    });
    let (position, strength): (Vec<Vec3>, Vec<Vec3>) = rows.into_iter().flatten().unzip();
    let core = vec![core; position.len()];
    let mut made = Flow::new(params.flow.clone());
    let volume = vec![spacing.powi(3); position.len()];
    made.add(&Vortons { position, strength, core }, &volume);

    // Scale to the requested speed.
    let velocity = made.velocity_at(&made.vortons.position)?;
    let square = par::sum(velocity.len(), |i| f64::from(velocity[i].norm_squared()));
    if square > 0.0 {
        let factor = f64::from(turbulence.strength) / (square / velocity.len() as f64).sqrt();
        par::update(&mut made.vortons.strength, |_, strength| *strength *= factor as f32);
        out.position.append(&mut made.vortons.position);
        out.strength.append(&mut made.vortons.strength);
        out.core.append(&mut made.vortons.core);
    }
    Ok(())
}

/// Wave `k`: any direction, a wavelength between 0.7 and 1.4 of the scale.
fn wave(turbulence: &Turbulence, k: u64) -> Wave {
    let random = Random::new([turbulence.seed, 2, k as u32]);
    let on_sphere = |place: u64| {
        let (z, angle) = (2.0 * random.at(place) - 1.0, TAU * random.at(place + 1));
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos(angle), r * sin(angle), z)
    };
    let length = turbulence.scale * 0.7 * powf(2.0_f32, random.at(9));
    Wave { amplitude: on_sphere(0), wave: on_sphere(4) * (TAU / length), phase: TAU * random.at(8) }
}

/// ∇ × (w P) at `x`, not scaled; `None` outside the shape.
fn vorticity(turbulence: &Turbulence, waves: &[Wave], x: Vec3) -> Option<Vec3> {
    let (distance, normal) = turbulence.shape.contact(x);
    if distance >= 0.0 {
        return None;
    }
    // A smooth step over the rim; its gradient points inwards.
    let rim = RIM * turbulence.scale;
    let t = (-distance / rim).min(1.0);
    let (window, slope) = (t * t * (3.0 - 2.0 * t), 6.0 * t * (1.0 - t) / rim);
    let (mut potential, mut curl) = (Vec3::zeros(), Vec3::zeros());
    for Wave { amplitude, wave, phase } in waves {
        let (sin, cos) = (sin(wave.dot(&x) + phase), cos(wave.dot(&x) + phase));
        potential += amplitude * sin;
        curl += wave.cross(amplitude) * cos;
    }
    Some(curl * window - normal.cross(&potential) * slope) // ∇ × (w P) = w ∇ × P + ∇w × P
}
