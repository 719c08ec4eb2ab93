//! Estimate of a shot's vortons and tracers from its parameters alone.

use super::SmokeParams;
use crate::{
    sim::{
        SetupError,
        vortex::{Kernel, flow::Sum},
    },
    solid::Shape,
};

/// Limit of tracers and vortons: their ids have 32 bits.
pub(in crate::sim) const MAX_TRACERS_AND_VORTONS: f64 = 2_147_483_648.0;

/// Refuses smoke of too many vortons and tracers, once its meshes are filled.
///
/// # Errors
/// [`SetupError::TooMuchSmoke`].
pub(in crate::sim) fn refuse_too_much(smoke: &SmokeParams, seconds: f64) -> Result<(), SetupError> {
    let count = estimate(smoke, seconds);
    if count > MAX_TRACERS_AND_VORTONS { Err(SetupError::TooMuchSmoke { count }) } else { Ok(()) }
}

/// Refuses a kernel that the method of summation does not have.
///
/// # Errors
/// [`SetupError::MultigridKernel`].
pub(super) fn refuse_kernel(smoke: &SmokeParams) -> Result<(), SetupError> {
    match (smoke.flow.sum, smoke.flow.kernel) {
        (Sum::Multigrid, Kernel::Gaussian) => Ok(()),
        (Sum::Multigrid, _) => Err(SetupError::MultigridKernel),
        _ => Ok(()),
    }
}

/// Upper estimate of vortons and tracers after some seconds; meshes that are not filled are not counted.
pub(in crate::sim) fn estimate(smoke: &SmokeParams, seconds: f64) -> f64 {
    let (h, s) = (f64::from(smoke.spacing), f64::from(smoke.tracer_spacing()));
    let core = |length: f64, thickness: f32, density: f32| {
        let area = std::f64::consts::PI * f64::from(thickness).powi(2);
        let tracers = if density > 0.0 { area.max(s * s) / s.powi(3) } else { 0.0 };
        length * (4.0 * area.max(h * h) / h.powi(3) + tracers)
    };
    let rings = smoke
        .ring
        .iter()
        .map(|ring| core(std::f64::consts::TAU * f64::from(ring.radius), ring.thickness, ring.density));
    let tubes = smoke.tube.iter().map(|tube| {
        let axis = [0, 1, 2].map(|axis| f64::from(tube.to[axis]) - f64::from(tube.from[axis]));
        core(axis.iter().map(|c| c * c).sum::<f64>().sqrt(), tube.thickness, tube.density)
    });
    let turbulence = smoke.turbulence.iter().map(|t| points(&t.shape, h));
    let sources = smoke.source.iter().map(|source| points(&source.shape, s));
    let emitters =
        smoke.emitter.iter().map(|emitter| points(&emitter.shape, s) * f64::from(emitter.rate) * seconds);
    rings.chain(tubes).chain(turbulence).chain(sources).chain(emitters).sum()
}

/// Points of this `spacing` [m] in the box around a shape, or in a mesh; 0 for an unbounded shape and a mesh in a file.
fn points(shape: &Shape, spacing: f64) -> f64 {
    if let Shape::Mesh(mesh) = shape {
        return mesh.volume().map_or(0.0, |volume| volume / spacing.powi(3));
    }
    let bounds = shape.bounds().filter(|_| shape.check().is_ok());
    let along = |low: f32, high: f32| ((f64::from(high) - f64::from(low)) / spacing).max(1.0);
    bounds.map_or(0.0, |(low, high)| (0..3).map(|axis| along(low[axis], high[axis])).product())
}
