//! The jobs: what the verbs of the command line do, without the command line.
//!
//! This is the only layer that sees a whole [`Scene`](crate::scene::Scene): it passes each module its own part. Jobs report through
//! a [`Reporter`] and check between steps whether to go on.

mod bounds;
mod branch;
mod follow;
mod info;
mod plan;
mod prepare;
mod products;
mod recorded;
mod report;
mod simulate;
mod solids;
mod stale;
pub(crate) mod tradeoff;
mod vary;
mod verify;
pub(crate) mod wedge;

use crate::job::usage;
pub(crate) use crate::{
    job::{
        Control, FailedFrame, Failure, FrameSpan, Manifest, OutputFiles, Reporter, RunError, ShotFolder,
        Total,
        batch::{BatchRequest, Source},
    },
    product::{
        ParticleLook, PreviewParams, ProductInput, ProductRequest, ProductSelection, ProductSettings, Retime,
        is_any_requested,
    },
};
pub(crate) use bounds::{FrameBounds, bounds};
pub(crate) use branch::NewBranch;
pub(crate) use follow::follow;
pub(crate) use info::{FrameState, Info, OutputInfo, frame_ranges, info, is_shot};
pub(crate) use plan::{Outline, Plan, outline, plan, refuse_over_memory};
pub(crate) use prepare::prepare;
pub(crate) use products::make_products;
pub(crate) use recorded::recorded_scene;
pub(crate) use report::report;
pub(crate) use simulate::{check_selection, simulate};
pub(crate) use vary::Vary;
pub(crate) use verify::{Stage, Verification, verify};
