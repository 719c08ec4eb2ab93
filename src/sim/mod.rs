//! Simulation: the systems of a shot, their sources and forces, as the preset composes them.
//!
//! A [`Simulation`] advances frame by frame, and gives its state as a [`Frame`](crate::frame::Frame). A [`Watch`]
//! observes and interrupts it. [`Stop`] is the error that ends it, and a [`FrameRecord`] describes every frame.

/// Version of the simulated state, raised with every change of its bits, so that a resumed cache never mixes two solvers.
pub const STATE_VERSION: u32 = 23;

/// The same of smoke, whose changes leave shots without smoke alone.
const SMOKE_STATE_VERSION: u32 = 5;

/// The same of shots with rigid bodies.
const BODY_STATE_VERSION: u32 = 9;

mod clock;
pub mod coupling;
#[cfg(feature = "presets")]
pub(crate) mod deforming;
pub mod force;
#[cfg(feature = "presets")]
pub(crate) mod forecast;
pub mod liquid;
mod observe;
mod record;
#[cfg(feature = "presets")]
pub(crate) mod registry;
pub mod rigid;
#[cfg(feature = "presets")]
pub mod scene;
#[cfg(feature = "presets")]
pub(crate) mod scene_check;
#[cfg(feature = "presets")]
mod scene_query;
mod setup;
pub mod sheet;
mod simulation;
pub mod smoke;
mod substep;
#[cfg(feature = "presets")]
pub(crate) mod system;
#[cfg(feature = "presets")]
pub(crate) mod tradeoff;
pub mod vortex;
#[cfg(feature = "presets")]
pub mod whitewater;

pub use crate::control::{CancelToken, Diverged, Stop, Unwatched, Watch};
pub use clock::Seconds;
#[cfg(feature = "presets")]
pub(crate) use forecast::{ElementCount, ProductForecast, SystemForecast};
pub use observe::Observable;
pub use record::{FrameRecord, SeedReport};
pub use setup::{SetupError, Timeline, World};
pub use simulation::{Simulation, Systems};
