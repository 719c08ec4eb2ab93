//! What could not be kept apart moves as one.
//!
//! *Method*: rigid impact zones ([provot97], [bridson02]): points of pairs that might pass through each other move together as a
//! rigid body with their momentum and angular momentum, and with the zones that they meet, until none is left.
//! *Departs from the papers*: whether a pair might pass is not asked of roots in time but of bounds that take in the whole substep. Ways are
//! linear in time; so two features have not met if (1) the distance they began with is longer than their relative way, or (2) a plane
//! parts them at the start and at the end, and so always, or (3) distances at the start and at the end together are longer than their relative way.
//! A pair that passes by none of the three may not have met either; it is held all the same.
//!
//! Limits: a zone whose points of no mobility go different ways cannot be one.

use super::{
    closest::Double,
    solve::{Body, Touch},
};
use crate::par::Forest;
use nalgebra::Matrix3;

/// Rounds at most: each adds at least one pair to a zone, and a zone of all is the end.
const ROUNDS: usize = 32;

/// The part of the thickness that is never given up, but by what had less from the start.
const LEAST: f64 = 0.1;

/// Rounds in which a zone is moved out of solids.
const CORNERS: usize = 8;

/// The part of a distance below that which a substep may take all the same: rounding.
const SAME: f64 = 0.98;

/// What had to be done.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Held {
    /// Points that moved as one with others.
    pub(super) points: u64,
    /// Pairs of which it is not known that they have not met.
    pub(super) unseparated: u64,
}

/// Makes one of what might pass through each other in a substep of `dt` [s].
pub(super) fn hold(touches: &[Touch], all: &mut [Body], dt: f64, thickness: f64) -> Held {
    let mut unsafe_pairs = failing(touches, all, thickness);
    if unsafe_pairs.is_empty() {
        return Held::default();
    }
    let mut joined: Vec<[usize; 4]> = Vec::new();
    let mut points = 0;
    for _ in 0..ROUNDS {
        joined.extend(unsafe_pairs.iter().map(|&k| touches[k].bodies));
        points = move_as_one(&joined, all, dt);
        unsafe_pairs = failing(touches, all, thickness);
        let bodies = |k: &usize| touches[*k].bodies;
        if unsafe_pairs.iter().all(|k| joined.contains(&bodies(k))) {
            break;
        }
    }
    Held { points, unseparated: unsafe_pairs.len() as u64 }
}

fn failing(touches: &[Touch], all: &[Body], thickness: f64) -> Vec<usize> {
    (0..touches.len()).filter(|&k| !is_safe(&touches[k], all, thickness)).collect()
}

/// Whether a pair has surely not met.
fn is_safe(touch: &Touch, all: &[Body], thickness: f64) -> bool {
    let near = &touch.near;
    // What lies in one place has no side to be on.
    if near.distance <= 1e-6 * thickness {
        return true;
    }
    let bodies = touch.bodies.map(|i| &all[i]);
    let split = near.features.sides().0.len();
    let cross = || (0..split).flat_map(|a| (split..4).map(move |b| (a, b)));
    let least = (SAME * near.distance).min(LEAST * near.thickness);
    let way = cross().map(|(a, b)| (bodies[a].way - bodies[b].way).norm_squared()).fold(0.0, f64::max).sqrt();
    if near.distance - way >= least {
        return true;
    }
    let ends = bodies.map(|body| body.start + body.way);
    let plane = cross().map(|(a, b)| (ends[a] - ends[b]).dot(&near.normal)).fold(f64::INFINITY, f64::min);
    if plane >= least {
        return true;
    }
    let after = near.features.distance(ends);
    after >= least && near.distance + after > 1.01 * way
}

/// Gives every zone one rigid motion; returns how many points are in zones.
fn move_as_one(joined: &[[usize; 4]], all: &mut [Body], dt: f64) -> u64 {
    let forest = Forest::new(all.len());
    for bodies in joined {
        bodies[1..].iter().for_each(|&i| forest.join(bodies[0] as u32, i as u32));
    }
    let roots = forest.roots();
    let mut is_in = vec![false; all.len()];
    joined.iter().flatten().for_each(|&i| is_in[i] = true);
    let mut members: Vec<(u32, usize)> =
        (0..all.len()).filter(|&i| is_in[i]).map(|i| (roots[i], i)).collect();
    members.sort_unstable();
    for zone in members.chunk_by(|a, b| a.0 == b.0) {
        let zone: Vec<usize> = zone.iter().map(|&(_, i)| i).collect();
        rigid(&zone, all, dt);
    }
    members.len() as u64
}

fn rigid(zone: &[usize], all: &mut [Body], dt: f64) {
    let fixed: Vec<usize> = zone.iter().copied().filter(|&i| all[i].mobility == 0.0).collect();
    if !fixed.is_empty() {
        // It goes with what cannot be moved.
        let way = fixed.iter().map(|&i| all[i].way).sum::<Double>() / fixed.len() as f64;
        for &i in zone {
            if all[i].mobility > 0.0 {
                (all[i].way, all[i].velocity) = (way, way / dt);
            }
        }
        return;
    }
    let mass = |i: usize| 1.0 / all[i].mobility;
    let total: f64 = zone.iter().map(|&i| mass(i)).sum();
    let centre = zone.iter().map(|&i| all[i].start * mass(i)).sum::<Double>() / total;
    let velocity = zone.iter().map(|&i| all[i].velocity * mass(i)).sum::<Double>() / total;
    let (mut turning, mut inertia) = (Double::zeros(), Matrix3::zeros());
    for &i in zone {
        let r = all[i].start - centre;
        turning += r.cross(&all[i].velocity) * mass(i);
        inertia += (Matrix3::identity() * r.norm_squared() - r * r.transpose()) * mass(i);
    }
    // Points on one line have no moment of inertia about it, and no angular momentum.
    let scale = inertia.trace();
    let inverse = (inertia + Matrix3::identity() * (1e-12 * scale)).try_inverse();
    let spin = inverse.map_or(Double::zeros(), |inverse| inverse * turning); // [provot97]: ω = I⁻¹ L
    for &i in zone {
        let v = velocity + spin.cross(&(all[i].start - centre));
        (all[i].way, all[i].velocity) = (v * dt, v);
    }
    // Where it would enter solids it is moved out as a whole; in a corner each undoes part of the others'.
    for _ in 0..CORNERS {
        let depth = |&i: &usize| all[i].wall.map(|wall| (wall.depth(all[i].way), wall.normal));
        let Some((depth, normal)) = zone.iter().filter_map(depth).max_by(|a, b| a.0.total_cmp(&b.0)) else {
            return;
        };
        if depth <= 0.0 {
            return;
        }
        for &i in zone {
            all[i].way += normal * depth;
            all[i].velocity += normal * (depth / dt);
        }
    }
}
