//! What the solids do to the liquid: keep particles out, and fill in the density they displace.
//!
//! *Method*: contact by projection along the outward normal, inside the solver's loop ([pbf] Algorithm 1, line 14). A
//! moving solid stands where it is at the substep's end; since velocities are made from positions, what it pushes
//! takes on its normal velocity, and no other: there is no friction.
//! *Departs from the paper*: paths are followed through the distance field of every body, relative to the body, so
//! that no step and no solid is fast enough to pass a particle through a part, however thin. Near a solid the density
//! lacks the share of a kernel that lies inside it, and particles stack in layers ([pbf] section 9). That share is
//! added as if the solid were a slab behind its nearest point: Poly6 and Spiky integrated over a half space have
//! closed forms, and a slab is the difference of two. Boxes are the product of three slabs, which holds at their edges
//! too; for meshes the kernel is integrated on a grid (`displaced.rs`). Several solids combine as independent: the part
//! left open is the product of the parts that each leaves open, which for two or three perpendicular walls keeps the
//! corner near rest.
//!
//! Limits: the curvature of balls and capsules is neglected: where it is touched, a ball of radius h displaces 0.65 of
//! what is assumed, one of 3 h 0.87. A mesh whose voxels are larger than 0.4 h is taken as flat: its edges then displace
//! 0.4, its inner edges 1.8 of what is assumed (test `the_share_beside_bodies_is_near_the_kernels_integral`).

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

    /// What moving solids did through their share of the density in one correction of a particle at `x` with the
    /// multiplier `lambda` [m²]; see [`Walls::work`].
    #[inline]
    pub(super) fn pressing(&self, x: Vec3, lambda: f32) -> f64 {
        if lambda == 0.0 {
            return 0.0;
        }
        let planes = self.planes.iter().filter_map(|plane| {
            let d = plane.n.dot(&x) - plane.offset;
            let near = plane.mover.filter(|_| d < self.support);
            near.map(|mover| (mover, plane.n * self.slope(d)))
        });
        let bodies = self.bodies.iter().filter_map(|body| {
            let near = body.mover.filter(|_| self.body_distance(body, x) < self.support);
            near.map(|mover| (mover, self.body_share(body, x).1))
        });
        let did = planes.chain(bodies).map(|(mover, falls)| {
            let Mover { before, now, .. } = &self.movers[mover];
            let way = x - before.to_world(now.to_local(x));
            f64::from(falls.dot(&way)) * f64::from(-lambda)
        });
        did.sum()
    }

    /// The solids' share of ρ₀ at `x` and its gradient [1/m].
    #[inline]
    pub(super) fn share(&self, x: Vec3) -> (f32, Vec3) {
        let (mut open, mut open_gradient) = (1.0_f32, Vec3::zeros());
        let mut add = |left: f32, slope: Vec3| {
            open_gradient = open_gradient * left + slope * open;
            open *= left;
        };
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                add(1.0 - self.half_space(d), plane.n * self.slope(d));
            }
        }
        for body in &self.bodies {
            if self.body_distance(body, x) < self.support {
                let (share, slope) = self.body_share(body, x);
                add(1.0 - share, slope);
            }
        }
        (1.0 - open, -open_gradient)
    }

    /// The share of a half space at distance `d` [m].
    #[inline]
    fn half_space(&self, d: f32) -> f32 {
        self.rest.solid_share((d + self.shift) * self.inv_support)
    }

    /// How fast that share falls off [1/m].
    #[inline]
    fn slope(&self, d: f32) -> f32 {
        self.rest.solid_slope(d * self.inv_support) * self.inv_support
    }

    /// The share of one body, and how fast it falls off, and in which direction [1/m].
    #[inline]
    fn body_share(&self, body: &Body, x: Vec3) -> (f32, Vec3) {
        let pose = body.mover.map(|mover| &self.movers[mover].now);
        let own = pose.map_or(x, |pose| pose.to_local(x));
        let turned = |n: Vec3| pose.map_or(n, |pose| pose.rotation * n);
        if let Some(displaced) = &body.displaced {
            let (d, n) = displaced.contact(own);
            return (self.half_space(d), turned(n) * self.slope(d));
        }
        if let Shape::Box { min, max } = body.shape {
            let (share, slope) = self.box_share(min, max, own);
            return (share, turned(slope));
        }
        // Where a half space would be h - d deep, a slab is not, and tells its thickness.
        let (d, n) = self.body_contact(body, x);
        let beyond = self.body_distance(body, x - n * self.support);
        let far = -d - (self.support - d - beyond).max(0.0);
        let share = self.half_space(d) - (1.0 - self.half_space(far));
        (share.max(0.0), n * (self.slope(d) - self.slope(far)))
    }

    /// The share of a box: three slabs that cut each other.
    #[inline]
    fn box_share(&self, min: [f32; 3], max: [f32; 3], x: Vec3) -> (f32, Vec3) {
        let (mut part, mut falls) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            // Distances to the planes of both faces, positive outside the slab.
            let (low, high) = (min[axis] - x[axis], x[axis] - max[axis]);
            part[axis] = (self.half_space(low) - (1.0 - self.half_space(high))).max(0.0);
            falls[axis] = self.slope(high) - self.slope(low);
        }
        let [a, b, c] = part;
        (a * b * c, Vec3::new(falls[0] * b * c, a * falls[1] * c, a * b * falls[2]))
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

    fn walls(shapes: &[Shape]) -> Walls {
        let solids: Vec<Solid> = shapes.iter().cloned().map(Solid::fixed).collect();
        Walls::new(&solids, &Rest::new(Kernel::Poly6Spiky, 0.1, 2.0))
    }

    fn corner() -> Walls {
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
    fn mesh(voxel: f32, distance: impl Fn(Vec3) -> f32) -> Shape {
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

    #[test]
    fn the_share_in_edges_and_corners_leaves_the_lattice_near_rest() {
        let (walls, rest) = (corner(), Rest::new(Kernel::Poly6Spiky, 0.1, 2.0));
        for (walls_near, bound) in [(1, 1e-3), (2, 0.03), (3, 0.05)] {
            let x = Vec3::from_fn(|axis, _| if axis < walls_near { 0.05 } else { 0.55 });
            let mut c = walls.share(x).0 - 1.0;
            for k in 0..1000 {
                let y = Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32) * 0.1;
                let q2 = (y + Vec3::repeat(0.05) - x).norm_squared() * rest.inv_support.powi(2);
                c += rest.density_scale * (1.0 - q2).max(0.0).powi(3);
            }
            assert!(c.abs() < bound, "{walls_near} walls: C = {c}");
        }
    }

    /// Poly6 integrated over the solid, moved inward by the calibration's shift.
    fn integral(rest: &Rest, x: Vec3, distance: impl Fn(Vec3) -> f32) -> f32 {
        let n = 48;
        let (mut inside, mut all) = (0.0, 0.0);
        for k in 0..n * n * n {
            let at = |i: i32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            let q = Vec3::new(at(k % n), at(k / n % n), at(k / n / n));
            let w = (1.0 - q.norm_squared()).max(0.0).powi(3);
            all += w;
            // The cell's own share: a plane that cuts it is not rounded to its edge.
            let depth = -(distance(x + q * rest.support) + rest.wall_shift) / (2.0 * rest.support / n as f32);
            inside += w * (depth + 0.5).clamp(0.0, 1.0);
        }
        inside / all
    }

    #[test]
    fn the_share_beside_bodies_is_near_the_kernels_integral() {
        let rest = Rest::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let cuboid = |half: Vec3| {
            move |x: Vec3| {
                let q = x.abs() - half;
                q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
            }
        };
        let thick = Vec3::repeat(0.6);
        let thin = Vec3::new(0.6, 0.6, 0.05);
        let shape = |half: Vec3| Shape::Box { min: (-half).into(), max: half.into() };
        let ball = |radius: f32| move |x: Vec3| x.norm() - radius;
        let bowl = |x: Vec3| -cuboid(thick)(x);
        type Exact<'a> = &'a dyn Fn(Vec3) -> f32;
        let (thick_, thin_, big, small) = (cuboid(thick), cuboid(thin), ball(0.6), ball(0.2));
        let face = Vec3::new(0.0, 0.0, 0.65);
        let edge = Vec3::new(0.0, 0.635, 0.635);
        let point = Vec3::repeat(0.63);
        let cases: [(&str, Shape, Exact<'_>, Vec3, f32); 13] = [
            ("box, face", shape(thick), &thick_, face, 0.01),
            ("box, edge", shape(thick), &thick_, edge, 0.03),
            ("box, corner", shape(thick), &thick_, point, 0.03),
            ("plate one spacing thick", shape(thin), &thin_, Vec3::new(0.0, 0.0, 0.1), 0.01),
            ("plate, rim", shape(thin), &thin_, Vec3::new(0.0, 0.65, 0.0), 0.03),
            ("ball of three h", Shape::Sphere { center: [0.0; 3], radius: 0.6 }, &big, face, 0.06),
            (
                "ball of one h",
                Shape::Sphere { center: [0.0; 3], radius: 0.2 },
                &small,
                Vec3::new(0.0, 0.0, 0.25),
                0.13,
            ),
            ("mesh of a box, face", mesh(0.05, cuboid(thick)), &thick_, face, 0.01),
            ("mesh of a box, edge", mesh(0.05, cuboid(thick)), &thick_, edge, 0.03),
            ("mesh of a box, corner", mesh(0.05, cuboid(thick)), &thick_, point, 0.03),
            ("mesh of a plate", mesh(0.025, cuboid(thin)), &thin_, Vec3::new(0.0, 0.0, 0.1), 0.02),
            ("mesh from inside, edge", mesh(0.05, bowl), &bowl, Vec3::new(0.0, 0.55, 0.55), 0.04),
            ("mesh from inside, face", mesh(0.05, bowl), &bowl, Vec3::new(0.0, 0.0, 0.55), 0.01),
        ];
        for (name, shape, exact, x, bound) in cases {
            let (share, truth) = (walls(&[shape]).share(x).0, integral(&rest, x, exact));
            println!("{name}: {share:.3}, integral {truth:.3}");
            assert!((share - truth).abs() < bound, "{name}: {share}, integral {truth}");
        }
    }

    #[test]
    fn the_gradient_points_into_the_solids() {
        let (share, gradient) = corner().share(Vec3::new(0.05, 0.5, 0.08));
        assert!(share > 0.0 && gradient.x < 0.0 && gradient.z < 0.0 && gradient.y == 0.0);
        assert_eq!(corner().share(Vec3::repeat(0.5)).0, 0.0);
        let plate = walls(&[Shape::Box { min: [-1.0, -1.0, -0.05], max: [1.0, 1.0, 0.05] }]);
        for x in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(1.05, 0.0, 0.0), Vec3::new(0.0, -1.02, -0.08)] {
            let (share, gradient) = plate.share(x);
            assert!(share > 0.0 && gradient.dot(&x) < 0.0, "{x:?} {gradient:?}");
        }
    }
}
