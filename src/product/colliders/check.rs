//! Checks of the colliders of a preset, before its frames are simulated.

use super::motion::{MAX_POSES, pose_count};
use crate::{
    preset::{check::Places, problem::Finding},
    sim::scene::Scene,
};

/// The largest number of colliders that are written: a manifest has 1000 outputs at most, those of systems among them.
pub(super) const MAX_COLLIDERS: usize = 500;

/// Reports colliders that are too many, or move in too many frames, for their files.
pub(super) fn check(scene: &Scene, places: &Places, findings: &mut Vec<Finding>) {
    let all = scene.world.collider.iter().enumerate();
    let shown: Vec<_> = all.filter(|(_, collider)| collider.shown_look().is_some()).collect();
    if let Some((index, _)) = shown.get(MAX_COLLIDERS) {
        let key = format!("world.collider.{index}");
        let message = "`world.collider` has more colliders than a shot can list".to_owned();
        let label = format!("found {} colliders to write, expected at most {MAX_COLLIDERS}", shown.len());
        let finding = Finding::new(places.of(&key), &key, message, label);
        findings.push(finding.with_help("join several of them in one mesh file"));
    }
    let frames = scene.frames.first().0..=scene.frames.last().0;
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
