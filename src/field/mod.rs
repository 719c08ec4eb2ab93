//! Scalar and vector fields on grids, sampled from particles.
//!
//! [`density`] turns particles into a smooth dimensionless density on sparse bricks; its level set at
//! [`Density::threshold`] is the surface of the liquid. [`velocity`] interpolates the particles' velocities
//! to the same bricks, and [`tracer_fields`] the values of smoke tracers.

mod active;
mod anisotropy;
mod dense_clusters;
mod density;
mod fill;
mod kernel;
mod params;
mod particle_kernel;
mod scaled;
mod sorted_particles;
mod threshold;
mod tracer_fields;
mod velocity;

pub(crate) use active::coarse_step;
pub(crate) use dense_clusters::thinned;
pub(crate) use density::surface_size;
pub use density::{Density, density, density_of_radii};
pub use params::{Anisotropy, DensityParams};
pub(crate) use tracer_fields::{TracerFieldParams, TracerFields, tracer_fields, tracer_fields_at};
pub use velocity::{Velocity, velocity};
