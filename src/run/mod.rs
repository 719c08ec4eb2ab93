//! The jobs: what the verbs of the command line do, without the command line.
//!
//! This is the only layer that sees a whole [`Scene`](crate::scene::Scene): it takes it apart and hands each module its own
//! part. Jobs say what happens through a [`Reporter`] and ask between steps whether to go on.

mod batch;
mod info;
mod job;
mod lattices;
mod ledger;
mod level_sets;
mod log;
mod manifest;
mod mesh_log;
mod plan;
mod points;
mod remarks;
mod retime;
mod sheet_meshes;
mod sheets;
mod simulate;
mod smoke_grids;
mod solids;
mod source;
mod surface;
mod totals;
pub mod tradeoff;
mod volume;
mod volume_grids;

pub use crate::job::{Control, FailedFrame, Failure, Reporter, RunError, ShotFolder};
use crate::job::{scratch, usage};
pub use info::{FrameState, Info, OutputInfo, info};
pub use job::Job;
pub use ledger::Done;
pub use level_sets::mesh_level_sets;
pub use manifest::{FrameSpan, Manifest, OutputFiles};
pub use mesh_log::{Jump, MeshRecord};
pub use plan::{Outline, Plan, outline, plan, refuse_over_memory};
pub use points::points;
pub use retime::{Retime, retime};
pub use sheets::{SheetSettings, SheetsDone, has_sheets, sheets};
pub use simulate::{Simulated, simulate};
pub use source::Source;
pub use surface::{SurfaceSettings, surface};
pub use totals::{LiquidTotals, SheetTotals, SmokeTotals, Totals};
pub use volume::{Surroundings, VolumeSettings, surroundings, volume};
