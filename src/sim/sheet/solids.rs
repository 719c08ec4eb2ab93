//! Solids: what pushes sheets off before they touch, and what puts back those that slip through.
//!
//! *Method*: [gudukbay97] Eq. 9 with the potential c·exp(−f/ξ) of a square metre, f the signed distance, so that |∇f| = 1 at every solid.
//! The force −∇ of it is (c/ξ) exp(−f/ξ) ∇f, of which only the part along the sheet's normal n acts. What is left inside after a substep is
//! put to the surface, and its speed into the solid ends. Friction takes up to μ times what either took from the speed along the solid, once
//! forces have acted: what rests stays where it is.
//! *Departs from the paper*: the sign, which Eq. 9 and its prose give differently (force outwards is meant); friction; solids move; where a
//! fold leaves a point without a normal ∇f takes its place.
//!
//! Symbols: f → `distance` [m], c → `energy` [J/m²], ξ → `range` [m].
//! Limits: points are kept out, and `clearance` off, not the faces between them: in a ball of radius R the middle of a square face of width w lies w²/4R deeper
//! than its points, and half of that at its edges. What is thinner than a cell pokes through. Faces are counted where one of the places that `cut` asks is inside;
//! what comes through between these is not told. An edge-on sheet is not pushed (n ⊥ ∇f), only put back.

use super::{
    lanes::{Vectors, chunk},
    params::Repulsion,
};
use crate::{
    math::{
        Vec3,
        wide::{WIDTH, Wide},
    },
    par,
    solid::{Pose, Shape, Solid},
};

/// Beyond so many ξ the push is below a ten millionth of that at the surface, which is what single precision keeps of a sum.
const FAR: f32 = 16.0;

/// Rounds over all solids in which a point is put back: in a corner of three each undoes part of the others', and at the rounded corner of a sampled
/// mesh, where the distance grows by half of the way, half of it is left. Of 8, micrometres were left there.
const ROUNDS: usize = 32;

/// How far outside a point is put back to, in parts of its largest coordinate: what rounding takes. Within twice as much it still touches: it
/// would else slide without friction until it has fallen in again, and creep down a slope.
const SKIN: f32 = 1e-6;

/// A solid at both ends of a substep.
pub(super) struct Placed<'a> {
    shape: &'a Shape,
    /// How far off it is kept out of [m].
    clearance: f32,
    poses: Option<[Pose; 2]>,
}

/// The solids between two times [s], larger by a `clearance` [m].
pub(super) fn placed(solids: &[Solid], clearance: f32, from: f64, to: f64) -> Vec<Placed<'_>> {
    let poses = |solid: &Solid| solid.motion.as_ref().map(|motion| [motion.pose(from), motion.pose(to)]);
    solids.iter().map(|solid| Placed { shape: &solid.shape, clearance, poses: poses(solid) }).collect()
}

impl Placed<'_> {
    /// Distance from where its clearance ends, and normal, at one end of the substep.
    pub(super) fn contact(&self, x: Vec3, end: usize) -> (f32, Vec3) {
        self.contact_off(x, end, 1.0)
    }

    /// The same of a part of its clearance.
    fn contact_off(&self, x: Vec3, end: usize, part: f32) -> (f32, Vec3) {
        let (distance, n) = match &self.poses {
            None => self.shape.contact(x),
            Some(poses) => {
                let (d, n) = self.shape.contact(poses[end].to_local(x));
                (d, poses[end].rotation * n)
            }
        };
        (distance - part * self.clearance, n)
    }

    /// The solid's own way during the substep at a place [m].
    pub(super) fn displacement(&self, x: Vec3) -> Vec3 {
        self.poses.as_ref().map_or(Vec3::zeros(), |[from, to]| {
            let local = to.to_local(x);
            to.to_world(local) - from.to_world(local)
        })
    }

    /// The same of what is at a place when the substep begins [m].
    fn displacement_from(&self, x: Vec3) -> Vec3 {
        self.poses.as_ref().map_or(Vec3::zeros(), |[from, to]| to.to_world(from.to_local(x)) - x)
    }
}

/// Faces around points, for normals: the two neighbours of a point in each.
#[derive(Clone, Debug, Default)]
pub(super) struct Around {
    start: Vec<u32>,
    pairs: Vec<[u32; 2]>,
}

impl Around {
    /// Of `count` points.
    pub(super) fn new(count: usize, faces: &[[u32; 4]]) -> Self {
        let mut all = Vec::with_capacity(4 * faces.len());
        for &[a, b, c, d] in faces {
            let corners: &[u32] = if c == d { &[a, b, c] } else { &[a, b, c, d] };
            let n = corners.len();
            for k in 0..n {
                all.push((corners[k], [corners[(k + 1) % n], corners[(k + n - 1) % n]]));
            }
        }
        par::sort_by_key(&mut all, |&entry| entry);
        let mut start = vec![0; count + 1];
        all.iter().for_each(|(i, _)| start[*i as usize + 1] += 1);
        (0..count).for_each(|i| start[i + 1] += start[i]);
        Self { start, pairs: all.into_iter().map(|(_, pair)| pair).collect() }
    }

    /// The unit normal at a point; `None` where faces cancel or there are none.
    pub(super) fn normal(&self, x: &Vectors, i: usize) -> Option<Vec3> {
        let own = x.get(i);
        let pairs = &self.pairs[self.start[i] as usize..self.start[i + 1] as usize];
        let sum: Vec3 =
            pairs.iter().map(|[a, b]| (x.get(*a as usize) - own).cross(&(x.get(*b as usize) - own))).sum();
        let length = sum.norm();
        (length > 0.0 && length.is_finite()).then(|| sum / length)
    }
}

/// A push on a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Push {
    pub(super) point: u32,
    /// Force [N].
    pub(super) force: Vec3,
    /// −∂force/∂x = `stiffness` n nᵀ [N/m].
    pub(super) stiffness: f32,
    /// The sheet's unit normal.
    pub(super) normal: Vec3,
    /// That of the solid, …
    out: Vec3,
    /// … and its speed there [m/s].
    own: Vec3,
}

impl Push {
    /// Friction once the point has the speed `v` [m/s], at the end of a substep of `dt` [s]: what it takes from it. A push that was `solved` has
    /// become less as the point moved away.
    fn rub(&self, friction: f32, v: Vec3, mobility: f32, dt: f32, solved: bool) -> Vec3 {
        let at_start = self.force.dot(&self.normal);
        let less = if solved { self.stiffness * dt * self.normal.dot(&v) } else { 0.0 };
        let pressed = ((at_start - less) * at_start.signum()).max(0.0);
        let slip = v - self.own;
        let slip = slip - self.out * self.out.dot(&slip);
        let speed = slip.norm();
        if speed > 0.0 { slip * (friction * pressed * dt * mobility / speed).min(1.0) } else { slip }
    }
}

/// What the solids, as they are at one `end` of a substep of `dt` [s], push.
pub(super) fn pushes(
    repulsion: &Repulsion,
    (solids, end): (&[Placed<'_>], usize),
    around: &Around,
    (x, area): (&Vectors, &[f32]),
    dt: f32,
) -> Vec<Push> {
    let Repulsion { energy, range } = *repulsion;
    let parts = par::map_chunks(x.len(), par::CHUNK, |points| {
        let mut found = Vec::new();
        for i in points {
            for solid in solids {
                let (distance, out) = solid.contact(x.get(i), end);
                if distance >= FAR * range {
                    continue;
                }
                let normal = around.normal(x, i).unwrap_or(out);
                let at_point = area[i] * energy / range * (-distance.max(0.0) / range).exp();
                let along = out.dot(&normal);
                let force = normal * (at_point * along); // [gudukbay97] Eq. 9
                let stiffness = at_point / range * along * along;
                // The point is where it is as the substep begins: by the way that ends there it would creep off a circle, by ω² r Δt.
                let own = solid.displacement_from(x.get(i)) / dt;
                found.push(Push { point: i as u32, force, stiffness, normal, out, own });
            }
        }
        found
    });
    parts.into_iter().flatten().collect()
}

/// A point in motion, and what rounding took from its place.
#[derive(Clone, Copy)]
struct Moving {
    x: Vec3,
    v: Vec3,
    low: Vec3,
}

impl Moving {
    /// Moves it. Rounding would else let go of the way back, and not of the way there: what rests would stray.
    fn shift(&mut self, by: Vec3) {
        let (way, before) = (by + self.low, self.x);
        self.x += way;
        self.low = way - (self.x - before);
    }
}

/// Calls `f` on points; `points` are asked for those of a range. It returns `None` where it left one alone, and else whether it counts.
/// Returns how many count.
fn move_each<I: Iterator<Item = usize>>(
    [x, v, low]: [&mut Vectors; 3],
    points: impl Fn(std::ops::Range<usize>) -> I + Sync,
    f: impl Fn(usize, &mut Moving) -> Option<bool> + Sync,
) -> u64 {
    let (len, eights) = (x.len(), x.axes[0].len());
    let ([x0, x1, x2], [v0, v1, v2], [l0, l1, l2]) = (&mut x.axes, &mut v.axes, &mut low.axes);
    let all: [&mut [Wide]; 9] = [x0, x1, x2, v0, v1, v2, l0, l1, l2];
    // Solids cost more than what few points cost elsewhere.
    let counts = par::map_chunks_mut(all, chunk(eights), |start, parts: [&mut [Wide]; 9]| {
        let mut count = 0;
        for i in points(start * WIDTH..len.min((start + parts[0].len()) * WIDTH)) {
            let (at, lane) = (i / WIDTH - start, i % WIDTH);
            let [x, v, low] = [0, 3, 6].map(|of| Vec3::from_fn(|axis, _| parts[of + axis][at][lane]));
            let mut moving = Moving { x, v, low };
            let Some(counts) = f(i, &mut moving) else { continue };
            count += u64::from(counts);
            for (of, vector) in [(0, moving.x), (3, moving.v), (6, moving.low)] {
                (0..3).for_each(|axis| parts[of + axis][at][lane] = vector[axis]);
            }
        }
        count
    });
    counts.into_iter().sum()
}

/// Lets what was pushed rub, at the end of a substep of `dt` [s]; see [`Push::rub`].
pub(super) fn rub(
    pushes: &[Push],
    friction: f32,
    mobility: &[f32],
    sheet: [&mut Vectors; 3],
    (dt, solved): (f32, bool),
) {
    let of = |points: std::ops::Range<usize>| {
        let [first, end] = [points.start, points.end]
            .map(|point| pushes.partition_point(|push| (push.point as usize) < point));
        pushes[first..end].chunk_by(|a, b| a.point == b.point)
    };
    move_each(
        sheet,
        |points| of(points).map(|pushes| pushes[0].point as usize),
        |i, moving| {
            for push in of(i..i + 1).flatten() {
                let taken = push.rub(friction, moving.v, mobility[i], dt, solved);
                // It has slid too far already: else what rests on a slope would creep.
                moving.shift(-taken * dt);
                moving.v -= taken;
            }
            Some(false)
        },
    );
}

/// Puts points that are inside solids at the end of a substep of `dt` [s] back to their surfaces. Points of no mobility stay. Returns
/// how many were.
pub(super) fn put_back(
    solids: &[Placed<'_>],
    friction: Option<f32>,
    mobility: &[f32],
    sheet: [&mut Vectors; 3],
    dt: f32,
) -> u64 {
    let mobile = |points: std::ops::Range<usize>| points.filter(|&i| mobility[i] != 0.0);
    move_each(sheet, mobile, |_, moving| outside(solids, friction, moving, dt))
}

/// Puts a point that is inside a solid, or its clearance, to the surface, and stops one that touches. Whether it was inside any; `None` if it did neither. Between
/// solids that leave less room than their clearances these give way, round by round: no point may end in a solid for the sake of another's clearance.
fn outside(solids: &[Placed<'_>], friction: Option<f32>, point: &mut Moving, dt: f32) -> Option<bool> {
    let (mut caught, mut met) = (false, false);
    for round in 0..ROUNDS {
        let mut again = false;
        let part = (1.5 - 0.25 * round as f32).clamp(0.0, 1.0);
        for solid in solids {
            let (distance, n) = solid.contact_off(point.x, 1, part);
            let skin = SKIN * (1.0 + point.x.amax());
            if distance >= if round == 0 { 2.0 * skin } else { 0.0 } {
                continue;
            }
            let own = solid.displacement(point.x) / dt;
            let relative = point.v - own;
            let inwards = relative.dot(&n);
            if distance >= 0.0 && inwards >= 0.0 {
                continue;
            }
            caught |= distance < 0.0;
            (met, again) = (true, true);
            point.shift(n * (skin - distance));
            let mut slip = relative - n * inwards;
            if let (Some(friction), true) = (friction, inwards < 0.0) {
                let (speed, before) = (slip.norm(), slip);
                slip *= if speed > 0.0 { 1.0 - (-friction * inwards / speed).min(1.0) } else { 0.0 };
                // It has slid too far already: else what rests on a slope would creep.
                point.shift((slip - before) * dt);
            }
            point.v = own + slip + n * inwards.max(0.0);
        }
        if !again {
            break;
        }
    }
    met.then_some(caught)
}

/// Points inside solids at a time [s], but for those that are held exactly.
pub(super) fn inside(solids: &[Solid], time: f64, x: &Vectors, mobility: &[f32]) -> u64 {
    let solids = placed(solids, 0.0, time, time);
    let count = |range: std::ops::Range<usize>| {
        range
            .filter(|&i| mobility[i] > 0.0 && solids.iter().any(|solid| solid.contact(x.get(i), 1).0 < 0.0))
            .count() as u64
    };
    par::map_chunks(x.len(), par::CHUNK, count).into_iter().sum()
}

/// Faces that are inside solids at a time [s], by more than rounding, where they are asked, and how deep the deepest of these places is [m]: at the middles of
/// edges and diagonals, and of triangles. `faces`: of each sheet, and its first point. Faces with corners that are held exactly do not count: they go where
/// they are led.
pub(super) fn cut<'a>(
    solids: &[Solid],
    time: f64,
    (x, mobility): (&Vectors, &[f32]),
    faces: impl Iterator<Item = (&'a [[u32; 4]], u32)>,
) -> (u64, f64) {
    let solids = placed(solids, 0.0, time, time);
    if solids.is_empty() {
        return (0, 0.0);
    }
    let nearest =
        |place: Vec3| solids.iter().map(|solid| solid.contact(place, 1).0).fold(f32::INFINITY, f32::min);
    let depth = |face: [u32; 4]| {
        if face.iter().any(|&i| mobility[i as usize] == 0.0) {
            return 0.0;
        }
        let [a, b, c, d] = face.map(|i| x.get(i as usize));
        // A triangle has its last corner twice, and no second diagonal.
        let is_triangle = face[2] == face[3];
        let middle = if is_triangle { (a + b + c) / 3.0 } else { 0.25 * (a + b + c + d) };
        let last = if is_triangle { middle } else { 0.5 * (b + d) };
        let places = [0.5 * (a + b), 0.5 * (b + c), 0.5 * (a + c), 0.5 * (a + d), 0.5 * (c + d), last];
        // Distances differ by no more than the way, and by less than half more where they are sampled.
        let farthest = places.iter().map(|place| (place - middle).norm()).fold(0.0, f32::max);
        if nearest(middle) > 1.5 * farthest {
            return 0.0;
        }
        places.into_iter().fold(0.0_f32, |deepest, place| {
            let (skin, distance) = (2.0 * SKIN * (1.0 + place.amax()), nearest(place));
            if distance < -skin { deepest.max(-distance) } else { deepest }
        })
    };
    let both = |(count, deepest): (u64, f64), (more, depth): (u64, f64)| (count + more, deepest.max(depth));
    let of_sheet = |(faces, start): (&[[u32; 4]], u32)| {
        let parts = par::map_chunks(faces.len(), par::CHUNK, |range| {
            let depths = faces[range].iter().map(|face| depth(face.map(|i| i + start)));
            depths.map(|depth| (u64::from(depth > 0.0), f64::from(depth))).fold((0, 0.0), both)
        });
        parts.into_iter().fold((0, 0.0), both)
    };
    faces.map(of_sheet).fold((0, 0.0), both)
}
