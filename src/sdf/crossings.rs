//! Triangles of a mesh that pass through each other.
//!
//! *Method*: two triangles cross if an edge of one runs through the inside of the other, by the signs of the volumes of tetrahedra
//! [guigue03]. Triangles with a corner in common, those that touch, and those in one plane do not count.
//!
//! Limits: a triangle is compared with [`MAX_COMPARED`] others near it, so that time grows with their number.

use super::{Triangles, bvh::TriangleBvh};
use crate::{math::Vec3, par};
use nalgebra::Vector3;

/// Triangles near one that it is compared with: those of sound meshes have a few tens.
const MAX_COMPARED: usize = 1000;

/// The number of triangles that cross another one.
pub(super) fn crossing(mesh: &Triangles) -> usize {
    if mesh.triangles.is_empty() {
        return 0;
    }
    let bvh = TriangleBvh::new(mesh);
    let corners = bvh.corners();
    let is_crossing = |i: usize| {
        let own = &corners[i];
        let (low, high) = (own[0].inf(&own[1]).inf(&own[2]), own[0].sup(&own[1]).sup(&own[2]));
        let (mut compared, mut found) = (0, false);
        bvh.near_box(low, high, |place, other| {
            compared += 1;
            found = place != i && cross(own, other);
            !found && compared < MAX_COMPARED
        });
        found
    };
    par::sum(corners.len(), |i| f64::from(u8::from(is_crossing(i)))) as usize
}

/// Whether two triangles pass through each other.
fn cross(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let shares_corner = a.iter().any(|x| b.contains(x));
    !shares_corner && (pierces(a, b) || pierces(b, a))
}

/// Whether an edge of `a` runs through the inside of `b`.
fn pierces(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let a = a.map(|x| x.cast::<f64>());
    let b = b.map(|x| x.cast::<f64>());
    let sides = a.map(|x| volume(b[0], b[1], b[2], x));
    (0..3).any(|k| {
        let (from, to) = (a[k], a[(k + 1) % 3]);
        if sides[k] * sides[(k + 1) % 3] >= 0.0 {
            return false;
        }
        let around = [0, 1, 2].map(|i| volume(from, to, b[i], b[(i + 1) % 3]));
        around.iter().all(|&v| v > 0.0) || around.iter().all(|&v| v < 0.0)
    })
}

/// Six times the volume of a tetrahedron, by the side of the plane of three corners on which the fourth is.
fn volume(a: Vector3<f64>, b: Vector3<f64>, c: Vector3<f64>, d: Vector3<f64>) -> f64 {
    (b - a).cross(&(c - a)).dot(&(d - a))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cube's twelve triangles.
    fn cube(low: Vec3, side: f32) -> Triangles {
        let corner = |i: u32| low + Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * side;
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
        Triangles { positions: (0..8).map(corner).collect(), triangles: triangles.collect() }
    }

    fn count(meshes: &[Triangles]) -> usize {
        let mut all = Triangles { positions: Vec::new(), triangles: Vec::new() };
        for mesh in meshes {
            let first = all.positions.len() as u32;
            all.positions.extend(&mesh.positions);
            all.triangles.extend(mesh.triangles.iter().map(|triangle| triangle.map(|corner| corner + first)));
        }
        crossing(&all)
    }

    #[test]
    fn triangles_that_pass_through_others_are_counted() {
        let unit = || cube(Vec3::zeros(), 1.0);
        assert_eq!(count(&[unit()]), 0);
        // Apart, within each other, face to face, and in the same place.
        for (low, side) in [([3.0; 3], 1.0), ([0.25; 3], 0.5), ([1.0, 0.0, 0.0], 1.0), ([0.0; 3], 1.0)] {
            assert_eq!(count(&[unit(), cube(low.into(), side)]), 0, "{low:?} {side}");
        }
        // A corner reaches into a corner: three faces of either cube, of whose triangles some are cut.
        let found = count(&[unit(), cube(Vec3::new(0.6, 0.7, 0.8), 1.0)]);
        assert!((6..=12).contains(&found), "{found}");
        // A needle through two faces: one triangle of each, and some of the needle.
        let needle = Triangles {
            positions: [[0.3, 0.2, -1.0], [0.35, 0.2, -1.0], [0.3, 0.2, 2.0]].map(Vec3::from).into(),
            triangles: vec![[0, 1, 2]],
        };
        assert_eq!(count(&[unit(), needle]), 3);
    }
}
