//! Boundary handling: collisions with solids, and the density that they contribute: colliders by an integral (`boundary_density.rs`), rigid bodies by
//! images of the particles (`rigid.rs`, `../images.rs`).
//!
//! *Method*: contact by projection along the outward normal, within the solver's iteration ([pbf] Algorithm 1, line 14). A
//! moving solid has its position at the end of the substep. Velocities follow from positions, so a particle takes on the
//! normal velocity of a solid that pushes it, but no tangential one: that comes from viscosity (`no_slip.rs`) or from Coulomb
//! friction (`friction.rs`).
//! *Departs from the paper*: continuous collision detection traces the path of a particle relative to every body through
//! the body's distance field (sphere tracing), so that no particle crosses even a thin part at any speed.

mod body_grid;
mod boundary_density;
mod deforming;
mod friction;
mod near;
mod no_slip;
mod rigid;
mod round_density;
mod surface;
mod surface_motion;
mod wetting;

pub(super) use friction::{PushedParticle, ROUNDING};
pub(super) use no_slip::{Resistance, WallDrag};
pub(super) use rigid::{Mirror, STEEPEST_INTERPOLATED};
pub(super) use wetting::Wetting;

use super::{calibration::RestState, density_map};
use crate::{
    math::Vec3,
    solid::{MeshShape, Motion, Pose, Shape, Solid},
};
use body_grid::BodyGrid;
use deforming::Deforming;
use surface::Surface;

/// Contact distance between particles and colliders [spacings].
const CONTACT: f32 = 0.5;

/// Most iterations that project a particle out of all solids; after them remaining contacts are counted.
const MAX_PROJECTION_ITERATIONS: usize = 12;

/// From this iteration on the contact distance decreases to zero. Between solids that are too close for a particle it then
/// converges to the middle of the gap, instead of being pushed from one into the other.
const FIRST_YIELDING_ITERATION: usize = 6;

/// Distance from a body at which a path stops, in contact distances: enough to identify the side.
const STOP_DISTANCE: f32 = 0.1;

/// Most stops along one path, each followed by a slide along the surface.
const MAX_SLIDES: usize = 3;

/// Most sphere tracing steps along one path. Each is as long as the distance to the surface; three are usual.
const MAX_TRACING_STEPS: usize = 48;

/// The solids in the form that the solver uses.
#[derive(Debug)]
pub(super) struct Walls {
    /// Half spaces: planes and the faces of tanks.
    planes: Vec<Plane>,
    /// All other shapes.
    bodies: Vec<Body>,
    /// The solids that move: by keyframes, then rigid bodies.
    movers: Vec<MovingSolid>,
    /// Number of those that move by keyframes.
    keyframed: usize,
    /// Where the bodies are, and the largest displacement of a moving solid in the substep [m].
    grid: BodyGrid,
    largest_displacement: f32,
    /// Current time [s].
    now: f64,
    /// Contact distance between particles and half spaces [m].
    contact: f32,
    support: f32,
    inv_support: f32,
    shift: f32,
    rest: RestState,
}

/// A half space behind a plane.
#[derive(Debug)]
struct Plane {
    /// Unit outward normal and offset [m] in world coordinates.
    n: Vec3,
    offset: f32,
    /// Normal and offset in the solid's own coordinates, and the index of its motion.
    own: (Vec3, f32),
    mover: Option<usize>,
    surface: Surface,
}

/// A shape, and the index of its motion.
#[derive(Debug)]
struct Body {
    shape: Shape,
    /// Density map of a mesh, as distances of the equivalent half spaces.
    density_map: Option<MeshShape>,
    deforming: Option<Deforming>,
    mover: Option<usize>,
    surface: Surface,
    /// Contact distance between particles and its surface [m].
    contact: f32,
    /// All of it is within `reach` [m] of `center`, in its own axes [m].
    center: Vec3,
    reach: f32,
    /// Half of the box around `center` that contains all of it [m].
    half_extent: Vec3,
}

/// A moving solid, with its poses at the start and at the end of the substep.
#[derive(Debug)]
struct MovingSolid {
    /// `None`: a rigid body.
    motion: Option<Motion>,
    /// Points of the solid are within `reach` [m] of `center`, in its own axes [m].
    center: Vec3,
    reach: f32,
    before: Pose,
    now: Pose,
}

impl Body {
    fn new(solid: &Solid, mover: Option<usize>, rest: &RestState) -> Self {
        let is_scaling = solid.motion.as_ref().is_some_and(Motion::is_scaling);
        let density_map = match &solid.shape {
            // A shape that changes gets its map when it is placed in time.
            Shape::Mesh(mesh) if !solid.is_deforming() => density_map::equivalent_distances(mesh, rest),
            _ => None,
        };
        let (shape, surface) = (solid.shape.clone(), Surface::of(solid));
        let (low, high) = shape.bounds().unwrap_or_default();
        let (mut center, mut half_extent) = ((low + high) / 2.0, (high - low) / 2.0);
        // Of a ball around the box. A smaller one leaves more out of paths, whose ends then have other last bits: docs/decisions/051.
        let mut reach = half_extent.norm();
        if is_scaling {
            (center, reach) = (Vec3::zeros(), shape.reach() * solid.scales()[1]);
            half_extent = Vec3::repeat(reach);
        }
        let deforming = Deforming::of(solid);
        let contact = CONTACT * rest.spacing;
        Self { half_extent, shape, density_map, deforming, mover, surface, contact, center, reach }
    }
}

impl MovingSolid {
    /// Displacement over the substep of the part of the solid that is at `x` in the middle of it [m]: a central difference. The
    /// chord of a turn, from the pose before to the pose now, has a component along the radius, by which a ball that spins in
    /// place would do work; the central difference has none.
    #[inline]
    fn displacement(&self, x: Vec3) -> Vec3 {
        let Self { before, now, .. } = self;
        (now.to_world(before.to_local(x)) - before.to_world(now.to_local(x))) / 2.0
    }
}

impl Walls {
    /// Splits solids into half spaces and bodies, at their poses at time 0.
    pub(super) fn new(solids: &[Solid], rest: &RestState) -> Self {
        let (mut planes, mut bodies, mut movers) = (Vec::new(), Vec::new(), Vec::new());
        for solid in solids {
            let Solid { shape, motion, .. } = solid;
            let surface = Surface::of(solid);
            let still = solid.is_deforming().then(Motion::still);
            let mover = motion.clone().or(still).map(|motion| {
                let pose = motion.pose(0.0);
                movers.push(MovingSolid {
                    motion: Some(motion),
                    center: Vec3::zeros(),
                    reach: shape.reach(),
                    before: pose,
                    now: pose,
                });
                movers.len() - 1
            });
            let mut plane = |n: Vec3, offset: f32| {
                planes.push(Plane { n, offset, own: (n, offset), mover, surface });
            };
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
                _ => bodies.push(Body::new(solid, mover, rest)),
            }
        }
        let mut walls = Self {
            planes,
            bodies,
            keyframed: movers.len(),
            movers,
            grid: BodyGrid::default(),
            largest_displacement: 0.0,
            now: 0.0,
            contact: CONTACT * rest.spacing,
            support: rest.support,
            inv_support: rest.inv_support,
            shift: rest.wall_shift,
            rest: *rest,
        };
        walls.place_at(0.0);
        walls
    }

    /// Sets the time to `time` [s] without motion during the substep.
    pub(super) fn place_at(&mut self, time: f64) {
        self.move_to(time);
        for mover in &mut self.movers {
            mover.before = mover.now;
        }
        self.bodies.iter_mut().for_each(Body::rest);
        self.refresh_near();
    }

    /// Moves every solid with keyframes to its pose at `time` [s], the end of the substep, and the vertices of those that deform.
    pub(super) fn move_to(&mut self, time: f64) {
        self.now = time;
        for mover in &mut self.movers {
            if let Some(motion) = &mover.motion {
                mover.before = std::mem::replace(&mut mover.now, motion.pose(time));
            }
        }
        self.bodies.iter_mut().for_each(|body| body.deform(time, &self.rest));
        for plane in &mut self.planes {
            if let Some(mover) = plane.mover {
                let pose = &self.movers[mover].now;
                plane.n = pose.rotation * plane.own.0;
                plane.offset = plane.own.1 + plane.n.dot(&pose.position);
            }
        }
        self.refresh_near();
    }

    /// Current time [s].
    pub(super) fn now(&self) -> f64 {
        self.now
    }

    /// Whether any solid moves by keyframes or deforms, and does work that the liquid's energy may rise by. The work of rigid bodies follows from
    /// their impulses.
    pub(super) fn has_moving_solids(&self) -> bool {
        self.keyframed > 0
    }

    /// Upper bound of the speed of all surfaces that move by keyframes or deform over the next `seconds` [m/s].
    pub(super) fn max_speed(&self, seconds: f64) -> f64 {
        let speed = |mover: &MovingSolid| {
            let motion = mover.motion.as_ref();
            motion.map_or(0.0, |motion| motion.fastest(self.now, self.now + seconds, mover.reach))
        };
        let deforming = |body: &Body| {
            let rigid = speed(&self.movers[body.mover?]);
            let Shape::Mesh(mesh) = &body.shape else { return None };
            // The shape has its present size, and may grow within the time.
            Some(rigid + mesh.fastest(self.now, self.now + seconds) * body.growth())
        };
        let movers = self.movers.iter().map(speed);
        movers.chain(self.bodies.iter().filter_map(deforming)).fold(0.0, f64::max)
    }

    /// Signed distance from `x` to the nearest solid [m]; infinite without solids. Outside a mesh's grid it is a lower bound. Bodies that are
    /// farther than twice the support may be left out.
    #[inline]
    pub(super) fn distance(&self, x: Vec3) -> f32 {
        self.distance_from_first(self.bodies.len(), x)
    }

    /// As [`Self::distance`] without rigid bodies.
    #[inline]
    pub(super) fn collider_distance(&self, x: Vec3) -> f32 {
        self.distance_from_first(self.rigid_index(0), x)
    }

    #[inline(always)]
    fn distance_from_first(&self, count: usize, x: Vec3) -> f32 {
        let planes = self.planes.iter().map(|plane| plane.n.dot(&x) - plane.offset);
        let near = self.near_of_first(count, x, self.near_reach());
        let bodies = near.map(|body| self.body_distance(&self.bodies[body], x));
        planes.chain(bodies).fold(f32::INFINITY, f32::min)
    }

    #[inline]
    fn body_distance(&self, body: &Body, x: Vec3) -> f32 {
        body.shape.signed_distance(self.own_position(body, x))
    }

    #[inline]
    fn body_contact(&self, body: &Body, x: Vec3) -> (f32, Vec3) {
        let (d, n) = body.shape.contact(self.own_position(body, x));
        (d, self.turned(body, n))
    }

    /// `x` in the coordinates of a body.
    #[inline]
    fn own_position(&self, body: &Body, x: Vec3) -> Vec3 {
        body.mover.map_or(x, |mover| self.movers[mover].now.to_local(x))
    }

    /// A direction of a body in the coordinates of the world.
    #[inline]
    fn turned(&self, body: &Body, direction: Vec3) -> Vec3 {
        body.mover.map_or(direction, |mover| self.movers[mover].now.rotation * direction)
    }

    /// `x` projected out of the half spaces and the first `count` bodies, and whether it is still closer to one than the contact distance.
    #[inline]
    pub(super) fn project(&self, count: usize, mut x: Vec3) -> (Vec3, bool) {
        for iteration in 0..MAX_PROJECTION_ITERATIONS {
            let yielded = (iteration.max(FIRST_YIELDING_ITERATION) - FIRST_YIELDING_ITERATION + 1) as f32
                / (MAX_PROJECTION_ITERATIONS - FIRST_YIELDING_ITERATION) as f32;
            let kept = if iteration < FIRST_YIELDING_ITERATION { 1.0 } else { 1.0 - yielded };
            let keep = self.contact * kept;
            let mut touched = false;
            for plane in &self.planes {
                let depth = keep - (plane.n.dot(&x) - plane.offset);
                if depth > 0.0 {
                    x += plane.n * depth;
                    touched = true;
                }
            }
            for body in self.near_of_first(count, x, self.support).map(|body| &self.bodies[body]) {
                let keep = body.contact * kept;
                if self.body_distance(body, x) < keep {
                    let (d, n) = self.body_contact(body, x);
                    if d < keep {
                        x += n * (keep - d);
                        touched = true;
                    }
                }
            }
            if !touched {
                return (x, iteration >= FIRST_YIELDING_ITERATION && self.touches(count, x));
            }
        }
        (x, self.touches(count, x))
    }

    /// Whether `x` is clearly closer to a half space or one of the first `count` bodies than the contact distance.
    fn touches(&self, count: usize, x: Vec3) -> bool {
        let of_plane = |plane: &Plane| plane.n.dot(&x) - plane.offset < 0.99 * self.contact;
        let of_body = |body: &Body| self.body_contact(body, x).0 < 0.99 * body.contact;
        self.planes.iter().any(of_plane)
            || self.near_of_first(count, x, self.support).any(|body| of_body(&self.bodies[body]))
    }

    /// End of a particle's path from `from` to `to` while the solids do not move, and whether it is still in contact.
    #[inline]
    pub(super) fn collide(&self, from: Vec3, to: Vec3) -> (Vec3, bool) {
        self.collide_with_first(self.bodies.len(), from, to)
    }

    /// As [`Self::collide`] far from rigid bodies.
    #[inline]
    pub(super) fn collide_with_colliders(&self, from: Vec3, to: Vec3) -> (Vec3, bool) {
        self.collide_with_first(self.rigid_index(0), from, to)
    }

    #[inline(always)]
    fn collide_with_first(&self, count: usize, from: Vec3, to: Vec3) -> (Vec3, bool) {
        if count == 0 {
            return self.project(count, to); // a half space has no other side
        }
        let bodies = self.near_path(count, from, to).map(|body| &self.bodies[body]);
        let stopped = bodies.fold(self.project_onto_planes(to), |to, body| self.trace_path(body, from, to));
        self.project(count, stopped)
    }

    /// `x` projected out of every half space once. A straight path between points outside of all half spaces stays outside,
    /// and does not lead around the end of a body that reaches through a wall.
    #[inline]
    fn project_onto_planes(&self, mut x: Vec3) -> Vec3 {
        for plane in &self.planes {
            x += plane.n * (self.contact - (plane.n.dot(&x) - plane.offset)).max(0.0);
        }
        x
    }

    /// End of a particle's path from `from` to `to` while the solids move through the substep, and whether it is still in contact.
    #[inline]
    pub(super) fn collide_moving(&self, from: Vec3, to: Vec3) -> (Vec3, bool) {
        let all = self.bodies.len();
        if all == 0 {
            return self.project(all, to);
        }
        let follow = |to: Vec3, body: &Body| {
            // In the body's frame, the particle starts at the point of the body's motion that ends there.
            let start = body.mover.map_or(from, |mover| {
                let MovingSolid { before, now, .. } = &self.movers[mover];
                let local = before.to_local(from);
                now.to_world(body.swept_start(local))
            });
            self.trace_path(body, start, to)
        };
        let mut bodies = self.near_path(all, from, to).map(|body| &self.bodies[body]).peekable();
        // Half spaces at rest do not project a particle that comes from outside of them beyond its path.
        if bodies.peek().is_none() && !self.has_moving_solids() {
            return self.project(0, to);
        }
        self.project(all, bodies.fold(self.project_onto_planes(to), follow))
    }

    /// End of the path from `from` to `to`, stopped before it enters `body` and continued along its surface.
    #[inline]
    fn trace_path(&self, body: &Body, from: Vec3, to: Vec3) -> Vec3 {
        let (mut x, mut left) = (from, to - from);
        let near = STOP_DISTANCE * body.contact;
        for _ in 0..MAX_SLIDES {
            let mut length = left.norm();
            let mut d = self.body_distance(body, x);
            if d >= length + near || length.is_nan() {
                return x + left;
            }
            let direction = left / length.max(f32::MIN_POSITIVE);
            for _ in 0..MAX_TRACING_STEPS {
                if d <= near || length <= 0.0 {
                    break;
                }
                let step = d.min(length);
                x += direction * step;
                length -= step;
                d = self.body_distance(body, x);
            }
            // Arrived, or out of steps on a path that grazes the body: the next substep continues it.
            if d > near || length <= 0.0 {
                return x;
            }
            let (d, n) = self.body_contact(body, x);
            left = direction * length;
            left -= n * left.dot(&n).min(0.0);
            x += n * (body.contact - d);
        }
        x
    }

    /// Work of moving solids when a particle is projected from `from` to `to`, as projection times displacement of the surface
    /// [m²]. Times the particle's mass over dt² it is a work [J].
    #[inline]
    pub(super) fn work(&self, from: Vec3, to: Vec3) -> f64 {
        let push = to - from;
        if push == Vec3::zeros() {
            return 0.0;
        }
        // Among the moving solids in contact, the one whose normal is closest to the projection did the work.
        let planes = self.planes.iter().filter_map(|plane| {
            let d = plane.n.dot(&to) - plane.offset;
            plane.mover.filter(|_| d < 1.5 * self.contact).map(|mover| (mover, None, plane.n))
        });
        let bodies = self.near(to, self.support).filter_map(|body| {
            let body = &self.bodies[body];
            let (d, n) = self.body_contact(body, to);
            body.mover.filter(|_| d < 1.5 * body.contact).map(|mover| (mover, Some(body), n))
        });
        let facing = planes.chain(bodies).map(|(mover, body, n)| (mover, body, n.dot(&push), n));
        let facing = facing.filter(|&(_, _, along, _)| along > 0.0);
        let best = facing.reduce(|a, b| if b.2 > a.2 { b } else { a });
        best.filter(|&(mover, ..)| mover < self.keyframed).map_or(0.0, |(mover, body, along, n)| {
            f64::from(along) * f64::from(n.dot(&self.displacement(mover, body, to)))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::Kernel,
        solid::{Interpolation, Keyframe, sampled_mesh},
    };

    pub(super) fn walls(shapes: &[Shape]) -> Walls {
        let solids: Vec<Solid> = shapes.iter().cloned().map(Solid::fixed).collect();
        Walls::new(&solids, &RestState::new(Kernel::Poly6Spiky, 0.1, 2.0))
    }

    pub(super) fn corner() -> Walls {
        walls(&[Shape::Tank { min: [0.0; 3], max: [1.0; 3] }])
    }

    /// A shape that moves from `from` at time 0 to `to` at time 1.
    fn moving(shape: Shape, from: [f32; 3], to: [f32; 3]) -> Solid {
        let key = |frame: u32, position: [f32; 3]| Keyframe {
            frame,
            position,
            rotation: [0.0; 3],
            quaternion: None,
            scale: 1.0,
        };
        let motion = Motion::new(&[key(0, from), key(1, to)], Interpolation::Linear, 1.0, 0);
        Solid { motion, ..Solid::fixed(shape) }
    }

    #[test]
    fn a_particle_beyond_a_corner_ends_inside_it() {
        let (x, stuck) = corner().project(0, Vec3::new(-3.0, 1.5, -0.2));
        assert!(!stuck && (x - Vec3::new(0.05, 0.95, 0.05)).norm() < 1e-5, "{x:?}");
    }

    #[test]
    fn in_a_narrow_gap_a_particle_stays_between_the_solids_and_is_reported() {
        for gap in [0.08, 0.03, 0.01] {
            let sides = [([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), ([0.0, 0.0, gap], [0.0, 0.0, -1.0])];
            let walls = walls(&sides.map(|(point, normal)| Shape::Plane { point, normal }));
            for z in [-0.1, 0.0, 0.5 * gap, gap, 0.3] {
                let (x, stuck) = walls.project(0, Vec3::new(0.0, 0.0, z));
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
        for (name, shape) in [("box", Shape::Box { min, max }), ("mesh", sampled_mesh(0.025, slab))] {
            let fixed = walls(std::slice::from_ref(&shape));
            for i in 0..60 {
                let to = Vec3::new(0.02 * i as f32 - 0.6, 0.3, -3.0);
                let (x, stuck) = fixed.collide(Vec3::new(0.0, 0.0, 0.4), to);
                assert!(!stuck && x.z > 0.049, "{name}: {x:?}");
                // The motion along the plate continues.
                assert!((x.x - to.x).abs() < 0.05 || x.x.abs() > 0.9, "{name}: {x:?} to {to:?}");
            }
            // The plate sweeps over a particle at rest, 80 times its thickness in one substep, and pushes it along.
            let rest = RestState::new(Kernel::Poly6Spiky, 0.1, 2.0);
            let mut walls = Walls::new(&[moving(shape, [0.0, 0.0, -0.4], [0.0, 0.0, 0.4])], &rest);
            walls.move_to(1.0);
            let x = Vec3::new(0.1, 0.2, 0.0);
            let (swept, stuck) = walls.collide_moving(x, x);
            assert!(!stuck && swept.z > 0.449, "{name}: {swept:?}");
            assert!((swept.z - 0.5).abs() < 0.06, "{name}: {swept:?}");
            let work = walls.work(x, swept);
            assert!((work / (f64::from(swept.z) * 0.8) - 1.0).abs() < 1e-3, "{name}: {work}");
            assert!((walls.max_speed(1.0) - 0.0).abs() < 1e-9, "the motion has ended");
        }
    }

    #[test]
    fn a_turn_does_work_by_the_velocity_of_the_surface_and_none_by_the_chord() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let turning = |shape: Shape| {
            let key = |frame: u32, rotation: f32| Keyframe {
                frame,
                position: [2.0, 0.0, 0.0],
                rotation: [0.0, 0.0, rotation],
                quaternion: None,
                scale: 1.0,
            };
            let motion = Motion::new(&[key(0, 0.0), key(1, 9.0)], Interpolation::Linear, 1.0, 0);
            let mut walls = Walls::new(&[Solid { motion, ..Solid::fixed(shape) }], &rest);
            walls.move_to(1.0);
            walls
        };
        let ball = turning(Shape::Sphere { center: [0.0; 3], radius: 0.5 });
        let x = Vec3::new(2.0 + 0.4 * 0.6, 0.4 * 0.8, 0.0);
        let (out, stuck) = ball.project(1, x);
        assert!(!stuck && (out - x).norm() > 0.1, "{out:?}");
        let bound = 1e-6 * f64::from((out - x).norm());
        assert!(ball.work(x, out).abs() < bound, "{}", ball.work(x, out));
        assert!(ball.pressure_work(out, -1.0).abs() < 10.0 * bound, "{}", ball.pressure_work(out, -1.0));
        // A box of 1.2 m turns its face against a particle 0.5 m from the axis.
        let paddle = turning(Shape::Box { min: [-0.6, -0.05, -0.6], max: [0.6, 0.05, 0.6] });
        let angle = 9.0_f32.to_radians();
        let (along, n) =
            (Vec3::new(angle.cos(), angle.sin(), 0.0), Vec3::new(-angle.sin(), angle.cos(), 0.0));
        let x = Vec3::new(2.0, 0.0, 0.0) + along * 0.5 + n * 0.06;
        let (out, _) = paddle.project(1, x);
        let expected = f64::from((out - x).norm() * 0.5 * angle);
        assert!(expected > 1e-3 && (paddle.work(x, out) / expected - 1.0).abs() < 0.01, "{expected}");
        assert!(paddle.pressure_work(out, -1.0) > 0.0);
    }

    #[test]
    fn the_walls_of_a_tank_move_with_it() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let tank = Shape::Tank { min: [0.0; 3], max: [1.0; 3] };
        let mut walls = Walls::new(&[moving(tank, [0.0; 3], [2.0, 0.0, 0.0])], &rest);
        assert!((walls.max_speed(0.5) - 2.0).abs() < 1e-9);
        walls.move_to(0.5);
        assert!((walls.distance(Vec3::new(1.2, 0.5, 0.5)) - 0.2).abs() < 1e-6);
        let (x, _) = walls.collide_moving(Vec3::new(0.2, 0.5, 0.5), Vec3::new(0.2, 0.5, 0.5));
        assert!((x.x - 1.05).abs() < 1e-6);
    }
}
