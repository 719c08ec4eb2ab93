//! Geometry of a point and a triangle: closest point, and continuous collision detection while both move.

use crate::math::Vec3;
use nalgebra::Vector3;

/// Barycentric tolerance beyond an edge that still counts as a hit: otherwise rounding lets a point slip between two faces.
const EDGE_TOLERANCE: f64 = 1e-4;

/// Bisection steps that find the time of a crossing: to a millionth of a substep.
const BISECTION_STEPS: u32 = 20;

/// Barycentric weights of the point of a triangle closest to `x`.
pub(super) fn closest_point(x: Vec3, [a, b, c]: [Vec3; 3]) -> [f32; 3] {
    let (ab, ac, ax) = (b - a, c - a, x - a);
    let (d1, d2) = (ab.dot(&ax), ac.dot(&ax));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bx = x - b;
    let (d3, d4) = (ab.dot(&bx), ac.dot(&bx));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let along_c = d1 * d4 - d3 * d2;
    if along_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = ratio(d1, d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cx = x - c;
    let (d5, d6) = (ab.dot(&cx), ac.dot(&cx));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let along_b = d5 * d2 - d1 * d6;
    if along_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = ratio(d2, d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let along_a = d3 * d6 - d5 * d4;
    if along_a <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        let t = ratio(d4 - d3, (d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let all = along_a + along_b + along_c;
    let (v, w) = (ratio(along_b, all), ratio(along_c, all));
    [1.0 - v - w, v, w]
}

/// The ratio of a part to a whole that may be zero.
fn ratio(a: f32, all: f32) -> f32 {
    if all > 0.0 { (a / all).clamp(0.0, 1.0) } else { 0.0 }
}

/// The point with these barycentric weights, Σ w x.
pub(super) fn blend(weights: [f32; 3], corners: [Vec3; 3]) -> Vec3 {
    corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
}

/// Unit normal; zero for a degenerate triangle.
pub(super) fn normal([a, b, c]: [Vec3; 3]) -> Vec3 {
    (b - a).cross(&(c - a)).try_normalize(f32::MIN_POSITIVE).unwrap_or_else(Vec3::zeros)
}

/// Where a point crossed a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Crossing {
    /// The side that the point came from: 1 where the normal points, else −1.
    pub(super) side: f32,
    pub(super) weights: [f32; 3],
}

/// Whether a point that moves along a straight path ends on the other side of a triangle, whose corners move meanwhile, and crossed it.
/// A point that crosses twice has not crossed.
pub(super) fn crossing(x: [Vec3; 2], corners: [[Vec3; 3]; 2]) -> Option<Crossing> {
    // In the frame of the first corner.
    let at = |t: f64| {
        let place = |from: Vec3, to: Vec3| -> Vector3<f64> {
            let (from, to) = (from.cast::<f64>(), to.cast::<f64>());
            from + (to - from) * t
        };
        let a = place(corners[0][0], corners[1][0]);
        let rest = [1, 2].map(|k| place(corners[0][k], corners[1][k]) - a);
        (rest[0], rest[1], place(x[0], x[1]) - a)
    };
    let above = |t: f64| {
        let (b, c, x) = at(t);
        b.cross(&c).dot(&x)
    };
    let (first, last) = (above(0.0), above(1.0));
    if first * last > 0.0 || first == 0.0 {
        return None;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..BISECTION_STEPS {
        let middle = 0.5 * (low + high);
        if above(middle) * first > 0.0 { low = middle } else { high = middle }
    }
    let (b, c, x) = at(high);
    let n = b.cross(&c);
    let area2 = n.norm_squared();
    if area2 == 0.0 {
        return None;
    }
    let (v, w) = (x.cross(&c).dot(&n) / area2, b.cross(&x).dot(&n) / area2);
    let weights = [1.0 - v - w, v, w];
    let hits = weights.iter().all(|&weight| weight >= -EDGE_TOLERANCE);
    let side = if first > 0.0 { 1.0 } else { -1.0 };
    hits.then(|| Crossing { side, weights: clamped(weights) })
}

/// Weights clamped to the triangle.
fn clamped(weights: [f64; 3]) -> [f32; 3] {
    let kept = weights.map(|weight| weight.max(0.0));
    let sum: f64 = kept.iter().sum();
    kept.map(|weight| (weight / sum) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const FACE: [Vec3; 3] = [Vec3::new(0.0, 0.0, 0.0), Vec3::new(1.0, 0.0, 0.0), Vec3::new(0.0, 1.0, 0.0)];

    #[test]
    fn the_closest_point_is_nearer_than_any_other() {
        let number = |k: u32| (k.wrapping_mul(2_654_435_761) >> 16) as f32 / 32768.0 - 1.0;
        for k in 0..500 {
            let face = [0, 3, 6].map(|i| Vec3::from_fn(|axis, _| number(k * 12 + i + axis as u32)));
            let x = Vec3::from_fn(|axis, _| 2.0 * number(k * 12 + 9 + axis as u32));
            let found = closest_point(x, face);
            assert!((found.iter().sum::<f32>() - 1.0).abs() < 1e-5 && found.iter().all(|w| *w >= -1e-6));
            let d = (blend(found, face) - x).norm();
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let (v, w) = (i as f32 / 20.0, j as f32 / 20.0);
                    let other = (blend([1.0 - v - w, v, w], face) - x).norm();
                    assert!(d <= other + 1e-5, "{d} and {other}");
                }
            }
        }
    }

    #[test]
    fn a_crossing_is_found_and_a_path_next_to_the_triangle_is_not() {
        let (above, below) = (Vec3::new(0.2, 0.2, 3.0), Vec3::new(0.3, 0.2, -40.0));
        let found = crossing([above, below], [FACE; 2]).expect("it goes through");
        assert!(found.side == 1.0 && (blend(found.weights, FACE) - Vec3::new(0.207, 0.2, 0.0)).norm() < 1e-3);
        assert_eq!(crossing([below, above], [FACE; 2]).expect("it comes back").side, -1.0);
        let offset = Vec3::new(0.8, 0.8, 0.0);
        assert!(crossing([above + offset, below + offset], [FACE; 2]).is_none());
        assert!(crossing([above, above - Vec3::new(0.0, 0.0, 2.0)], [FACE; 2]).is_none());
        // A face that sweeps over a point at rest, and one that recedes as fast as the point.
        let up = |z: f32| FACE.map(|corner| corner + Vec3::new(0.0, 0.0, z));
        assert_eq!(crossing([above, above], [up(0.0), up(5.0)]).expect("it is run over").side, 1.0);
        assert!(crossing([above, above - Vec3::new(0.0, 0.0, 9.0)], [up(0.0), up(-9.0)]).is_none());
        // Along the shared edge of two faces one of them is hit.
        let other = [FACE[1], Vec3::new(1.0, 1.0, 0.0), FACE[2]];
        for k in 0..100 {
            let on_edge = Vec3::new(k as f32 / 99.0, 1.0 - k as f32 / 99.0, 0.0);
            let path = [on_edge + Vec3::new(0.1, 0.1, 0.3), on_edge - Vec3::new(0.1, 0.1, 0.3)];
            assert!(crossing(path, [FACE; 2]).is_some() || crossing(path, [other; 2]).is_some(), "{k}");
        }
    }
}
