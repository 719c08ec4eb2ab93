//! Pins and joints of sheets.
//!
//! *Method*: [gudukbay97] Eq. 8, f = k (p − x) at the one named point. The delta function makes this a force
//! that does not depend on the resolution, and the springs around the point pass it on. A pin without
//! stiffness is exact: the point is at its place, with the velocity of its path. A joint with a direction n
//! pulls at the ends of d = x_b − x_a by k (n |d| − d (n·d)/|d|). This force is across d: it turns the pair
//! and leaves its length alone. A joint without stiffness is exact (`exact_joints.rs`).
//! *Departs from the paper*: places move by keyframes or with colliders; pins and joints may let go at a
//! frame.
//!
//! Limits: an exact pin moves its point with any speed of its keyframes.

use super::{
    SheetError,
    constraints::{JointPair, PinnedPoint},
    exact_joints,
    model::Model,
    params::{Pin, Select, SheetShape, SheetsParams},
    vectors::Vectors,
};
use crate::{
    math::Vec3,
    solid::{Motion, Solid},
};
use std::ops::Range;

/// Largest distance at the start of points that are joined exactly, in parts of 1 m and of their largest
/// coordinate. It covers the rounding errors of one place that two sheets state differently.
const MAX_EXACT_JOINT_GAP: f32 = 1e-5;

/// The time of a frame, slightly earlier, so that rounding does not move it into the next frame.
fn release(frame: Option<u32>, fps: f64, first: u32) -> f64 {
    frame.map_or(f64::INFINITY, |frame| (f64::from(frame) - f64::from(first) - 1e-6) / fps)
}

/// All pinned points; `ranges` holds the points of each sheet.
pub(super) fn pinned_points(
    params: &SheetsParams,
    models: &[Model],
    ranges: &[Range<usize>],
    solids: &[Solid],
    [fps, first]: [f64; 2],
) -> Result<Vec<PinnedPoint>, SheetError> {
    let mut out = Vec::new();
    for (i, sheet) in params.sheet.iter().enumerate() {
        for (k, pin) in sheet.pin.iter().enumerate() {
            let key = format!("sheet.{i}.pin.{k}");
            let points = select(&pin.at, &models[i], &sheet.shape, format!("{key}.at"))?;
            let motion = motion(pin, solids, key, [fps, first])?;
            for point in points {
                let own = models[i].points[point as usize];
                // With a collider the point keeps its place in the collider's axes at the start.
                let start = match (&motion, pin.collider) {
                    (Some(motion), Some(_)) => motion.pose(0.0).to_local(own),
                    _ => own,
                };
                out.push(PinnedPoint {
                    point: ranges[i].start as u32 + point,
                    stiffness: pin.stiffness,
                    place: pin.place.map_or(start, Vec3::from),
                    motion: motion.clone(),
                    until: release(pin.release, fps, first as u32),
                });
            }
        }
    }
    Ok(out)
}

fn motion(
    pin: &Pin,
    solids: &[Solid],
    key: String,
    [fps, first]: [f64; 2],
) -> Result<Option<Motion>, SheetError> {
    let Some(number) = pin.collider else {
        return Ok(Motion::new(&pin.keyframes, pin.interpolation, fps, first as u32));
    };
    let unknown = SheetError::Name { key: format!("{key}.collider"), name: number.to_string() };
    solids.get(number as usize).map(|solid| solid.motion.clone()).ok_or(unknown)
}

/// All joined points.
pub(super) fn joint_pairs(
    params: &SheetsParams,
    models: &[Model],
    ranges: &[Range<usize>],
    [fps, first]: [f64; 2],
) -> Result<Vec<JointPair>, SheetError> {
    let mut out = Vec::new();
    for (i, joint) in params.common.joint.iter().enumerate() {
        let mut points = [Vec::new(), Vec::new()];
        for (side, found) in points.iter_mut().enumerate() {
            let name = &joint.sheets[side];
            let unknown = SheetError::Name { key: format!("sheets.joint.{i}.sheets"), name: name.clone() };
            let sheet = params.sheet.iter().position(|sheet| sheet.name == *name).ok_or(unknown)?;
            let key = format!("sheets.joint.{i}.at");
            let selected = select(&joint.at[side], &models[sheet], &params.sheet[sheet].shape, key)?;
            *found = selected.into_iter().map(|point| ranges[sheet].start as u32 + point).collect();
        }
        if points[0].len() != points[1].len() {
            let (key, expected) = (format!("sheets.joint.{i}.at"), "as many as the other side");
            return Err(SheetError::Selection { key, found: points[1].len(), expected });
        }
        for ends in points[0].iter().zip(&points[1]).map(|(&a, &b)| [a, b]).filter(|[a, b]| a != b) {
            let direction = joint.direction.map(|n| Vec3::from(n).normalize());
            if joint.stiffness.is_none() {
                check_joint_gap(ends.map(|i| place(models, ranges, i)), direction, i)?;
            }
            let until = release(joint.release, fps, first as u32);
            out.push(JointPair { ends, stiffness: joint.stiffness, direction, until });
        }
    }
    Ok(out)
}

/// Position of a point at the start, by its number among all.
fn place(models: &[Model], ranges: &[Range<usize>], point: u32) -> Vec3 {
    let sheet = ranges.partition_point(|range| range.end <= point as usize);
    models[sheet].points[point as usize - ranges[sheet].start]
}

/// Checks that the ends of an exact joint are at the start where it will hold them.
fn check_joint_gap([a, b]: [Vec3; 2], direction: Option<Vec3>, joint: usize) -> Result<(), SheetError> {
    let d = b - a;
    let gap = direction.map_or(d, |n| d - n * n.dot(&d).max(0.0)).norm();
    if gap > MAX_EXACT_JOINT_GAP * (1.0 + a.amax().max(b.amax())) {
        let what = if direction.is_some() { "off its direction" } else { "apart" };
        return Err(SheetError::Apart { key: format!("sheets.joint.{joint}"), distance: gap, what });
    }
    Ok(())
}

/// Checks that each point is held exactly at most once.
///
/// # Errors
/// The first point that two pins or joints hold at different places.
pub(super) fn check_held_once(
    pins: &[PinnedPoint],
    joints: &[JointPair],
    ranges: &[Range<usize>],
) -> Result<(), SheetError> {
    let error = |point: u32, expected| {
        let sheet = ranges.partition_point(|range| range.end <= point as usize);
        Err(SheetError::Selection { key: format!("sheet.{sheet}.pin"), found: 2, expected })
    };
    let mut pinned: Vec<u32> =
        pins.iter().filter(|pin| pin.stiffness.is_none()).map(|pin| pin.point).collect();
    pinned.sort_unstable();
    if let Some(pair) = pinned.windows(2).find(|pair| pair[0] == pair[1]) {
        return error(pair[0], "each point is held exactly by one pin at most");
    }
    let is_pinned = |point: &u32| pinned.binary_search(point).is_ok();
    let exact = || joints.iter().filter(|joint| joint.stiffness.is_none());
    let without_direction = exact().filter(|joint| joint.direction.is_none()).map(|joint| joint.ends);
    for group in exact_joints::groups(without_direction) {
        if group.iter().filter(|&point| is_pinned(point)).count() > 1 {
            return error(group[0], "points that are joined exactly are held exactly by one pin at most");
        }
    }
    for (k, joint) in exact().enumerate().filter(|(_, joint)| joint.direction.is_some()) {
        let shared =
            |point: &&u32| exact().enumerate().any(|(other, joint)| other != k && joint.ends.contains(point));
        if let Some(&point) = joint.ends.iter().find(shared) {
            return error(
                point,
                "a point that keeps a direction exactly has no other exact joint; give one a stiffness",
            );
        }
        if joint.ends.iter().all(is_pinned) {
            return error(
                joint.ends[0],
                "of a pair that keeps a direction exactly one point is held exactly at most",
            );
        }
    }
    Ok(())
}

/// The selected points, each once, in ascending order unless they are named by number.
fn select(at: &Select, model: &Model, shape: &SheetShape, key: String) -> Result<Vec<u32>, SheetError> {
    let points = &model.points;
    let all = 0..points.len() as u32;
    let nearest = |x: Vec3| {
        let far = |&i: &u32| (points[i as usize] - x).norm_squared();
        all.clone().min_by(|a, b| far(a).total_cmp(&far(b))).into_iter().collect::<Vec<u32>>()
    };
    let found = match at {
        Select::Corners => match (shape, model.grid) {
            (SheetShape::Grid { .. }, Some([n, m])) => {
                let mut corners = vec![0, n - 1, n * (m - 1), n * m - 1];
                corners.sort_unstable();
                corners.dedup();
                corners
            }
            _ => Vec::new(),
        },
        Select::Center => {
            let sum: nalgebra::Vector3<f64> =
                points.iter().zip(&model.area).map(|(x, &a)| x.cast::<f64>() * a).sum();
            nearest((sum / model.area.iter().sum::<f64>()).cast())
        }
        Select::Nearest(x) => nearest(Vec3::from(*x)),
        Select::Inside(shape) => all.filter(|&i| shape.signed_distance(points[i as usize]) <= 0.0).collect(),
        Select::Points(list) => {
            let count = points.len() as u32;
            if let Some(&point) = list.iter().find(|&&i| i >= count) {
                return Err(SheetError::NoSuchPoint { key, point, count });
            }
            list.clone()
        }
    };
    let expected = "at least one is needed";
    if found.is_empty() { Err(SheetError::Selection { key, found: 0, expected }) } else { Ok(found) }
}

/// Adds the forces of soft pins and joints that hold at `time` [s], with the places of pins at `place` [s].
pub(super) fn add_forces(
    pins: &[PinnedPoint],
    joints: &[JointPair],
    [time, place]: [f64; 2],
    x: &Vectors,
    out: &mut Vectors,
) {
    for pin in pins.iter().filter(|pin| pin.holds(time)) {
        if let Some(stiffness) = pin.stiffness {
            let i = pin.point as usize;
            out.add(i, (pin.place(place) - x.get(i)) * stiffness); // [gudukbay97] Eq. 8
        }
    }
    for joint in joints.iter().filter(|joint| joint.holds(time)) {
        let Some(stiffness) = joint.stiffness else { continue };
        let [a, b] = joint.ends.map(|i| i as usize);
        let d = x.get(b) - x.get(a);
        let mut force = d * stiffness;
        if let Some(n) = joint.direction {
            // Across the pair, towards the direction, in proportion to the deviation.
            let length = d.norm().max(f32::MIN_POSITIVE);
            force = (d * (n.dot(&d) / length) - n * length) * stiffness;
        }
        out.add(a, force);
        out.add(b, -force);
    }
}
