//! Broad phase: candidate pairs of features that may come into contact before long.
//!
//! *Method*: a candidate list covers a span of time. Within it each point is predicted to keep its velocity,
//! to within `slack`. The list holds all pairs that can then come within their thickness of each other, each
//! with the earliest time at which they can. The bounding volume hierarchy (`bvh.rs`) finds them. The list
//! stays valid as long as all points keep to the prediction. Predicted velocities are means over neighbours,
//! since points oscillate about their positions while cloth moves as a whole. Free fall and common motion
//! leave the list valid; a list of near pairs without velocities would not survive them. Points that deviate
//! from their prediction, such as those that were struck, get a new one, and their candidates are searched
//! again.
//!
//! Symbols: x_b, v_b → `x`, `v` at the time when the list began.
//! Limits: a list lasts no longer than its span.

use super::{
    bvh::{self, Bvh, MovingPoint, SweptBox},
    collision_mesh::{CollisionMesh, FeaturePair, TriangleIndex},
};
use crate::{math::Vec3, par, sim::sheet::vectors::Vectors};

/// Candidate pairs that may come into contact within a span of time.
#[derive(Debug)]
pub(super) struct CandidateList {
    pub(super) pairs: Vec<CandidatePair>,
    /// The largest relative speed of two points of a pair [m/s].
    pub(super) max_speed: f64,
    /// The first point of that pair.
    pub(super) fastest_point: usize,
    pub(super) from: f64,
    /// The end of the span.
    pub(super) until: f64,
    slack: f32,
    /// Margin of the search: twice `slack`, and rounding.
    margin: f32,
    x: Vectors,
    v: Vectors,
}

/// A pair of features that may come into contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct CandidatePair {
    pub(super) features: FeaturePair,
    /// The distance at which contact keeps the two [m].
    pub(super) thickness: f32,
    /// Earliest time of contact after the list began [s].
    pub(super) earliest: f32,
    /// Relative speed when the list began [m/s].
    speed: f32,
}

/// What the broad phase searches.
pub(super) struct BroadPhase<'a> {
    pub(super) mesh: &'a CollisionMesh,
    pub(super) bvh: &'a Bvh,
    /// Points of sheets that intersect each other; see `intersections.rs`.
    pub(super) tangled: &'a [bool],
    pub(super) thickness: f64,
}

/// Bound of the rounding error of a distance, in parts of the largest coordinate: six roundings.
const ROUNDING_ERROR: f32 = 4e-7;

impl BroadPhase<'_> {
    /// Builds the list from `from` to `until` [s].
    pub(super) fn candidates(
        &self,
        x: &Vectors,
        v: Vectors,
        [from, until]: [f64; 2],
        slack: f32,
    ) -> CandidateList {
        let far = par::max(x.len(), |i| x.get(i).amax()).map_or(0.0, |(_, far)| far);
        let margin = 2.0 * slack + ROUNDING_ERROR * far;
        let mut list = CandidateList {
            pairs: Vec::new(),
            max_speed: 0.0,
            fastest_point: 0,
            from,
            until,
            slack,
            margin,
            x: x.clone(),
            v,
        };
        self.add(&mut list, from, None);
        list
    }

    /// Searches again for candidates of the points that deviate from their prediction: between two times [s]
    /// they move from `start` to `x`, and continue so.
    pub(super) fn update(
        &self,
        list: &mut CandidateList,
        deviating: &[u32],
        [start, x]: [&Vectors; 2],
        [now, then]: [f64; 2],
    ) {
        let mut is_deviating = vec![false; x.len()];
        let per = 1.0 / (then - now) as f32;
        for &i in deviating {
            let at = i as usize;
            is_deviating[at] = true;
            let v = (x.get(at) - start.get(at)) * per;
            list.v.set(at, v);
            list.x.set(at, start.get(at) - v * (now - list.from) as f32);
        }
        list.pairs.retain(|pair| !pair.features.points.iter().any(|&i| is_deviating[i as usize]));
        self.add(list, now, Some(&is_deviating));
    }

    /// Adds the pairs that may come into contact from `now` [s] on. With `selected`, only those with a
    /// selected point.
    fn add(&self, list: &mut CandidateList, now: f64, selected: Option<&[bool]>) {
        let (since, left) = ((now - list.from) as f32, (list.until - now) as f32);
        let reach = self.thickness as f32 + list.margin;
        let points: Vec<MovingPoint> = bvh::moving_points(&list.x, |i| list.v.get(i))
            .into_iter()
            .map(|[x, v]| [x + v * since, v * left])
            .collect();
        let boxes = self.bvh.refit(self.mesh, &points);
        let is_selected = |i: u32| selected.is_none_or(|selected| selected[i as usize]);
        let leaves = selected.map(|_| self.bvh.leaves_with_selected(self.mesh, is_selected));
        let found =
            self.bvh.overlapping_pairs(&boxes, reach, leaves.as_deref(), |found, triangles, boxes| {
                let mut corners = triangles.iter().flat_map(|&triangle| self.mesh.corners(triangle));
                if !corners.any(is_selected) {
                    return;
                }
                self.feature_pairs(triangles, boxes, reach, &points, |features| {
                    if features.points.iter().any(|&i| is_selected(i)) {
                        found.extend(self.candidate(features, &points, [since, left], list.margin));
                    }
                });
            });
        for pair in found.into_iter().flatten() {
            if f64::from(pair.speed) > list.max_speed {
                list.max_speed = f64::from(pair.speed);
                list.fastest_point = pair.features.points[0] as usize;
            }
            list.pairs.push(pair);
        }
    }

    /// Calls `f` with the pairs of features of two triangles whose boxes overlap.
    fn feature_pairs(
        &self,
        numbers: [TriangleIndex; 2],
        boxes: [&SweptBox; 2],
        reach: f32,
        points: &[MovingPoint],
        mut f: impl FnMut(FeaturePair),
    ) {
        let swept = |i: u32| SweptBox::of_point(points[i as usize]);
        let triangles = numbers.map(|number| self.mesh.corners(number));
        let owned = numbers.map(|number| self.mesh.owned(number));
        let coincide = |a: u32, b: u32| self.mesh.coincide(a, b);
        for side in [0, 1] {
            let [a, b, c] = triangles[1 - side];
            for k in (0..3).filter(|k| owned[side] >> k & 1 == 1) {
                let p = triangles[side][k];
                let shared = coincide(p, a) || coincide(p, b) || coincide(p, c);
                if !shared && swept(p).overlaps(boxes[1 - side], reach) {
                    f(FeaturePair { points: [p, a, b, c], edges: false });
                }
            }
        }
        let edge = |side: usize, k: usize| [triangles[side][k], triangles[side][(k + 1) % 3]];
        for k in (0..3).filter(|k| owned[0] >> (3 + k) & 1 == 1) {
            let [a, b] = edge(0, k);
            let one = swept(a).union(swept(b));
            if !one.overlaps(boxes[1], reach) {
                continue;
            }
            for l in (0..3).filter(|l| owned[1] >> (3 + l) & 1 == 1) {
                let [c, d] = edge(1, l);
                let shared = coincide(a, c) || coincide(a, d) || coincide(b, c) || coincide(b, d);
                if !shared && one.overlaps(&swept(c).union(swept(d)), reach) {
                    f(FeaturePair { points: [a, b, c, d], edges: true });
                }
            }
        }
    }

    /// A candidate pair, if it can come into contact within the span.
    fn candidate(
        &self,
        features: FeaturePair,
        points: &[MovingPoint],
        [since, span]: [f32; 2],
        margin: f32,
    ) -> Option<CandidatePair> {
        let is_tangled = |i: &u32| self.tangled.get(*i as usize).is_some_and(|&is_tangled| is_tangled);
        if features.points.iter().all(is_tangled) {
            return None;
        }
        let distance = features.distance(features.points.map(|i| points[i as usize][0].cast())) as f32;
        let speed = max_difference(&features, |i| points[i as usize][1]) / span;
        if distance - speed * span > self.thickness as f32 + margin {
            return None;
        }
        let thickness = self.mesh.thickness(&features, self.thickness) as f32;
        let left = distance - thickness - margin;
        let earliest = if left > 0.0 { left / speed } else { 0.0 };
        (earliest <= span).then_some(CandidatePair { features, thickness, earliest: since + earliest, speed })
    }
}

/// The largest difference of a vector between points of the two sides.
pub(super) fn max_difference(features: &FeaturePair, v: impl Fn(u32) -> Vec3) -> f32 {
    let (one, other) = features.sides();
    let pairs = one.iter().flat_map(|&a| other.iter().map(move |&b| (a, b)));
    pairs.map(|(a, b)| (v(a) - v(b)).norm_squared()).fold(0.0, f32::max).sqrt()
}

impl CandidateList {
    /// The points that deviate from their predicted positions at a time [s].
    pub(super) fn deviating(&self, x: &Vectors, time: f64) -> Vec<u32> {
        let since = (time - self.from) as f32;
        let max_square = self.slack * self.slack;
        let parts = par::map_chunks(x.len(), par::CHUNK, |range| {
            let is_deviating =
                |&i: &usize| (x.get(i) - self.x.get(i) - self.v.get(i) * since).norm_squared() > max_square;
            range.filter(is_deviating).map(|i| i as u32).collect::<Vec<u32>>()
        });
        parts.into_iter().flatten().collect()
    }
}
