//! The Eikonal equation |∇u| = 1 at one node, and the eight orders of fast sweeping.
//!
//! *Method* [zhao05] §2: Godunov upwind differences.
//! *Departs from the paper*: the equation is solved relative to the smallest neighbour, which keeps single
//! precision accurate far from the surface.
//!
//! Symbols: u distance [voxels]; a ≤ b ≤ c the smaller neighbour of each axis.

use crate::simd::Lanes;

/// The directions of the sweeps along x, y and z, in the order of [gourlay17].
pub(super) const ORDERS: [[i32; 3]; 8] =
    [[-1, -1, -1], [1, -1, -1], [-1, 1, -1], [1, 1, -1], [-1, -1, 1], [1, -1, 1], [-1, 1, 1], [1, 1, 1]];

/// Sweeps in one order after another until the distances have converged; returns the number of sweeps.
pub(super) fn until_converged(converged: impl Fn() -> bool, sweep: impl Fn([i32; 3])) -> usize {
    let mut sweeps = 0;
    while !converged() {
        sweep(ORDERS[sweeps % ORDERS.len()]);
        sweeps += 1;
    }
    sweeps
}

/// The minimum of two numbers that are not NaN, in one instruction.
#[inline]
pub(super) fn smaller(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Whether the neighbours imply a distance below both `own` and `band`: the left side of the Eikonal equation
/// at the smaller of the two is above 1. Never for a pinned node, whose number is negative.
#[inline]
pub(super) fn lowered(own: f32, nearest: [f32; 3], band: f32) -> bool {
    // ∞ − ∞ would be NaN; a large finite number gives the same result.
    let bound = smaller(smaller(own, band), 1e18);
    let slope = |x: f32| if bound > x { bound - x } else { 0.0 };
    let [x, y, z] = nearest.map(slope);
    x * x + y * y + z * z > 1.0 // Σ ((u − u_min)⁺)² = h², [zhao05] §2
}

/// The new distance of a node whose distance is `own`, if its neighbours lower it.
#[inline]
pub(super) fn update(own: f32, nearest: [f32; 3], band: f32) -> Option<f32> {
    if !lowered(own, nearest, band) {
        return None;
    }
    let distance = godunov(nearest);
    (distance < own && distance < band).then_some(distance)
}

/// Godunov's upwind solution from the smaller neighbour of each axis [voxels]; above the smallest of them.
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

/// [`update`] for eight nodes: their new distances, if any of them is lowered.
///
/// Both sides of the equation's cases are computed and selected from, in the order of operations of
/// [`godunov`], so the bits are the same. Where no lane is lowered, nothing is solved.
#[inline(always)]
pub(super) fn update_lanes<L: Lanes>(own: L, [x, y, z]: [L; 3], band: f32) -> Option<L> {
    let (zero, one) = (L::splat(0.0), L::splat(1.0));
    let bound = own.min(L::splat(smaller(band, 1e18)));
    let (slope_x, slope_y, slope_z) = ((bound - x).max(zero), (bound - y).max(zero), (bound - z).max(zero));
    let lowered = one.less(slope_x * slope_x + slope_y * slope_y + slope_z * slope_z);
    if L::bits(lowered) == 0 {
        return None;
    }

    let (low, high) = (x.min(y), x.max(y));
    let (a, middle) = (low.min(z), low.max(z));
    let (b, c) = (middle.min(high) - a, middle.max(high) - a);
    let (half, three) = (L::splat(0.5), L::splat(3.0));
    let of_two = half * (b + (L::splat(2.0) - b * b).sqrt());
    let (s, q) = (b + c, b * b + c * c);
    let of_three = (s + (s * s - three * (q - one)).max(zero).sqrt()) / three;
    let takes_two = b.less(one);
    let u = L::select(takes_two, of_two, one);
    let takes_three = L::and(takes_two, c.less(u));
    let u = a + L::select(takes_three, of_three, u);

    let below = L::and(u.less(own), u.less(L::splat(band)));
    let lowers = L::and(below, lowered);
    if L::bits(lowers) == 0 {
        return None;
    }
    Some(L::select(lowers, u, own))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn godunov_solves_planes_exactly_and_ignores_downwind_neighbours() {
        for n in [Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 1.0, 0.5), Vec3::new(0.0, 3.0, 1.0)] {
            let n = n.normalize();
            for far in [0.0, 5.0, 4000.0] {
                // Upwind of the node along each axis the plane u = n·x is lower by |n| of that axis.
                let u = godunov([far - n.x.abs(), far - n.y.abs(), far - n.z.abs()]);
                assert!((u - far).abs() < 4.0 * f32::EPSILON * far.max(1.0), "{u} {far}");
            }
        }
        assert_eq!(godunov([2.0, 3.5, 9.0]), 3.0);
        assert_eq!(godunov([f32::INFINITY, 1.0, f32::INFINITY]), 2.0);
        assert_eq!(godunov([f32::INFINITY; 3]), f32::INFINITY);
    }
}
