//! Faces of many corners, cut into triangles that cover them once.
//!
//! *Method*: a fan from the first corner where that covers the face, as that of any convex one; else ears are clipped [meisters75] in the
//! plane that the face is seen in best. Corners on a straight side stay, so that neighbours keep whole edges in common.
//!
//! Limits: of a face that crosses itself, or that takes more than [`TESTS_PER_CORNER`] tests a corner, the rest is a fan, and the face counts
//! as folded.

use crate::math::Vec3;

/// Tests whether a corner is in an ear, for each corner of a face: combs of 400 corners are cut, and time grows with the size of the file.
const TESTS_PER_CORNER: usize = 1000;

/// Cuts a face into triangles, which are added to `triangles`; whether they cover it once.
pub(super) fn cut(corners: &[u32], positions: &[Vec3], triangles: &mut Vec<[u32; 3]>) -> bool {
    let at = match corners {
        [_, _, _] => None,
        _ => flattened(corners, positions),
    };
    let Some(at) = at.filter(|at| (2..at.len()).any(|i| area(at[0], at[i - 1], at[i]) < 0.0)) else {
        triangles.extend(fan(corners));
        return true;
    };
    let mut left: Vec<usize> = (0..corners.len()).collect();
    let mut tests = TESTS_PER_CORNER * corners.len();
    while left.len() > 3 {
        let Some(ear) = (0..left.len()).find(|&place| is_ear(place, &left, &at, &mut tests)) else { break };
        let n = left.len();
        triangles.push([(ear + n - 1) % n, ear, (ear + 1) % n].map(|place| corners[left[place]]));
        left.remove(ear);
    }
    let rest: Vec<u32> = left.iter().map(|&place| corners[place]).collect();
    triangles.extend(fan(&rest));
    left.len() == 3 && area(at[left[0]], at[left[1]], at[left[2]]) >= 0.0
}

fn fan(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    (2..corners.len()).map(|i| [corners[0], corners[i - 1], corners[i]])
}

/// The corners in the plane of two axes in which the face is largest and counter-clockwise; `None` if it has no area.
fn flattened(corners: &[u32], positions: &[Vec3]) -> Option<Vec<[f64; 2]>> {
    let first = positions[corners[0] as usize].cast::<f64>();
    let offsets: Vec<_> = corners.iter().map(|&c| positions[c as usize].cast::<f64>() - first).collect();
    let normal: nalgebra::Vector3<f64> = (2..offsets.len()).map(|i| offsets[i - 1].cross(&offsets[i])).sum();
    let axis = normal.iamax();
    let [mut u, mut v] = [(axis + 1) % 3, (axis + 2) % 3];
    if normal[axis] < 0.0 {
        (u, v) = (v, u);
    }
    (normal[axis] != 0.0).then(|| offsets.iter().map(|x| [x[u], x[v]]).collect())
}

/// Twice the area of a triangle, negative if it is clockwise.
fn area(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether the corner at a place of those that are left makes a triangle with its neighbours that has no other corner in it. Corners at
/// the places of these three do not count: holes are joined to the outline by such pairs.
fn is_ear(place: usize, left: &[usize], at: &[[f64; 2]], tests: &mut usize) -> bool {
    let n = left.len();
    let [a, b, c] = [(place + n - 1) % n, place, (place + 1) % n].map(|place| at[left[place]]);
    if area(a, b, c) <= 0.0 {
        return false;
    }
    left.iter().all(|&other| {
        *tests = tests.saturating_sub(1);
        let x = at[other];
        let is_outside = area(a, b, x) < 0.0 || area(b, c, x) < 0.0 || area(c, a, x) < 0.0;
        *tests > 0 && (is_outside || [a, b, c].contains(&x))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Random;
    use proptest::prelude::*;

    /// Cuts a polygon that lies askew in space; whether it was cut cleanly, and the triangles in the plane.
    fn cut_flat(outline: &[[f32; 2]]) -> (bool, Vec<[[f64; 2]; 3]>) {
        let askew = |[x, y]: &[f32; 2]| Vec3::new(0.5 * x - y, 2.0 * y + 0.25 * x, 4.0 * x + 8.0);
        let positions: Vec<Vec3> = outline.iter().map(askew).collect();
        let corners: Vec<u32> = (0..outline.len() as u32).collect();
        let mut triangles = Vec::new();
        let is_clean = cut(&corners, &positions, &mut triangles);
        assert_eq!(triangles.len(), outline.len() - 2);
        let flat = |corner: u32| outline[corner as usize].map(f64::from);
        (is_clean, triangles.into_iter().map(|triangle| triangle.map(flat)).collect())
    }

    /// Twice the area of a polygon.
    fn polygon_area(outline: &[[f32; 2]]) -> f64 {
        let at = |i: usize| outline[i % outline.len()].map(f64::from);
        (0..outline.len()).map(|i| at(i)[0] * at(i + 1)[1] - at(i)[1] * at(i + 1)[0]).sum()
    }

    /// Asserts that the triangles cover the outline once.
    fn assert_covered(outline: &[[f32; 2]]) {
        let (is_clean, triangles) = cut_flat(outline);
        let areas: Vec<f64> = triangles.iter().map(|&[a, b, c]| area(a, b, c)).collect();
        let total = polygon_area(outline);
        assert!(is_clean && areas.iter().all(|area| area * total.signum() >= 0.0), "{outline:?}: {areas:?}");
        assert!((areas.iter().sum::<f64>() - total).abs() < 1e-5 * total.abs(), "{outline:?}");
    }

    /// The letter L, from each of its corners on, and with corners on its straight sides.
    fn letters() -> Vec<Vec<[f32; 2]>> {
        let l =
            [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0], [0.0, 1.0]];
        (0..l.len()).map(|first| l[first..].iter().chain(&l[..first]).copied().collect()).collect()
    }

    #[test]
    fn concave_faces_are_covered_once_from_any_corner() {
        for letter in letters() {
            assert_covered(&letter);
            assert_covered(&letter.into_iter().rev().collect::<Vec<_>>());
        }
        // An arrow head of four corners, whose fan from the first leaves it.
        assert_covered(&[[0.0, 0.0], [2.0, -1.0], [0.5, 0.0], [2.0, 1.0]]);
        assert_covered(&[[2.0, -1.0], [0.5, 0.0], [2.0, 1.0], [0.0, 0.0]]);
        // A comb of 200 teeth.
        let tooth = |i: usize| [[i as f32, 0.0], [i as f32 + 0.5, 1.0]];
        let back = [[200.0, 2.0], [-1.0, 2.0]];
        assert_covered(&(0..200).flat_map(tooth).chain(back).collect::<Vec<[f32; 2]>>());
        // A square with a hole, joined by an edge that is there twice.
        let hole = [[1.0, 1.0], [1.0, 2.0], [2.0, 2.0], [2.0, 1.0], [1.0, 1.0]];
        let square = [[0.0, 0.0], [3.0, 0.0], [3.0, 3.0], [0.0, 3.0], [0.0, 0.0]];
        assert_covered(&[&square[..], &hole].concat());
    }

    #[test]
    fn faces_that_cannot_be_covered_are_reported_in_bounded_time() {
        // A star that crosses itself, and a bow.
        let star = [0, 2, 4, 1, 3].map(|i| {
            let angle = std::f32::consts::TAU * i as f32 / 5.0;
            [angle.cos(), angle.sin()]
        });
        assert!(!cut_flat(&star).0);
        assert!(!cut_flat(&[[0.0, 0.0], [2.0, 2.0], [2.0, 0.0], [0.0, 1.0]]).0);
        // On a line there is nothing to cover.
        assert!(cut_flat(&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [1.0, 0.0]]).0);
        let random = Random::new([1, 2, 3]);
        let scribble: Vec<[f32; 2]> = (0..40_000).map(|i| [random.at(2 * i), random.at(2 * i + 1)]).collect();
        assert!(!cut_flat(&scribble).0);
    }

    proptest! {
        #[test]
        fn star_shaped_faces_are_covered_once(radii in prop::collection::vec(0.1_f32..1.0, 4..60), first in 0_usize..60) {
            let n = radii.len();
            let corner = |i: usize| {
                let angle = std::f32::consts::TAU * i as f32 / n as f32;
                [radii[i % n] * angle.cos(), radii[i % n] * angle.sin()]
            };
            let outline: Vec<[f32; 2]> = (0..n).map(|i| corner((i + first) % n)).collect();
            assert_covered(&outline);
        }
    }
}
