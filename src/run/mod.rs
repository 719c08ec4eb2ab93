//! The jobs: what the verbs of the command line do, without the command line.
//!
//! This is the only layer that sees a whole [`Scene`](crate::scene::Scene): it takes it apart and hands each module its own
//! part. Jobs say what happens through a [`Reporter`] and ask between steps whether to go on.

mod info;
mod lattices;
mod log;
mod plan;
mod remarks;
mod simulate;
mod solids;
mod surroundings;
mod totals;
pub mod tradeoff;

use crate::job::{scratch, usage};
pub use crate::{
    job::{
        Control, FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, Reporter, RunError, ShotFolder,
        batch::{BatchRequest, BatchSummary, Source},
    },
    product::{
        point_cache::point_caches,
        points::points,
        sheet_mesh::sheet_meshes,
        surface::{Jump, MeshRecord, SurfaceSettings, mesh_level_sets, surface},
        volume::{Retime, Surroundings, VolumeSettings, retime, volume},
    },
};
pub use info::{FrameState, Info, OutputInfo, info};
pub use plan::{Outline, Plan, outline, plan, refuse_over_memory};
pub use simulate::{Simulated, simulate};
pub use surroundings::surroundings;
pub use totals::{LiquidTotals, SheetTotals, SmokeTotals, Totals};
