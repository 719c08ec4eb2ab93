//! Density that solids contribute to the liquid near them.
//!
//! *Method*: without it, a kernel that reaches into a solid lacks density, and particles stack in layers ([pbf] section 9).
//! It is added as if the solid were a slab behind its nearest point: the integrals of the kernels over a half space have
//! closed forms, and a slab is the difference of two half spaces. A box is the product of three slabs, which also holds at
//! its edges. Round solids contribute what a ball of their curvature does (`round_density.rs`). For meshes a density map has
//! the integral (`density_map.rs`). Several solids combine as if independent: the
//! open part is the product of their open parts, which for two or three perpendicular walls keeps a corner near rest.
//! In the density solve rigid bodies contribute by images of the particles instead (`images.rs`); surface tension and measures use the integral.
//! *Departs from [pbf]*: the paper has neither boundary particles nor such a term, and names stacking as a limitation.
//!
//! Limits: a mesh whose voxels are far larger than h is taken as flat (`density_map.rs`): its convex edges then contribute
//! 0.4, its concave edges 1.8 of the assumed density.

use super::{Body, Plane, Walls, round_density::mean_curvature};
use crate::{math::Vec3, solid::Shape};

impl Walls {
    /// Work of moving solids through their density in one correction of a particle at `x` with the multiplier `lambda` [m²];
    /// see [`Walls::work`].
    #[inline]
    pub(in crate::sim::liquid) fn pressure_work(&self, x: Vec3, lambda: f32) -> f64 {
        if lambda == 0.0 {
            return 0.0;
        }
        let planes = self.planes.iter().filter_map(|plane| {
            let d = plane.n.dot(&x) - plane.offset;
            let near = plane.mover.filter(|_| d < self.support);
            near.map(|mover| (mover, None, plane.n * self.half_space_slope(d)))
        });
        let bodies = self.near(x, self.support).map(|body| &self.bodies[body]).filter_map(|body| {
            let keyframed = body.mover.filter(|&mover| mover < self.keyframed);
            let near = keyframed.filter(|_| self.body_distance(body, x) < self.support);
            near.map(|mover| (mover, Some(body), self.body_slope(body, x)))
        });
        let did = planes.chain(bodies).map(|(mover, body, falls)| {
            f64::from(falls.dot(&self.displacement(mover, body, x))) * f64::from(-lambda)
        });
        did.sum()
    }

    /// Density of the solids at `x`, over ρ₀, and its gradient [1/m].
    #[inline]
    pub(in crate::sim::liquid) fn boundary_density(&self, x: Vec3) -> (f32, Vec3) {
        self.density_of_first(self.bodies.len(), x)
    }

    /// As [`Self::boundary_density`] without rigid bodies.
    #[inline]
    pub(in crate::sim::liquid) fn collider_density(&self, x: Vec3) -> (f32, Vec3) {
        self.density_of_first(self.rigid_index(0), x)
    }

    /// Density of the half spaces and of the first `count` bodies at `x`, over ρ₀, and its gradient [1/m].
    #[inline(always)]
    fn density_of_first(&self, count: usize, x: Vec3) -> (f32, Vec3) {
        let (mut open, mut open_gradient) = (1.0_f32, Vec3::zeros());
        let mut add = |left: f32, slope: Vec3| {
            open_gradient = open_gradient * left + slope * open;
            open *= left;
        };
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                add(1.0 - self.half_space_density(d, self.shift), plane.n * self.half_space_slope(d));
            }
        }
        for body in self.near_of_first(count, x, self.support).map(|body| &self.bodies[body]) {
            if self.body_distance(body, x) < self.support {
                let (share, slope) = self.body_density(body, x, self.shift);
                add(1.0 - share, slope);
            }
        }
        (1.0 - open, -open_gradient)
    }

    /// The gradient of [`Self::boundary_density`] alone, which takes less time where only one solid is near.
    #[inline]
    pub(in crate::sim::liquid) fn boundary_gradient(&self, x: Vec3) -> Vec3 {
        let of_plane = |plane: &Plane| {
            let d = plane.n.dot(&x) - plane.offset;
            (d < self.support).then(|| plane.n * self.half_space_slope(d))
        };
        let mut planes = self.planes.iter().filter_map(of_plane);
        let near = self.near(x, self.support).map(|body| &self.bodies[body]);
        let mut bodies = near.filter(|body| self.body_distance(body, x) < self.support);
        let slope = match (planes.next(), bodies.next()) {
            (None, None) => Vec3::zeros(),
            (Some(of_plane), None) if planes.next().is_none() => of_plane,
            (None, Some(body)) if bodies.next().is_none() => self.body_slope(body, x),
            _ => return self.boundary_density(x).1,
        };
        -slope
    }

    /// The negative gradient of [`Self::body_density`] alone, which takes less time at round bodies.
    #[inline]
    pub(super) fn body_slope(&self, body: &Body, x: Vec3) -> Vec3 {
        let own = self.own_position(body, x);
        let contact = body.shape.contact(own);
        match mean_curvature(&body.shape, own, contact.1, self.support) {
            Some(curvature) => self.turned(body, contact.1) * self.round_slope(curvature, contact.0),
            _ => self.body_density_with(body, [x, own], || contact, self.shift).1,
        }
    }

    /// Density of a half space at distance `d` [m] whose surface is moved inward by `shift` [m].
    #[inline]
    pub(super) fn half_space_density(&self, d: f32, shift: f32) -> f32 {
        self.rest.half_space_density((d + shift) * self.inv_support)
    }

    /// Slope with which the density of a half space decreases at distance `d` [1/m].
    #[inline]
    pub(super) fn half_space_slope(&self, d: f32) -> f32 {
        self.rest.half_space_slope(d * self.inv_support) * self.inv_support
    }

    /// Density of one body whose surface is moved inward by `shift` [m], and the negative gradient [1/m] of that without the shift.
    #[inline]
    pub(super) fn body_density(&self, body: &Body, x: Vec3, shift: f32) -> (f32, Vec3) {
        let own = self.own_position(body, x);
        self.body_density_with(body, [x, own], || body.shape.contact(own), shift)
    }

    /// As [`Self::body_density`] at a position in the coordinates of the world and of the body, where `contact` gives distance and normal
    /// in the latter.
    #[inline]
    pub(super) fn body_density_with(
        &self,
        body: &Body,
        [x, own]: [Vec3; 2],
        contact: impl FnOnce() -> (f32, Vec3),
        shift: f32,
    ) -> (f32, Vec3) {
        let turned = |n: Vec3| self.turned(body, n);
        if let Some(map) = &body.density_map {
            let (d, n) = map.contact(own);
            return (self.half_space_density(d, shift), turned(n) * self.half_space_slope(d));
        }
        if let Shape::Box { min, max } = body.shape {
            let (share, slope) = self.box_density(min, max, own, shift);
            return (share, turned(slope));
        }
        let (d, n) = contact();
        if let Some(curvature) = mean_curvature(&body.shape, own, n, self.support) {
            return (self.round_density(curvature, d, shift), turned(n) * self.round_slope(curvature, d));
        }
        // The probe at depth h is closer to the opposite face if the body is a slab thinner than h.
        let n = turned(n);
        let beyond = self.body_distance(body, x - n * self.support);
        let far = -d - (self.support - d - beyond).max(0.0);
        let share = self.half_space_density(d, shift) - (1.0 - self.half_space_density(far, shift));
        (share.max(0.0), n * (self.half_space_slope(d) - self.half_space_slope(far)))
    }

    /// Density of a box: the product of three slabs.
    #[inline]
    fn box_density(&self, min: [f32; 3], max: [f32; 3], x: Vec3, shift: f32) -> (f32, Vec3) {
        let (mut part, mut falls) = ([0.0; 3], [0.0; 3]);
        for axis in 0..3 {
            // Distances to both faces, positive outside the slab.
            let (low, high) = (min[axis] - x[axis], x[axis] - max[axis]);
            let [near, far] = [low, high].map(|d| self.half_space_density(d, shift));
            part[axis] = (near - (1.0 - far)).max(0.0);
            falls[axis] = self.half_space_slope(high) - self.half_space_slope(low);
        }
        let [a, b, c] = part;
        (a * b * c, Vec3::new(falls[0] * b * c, a * falls[1] * c, a * b * falls[2]))
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{corner, walls};
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState},
        solid::{Pose, Solid, sampled_mesh},
    };
    use nalgebra::Rotation3;

    #[test]
    fn the_density_in_edges_and_corners_leaves_the_seeding_lattice_near_rest() {
        let (walls, rest) = (corner(), RestState::new(Kernel::Poly6Spiky, 0.1, 2.0));
        for (walls_near, bound) in [(1, 1e-3), (2, 0.03), (3, 0.05)] {
            let x = Vec3::from_fn(|axis, _| if axis < walls_near { 0.05 } else { 0.55 });
            let mut c = walls.boundary_density(x).0 - 1.0;
            for k in 0..1000 {
                let y = Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32) * 0.1;
                let q2 = (y + Vec3::repeat(0.05) - x).norm_squared() * rest.inv_support.powi(2);
                c += rest.density_scale * (1.0 - q2).max(0.0).powi(3);
            }
            assert!(c.abs() < bound, "{walls_near} walls: C = {c}");
        }
    }

    #[test]
    fn gradients_alone_are_those_with_the_density() {
        let plane = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        let block = Shape::Box { min: [0.0, 0.0, 0.1], max: [0.3, 0.2, 0.3] };
        let ball = Shape::Sphere { center: [0.7, 0.1, 0.3], radius: 0.15 };
        let bar = Shape::Capsule { from: [0.9, 0.1, 0.3], to: [1.1, 0.3, 0.5], radius: 0.05 };
        let ring = Shape::Torus { center: [0.4, 0.8, 0.3], axis: [0.0, 1.0, 1.0], radius: 0.2, tube: 0.06 };
        let drop = Shape::Ellipsoid { center: [0.0; 3], radii: [0.15, 0.1, 0.08] };
        let mut walls = walls(&[plane, block.clone(), ball, bar, ring]);
        walls.add_rigid_bodies(&[block, drop].map(Solid::fixed), |_| 1.0);
        let rotation = *Rotation3::from_euler_angles(0.4_f32, -0.7, 1.1).matrix();
        let pose = |x| Pose { rotation, position: Vec3::new(x, 0.9, 0.5) };
        walls.set_rigid_bodies([1.0, 0.2].into_iter().map(|x| [pose(x); 2]));
        // No solid, one and several.
        let mut found = [0; 3];
        for k in 0..20_000_u32 {
            let part = |prime: u32| (k * prime % 19_997) as f32 / 19_997.0;
            let x = Vec3::new(1.3 * part(71), 1.2 * part(397), 0.9 * part(1_879));
            let near = walls.near(x, walls.support);
            let near =
                near.filter(|&body| walls.body_distance(&walls.bodies[body], x) < walls.support).count();
            found[(near + usize::from(x.z < walls.support)).min(2)] += 1;
            assert_eq!(walls.boundary_gradient(x), walls.boundary_density(x).1, "{x:?}");
        }
        assert!(found.iter().all(|&found| found > 500), "{found:?}");
    }

    /// Integral of Poly6 over the solid, moved inward by the calibrated offset.
    fn integral(rest: &RestState, x: Vec3, distance: impl Fn(Vec3) -> f32) -> f32 {
        let n = 48;
        let (mut inside, mut all) = (0.0, 0.0);
        for k in 0..n * n * n {
            let at = |i: i32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
            let q = Vec3::new(at(k % n), at(k / n % n), at(k / n / n));
            let w = (1.0 - q.norm_squared()).max(0.0).powi(3);
            all += w;
            // Solid fraction of the cell, so that a face within it is not rounded to its edge.

            let depth = -(distance(x + q * rest.support) + rest.wall_shift) / (2.0 * rest.support / n as f32);
            inside += w * (depth + 0.5).clamp(0.0, 1.0);
        }
        inside / all
    }

    #[test]
    fn the_density_near_bodies_approximates_the_kernels_integral() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let cuboid = |half: Vec3| {
            move |x: Vec3| {
                let q = x.abs() - half;
                q.sup(&Vec3::zeros()).norm() + q.max().min(0.0)
            }
        };
        let thick = Vec3::repeat(0.6);
        let thin = Vec3::new(0.6, 0.6, 0.05);
        let shape = |half: Vec3| Shape::Box { min: (-half).into(), max: half.into() };
        let ball = |radius: f32| move |x: Vec3| x.norm() - radius;
        let bowl = |x: Vec3| -cuboid(thick)(x);
        type Exact<'a> = &'a dyn Fn(Vec3) -> f32;
        let (thick_, thin_, big, small) = (cuboid(thick), cuboid(thin), ball(0.6), ball(0.2));
        let face = Vec3::new(0.0, 0.0, 0.65);
        let edge = Vec3::new(0.0, 0.635, 0.635);
        let point = Vec3::repeat(0.63);
        let cases: [(&str, Shape, Exact<'_>, Vec3, f32); 17] = [
            ("box, face", shape(thick), &thick_, face, 0.01),
            ("box, edge", shape(thick), &thick_, edge, 0.03),
            ("box, corner", shape(thick), &thick_, point, 0.03),
            ("plate one spacing thick", shape(thin), &thin_, Vec3::new(0.0, 0.0, 0.1), 0.01),
            ("plate, rim", shape(thin), &thin_, Vec3::new(0.0, 0.65, 0.0), 0.03),
            ("ball of three h", Shape::Sphere { center: [0.0; 3], radius: 0.6 }, &big, face, 0.005),
            (
                "ball of one h",
                Shape::Sphere { center: [0.0; 3], radius: 0.2 },
                &small,
                Vec3::new(0.0, 0.0, 0.25),
                0.005,
            ),
            ("mesh of a box, face", sampled_mesh(0.05, cuboid(thick)), &thick_, face, 0.01),
            ("mesh of a box, edge", sampled_mesh(0.05, cuboid(thick)), &thick_, edge, 0.03),
            ("mesh of a box, corner", sampled_mesh(0.05, cuboid(thick)), &thick_, point, 0.03),
            ("mesh with voxels of h/2, edge", sampled_mesh(0.1, cuboid(thick)), &thick_, edge, 0.03),
            (
                "mesh with voxels of h/2 from inside, edge",
                sampled_mesh(0.1, bowl),
                &bowl,
                Vec3::new(0.0, 0.55, 0.55),
                0.04,
            ),
            ("mesh with voxels of h, edge", sampled_mesh(0.2, cuboid(thick)), &thick_, edge, 0.04),
            ("mesh with voxels of h, face", sampled_mesh(0.2, cuboid(thick)), &thick_, face, 0.01),
            ("mesh of a plate", sampled_mesh(0.025, cuboid(thin)), &thin_, Vec3::new(0.0, 0.0, 0.1), 0.02),
            ("mesh from inside, edge", sampled_mesh(0.05, bowl), &bowl, Vec3::new(0.0, 0.55, 0.55), 0.04),
            ("mesh from inside, face", sampled_mesh(0.05, bowl), &bowl, Vec3::new(0.0, 0.0, 0.55), 0.01),
        ];
        for (name, shape, exact, x, bound) in cases {
            let (share, truth) = (walls(&[shape]).boundary_density(x).0, integral(&rest, x, exact));
            println!("{name}: {share:.3}, integral {truth:.3}");
            assert!((share - truth).abs() < bound, "{name}: {share}, integral {truth}");
        }
    }

    #[test]
    fn the_gradient_points_into_the_solids() {
        let (share, gradient) = corner().boundary_density(Vec3::new(0.05, 0.5, 0.08));
        assert!(share > 0.0 && gradient.x < 0.0 && gradient.z < 0.0 && gradient.y == 0.0);
        assert_eq!(corner().boundary_density(Vec3::repeat(0.5)).0, 0.0);
        let plate = walls(&[Shape::Box { min: [-1.0, -1.0, -0.05], max: [1.0, 1.0, 0.05] }]);
        for x in [Vec3::new(0.0, 0.0, 0.1), Vec3::new(1.05, 0.0, 0.0), Vec3::new(0.0, -1.02, -0.08)] {
            let (share, gradient) = plate.boundary_density(x);
            assert!(share > 0.0 && gradient.dot(&x) < 0.0, "{x:?} {gradient:?}");
        }
    }
}
