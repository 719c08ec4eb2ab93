//! Numerics against closed forms: convergence, conservation, limits, the same bytes every time.

mod mesh;
mod sdf;
mod surface_field;
