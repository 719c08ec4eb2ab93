//! The invariants of vortex motion.
//!
//! *Method*: [winckelmans93]; sums in double precision. ΣΓ is conserved by stretching in the transpose form,
//! the impulse and the angular impulse by any exact motion without walls, the energy and the helicity by
//! inviscid motion.

use super::{Kernel, Method, OutOfRange, Quantity, Targets, Vortons, induced};
use crate::par;
use serde::{Deserialize, Serialize};

/// The invariants of a set of vortons, for a density of 1 kg/m³.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Invariants {
    /// ΣΓ [m³/s].
    pub strength: [f64; 3],
    /// I = ½ Σ x × Γ [m⁴/s].
    pub impulse: [f64; 3],
    /// L = ⅓ Σ x × (x × Γ) [m⁵/s].
    pub angular_impulse: [f64; 3],
    /// E = ½ Σ Γ·A [m⁵/s²]: (1/8π) ΣΣ Γ_p·Γ_q G, including p = q.
    pub energy: f64,
    /// H = Σ Γ·u [m⁴/s²].
    pub helicity: f64,
}

/// The invariants of `vortons`, with the potential and the velocity by `method`.
///
/// # Errors
/// [`OutOfRange`] as of [`induced`].
///
/// # Panics
/// As [`induced`].
pub fn invariants(vortons: &Vortons, kernel: Kernel, method: Method) -> Result<Invariants, OutOfRange> {
    let potential = induced(vortons, Targets::Vortons, Quantity::Potential, kernel, method)?.potential;
    let velocity = induced(vortons, Targets::Vortons, Quantity::Velocity, kernel, method)?.velocity;
    let sum = |f: &(dyn Fn(Double, Double) -> f64 + Sync)| {
        par::sum(vortons.len(), |i| f(vortons.position[i].cast(), vortons.strength[i].cast()))
    };
    let dot = |others: &[crate::math::Vec3]| {
        par::sum(vortons.len(), |i| vortons.strength[i].cast::<f64>().dot(&others[i].cast()))
    };
    Ok(Invariants {
        strength: std::array::from_fn(|k| sum(&|_, g| g[k])),
        impulse: std::array::from_fn(|k| sum(&|x, g| x.cross(&g)[k] / 2.0)),
        angular_impulse: std::array::from_fn(|k| sum(&|x, g| x.cross(&x.cross(&g))[k] / 3.0)),
        energy: dot(&potential) / 2.0,
        helicity: dot(&velocity),
    })
}

type Double = nalgebra::Vector3<f64>;
