//! The Eikonal equation |∇u| = 1 at one node, and the eight orders that nodes are visited in.
//!
//! *Method* [zhao05] §2: Godunov's upwind difference. *Departs from the paper*: the equation is solved relative to the
//! smallest neighbour, which keeps single precision accurate far out.
//!
//! Symbols: u distance [voxels]; a ≤ b ≤ c the smaller neighbour of each axis.

/// The directions of the sweeps along x, y and z, in the order of [gourlay17].
pub(super) const ORDERS: [[i32; 3]; 8] =
    [[-1, -1, -1], [1, -1, -1], [-1, 1, -1], [1, 1, -1], [-1, -1, 1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]];

/// Sweeps in one order after another until all is at rest; returns how many sweeps it took.
pub(super) fn until_rest(at_rest: impl Fn() -> bool, sweep: impl Fn([i32; 3])) -> usize {
    let mut sweeps = 0;
    while !at_rest() {
        sweep(ORDERS[sweeps % ORDERS.len()]);
        sweeps += 1;
    }
    sweeps
}

/// The smaller of two numbers that are not NaN, in one instruction.
#[inline]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Whether the neighbours imply a distance below both `own` and `band`: the Eikonal equation's left side at the
/// lesser of the two is above 1. Never for a pinned node, whose number is negative.
#[inline]
pub(super) fn lowered(own: f32, nearest: [f32; 3], band: f32) -> bool {
    // ∞ − ∞ would be NaN; a large number does as well.
    let most = smaller(smaller(own, band), 1e18);
    let slope = |x: f32| if most > x { most - x } else { 0.0 };
    let [x, y, z] = nearest.map(slope);
    x * x + y * y + z * z > 1.0 // Σ ((u − u_min)⁺)² = h², [zhao05] §2
}

/// The new distance of a node that holds `own`, if its neighbours lower it.
#[inline]
pub(super) fn update(own: f32, nearest: [f32; 3], band: f32) -> Option<f32> {
    if !lowered(own, nearest, band) {
        return None;
    }
    let distance = godunov(nearest);
    (distance < own && distance < band).then_some(distance)
}

/// The distance that the smaller neighbours of the three axes imply [voxels]; above the smallest of them.
pub(super) fn godunov(nearest: [f32; 3]) -> f32 {
    // The neighbours in ascending order, the larger two relative to the smallest.
    let [x, y, z] = nearest;
    let (low, high) = if x < y { (x, y) } else { (y, x) };
    let (low, middle) = if low < z { (low, z) } else { (z, low) };
    let (middle, high) = if middle < high { (middle, high) } else { (high, middle) };
    let (a, b, c) = (low, middle - low, high - low);
    let mut u = 1.0;
    if u > b {
        u = 0.5 * (b + (2.0 - b * b).sqrt()); // ū of two, [zhao05] §2
        if u > c {
            let (s, q) = (b + c, b * b + c * c);
            u = (s + (s * s - 3.0 * (q - 1.0)).max(0.0).sqrt()) / 3.0; // ū of three, [zhao05] §2
        }
    }
    a + u
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn godunov_solves_planes_exactly_and_ignores_what_lies_ahead() {
        for n in [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 1.0, 0.5), Vec3::new(0.0, 3.0, 1.0)] {
            let n = n.normalize();
            for far in [0.0, 5.0, 4000.0] {
                // Behind the node along each axis the plane u = n·x is lower by |n| of that axis.
                let u = godunov([far - n.x.abs(), far - n.y.abs(), far - n.z.abs()]);
                assert!((u - far).abs() < 4.0 * f32::EPSILON * far.max(1.0), "{u} {far}");
            }
        }
        assert_eq!(godunov([2.0, 3.5, 9.0]), 3.0);
        assert_eq!(godunov([f32::INFINITY, 1.0, f32::INFINITY]), 2.0);
        assert_eq!(godunov([f32::INFINITY; 3]), f32::INFINITY);
    }
}
