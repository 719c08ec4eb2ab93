//! What the solids do to the liquid: keep particles out, and fill in the density they displace (`share.rs`).
//!
//! *Method*: contact by projection along the outward normal, inside the solver's loop ([pbf] Algorithm 1, line 14). A
//! moving solid stands where it is at the substep's end; since velocities are made from positions, what it pushes
//! takes on its normal velocity, and no other: there is no friction.
//! *Departs from the paper*: paths are followed through the distance field of every body, relative to the body, so
//! that no step and no solid is fast enough to pass a particle through a part, however thin.

mod share;

use super::{displaced, rest::Rest};
use crate::{
    math::Vec3,
    solid::{MeshShape, Motion, Pose, Shape, Solid},
};

/// How often a particle is pushed out of all solids in turn before the rest is only counted.
const ROUNDS: usize = 12;

/// From this round on the distance kept shrinks to nothing: between solids that close on it a particle that has no
/// room finds its way to the middle of the gap, instead of being pushed from the one into the other.
const YIELDING: usize = 6;

/// A path is stopped where it comes this near to a body, in distances kept: enough to know the side by.
const HALT: f32 = 0.1;

/// Stops along one path, each followed by a slide along the surface.
const SLIDES: usize = 3;

/// Steps along one path. Each is as long as the nearest surface is far, and a path seldom has more than three.
const STEPS: usize = 48;

/// The solids, as the solver asks for them.
#[derive(Debug)]
pub(super) struct Walls {
    /// Half spaces: planes and the faces of tanks.
    planes: Vec<Plane>,
    /// Every other shape.
    bodies: Vec<Body>,
    /// The solids that move.
    movers: Vec<Mover>,
    /// Where the clock stands [s].
    now: f64,
    /// Particles keep this far from every surface [m].
    contact: f32,
    support: f32,
    inv_support: f32,
    shift: f32,
    rest: Rest,
}

/// A half space behind a plane.
#[derive(Debug)]
struct Plane {
    /// Unit outward normal and offset [m], in the world.
    n: Vec3,
    offset: f32,
    /// The same about the solid's own origin, and which mover carries it.
    own: (Vec3, f32),
    mover: Option<usize>,
}

/// A shape, and which mover carries it.
#[derive(Debug)]
struct Body {
    shape: Shape,
    /// For a mesh, the distances of half spaces that displace as much as it does.
    displaced: Option<MeshShape>,
    mover: Option<usize>,
}

/// A solid that moves: where it is at the start and at the end of the substep.
#[derive(Debug)]
struct Mover {
    motion: Motion,
    reach: f32,
    before: Pose,
    now: Pose,
}

impl Walls {
    /// Takes the solids apart; they stand where they are at time 0.
    pub(super) fn new(solids: &[Solid], rest: &Rest) -> Self {
        let (mut planes, mut bodies, mut movers) = (Vec::new(), Vec::new(), Vec::new());
        for Solid { shape, motion } in solids {
            let mover = motion.as_ref().map(|motion| {
                let pose = motion.pose(0.0);
                movers.push(Mover { motion: motion.clone(), reach: shape.reach(), before: pose, now: pose });
                movers.len() - 1
            });
            let mut plane = |n: Vec3, offset: f32| planes.push(Plane { n, offset, own: (n, offset), mover });
            match *shape {
                Shape::Plane { point, normal } => {
                    let n = Vec3::from(normal).normalize();
                    plane(n, n.dot(&Vec3::from(point)));
                }
                Shape::Tank { min, max } => {
                    for axis in 0..3 {
                        let n = Vec3::ith(axis, 1.0);
                        plane(n, min[axis]);
                        plane(-n, -max[axis]);
                    }
                }
                _ => {
                    let displaced = match shape {
                        Shape::Mesh(mesh) => displaced::equivalent(mesh, rest),
                        _ => None,
                    };
                    bodies.push(Body { shape: shape.clone(), displaced, mover });
                }
            }
        }
        let mut walls = Self {
            planes,
            bodies,
            movers,
            now: 0.0,
            contact: 0.5 * rest.spacing,
            support: rest.support,
            inv_support: rest.inv_support,
            shift: rest.wall_shift,
            rest: *rest,
        };
        walls.place_at(0.0);
        walls
    }

    /// Sets the clock to `time` [s] without a motion that leads there.
    pub(super) fn place_at(&mut self, time: f64) {
        self.move_to(time);
        for mover in &mut self.movers {
            mover.before = mover.now;
        }
    }

    /// Moves every solid to where it is at `time` [s], the end of the substep.
    pub(super) fn move_to(&mut self, time: f64) {
        self.now = time;
        for mover in &mut self.movers {
            mover.before = std::mem::replace(&mut mover.now, mover.motion.pose(time));
        }
        for plane in &mut self.planes {
            if let Some(mover) = plane.mover {
                let pose = &self.movers[mover].now;
                plane.n = pose.rotation * plane.own.0;
                plane.offset = plane.own.1 + plane.n.dot(&pose.position);
            }
        }
    }

    /// Whether any solid moves at any time.
    pub(super) fn any_move(&self) -> bool {
        !self.movers.is_empty()
    }

    /// A bound of the speed of every solid's surface over the next `seconds` [m/s].
    pub(super) fn fastest(&self, seconds: f64) -> f64 {
        let speed = |mover: &Mover| mover.motion.fastest(self.now, self.now + seconds, mover.reach);
        self.movers.iter().map(speed).fold(0.0, f64::max)
    }

    /// The smallest distance from `x` to a solid [m], negative inside one; infinite without solids. Off a mesh's grid
    /// it is a lower bound.
    #[inline]
    pub(super) fn distance(&self, x: Vec3) -> f32 {
        let planes = self.planes.iter().map(|plane| plane.n.dot(&x) - plane.offset);
        planes.chain(self.bodies.iter().map(|body| self.body_distance(body, x))).fold(f32::INFINITY, f32::min)
    }

    #[inline]
    fn body_distance(&self, body: &Body, x: Vec3) -> f32 {
        match body.mover {
            None => body.shape.signed_distance(x),
            Some(mover) => body.shape.signed_distance(self.movers[mover].now.to_local(x)),
        }
    }

    #[inline]
    fn body_contact(&self, body: &Body, x: Vec3) -> (f32, Vec3) {
        match body.mover {
            None => body.shape.contact(x),
            Some(mover) => {
                let pose = &self.movers[mover].now;
                let (d, n) = body.shape.contact(pose.to_local(x));
                (d, pose.rotation * n)
            }
        }
    }

    /// `x` pushed out of the solids, and whether it had no room at the full distance from all of them.
    #[inline]
    pub(super) fn project(&self, mut x: Vec3) -> (Vec3, bool) {
        for round in 0..ROUNDS {
            let yielded = (round.max(YIELDING) - YIELDING + 1) as f32 / (ROUNDS - YIELDING) as f32;
            let keep = if round < YIELDING { self.contact } else { self.contact * (1.0 - yielded) };
            let mut touched = false;
            for plane in &self.planes {
                let depth = keep - (plane.n.dot(&x) - plane.offset);
                if depth > 0.0 {
                    x += plane.n * depth;
                    touched = true;
                }
            }
            for body in &self.bodies {
                if self.body_distance(body, x) < keep {
                    let (d, n) = self.body_contact(body, x);
                    if d < keep {
                        x += n * (keep - d);
                        touched = true;
                    }
                }
            }
            if !touched {
                return (x, round >= YIELDING && self.touches(x));
            }
        }
        (x, self.touches(x))
    }

    /// Whether `x` is clearly nearer to a solid than particles keep.
    fn touches(&self, x: Vec3) -> bool {
        let near = 0.99 * self.contact;
        self.planes.iter().any(|plane| plane.n.dot(&x) - plane.offset < near)
            || self.bodies.iter().any(|body| self.body_contact(body, x).0 < near)
    }

    /// Where a particle gets that is to move from `from` to `to` while the solids stand: no body is passed through.
    #[inline]
    pub(super) fn step(&self, from: Vec3, to: Vec3) -> (Vec3, bool) {
        if self.bodies.is_empty() {
            return self.project(to); // a half space has no other side
        }
        let to = self.before_planes(to);
        self.project(self.bodies.iter().fold(to, |to, body| self.follow(body, from, to)))
    }

    /// `x` pushed out of every half space once. Between points outside them all a straight path stays outside, and
    /// does not lead around the end of a body that reaches through a wall.
    #[inline]
    fn before_planes(&self, mut x: Vec3) -> Vec3 {
        for plane in &self.planes {
            x += plane.n * (self.contact - (plane.n.dot(&x) - plane.offset)).max(0.0);
        }
        x
    }

    /// Where a particle gets that is to move from `from` to `to` while the solids move through the substep.
    #[inline]
    pub(super) fn carry(&self, from: Vec3, to: Vec3) -> (Vec3, bool) {
        if self.bodies.is_empty() {
            return self.project(to);
        }
        let follow = |to: Vec3, body: &Body| {
            // Seen from the body, the particle starts where the body would have carried it.
            let start = body.mover.map_or(from, |mover| {
                let Mover { before, now, .. } = &self.movers[mover];
                now.to_world(before.to_local(from))
            });
            self.follow(body, start, to)
        };
        self.project(self.bodies.iter().fold(self.before_planes(to), follow))
    }

    /// The path from `from` to `to`, stopped before it enters `body` and led on along its surface.
    #[inline]
    fn follow(&self, body: &Body, from: Vec3, to: Vec3) -> Vec3 {
        let (mut x, mut left) = (from, to - from);
        let near = HALT * self.contact;
        for _ in 0..SLIDES {
            let mut length = left.norm();
            let mut d = self.body_distance(body, x);
            if d >= length + near || length.is_nan() {
                return x + left;
            }
            let direction = left / length.max(f32::MIN_POSITIVE);
            for _ in 0..STEPS {
                if d <= near || length <= 0.0 {
                    break;
                }
                let step = d.min(length);
                x += direction * step;
                length -= step;
                d = self.body_distance(body, x);
            }
            // Arrived, or out of steps on a path that grazes the body: it then goes on from there in the next step.
            if d > near || length <= 0.0 {
                return x;
            }
            let (d, n) = self.body_contact(body, x);
            left = direction * length;
            left -= n * left.dot(&n).min(0.0);
            x += n * (self.contact - d);
        }
        x
    }

    /// What moving solids did in pushing a particle from `from` to `to` [m²]: the push times the way of the solid's
    /// surface. By the particle's mass over dt², it is work [J].
    #[inline]
    pub(super) fn work(&self, from: Vec3, to: Vec3) -> f64 {
        let push = to - from;
        if push == Vec3::zeros() {
            return 0.0;
        }
        // Of the moving solids that it touches, the one that faces the push the most did it.
        let planes = self.planes.iter().filter_map(|plane| {
            let d = plane.n.dot(&to) - plane.offset;
            plane.mover.map(|mover| (mover, d, plane.n))
        });
        let bodies = self.bodies.iter().filter_map(|body| {
            body.mover.map(|mover| {
                let (d, n) = self.body_contact(body, to);
                (mover, d, n)
            })
        });
        let touching = planes.chain(bodies).filter(|&(_, d, _)| d < 1.5 * self.contact);
        let facing =
            touching.map(|(mover, _, n)| (mover, n.dot(&push), n)).filter(|&(_, along, _)| along > 0.0);
        let most = facing.reduce(|a, b| if b.1 > a.1 { b } else { a });
        most.map_or(0.0, |(mover, along, n)| {
            let Mover { before, now, .. } = &self.movers[mover];
            let way = to - before.to_world(now.to_local(to));
            f64::from(along) * f64::from(n.dot(&way))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sdf::Sampled,
        sim::liquid::Kernel,
        solid::{Interpolation, Keyframe, MeshShape},
    };
    use std::sync::Arc;

    pub(super) fn walls(shapes: &[Shape]) -> Walls {
        let solids: Vec<Solid> = shapes.iter().cloned().map(Solid::fixed).collect();
        Walls::new(&solids, &Rest::new(Kernel::Poly6Spiky, 0.1, 2.0))
    }

    pub(super) fn corner() -> Walls {
        walls(&[Shape::Tank { min: [0.0; 3], max: [1.0; 3] }])
    }

    /// A shape that is `from` there at time 0 and `to` there at time 1.
    fn moving(shape: Shape, from: [f32; 3], to: [f32; 3]) -> Solid {
        let key = |frame: u32, position: [f32; 3]| Keyframe {
            frame,
            position,
            rotation: [0.0; 3],
            quaternion: None,
        };
        let motion = Motion::new(&[key(0, from), key(1, to)], Interpolation::Linear, 1.0, 0);
        Solid { shape, motion }
    }

    /// A mesh of the given exact distance on [-1, 1]³, as if it had been sampled.
    pub(super) fn mesh(voxel: f32, distance: impl Fn(Vec3) -> f32) -> Shape {
        let n = (2.0 / voxel) as usize + 1;
        let node = |i: usize| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * voxel;
        let values = (0..n * n * n).map(|i| distance(node(i) - Vec3::repeat(1.0))).collect();
        let field = Sampled { origin: Vec3::repeat(-1.0), voxel, nodes: [n as u32; 3], values };
        let mut shape = MeshShape::new("made here");
        shape.fill(Arc::new(field));
        Shape::Mesh(shape)
    }

    #[test]
    fn a_particle_beyond_a_corner_ends_inside_it() {
        let (x, stuck) = corner().project(Vec3::new(-3.0, 1.5, -0.2));
        assert!(!stuck && (x - Vec3::new(0.05, 0.95, 0.05)).norm() < 1e-5, "{x:?}");
    }

    #[test]
    fn in_a_gap_too_narrow_a_particle_stays_between_the_solids_and_is_reported() {
        for gap in [0.08, 0.03, 0.01] {
            let sides = [([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), ([0.0, 0.0, gap], [0.0, 0.0, -1.0])];
            let walls = walls(&sides.map(|(point, normal)| Shape::Plane { point, normal }));
            for z in [-0.1, 0.0, 0.5 * gap, gap, 0.3] {
                let (x, stuck) = walls.project(Vec3::new(0.0, 0.0, z));
                assert!(stuck && (0.0..=gap).contains(&x.z), "gap {gap}, from {z}: {}", x.z);
            }
        }
    }

    #[test]
    fn no_path_leads_through_a_thin_plate() {
        let (min, max) = ([-1.0, -1.0, -0.005], [1.0, 1.0, 0.005]);
        let slab = |x: Vec3| {
            let q = x.abs() - Vec3::new(0.9, 0.9, 0.05);
            q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
        };
        for (name, shape) in [("box", Shape::Box { min, max }), ("mesh", mesh(0.025, slab))] {
            let fixed = walls(std::slice::from_ref(&shape));
            for i in 0..60 {
                let to = Vec3::new(0.02 * i as f32 - 0.6, 0.3, -3.0);
                let (x, stuck) = fixed.step(Vec3::new(0.0, 0.0, 0.4), to);
                assert!(!stuck && x.z > 0.049, "{name}: {x:?}");
                // Along the plate it goes on.
                assert!((x.x - to.x).abs() < 0.05 || x.x.abs() > 0.9, "{name}: {x:?} to {to:?}");
            }
            // The plate passes over a particle at rest, 80 times its thickness in one substep, and takes it along.
            let rest = Rest::new(Kernel::Poly6Spiky, 0.1, 2.0);
            let mut walls = Walls::new(&[moving(shape, [0.0, 0.0, -0.4], [0.0, 0.0, 0.4])], &rest);
            walls.move_to(1.0);
            let x = Vec3::new(0.1, 0.2, 0.0);
            let (carried, stuck) = walls.carry(x, x);
            assert!(!stuck && carried.z > 0.449, "{name}: {carried:?}");
            assert!((carried.z - 0.5).abs() < 0.06, "{name}: {carried:?}");
            let work = walls.work(x, carried);
            assert!((work / (f64::from(carried.z) * 0.8) - 1.0).abs() < 1e-3, "{name}: {work}");
            assert!((walls.fastest(1.0) - 0.0).abs() < 1e-9, "the motion has ended");
        }
    }

    #[test]
    fn a_moving_tank_carries_its_walls() {
        let rest = Rest::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let tank = Shape::Tank { min: [0.0; 3], max: [1.0; 3] };
        let mut walls = Walls::new(&[moving(tank, [0.0; 3], [2.0, 0.0, 0.0])], &rest);
        assert!((walls.fastest(0.5) - 2.0).abs() < 1e-9);
        walls.move_to(0.5);
        assert!((walls.distance(Vec3::new(1.2, 0.5, 0.5)) - 0.2).abs() < 1e-6);
        let (x, _) = walls.carry(Vec3::new(0.2, 0.5, 0.5), Vec3::new(0.2, 0.5, 0.5));
        assert!((x.x - 1.05).abs() < 1e-6);
    }
}
