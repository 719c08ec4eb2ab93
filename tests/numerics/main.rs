//! Numerics against closed forms: convergence, conservation, limits.

mod sdf;
mod surface_field;
