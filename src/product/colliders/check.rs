//! Checks of the colliders of a preset, before its frames are simulated.

use super::motion::pose_count;
use crate::{
    job::MAX_POSES,
    preset::{check::Places, problem::Finding},
    sim::scene::Scene,
};

/// The largest number of colliders and rigid bodies that are written: a manifest has 1000 outputs at most, those of systems among them.
pub(super) const MAX_COLLIDERS: usize = 500;

/// Reports colliders that are too many, or move in too many frames, for their files.
pub(super) fn check(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let all = scene.world.collider.iter().enumerate();
    let shown: Vec<_> = all.filter(|(_, collider)| collider.shown_look().is_some()).collect();
    let count = shown.len() + scene.body.len();
    if count > MAX_COLLIDERS {
        let key = match shown.get(MAX_COLLIDERS) {
            Some((index, _)) => format!("world.collider.{index}"),
            None => format!("body.{}", MAX_COLLIDERS - shown.len()),
        };
        let message = "there are more colliders and bodies than a shot can list".to_owned();
        let label = format!("found {count} colliders and bodies to write, expected at most {MAX_COLLIDERS}");
        let finding = Finding::new(places.of(&key), &key, message, label);
        findings.push(finding.with_help("remove some, or join several colliders in one mesh file"));
    }
    let frames = scene.frames.first().0..=scene.frames.last().0;
    let count = u64::from(frames.end() - frames.start()) + 1;
    if !scene.body.is_empty() && count > MAX_POSES {
        let message = "rigid bodies move in too many frames".to_owned();
        let label = format!("found {count} frames, expected at most {MAX_POSES}");
        findings
            .push(Finding::new(places.of("frames"), "frames", message, label).with_help("shorten `frames`"));
    }
    for (index, collider) in shown {
        let count = pose_count(collider, &frames);
        if count > MAX_POSES {
            let key = format!("world.collider.{index}.keyframes");
            let message = format!("`world.collider.{index}` moves in too many frames");
            let label = format!("found a motion of {count} frames, expected at most {MAX_POSES}");
            let finding = Finding::new(places.of(&key), &key, message, label);
            findings
                .push(finding.with_help("bring its first and last keyframes closer, or shorten `frames`"));
        }
    }
}
