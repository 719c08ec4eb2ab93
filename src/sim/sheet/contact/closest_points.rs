//! Closest points of a point and a triangle and of two edges, and whether an edge crosses a triangle.
//!
//! *Method*: [ericson05], closest points of point and triangle and of two segments, in double precision.
//! *Departs from the source*: a triangle without area is treated as its three edges. Edges that are parallel
//! to within 1e-4 count as parallel: their closest pair begins at an end, so that none depends on a quotient
//! of rounding errors.
//!
//! Limits: none; any corners may coincide.

use nalgebra::Vector3;

pub(super) type Double = Vector3<f64>;

/// Squared sine of the angle below which two directions count as parallel.
const PARALLEL: f64 = 1e-8;

/// The weights of a triangle's corners at its point that is closest to `p`: none negative, their sum 1.
pub(super) fn on_triangle(p: Double, [a, b, c]: [Double; 3]) -> [f64; 3] {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    if ab.cross(&ac).norm_squared() <= PARALLEL * PARALLEL * ab.norm_squared() * ac.norm_squared() {
        return on_edges(p, [a, b, c]);
    }
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return [1.0, 0.0, 0.0];
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return [0.0, 1.0, 0.0];
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        let t = d1 / (d1 - d3);
        return [1.0 - t, t, 0.0];
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return [0.0, 0.0, 1.0];
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        let t = d2 / (d2 - d6);
        return [1.0 - t, 0.0, t];
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 >= d3 && d5 >= d6 {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return [0.0, 1.0 - t, t];
    }
    let (v, w) = (vb / (va + vb + vc), vc / (va + vb + vc));
    [1.0 - v - w, v, w]
}

/// The weights for a triangle that is a line or a point.
fn on_edges(p: Double, corners: [Double; 3]) -> [f64; 3] {
    let mut best = ([1.0, 0.0, 0.0], f64::INFINITY);
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        let edge = corners[to] - corners[from];
        let length = edge.norm_squared();
        let t = if length > 0.0 { (edge.dot(&(p - corners[from])) / length).clamp(0.0, 1.0) } else { 0.0 };
        let far = (corners[from] + edge * t - p).norm_squared();
        if far < best.1 {
            let mut weights = [0.0; 3];
            weights[from] = 1.0 - t;
            weights[to] += t;
            best = (weights, far);
        }
    }
    best.0
}

/// How far along the edges `a` and `b`, from 0 to 1, the two are closest.
pub(super) fn on_segments(a: [Double; 2], b: [Double; 2]) -> [f64; 2] {
    let (d1, d2, r) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (e1, e2) = (d1.norm_squared(), d2.norm_squared());
    let share = |part: f64, whole: f64| if whole > 0.0 { (part / whole).clamp(0.0, 1.0) } else { 0.0 };
    let (c, f) = (d1.dot(&r), d2.dot(&r));
    if e1 == 0.0 {
        return [0.0, share(f, e2)];
    }
    if e2 == 0.0 {
        return [share(-c, e1), 0.0];
    }
    let across = d1.dot(&d2);
    let denominator = e1 * e2 - across * across;
    let s = if denominator > PARALLEL * e1 * e2 {
        ((across * f - c * e2) / denominator).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let t = (across * s + f) / e2;
    if t < 0.0 {
        [share(-c, e1), 0.0]
    } else if t > 1.0 {
        [share(across - c, e1), 1.0]
    } else {
        [s, t]
    }
}

/// Whether the segment `a` goes through the inside of a triangle. Touching does not count.
pub(super) fn crosses(a: [Double; 2], [p, q, r]: [Double; 3]) -> bool {
    let side = |x: Double, u: Double, v: Double, w: Double| (u - x).dot(&(v - x).cross(&(w - x)));
    let (from, to) = (side(a[0], p, q, r), side(a[1], p, q, r));
    if from * to >= 0.0 {
        return false;
    }
    let around = [side(a[0], a[1], p, q), side(a[0], a[1], q, r), side(a[0], a[1], r, p)];
    around.iter().all(|&side| side > 0.0) || around.iter().all(|&side| side < 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random points in a cube of 2 m.
    fn points<const N: usize>(number: u64) -> [Double; N] {
        let at = |k: u64| {
            let mut bits = (number * 64 + k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            bits = (bits ^ bits >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
        };
        std::array::from_fn(|i| Double::from_fn(|axis, _| at(3 * i as u64 + axis as u64)))
    }

    fn weighted(weights: [f64; 3], corners: [Double; 3]) -> Double {
        corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2]
    }

    fn is_convex(weights: [f64; 3]) -> bool {
        weights.iter().all(|&w| w >= -1e-12) && (weights.iter().sum::<f64>() - 1.0).abs() < 1e-12
    }

    /// The smallest distance of `p` to sample points of the triangle, and the spacing of the samples.
    fn sampled_distance(p: Double, corners: [Double; 3]) -> (f64, f64) {
        let n = 60;
        let mut shortest = f64::INFINITY;
        for i in 0..=n {
            for j in 0..=n - i {
                let weights = [i, j, n - i - j].map(|k| f64::from(k) / f64::from(n));
                shortest = shortest.min((weighted(weights, corners) - p).norm());
            }
        }
        let longest = (0..3).map(|k| (corners[k] - corners[(k + 1) % 3]).norm()).fold(0.0, f64::max);
        (shortest, longest / f64::from(n))
    }

    #[test]
    fn no_sample_point_of_a_triangle_is_closer_than_the_closest_point() {
        for number in 0..300 {
            let [p, a, b, c] = points(number);
            // Also slivers, and triangles that are lines or points.
            for corners in [
                [a, b, c],
                [a, b, a + (b - a) * 0.3 + (c - a) * 1e-9],
                [a, b, a + (b - a) * 1.7],
                [a, b, b],
                [a, a, b],
                [b, a, b],
                [a, a, a],
            ] {
                let weights = on_triangle(p, corners);
                let (shortest, step) = sampled_distance(p, corners);
                let found = (weighted(weights, corners) - p).norm();
                assert!(is_convex(weights) && found <= shortest + 1e-9, "{number}: {found} {shortest}");
                assert!(shortest - found <= step, "{number}: {found} {shortest}");
            }
        }
    }

    #[test]
    fn no_sample_points_of_two_edges_are_closer_than_the_closest_points() {
        for number in 0..300 {
            let [p, q, r, s] = points(number);
            for (a, b) in [
                ([p, q], [r, s]),
                ([p, q], [r, r + (q - p) * 0.7]),
                ([p, q], [r, r - (q - p) * 1.3 + (s - r) * 1e-7]),
                ([p, q], [p + (q - p) * 0.5, p + (q - p) * 2.0]),
                ([p, p], [r, s]),
                ([p, q], [r, r]),
                ([p, p], [r, r]),
            ] {
                let [s, t] = on_segments(a, b);
                let distance = |s: f64, t: f64| (a[0] + (a[1] - a[0]) * s - b[0] - (b[1] - b[0]) * t).norm();
                let n = 80;
                let all = (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j)));
                let shortest = all
                    .map(|(i, j)| distance(f64::from(i) / f64::from(n), f64::from(j) / f64::from(n)))
                    .fold(f64::INFINITY, f64::min);
                assert!((0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t));
                assert!(distance(s, t) <= shortest + 1e-6, "{number}: {} {shortest}", distance(s, t));
            }
        }
    }

    #[test]
    fn an_edge_crosses_a_triangle_if_it_goes_through_its_inside() {
        let corners = [Double::zeros(), Double::x(), Double::y()];
        let edge = |x: f64, y: f64, from: f64, to: f64| [Double::new(x, y, from), Double::new(x, y, to)];
        assert!(crosses(edge(0.2, 0.2, -1.0, 1.0), corners) && crosses(edge(0.2, 0.2, 1.0, -1.0), corners));
        assert!(!crosses(edge(0.6, 0.6, -1.0, 1.0), corners), "outside it");
        assert!(!crosses(edge(0.2, 0.2, 0.1, 1.0), corners), "above it");
        assert!(!crosses(edge(0.2, 0.2, 0.0, 1.0), corners), "on it");
        assert!(!crosses([Double::zeros(), Double::x()], corners), "in its plane");
        assert!(!crosses(edge(0.0, 0.0, -1.0, 1.0), corners), "through a corner");
        assert!(!crosses(edge(0.2, 0.2, -1.0, 1.0), [Double::zeros(); 3]));
    }
}
