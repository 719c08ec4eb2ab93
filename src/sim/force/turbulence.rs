//! Random acceleration without divergence.
//!
//! *Method*: random Fourier modes ([kraichnan70]) as a potential: P = Σ A/|k| q sin θ with θ = k·x + φ + ω t and a unit vector q
//! across k, and the acceleration is its curl ([bridson07]): w ∇×P + ∇w × P under the window w of a shape. A curl has no
//! divergence, whatever the window. Directions, wavelengths, phases and frequencies are counter-based random numbers.
//! *Departs from the papers*: [kraichnan70]'s spectrum is one band of wavelengths; [bridson07]'s noise is on a grid, which shows
//! its axes and whose cells end the smoothness.
//!
//! Symbols: A → `amplitude` [m/s²], k → `wave` [turns/m], q → `across` [1], w → window [1].
//! Limits: the sum of N modes has N random numbers: over a hundred scales a pattern does not repeat, but its largest values are at most
//! √(2N) times the RMS. Phases are double precision, so the pattern is the same 10 km from the origin.

use crate::math::{
    Random, Vec3,
    elementary::{cos, exp2, sin},
};
use nalgebra::Vector3;
use std::f32::consts::TAU;

/// Number of modes. A few tens look random; fewer show stripes.
const MODES: u32 = 48;

/// Counter of the random numbers, apart from those of other terms.
const STREAM: u32 = 11;

/// A mode of the potential.
#[derive(Clone, Copy, Debug)]
struct Mode {
    /// k over 2π [1/m].
    wave: Vector3<f64>,
    /// Unit vector across k.
    across: Vec3,
    /// (k/|k|) × q.
    curl: Vec3,
    /// Wavelength over 2π [m].
    length: f32,
    /// Phase at time 0 [turns], and its rate [turns/s].
    phase: [f64; 2],
}

/// The modes of a turbulence of RMS 1.
#[derive(Clone, Debug)]
pub(super) struct Turbulence(Vec<Mode>);

impl Turbulence {
    /// A pattern with wavelengths about `scale` [m] that changes in about a `period` [s].
    pub(super) fn new(seed: u32, scale: f32, period: Option<f32>) -> Self {
        Self((0..MODES).map(|number| mode(seed, number, scale, period)).collect())
    }

    /// Phases of the modes at `time` [s] [turns].
    pub(super) fn phases(&self, time: f64) -> Vec<f64> {
        self.0.iter().map(|mode| fraction(mode.phase[0] + mode.phase[1] * time)).collect()
    }

    /// Acceleration at `x` for an RMS of 1, under a window of this value and gradient [1/m].
    pub(super) fn acceleration(&self, x: Vec3, phases: &[f64], (window, slope): (f32, Vec3)) -> Vec3 {
        let x = x.cast::<f64>();
        let (mut curl, mut potential) = (Vec3::zeros(), Vec3::zeros());
        let is_sloped = slope != Vec3::zeros();
        for (mode, phase) in self.0.iter().zip(phases) {
            let angle = TAU * fraction(mode.wave.dot(&x) + phase) as f32;
            curl += mode.curl * cos(angle);
            if is_sloped {
                potential += mode.across * (mode.length * sin(angle));
            }
        }
        // Each mode has the mean square ½.
        let amplitude = (2.0 / self.0.len() as f32).sqrt();
        (curl * window + slope.cross(&potential)) * amplitude // ∇ × (w P) = w ∇ × P + ∇w × P
    }
}

/// Mode `number`: any direction, a wavelength between 0.7 and 1.4 of the scale.
fn mode(seed: u32, number: u32, scale: f32, period: Option<f32>) -> Mode {
    let random = Random::new([seed, STREAM, number]);
    let on_sphere = |place: u64| {
        let (z, angle) = (2.0 * random.at(place) - 1.0, TAU * random.at(place + 1));
        let r = (1.0 - z * z).max(0.0).sqrt();
        Vec3::new(r * cos(angle), r * sin(angle), z)
    };
    let direction = on_sphere(0);
    let other = on_sphere(2);
    let across = other - direction * direction.dot(&other);
    // Two random directions are hardly ever the same.
    let across = if across.norm() > 1e-3 { across } else { direction.cross(&smallest_axis(direction)) };
    let across = across / across.norm();
    let wavelength = scale * exp2(random.at(4) - 0.5);
    let rate = period.map_or(0.0, |period| {
        let sign = if random.at(6) < 0.5 { -1.0 } else { 1.0 };
        sign * (0.5 + f64::from(random.at(7))) / f64::from(period)
    });
    Mode {
        wave: direction.cast::<f64>() / f64::from(wavelength),
        across,
        curl: direction.cross(&across),
        length: wavelength / TAU,
        phase: [f64::from(random.at(5)), rate],
    }
}

/// The axis with the smallest component of a unit vector.
fn smallest_axis(v: Vec3) -> Vec3 {
    let axis = v.abs().imin();
    Vec3::from_fn(|i, _| if i == axis { 1.0 } else { 0.0 })
}

/// The part of a number after its integer part, from 0 to 1.
fn fraction(turns: f64) -> f64 {
    turns - turns.floor()
}
