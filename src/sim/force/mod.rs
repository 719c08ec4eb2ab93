//! Force fields of a preset, for all systems: accelerations by place, velocity and time.
//!
//! *Method*: the sum of the forces at a point is a + K (U − v), with accelerations a and drags of a rate K towards the velocity U. With
//! gravity g, the velocity after Δt is that of the exact solution at a fixed place: v + Δt φ(K Δt) (g + a + K (U − v)), φ(z) = (1 −
//! e⁻ᶻ)/z. Drag of any rate is therefore stable and its decay independent of the substep. A system applies what this adds to g Δt
//! where it applies gravity, and multiplies the mean acceleration by the displacement of the substep for the work, as if it were the
//! loss of a potential energy: forces that pressure or contacts balance do no work.
//! *Departs from the papers*: none is followed but for turbulence (`turbulence.rs`).
//!
//! Symbols: a → `acceleration` [m/s²], K → `rate` [1/s], K U → `pull` [m/s²].
//! Limits: places, directions and factors are those at the start of a substep: first order in time. The velocity that forces add in a
//! substep is limited to one CFL length a substep; see docs/forces.md.

#[cfg(feature = "presets")]
pub(crate) mod check;
mod field;
mod params;
mod record;
#[cfg(feature = "presets")]
pub(crate) mod report;
#[cfg(test)]
mod tests;
mod turbulence;

pub(in crate::sim) use field::{Forces, KickedSubstep, Sample, Snapshot};
pub use params::{ForceKind, ForceParams, StrengthKeyframe};
pub(in crate::sim) use record::ChunkMaximum;
pub use record::ForceRecord;
