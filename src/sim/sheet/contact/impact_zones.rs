//! Rigid impact zones: what impulses could not keep apart moves as one.
//!
//! *Method*: rigid impact zones ([provot97], [bridson02]). Points of pairs that might pass through each other
//! move together as a rigid body that keeps their momentum and angular momentum. Zones merge with the zones
//! they touch until no such pair is left.
//! *Departs from the papers*: continuous collision detection does not solve for roots in time, but uses
//! bounds that cover the whole substep. Points move linearly in time, so two features have not passed through
//! each other if (1) their distance at the start exceeds their relative displacement, or (2) one plane
//! separates them at the start and at the end, and so at all times, or (3) the sum of their distances at the
//! start and at the end exceeds their relative displacement.
//! A pair that meets none of the three conditions may not have collided either; it joins a zone all the same.
//!
//! Limits: a zone cannot be rigid if its points of zero mobility move in different directions.

use super::{
    closest_points::Double,
    impulses::{Body, ContactConstraint},
};
use crate::par::Forest;
use nalgebra::Matrix3;

/// Iterations at most: each adds at least one pair to a zone, and a zone of all points is the end.
const MAX_ITERATIONS: usize = 32;

/// The part of the thickness that is always kept, unless the distance was less at the start.
const MIN_GAP_FRACTION: f64 = 0.1;

/// Passes in which a zone is moved out of solids.
const MAX_SOLID_PASSES: usize = 8;

/// The part of the distance at the start that must be left: the rest covers rounding.
const KEPT_DISTANCE_FRACTION: f64 = 0.98;

/// What impact zones did in a substep.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ZoneReport {
    /// Points that moved as part of a zone.
    pub(super) points: u64,
    /// Pairs that were not proven separate.
    pub(super) unseparated: u64,
}

/// Merges pairs that might pass through each other in a substep of `dt` [s] into rigid zones.
pub(super) fn resolve(
    constraints: &[ContactConstraint],
    bodies: &mut [Body],
    dt: f64,
    thickness: f64,
) -> ZoneReport {
    let mut unseparated = unseparated_pairs(constraints, bodies, thickness);
    if unseparated.is_empty() {
        return ZoneReport::default();
    }
    let mut merged: Vec<[usize; 4]> = Vec::new();
    let mut points = 0;
    for _ in 0..MAX_ITERATIONS {
        merged.extend(unseparated.iter().map(|&k| constraints[k].bodies));
        points = move_zones(&merged, bodies, dt);
        unseparated = unseparated_pairs(constraints, bodies, thickness);
        let members = |k: &usize| constraints[*k].bodies;
        if unseparated.iter().all(|k| merged.contains(&members(k))) {
            break;
        }
    }
    ZoneReport { points, unseparated: unseparated.len() as u64 }
}

fn unseparated_pairs(constraints: &[ContactConstraint], bodies: &[Body], thickness: f64) -> Vec<usize> {
    (0..constraints.len()).filter(|&k| !is_separated(&constraints[k], bodies, thickness)).collect()
}

/// Whether the features of a pair have certainly not passed through each other.
fn is_separated(constraint: &ContactConstraint, bodies: &[Body], thickness: f64) -> bool {
    let pair = &constraint.pair;
    // Coincident features have no side to be on.
    if pair.distance <= 1e-6 * thickness {
        return true;
    }
    let bodies = constraint.bodies.map(|i| &bodies[i]);
    let split = pair.features.sides().0.len();
    let cross = || (0..split).flat_map(|a| (split..4).map(move |b| (a, b)));
    let min_gap = (KEPT_DISTANCE_FRACTION * pair.distance).min(MIN_GAP_FRACTION * pair.thickness);
    let displacement = cross()
        .map(|(a, b)| (bodies[a].displacement - bodies[b].displacement).norm_squared())
        .fold(0.0, f64::max)
        .sqrt();
    if pair.distance - displacement >= min_gap {
        return true;
    }
    let ends = bodies.map(|body| body.start + body.displacement);
    let plane = cross().map(|(a, b)| (ends[a] - ends[b]).dot(&pair.normal)).fold(f64::INFINITY, f64::min);
    if plane >= min_gap {
        return true;
    }
    let end_distance = pair.features.distance(ends);
    end_distance >= min_gap && pair.distance + end_distance > 1.01 * displacement
}

/// Gives every zone one rigid motion; returns how many points are in zones.
fn move_zones(merged: &[[usize; 4]], bodies: &mut [Body], dt: f64) -> u64 {
    let forest = Forest::new(bodies.len());
    for bodies in merged {
        bodies[1..].iter().for_each(|&i| forest.join(bodies[0] as u32, i as u32));
    }
    let roots = forest.roots();
    let mut is_in_zone = vec![false; bodies.len()];
    merged.iter().flatten().for_each(|&i| is_in_zone[i] = true);
    let mut members: Vec<(u32, usize)> =
        (0..bodies.len()).filter(|&i| is_in_zone[i]).map(|i| (roots[i], i)).collect();
    members.sort_unstable();
    for zone in members.chunk_by(|a, b| a.0 == b.0) {
        let zone: Vec<usize> = zone.iter().map(|&(_, i)| i).collect();
        move_rigidly(&zone, bodies, dt);
    }
    members.len() as u64
}

fn move_rigidly(zone: &[usize], bodies: &mut [Body], dt: f64) {
    let fixed: Vec<usize> = zone.iter().copied().filter(|&i| bodies[i].mobility == 0.0).collect();
    if !fixed.is_empty() {
        // The zone moves with its points of zero mobility.
        let displacement = fixed.iter().map(|&i| bodies[i].displacement).sum::<Double>() / fixed.len() as f64;
        for &i in zone {
            if bodies[i].mobility > 0.0 {
                (bodies[i].displacement, bodies[i].velocity) = (displacement, displacement / dt);
            }
        }
        return;
    }
    let mass = |i: usize| 1.0 / bodies[i].mobility;
    let total: f64 = zone.iter().map(|&i| mass(i)).sum();
    let centre = zone.iter().map(|&i| bodies[i].start * mass(i)).sum::<Double>() / total;
    let velocity = zone.iter().map(|&i| bodies[i].velocity * mass(i)).sum::<Double>() / total;
    let (mut angular_momentum, mut inertia) = (Double::zeros(), Matrix3::zeros());
    for &i in zone {
        let r = bodies[i].start - centre;
        angular_momentum += r.cross(&bodies[i].velocity) * mass(i);
        inertia += (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass(i);
    }
    // Collinear points have no moment of inertia about their line, and no angular momentum.
    let scale = inertia.trace();
    let inverse = (inertia + Matrix3::identity() * (1e-12 * scale)).try_inverse();
    let angular_velocity = inverse.map_or(Double::zeros(), |inverse| inverse * angular_momentum); // [provot97]: ω = I⁻¹ L
    for &i in zone {
        let v = velocity + angular_velocity.cross(&(bodies[i].start - centre));
        (bodies[i].displacement, bodies[i].velocity) = (v * dt, v);
    }
    // Where the zone would enter solids it is moved out as a whole. In a corner each push undoes part of the
    // others.
    for _ in 0..MAX_SOLID_PASSES {
        let depth = |&i: &usize| bodies[i].wall.map(|wall| (wall.depth(bodies[i].displacement), wall.normal));
        let Some((depth, normal)) = zone.iter().filter_map(depth).max_by(|a, b| a.0.total_cmp(&b.0)) else {
            return;
        };
        if depth <= 0.0 {
            return;
        }
        for &i in zone {
            bodies[i].displacement += normal * depth;
            bodies[i].velocity += normal * (depth / dt);
        }
    }
}
