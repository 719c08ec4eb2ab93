//! Branches: a shot goes on from a cached frame of another with other settings, in a folder of its own.
//!
//! Frames before the branch are the same files in both folders (hard links); only the branch's first frame is written anew, with the
//! energies that the new settings give it. A frame keeps the key of the simulation that computed it.

use super::{Control, RunError, ShotFolder, simulate, solids, stale};
use crate::{
    cache::{self, CacheError},
    control::printable_path,
    frame::{Frame, FrameIndex},
    job::{file_records::hex, log},
    preset::Branch,
    scene::{self, Overrides, Scene},
    sim::{FrameRecord, Simulation, registry},
};
use std::{
    collections::BTreeSet,
    io,
    path::{Path, PathBuf},
};

/// Settings of the whole shot that a branch cannot change.
const FIXED: [&str; 2] = ["fps", "first"];

/// A branch that is about to start.
#[derive(Clone, Debug)]
pub(crate) struct NewBranch {
    /// The shot that it branches from.
    parent: ShotFolder,
    /// The scene of that shot.
    before: Scene,
    /// The branch's own scene.
    pub(crate) scene: Scene,
    /// The branch's first frame.
    first: FrameIndex,
}

impl NewBranch {
    /// The branch of the shot in `parent` whose first frame is `first`, with the changes of `overrides`.
    ///
    /// # Errors
    /// If the folder has no preset or not that frame, and if a setting cannot change there.
    pub(crate) fn new(
        parent: ShotFolder,
        first: FrameIndex,
        overrides: &Overrides,
    ) -> Result<Self, RunError> {
        let path = parent.preset();
        if !path.is_file() {
            return Err(RunError::Request(format!(
                "--from {}: found no preset.toml in {}, expected a shot folder with cached frames; name the folder that `meniscus shot` wrote",
                first.0,
                printable_path(parent.root())
            )));
        }
        let preset = scene::load(&path.to_string_lossy())?;
        let before = Scene::from_preset(&preset, &Overrides::default())?;
        let mut scene = Scene::from_preset(&preset, overrides)?;
        if first <= before.frames.first() {
            return Err(RunError::Request(format!(
                "--from {}: a branch starts after the shot's first frame, {}; without --from the shot starts anew",
                first.0,
                before.frames.first().0
            )));
        }
        refuse_fixed(&before, &scene, first)?;
        let keys = before.frame_keys();
        let key = cache::read_header(&cache::frame_path(&parent.cache(), first)).and_then(|info| {
            keys.expect(&info, &cache::frame_path(&parent.cache(), first))?;
            Ok(keys.of(FrameIndex(first.0 - 1)))
        });
        let key = key.map_err(|why| explain(&parent, first, why))?;
        scene.branch.retain(|branch| branch.frame < first.0);
        scene.branch.push(Branch { frame: first.0, before: hex(key) });
        Ok(Self { parent, before, scene, first })
    }

    /// Links the frames before the branch into its folder and writes its first frame, unless they are there.
    ///
    /// # Errors
    /// If the folder has frames of other settings and `force` is not set, if a frame is damaged, or a file cannot be written.
    pub(crate) fn start(
        &self,
        folder: &ShotFolder,
        force: bool,
        max_memory: Option<u64>,
        control: Control,
    ) -> Result<(), RunError> {
        let is_same =
            |a: &Path, b: &Path| a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b));
        if is_same(self.parent.root(), folder.root()) {
            return Err(RunError::Request(format!(
                "--from {}: the branch needs a folder of its own; name another one with -o than {}",
                self.first.0,
                printable_path(folder.root())
            )));
        }
        simulate::refuse_foreign_preset(folder)?;
        solids::refuse_assets(&self.scene, folder)?;
        ShotFolder::create(&folder.cache())?;
        let _lock = cache::Lock::acquire_past_probes(&folder.cache())?;
        if !force {
            stale::refuse_others(folder, &self.scene)?;
        }
        let keys = self.scene.frame_keys();
        let is_there = |index| {
            let found = cache::verify_frame(&cache::frame_path(&folder.cache(), index));
            found.is_ok_and(|found| found.key == keys.of(index))
        };
        let mut shared = Vec::new();
        for (index, path) in
            cache::list(&self.parent.cache())?.into_iter().filter(|(index, _)| *index < self.first)
        {
            if !is_there(index) {
                keys.expect(&cache::verify_frame(&path)?, &path)?;
                shared.push((index, path));
            }
        }
        // What is there is given up only when the branch is known to start.
        let first = match is_there(self.first) {
            true => None,
            false => Some(self.first_frame(folder, max_memory, control)?),
        };
        let mut copied = 0;
        for (index, path) in &shared {
            copied += usize::from(!link(path, &cache::frame_path(&folder.cache(), *index))?);
        }
        if let Some(frame) = &first {
            cache::write_frame(&folder.cache(), frame, keys.of(self.first))?;
            let how = if copied > 0 { ", which could not be linked, so that they were copied" } else { "" };
            control.reporter.note(&format!(
                "branches from frame {} of {}: {} frames before it are shared{how}",
                self.first,
                printable_path(self.parent.root()),
                shared.len()
            ));
        }
        let new = shared.into_iter().map(|(index, _)| index).chain(first.map(|frame| frame.index));
        self.keep_log(folder, &new.collect())
    }

    /// The branch's first frame: the state of the shot's, with what the new settings change in it.
    fn first_frame(
        &self,
        folder: &ShotFolder,
        max_memory: Option<u64>,
        control: Control,
    ) -> Result<Frame, RunError> {
        let path = cache::frame_path(&self.parent.cache(), self.first);
        let (frame, info) = cache::read_frame_within(&path, max_memory)?;
        self.before.frame_keys().expect(&info, &path)?;
        let before = solids::fill(&self.before, Some(folder), control.reporter)?;
        let after = solids::fill(&self.scene, Some(folder), control.reporter)?;
        let branched = Simulation::branch(
            &frame,
            (before.surroundings(), before.systems()),
            (after.surroundings(), after.systems()),
        );
        let branched = branched.map_err(|why| {
            RunError::Request(format!(
                "--from {}: {why}; settings that need it cannot be added in the middle of a shot: simulate it from its start",
                self.first.0
            ))
        })?;
        Ok(branched.frame(self.first))
    }

    /// Takes over the log's lines about frames that are new in the folder.
    fn keep_log(&self, folder: &ShotFolder, new: &BTreeSet<FrameIndex>) -> Result<(), RunError> {
        if new.is_empty() {
            return Ok(());
        }
        log::retain(folder, |index| !new.contains(&index))?;
        let lines = log::read::<FrameRecord>(&self.parent)?;
        lines
            .iter()
            .filter(|(index, _)| new.contains(index))
            .try_for_each(|(_, line)| log::append(folder, line))
    }
}

/// Refuses changes of settings that have no effect, or another meaning, in the middle of a shot.
fn refuse_fixed(before: &Scene, scene: &Scene, first: FrameIndex) -> Result<(), RunError> {
    let fixed = || FIXED.iter().chain(registry::ALL.iter().flat_map(|system| system.fixed_at_branches()));
    let refused: Vec<String> = stale::differences(before, scene)
        .into_iter()
        .filter(|difference| fixed().any(|pattern| is_or_holds(&difference.key, pattern)))
        .map(|difference| format!("  {}", difference.line))
        .collect();
    if refused.is_empty() {
        return Ok(());
    }
    Err(RunError::Request(format!(
        "--from {}: what decides how a shot starts cannot change in the middle of it; simulate it from its start, or leave out\n{}",
        first.0,
        refused.join("\n")
    )))
}

/// Whether one of the keys lies in the table of the other; in `pattern`, `*` is any index.
fn is_or_holds(key: &str, pattern: &str) -> bool {
    key.split('.').zip(pattern.split('.')).all(|(key, pattern)| pattern == "*" || key == pattern)
}

/// Makes `target` the same file as the frame at `path`, or a copy of it where that cannot be. Returns whether it is the same.
fn link(path: &Path, target: &PathBuf) -> Result<bool, RunError> {
    let failed = |source| RunError::File {
        path: target.clone(),
        source,
        next: "check that the folder can be written",
    };
    match std::fs::remove_file(target) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(failed(error)),
        _ => {}
    }
    // A link to a symbolic link would lead elsewhere from there.
    let is_file = std::fs::symlink_metadata(path).is_ok_and(|found| found.is_file());
    if is_file && std::fs::hard_link(path, target).is_ok() {
        return Ok(true);
    }
    let (mut file, _) = cache::open_regular(path).map_err(failed)?;
    cache::write_atomically(target, |out| io::copy(&mut file, out).map(drop)).map_err(failed)?;
    Ok(false)
}

/// Why the shot has no such frame.
fn explain(parent: &ShotFolder, first: FrameIndex, why: CacheError) -> RunError {
    let CacheError::NotFound { .. } = why else { return why.into() };
    let before = cache::list(&parent.cache()).unwrap_or_default();
    let nearest = before.iter().map(|(index, _)| index.0).min_by_key(|index| index.abs_diff(first.0));
    let nearest =
        nearest.map_or_else(|| "it has none".to_owned(), |index| format!("the nearest is frame {index}"));
    RunError::Request(format!(
        "--from {}: {} has no such cached frame; {nearest}",
        first.0,
        printable_path(parent.root())
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_fixed_with_the_tables_around_them() {
        for (key, pattern, fixed) in [
            ("liquid.spacing", "liquid.spacing", true),
            ("liquid", "liquid.spacing", true),
            ("liquid.source.0.velocity", "liquid.source", true),
            ("liquid.emitter.3.shape.box.max", "liquid.emitter.*.shape", true),
            ("liquid.emitter", "liquid.emitter.*.shape", true),
            ("liquid.emitter.3.rate", "liquid.emitter.*.shape", false),
            ("liquid.viscosity", "liquid.spacing", false),
            ("liquids", "liquid.spacing", false),
        ] {
            assert_eq!(is_or_holds(key, pattern), fixed, "{key} {pattern}");
        }
    }
}
