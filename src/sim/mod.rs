//! Simulation: the systems, their sources and forces, composed from what the preset names.
//!
//! A [`Simulation`] is advanced frame by frame and read out as a [`Frame`](crate::frame::Frame). It is
//! interrupted and observed through [`Watch`], ends in [`Stop`] where it cannot go on, and tells of every frame
//! in a [`FrameRecord`].

/// Raised whenever a change gives the same preset other bits, so that a resumed cache never mixes two solvers.
pub const STATE_VERSION: u32 = 11;

mod clock;
pub mod coupling;
pub mod liquid;
mod observe;
mod record;
pub(crate) mod registry;
pub mod scene;
pub(crate) mod scene_check;
mod scene_query;
mod setup;
pub mod sheet;
mod simulation;
pub mod smoke;
mod substep;
pub(crate) mod system;
pub mod vortex;

pub use crate::control::{Diverged, Stop, Unwatched, Watch};
pub use clock::Seconds;
pub use observe::Observable;
pub use record::{FrameRecord, SeedReport};
pub use setup::{SetupError, World};
pub use simulation::{Simulation, Systems};
