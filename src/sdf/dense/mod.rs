//! First-order distance on a dense grid, from pinned nodes.
//!
//! *Method* [gourlay17], [zhao05]: fast sweeping in eight orders extends pinned distances to all nodes
//! ([`sweep`]), as a wavefront over blocks of any size ([`Layout`]). On the bricks of [`super::from_density`]
//! the same method follows the surface.
//!
//! Limits: memory grows with the box: 8 bytes per node in addition to the seeds.

mod first;
mod layout;
mod lines;
mod skewed;

pub use first::{sweep, sweep_in_order};
pub use layout::Layout;

/// The fastest size of blocks (see `docs/eikonal.md`): with smaller ones copying the layers of neighbours
/// costs more than the sweep; with larger ones more converged nodes are swept, and threads wait.
pub const BLOCK: [usize; 3] = [64, 16, 16];
