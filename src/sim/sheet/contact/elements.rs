//! What of sheets can meet: triangles, their edges and corners.
//!
//! *Method*: quads are cut into two triangles along the diagonal that is shorter at the start. A chain's pieces are triangles with two corners, a
//! loose point one with one. Every edge and every point belongs to one triangle, so that where two triangles come close each pair
//! of features is found once ([curtis08]).
//!
//! Features that share a point never meet, nor do those that joints draw together. Within a sheet two layers are kept no further apart than
//! 0.7 of what they were at the start: else a mesh finer than the thickness would burst. Near seams the way along the sheets to the seam
//! takes that place.

use super::closest::{self, Double};
use crate::{
    math::Vec3,
    par::{self, Forest},
    sim::sheet::{
        lanes::Vectors,
        model::{Model, Spring},
    },
};
use std::{
    cmp::Reverse,
    collections::{BTreeSet, BinaryHeap},
    ops::Range,
};

/// The part of the distance at the start that counts. At 1 every fold of a fine mesh would be stiff; at 0.7 a sheet can be pressed together
/// by three tenths before its own cells meet.
const SLACK: f64 = 0.7;

/// The sine of an angle of neighbours that counts as none: flat sheets are flat to within rounding.
const BESIDE: f64 = 1e-4;

/// The triangles of all sheets.
#[derive(Debug)]
pub(super) struct Elements {
    pub(super) triangles: Vec<[u32; 3]>,
    /// The corners (bits 0, 1, 2) and edges (3, 4, 5: from each corner to the next) that belong to a triangle.
    pub(super) owned: Vec<u8>,
    /// A triangle of every point.
    pub(super) of_point: Vec<u32>,
    /// The points that share an edge with a point `i`: `around[around_start[i]..around_start[i + 1]]`.
    around: Vec<u32>,
    around_start: Vec<u32>,
    /// The sheet of every point.
    sheet: Vec<u32>,
    /// Positions at the start.
    pub(super) rest: Vec<Vec3>,
    /// The part of its distances at the start that counts, of every sheet.
    slack: Vec<f64>,
    seam: Option<Seam>,
}

/// Where joints draw points together.
#[derive(Debug)]
struct Seam {
    /// The lowest of the points that are drawn to one place.
    place: Vec<u32>,
    /// The way along the sheet to the next seam [m]; infinite beyond the reach of contact.
    way: Vec<f32>,
}

/// A pair of features: a point and a triangle, or two edges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Features {
    pub(super) points: [u32; 4],
    /// Of the four points the first two are an edge and the others another; else the last three are a triangle.
    pub(super) edges: bool,
}

impl Features {
    /// How many of the points are on the first side.
    fn split(&self) -> usize {
        if self.edges { 2 } else { 1 }
    }

    /// The points of both sides.
    pub(super) fn sides(&self) -> (&[u32], &[u32]) {
        self.points.split_at(self.split())
    }

    /// The weights of the four points in the vector from the second side to the first, where they are closest; and whether that is inside of
    /// both edges.
    pub(super) fn closest(&self, x: [Double; 4]) -> ([f64; 4], bool) {
        if self.edges {
            let [s, t] = closest::on_segments([x[0], x[1]], [x[2], x[3]]);
            let inside = s > 0.0 && s < 1.0 && t > 0.0 && t < 1.0;
            ([1.0 - s, s, t - 1.0, -t], inside)
        } else {
            let [a, b, c] = closest::on_triangle(x[0], [x[1], x[2], x[3]]);
            ([1.0, -a, -b, -c], true)
        }
    }

    /// The distance of the two sides.
    pub(super) fn distance(&self, x: [Double; 4]) -> f64 {
        sum(self.closest(x).0, x).norm()
    }
}

/// Σ s x.
pub(super) fn sum(s: [f64; 4], x: [Double; 4]) -> Double {
    x[0] * s[0] + x[1] * s[1] + x[2] * s[2] + x[3] * s[3]
}

impl Elements {
    /// Of sheets whose points have these ranges, with the `rest` that each has of its lengths.
    pub(super) fn new(models: &[Model], ranges: &[Range<usize>], rest: &[[f32; 2]]) -> Self {
        let count = ranges.last().map_or(0, |range| range.end);
        let points: Vec<Vec3> = models.iter().flat_map(|model| model.points.iter().copied()).collect();
        let mut sheet = vec![0; count];
        let mut triangles = Vec::new();
        for (number, (model, range)) in models.iter().zip(ranges).enumerate() {
            sheet[range.clone()].fill(number as u32);
            let start = range.start as u32;
            triangles.extend(cut(model).into_iter().map(|corners| corners.map(|i| i + start)));
        }
        let mut elements = Self {
            owned: vec![0; triangles.len()],
            of_point: vec![0; count],
            around: Vec::new(),
            around_start: vec![0; count + 1],
            triangles,
            sheet,
            rest: points,
            slack: rest.iter().map(|&[a, b]| SLACK * f64::from(a.min(b).min(1.0))).collect(),
            seam: None,
        };
        elements.own(count);
        elements
    }

    /// Gives every point and every edge to the first triangle that has it.
    fn own(&mut self, count: usize) {
        let mut taken = vec![false; count];
        let mut edges = BTreeSet::new();
        for (number, (corners, owned)) in self.triangles.iter().zip(&mut self.owned).enumerate() {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                if !std::mem::replace(&mut taken[a as usize], true) {
                    *owned |= 1 << k;
                    self.of_point[a as usize] = number as u32;
                }
                if a != b && edges.insert([a.min(b), a.max(b)]) {
                    *owned |= 8 << k;
                }
            }
        }
        let mut ends: Vec<[u32; 2]> = edges.iter().flat_map(|&[a, b]| [[a, b], [b, a]]).collect();
        ends.sort_unstable();
        ends.iter().for_each(|[a, _]| self.around_start[*a as usize + 1] += 1);
        (0..count).for_each(|i| self.around_start[i + 1] += self.around_start[i]);
        self.around = ends.into_iter().map(|[_, b]| b).collect();
    }

    /// The points that share an edge with a point.
    fn around(&self, i: u32) -> &[u32] {
        &self.around[self.around_start[i as usize] as usize..self.around_start[i as usize + 1] as usize]
    }

    /// Whether the point of a triangle that is closest to another, with these weights, is the closest of the sheet around it too. If it is on
    /// an edge or corner a neighbour may have one that is closer, and then this pair only hinders: what slides towards the edge would climb it.
    /// `out` points from the triangle to the other.
    pub(super) fn is_closest_around(
        &self,
        features: &Features,
        weights: [f64; 4],
        out: Double,
        at: impl Fn(u32) -> Double,
    ) -> bool {
        let corners: Vec<u32> = (1..4).filter(|&k| weights[k] != 0.0).map(|k| features.points[k]).collect();
        if corners.len() == 3 {
            return true;
        }
        let place: Double = (1..4).map(|k| at(features.points[k]) * -weights[k]).sum();
        let beside = self
            .around(corners[0])
            .iter()
            .filter(|i| corners[1..].iter().all(|c| self.around(*c).contains(i)));
        beside.into_iter().all(|&i| {
            let there = at(i) - place;
            there.dot(&out) <= BESIDE * there.norm()
        })
    }

    /// Means of vectors over points and their neighbours, taken `rounds` times.
    pub(super) fn smoothed(&self, mut v: Vectors, rounds: usize) -> Vectors {
        let mut values = v.to_vec();
        let mut means = values.clone();
        for _ in 0..rounds {
            par::fill(&mut means, |i| {
                let around = self.around(i as u32);
                let sum: Vec3 = around.iter().map(|&j| values[j as usize]).sum();
                (values[i] + sum) / (around.len() + 1) as f32
            });
            std::mem::swap(&mut values, &mut means);
        }
        values.iter().enumerate().for_each(|(i, value)| v.set(i, *value));
        v
    }

    /// Draws points together; `reach` [m] is the furthest that contact looks.
    pub(super) fn join(&mut self, pairs: &[[u32; 2]], reach: f64) {
        if pairs.is_empty() {
            self.seam = None;
            return;
        }
        let forest = Forest::new(self.rest.len());
        pairs.iter().for_each(|[a, b]| forest.join(*a, *b));
        let place = forest.roots();
        let seam: BTreeSet<u32> = pairs.iter().flatten().copied().collect();
        self.seam = Some(Seam { way: self.ways(&seam, reach), place });
    }

    /// The way to the next of some points along the sheets, up to `reach`.
    fn ways(&self, to: &BTreeSet<u32>, reach: f64) -> Vec<f32> {
        let mut around = vec![Vec::new(); self.rest.len()];
        for corners in &self.triangles {
            for k in 0..3 {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                around[a as usize].push(b);
                around[b as usize].push(a);
            }
        }
        let mut way = vec![f32::INFINITY; self.rest.len()];
        // Lengths are not negative, so that their bits are in their order.
        let mut next: BinaryHeap<Reverse<(u32, u32)>> = to.iter().map(|&i| Reverse((0, i))).collect();
        to.iter().for_each(|&i| way[i as usize] = 0.0);
        while let Some(Reverse((bits, i))) = next.pop() {
            let own = f32::from_bits(bits);
            if own > way[i as usize] {
                continue;
            }
            for &j in &around[i as usize] {
                let there = own + (self.rest[i as usize] - self.rest[j as usize]).norm();
                if f64::from(there) < reach && there < way[j as usize] {
                    way[j as usize] = there;
                    next.push(Reverse((there.to_bits(), j)));
                }
            }
        }
        way
    }

    /// Whether two points are one, or are drawn together.
    pub(super) fn is_one(&self, a: u32, b: u32) -> bool {
        a == b || self.seam.as_ref().is_some_and(|seam| seam.place[a as usize] == seam.place[b as usize])
    }

    /// How far apart two features are kept [m], of a thickness that sheets have.
    pub(super) fn thickness(&self, features: &Features, thickness: f64) -> f64 {
        let (one, other) = features.sides();
        let sheet = self.sheet[one[0] as usize];
        let mut out = thickness;
        if sheet == self.sheet[other[0] as usize] {
            let x = features.points.map(|i| self.rest[i as usize].cast());
            out = out.min(self.slack[sheet as usize] * features.distance(x));
        }
        if let Some(seam) = &self.seam {
            let nearest =
                |side: &[u32]| side.iter().map(|&i| seam.way[i as usize]).fold(f32::INFINITY, f32::min);
            out = out.min(SLACK * f64::from(nearest(one) + nearest(other)));
        }
        out
    }

    /// The normal along which the first of two features that lie in one place goes: that of the sheet with the lower points, to whose front
    /// this goes. So all of a sheet goes the same way.
    pub(super) fn way_out(&self, features: &Features, at: impl Fn(u32) -> Double) -> Option<Double> {
        let (one, other) = features.sides();
        let lowest = one.iter().chain(other).min().copied()?;
        let [a, b, c] = self.triangles[self.of_point[lowest as usize] as usize].map(&at);
        let sign = if one.contains(&lowest) { 1.0 } else { -1.0 };
        (b - a).cross(&(c - a)).try_normalize(0.0).map(|normal| normal * sign)
    }
}

/// The triangles of a sheet. Pieces of chains have their second corner twice, points that have neither face nor spring are thrice their own.
fn cut(model: &Model) -> Vec<[u32; 3]> {
    let mut out = Vec::with_capacity(2 * model.faces.len());
    let far = |a: u32, b: u32| (model.points[a as usize] - model.points[b as usize]).norm();
    for &[a, b, c, d] in &model.faces {
        if c == d {
            out.push([a, b, c]);
        } else if far(a, c) <= far(b, d) {
            out.extend([[a, b, c], [a, c, d]]);
        } else {
            out.extend([[a, b, d], [b, c, d]]);
        }
    }
    let mut used = vec![false; model.points.len()];
    out.iter().flatten().for_each(|&i| used[i as usize] = true);
    let has_face = used.clone();
    let is_bare = |spring: &&Spring| spring.ends.iter().all(|&i| !has_face[i as usize]);
    for [a, b] in model.springs.iter().filter(is_bare).map(|spring| spring.ends) {
        out.push([a, b, b]);
        (used[a as usize], used[b as usize]) = (true, true);
    }
    out.extend((0..used.len() as u32).filter(|&i| !used[i as usize]).map(|i| [i; 3]));
    out
}
