//! What a comparison of wedges cannot show, or would show under the wrong values.

use super::list::{Wedge, WedgeList};
use crate::{
    cache,
    job::{FailedFrame, Failure, Manifest, RunError, ShotFolder},
    run::{frame_ranges, info::Info, verify::requested_frames},
    scene::{self, Overrides, Scene},
};
use std::collections::BTreeSet;

/// Missing frames that a message names.
const MAX_NAMED_FRAMES: usize = 100;

/// Why a wedge is not that of the list, if its preset has other values: when its folder was renamed, or the preset edited.
pub(super) fn of_values(shot: &ShotFolder, list: &WedgeList, wedge: &Wedge) -> Option<(Failure, String)> {
    let foreign = |why: &str| Some((Failure::Foreign, why.to_owned()));
    let path = shot.preset();
    if cache::leads_out(shot.root(), &path) {
        return foreign("its preset.toml is a link that leads out of its folder: replace it by a copy");
    }
    let read = || {
        let preset = scene::load(&path.to_string_lossy())?;
        let scene = |set| Scene::from_preset(&preset, &Overrides { quality: None, set });
        Ok::<_, RunError>(scene(Vec::new())? == scene(list.settings(wedge))?)
    };
    match read() {
        Ok(true) => None,
        Ok(false) => foreign(
            "its preset.toml has other values: the folder was renamed, or the preset edited; rename it, or make the wedges again",
        ),
        Err(why) => foreign(&format!("the values of its preset.toml are not known: {why}")),
    }
}

/// The gravest fault of the frames of a wedge.
pub(super) fn of_frames(shot: &ShotFolder, info: &Info) -> Option<(Failure, String)> {
    let manifest = match Manifest::read(shot) {
        Ok(Some(manifest)) => manifest,
        Ok(None) => return Some((Failure::Missing, "shot.json is missing: simulate it again".into())),
        Err(RunError::Cache(why)) => return Some((Failure::of(&why), why.to_string())),
        Err(why) => return Some((Failure::Other, why.to_string())),
    };
    let faults = || info.frames.iter().filter_map(|frame| Some((frame.failure?, frame.fault.clone()?)));
    // A frame of another shot is the gravest here: a picture of it would have the wrong label.
    if let Some(fault) = faults().find(|(kind, _)| *kind == Failure::Foreign).or_else(|| faults().next()) {
        return Some(fault);
    }
    let present: BTreeSet<u32> = info.frames.iter().map(|frame| frame.frame).collect();
    let missing: Vec<u32> = requested_frames(&manifest).difference(&present).copied().collect();
    let named = &missing[..missing.len().min(MAX_NAMED_FRAMES)];
    let more = if named.len() < missing.len() { ",…" } else { "" };
    (!missing.is_empty()).then(|| (Failure::Other, format!("missing frames: {}{more}", frame_ranges(named))))
}

/// A fault of a wedge as errors list it.
pub(super) fn named(list: &WedgeList, place: usize, (kind, why): (Failure, String)) -> FailedFrame {
    FailedFrame { name: list.numbered(place), why, kind }
}
