//! Sheets that meet each other and themselves.
//!
//! *Method*: the way of [bridson02] with the steps in another order, since a step is short beside the thickness here. After the integrator has moved the
//! points, pairs of a point and a triangle and of two edges that are close, or become so within the substep (`pairs.rs`, found by `tree.rs`),
//! get impulses (`solve.rs`). What might have passed all the same moves as one (`zones.rs`). Ends of substeps are in order if
//! their starts were: no edge goes through a face.
//! *Departs from the paper*: no times of collision are computed. A substep is shorter than half the thickness over the fastest approach of what is listed, so that
//! weights and normals of its start are good for the whole, and bounds on ways take the place of roots. It is shortened by halves, and stays so until the frame
//! ends: the symplectic rule keeps another energy for each length, and springs ring without end where lengths change in every substep (three
//! cloths had 5 J in place of 0.1 J, at `courant` 0.9).
//!
//! Symbols: h → `thickness` [m].
//! Limits: friction turns a pair by its impulse times its distance. What crosses at the start of a frame is not kept apart. Sheets against
//! solids come last and have the last word.

mod closest;
mod crossings;
mod elements;
mod pairs;
mod sheets;
mod solve;
mod tree;
mod zones;

use super::{
    lanes::Vectors,
    model::Model,
    params::{Contact as Params, SheetsParams},
    record::ContactRecord,
    solids::Placed,
};
use crate::par;
use elements::Elements;
use pairs::{List, Near, Search};
use solve::{Body, Touch, Wall};
use std::ops::Range;
use tree::Tree;

/// How far a point may be from where a list expects it, in parts of the thickness. Less has more points looked up again; at 0.5 a list took four
/// times as long, since cells of three times the thickness are then near their own neighbours.
const SLACK: f32 = 0.25;

/// Rounds in which a list's velocities are smoothed.
const SMOOTHED: usize = 4;

/// The way of one side against the other that a substep may have, in parts of the thickness.
const STRIDE: f64 = 0.5;

/// The way of a point by contact itself after which pairs are looked at again, in parts of the thickness: two such are what `List::near` looks beyond.
const SHOVE: f64 = 0.25;

/// Times that pairs are looked at again.
const ROUNDS: usize = 4;

/// Halvings of a substep at most: more substeps than any `max_substeps`.
const MOST_HALVED: f64 = 60.0;

/// The span of a list, in substeps. Shorter makes more lists, longer makes longer ones.
const SPAN: f64 = 16.0;

/// What meets, and what is known of it within a frame.
#[derive(Debug)]
pub(super) struct Contact {
    params: Params,
    elements: Elements,
    tree: Tree,
    /// Positions at the start of the substep.
    start: Vectors,
    list: Option<List>,
    /// How often the substep was halved in this frame.
    halved: f64,
    /// Points of what crossed when the frame began; `None`: not known yet.
    tangled: Option<Vec<bool>>,
    /// The bodies of points; `u32::MAX` of those that have none.
    numbers: Vec<u32>,
}

/// A substep that the integrator has made: from [`Contact::start`]'s places to `x` and `v`, in `dt` [s] from `now`.
pub(super) struct Moved<'a> {
    pub(super) x: &'a mut Vectors,
    pub(super) v: &'a mut Vectors,
    pub(super) mobility: &'a [f32],
    /// Solids, and the friction on them.
    pub(super) solids: &'a [Placed<'a>],
    pub(super) friction: f64,
    pub(super) now: f64,
    pub(super) dt: f64,
}

impl Contact {
    /// Of these sheets.
    pub(super) fn new(
        params: &Params,
        sheets: &SheetsParams,
        models: &[Model],
        ranges: &[Range<usize>],
    ) -> Self {
        let rest: Vec<[f32; 2]> = sheets.sheet.iter().map(|sheet| sheet.rest).collect();
        let elements = Elements::new(models, ranges, &rest);
        let count = elements.rest.len();
        Self {
            params: params.clone(),
            tree: Tree::new(&elements),
            elements,
            start: Vectors::zeros(count),
            list: None,
            halved: 0.0,
            tangled: None,
            numbers: par::repeated(u32::MAX, count),
        }
    }

    /// Which points joints draw together from now on.
    pub(super) fn join(&mut self, pairs: &[[u32; 2]]) {
        self.elements.join(pairs, 2.0 * f64::from(self.params.thickness));
        self.list = None;
    }

    /// Edges that go through faces.
    pub(super) fn crossings(&self, x: &Vectors) -> u64 {
        crossings::crossings(&self.elements, &self.tree, x).len() as u64
    }

    /// Begins a frame: whatever was known is forgotten, so that one that is resumed has the same bits.
    pub(super) fn begin(&mut self, x: &Vectors) {
        self.list = None;
        self.halved = 0.0;
        if self.tangled.is_none() {
            let found = crossings::crossings(&self.elements, &self.tree, x);
            self.tangled = Some(crossings::tangled(&self.elements, &found));
        }
    }

    /// Ends a frame.
    pub(super) fn end(&mut self, x: &Vectors, record: &mut ContactRecord) {
        let found = crossings::crossings(&self.elements, &self.tree, x);
        record.crossings = found.len() as u64;
        self.tangled = Some(crossings::tangled(&self.elements, &found));
    }

    /// Forgets what the positions were.
    pub(super) fn forget(&mut self) {
        self.tangled = None;
    }

    /// The longest substep from `now` [s] that keeps approaches shorter than the thickness [s], and a point of the fastest. `substep` is what it would be
    /// otherwise, and `left` what is left of the frame.
    pub(super) fn longest(
        &mut self,
        x: &Vectors,
        v: &Vectors,
        now: f64,
        [substep, left]: [f64; 2],
        record: &mut ContactRecord,
    ) -> (f64, usize) {
        if self.list.is_none() {
            self.search(x, v.clone(), now, substep.min(left), record);
        }
        let Some(list) = &self.list else { return (f64::INFINITY, 0) };
        let approach = STRIDE * f64::from(self.params.thickness) / list.fastest;
        // Nothing rings that has no springs.
        if !substep.is_finite() {
            return (approach, list.at);
        }
        let wanted = (substep / approach).log2().ceil().clamp(0.0, MOST_HALVED);
        self.halved = self.halved.max(wanted);
        if self.halved == 0.0 { (f64::INFINITY, 0) } else { (substep / self.halved.exp2(), list.at) }
    }

    /// Remembers where a substep begins.
    pub(super) fn start(&mut self, x: &Vectors) {
        self.start.clone_from(x);
    }

    fn searching(&self) -> Search<'_> {
        Search {
            elements: &self.elements,
            tree: &self.tree,
            tangled: self.tangled.as_deref().unwrap_or(&[]),
            thickness: f64::from(self.params.thickness),
        }
    }

    /// Makes a list that begins now, of `substep`s [s].
    fn search(&mut self, x: &Vectors, v: Vectors, now: f64, substep: f64, record: &mut ContactRecord) {
        record.searches += 1;
        let v = self.elements.smoothed(v, SMOOTHED);
        let slack = SLACK * self.params.thickness;
        self.list = Some(self.searching().list(x, v, [now, now + SPAN * substep], slack));
    }

    /// Sees to it that the list is good for the substep.
    pub(super) fn look(&mut self, moved: &Moved<'_>, record: &mut ContactRecord) {
        let then = moved.now + moved.dt;
        let start = std::mem::take(&mut self.start);
        if self.list.as_ref().is_none_or(|list| then > list.until + 1e-3 * moved.dt) {
            let mut v = Vectors::zeros(moved.x.len());
            let per = 1.0 / moved.dt as f32;
            v.update(|at, axes| {
                let (from, to) = (start.eight(at), moved.x.eight(at));
                for (axis, out) in axes.into_iter().enumerate() {
                    for lane in 0..out.len() {
                        out[lane] = (to[axis][lane] - from[axis][lane]) * per;
                    }
                }
            });
            self.search(&start, v, moved.now, moved.dt, record);
        }
        if let Some(mut list) = self.list.take() {
            let astray = list.astray(moved.x, then);
            if !astray.is_empty() {
                self.searching().renew(&mut list, &astray, [&start, moved.x], [moved.now, then]);
                record.renewed += astray.len() as u64;
            }
            self.list = Some(list);
        }
        self.start = start;
    }

    /// Keeps apart what meets in the substep; [`Contact::look`] has made the list. Returns whether anything was moved.
    pub(super) fn resolve(&mut self, moved: &mut Moved<'_>, record: &mut ContactRecord) -> bool {
        let thickness = f64::from(self.params.thickness);
        for round in 0..ROUNDS {
            if round > 0 {
                self.look(moved, record);
            }
            let Some(list) = &self.list else { return round > 0 };
            let then = moved.now + moved.dt;
            let near = list.near(&self.elements, &self.start, moved.x, then, thickness);
            if near.is_empty() {
                return round > 0;
            }
            let mut bodies = self.bodies(&near, moved);
            let numbered = |near: Near| {
                let own = near.features.points.map(|i| self.numbers[i as usize] as usize);
                Touch::new(near, own, &bodies)
            };
            let mut touches: Vec<Touch> = near.into_iter().map(numbered).collect();
            let before: Vec<Body> = bodies.clone();
            let friction = f64::from(self.params.friction.unwrap_or(0.0));
            let friction = [friction, moved.friction];
            solve::solve(&mut touches, &mut bodies, friction, moved.dt, thickness);
            let held = zones::hold(&touches, &mut bodies, moved.dt, thickness);
            record.pairs += touches.iter().filter(|touch| touch.pushes()).count() as u64;
            record.held += held.points;
            record.unseparated += held.unseparated;
            if self.write(&before, &bodies, moved) <= SHOVE * thickness {
                return true;
            }
        }
        true
    }

    /// The points of pairs, each once.
    fn bodies(&mut self, near: &[Near], moved: &Moved<'_>) -> Vec<Body> {
        let mut out = Vec::new();
        for &i in near.iter().flat_map(|near| &near.features.points) {
            let at = i as usize;
            if self.numbers[at] == u32::MAX {
                self.numbers[at] = out.len() as u32;
                out.push(Body {
                    point: i,
                    mobility: f64::from(moved.mobility[at]),
                    start: self.start.get(at).cast(),
                    way: moved.x.get(at).cast() - self.start.get(at).cast::<f64>(),
                    velocity: moved.v.get(at).cast(),
                    wall: self.wall(at, moved),
                });
            }
        }
        out
    }

    /// The solid that is closest to a point, if it is closer than the thickness.
    fn wall(&self, i: usize, moved: &Moved<'_>) -> Option<Wall> {
        let x = moved.x.get(i);
        let found = moved.solids.iter().map(|solid| (solid.contact(x, 1), solid));
        let ((distance, normal), solid) = found.min_by(|a, b| a.0.0.total_cmp(&b.0.0))?;
        (distance < self.params.thickness).then(|| {
            let from = x.cast() - self.start.get(i).cast::<f64>();
            let own = solid.way(x).cast::<f64>() / moved.dt;
            Wall::new(f64::from(distance.max(0.0)), from, normal.cast(), own)
        })
    }

    /// Gives points what has become of them, and returns the longest way that it moved one.
    fn write(&mut self, before: &[Body], after: &[Body], moved: &mut Moved<'_>) -> f64 {
        let mut longest: f64 = 0.0;
        for (before, after) in before.iter().zip(after) {
            self.numbers[before.point as usize] = u32::MAX;
            let change = after.way - before.way;
            if before.way != after.way || before.velocity != after.velocity {
                let i = after.point as usize;
                moved.x.set(i, (after.start + after.way).cast());
                moved.v.set(i, after.velocity.cast());
            }
            longest = longest.max(change.norm());
        }
        longest
    }
}
