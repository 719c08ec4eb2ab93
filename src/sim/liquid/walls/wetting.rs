//! Contact angles of several solids.
//!
//! *Method*: where solids of different contact angles are within the support, cos θ is the mean of theirs, weighted by the magnitudes of
//! their density gradients. It is that of the nearest solid where one is clearly nearest, and it is continuous, so that the
//! energy of the wetted area has a gradient everywhere.

use super::Walls;
use crate::math::Vec3;

/// Calibrated cos θ of all solids.
#[derive(Debug)]
pub(in crate::sim::liquid) struct Wetting {
    /// cos θ where no solid has another.
    common: f32,
    /// cos θ of the planes, then of the bodies; empty if all are [`Self::common`].
    each: Vec<f32>,
}

impl Wetting {
    /// Wetting by `walls`, where `cosine` is cos θ of a contact angle [°], and `liquid` the angle of solids that name none.
    pub(in crate::sim::liquid) fn new(walls: &Walls, liquid: f32, cosine: impl Fn(f32) -> f32) -> Self {
        let planes = walls.planes.iter().map(|plane| plane.surface);
        let angles = planes.chain(walls.bodies.iter().map(|body| body.surface));
        let each: Vec<f32> = angles.map(|surface| cosine(surface.contact_angle.unwrap_or(liquid))).collect();
        match each.split_first() {
            Some((&first, others)) if others.iter().all(|&other| other == first) => {
                Self { common: first, each: Vec::new() }
            }
            _ => Self { common: cosine(liquid), each },
        }
    }

    /// Whether solids have different contact angles.
    pub(in crate::sim::liquid) fn varies(&self) -> bool {
        !self.each.is_empty()
    }

    /// cos θ at `x`.
    #[inline]
    pub(in crate::sim::liquid) fn cosine(&self, walls: &Walls, x: Vec3) -> f32 {
        if self.varies() { self.mean_cosine(walls, x) } else { self.common }
    }

    /// Mean of the solids near `x`.
    fn mean_cosine(&self, walls: &Walls, x: Vec3) -> f32 {
        let (mut sum, mut weights) = (0.0, 0.0);
        let mut add = |weight: f32, cosine: f32| {
            sum += weight * cosine;
            weights += weight;
        };
        let (of_planes, of_bodies) = self.each.split_at(walls.planes.len());
        for (plane, &cosine) in walls.planes.iter().zip(of_planes) {
            let d = plane.n.dot(&x) - plane.offset;
            if d < walls.support {
                add(walls.half_space_slope(d), cosine);
            }
        }
        for (body, cosine) in walls.near(x, walls.support).map(|body| (&walls.bodies[body], of_bodies[body]))
        {
            if walls.body_distance(body, x) < walls.support {
                add(walls.body_density(body, x, walls.shift).1.norm(), cosine);
            }
        }
        if weights > 0.0 { sum / weights } else { self.common }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState},
        solid::{Shape, Solid},
    };

    #[test]
    fn the_cosine_is_that_of_the_nearest_solid_and_continuous() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.5);
        let floor = Shape::Plane { point: [0.0; 3], normal: [0.0, 0.0, 1.0] };
        let block = Shape::Box { min: [0.0, -1.0, 0.0], max: [2.0, 1.0, 1.0] };
        let solid = |shape: &Shape, contact_angle| Solid { contact_angle, ..Solid::fixed(shape.clone()) };
        let wetting = |angles: [Option<f32>; 2]| {
            let walls = Walls::new(&[solid(&block, angles[0]), solid(&floor, angles[1])], &rest);
            let wetting = Wetting::new(&walls, 60.0, |angle: f32| angle.to_radians().cos());
            (walls, wetting)
        };
        let (walls, same) = wetting([Some(120.0), Some(120.0)]);
        assert!(!same.varies() && (same.cosine(&walls, Vec3::zeros()) + 0.5).abs() < 1e-6);
        let (walls, varies) = wetting([Some(120.0), None]);
        assert!(varies.varies());
        let at = |x: f32, z: f32| varies.cosine(&walls, Vec3::new(x, 0.0, z));
        assert!((at(-0.5, 0.05) - 0.5).abs() < 1e-6, "floor: {}", at(-0.5, 0.05));
        assert!((at(-0.05, 0.5) + 0.5).abs() < 1e-6, "block: {}", at(-0.05, 0.5));
        assert!(at(-0.05, 0.15) < -0.1 && at(-0.15, 0.05) > 0.1, "{}, {}", at(-0.05, 0.15), at(-0.15, 0.05));
        for k in 0..100 {
            let x = -0.3 + 0.0025 * k as f32;
            assert!((at(x, 0.05) - at(x + 0.0025, 0.05)).abs() < 0.03, "{x}");
        }
    }
}
