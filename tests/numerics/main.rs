//! Numerical tests: observed orders of accuracy, conservation, closed forms.

mod mesh;
mod sdf;
