//! Narrow phase: the candidate pairs that are in contact within a substep, with their weights, normals and
//! distances.
//!
//! *Method*: the closest points of a point and a triangle or of two edges ([ericson05], `closest_points.rs`)
//! at the start of the substep. A pair is in contact if its distance less its largest relative displacement
//! is below the thickness and a margin.
//! *Departs from the paper*: [bridson02] solves a cubic for the times at which a pair is coplanar. The bound
//! here holds for the whole substep instead.

use super::{
    broad_phase::{CandidateList, CandidatePair, max_difference},
    closest_points::Double,
    collision_mesh::{CollisionMesh, FeaturePair, sum},
};
use crate::{par, sim::sheet::vectors::Vectors};

/// A pair of features that is close in a substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactPair {
    pub(super) features: FeaturePair,
    pub(super) thickness: f64,
    /// Weights of the four points in the vector between the two closest points, at the start of the substep.
    pub(super) weights: [f64; 4],
    pub(super) normal: Double,
    pub(super) distance: f64,
    /// Whether contact acts on it. Edges whose closest points are ends are kept apart by pairs of a point and
    /// a triangle. Of these the triangle whose inside is closest acts, if there is one.
    pub(super) is_active: bool,
}

/// Distance below which a pair has no direction, in parts of the thickness.
const COINCIDENT_DISTANCE: f64 = 1e-6;

impl CandidateList {
    /// The contact pairs while points move from `start` to `x`, which they reach at `time` [s]. They are
    /// closer than their thickness and half of `thickness`. The margin covers what contact itself moves, at
    /// most a quarter of `thickness` a point.
    pub(super) fn contact_pairs(
        &self,
        mesh: &CollisionMesh,
        start: &Vectors,
        x: &Vectors,
        time: f64,
        thickness: f64,
    ) -> Vec<ContactPair> {
        let since = (time - self.from) as f32 * (1.0 + 1e-5);
        let parts = par::map_chunks(self.pairs.len(), par::CHUNK, |range| {
            let due = self.pairs[range].iter().filter(|pair| pair.earliest <= since);
            due.filter_map(|pair| contact_pair(mesh, pair, start, x, thickness)).collect::<Vec<ContactPair>>()
        });
        parts.into_iter().flatten().collect()
    }
}

fn double(x: &Vectors, i: u32) -> Double {
    x.get(i as usize).cast()
}

fn contact_pair(
    mesh: &CollisionMesh,
    pair: &CandidatePair,
    start: &Vectors,
    x: &Vectors,
    within: f64,
) -> Option<ContactPair> {
    let features = pair.features;
    let positions = features.points.map(|i| double(start, i));
    let (weights, is_inside) = features.closest(positions);
    let between = sum(weights, positions);
    let distance = between.norm();
    let displacement = f64::from(max_difference(&features, |i| x.get(i as usize) - start.get(i as usize)));
    let thickness = f64::from(pair.thickness);
    let reach = if is_inside { thickness + 0.5 * within } else { 0.5 * within };
    if distance - displacement >= reach {
        return None;
    }
    let (normal, is_active) = if distance > COINCIDENT_DISTANCE * within {
        let normal = between / distance;
        let closest =
            || features.edges || mesh.is_locally_closest(&features, weights, normal, |i| double(start, i));
        (normal, is_inside && closest())
    } else if features.edges {
        return None;
    } else {
        (mesh.separation_normal(&features, |i| double(start, i))?, true)
    };
    Some(ContactPair { features, thickness, weights, normal, distance, is_active })
}
