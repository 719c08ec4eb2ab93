//! What a tradeoff can be about: a system's simulation, or a product that is made of frames.

use super::{
    folder::Jobs,
    knob::{Axis, Knob},
};
use crate::{
    job::{
        Control, RunError,
        batch::Source,
        tradeoff::{ColumnInfo, Setting, Table, Wording},
    },
    preset::Frames,
    sim::scene::Scene,
};
use std::path::Path;

/// Subject of a tradeoff.
pub(crate) struct Subject {
    /// Name for `--of`.
    pub name: &'static str,
    /// Words for its tables.
    pub wording: &'static Wording,
    /// Columns of the subject.
    pub columns: fn() -> Vec<ColumnInfo>,
    /// The settings that a reference can refine.
    pub knobs: fn(&Scene) -> Vec<Knob>,
    /// What is varied if nothing is named.
    pub defaults: fn(&Scene) -> Vec<Axis>,
    /// Whether the defaults are varied one by one, and not in every combination.
    pub one_by_one: bool,
    /// What labels leave out of keys.
    pub table: &'static str,
    /// Why a key changes nothing of it, and what to do instead; `None` if it may.
    pub refuse: fn(&str) -> Option<&'static str>,
    /// A hash that differs between scenes whose runs differ.
    pub key: fn(&Scene) -> u64,
    /// How its runs are made.
    pub runs: Runs,
}

/// How runs are made and compared. `run` runs what is not there yet, and tabulates everything; it fails with whatever stops
/// a run but divergence, which is a result.
pub(crate) enum Runs {
    /// Of a system: scenes are simulated.
    System(SystemRuns),
    /// Of a product: it is made of given particles.
    Product(ProductRuns),
}

/// How runs of a system are made and compared.
pub(crate) struct SystemRuns {
    /// How fine a scene is, in words: "spacing 0.1 m".
    pub size: fn(&Scene) -> String,
    pub run: fn(&Sweep, &TradeoffJob<'_>, Control) -> Result<Table, RunError>,
}

/// How runs of a product are made and compared.
pub(crate) struct ProductRuns {
    /// A bound of the memory that a scene needs for a frame of so many particles [bytes].
    pub memory: fn(usize, &Scene) -> u64,
    /// Whether a scene needs the colliders of the shot, whose meshes are then sampled.
    pub uses_solids: fn(&Scene) -> bool,
    pub run: fn(&Sweep, &ProductSource<'_>, &TradeoffJob<'_>, Control) -> Result<Table, RunError>,
}

/// The runs of a tradeoff, checked: every one of them is a valid scene.
#[derive(Clone, Debug)]
pub(crate) struct Sweep {
    /// The settings to compare.
    pub rows: Vec<(Setting, Scene)>,
    /// The reference of the comparison.
    pub reference: (Setting, Scene),
    /// The reference refined once more, which shows how far it can be trusted.
    pub refined: (Setting, Scene),
    /// The preset as given.
    pub base: Scene,
}

/// How the runs of a sweep are compared.
#[derive(Clone, Copy)]
pub(crate) struct TradeoffJob<'a> {
    /// The frames to compare.
    pub frames: &'a Frames,
    /// Where runs are kept, a folder each.
    pub folder: &'a Path,
    /// How often every setting is timed.
    pub repeats: usize,
    /// The criterion that decides.
    pub by: &'static str,
    /// Jobs that make the runs.
    pub jobs: &'static dyn Jobs,
}

/// What a product is made of.
#[derive(Clone, Copy)]
pub(crate) struct ProductSource<'a> {
    /// Where the particles come from.
    pub source: Source<'a>,
    /// The scene with the colliders of the shot, whose meshes are sampled if a setting needs them; `None` if the particles have none.
    pub scene: Option<&'a Scene>,
    /// How many frames a setting would be used on.
    pub shot_frames: u64,
    /// Refuse if a frame needs more memory than about this [bytes].
    pub max_memory: Option<u64>,
}
