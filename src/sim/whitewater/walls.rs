//! Solids around whitewater, through which no particle passes, and what accelerates it.
//!
//! *Method*: the path of a particle relative to a solid is traced through the solid's signed distance (sphere tracing), stops
//! at the surface and slides on along it. What is inside in the end is projected out. The normal velocity into the solid is removed.

use crate::{
    math::Vec3,
    sim::{
        Timeline, World,
        force::{ForceParams, Forces},
    },
    solid::{Pose, Shape, Solid},
};
use std::borrow::Cow;

/// Most steps of sphere tracing along a path; each is as long as the distance, and at least half a radius. After them the particle
/// stops there.
const MAX_TRACING_STEPS: usize = 64;

/// Most times that a path is bent along surfaces.
const MAX_SLIDES: usize = 3;

/// Sine of the angle below which a path is along a surface: what sliding leaves of a path into a solid.
const GRAZING: f32 = 1e-4;

/// Most projections out of all solids; a particle that is then still inside is between two of them.
const MAX_PROJECTIONS: usize = 6;

/// Solids, gravity and forces of a shot.
#[derive(Clone, Debug)]
pub(crate) struct Walls {
    pub(super) solids: Vec<Solid>,
    pub(super) gravity: Vec3,
    /// Those that act on the liquid act on its spray.
    pub(super) forces: Option<Forces>,
}

/// A particle that moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mover {
    pub(super) x: Vec3,
    pub(super) v: Vec3,
    /// Distance that it keeps from surfaces [m].
    pub(super) radius: f32,
}

/// Result of a motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Contact {
    None,
    /// A solid was touched.
    Touched,
    /// It is inside a solid that it could not be projected out of.
    Stuck,
}

/// A solid at a time.
#[derive(Clone, Debug)]
pub(super) struct PlacedSolid<'a> {
    shape: Cow<'a, Shape>,
    is_deforming: bool,
    pose: Pose,
}

/// All solids at the start and the end of a step.
#[derive(Clone, Debug)]
pub(super) struct StepSolids<'a> {
    before: Vec<PlacedSolid<'a>>,
    after: Vec<PlacedSolid<'a>>,
    /// Length of the step [s].
    pub(super) dt: f32,
}

impl Walls {
    /// Solids and gravity of a world, and the forces on its liquid.
    pub(crate) fn new(world: &World, forces: &[ForceParams], timeline: Timeline) -> Self {
        let forces = Forces::on("liquid", forces, timeline);
        Self { solids: world.solids.clone(), gravity: world.gravity, forces }
    }

    /// Whether forces act on spray.
    pub(crate) fn has_forces(&self) -> bool {
        self.forces.is_some()
    }

    /// The solids at a time since the shot's start [s].
    pub(super) fn at(&self, time: f64) -> Vec<PlacedSolid<'_>> {
        let pose =
            |solid: &Solid| solid.motion.as_ref().map_or_else(Pose::identity, |motion| motion.pose(time));
        self.solids
            .iter()
            .map(|solid| PlacedSolid {
                shape: solid.shape_at(time),
                is_deforming: solid.is_deforming(),
                pose: pose(solid),
            })
            .collect()
    }

    /// The solids at both ends of a step [s].
    pub(super) fn step(&self, from: f64, to: f64) -> StepSolids<'_> {
        StepSolids { before: self.at(from), after: self.at(to), dt: (to - from) as f32 }
    }

    /// Distance to the nearest of the solids [m]; infinite without any.
    pub(super) fn distance(solids: &[PlacedSolid], x: Vec3) -> f32 {
        solids.iter().map(|solid| solid.distance(x)).fold(f32::INFINITY, f32::min)
    }

    /// Moves a particle from where it is to `target`, unless solids are in the way.
    pub(super) fn advance(solids: &StepSolids, mover: &mut Mover, mut target: Vec3) -> Contact {
        let mut contact = Contact::None;
        let mut stopped_at = None;
        for _ in 0..MAX_SLIDES {
            let Some((place, hit)) = first_hit(solids, mover, target) else {
                stopped_at = None;
                break;
            };
            contact = Contact::Touched;
            let (before, after) = (&solids.before[place].pose, &solids.after[place].pose);
            stopped_at = Some(after.to_world(hit.x));
            // The rest of the path goes along the surface, from where it meets it.
            let rest = if hit.slides { after.to_local(target) - hit.x } else { Vec3::zeros() };
            mover.x = before.to_world(hit.x);
            target = after.to_world(hit.x + rest - hit.n * rest.dot(&hit.n).min(0.0));
        }
        // What is still stopped is in a corner.
        target = stopped_at.unwrap_or(target);
        for _ in 0..MAX_PROJECTIONS {
            let mut is_inside = false;
            for (before, after) in solids.before.iter().zip(&solids.after) {
                let local = after.pose.to_local(target);
                let (d, n) = after.shape.contact(local);
                if d >= mover.radius * (1.0 - 1e-3) && contact == Contact::None {
                    continue;
                }
                if d < mover.radius * 1.5 {
                    // Within reach of the surface that stopped it, the velocity into the solid is removed.
                    let n = after.pose.rotation * n;
                    let mut displacement = after.pose.to_world(local) - before.pose.to_world(local);
                    if after.is_deforming {
                        displacement +=
                            after.pose.rotation * after.shape.displacement_since(&before.shape, local);
                    }
                    let surface = displacement / solids.dt.max(f32::MIN_POSITIVE);
                    mover.v -= n * (mover.v - surface).dot(&n).min(0.0);
                }
                if d < mover.radius * (1.0 - 1e-3) {
                    is_inside = true;
                    contact = Contact::Touched;
                    target = after.pose.to_world(local + n * (mover.radius - d));
                }
            }
            if !is_inside {
                mover.x = target;
                return contact;
            }
        }
        mover.x = target;
        if Self::distance(&solids.after, target) < 0.0 { Contact::Stuck } else { contact }
    }
}

impl PlacedSolid<'_> {
    fn distance(&self, x: Vec3) -> f32 {
        self.shape.signed_distance(self.pose.to_local(x))
    }
}

/// The solid that the path to `target` meets first, in the order along the path, and where.
fn first_hit(solids: &StepSolids, mover: &Mover, target: Vec3) -> Option<(usize, Hit)> {
    let pairs = solids.before.iter().zip(&solids.after).enumerate();
    let hits = pairs.filter_map(|(place, (before, after))| {
        let (from, to) = (before.pose.to_local(mover.x), after.pose.to_local(target));
        trace(&after.shape, from, to, mover.radius).map(|hit| (place, hit))
    });
    hits.min_by(|(_, a), (_, b)| a.part.total_cmp(&b.part))
}

/// Where a path comes close to a surface.
struct Hit {
    /// Part of the path before it, 0 to 1.
    part: f32,
    x: Vec3,
    n: Vec3,
    /// Whether the rest of the path is known to be free along the surface.
    slides: bool,
}

/// Where the path between two places in a solid's own coordinates comes within `radius` of its surface on its way in; `None` if it does
/// not.
fn trace(shape: &Shape, from: Vec3, to: Vec3, radius: f32) -> Option<Hit> {
    let path = to - from;
    let length = path.norm();
    let mut distance = shape.signed_distance(from);
    if length <= 0.0 || distance - length > radius {
        return None;
    }
    let (mut at, mut x) = (0.0, from);
    for step in 0..=MAX_TRACING_STEPS {
        if step == MAX_TRACING_STEPS {
            let (_, n) = shape.contact(x);
            return Some(Hit { part: at / length, x, n, slides: false });
        }
        if distance <= radius * 1.01 {
            let (_, n) = shape.contact(x);
            // Along the surface, or away from it: it may meet another part of it.
            if path.dot(&n) < -GRAZING * length {
                return Some(Hit { part: at / length, x, n, slides: true });
            }
        }
        // Half a radius cannot jump over a surface, and does not creep along one.
        at += (distance - radius).max(0.5 * radius);
        if at >= length {
            return None;
        }
        x = from + path * (at / length);
        distance = shape.signed_distance(x);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{math::Random, solid::Shape};

    fn walls(shapes: &[Shape]) -> Walls {
        let solids = shapes.iter().cloned().map(Solid::fixed).collect();
        Walls { solids, gravity: Vec3::zeros(), forces: None }
    }

    #[test]
    fn no_particle_passes_through_the_tube_of_a_torus() {
        let torus = Shape::Torus { center: [0.0; 3], axis: [0.0, 0.0, 1.0], radius: 0.05, tube: 0.004 };
        let walls = walls(&[torus]);
        let poses = walls.step(0.0, 1.0 / 96.0);
        let random = Random::new([4, 5, 6]);
        for i in 0..4000_u64 {
            let u = |k: u64| random.at(8 * i + k) * 2.0 - 1.0;
            // In the plane of the ring, where nothing leads around the tube.
            let x = Vec3::new(0.03 * u(0), 0.03 * u(1), 0.0);
            let mut mover = Mover { x, v: Vec3::new(4.0 * u(2), 4.0 * u(3), 0.0), radius: 2e-4 };
            let target = x + mover.v * poses.dt;
            Walls::advance(&poses, &mut mover, target);
            assert!(mover.x.norm() < 0.046, "{i}: from {x:?} to {:?}", mover.x);
        }
    }

    #[test]
    fn no_particle_leaves_a_cup_of_thin_slabs() {
        let slab = |center: [f32; 3], size: [f32; 3]| {
            let half = |axis: usize| size[axis] / 2.0;
            Shape::Box {
                min: std::array::from_fn(|axis| center[axis] - half(axis)),
                max: std::array::from_fn(|axis| center[axis] + half(axis)),
            }
        };
        // Walls after the floor and before it, since the order of solids must not matter.
        let mut slabs = vec![
            slab([0.04, 0.04, 0.0], [0.002, 0.08, 0.082]),
            slab([0.0, 0.04, 0.04], [0.082, 0.08, 0.002]),
            slab([0.0, 0.0, 0.0], [0.082, 0.002, 0.082]),
            slab([-0.04, 0.04, 0.0], [0.002, 0.08, 0.082]),
            slab([0.0, 0.04, -0.04], [0.082, 0.08, 0.002]),
        ];
        let random = Random::new([7, 8, 9]);
        for _ in 0..2 {
            let walls = walls(&slabs);
            let poses = walls.step(0.0, 1.0 / 96.0);
            for i in 0..4000_u64 {
                let u = |k: u64| random.at(8 * i + k) * 2.0 - 1.0;
                let x = Vec3::new(0.038 * u(0), 0.005 + 0.003 * u(1), 0.038 * u(2));
                let v = Vec3::new(4.0 * u(3), -4.0 * u(4).abs(), 4.0 * u(5));
                let mut mover = Mover { x, v, radius: 2e-4 };
                Walls::advance(&poses, &mut mover, x + v * poses.dt);
                let inside = mover.x.x.abs() < 0.039 && mover.x.z.abs() < 0.039 && mover.x.y > 0.001;
                assert!(inside, "{i}: from {x:?} at {v:?} to {:?}", mover.x);
            }
            slabs.reverse();
        }
    }
}
