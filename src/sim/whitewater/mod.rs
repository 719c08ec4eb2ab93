//! Spray, foam and bubbles of a liquid, computed from its cached frames.
//!
//! *Method*: [ihmsen12], with emission that does not depend on frames and steps (`emission`). Positions are metres, times seconds since
//! the start of the shot. Between two frames the liquid moves on cubics (`liquid`); what it emits follows from its potentials
//! (`potentials`); particles move by the balance of drag, gravity and buoyancy (`step`) and stay out of solids (`walls`).

mod emission;
mod liquid;
pub mod params;
mod potentials;
mod state;
mod step;
#[cfg(test)]
mod tests;
mod walls;

pub(crate) use liquid::{LiquidFrame, LiquidInterval};
pub(crate) use params::Kind;
pub use params::{WhitewaterFormat, WhitewaterParams};
pub(crate) use potentials::Rates;
pub(crate) use state::{STREAM, Whitewater};
pub(crate) use step::{advance, births_bound};
pub(crate) use walls::Walls;
