//! Vortons and tracers of rings and tubes.
//!
//! *Method*: a bundle of vortex filaments fills the core: one on the axis and circles of 6, 12, 18 … filaments one spacing apart.
//! Together they have the Gaussian core ω = Γ_c/(πa²) e^(−r²/a²), [winckelmans93]. The vortons of a filament are as wide as a
//! Gaussian of mean square radius v σ² (`Kernel::filament_variance`), so the filaments have one of b² = a² − v σ². It is cut off at
//! 2b, and offsets are scaled so that its mean square radius is b² after that, too. Circulations are scaled to sum to Γ_c. Each
//! filament is divided into segments of about one spacing, Γ = Γ_filament · Δs.
//!
//! *Limits*: a core narrower than that of vortons is one filament. A ring then flies as thin rings of the kernel do.
//!
//! Symbols: Γ_c → `circulation` [m²/s], a → `thickness` [m], R → `radius` [m].

use super::{
    params::{Ring, SmokeParams, Tube},
    tracers::Seeds,
};
use crate::math::elementary::{cos, exp, sin};
use crate::{
    math::{Random, Vec3},
    sim::vortex::{Kernel, Vortons},
};
use std::f32::consts::{PI, TAU};

/// Number of waves along a ring with `wobble`: that of the instability of rings of the usual thickness.
const WAVES: f32 = 7.0;

/// Radius at which the vorticity is cut off, in core radii: e⁻⁴ of that on the axis is left.
const CUT: f32 = 2.0;

/// A filament of a bundle: where it passes through the cross-section [m], and its part of the area [m²].
struct Filament {
    offset: [f32; 2],
    area: f32,
}

/// Filaments about `distance` apart that fill a disc of `radius`; at least the one on the axis.
fn bundle(radius: f32, distance: f32) -> Vec<Filament> {
    let circles = (radius / distance - 0.5).round().max(0.0) as usize;
    let distance = radius / (circles as f32 + 0.5);
    let mut filaments = vec![Filament { offset: [0.0; 2], area: PI * (0.5 * distance).powi(2) }];
    for circle in 1..=circles {
        let (r, count) = (circle as f32 * distance, 6 * circle);
        let area = TAU * r * distance / count as f32;
        filaments.extend((0..count).map(|k| {
            // Circles are rotated against each other, so that filaments do not line up.
            let angle = TAU * (k as f32 + 0.5 * (circle % 2) as f32) / count as f32;
            Filament { offset: [r * cos(angle), r * sin(angle)], area }
        }));
    }
    filaments
}

/// Filaments whose mean square radius is `variance` [m²], with their parts of the circulation, which sum to one.
fn shares(variance: f64, spacing: f32) -> Vec<(Filament, f32)> {
    let filaments = bundle(CUT * variance.max(0.0).sqrt() as f32, spacing);
    if filaments.len() == 1 {
        return filaments.into_iter().map(|filament| (filament, 1.0)).collect();
    }
    let square = |filament: &Filament| filament.offset.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
    let weight = |filament: &Filament| f64::from(filament.area) * exp(-square(filament) / variance);
    let sum: f64 = filaments.iter().map(weight).sum();
    let found = filaments.iter().map(|filament| weight(filament) * square(filament)).sum::<f64>() / sum;
    let scale = (variance / found).sqrt() as f32;
    filaments
        .into_iter()
        .map(|filament| {
            let share = (weight(&filament) / sum) as f32;
            (Filament { offset: filament.offset.map(|x| x * scale), ..filament }, share)
        })
        .collect()
}

/// A curve with a cross-section.
struct Path<'a> {
    /// Position [m] at parameter `t`, 0 to 1, and at an offset in the cross-section; and its derivative by t.
    at: &'a (dyn Fn(f32, [f32; 2]) -> (Vec3, Vec3) + Sync),
    /// Length of the axis [m].
    length: f32,
}

/// Adds the vortons of a core along `path`.
fn add_vortons(path: &Path, thickness: f32, circulation: f32, setting: Setting, out: &mut Vortons) {
    let Setting { spacing, core, .. } = setting;
    let segments = (path.length / spacing).ceil().max(4.0) as usize;
    for (filament, share) in shares(setting.filament_variance(thickness), spacing) {
        for segment in 0..segments {
            let (x, along) = (path.at)((segment as f32 + 0.5) / segments as f32, filament.offset);
            out.position.push(x);
            out.strength.push(along * (circulation * share / segments as f32));
            out.core.push(core);
        }
    }
}

/// Adds the tracers that fill a core along `path`, each moved at random by up to half a spacing against patterns.
fn add_tracers(path: &Path, thickness: f32, spacing: f32, smoke: [f32; 2], key: u32, out: &mut Seeds) {
    let random = Random::new([key, 1, 0]);
    let segments = (path.length / spacing).ceil().max(4.0) as usize;
    let (filaments, mut number) = (bundle(thickness, spacing), 0);
    for filament in &filaments {
        // Volume of a segment over that of a tracer.
        let share = filament.area * path.length / segments as f32 / spacing.powi(3);
        for segment in 0..segments {
            let v = random.vector(number) - Vec3::repeat(0.5);
            let offset = [filament.offset[0] + spacing * v.x, filament.offset[1] + spacing * v.y];
            let (x, _) = (path.at)((segment as f32 + 0.5 + v.z) / segments as f32, offset);
            out.add(x, smoke.map(|value| value * share));
            number += 1;
        }
    }
}

/// Seeds a ring; `key` is its number.
pub(super) fn ring(ring: &Ring, setting: Setting, key: u32, vortons: &mut Vortons, seeds: &mut Seeds) {
    let axis = Vec3::from(ring.direction).normalize();
    let (u, v) = across(axis);
    let center = Vec3::from(ring.center);
    // The offset is measured outwards and along the axis; the wave does not rotate filaments around the core.
    let at = |t: f32, offset: [f32; 2]| {
        let [cosine, sine] = [cos(TAU * t), sin(TAU * t)];
        let (out, around) = (u * cosine + v * sine, v * cosine - u * sine);
        let wave = ring.radius * ring.wobble;
        let r = ring.radius + offset[0] + wave * cos(WAVES * TAU * t);
        let slope = -wave * WAVES * sin(WAVES * TAU * t);
        (center + out * r + axis * offset[1], (around * r + out * slope) * TAU)
    };
    let path = Path { at: &at, length: TAU * ring.radius };
    add_vortons(&path, ring.thickness, ring.circulation, setting, vortons);
    if ring.density > 0.0 {
        add_tracers(&path, ring.thickness, setting.tracers, [ring.density, ring.temperature], key, seeds);
    }
}

/// Seeds a tube; `key` is its number.
pub(super) fn tube(tube: &Tube, setting: Setting, key: u32, vortons: &mut Vortons, seeds: &mut Seeds) {
    let (from, to) = (Vec3::from(tube.from), Vec3::from(tube.to));
    let axis = to - from;
    let (u, v) = across(axis.normalize());
    let at = |t: f32, [a, b]: [f32; 2]| (from + axis * t + u * a + v * b, axis);
    let path = Path { at: &at, length: axis.norm() };
    add_vortons(&path, tube.thickness, tube.circulation, setting, vortons);
    if tube.density > 0.0 {
        add_tracers(&path, tube.thickness, setting.tracers, [tube.density, tube.temperature], key, seeds);
    }
}

/// Spacings and core of the seeding [m].
#[derive(Clone, Copy, Debug)]
pub(super) struct Setting {
    /// Spacing of vortons.
    pub(super) spacing: f32,
    /// Core σ of each vorton.
    pub(super) core: f32,
    /// Distribution of the vorticity over it.
    pub(super) kernel: Kernel,
    /// Spacing of tracers.
    pub(super) tracers: f32,
}

impl Setting {
    /// The setting of smoke with these parameters.
    pub(super) fn of(params: &SmokeParams) -> Self {
        let (spacing, core, tracers) = (params.spacing, params.core(), params.tracer_spacing());
        Self { spacing, core, kernel: params.flow.kernel, tracers }
    }

    /// b²: the mean square radius that filaments have in a core of this `thickness` [m²]; below 0 vortons are wider than the core.
    pub(super) fn filament_variance(&self, thickness: f32) -> f64 {
        f64::from(thickness).powi(2) - self.kernel.filament_variance() * f64::from(self.core).powi(2)
    }
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
        let params: Ring = crate::from_toml(text);
        for spacing in [0.05, 0.02] {
            let setting =
                Setting { spacing, core: 1.5 * spacing, kernel: Kernel::default(), tracers: 0.5 * spacing };
            let (mut vortons, mut seeds) = (Vortons::default(), Seeds::default());
            ring(&params, setting, 0, &mut vortons, &mut seeds);
            let sum: Vec3 = vortons.strength.iter().sum();
            assert!(sum.norm() < 1e-4, "{sum}");
            // ½ Σ (x − c) × Γ = Γ_c π (R² + ⟨r²⟩/2), along its direction.
            let variance = setting.filament_variance(0.06).max(0.0);
            assert_eq!(variance > 0.0, spacing < 0.05, "the wider vortons are wider than the core");
            let x = vortons.position.iter().map(|x| x - Vec3::from(params.center));
            let impulse: Vec3 = x.zip(&vortons.strength).map(|(x, g)| x.cross(g) * 0.5).sum();
            let exact = 2.0 * PI * (0.16 + 0.5 * variance as f32);
            let along = impulse.dot(&Vec3::new(0.0, 1.0, 1.0).normalize());
            assert!(
                (along / exact - 1.0).abs() < 1e-3 && (impulse.norm() - along).abs() < 1e-3,
                "{impulse} {exact}"
            );
            let smoke: f32 = seeds.smoke.iter().map(|[density, _]| density * setting.tracers.powi(3)).sum();
            let volume = 2.0 * PI * PI * 0.4 * 0.06 * 0.06;
            assert!((smoke / volume - 1.0).abs() < 0.01, "{smoke} of {volume}");
        }
    }
}
