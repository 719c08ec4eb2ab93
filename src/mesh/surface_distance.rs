//! Surface distance: RMS distance, Hausdorff distance and angle of normals between two meshes.
//!
//! *Method*: the measures of [cignoni98], from exact distances to the nearest triangle. The mean squares of
//! the distance and of the angle between normals over the area come from a triangle's corners and middle,
//! which integrate squares of linear functions exactly. The largest distance, the one-sided Hausdorff
//! distance, follows from the bounds of [tang09]: the distance to a single triangle is convex, so over a
//! triangle it is at most the value at its corners. Triangles that may exceed the largest distance found are
//! subdivided into quarters until none can.
//! *Departs from the papers*: no random samples. The distances at all vertices decide which triangles to
//! subdivide, so that the result does not depend on the order of work.
//!
//! Symbols: d distance [m]; θ angle between the normals [rad].
//!
//! Limits: the largest distance is short by at most 1 % and [`STEP_TOLERANCE`] of the step; the means resolve
//! nothing finer than the step. Where one surface has no counterpart (a droplet that the other lost), the
//! angle is that to the nearest surface.

use super::{Mesh, normals_from_faces};
use crate::math::elementary::atan2;
use crate::{
    math::Vec3,
    par,
    sdf::{TriangleBvh, Triangles, closest_point},
};

/// Absolute tolerance of the largest distance [steps], in addition to one part in a hundred.
pub const STEP_TOLERANCE: f32 = 1e-3;

/// Relative tolerance of the largest distance.
const RELATIVE_TOLERANCE: f32 = 0.01;

/// Subdivisions of a triangle at most. The bounds converge long before: a triangle's size halves each time.
const MAX_SUBDIVISIONS: u32 = 12;

/// A surface to measure distances to.
#[derive(Debug)]
pub struct Target<'a> {
    mesh: &'a Mesh,
    normals: Vec<Vec3>,
    tree: TriangleBvh,
}

/// Integrals of the distance from one surface to another, over the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Distance {
    /// Area of the surface [m²].
    pub area: f64,
    /// ∫ d² over the surface [m⁴].
    pub square: f64,
    /// The largest d [m].
    pub largest: f64,
    /// ∫ θ² over the surface [rad² m²].
    pub angle_square: f64,
}

impl<'a> Target<'a> {
    /// Builds the search tree of a mesh; `None` if it has no triangle.
    pub fn new(mesh: &'a Mesh) -> Option<Self> {
        if mesh.triangles.is_empty() {
            return None;
        }
        let Mesh { positions, triangles, .. } = mesh;
        let tree =
            TriangleBvh::new(&Triangles { positions: positions.clone(), triangles: triangles.clone() });
        Some(Self { mesh, normals: normals(mesh), tree })
    }

    /// The nearest triangle and the distance to it [m]. The search is shorter if `guess` is a triangle close
    /// by.
    ///
    /// # Panics
    /// If there is no triangle `guess`.
    pub fn nearest(&self, q: Vec3, guess: u32) -> (u32, f32) {
        let guessed = self.distance_to(guess, q);
        // The tolerance covers rounding, so that the guess itself is found if it is the nearest.
        let found = self.tree.nearest(q, guessed * guessed * 1.0001 + f32::MIN_POSITIVE);
        found.map_or((guess, guessed), |found| (found.triangle, found.distance2.sqrt()))
    }

    fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.mesh.triangles[triangle as usize].map(|v| self.mesh.positions[v as usize])
    }

    /// Distance to one triangle [m].
    fn distance_to(&self, triangle: u32, q: Vec3) -> f32 {
        (q - closest_point(&self.corners(triangle), q)).norm()
    }

    /// The interpolated normal at the point of a triangle that is nearest to `q`.
    fn normal_near(&self, triangle: u32, q: Vec3) -> Vec3 {
        let corners = self.corners(triangle);
        let at = closest_point(&corners, q);
        let [a, b, c] = corners.map(|x| x - at);
        let shares = [b.cross(&c).norm(), c.cross(&a).norm(), a.cross(&b).norm()];
        let normals = self.mesh.triangles[triangle as usize].map(|v| self.normals[v as usize]);
        let sum: Vec3 = (0..3).map(|i| normals[i] * shares[i]).sum();
        if sum.norm_squared() > 0.0 { sum } else { normals[0] }
    }
}

/// The mesh's own normals, or those of its faces if it has none.
fn normals(mesh: &Mesh) -> Vec<Vec3> {
    if mesh.normals.is_empty() { normals_from_faces(mesh) } else { mesh.normals.clone() }
}

/// Distance from `mesh` to `target`. Triangles longer than `step` [m] are sampled in parts of that size.
///
/// # Panics
/// If `step` is not above zero or a vertex is not finite.
pub fn distance(mesh: &Mesh, target: &Target<'_>, step: f32) -> Distance {
    assert!(step > 0.0, "a step has a length");
    let normals = normals(mesh);
    let at = |t: usize| mesh.triangles[t].map(|v| mesh.positions[v as usize]);

    // Find the nearest point of every vertex; consecutive vertices mostly have the same nearest triangle.
    let mut near = vec![NearestPoint::default(); mesh.positions.len()];
    par::for_chunks(&mut near, CHUNK, |start, near| {
        let mut guess = 0;
        for (nearest, v) in near.iter_mut().zip(start..) {
            *nearest = NearestPoint::from(target, mesh.positions[v], normals[v], guess);
            guess = nearest.triangle;
        }
    });

    // Integrate over the area.
    let parts = par::map_chunks(mesh.triangles.len(), CHUNK, |range| {
        let mut sum = Distance::default();
        for t in range {
            let normals = mesh.triangles[t].map(|v| normals[v as usize]);
            let nearest = mesh.triangles[t].map(|v| near[v as usize]);
            sum.add(target, &at(t), &normals, &nearest, step);
        }
        sum
    });
    let mut sum = parts.into_iter().fold(Distance::default(), Distance::joined);

    // The largest distance may be inside a triangle, between the samples.
    let found = sum.largest as f32;
    let inner = par::map_chunks(mesh.triangles.len(), CHUNK, |range| {
        let search = Search { target, slack: STEP_TOLERANCE * step };
        let corner = |v: u32| (near[v as usize].triangle, near[v as usize].distance);
        range.fold(found, |largest, t| search.largest(&at(t), &mesh.triangles[t].map(corner), largest, 0))
    });
    sum.largest = f64::from(inner.into_iter().fold(found, f32::max));
    sum
}

/// Triangles that a thread takes at a time.
const CHUNK: usize = 1024;

/// The nearest point of a target, as seen from a point of the surface.
#[derive(Clone, Copy, Debug, Default)]
struct NearestPoint {
    /// The nearest triangle of the target.
    triangle: u32,
    /// Distance to it [m].
    distance: f32,
    /// Angle to its normal [rad].
    angle: f32,
}

impl NearestPoint {
    /// The nearest point of `target` to the point `x` with this normal.
    fn from(target: &Target<'_>, x: Vec3, normal: Vec3, guess: u32) -> Self {
        let (triangle, distance) = target.nearest(x, guess);
        let other = target.normal_near(triangle, x);
        Self { triangle, distance, angle: atan2(normal.cross(&other).norm(), normal.dot(&other)) }
    }
}

/// Quadrature weights of a triangle's corners and of its middle, exact for squares of linear functions.
const WEIGHTS: [f64; 4] = [1.0 / 12.0, 1.0 / 12.0, 1.0 / 12.0, 0.75];

impl Distance {
    /// Root mean square (RMS) distance [m]; 0 for a surface without area.
    pub fn rms(&self) -> f64 {
        if self.area > 0.0 { (self.square / self.area).sqrt() } else { 0.0 }
    }

    /// Root mean square angle between the normals [rad]; 0 for a surface without area.
    pub fn angle(&self) -> f64 {
        if self.area > 0.0 { (self.angle_square / self.area).sqrt() } else { 0.0 }
    }

    /// The sum of both surfaces, or of both directions.
    #[must_use]
    pub fn joined(self, other: Self) -> Self {
        Self {
            area: self.area + other.area,
            square: self.square + other.square,
            largest: self.largest.max(other.largest),
            angle_square: self.angle_square + other.angle_square,
        }
    }

    /// Adds a triangle whose corners have the nearest points `nearest`, in n² parts no longer than `step`.
    fn add(
        &mut self,
        target: &Target<'_>,
        corners: &[Vec3; 3],
        normals: &[Vec3; 3],
        nearest: &[NearestPoint; 3],
        step: f32,
    ) {
        let [a, b, c] = *corners;
        let longest = longest(corners);
        let n = (longest / step).ceil().max(1.0) as usize;
        let area = 0.5 * f64::from((b - a).cross(&(c - a)).norm());
        let from = |[s, t]: [f32; 2]| {
            let x = a + (b - a) * s + (c - a) * t;
            let normal = normals[0] * (1.0 - s - t) + normals[1] * s + normals[2] * t;
            NearestPoint::from(target, x, normal, nearest[0].triangle)
        };
        for part in parts(n) {
            let [p, q, r] = part;
            let middle = [0, 1].map(|i| (p[i] + q[i] + r[i]) / 3.0);
            let nearest = if n == 1 { *nearest } else { part.map(from) };
            for (nearest, share) in nearest.into_iter().chain([from(middle)]).zip(WEIGHTS) {
                let weight = area * share / (n * n) as f64;
                self.largest = self.largest.max(f64::from(nearest.distance));
                self.square += weight * f64::from(nearest.distance).powi(2);
                self.angle_square += weight * f64::from(nearest.angle).powi(2);
            }
        }
        self.area += area;
    }
}

/// Length of the longest side [m].
fn longest([a, b, c]: &[Vec3; 3]) -> f32 {
    (b - a).norm().max((c - b).norm()).max((a - c).norm())
}

/// The corners of a triangle's n² parts, as barycentric coordinates of its second and third corner.
fn parts(n: usize) -> impl Iterator<Item = [[f32; 2]; 3]> {
    let at = move |column: usize, row: usize| [column as f32 / n as f32, row as f32 / n as f32];
    (0..n).flat_map(move |row| {
        let upward = (0..n - row).map(move |i| [at(i, row), at(i + 1, row), at(i, row + 1)]);
        let downward = (0..n - row - 1).map(move |i| [at(i + 1, row + 1), at(i, row + 1), at(i + 1, row)]);
        upward.chain(downward)
    })
}

/// A search for the largest distance.
struct Search<'a> {
    target: &'a Target<'a>,
    slack: f32,
}

impl Search<'_> {
    /// The larger of `largest` and the largest distance in a triangle, whose corners have these nearest
    /// triangles.
    fn largest(&self, corners: &[Vec3; 3], near: &[(u32, f32); 3], largest: f32, depth: u32) -> f32 {
        let largest = near.iter().fold(largest, |largest, (_, d)| largest.max(*d));
        let limit = largest * (1.0 + RELATIVE_TOLERANCE) + self.slack;
        // No point of a triangle is farther than its longest side over √3 from all of its corners.
        let nearer = near.iter().fold(0.0, |far: f32, (_, d)| far.max(*d)) + 0.578 * longest(corners);
        if nearer <= limit {
            return largest;
        }
        // Nowhere in the triangle is the distance to one triangle larger than at the corners.
        let bound = |&(triangle, _): &(u32, f32)| {
            corners.iter().map(|&x| self.target.distance_to(triangle, x)).fold(0.0, f32::max)
        };
        let bounded = near.iter().any(|found| bound(found) <= limit);
        if bounded || depth == MAX_SUBDIVISIONS {
            return largest;
        }
        let [a, b, c] = *corners;
        let middles = [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5];
        let [ab, bc, ca] = middles;
        let [n_ab, n_bc, n_ca] = middles.map(|x| self.target.nearest(x, near[0].0));
        let quarters = [
            ([a, ab, ca], [near[0], n_ab, n_ca]),
            ([ab, b, bc], [n_ab, near[1], n_bc]),
            ([ca, bc, c], [n_ca, n_bc, near[2]]),
            ([ab, bc, ca], [n_ab, n_bc, n_ca]),
        ];
        quarters
            .iter()
            .fold(largest, |largest, (corners, near)| self.largest(corners, near, largest, depth + 1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{grid::SparseGrid, mesh::marching_cubes};

    fn ball(radius: f32, voxel: f32) -> Mesh {
        let reach = Vec3::repeat(radius + 4.0 * voxel);
        let mut mesh = marching_cubes(&SparseGrid::sample(voxel, -reach, reach, |x| x.norm() - radius)).0;
        mesh.normals = mesh.positions.iter().map(|x| x.normalize()).collect();
        mesh
    }

    /// A unit cube of twelve triangles, translated.
    fn cube(by: Vec3) -> Mesh {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) + by;
        let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let triangles = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() }
    }

    fn between(a: &Mesh, b: &Mesh, step: f32) -> [Distance; 2] {
        [distance(a, &Target::new(b).unwrap(), step), distance(b, &Target::new(a).unwrap(), step)]
    }

    #[test]
    fn the_distance_of_concentric_balls_is_the_difference_of_their_radii() {
        let (small, large) = (ball(1.0, 0.05), ball(1.2, 0.05));
        for found in between(&small, &large, 0.1) {
            // Chords of the voxel lie below the sphere by an eighth of its square over the radius.
            assert!((found.rms() - 0.2).abs() < 1e-3, "{found:?}");
            assert!((found.largest - 0.2).abs() < 2e-3, "{found:?}");
            assert!(found.angle() < 0.02, "{found:?}");
        }
        let [outward, inward] = between(&small, &large, 0.1);
        let sphere = |r: f64| 4.0 * std::f64::consts::PI * r * r;
        assert!((outward.area / sphere(1.0) - 1.0).abs() < 2e-3);
        let both = outward.joined(inward);
        assert!((both.area - outward.area - inward.area).abs() < 1e-9 && both.largest >= inward.largest);
    }

    #[test]
    fn the_distance_of_a_translated_cube_matches_the_integral() {
        for by in [Vec3::new(0.3, 0.0, 0.0), Vec3::new(0.0, 0.0, -0.3)] {
            for found in between(&cube(Vec3::zeros()), &cube(by), 0.01) {
                // One face is 0.3 away everywhere. The opposite one is inside, at 0.3 or the distance to its
                // rim: 0.0342. Four strips protrude: 0.009 each.
                let square = 0.09 + 0.0342 + 4.0 * 0.009;
                assert!((found.square - square).abs() < 2e-4, "{found:?}");
                assert!((found.area - 6.0).abs() < 1e-5 && (found.largest - 0.3).abs() < 1e-6, "{found:?}");
            }
        }
    }

    #[test]
    fn the_hausdorff_distance_is_found_between_the_vertices() {
        // Every vertex of the flat triangle lies on the roof: only its interior is far from it.
        let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [1.0, 2.0, 0.0]].map(Vec3::from);
        let top = Vec3::new(1.4, 0.4, 0.8);
        let flat = Mesh { positions: corners.to_vec(), triangles: vec![[0, 1, 2]], ..Mesh::default() };
        let roof = Mesh {
            positions: [&corners[..], &[top]].concat(),
            triangles: vec![[0, 1, 3], [1, 2, 3], [2, 0, 3]],
            ..Mesh::default()
        };
        let target = Target::new(&roof).unwrap();
        let found = distance(&flat, &target, 3.0).largest;
        let mut exact = 0.0_f32;
        for (i, j) in (0..1000).flat_map(|i| (0..1000 - i).map(move |j| (i, j))) {
            let (s, t) = (i as f32 / 1000.0, j as f32 / 1000.0);
            let x = corners[0] + (corners[1] - corners[0]) * s + (corners[2] - corners[0]) * t;
            exact = exact.max(target.nearest(x, 0).1);
        }
        let found = found as f32;
        let middle = target.nearest(corners.iter().sum::<Vec3>() / 3.0, 0).1;
        assert!(middle < 0.95 * exact, "the middle alone would suffice: {middle} of {exact}");
        assert!(found <= exact * 1.0001 && found > exact * 0.99 - STEP_TOLERANCE * 3.0, "{found} of {exact}");
    }

    #[test]
    fn tilted_normals_have_their_angle_and_equal_surfaces_no_distance() {
        let ball = ball(1.0, 0.1);
        let target = Target::new(&ball).unwrap();
        let same = distance(&ball, &target, 0.2);
        // Nearest points on slivers are accurate to a few millionths of their length.
        assert!(same.rms() < 1e-6 && same.largest < f64::from(STEP_TOLERANCE) * 0.2, "{same:?}");
        assert!(same.angle() < 1e-3, "{same:?}");
        // All turned by ten degrees, each about an axis across it.
        let mut turned = ball.clone();
        for n in &mut turned.normals {
            let across = n.cross(&if n.x.abs() < 0.5 { Vec3::x() } else { Vec3::y() }).normalize();
            *n = *n * 10.0_f32.to_radians().cos() + across * 10.0_f32.to_radians().sin();
        }
        let found = distance(&turned, &target, 0.2).angle().to_degrees();
        assert!((found - 10.0).abs() < 0.4, "{found}");
        assert!(Target::new(&Mesh::default()).is_none());
        assert_eq!(distance(&Mesh::default(), &target, 0.2), Distance::default());
    }

    #[test]
    fn threads_change_no_bit() {
        let (a, b) = (ball(1.0, 0.1), ball(1.03, 0.07));
        let found = [1, 2, 5].map(|threads| par::with_threads(threads, || between(&a, &b, 0.05)));
        assert!(found.iter().all(|other| *other == found[0]));
    }
}
