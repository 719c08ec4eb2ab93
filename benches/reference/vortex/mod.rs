//! The methods of [gourlay19] for the velocity that vortons induce, for comparison with those of the library.
//!
//! `benches/vortex.rs` measures them and `tests/numerics/` tests them; no command of the program uses them.

pub(crate) mod multigrid;
pub(crate) mod paper_grid;
pub(crate) mod tree_rule;
