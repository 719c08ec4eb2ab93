//! Contact detection between particles and faces of sheets.
//!
//! *Method*: the broad phase queries the cells of the liquid's neighbour search with the bounding box of every moving face, which is
//! linear in faces and particles. The narrow phase computes the closest point of each face. Of the faces near a particle it keeps the
//! nearest one, and others in clearly different directions, as in a fold.
//!
//! Limits: a particle has at most [`MAX_CONTACTS_PER_PARTICLE`] contacts; crossings of other faces are found at the end of the
//! substep.

use super::triangle::{blend, closest_point, normal};
use crate::{math::Vec3, par, space::CellGrid};

/// Largest number of faces that push one particle in a substep: both sides of a fold and its end.
const MAX_CONTACTS_PER_PARTICLE: usize = 3;

/// Contacts of one particle differ in direction if the cosine between their normals is at most this. A larger value lets both sides of
/// a shallow fold push as one, and neither reaches its distance; a smaller value holds a particle in a fold from one side only.
const MAX_NORMAL_COSINE: f32 = 0.8;

/// Faces that one task of the broad phase queries.
const FACES_PER_TASK: usize = 32;

/// The corners of a face, as indices of points of all sheets.
pub(super) type Face = [u32; 3];

/// A particle and a face that may come into contact.
#[derive(Clone, Copy, Debug)]
pub(super) struct CandidatePair {
    pub(super) particle: u32,
    pub(super) face: u32,
    /// Distance at the start of the substep [m].
    gap: f32,
}

/// Motion of particles and sheets during a substep.
pub(super) struct Trajectories<'a> {
    /// Positions of particles at the start of the substep and predicted for its end [m].
    pub(super) particles: [&'a [Vec3]; 2],
    /// Positions of the sheets' points at the same instants [m].
    pub(super) points: [&'a [Vec3]; 2],
    pub(super) grid: &'a CellGrid,
    /// Positions for which the particles were sorted into the grid [m].
    pub(super) sorted_at: &'a [Vec3],
}

impl Trajectories<'_> {
    pub(super) fn corners(&self, end: usize, face: Face) -> [Vec3; 3] {
        face.map(|i| self.points[end][i as usize])
    }
}

/// All pairs whose distance may fall below `reach` [m], sorted by particle and distance.
pub(super) fn candidate_pairs(
    trajectories: &Trajectories<'_>,
    faces: &[Face],
    reach: f32,
) -> Vec<CandidatePair> {
    let [from, to] = trajectories.particles;
    let off = |i: usize| {
        let at = trajectories.sorted_at[i];
        (at - from[i]).norm_squared().max((at - to[i]).norm_squared())
    };
    let farthest = par::max(from.len(), off).map_or(0.0, |(_, square)| square.sqrt());
    let order = trajectories.grid.order();
    let parts = par::map_chunks(faces.len(), FACES_PER_TASK, |range| {
        let mut found = Vec::new();
        for face in range {
            let [start, end] = [0, 1].map(|end| trajectories.corners(end, faces[face]));
            let (low, high) = bounds(start.iter().chain(&end), reach);
            let travel = (0..3).map(|k| (end[k] - start[k]).norm()).fold(0.0, f32::max);
            let wide = Vec3::repeat(farthest);
            trajectories.grid.for_each_stretch(low - wide, high + wide, |places| {
                for &i in &order[places] {
                    let (x, then) = (from[i as usize], to[i as usize]);
                    if !(overlaps(x, then, low, high)) {
                        continue;
                    }
                    let gap = (x - blend(closest_point(x, start), start)).norm();
                    if gap <= reach + travel + (then - x).norm() {
                        found.push(CandidatePair { particle: i, face: face as u32, gap });
                    }
                }
            });
        }
        found
    });
    let mut all = parts.concat();
    // Distances are not negative, so their bits have the same order.
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

/// Whether the bounding box of a path overlaps another box.
#[inline]
fn overlaps(a: Vec3, b: Vec3, low: Vec3, high: Vec3) -> bool {
    (0..3).all(|axis| a[axis].min(b[axis]) <= high[axis] && a[axis].max(b[axis]) >= low[axis])
}

/// A contact constraint between a particle and a point of a face.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParticleContact {
    pub(super) particle: u32,
    pub(super) face: u32,
    /// Barycentric weights of the point.
    pub(super) weights: [f32; 3],
    /// Unit vector from the point to the particle.
    pub(super) normal: Vec3,
    /// Distance to keep [m].
    pub(super) distance: f32,
    /// Number of contacts of the particle.
    pub(super) count: u32,
}

/// Contact constraints at `distance` [m] for the candidate pairs, sorted by particle. Pairs that start closer separate by at most
/// `max_separation` [m] in the substep.
pub(super) fn particle_contacts(
    trajectories: &Trajectories<'_>,
    faces: &[Face],
    pairs: &[CandidatePair],
    distance: f32,
    max_separation: f32,
) -> Vec<ParticleContact> {
    let mut ends: Vec<usize> = Vec::new();
    for (k, pair) in pairs.iter().enumerate() {
        if pairs.get(k + 1).is_none_or(|next| next.particle != pair.particle) {
            ends.push(k + 1);
        }
    }
    let parts = par::map_chunks(ends.len(), par::CHUNK, |range| {
        let mut found: Vec<ParticleContact> = Vec::new();
        for number in range {
            let first = found.len();
            let start = if number == 0 { 0 } else { ends[number - 1] };
            for pair in &pairs[start..ends[number]] {
                let x = trajectories.particles[0][pair.particle as usize];
                let corners = trajectories.corners(0, faces[pair.face as usize]);
                let weights = closest_point(x, corners);
                let off = x - blend(weights, corners);
                // A particle on the face itself may take either side.
                let n = off.try_normalize(f32::MIN_POSITIVE).unwrap_or_else(|| normal(corners));
                if found[first..].iter().any(|other| other.normal.dot(&n) > MAX_NORMAL_COSINE) {
                    continue;
                }
                found.push(ParticleContact {
                    particle: pair.particle,
                    face: pair.face,
                    weights,
                    normal: n,
                    distance: distance.min(pair.gap + max_separation),
                    count: 0,
                });
                if found.len() - first == MAX_CONTACTS_PER_PARTICLE {
                    break;
                }
            }
            let count = (found.len() - first) as u32;
            found[first..].iter_mut().for_each(|contact| contact.count = count);
        }
        found
    });
    parts.concat()
}
