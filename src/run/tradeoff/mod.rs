//! Time against accuracy on the user's own shot: which settings are worth their time.
//!
//! *Method*: every setting of a sweep (`sweep`) is run on the same frames. So is a reference finer than all of them
//! ([`crate::sim::tradeoff`]), and a refinement of that, which determines how small an error is visible. The Pareto front and its
//! knee ([`crate::job::tradeoff`]) name the settings to consider. Systems and products define what is varied, run and compared.

mod sweep;

pub(crate) use crate::{
    job::tradeoff::{ColumnInfo, Setting, Shown, Table, write},
    sim::tradeoff::{ProductRuns, ProductSource, Runs, Subject, Sweep, TradeoffJob},
};
pub(crate) use sweep::{Origin, Request};

use super::{simulate, solids};
use crate::{
    cache,
    frame::Frame,
    job::{Control, RunError, ShotFolder},
    preset::Frames,
    product,
    sim::{
        forecast::{ProductSample, ProductSampler},
        registry,
        scene::Scene,
        tradeoff::Jobs,
    },
};
use std::path::Path;

/// Everything that can be compared: systems, then products.
pub(crate) fn subjects() -> impl Iterator<Item = &'static Subject> {
    let systems = registry::ALL.iter().filter_map(|system| system.tradeoff());
    systems.chain(product::ALL.iter().filter_map(|product| product.tradeoff()))
}

/// The systems of a scene that can be compared.
pub(crate) fn systems(scene: &Scene) -> impl Iterator<Item = &'static Subject> {
    let present = registry::ALL.iter().filter(|system| system.is_present(scene));
    present.filter_map(|system| system.tradeoff())
}

/// The scene with the meshes of its colliders sampled, as the shot has them.
///
/// # Errors
/// If a mesh is no closed surface, or is broken, or the samples cannot be written.
pub(crate) fn with_sampled_meshes(
    scene: &Scene,
    shot: &ShotFolder,
    control: Control,
) -> Result<Scene, RunError> {
    solids::fill(scene, Some(shot), control.reporter)
}

/// The jobs that a tradeoff's runs are made of.
pub(crate) struct RunJobs;

impl Jobs for RunJobs {
    fn simulate(
        &self,
        scene: &Scene,
        shot: &ShotFolder,
        frames: &Frames,
        force: bool,
        control: Control,
    ) -> Result<usize, RunError> {
        simulate::simulate(scene, shot, frames, force, None, control).map(|done| done.kept)
    }

    fn sample_products(
        &self,
        scene: &Scene,
        frame: &Frame,
        folder: &Path,
        control: Control,
    ) -> Result<Vec<ProductSample>, RunError> {
        let around = folder.parent().map(ShotFolder::new);
        let scene = solids::fill(scene, around.as_ref(), control.reporter)?;
        let shot = ShotFolder::new(folder);
        ShotFolder::create(&shot.cache())?;
        cache::write_frame(&shot.cache(), frame, 0)?;
        let frames =
            Frames::from_first_to_last(frame.index, frame.index).expect("a frame is not after itself");
        product::RequestedProducts.sample(&scene, &shot, &frames, control)
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_guide_lists_every_column() {
        let guide = include_str!("../../../docs/tradeoff.md");
        for subject in super::subjects() {
            for info in (subject.columns)().iter().filter(|info| !info.meaning.is_empty()) {
                let by = info.criterion.map_or_else(String::new, |name| format!("`{name}`"));
                let line = format!("| {} | {} | {by} |", info.heading, info.meaning.replace('|', "\\|"));
                assert!(guide.contains(&line), "docs/tradeoff.md lacks, of {}:\n{line}", subject.name);
            }
        }
    }
}
