//! Collisions of sheets with solids: repulsion before they touch, and projection out of solids.
//!
//! *Method*: [gudukbay97] Eq. 9 with the potential c·exp(−f/ξ) per square metre, f the signed distance, so
//! that |∇f| = 1 at every solid. Its force −∇ is (c/ξ) exp(−f/ξ) ∇f, of which only the part along the sheet's
//! normal n acts. A point inside a solid after a substep is projected to the surface, and its velocity into
//! the solid is removed. Friction removes up to μ times the change of normal velocity from the velocity along
//! the solid, after forces have acted. Points at rest therefore stay at rest.
//! *Departs from the paper*: the sign, which Eq. 9 and its prose give differently (an outward force is
//! meant); friction; solids move; ∇f replaces n where a fold leaves a point without a normal.
//!
//! Symbols: f → `distance` [m], c → `energy` [J/m²], ξ → `range` [m].
//! Limits: points keep out of solids and `clearance` off, but not the faces between them. In a ball of radius
//! R the middle of a square face of width w lies w²/4R deeper than its points, and half of that at its edges.
//! A solid thinner than a cell pokes through. Faces count as cut where one of the sample places of `cut` is
//! inside; a penetration between these is not reported. An edge-on sheet is not repelled (n ⊥ ∇f), only
//! projected.

use super::{
    params::Repulsion,
    vectors::{Vectors, chunk_len},
};
use crate::math::elementary::exp;
use crate::{
    math::Vec3,
    par,
    simd::{F32x8, LANES},
    solid::{Pose, Shape, Solid},
};
use std::borrow::Cow;

/// Range of repulsion in ξ: beyond it the force is below a ten millionth of that at the surface, the
/// precision of a sum in single precision.
const REPULSION_RANGE: f32 = 16.0;

/// Passes over all solids in which a point is projected out. In a corner of three solids each projection
/// undoes part of the others. At the rounded corner of a sampled mesh, where the distance grows by half the
/// displacement, half the depth is left. With 8 passes, micrometres were left there.
const MAX_PROJECTION_PASSES: usize = 32;

/// Distance outside a solid to which a point is projected, relative to its largest coordinate: the rounding
/// error. Up to twice this distance it still is in contact. Otherwise it would slide without friction until
/// it falls in again, and creep down a slope.
pub(super) const SKIN_FRACTION: f32 = 1e-6;

/// A solid at both ends of a substep.
pub(super) struct PlacedSolid<'a> {
    /// The shape at the start and at the end.
    shapes: [Cow<'a, Shape>; 2],
    is_deforming: bool,
    /// Distance from the solid to keep [m].
    clearance: f32,
    poses: Option<[Pose; 2]>,
}

/// The solids at two times [s], enlarged by a `clearance` [m].
pub(super) fn place_solids<'a>(
    solids: &'a [Solid],
    clearance: f32,
    from: f64,
    to: f64,
) -> Vec<PlacedSolid<'a>> {
    let poses = |solid: &Solid| solid.motion.as_ref().map(|motion| [motion.pose(from), motion.pose(to)]);
    let shapes = |solid: &'a Solid| [solid.shape_at(from), solid.shape_at(to)];
    let place = |solid: &'a Solid| PlacedSolid {
        shapes: shapes(solid),
        is_deforming: solid.is_deforming(),
        clearance,
        poses: poses(solid),
    };
    solids.iter().map(place).collect()
}

impl<'a> PlacedSolid<'a> {
    /// A rigid shape at the poses at both ends, enlarged by a `clearance` [m].
    pub(super) fn rigid(shape: &'a Shape, clearance: f32, poses: [Pose; 2]) -> Self {
        let shapes = [Cow::Borrowed(shape), Cow::Borrowed(shape)];
        Self { shapes, is_deforming: false, clearance, poses: Some(poses) }
    }

    /// Distance from the solid's clearance, and normal, at one end of the substep.
    pub(super) fn contact(&self, x: Vec3, end: usize) -> (f32, Vec3) {
        self.contact_off(x, end, 1.0)
    }

    /// Distance from the clearance of a rigid solid, and normal, at a place in its own axes.
    pub(super) fn local_contact(&self, x: Vec3) -> (f32, Vec3) {
        let (distance, n) = self.shapes[1].contact(x);
        (distance - self.clearance, n)
    }

    /// Distance from a part of the solid's clearance, and normal.
    fn contact_off(&self, x: Vec3, end: usize, part: f32) -> (f32, Vec3) {
        let (distance, n) = match &self.poses {
            None => self.shapes[end].contact(x),
            Some(poses) => {
                let (d, n) = self.shapes[end].contact(poses[end].to_local(x));
                (d, poses[end].rotation * n)
            }
        };
        (distance - part * self.clearance, n)
    }

    /// Displacement of the solid during the substep, at a place at its end [m].
    pub(super) fn displacement(&self, x: Vec3) -> Vec3 {
        let rigid = self.poses.as_ref().map_or(Vec3::zeros(), |[from, to]| {
            let local = to.to_local(x);
            to.to_world(local) - from.to_world(local)
        });
        rigid + self.deformation(x, 1)
    }

    /// Displacement of the solid along its normal by its vertices, at a place at an end of the substep [m].
    fn deformation(&self, x: Vec3, end: usize) -> Vec3 {
        if !self.is_deforming {
            return Vec3::zeros();
        }
        let pose = self.poses.as_ref().map_or_else(Pose::identity, |poses| poses[end]);
        let local = pose.to_local(x);
        // The distance at the start less that at the end; the normal of the requested end.
        let [start, finish] = &self.shapes;
        let (of, other, sign) = if end == 1 { (finish, start, 1.0) } else { (start, finish, -1.0) };
        pose.rotation * of.displacement_since(other, local) * sign
    }

    /// Displacement of the solid during the substep, at a place at its start [m].
    fn displacement_from(&self, x: Vec3) -> Vec3 {
        let rigid = self.poses.as_ref().map_or(Vec3::zeros(), |[from, to]| to.to_world(from.to_local(x)) - x);
        rigid + self.deformation(x, 0)
    }
}

/// Faces around points, for normals: the two neighbours of a point in each face.
#[derive(Clone, Debug, Default)]
pub(super) struct VertexFaces {
    start: Vec<u32>,
    pairs: Vec<[u32; 2]>,
}

impl VertexFaces {
    /// The faces around `count` points.
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

    /// Unit normal at a point; `None` where faces cancel or there are none.
    pub(super) fn normal(&self, x: &Vectors, i: usize) -> Option<Vec3> {
        let own = x.get(i);
        let pairs = &self.pairs[self.start[i] as usize..self.start[i + 1] as usize];
        let sum: Vec3 =
            pairs.iter().map(|[a, b]| (x.get(*a as usize) - own).cross(&(x.get(*b as usize) - own))).sum();
        let length = sum.norm();
        (length > 0.0 && length.is_finite()).then(|| sum / length)
    }
}

/// Repulsion of a point by a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct RepulsionForce {
    pub(super) point: u32,
    /// Force [N].
    pub(super) force: Vec3,
    /// −∂force/∂x = `stiffness` n nᵀ [N/m].
    pub(super) stiffness: f32,
    /// The sheet's unit normal.
    pub(super) normal: Vec3,
    /// Normal of the solid.
    solid_normal: Vec3,
    /// Velocity of the solid there [m/s].
    solid_velocity: Vec3,
}

impl RepulsionForce {
    /// Velocity that friction removes from `v` [m/s] at the end of a substep of `dt` [s]. With the implicit
    /// integrator (`solved`) the force has decreased as the point moved away.
    fn friction_change(&self, friction: f32, v: Vec3, mobility: f32, dt: f32, solved: bool) -> Vec3 {
        let at_start = self.force.dot(&self.normal);
        let decrease = if solved { self.stiffness * dt * self.normal.dot(&v) } else { 0.0 };
        let normal_force = ((at_start - decrease) * at_start.signum()).max(0.0);
        let slip = v - self.solid_velocity;
        let slip = slip - self.solid_normal * self.solid_normal.dot(&slip);
        let speed = slip.norm();
        if speed > 0.0 { slip * (friction * normal_force * dt * mobility / speed).min(1.0) } else { slip }
    }
}

/// Repulsion of points by the solids at one `end` of a substep of `dt` [s].
pub(super) fn repulsion_forces(
    repulsion: &Repulsion,
    (solids, end): (&[PlacedSolid<'_>], usize),
    vertex_faces: &VertexFaces,
    (x, area): (&Vectors, &[f32]),
    dt: f32,
) -> Vec<RepulsionForce> {
    let Repulsion { energy, range } = *repulsion;
    let parts = par::map_chunks(x.len(), par::CHUNK, |points| {
        let mut found = Vec::new();
        for i in points {
            for solid in solids {
                let (distance, solid_normal) = solid.contact(x.get(i), end);
                if distance >= REPULSION_RANGE * range {
                    continue;
                }
                let normal = vertex_faces.normal(x, i).unwrap_or(solid_normal);
                let at_point = area[i] * energy / range * exp(-distance.max(0.0) / range);
                let along = solid_normal.dot(&normal);
                let force = normal * (at_point * along); // [gudukbay97] Eq. 9
                let stiffness = at_point / range * along * along;
                // The point is where it is at the start of the substep. With the solid's displacement that
                // ends there it would creep off a circle, by ω² r Δt.
                let solid_velocity = solid.displacement_from(x.get(i)) / dt;
                found.push(RepulsionForce {
                    point: i as u32,
                    force,
                    stiffness,
                    normal,
                    solid_normal,
                    solid_velocity,
                });
            }
        }
        found
    });
    parts.into_iter().flatten().collect()
}

/// A moving point, and the rounding error of its position.
#[derive(Clone, Copy)]
struct Moving {
    x: Vec3,
    v: Vec3,
    low: Vec3,
}

impl Moving {
    /// Moves the point. Without the rounding error, projections would be rounded away and motion into the
    /// solid would not: points at rest would drift.
    fn shift(&mut self, by: Vec3) {
        let (displacement, before) = (by + self.low, self.x);
        self.x += displacement;
        self.low = displacement - (self.x - before);
    }
}

/// Calls `f` on the points that `points` selects from each range. `f` returns `None` if it left the point
/// unchanged, and otherwise whether to count it. Returns the count.
fn move_each<I: Iterator<Item = usize>>(
    [x, v, low]: [&mut Vectors; 3],
    points: impl Fn(std::ops::Range<usize>) -> I + Sync,
    f: impl Fn(usize, &mut Moving) -> Option<bool> + Sync,
) -> u64 {
    let (len, eights) = (x.len(), x.axes[0].len());
    let ([x0, x1, x2], [v0, v1, v2], [l0, l1, l2]) = (&mut x.axes, &mut v.axes, &mut low.axes);
    let all: [&mut [F32x8]; 9] = [x0, x1, x2, v0, v1, v2, l0, l1, l2];
    // Solids cost more per point than other passes, so the chunks are short.
    let counts = par::map_chunks_mut(all, chunk_len(eights), |start, parts: [&mut [F32x8]; 9]| {
        let mut count = 0;
        for i in points(start * LANES..len.min((start + parts[0].len()) * LANES)) {
            let (at, lane) = (i / LANES - start, i % LANES);
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

/// Applies friction to repelled points at the end of a substep of `dt` [s]; see
/// [`RepulsionForce::friction_change`].
pub(super) fn apply_friction(
    forces: &[RepulsionForce],
    friction: f32,
    mobility: &[f32],
    sheet: [&mut Vectors; 3],
    (dt, solved): (f32, bool),
) {
    let of = |points: std::ops::Range<usize>| {
        let [first, end] = [points.start, points.end]
            .map(|point| forces.partition_point(|force| (force.point as usize) < point));
        forces[first..end].chunk_by(|a, b| a.point == b.point)
    };
    move_each(
        sheet,
        |points| of(points).map(|forces| forces[0].point as usize),
        |i, moving| {
            for force in of(i..i + 1).flatten() {
                let change = force.friction_change(friction, moving.v, mobility[i], dt, solved);
                // The point has already slid too far: without this, points at rest on a slope would creep.
                moving.shift(-change * dt);
                moving.v -= change;
            }
            Some(false)
        },
    );
}

/// Projects points that are inside solids at the end of a substep of `dt` [s] to their surfaces. Points of
/// zero mobility stay. Returns the number of points.
pub(super) fn project_out(
    solids: &[PlacedSolid<'_>],
    friction: Option<f32>,
    mobility: &[f32],
    sheet: [&mut Vectors; 3],
    dt: f32,
) -> u64 {
    let mobile = |points: std::ops::Range<usize>| points.filter(|&i| mobility[i] != 0.0);
    move_each(sheet, mobile, |_, moving| project_point(solids, friction, moving, dt))
}

/// Projects a point inside a solid, or its clearance, to the surface, and stops it if it touches. Returns
/// whether it was inside; `None` if it did not touch either. Clearances shrink pass by pass between solids
/// that are too close for them: no point may end inside one solid for the clearance of another.
fn project_point(
    solids: &[PlacedSolid<'_>],
    friction: Option<f32>,
    point: &mut Moving,
    dt: f32,
) -> Option<bool> {
    let (mut was_inside, mut touched) = (false, false);
    for pass in 0..MAX_PROJECTION_PASSES {
        let mut again = false;
        let part = (1.5 - 0.25 * pass as f32).clamp(0.0, 1.0);
        for solid in solids {
            let (distance, n) = solid.contact_off(point.x, 1, part);
            let skin = SKIN_FRACTION * (1.0 + point.x.amax());
            if distance >= if pass == 0 { 2.0 * skin } else { 0.0 } {
                continue;
            }
            let solid_velocity = solid.displacement(point.x) / dt;
            let relative = point.v - solid_velocity;
            let inwards = relative.dot(&n);
            if distance >= 0.0 && inwards >= 0.0 {
                continue;
            }
            was_inside |= distance < 0.0;
            (touched, again) = (true, true);
            point.shift(n * (skin - distance));
            let mut slip = relative - n * inwards;
            if let (Some(friction), true) = (friction, inwards < 0.0) {
                let (speed, before) = (slip.norm(), slip);
                slip *= if speed > 0.0 { 1.0 - (-friction * inwards / speed).min(1.0) } else { 0.0 };
                // The point has already slid too far: without this, points at rest on a slope would creep.
                point.shift((slip - before) * dt);
            }
            point.v = solid_velocity + slip + n * inwards.max(0.0);
        }
        if !again {
            break;
        }
    }
    touched.then_some(was_inside)
}

/// Number of points inside solids at the end of the substep, without those that are held exactly.
pub(super) fn count_inside(solids: &[PlacedSolid<'_>], x: &Vectors, mobility: &[f32]) -> u64 {
    let count = |range: std::ops::Range<usize>| {
        range
            .filter(|&i| mobility[i] > 0.0 && solids.iter().any(|solid| solid.contact(x.get(i), 1).0 < 0.0))
            .count() as u64
    };
    par::map_chunks(x.len(), par::CHUNK, count).into_iter().sum()
}

/// Number of faces inside solids at the end of the substep by more than rounding, and their largest depth [m], tested at
/// the middles of edges and diagonals, and of triangles. `faces`: the faces of each sheet, and its first
/// point. Faces with exactly held corners do not count, as pins move them.
pub(super) fn cut_faces<'a>(
    solids: &[PlacedSolid<'_>],
    (x, mobility): (&Vectors, &[f32]),
    faces: impl Iterator<Item = (&'a [[u32; 4]], u32)>,
) -> (u64, f64) {
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
        // A distance changes by no more than the displacement, and by half more where the solid is sampled.
        let farthest = places.iter().map(|place| (place - middle).norm()).fold(0.0, f32::max);
        if nearest(middle) > 1.5 * farthest {
            return 0.0;
        }
        places.into_iter().fold(0.0_f32, |deepest, place| {
            let (skin, distance) = (2.0 * SKIN_FRACTION * (1.0 + place.amax()), nearest(place));
            if distance < -skin { deepest.max(-distance) } else { deepest }
        })
    };
    let combine =
        |(count, deepest): (u64, f64), (more, depth): (u64, f64)| (count + more, deepest.max(depth));
    let of_sheet = |(faces, start): (&[[u32; 4]], u32)| {
        let parts = par::map_chunks(faces.len(), par::CHUNK, |range| {
            let depths = faces[range].iter().map(|face| depth(face.map(|i| i + start)));
            depths.map(|depth| (u64::from(depth > 0.0), f64::from(depth))).fold((0, 0.0), combine)
        });
        parts.into_iter().fold((0, 0.0), combine)
    };
    faces.map(of_sheet).fold((0, 0.0), combine)
}
