//! What holds points: pins, leads and joints.
//!
//! *Method*: [gudukbay97] Eq. 8, f = k (p − x) at the one point that is named: the delta function makes a force of it that does not depend on
//! the resolution, and the springs around the point pass it on. A pin without stiffness is exact: the point goes where it says, with the speed
//! of its way there. A joint with a direction n pulls at the ends of d = x_b − x_a
//! by k (n |d| − d (n·d)/|d|), which is across d: it turns the pair and leaves its length alone.
//! *Departs from the paper*: places move by keyframes or with colliders; everything may let go at a frame.
//!
//! Limits: an exact pin drives what hangs on it with any speed its keyframes ask for.

use super::{
    SheetError,
    lanes::Vectors,
    model::Model,
    params::{Pin, Select, SheetShape, SheetsParams},
};
use crate::{
    math::Vec3,
    solid::{Motion, Solid},
};
use std::ops::Range;

/// A point that is held.
#[derive(Clone, Debug)]
pub(super) struct Held {
    pub(super) point: u32,
    /// `None`: exactly.
    pub(super) stiffness: Option<f32>,
    place: Vec3,
    motion: Option<Motion>,
    /// Until then [s].
    until: f64,
}

/// Two points that are joined.
#[derive(Clone, Debug)]
pub(super) struct Joined {
    pub(super) ends: [u32; 2],
    pub(super) stiffness: f32,
    /// Unit vector.
    pub(super) direction: Option<Vec3>,
    until: f64,
}

impl Held {
    /// Whether it still holds.
    pub(super) fn holds(&self, time: f64) -> bool {
        time < self.until
    }

    /// Where the point is to be.
    pub(super) fn place(&self, time: f64) -> Vec3 {
        self.motion.as_ref().map_or(self.place, |motion| motion.pose(time).to_world(self.place))
    }
}

impl Joined {
    /// Whether it still holds.
    pub(super) fn holds(&self, time: f64) -> bool {
        time < self.until
    }
}

/// The time of a frame, a hair before it, so that rounding does not move it into the next.
fn release(frame: Option<u32>, fps: f64, first: u32) -> f64 {
    frame.map_or(f64::INFINITY, |frame| (f64::from(frame) - f64::from(first) - 1e-6) / fps)
}

/// Every pin, of sheets that have the points of these ranges.
pub(super) fn held(
    params: &SheetsParams,
    models: &[Model],
    ranges: &[Range<usize>],
    solids: &[Solid],
    [fps, first]: [f64; 2],
) -> Result<Vec<Held>, SheetError> {
    let mut out = Vec::new();
    for (i, sheet) in params.sheet.iter().enumerate() {
        for (k, pin) in sheet.pin.iter().enumerate() {
            let key = format!("sheet.{i}.pin.{k}");
            let points = select(&pin.at, &models[i], &sheet.shape, format!("{key}.at"))?;
            let motion = motion(pin, solids, key, [fps, first])?;
            for point in points {
                let own = models[i].points[point as usize];
                // With a collider it keeps the place that it has in its axes at the start.
                let start = match (&motion, pin.collider) {
                    (Some(motion), Some(_)) => motion.pose(0.0).to_local(own),
                    _ => own,
                };
                out.push(Held {
                    point: ranges[i].start as u32 + point,
                    stiffness: pin.stiffness,
                    place: pin.place.map_or(start, Vec3::from),
                    motion: motion.clone(),
                    until: release(pin.release, fps, first as u32),
                });
            }
        }
    }
    // Two that hold one point exactly would each want it elsewhere.
    let mut exact: Vec<u32> = out.iter().filter(|pin| pin.stiffness.is_none()).map(|pin| pin.point).collect();
    exact.sort_unstable();
    match exact.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => {
            let sheet = ranges.iter().position(|range| range.contains(&(pair[0] as usize))).unwrap_or(0);
            let expected = "each point is held exactly by one pin at most";
            Err(SheetError::Selection { key: format!("sheet.{sheet}.pin"), found: 2, expected })
        }
        None => Ok(out),
    }
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
    let none = SheetError::Name { key: format!("{key}.collider"), name: number.to_string() };
    solids.get(number as usize).map(|solid| solid.motion.clone()).ok_or(none)
}

/// Every joint.
pub(super) fn joined(
    params: &SheetsParams,
    models: &[Model],
    ranges: &[Range<usize>],
    [fps, first]: [f64; 2],
) -> Result<Vec<Joined>, SheetError> {
    let mut out = Vec::new();
    for (i, joint) in params.common.joint.iter().enumerate() {
        let mut points = [Vec::new(), Vec::new()];
        for (side, found) in points.iter_mut().enumerate() {
            let name = &joint.sheets[side];
            let none = SheetError::Name { key: format!("sheets.joint.{i}.sheets"), name: name.clone() };
            let sheet = params.sheet.iter().position(|sheet| sheet.name == *name).ok_or(none)?;
            let key = format!("sheets.joint.{i}.at");
            let selected = select(&joint.at[side], &models[sheet], &params.sheet[sheet].shape, key)?;
            *found = selected.into_iter().map(|point| ranges[sheet].start as u32 + point).collect();
        }
        if points[0].len() != points[1].len() {
            let (key, expected) = (format!("sheets.joint.{i}.at"), "as many as the other side");
            return Err(SheetError::Selection { key, found: points[1].len(), expected });
        }
        for ends in points[0].iter().zip(&points[1]).map(|(&a, &b)| [a, b]).filter(|[a, b]| a != b) {
            out.push(Joined {
                ends,
                stiffness: joint.stiffness,
                direction: joint.direction.map(|n| Vec3::from(n).normalize()),
                until: release(joint.release, fps, first as u32),
            });
        }
    }
    Ok(out)
}

/// The points that are meant, each once, ascending but for those named by number.
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

/// Adds the forces of soft pins and of joints with a direction.
pub(super) fn add_forces(held: &[Held], joined: &[Joined], time: f64, x: &Vectors, out: &mut Vectors) {
    for pin in held.iter().filter(|pin| pin.holds(time)) {
        if let Some(stiffness) = pin.stiffness {
            let i = pin.point as usize;
            out.add(i, (pin.place(time) - x.get(i)) * stiffness); // [gudukbay97] Eq. 8
        }
    }
    for joint in joined.iter().filter(|joint| joint.holds(time)) {
        let [a, b] = joint.ends.map(|i| i as usize);
        let d = x.get(b) - x.get(a);
        let mut force = d * joint.stiffness;
        if let Some(n) = joint.direction {
            // Across the pair, towards the direction, as far as it is off.
            let length = d.norm().max(f32::MIN_POSITIVE);
            force = (d * (n.dot(&d) / length) - n * length) * joint.stiffness;
        }
        out.add(a, force);
        out.add(b, -force);
    }
}
