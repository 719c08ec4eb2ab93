//! Fields on grids from particles.
//!
//! [`density`] turns particles into a smooth dimensionless density on sparse bricks; its level set at
//! [`Density::threshold`] is the surface of the liquid. [`velocity`] carries the particles' velocities to the same bricks.

mod active;
mod anisotropy;
mod blob;
mod carried;
mod cloud;
mod density;
mod fill;
mod kernel;
mod params;
mod threshold;
mod velocity;

pub use active::coarse_step;
pub use carried::{Carried, CarriedParams, carried, carried_at};
pub use density::{Density, bricks_near_surface, density};
pub use params::{Anisotropy, DensityParams};
pub use threshold::surface_threshold;
pub use velocity::{Velocity, velocity};
