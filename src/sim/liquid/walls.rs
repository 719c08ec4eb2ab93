//! What the solids do to the liquid: keep particles out, and fill in the density they displace.
//!
//! *Method*: contact by projection along the outward normal, inside the solver's loop ([pbf] Algorithm 1,
//! line 14). *Departs from the paper*: near a solid the density lacks the share of a kernel that lies inside it,
//! and particles stack in layers ([pbf] section 9). That share is added as if the solid were a half space behind
//! its nearest point: Poly6 and Spiky integrated over a half space have closed forms. Several solids combine as
//! independent: the part left open is the product of the parts that each leaves open, which for two or three
//! perpendicular walls keeps the corner near rest.
//!
//! Limits: sharp convex corners and parts thinner than h displace less than the half space assumed.

use super::rest::Rest;
use crate::{
    math::Vec3,
    solid::{Collider, Shape},
};

/// How often a particle is pushed out of all solids in turn before the rest is only counted.
const ROUNDS: usize = 8;

/// The solids, as the solver asks for them.
#[derive(Debug)]
pub(super) struct Walls {
    /// Half spaces as (unit outward normal, offset): planes and the faces of tanks.
    planes: Vec<(Vec3, f32)>,
    /// Every other shape.
    shapes: Vec<Shape>,
    /// Particles keep this far from every surface [m].
    contact: f32,
    support: f32,
    inv_support: f32,
    shift: f32,
    rest: Rest,
}

impl Walls {
    /// Takes the colliders apart.
    pub(super) fn new(colliders: &[Collider], rest: &Rest) -> Self {
        let (mut planes, mut shapes) = (Vec::new(), Vec::new());
        for Collider { shape, .. } in colliders {
            match *shape {
                Shape::Plane { point, normal } => {
                    let n = Vec3::from(normal).normalize();
                    planes.push((n, n.dot(&Vec3::from(point))));
                }
                Shape::Tank { min, max } => {
                    for axis in 0..3 {
                        let n = Vec3::ith(axis, 1.0);
                        planes.push((n, min[axis]));
                        planes.push((-n, -max[axis]));
                    }
                }
                _ => shapes.push(shape.clone()),
            }
        }
        Self {
            planes,
            shapes,
            contact: 0.5 * rest.spacing,
            support: rest.support,
            inv_support: rest.inv_support,
            shift: rest.wall_shift,
            rest: *rest,
        }
    }

    /// Distance and normal of every solid at `x`.
    #[inline]
    fn contacts(&self, x: Vec3) -> impl Iterator<Item = (f32, Vec3)> {
        let planes = self.planes.iter().map(move |&(n, offset)| (n.dot(&x) - offset, n));
        planes.chain(self.shapes.iter().map(move |shape| shape.contact(x)))
    }

    /// The smallest distance from `x` to a solid [m]; infinite without solids.
    pub(super) fn distance(&self, x: Vec3) -> f32 {
        self.contacts(x).fold(f32::INFINITY, |least, (d, _)| least.min(d))
    }

    /// `x` pushed out of the solids, and whether it still touches one after the last round.
    #[inline]
    pub(super) fn project(&self, mut x: Vec3) -> (Vec3, bool) {
        for _ in 0..ROUNDS {
            let mut touched = false;
            for &(n, offset) in &self.planes {
                let depth = self.contact - (n.dot(&x) - offset);
                if depth > 0.0 {
                    x += n * depth;
                    touched = true;
                }
            }
            for shape in &self.shapes {
                let (d, n) = shape.contact(x);
                if d < self.contact {
                    x += n * (self.contact - d);
                    touched = true;
                }
            }
            if !touched {
                return (x, false);
            }
        }
        let slack = 0.01 * self.contact;
        (x, self.distance(x) < self.contact - slack)
    }

    /// The solids' share of ρ₀ at `x` and its gradient [1/m].
    #[inline]
    pub(super) fn share(&self, x: Vec3) -> (f32, Vec3) {
        let (mut open, mut open_gradient) = (1.0_f32, Vec3::zeros());
        for (d, n) in self.contacts(x) {
            if d < self.support {
                let left = 1.0 - self.rest.solid_share((d + self.shift) * self.inv_support);
                let slope = n * (self.rest.solid_slope(d * self.inv_support) * self.inv_support);
                open_gradient = open_gradient * left + slope * open;
                open *= left;
            }
        }
        (1.0 - open, -open_gradient)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sim::liquid::Kernel;

    fn corner() -> Walls {
        let tank = Shape::Tank { min: [0.0; 3], max: [1.0; 3] };
        Walls::new(&[Collider { shape: tank }], &Rest::new(Kernel::Poly6Spiky, 0.1, 2.0))
    }

    #[test]
    fn a_particle_beyond_a_corner_ends_inside_it() {
        let (x, stuck) = corner().project(Vec3::new(-3.0, 1.5, -0.2));
        assert!(!stuck && (x - Vec3::new(0.05, 0.95, 0.05)).norm() < 1e-5, "{x:?}");
    }

    #[test]
    fn a_gap_too_narrow_for_a_particle_is_reported() {
        let sides = [([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]), ([0.0, 0.0, 0.08], [0.0, 0.0, -1.0])];
        let colliders = sides.map(|(point, normal)| Collider { shape: Shape::Plane { point, normal } });
        assert!(Walls::new(&colliders, &Rest::new(Kernel::Poly6Spiky, 0.1, 2.0)).project(Vec3::zeros()).1);
    }

    #[test]
    fn the_share_in_edges_and_corners_leaves_the_lattice_near_rest() {
        let (walls, rest) = (corner(), Rest::new(Kernel::Poly6Spiky, 0.1, 2.0));
        for (walls_near, bound) in [(1, 1e-3), (2, 0.03), (3, 0.05)] {
            let x = Vec3::from_fn(|axis, _| if axis < walls_near { 0.05 } else { 0.55 });
            let mut c = walls.share(x).0 - 1.0;
            for k in 0..1000 {
                let y = Vec3::new((k % 10) as f32, (k / 10 % 10) as f32, (k / 100) as f32) * 0.1;
                let q2 = (y + Vec3::repeat(0.05) - x).norm_squared() * rest.inv_support.powi(2);
                c += rest.density_scale * (1.0 - q2).max(0.0).powi(3);
            }
            assert!(c.abs() < bound, "{walls_near} walls: C = {c}");
        }
    }

    #[test]
    fn the_gradient_points_into_the_solids() {
        let (share, gradient) = corner().share(Vec3::new(0.05, 0.5, 0.08));
        assert!(share > 0.0 && gradient.x < 0.0 && gradient.z < 0.0 && gradient.y == 0.0);
        assert_eq!(corner().share(Vec3::repeat(0.5)).0, 0.0);
    }
}
