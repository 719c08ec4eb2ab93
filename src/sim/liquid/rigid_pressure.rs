//! The particles near rigid bodies, and the pressures at them, in an iteration of the density solve; see `rigid.rs`.

use super::{
    density::Multiplier,
    images::{Images, PairSample, own_image_is_near},
    rigid::{RigidSide, sum_by_body},
    rigid_pairs::{NO_PAIR, RigidPair},
    rigid_system::{BodySystem, Lever, dot, lever},
    setup::{LIST_SKIN, SolverSetup},
    solve::Solver,
    walls::{Mirror, STEEPEST_INTERPOLATED, Walls},
};
use crate::{math::Vec3, par, solid::RigidBody};

/// Distance that a body may move, as a fraction of the skin of the neighbour lists, before the particles at it are searched again. Bodies hardly
/// move within a substep; the larger it is, the more pairs without an image are evaluated.
pub(super) const BODY_SKIN: f32 = 0.25;

/// Distance from a rigid body at which particles have pairs [m]; farther ones reach none before lists are built again. Surface tension reacts
/// on bodies by pairs, and acts where the particles were at the start of the substep: hence a skin more.
fn rigid_reach(setup: &SolverSetup<'_>) -> f32 {
    setup.boundary_reach() + setup.skin()
}

/// An iteration whose pressures bodies yield to.
pub(super) struct YieldStep {
    /// ω of the iteration.
    pub(super) relaxation: f32,
    /// Lower bound of κ at surfaces, or of changes of the Jacobi solver [m²].
    pub(super) smallest: f32,
    /// How far κ inside the liquid may be below that [m²].
    pub(super) tension: f32,
    /// Whether κ is the sum of its changes.
    pub(super) is_accumulating: bool,
}

/// Linear and angular part of what a body takes up of the pressure of a particle.
fn pair_lever(body: &RigidBody, x: Vec3, sample: &PairSample) -> Lever {
    let [force, moment] = sample.image.of_body;
    let mut lever = lever(body, x, force);
    (0..3).for_each(|axis| lever[3 + axis] += f64::from(moment[axis]));
    lever
}

impl Solver {
    /// Finds the distances from solids of the particles that are `chosen` by their positions, and the particles near rigid bodies, where the
    /// lists were built.
    pub(super) fn find_clearance(&mut self, setup: &SolverSetup<'_>, chosen: impl Fn(Vec3) -> bool + Sync) {
        let built_at = &self.built_at;
        par::update(&mut self.clearance, |i, clearance| {
            if chosen(built_at[i]) {
                *clearance = setup.walls.distance(built_at[i]);
            }
        });
        self.find_rigid_pairs(setup);
        self.free_pins_of_solids();
    }

    /// As [`Solver::find_clearance`] of all particles at the predicted positions, where the distances from where lists were built before are
    /// known. Far from solids, where most particles are, lower bounds follow from how far particles and bodies have moved.
    pub(super) fn update_clearance(&mut self, setup: &SolverSetup<'_>) {
        let (walls, reach) = (setup.walls, rigid_reach(setup));
        let (known, shift) = (walls.near_reach(), self.rigid_displacement(walls));
        // Those of pinned particles were replaced (`free_pins_of_solids`).
        for pin in &self.pins {
            self.clearance[pin.particle as usize] = 0.0;
        }
        let (p, built_at) = (&self.p, &self.built_at);
        par::update(&mut self.clearance, |i, clearance| {
            let moved = (p[i] - built_at[i]).norm() + shift;
            let left = clearance.min(known) - STEEPEST_INTERPOLATED * moved;
            *clearance = if left > reach { left } else { walls.distance(p[i]) };
        });
        self.built_at.clone_from(&self.p);
        self.find_rigid_pairs(setup);
        self.free_pins_of_solids();
    }

    /// How far the bodies have moved since [`super::rigid::RigidSide::pairs`] were found [m].
    fn rigid_displacement(&self, walls: &Walls) -> f32 {
        let poses = self.rigid.listed_at.iter().enumerate();
        poses.map(|(body, pose)| walls.rigid_displacement(body, pose)).fold(0.0, f32::max)
    }

    /// Finds the particles near rigid bodies.
    fn find_rigid_pairs(&mut self, setup: &SolverSetup<'_>) {
        let walls = setup.walls;
        let bodies = walls.rigid_bodies();
        if bodies == 0 {
            return;
        }
        let (margin, reach) = (BODY_SKIN * setup.skin(), rigid_reach(setup));
        // Particles may move by half a skin, bodies by the margin.
        let approach = 0.5 * setup.skin() + margin;
        let (p, clearance) = (&self.built_at, &self.clearance);
        let found = par::map_chunks(p.len(), par::CHUNK, |range| {
            let mut pairs = Vec::new();
            for i in range.filter(|&i| clearance[i] < reach) {
                let mut collider_distance = None;
                for body in walls.rigid_bodies_near(p[i], reach) {
                    let distance = walls.min_mirror_distance(body, p[i], approach);
                    pairs.push(RigidPair {
                        particle: i as u32,
                        body: body as u32,
                        x: p[i],
                        collider_distance: *collider_distance
                            .get_or_insert_with(|| walls.collider_distance(p[i])),
                        is_active: true,
                        mirror: Mirror { distance, ..Mirror::default() },
                    });
                }
            }
            pairs
        });
        self.rigid.pairs = found.concat();
        self.rigid.first_pair.clear();
        self.rigid.first_pair.resize(p.len(), NO_PAIR);
        // The bodies may come closer by the margin before the lists are built again.
        for (k, &RigidPair { particle, .. }) in (0..).zip(&self.rigid.pairs) {
            let first = &mut self.rigid.first_pair[particle as usize];
            if *first == NO_PAIR {
                *first = k;
                self.clearance[particle as usize] -= margin;
            }
        }
        let RigidSide { pairs, samples, images, first_pair, .. } = &mut self.rigid;
        samples.clear();
        samples.resize(pairs.len(), PairSample::default());
        images.rebuild(&self.lists, first_pair, pairs, [setup.rest.inv_support, LIST_SKIN]);
        // What this leaves out at the edges of a box, whose density is a product of slabs, is below 5e-5.
        par::update(pairs, |k, pair| {
            let has_image = own_image_is_near(&pair.mirror) || !images.place_of(k).1.is_empty();
            pair.is_active = has_image || walls.has_hollows(pair.body as usize);
        });
        self.rigid.listed_at = walls.rigid_poses();
        (self.rigid.stale, self.rigid.is_sampled) = (false, false);
    }

    /// Marks the pairs as stale if a body has moved farther than its skin since they were found.
    pub(super) fn check_rigid_skin(&mut self, setup: &SolverSetup<'_>) {
        self.rigid.stale |= self.rigid_displacement(setup.walls) > BODY_SKIN * setup.skin();
    }

    /// Evaluates what the particles near rigid bodies see of them, for the passes of an iteration.
    pub(super) fn sample_rigid_pairs(&mut self, setup: &SolverSetup<'_>) {
        if self.rigid.pairs.is_empty() {
            return;
        }
        let Self { p, rigid, .. } = self;
        let walls = setup.walls;
        let RigidSide { pairs, samples, images: lists, image_nodes: nodes, .. } = rigid;
        par::update(pairs, |_, pair| {
            pair.x = p[pair.particle as usize];
            if pair.is_active {
                pair.mirror = walls.mirror(pair.body as usize, pair.x);
            }
        });
        nodes.publish(pairs, setup.rest.inv_support);
        let boundary_reach = setup.boundary_reach();
        par::update(samples, |k, sample| {
            let RigidPair { x, collider_distance, .. } = pairs[k];
            let is_near = collider_distance <= boundary_reach;
            sample.colliders = if is_near { walls.collider_density(x) } else { Default::default() };
        });
        Images { rest: setup.rest, pairs, lists, nodes }.find_densities(samples);
        rigid.is_sampled = true;
    }

    /// Evaluates the displacements of the particles near rigid bodies by their images, for the next correction.
    pub(super) fn sample_image_pushes(&mut self, setup: &SolverSetup<'_>) {
        let Self { rigid, nodes, .. } = self;
        if !rigid.is_sampled {
            return;
        }
        let RigidSide { pairs, samples, images: lists, image_nodes, .. } = rigid;
        image_nodes.set_lambda(pairs, |i| nodes[i as usize].value());
        Images { rest: setup.rest, pairs, lists, nodes: image_nodes }.find_pushes(samples);
    }

    /// Reduces the changes of pressure near bodies by what the bodies yield to them, before particles are moved.
    pub(super) fn yield_to_rigid_bodies(&mut self, bodies: &[RigidBody], mass: f64, step: &YieldStep) {
        let &YieldStep { relaxation, smallest, tension, is_accumulating } = step;
        let Self { rigid, multipliers, nodes, tensile_part, .. } = self;
        let lower_bound = |i: usize| smallest - tension * tensile_part[i];
        let Multiplier { lambda, applied, last, denominator } = &mut multipliers.0;
        let RigidSide { pairs, samples, .. } = rigid;
        let (change, total, diagonal) = (&*lambda, &*applied, &*denominator);
        let is_active = |i: usize| !is_accumulating || total[i] > lower_bound(i);
        let add = |k: usize, sums: &mut [BodySystem]| {
            let (RigidPair { particle, body, x, .. }, sample) = (pairs[k], &samples[k]);
            let (i, body) = (particle as usize, body as usize);
            if sample.image.of_body[0] != Vec3::zeros() && is_active(i) {
                let lever = pair_lever(&bodies[body], x, sample);
                sums[body].add(&lever, f64::from(relaxation / diagonal[i]), -f64::from(change[i]));
            }
        };
        let systems = sum_by_body(pairs.len(), bodies.len(), &BodySystem::zero(), add, BodySystem::merge);
        let solve = |(system, body): (BodySystem, &RigidBody)| system.solve(body, mass);
        let yielded: Vec<Lever> = systems.into_iter().zip(bodies).map(solve).collect();
        par::update(samples, |k, sample| {
            let RigidPair { body, x, .. } = pairs[k];
            let body = body as usize;
            sample.gives = dot(&pair_lever(&bodies[body], x, sample), &yielded[body]) as f32;
        });
        for (&RigidPair { particle, .. }, &PairSample { gives, .. }) in pairs.iter().zip(&*samples) {
            let i = particle as usize;
            if gives == 0.0 || (is_accumulating && applied[i] <= lower_bound(i)) {
                continue;
            }
            let less = relaxation * gives / denominator[i];
            if is_accumulating {
                let reduced = (applied[i] - less).max(lower_bound(i));
                lambda[i] += applied[i] - reduced;
                applied[i] = reduced;
                last[i] = (last[i] - less).max(lower_bound(i));
            } else {
                lambda[i] = (lambda[i] + less).min(-smallest);
            }
            nodes[i].0[3] = lambda[i];
        }
    }

    /// Adds the reactions to the last correction to the bodies, those of pressure where the particles were before it, and of projections.
    pub(super) fn push_rigid_bodies(&mut self, walls: &Walls, bodies: &mut [RigidBody], units: [f64; 2]) {
        let Self { rigid, p, wall_push, .. } = self;
        rigid.discard_samples();
        let push = |pair: &RigidPair, PairSample { push, .. }: &PairSample| {
            (push.by_body != Vec3::zeros()).then_some((pair.x, push.by_body))
        };
        rigid.react_to_pairs(bodies, units[1], push);
        rigid.exchange_projections(walls, [p, wall_push], bodies, units);
    }
}
