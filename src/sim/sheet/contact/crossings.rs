//! Where layers go through each other.
//!
//! *Method*: every edge against every triangle that its box meets. Points of what crosses are tangled: pairs of features that are all tangled
//! are left to themselves, since neither side is the right one, and pushing them apart would pump energy into the knot.

use super::{
    closest,
    elements::Elements,
    tree::{self, Tree},
};
use crate::{math::Vec3, sim::sheet::lanes::Vectors};

/// Edges that go through triangles, as pairs of triangles: the owner of the edge and the other.
pub(super) fn crossings(elements: &Elements, tree: &Tree, x: &Vectors) -> Vec<[u32; 2]> {
    let boxes = tree.boxes(elements, &tree::moving(x, |_| Vec3::zeros()));
    let at = |i: u32| x.get(i as usize).cast::<f64>();
    let found = tree.pairs(&boxes, 0.0, None, |found, [one, two], _| {
        for [edges, triangle] in [[one, two], [two, one]] {
            let (owned, own) = (elements.owned[edges as usize], elements.triangles[edges as usize]);
            let corners = elements.triangles[triangle as usize];
            for k in (0..3).filter(|k| owned >> (3 + k) & 1 == 1) {
                let ends = [own[k], own[(k + 1) % 3]];
                let shared = ends.iter().any(|&a| corners.iter().any(|&b| elements.is_one(a, b)));
                if !shared && closest::crosses(ends.map(at), corners.map(at)) {
                    found.push([edges, triangle]);
                }
            }
        }
    });
    found.into_iter().flatten().collect()
}

/// The points of what crosses; empty if nothing does.
pub(super) fn tangled(elements: &Elements, crossings: &[[u32; 2]]) -> Vec<bool> {
    if crossings.is_empty() {
        return Vec::new();
    }
    let mut out = vec![false; elements.rest.len()];
    let corners = crossings.iter().flatten().flat_map(|&number| elements.triangles[number as usize]);
    corners.for_each(|i| out[i as usize] = true);
    out
}
