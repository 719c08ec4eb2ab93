//! Which particles may touch which faces in a substep.
//!
//! *Method*: every face asks the liquid's own cells for the particles around its way, which is linear in faces and particles. Of the faces
//! near a particle it keeps the nearest, and others that lie in other directions, as in a fold.
//!
//! Limits: a particle meets at most [`MOST`] faces; those that it goes through beside are found when the substep ends.

use super::triangle::{blend, nearest, normal};
use crate::{math::Vec3, par, space::CellGrid};

/// Faces that push one particle in one substep: of a fold's two sides and its end.
const MOST: usize = 3;

/// Faces lie in other directions if the cosine between is below it. Above, the two sides of a shallow fold push as one and neither reaches
/// its distance; below, a particle in a fold is held from one side only.
const APART: f32 = 0.8;

/// Faces a task asks for.
const TASK: usize = 32;

/// A face: its corners among the points of all sheets.
pub(super) type Face = [u32; 3];

/// A particle and a face that are near.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    pub(super) particle: u32,
    pub(super) face: u32,
    /// Between them when the substep began [m].
    gap: f32,
}

/// Both sides in a substep.
pub(super) struct Ways<'a> {
    /// Particles, where the substep began and where it leads [m].
    pub(super) particles: [&'a [Vec3]; 2],
    /// The same of the points of sheets.
    pub(super) points: [&'a [Vec3]; 2],
    pub(super) grid: &'a CellGrid,
    /// Particles when they were sorted into the grid [m].
    pub(super) sorted_at: &'a [Vec3],
}

impl Ways<'_> {
    pub(super) fn corners(&self, end: usize, face: Face) -> [Vec3; 3] {
        face.map(|i| self.points[end][i as usize])
    }
}

/// All pairs whose ways may bring them nearer than `reach` [m], by particle and from near to far.
pub(super) fn pairs(ways: &Ways<'_>, faces: &[Face], reach: f32) -> Vec<Pair> {
    let [from, to] = ways.particles;
    let off = |i: usize| {
        let at = ways.sorted_at[i];
        (at - from[i]).norm_squared().max((at - to[i]).norm_squared())
    };
    let farthest = par::max(from.len(), off).map_or(0.0, |(_, square)| square.sqrt());
    let order = ways.grid.order();
    let parts = par::map_chunks(faces.len(), TASK, |range| {
        let mut found = Vec::new();
        for face in range {
            let [start, end] = [0, 1].map(|end| ways.corners(end, faces[face]));
            let (low, high) = bounds(start.iter().chain(&end), reach);
            let travel = (0..3).map(|k| (end[k] - start[k]).norm()).fold(0.0, f32::max);
            let wide = Vec3::repeat(farthest);
            ways.grid.for_each_stretch(low - wide, high + wide, |places| {
                for &i in &order[places] {
                    let (x, then) = (from[i as usize], to[i as usize]);
                    if !(overlaps(x, then, low, high)) {
                        continue;
                    }
                    let gap = (x - blend(nearest(x, start), start)).norm();
                    if gap <= reach + travel + (then - x).norm() {
                        found.push(Pair { particle: i, face: face as u32, gap });
                    }
                }
            });
        }
        found
    });
    let mut all = parts.concat();
    // Gaps are not negative: their bits sort as they do.
    par::sort_by_key(&mut all, |pair| (pair.particle, pair.gap.to_bits(), pair.face));
    all
}

fn bounds<'a>(points: impl Iterator<Item = &'a Vec3>, reach: f32) -> (Vec3, Vec3) {
    let (mut low, mut high) = (Vec3::repeat(f32::INFINITY), Vec3::repeat(f32::NEG_INFINITY));
    for x in points {
        (low, high) = (low.inf(x), high.sup(x));
    }
    (low - Vec3::repeat(reach), high + Vec3::repeat(reach))
}

/// Whether the box around a way and another box have a part in common.
#[inline]
fn overlaps(a: Vec3, b: Vec3, low: Vec3, high: Vec3) -> bool {
    (0..3).all(|axis| a[axis].min(b[axis]) <= high[axis] && a[axis].max(b[axis]) >= low[axis])
}

/// A particle and the place of a face that it must stay away from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Contact {
    pub(super) particle: u32,
    pub(super) face: u32,
    /// Of the corners, at the place.
    pub(super) weights: [f32; 3],
    /// Unit vector from there to the particle.
    pub(super) normal: Vec3,
    /// The distance to keep [m].
    pub(super) keep: f32,
    /// How many contacts the particle has.
    pub(super) shared: u32,
}

/// The contacts among pairs, by particle; `keep` [m] is kept, and what begins nearer parts by `most` [m] a substep.
pub(super) fn contacts(
    ways: &Ways<'_>,
    faces: &[Face],
    pairs: &[Pair],
    keep: f32,
    most: f32,
) -> Vec<Contact> {
    let mut ends: Vec<usize> = Vec::new();
    for (k, pair) in pairs.iter().enumerate() {
        if pairs.get(k + 1).is_none_or(|next| next.particle != pair.particle) {
            ends.push(k + 1);
        }
    }
    let parts = par::map_chunks(ends.len(), par::CHUNK, |range| {
        let mut found: Vec<Contact> = Vec::new();
        for number in range {
            let first = found.len();
            let start = if number == 0 { 0 } else { ends[number - 1] };
            for pair in &pairs[start..ends[number]] {
                let x = ways.particles[0][pair.particle as usize];
                let corners = ways.corners(0, faces[pair.face as usize]);
                let weights = nearest(x, corners);
                let off = x - blend(weights, corners);
                // On the face itself its own side is as good as the other.
                let n = off.try_normalize(f32::MIN_POSITIVE).unwrap_or_else(|| normal(corners));
                if found[first..].iter().any(|other| other.normal.dot(&n) > APART) {
                    continue;
                }
                found.push(Contact {
                    particle: pair.particle,
                    face: pair.face,
                    weights,
                    normal: n,
                    keep: keep.min(pair.gap + most),
                    shared: 0,
                });
                if found.len() - first == MOST {
                    break;
                }
            }
            let shared = (found.len() - first) as u32;
            found[first..].iter_mut().for_each(|contact| contact.shared = shared);
        }
        found
    });
    parts.concat()
}
