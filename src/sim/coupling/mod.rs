//! What couples systems: liquid and sheets push each other (`liquid.rs`), smoke blows sheets about (`air.rs`).
//!
//! A coupling exists where the preset names both sides, and nowhere else. The order in which they are named, and in which couplings stand,
//! does not matter.

mod air;
pub(crate) mod job;
mod liquid;
mod meet;
mod params;
mod record;
mod resolve;
mod triangle;

pub use params::{Coupling, Drag};
pub use record::{CouplingRecord, LiquidOnSheets, SmokeOnSheets};
pub use resolve::{CouplingError, Resolved, There, resolve};

pub(super) use air::{Blown, Wind};
pub(super) use liquid::{Bound, Outside, Together};

/// The passes of a substep that liquid and sheets share.
pub(super) const PASSES: [&str; 2] = ["coupling_search", "coupling"];

/// The pass in which sheets feel the air.
pub(super) const AIR: &str = "coupling_air";
