//! Contact of sheets with each other and with themselves.
//!
//! *Method*: [bridson02] with the steps in another order, since a time step is short compared with the
//! thickness here. The integrator first moves the points. The broad phase (`broad_phase.rs`, a bounding
//! volume hierarchy in `bvh.rs`) lists candidate pairs of a point and a triangle or of two edges. The narrow
//! phase (`narrow_phase.rs`) keeps those that are close or become so within the substep. Contact impulses
//! with friction separate them (`impulses.rs`). Pairs that might have passed through each other all the same
//! become rigid impact zones (`impact_zones.rs`). If no edge goes through a face at the start of a substep,
//! none does at its end.
//! *Departs from the paper*: continuous collision detection solves no cubic for the time of impact. A substep
//! is shorter than half the thickness over the fastest approach of the candidates. Weights and normals of its
//! start therefore hold for all of it, and bounds on displacements replace the roots. Contact shortens the
//! substep by halving, and it stays short until the frame ends. The symplectic integrator conserves a
//! different energy for each length, so springs ring without end if the length changes in every substep
//! (three cloths had 5 J in place of 0.1 J, at `courant` 0.9).
//!
//! Symbols: h → `thickness` [m].
//! Limits: friction turns a pair by its impulse times its distance. What intersects at the start of a frame
//! is not kept apart. Collisions with solids are resolved last, so contact never leaves a point inside a
//! solid.

mod broad_phase;
mod bvh;
mod closest_points;
mod collision_mesh;
mod impact_zones;
mod impulses;
mod intersections;
mod narrow_phase;
mod substep;

use super::{
    model::Model,
    params::{Contact as Params, SheetsParams},
    record::ContactRecord,
    solids::PlacedSolid,
    vectors::Vectors,
};
use crate::math::elementary::{exp2, log2};
use crate::par;
use broad_phase::{BroadPhase, CandidateList};
use bvh::Bvh;
use collision_mesh::CollisionMesh;
use impulses::{Body, ContactConstraint, Wall};
use narrow_phase::ContactPair;
use std::ops::Range;

/// How far a point may deviate from its predicted position, in parts of the thickness. With less, more points
/// are searched again. At 0.5 a search took four times as long, since cells of three times the thickness then
/// come near their own neighbours.
const PREDICTION_SLACK: f32 = 0.25;

/// Smoothing passes over the velocities that predict positions.
const VELOCITY_SMOOTHING_PASSES: usize = 4;

/// Largest displacement of one side relative to the other within a substep, in parts of the thickness.
const MAX_APPROACH: f64 = 0.5;

/// Displacement of a point by contact itself after which pairs are detected again, in parts of the thickness.
/// The narrow phase looks two of these further than the thickness.
const RECHECK_DISPLACEMENT: f64 = 0.25;

/// Passes of detection and resolution per substep at most.
const MAX_CONTACT_PASSES: usize = 4;

/// Halvings of a substep at most: they allow more substeps than any `max_substeps`.
const MAX_HALVINGS: f64 = 60.0;

/// How many substeps a candidate list covers. A shorter span needs more searches, a longer one makes longer
/// lists.
const CANDIDATE_SPAN: f64 = 16.0;

/// Contact of sheets, and what it keeps during a frame.
#[derive(Debug)]
pub(super) struct SheetContact {
    params: Params,
    mesh: CollisionMesh,
    bvh: Bvh,
    /// Positions at the start of the substep.
    start: Vectors,
    candidates: Option<CandidateList>,
    /// How often the substep was halved in this frame.
    halvings: f64,
    /// Points of the triangles that intersected when the frame began; `None`: not known yet.
    tangled: Option<Vec<bool>>,
    /// Index of each point among the bodies of a pass; `u32::MAX`: none.
    body_index: Vec<u32>,
}

/// A substep that the integrator has made: from the positions at [`SheetContact::begin_substep`] to `x` and
/// `v`, in `dt` [s] from `now`.
pub(super) struct IntegratedStep<'a> {
    pub(super) x: &'a mut Vectors,
    pub(super) v: &'a mut Vectors,
    pub(super) mobility: &'a [f32],
    /// Solids, and the coefficient of friction on them.
    pub(super) solids: &'a [PlacedSolid<'a>],
    pub(super) friction: f64,
    pub(super) now: f64,
    pub(super) dt: f64,
}

impl SheetContact {
    /// Contact of these sheets.
    pub(super) fn new(
        params: &Params,
        sheets: &SheetsParams,
        models: &[Model],
        ranges: &[Range<usize>],
    ) -> Self {
        let rest_factors: Vec<[f32; 2]> = sheets.sheet.iter().map(|sheet| sheet.rest).collect();
        let mesh = CollisionMesh::new(models, ranges, &rest_factors);
        let count = mesh.rest_positions.len();
        Self {
            params: params.clone(),
            bvh: Bvh::new(&mesh),
            mesh,
            start: Vectors::zeros(count),
            candidates: None,
            halvings: 0.0,
            tangled: None,
            body_index: par::repeated(u32::MAX, count),
        }
    }

    /// Sets which points joints hold together from now on.
    pub(super) fn set_seams(&mut self, pairs: &[[u32; 2]]) {
        self.mesh.set_seams(pairs, 2.0 * f64::from(self.params.thickness));
        self.candidates = None;
    }

    /// Number of edges that go through faces.
    pub(super) fn crossings(&self, x: &Vectors) -> u64 {
        intersections::crossings(&self.mesh, &self.bvh, x).len() as u64
    }

    /// Begins a frame. It forgets the candidates, so that a resumed frame has the same bits.
    pub(super) fn begin_frame(&mut self, x: &Vectors) {
        self.candidates = None;
        self.halvings = 0.0;
        if self.tangled.is_none() {
            let found = intersections::crossings(&self.mesh, &self.bvh, x);
            self.tangled = Some(intersections::tangled(&self.mesh, &found));
        }
    }

    /// Ends a frame: counts the intersections.
    pub(super) fn end_frame(&mut self, x: &Vectors, record: &mut ContactRecord) {
        let found = intersections::crossings(&self.mesh, &self.bvh, x);
        record.crossings = found.len() as u64;
        self.tangled = Some(intersections::tangled(&self.mesh, &found));
    }

    /// Forgets which points are tangled, after positions were replaced.
    pub(super) fn forget_tangles(&mut self) {
        self.tangled = None;
    }

    /// The longest substep from `now` [s] that keeps approaches shorter than the thickness [s], and a point
    /// of the fastest pair. `substep` is its length without contact, and `left` the rest of the frame.
    pub(super) fn max_substep(
        &mut self,
        x: &Vectors,
        v: &Vectors,
        now: f64,
        [substep, left]: [f64; 2],
        record: &mut ContactRecord,
    ) -> (f64, usize) {
        if self.candidates.is_none() {
            self.build_candidates(x, v.clone(), now, substep.min(left), record);
        }
        let Some(candidates) = &self.candidates else { return (f64::INFINITY, 0) };
        let approach = MAX_APPROACH * f64::from(self.params.thickness) / candidates.max_speed;
        // Without springs nothing rings, so the substep need not be halved.
        if !substep.is_finite() {
            return (approach, candidates.fastest_point);
        }
        let wanted = log2(substep / approach).ceil().clamp(0.0, MAX_HALVINGS);
        self.halvings = self.halvings.max(wanted);
        if self.halvings == 0.0 {
            (f64::INFINITY, 0)
        } else {
            (substep / exp2(self.halvings), candidates.fastest_point)
        }
    }

    /// Stores the positions at which a substep begins.
    pub(super) fn begin_substep(&mut self, x: &Vectors) {
        self.start.clone_from(x);
    }

    fn broad_phase(&self) -> BroadPhase<'_> {
        BroadPhase {
            mesh: &self.mesh,
            bvh: &self.bvh,
            tangled: self.tangled.as_deref().unwrap_or(&[]),
            thickness: f64::from(self.params.thickness),
        }
    }

    /// Builds the candidate list that begins now and covers `CANDIDATE_SPAN` substeps of `substep` [s].
    fn build_candidates(
        &mut self,
        x: &Vectors,
        v: Vectors,
        now: f64,
        substep: f64,
        record: &mut ContactRecord,
    ) {
        record.searches += 1;
        let v = self.mesh.smoothed(v, VELOCITY_SMOOTHING_PASSES);
        let slack = PREDICTION_SLACK * self.params.thickness;
        self.candidates =
            Some(self.broad_phase().candidates(x, v, [now, now + CANDIDATE_SPAN * substep], slack));
    }

    /// Rebuilds or updates the candidate list so that it holds for the substep.
    pub(super) fn update_candidates(&mut self, step: &IntegratedStep<'_>, record: &mut ContactRecord) {
        let then = step.now + step.dt;
        let start = std::mem::take(&mut self.start);
        if self.candidates.as_ref().is_none_or(|candidates| then > candidates.until + 1e-3 * step.dt) {
            let mut v = Vectors::zeros(step.x.len());
            let per = 1.0 / step.dt as f32;
            v.update(|at, axes| {
                let (from, to) = (start.eight(at), step.x.eight(at));
                for (axis, out) in axes.into_iter().enumerate() {
                    for lane in 0..out.len() {
                        out[lane] = (to[axis][lane] - from[axis][lane]) * per;
                    }
                }
            });
            self.build_candidates(&start, v, step.now, step.dt, record);
        }
        if let Some(mut candidates) = self.candidates.take() {
            let deviating = candidates.deviating(step.x, then);
            if !deviating.is_empty() {
                self.broad_phase().update(&mut candidates, &deviating, [&start, step.x], [step.now, then]);
                record.renewed += deviating.len() as u64;
            }
            self.candidates = Some(candidates);
        }
        self.start = start;
    }

    /// Resolves the contacts of the substep; [`SheetContact::update_candidates`] has updated the candidates.
    /// Returns whether it moved any point.
    pub(super) fn resolve(&mut self, step: &mut IntegratedStep<'_>, record: &mut ContactRecord) -> bool {
        let thickness = f64::from(self.params.thickness);
        for pass in 0..MAX_CONTACT_PASSES {
            if pass > 0 {
                self.update_candidates(step, record);
            }
            let Some(candidates) = &self.candidates else { return pass > 0 };
            let then = step.now + step.dt;
            let pairs = candidates.contact_pairs(&self.mesh, &self.start, step.x, then, thickness);
            if pairs.is_empty() {
                return pass > 0;
            }
            let mut bodies = self.bodies(&pairs, step);
            let constraint = |pair: ContactPair| {
                let index = pair.features.points.map(|i| self.body_index[i as usize] as usize);
                ContactConstraint::new(pair, index, &bodies)
            };
            let mut constraints: Vec<ContactConstraint> = pairs.into_iter().map(constraint).collect();
            let before: Vec<Body> = bodies.clone();
            let friction = f64::from(self.params.friction.unwrap_or(0.0));
            let friction = [friction, step.friction];
            impulses::solve(&mut constraints, &mut bodies, friction, step.dt, thickness);
            let zones = impact_zones::resolve(&constraints, &mut bodies, step.dt, thickness);
            record.pairs += constraints.iter().filter(|constraint| constraint.is_pushing()).count() as u64;
            record.in_impact_zones += zones.points;
            record.unseparated += zones.unseparated;
            if self.write_back(&before, &bodies, step) <= RECHECK_DISPLACEMENT * thickness {
                return true;
            }
        }
        true
    }

    /// The points of contact pairs, each once.
    fn bodies(&mut self, pairs: &[ContactPair], step: &IntegratedStep<'_>) -> Vec<Body> {
        let mut out = Vec::new();
        for &i in pairs.iter().flat_map(|pair| &pair.features.points) {
            let at = i as usize;
            if self.body_index[at] == u32::MAX {
                self.body_index[at] = out.len() as u32;
                out.push(Body {
                    point: i,
                    mobility: f64::from(step.mobility[at]),
                    start: self.start.get(at).cast(),
                    displacement: step.x.get(at).cast() - self.start.get(at).cast::<f64>(),
                    velocity: step.v.get(at).cast(),
                    wall: self.nearest_wall(at, step),
                });
            }
        }
        out
    }

    /// The solid that is closest to a point, if it is closer than the thickness.
    fn nearest_wall(&self, i: usize, step: &IntegratedStep<'_>) -> Option<Wall> {
        let x = step.x.get(i);
        let found = step.solids.iter().map(|solid| (solid.contact(x, 1), solid));
        let ((distance, normal), solid) = found.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        (distance < self.params.thickness).then(|| {
            let displacement = x.cast() - self.start.get(i).cast::<f64>();
            let velocity = solid.displacement(x).cast::<f64>() / step.dt;
            Wall::new(f64::from(distance.max(0.0)), displacement, normal.cast(), velocity)
        })
    }

    /// Writes positions and velocities back, and returns the largest displacement by contact [m].
    fn write_back(&mut self, before: &[Body], after: &[Body], step: &mut IntegratedStep<'_>) -> f64 {
        let mut longest: f64 = 0.0;
        for (before, after) in before.iter().zip(after) {
            self.body_index[before.point as usize] = u32::MAX;
            let change = after.displacement - before.displacement;
            if before.displacement != after.displacement || before.velocity != after.velocity {
                let i = after.point as usize;
                step.x.set(i, (after.start + after.displacement).cast());
                step.v.set(i, after.velocity.cast());
            }
            longest = longest.max(change.norm());
        }
        longest
    }
}
