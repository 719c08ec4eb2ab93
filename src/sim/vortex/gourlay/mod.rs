//! The two sums of [gourlay19] as published, for comparison: the grouping rule, and the grid solved by multigrid.
//!
//! The library's own tree and grid ([`Method::Tree`](super::Method::Tree), [`Method::Grid`](super::Method::Grid)) keep a
//! requested error. These do not: docs/vortices.md has what they reach.

pub(in crate::sim::vortex) mod grid;
pub(super) mod grouping;
mod multigrid;

pub use multigrid::multigrid_poisson;
