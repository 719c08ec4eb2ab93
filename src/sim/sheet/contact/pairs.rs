//! Lists of features that may meet before long.
//!
//! *Method*: a list is made for a span of time, within which every point is taken to go on with its velocity, give or take `slack`. It holds
//! all pairs that can come within their thickness of each other then, each with the time from when. It is good as long as all points
//! keep to that; velocities are means over neighbours, since points ring about their places while cloth moves as a whole. Free fall and what moves together leave it alone, which a list of near pairs without velocities would not stand.
//!
//! Symbols: x_b, v_b → `x`, `v` where the list began.
//! Points that leave their ways, as those do that are struck, get others, and what they meet is looked for again.
//!
//! Limits: a list lasts no longer than its span.

use super::{
    closest::Double,
    elements::{Elements, Features, sum},
    tree::{self, Moving, Swept, Tree},
};
use crate::{math::Vec3, par, sim::sheet::lanes::Vectors};

/// Pairs that may meet within a span of time.
#[derive(Debug)]
pub(super) struct List {
    pub(super) pairs: Vec<Listed>,
    /// The largest relative speed of two points of a pair [m/s].
    pub(super) fastest: f64,
    /// The points of that pair's first.
    pub(super) at: usize,
    from: f64,
    /// The end of the span.
    pub(super) until: f64,
    slack: f32,
    /// Twice that, and rounding.
    beside: f32,
    x: Vectors,
    v: Vectors,
}

/// A pair that may meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Listed {
    pub(super) features: Features,
    /// How far apart the two are kept [m].
    pub(super) thickness: f32,
    /// Not before so long after the list began [s].
    pub(super) after: f32,
    /// Relative speed when the list began [m/s].
    speed: f32,
}

/// What a list is made from.
pub(super) struct Search<'a> {
    pub(super) elements: &'a Elements,
    pub(super) tree: &'a Tree,
    /// Points of sheets that cross each other; see `crossings.rs`.
    pub(super) tangled: &'a [bool],
    pub(super) thickness: f64,
}

/// What rounding may take from a distance, in parts of the largest coordinate: six roundings of one.
const ROUNDING: f32 = 4e-7;

impl Search<'_> {
    /// The list from `from` to `until` [s].
    pub(super) fn list(&self, x: &Vectors, v: Vectors, [from, until]: [f64; 2], slack: f32) -> List {
        let far = par::max(x.len(), |i| x.get(i).amax()).map_or(0.0, |(_, far)| far);
        let beside = 2.0 * slack + ROUNDING * far;
        let mut list =
            List { pairs: Vec::new(), fastest: 0.0, at: 0, from, until, slack, beside, x: x.clone(), v };
        self.add(&mut list, from, None);
        list
    }

    /// Looks again for what points meet that have left their ways, between two times [s]: from `start` they go to `x`, and on.
    pub(super) fn renew(
        &self,
        list: &mut List,
        astray: &[u32],
        [start, x]: [&Vectors; 2],
        [now, then]: [f64; 2],
    ) {
        let mut is_astray = vec![false; x.len()];
        let per = 1.0 / (then - now) as f32;
        for &i in astray {
            let at = i as usize;
            is_astray[at] = true;
            let v = (x.get(at) - start.get(at)) * per;
            list.v.set(at, v);
            list.x.set(at, start.get(at) - v * (now - list.from) as f32);
        }
        list.pairs.retain(|pair| !pair.features.points.iter().any(|&i| is_astray[i as usize]));
        self.add(list, now, Some(&is_astray));
    }

    /// Adds the pairs that may meet from `now` [s] on; of some points, only those that have one.
    fn add(&self, list: &mut List, now: f64, some: Option<&[bool]>) {
        let (since, left) = ((now - list.from) as f32, (list.until - now) as f32);
        let reach = self.thickness as f32 + list.beside;
        let points: Vec<Moving> = tree::moving(&list.x, |i| list.v.get(i))
            .into_iter()
            .map(|[x, v]| [x + v * since, v * left])
            .collect();
        let boxes = self.tree.boxes(self.elements, &points);
        let is_meant = |i: u32| some.is_none_or(|some| some[i as usize]);
        let meant = some.map(|_| self.tree.leaves_with(self.elements, is_meant));
        let found = self.tree.pairs(&boxes, reach, meant.as_deref(), |found, triangles, boxes| {
            let mut corners = triangles.iter().flat_map(|&k| self.elements.triangles[k as usize]);
            if !corners.any(is_meant) {
                return;
            }
            self.features(triangles, boxes, reach, &points, |features| {
                if features.points.iter().any(|&i| is_meant(i)) {
                    found.extend(self.listed(features, &points, [since, left], list.beside));
                }
            });
        });
        for pair in found.into_iter().flatten() {
            if f64::from(pair.speed) > list.fastest {
                list.fastest = f64::from(pair.speed);
                list.at = pair.features.points[0] as usize;
            }
            list.pairs.push(pair);
        }
    }

    /// Calls `f` with the features of two triangles whose boxes meet.
    fn features(
        &self,
        numbers: [u32; 2],
        boxes: [&Swept; 2],
        reach: f32,
        points: &[Moving],
        mut f: impl FnMut(Features),
    ) {
        let swept = |i: u32| Swept::of(points[i as usize]);
        let triangles = numbers.map(|number| self.elements.triangles[number as usize]);
        let owned = numbers.map(|number| self.elements.owned[number as usize]);
        let is_one = |a: u32, b: u32| self.elements.is_one(a, b);
        for side in [0, 1] {
            let [a, b, c] = triangles[1 - side];
            for k in (0..3).filter(|k| owned[side] >> k & 1 == 1) {
                let p = triangles[side][k];
                let shared = is_one(p, a) || is_one(p, b) || is_one(p, c);
                if !shared && swept(p).meets(boxes[1 - side], reach) {
                    f(Features { points: [p, a, b, c], edges: false });
                }
            }
        }
        let edge = |side: usize, k: usize| [triangles[side][k], triangles[side][(k + 1) % 3]];
        for k in (0..3).filter(|k| owned[0] >> (3 + k) & 1 == 1) {
            let [a, b] = edge(0, k);
            let one = swept(a).and(swept(b));
            if !one.meets(boxes[1], reach) {
                continue;
            }
            for l in (0..3).filter(|l| owned[1] >> (3 + l) & 1 == 1) {
                let [c, d] = edge(1, l);
                let shared = is_one(a, c) || is_one(a, d) || is_one(b, c) || is_one(b, d);
                if !shared && one.meets(&swept(c).and(swept(d)), reach) {
                    f(Features { points: [a, b, c, d], edges: true });
                }
            }
        }
    }

    /// A pair, if it can meet within the span.
    fn listed(
        &self,
        features: Features,
        points: &[Moving],
        [since, span]: [f32; 2],
        beside: f32,
    ) -> Option<Listed> {
        let is_tangled = |i: &u32| self.tangled.get(*i as usize).is_some_and(|&is_tangled| is_tangled);
        if features.points.iter().all(is_tangled) {
            return None;
        }
        let distance = features.distance(features.points.map(|i| points[i as usize][0].cast())) as f32;
        let speed = fastest(&features, |i| points[i as usize][1]) / span;
        if distance - speed * span > self.thickness as f32 + beside {
            return None;
        }
        let thickness = self.elements.thickness(&features, self.thickness) as f32;
        let left = distance - thickness - beside;
        let after = if left > 0.0 { left / speed } else { 0.0 };
        (after <= span).then_some(Listed { features, thickness, after: since + after, speed })
    }
}

/// The largest difference of what the points of the two sides have.
pub(super) fn fastest(features: &Features, v: impl Fn(u32) -> Vec3) -> f32 {
    let (one, other) = features.sides();
    let pairs = one.iter().flat_map(|&a| other.iter().map(move |&b| (a, b)));
    pairs.map(|(a, b)| (v(a) - v(b)).norm_squared()).fold(0.0, f32::max).sqrt()
}

fn double(x: &Vectors, i: u32) -> Double {
    x.get(i as usize).cast()
}

/// A pair that is close in a substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Near {
    pub(super) features: Features,
    pub(super) thickness: f64,
    /// Weights of the points in the vector between the sides, at the start of the substep.
    pub(super) weights: [f64; 4],
    pub(super) normal: Double,
    pub(super) distance: f64,
    /// Whether it is pushed: edges whose closest points are ends are kept apart by points and triangles, and these by the triangle whose
    /// inside is closest, if there is one.
    pub(super) pushed: bool,
}

/// A point that lies so close that no direction can be told, in parts of the thickness.
const NOWHERE: f64 = 1e-6;

impl List {
    /// The points that are not where the list expects them at a time [s].
    pub(super) fn astray(&self, x: &Vectors, time: f64) -> Vec<u32> {
        let since = (time - self.from) as f32;
        let most = self.slack * self.slack;
        let parts = par::map_chunks(x.len(), par::CHUNK, |range| {
            let is_astray =
                |&i: &usize| (x.get(i) - self.x.get(i) - self.v.get(i) * since).norm_squared() > most;
            range.filter(is_astray).map(|i| i as u32).collect::<Vec<u32>>()
        });
        parts.into_iter().flatten().collect()
    }

    /// The pairs that are close while points go from `start` to `x`, which they reach at `time` [s]: within their thickness and half of
    /// `thickness`, so that no other comes to touch by what contact itself moves, a quarter of it at most.
    pub(super) fn near(
        &self,
        elements: &Elements,
        start: &Vectors,
        x: &Vectors,
        time: f64,
        thickness: f64,
    ) -> Vec<Near> {
        let since = (time - self.from) as f32 * (1.0 + 1e-5);
        let parts = par::map_chunks(self.pairs.len(), par::CHUNK, |range| {
            let due = self.pairs[range].iter().filter(|pair| pair.after <= since);
            due.filter_map(|pair| near(elements, pair, start, x, thickness)).collect::<Vec<Near>>()
        });
        parts.into_iter().flatten().collect()
    }
}

fn near(elements: &Elements, pair: &Listed, start: &Vectors, x: &Vectors, within: f64) -> Option<Near> {
    let features = pair.features;
    let places = features.points.map(|i| double(start, i));
    let (weights, inside) = features.closest(places);
    let between = sum(weights, places);
    let distance = between.norm();
    let way = f64::from(fastest(&features, |i| x.get(i as usize) - start.get(i as usize)));
    let thickness = f64::from(pair.thickness);
    let reach = if inside { thickness + 0.5 * within } else { 0.5 * within };
    if distance - way >= reach {
        return None;
    }
    let (normal, pushed) = if distance > NOWHERE * within {
        let normal = between / distance;
        let closest =
            || features.edges || elements.is_closest_around(&features, weights, normal, |i| double(start, i));
        (normal, inside && closest())
    } else if features.edges {
        return None;
    } else {
        (elements.way_out(&features, |i| double(start, i))?, true)
    };
    Some(Near { features, thickness, weights, normal, distance, pushed })
}
