//! Signed distance on a dense grid.

mod first;
mod layout;
mod skewed;
#[cfg(target_arch = "x86_64")]
mod skewed_avx2;

pub use first::{sweep, sweep_in_order};
