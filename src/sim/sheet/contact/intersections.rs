//! Intersections of layers: edges that go through triangles.
//!
//! *Method*: every edge is tested against every triangle whose box it overlaps. The points of intersecting
//! triangles are tangled. Pairs of features whose points are all tangled get no contact impulses: neither
//! side is the right one, and pushing them apart would pump energy into the knot.

use super::{
    bvh::{self, Bvh},
    closest_points,
    collision_mesh::{CollisionMesh, TriangleIndex},
};
use crate::{math::Vec3, sim::sheet::vectors::Vectors};

/// Edges that go through triangles, as pairs of triangles: the owner of the edge and the other.
pub(super) fn crossings(mesh: &CollisionMesh, bvh: &Bvh, x: &Vectors) -> Vec<[TriangleIndex; 2]> {
    let boxes = bvh.refit(mesh, &bvh::moving_points(x, |_| Vec3::zeros()));
    let at = |i: u32| x.get(i as usize).cast::<f64>();
    let found = bvh.overlapping_pairs(&boxes, 0.0, None, |found, [one, two], _| {
        for [edges, triangle] in [[one, two], [two, one]] {
            let (owned, own) = (mesh.owned(edges), mesh.corners(edges));
            let corners = mesh.corners(triangle);
            for k in (0..3).filter(|k| owned >> (3 + k) & 1 == 1) {
                let ends = [own[k], own[(k + 1) % 3]];
                let shared = ends.iter().any(|&a| corners.iter().any(|&b| mesh.coincide(a, b)));
                if !shared && closest_points::crosses(ends.map(at), corners.map(at)) {
                    found.push([edges, triangle]);
                }
            }
        }
    });
    found.into_iter().flatten().collect()
}

/// Marks the points of intersecting triangles; empty if nothing intersects.
pub(super) fn tangled(mesh: &CollisionMesh, crossings: &[[TriangleIndex; 2]]) -> Vec<bool> {
    if crossings.is_empty() {
        return Vec::new();
    }
    let mut out = vec![false; mesh.rest_positions.len()];
    let corners = crossings.iter().flatten().flat_map(|&triangle| mesh.corners(triangle));
    corners.for_each(|i| out[i as usize] = true);
    out
}
