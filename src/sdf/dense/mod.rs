//! First-order distance on a dense grid, from pinned nodes.
//!
//! *Method* [gourlay17], [zhao05]: fast sweeping in eight orders propagates pinned distances ([`sweep`]), as a wavefront over
//! blocks of any size ([`Layout`]). On the bricks of [`super::from_density`] the same method follows the surface.
//!
//! Limits: memory follows the box: 8 bytes per node besides the seeds.

mod first;
mod layout;
mod skewed;

pub use first::{sweep, sweep_in_order};
pub use layout::Layout;

/// The fastest block size measured (see `docs/eikonal.md`): in smaller blocks copying the layers of neighbours costs
/// more than the sweep; with larger ones more nodes at rest are swept, and threads wait.
pub const BLOCK: [usize; 3] = [64, 16, 16];
