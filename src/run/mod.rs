//! The jobs: what the verbs of the command line do, without the command line.
//!
//! This is the only layer that sees a whole [`Scene`](crate::scene::Scene): it takes it apart and hands each module its own
//! part. Jobs say what happens through a [`Reporter`] and ask between steps whether to go on.

mod batch;
mod error;
mod folder;
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
mod scratch;
mod sheet_meshes;
mod sheets;
mod simulate;
mod smoke_grids;
mod solids;
mod source;
mod surface;
mod totals;
pub mod tradeoff;
mod usage;
mod volume;
mod volume_grids;

pub use error::{FailedFrame, Failure, RunError};
pub use folder::ShotFolder;
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

/// What a job tells while it works. Implemented by the command line.
pub trait Reporter: Sync {
    /// A job of `frames` frames begins.
    fn begin(&self, job: &str, frames: usize);

    /// So many frames of the job are done; fractions count.
    fn progress(&self, frames_done: f64);

    /// A frame is finished; `figures` is one line about it.
    fn frame(&self, figures: &str);

    /// Something the user should know, once.
    fn note(&self, text: &str);

    /// The job is done.
    fn end(&self);

    /// The job, if one was under way, ended early; the reason is told elsewhere.
    fn stop(&self);
}

/// How a job talks to whoever started it.
#[derive(Clone, Copy)]
pub struct Control<'a> {
    /// Told what happens.
    pub reporter: &'a dyn Reporter,
    /// Asked between steps; `true` stops the job, with everything finished so far kept.
    pub interrupted: &'a (dyn Fn() -> bool + Sync),
}
