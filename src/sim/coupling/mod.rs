//! Couplings between systems: two-way contact of liquid and sheets (`liquid_sheet.rs`), wind, the one-way drag of the smoke's air on
//! sheets (`wind.rs`), and two-way contact of rigid bodies and sheets (`body_sheet.rs`).
//!
//! The preset names both systems of a coupling; systems that are not coupled do not interact. The order of the names and of the
//! couplings does not matter. Rigid bodies collide with sheets as with colliders, without a `[[coupling]]`.

mod body_sheet;
mod contact;
mod error;
#[cfg(feature = "presets")]
pub(crate) mod job;
mod liquid_sheet;
mod params;
mod record;
mod resolve;
mod triangle;
mod wind;

pub use error::CouplingError;
pub use params::{Coupling, Drag};
pub use record::{BodySheetRecord, CouplingRecord, LiquidSheetRecord, WindRecord};
pub use resolve::resolve;
pub(crate) use resolve::{PresentSystems, ResolvedCouplings};

pub(super) use body_sheet::advance_bodies_and_sheets;
pub(super) use liquid_sheet::{CoupledSheets, ExternalForces, LiquidSheetCoupling};
pub(super) use wind::{FrameWind, WindCoupling};

/// The passes of a substep that liquid and sheets share.
pub(super) const LIQUID_PASSES: [&str; 2] = ["coupling_search", "coupling"];

/// The pass that computes the drag of the air.
pub(super) const WIND_PASS: &str = "coupling_air";

/// The passes of a substep that rigid bodies and sheets share, in addition to those of the sheets.
pub(super) const BODY_PASSES: [&str; 2] = ["bodies", "coupling_bodies"];
