//! Poses of rigid bodies in the frames of a cache.

use super::motion::MotionFile;
use crate::{
    cache,
    frame::{Stream, StreamKind},
    job::{MAX_POSES, RunError, batch::RequestedFrame},
    math::Vec3,
    sim::{rigid::BodyParams, scene::Scene},
    solid::Look,
};

/// Largest coordinate of a pose in a file [m]: docs/formats/shot.md.
const MAX_PLACE: f32 = 1e9;

/// The motion of every body of a scene, from the first of `frames` to the last. In frames that are missing between, a body is where it
/// was before.
///
/// # Errors
/// [`RunError`] if a frame cannot be read or lacks a body.
pub(super) fn motions(scene: &Scene, frames: &[RequestedFrame]) -> Result<Vec<MotionFile>, RunError> {
    let cached: Vec<_> = frames.iter().filter_map(|(index, path)| Some((index, path.as_ref()?))).collect();
    let (Some(&(first, _)), Some(&(last, _)), false) = (cached.first(), cached.last(), scene.body.is_empty())
    else {
        return Ok(Vec::new());
    };
    let count = u64::from(last.0 - first.0) + 1;
    if count > MAX_POSES {
        return Err(RunError::Request(format!(
            "found cached frames of rigid bodies from {} to {}, expected at most {MAX_POSES}; remove those that are far from the others",
            first.0, last.0
        )));
    }
    let mut poses: Vec<Vec<[f32; 7]>> = vec![Vec::new(); scene.body.len()];
    for (index, path) in cached {
        let frame = cache::read_streams(path, StreamKind::RigidBodies)?;
        let found = frame.streams.first().and_then(poses_of).filter(|found| found.len() == poses.len());
        let found = found.ok_or_else(|| {
            RunError::Request(format!(
                "{}: found no poses of the {} bodies of the preset; simulate the frame again with --force",
                path.display(),
                poses.len()
            ))
        })?;
        let missing = (index.0 - first.0) as usize;
        if !found.iter().flat_map(|pose| &pose[..3]).all(|place| place.abs() <= MAX_PLACE) {
            return Err(RunError::Request(format!(
                "{}: found a rigid body farther than {MAX_PLACE:e} m from the origin, which files of poses cannot hold; shorten the shot",
                path.display()
            )));
        }
        for (poses, pose) in poses.iter_mut().zip(found) {
            let before = poses.last().copied().unwrap_or(pose);
            poses.resize(missing, before);
            poses.push(continued(pose, before));
        }
    }
    let motion = |(body, poses): (&BodyParams, Vec<[f32; 7]>)| {
        MotionFile::of_poses(body.shape.name(), body.look.unwrap_or(Look::Matte), first.0, poses)
    };
    Ok(scene.body.iter().zip(poses).map(motion).collect())
}

/// Position and quaternion (w, x, y, z) of each body.
fn poses_of(stream: &Stream) -> Option<Vec<[f32; 7]>> {
    let (positions, turns) = (stream.vec3("position")?, stream.vec3("rotation")?);
    let pose = |((x, q), &w): ((&Vec3, &Vec3), &f32)| [x.x, x.y, x.z, w, q.x, q.y, q.z];
    Some(positions.iter().zip(turns).zip(stream.f32("rotation_w")?).map(pose).collect())
}

/// The pose with that of its two quaternions which is nearer to the one before, so that components can be interpolated.
fn continued(mut pose: [f32; 7], before: [f32; 7]) -> [f32; 7] {
    let dot: f32 = (3..7).map(|i| pose[i] * before[i]).sum();
    if dot < 0.0 {
        pose[3..].iter_mut().for_each(|part| *part = -*part);
    }
    pose
}
