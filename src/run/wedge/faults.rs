//! Faults of wedges that a comparison reports.

use super::list::{Wedge, WedgeList};
use crate::{
    job::{FailedFrame, Failure, Manifest, RunError, ShotFolder},
    run::{frame_ranges, info::Info, recorded_scene, verify::requested_frames},
};
use std::collections::BTreeSet;

/// Missing frames that a message names.
const MAX_NAMED_FRAMES: usize = 100;

/// What is wrong, and why.
pub(super) type Fault = (Failure, String);

/// Compares a wedge's preset with the values of the list: they differ when its folder was renamed, or the preset edited.
pub(super) fn of_values(shot: &ShotFolder, list: &WedgeList, wedge: &Wedge) -> Option<Fault> {
    let foreign = |why: String| Some((Failure::Foreign, why));
    let scenes = [&[], list.settings(wedge).as_slice()].map(|set| recorded_scene(shot, set));
    match scenes {
        [Ok(Some(found)), Ok(Some(expected))] if found == expected => None,
        [Ok(Some(_)), Ok(Some(_))] => foreign(
            "its preset.toml has other values: the folder was renamed, or the preset edited; rename it, or make the wedges again"
                .into(),
        ),
        [Err(why), _] | [_, Err(why)] => foreign(format!("the values of its preset.toml are not known: {why}")),
        _ => foreign("its preset.toml is missing, so that its values are not known: make the wedges again".into()),
    }
}

/// The gravest fault of the frames of a wedge; one of another shot before all others, since a picture of it would have the wrong label.
pub(super) fn of_frames(shot: &ShotFolder, info: &Info) -> Result<Option<Fault>, RunError> {
    let Some(manifest) = Manifest::read(shot)? else {
        let why = "shot.json is missing, so that its frames may be of another shot: simulate it again";
        return Ok(Some((Failure::Missing, why.into())));
    };
    let faults = info.frames.iter().filter_map(|frame| Some((frame.failure?, frame.fault.clone()?)));
    let gravest = faults.min_by_key(|(kind, _)| (*kind != Failure::Foreign, *kind));
    if gravest.is_some() {
        return Ok(gravest);
    }
    let present: BTreeSet<u32> = info.frames.iter().map(|frame| frame.frame).collect();
    let missing: Vec<u32> = requested_frames(&manifest).difference(&present).copied().collect();
    let named = &missing[..missing.len().min(MAX_NAMED_FRAMES)];
    let more = if named.len() < missing.len() { ",…" } else { "" };
    let fault = || (Failure::Other, format!("missing frames: {}{more}", frame_ranges(named)));
    Ok((!missing.is_empty()).then(fault))
}

/// A fault of a wedge as errors list it.
pub(super) fn named(list: &WedgeList, place: usize, (kind, why): Fault) -> FailedFrame {
    FailedFrame { name: list.numbered(place), why, kind }
}
