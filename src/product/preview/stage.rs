//! What is the same in all pictures of a shot: camera, ground, light, the scale of speeds.

use super::{
    evenly,
    props::{Props, text},
    settings::{ParticleLook, PreviewParams},
};
use crate::{
    cache,
    frame::{Frame, Stream, StreamKind},
    image::render::{Bounds, Viewpoint},
    job::{RunError, batch::RequestedFrame},
    math::Vec3,
    preset::Camera,
    product::colors::StreamColors,
    sim::scene::Scene,
    solid::body_poses,
};
use nalgebra::Vector3;
use std::path::Path;

/// Frames that decide camera, ground and scale of speeds, as many as the Blender extension looks at.
const LOOKED_AT_FRAMES: usize = 5;

/// Part of the points at either end of each axis that the camera need not show: a few thrown drops must not push it away.
const BOX_CUT: f64 = 0.002;

/// A collider that is larger by this factor than what moves need not be in the picture.
const MAX_COLLIDER_SIZE: f64 = 2.5;

/// How far solids that carry what moves may go below it before they stand on the ground, as a part of its size.
const MAX_FOUNDATION: f64 = 0.03;

/// Distance of the ground below what stands on nothing else, as a part of its size.
const GROUND_GAP: f64 = 0.002;

/// Part of the particles that are faster than the largest speed of the scale.
const FASTEST: f64 = 0.002;

/// The settings of all pictures of a shot.
pub(super) struct Stage {
    pub(super) props: Props,
    pub(super) colors: StreamColors,
    pub(super) view: Viewpoint,
    pub(super) ground: Option<f64>,
    pub(super) bounds: Bounds,
    /// The largest speed of the scale [m/s].
    pub(super) speed: f32,
    pub(super) is_dark: bool,
    pub(super) particles: ParticleLook,
    /// All that decides them, for the keys of files.
    pub(super) text: String,
}

/// What the frames that were looked at have.
struct Found {
    /// Points that move.
    moving: Bounds,
    /// Rigid bodies.
    bodies: Bounds,
    /// The boxes of solids, by their number.
    solids: Vec<Bounds>,
    speed: f32,
    kinds: Vec<StreamKind>,
}

impl Stage {
    /// The stage of a shot, of which some of these frames are looked at.
    ///
    /// # Errors
    /// If no frame can be read or none has anything to show; if a mesh of the scene cannot be read.
    pub(super) fn new(
        scene: Option<&Scene>,
        camera: Option<Camera>,
        frames: &[RequestedFrame],
        params: &PreviewParams,
        max_memory: Option<u64>,
    ) -> Result<Self, RunError> {
        let props = scene.map(Props::new).transpose()?.unwrap_or_default();
        let paths: Vec<&Path> = frames.iter().filter_map(|(_, path)| path.as_deref()).collect();
        let found = look_at(&props, &paths, max_memory)?;
        let Found { moving, bodies, solids, speed, kinds } = found;
        // Bodies that fly off do not widen a picture of what they leave behind.
        let moving = if moving.exists() { moving } else { bodies };
        let size = moving.size();
        let near = |solid: &&Bounds| !moving.exists() || solid.size() <= MAX_COLLIDER_SIZE * size;
        let bounds = solids.iter().filter(near).fold(moving, |all, solid| all.union(solid));
        if !bounds.exists() {
            return Err(RunError::Request(
                "found nothing to show in the frames that were looked at, expected particles, points of smoke, sheets or rigid bodies within 10⁹ m; \
                 `meniscus info` lists what is in the frames"
                    .into(),
            ));
        }
        let [width, height] = params.size.map(|side| side as f64);
        let view = view(camera.or(scene.and_then(|scene| scene.camera)), &bounds, width / height)?;
        let ground = Some(ground(&props, &moving, &bounds, &solids));
        let is_dark = kinds.contains(&StreamKind::Tracers);
        let settings = scene.map(text).unwrap_or_default();
        let colors = StreamColors::of(scene);
        let shown = if params.particles == ParticleLook::Surface { colors.all_text() } else { String::new() };
        let text = format!(
            "{view:?} {bounds:?} {ground:?} {speed} {is_dark} {:?} {settings}{shown}",
            params.particles
        );
        Ok(Self { props, colors, view, ground, bounds, speed, is_dark, particles: params.particles, text })
    }
}

/// The camera of the preset, or else one that shows the bounds in pictures of an aspect.
///
/// # Errors
/// If the bounds are so far away or so large that no camera within 10⁹ m shows them.
fn view(given: Option<Camera>, bounds: &Bounds, aspect: f64) -> Result<Viewpoint, RunError> {
    let given = given.map(|camera| Viewpoint {
        position: camera.position.map(f64::from),
        target: camera.target.map(f64::from),
        focal_length: camera.focal_length.into(),
    });
    let view = given.filter(Viewpoint::is_valid).unwrap_or_else(|| Viewpoint::framing(bounds, aspect));
    if view.is_valid() {
        return Ok(view);
    }
    let [low, high] = [bounds.low, bounds.high].map(|corner| format!("{:?}", corner.as_slice()));
    Err(RunError::Request(format!(
        "found a shot from {low} to {high} m, expected one that a camera within 10⁹ m of the origin shows; \
         `[camera]` in the preset places the camera"
    )))
}

/// Looks at frames from the first to the last, at equal distances.
fn look_at(props: &Props, paths: &[&Path], max_memory: Option<u64>) -> Result<Found, RunError> {
    let (moving, bodies) = (Bounds::empty(), Bounds::empty());
    let mut found = Found { moving, bodies, solids: Vec::new(), speed: 0.0, kinds: Vec::new() };
    let mut unread = None;
    let mut read = 0;
    for place in evenly(paths.len(), LOOKED_AT_FRAMES) {
        let frame = match cache::read_frame_within(paths[place], max_memory) {
            Ok((frame, _)) => frame,
            Err(why) => {
                unread = unread.or(Some(why));
                continue;
            }
        };
        read += 1;
        found.add(&frame, props);
    }
    match unread {
        Some(why) if read == 0 => Err(why.into()),
        _ => Ok(found),
    }
}

impl Found {
    fn add(&mut self, frame: &Frame, props: &Props) {
        for stream in &frame.streams {
            self.kinds.push(stream.kind);
            if let Some(bounds) = extent(stream) {
                self.moving = self.moving.union(&bounds);
            }
            if stream.kind == StreamKind::Particles {
                self.speed = self.speed.max(fastest(stream).unwrap_or(0.0));
            }
        }
        let poses = body_poses(&frame.streams);
        self.bodies = props.body_boxes(&poses).fold(self.bodies, |all, own| all.union(&own));
        let boxes = props.boxes(frame.time, &poses);
        self.solids.resize(self.solids.len().max(boxes.len()), Bounds::empty());
        for (all, own) in self.solids.iter_mut().zip(boxes) {
            *all = all.union(&own);
        }
    }
}

/// Whether entries of a kind are shown as points of something that moves.
fn is_shown(kind: StreamKind) -> bool {
    matches!(kind, StreamKind::Particles | StreamKind::Tracers | StreamKind::MeshPoints)
}

/// The box around the points of a stream but for a few at either end of each axis, half a spacing wider.
fn extent(stream: &Stream) -> Option<Bounds> {
    let positions = stream.vec3("position").filter(|_| is_shown(stream.kind))?;
    let is_near = |x: &&Vec3| x.iter().all(|x| x.abs() <= 1e9);
    let mut places: [Vec<f32>; 3] = Default::default();
    for x in positions.iter().filter(is_near) {
        (0..3).for_each(|axis| places[axis].push(x[axis]));
    }
    let count = places[0].len();
    if count == 0 {
        return None;
    }
    let cut = ((count as f64 * BOX_CUT) as usize).min((count - 1) / 2);
    let margin = stream.spacing().map_or(0.0, |spacing| 0.5 * f64::from(spacing));
    let mut at =
        |axis: usize, place: usize| f64::from(*places[axis].select_nth_unstable_by(place, f32::total_cmp).1);
    let low = Vector3::from_fn(|axis, _| at(axis, cut) - margin);
    let high = Vector3::from_fn(|axis, _| at(axis, count - 1 - cut) + margin);
    Some(Bounds { low, high })
}

/// The speed that all but a few particles of a stream do not exceed [m/s].
fn fastest(stream: &Stream) -> Option<f32> {
    let velocities = stream.vec3("velocity")?;
    let mut speeds: Vec<f32> = velocities.iter().map(|v| v.norm()).filter(|v| v.is_finite()).collect();
    let last = speeds.len().checked_sub(1)?;
    let place = last - (speeds.len() as f64 * FASTEST) as usize;
    Some(*speeds.select_nth_unstable_by(place, f32::total_cmp).1)
}

/// The height of the ground: that of a floor, of the lowest solid that carries what moves, of a tank's bottom, or just below what moves.
fn ground(props: &Props, moving: &Bounds, bounds: &Bounds, solids: &[Bounds]) -> f64 {
    if let Some(height) = props.floor() {
        return height;
    }
    let shown = if moving.exists() { moving } else { bounds };
    let size = shown.size();
    let carries = |solid: &&Bounds| {
        (0..2).all(|axis| solid.low[axis] <= shown.low[axis] && solid.high[axis] >= shown.high[axis])
    };
    let lowest = solids.iter().filter(carries).map(|solid| solid.low.z).fold(f64::INFINITY, f64::min);
    if lowest < shown.low.z - MAX_FOUNDATION * size {
        return lowest;
    }
    let tanks = props.tanks();
    let bottom =
        tanks.iter().map(|tank| tank.low.z).filter(|z| (z - shown.low.z).abs() < MAX_FOUNDATION * size);
    bottom.fold(bounds.low.z, f64::min) - GROUND_GAP * size
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_that_no_camera_within_reach_shows_are_refused() {
        let cube = |side: f64| Bounds { low: Vector3::repeat(-side), high: Vector3::repeat(side) };
        assert!(view(None, &cube(1e8), 1.8).unwrap().is_valid());
        assert!(cube(9e8).exists());
        let why = view(None, &cube(9e8), 1.8).unwrap_err().to_string();
        assert!(why.contains("900000000.0") && why.contains("[camera]"), "{why}");
        // The preset's camera shows them all the same.
        let camera = Camera { position: [0.0, -9.0, 0.0], target: [0.0; 3], focal_length: 50.0 };
        assert_eq!(view(Some(camera), &cube(9e8), 1.8).unwrap().position, [0.0, -9.0, 0.0]);
    }
}
