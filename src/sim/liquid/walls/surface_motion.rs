//! Displacement of the surfaces of solids over a substep.

use super::{Body, Walls, deforming::Deforming};
use crate::{math::Vec3, sim::liquid::calibration::RestState};

impl Body {
    /// Gives it the shape and size at `time` [s], the end of the substep.
    pub(super) fn deform(&mut self, time: f64, rest: &RestState) {
        if let Some(deforming) = &mut self.deforming {
            self.density_map = deforming.advance(&mut self.shape, time, rest);
        }
    }

    /// Removes the motion of its vertices in the substep.
    pub(super) fn rest(&mut self) {
        if let Some(deforming) = &mut self.deforming {
            deforming.rest(&self.shape);
        }
    }

    /// Largest size over the present one, at least 1.
    pub(super) fn growth(&self) -> f64 {
        self.deforming.as_ref().map_or(1.0, Deforming::growth)
    }

    /// Where the path of a particle relative to its surface starts that was at `x` at the start of the substep, in its own axes [m].
    #[inline]
    pub(super) fn swept_start(&self, x: Vec3) -> Vec3 {
        self.deforming.as_ref().map_or(x, |deforming| deforming.swept_start(&self.shape, x))
    }

    /// Displacement of its surface over the substep by its change of shape and size, near `x`, in its own axes [m].
    #[inline]
    pub(super) fn deformed(&self, x: Vec3) -> Option<Vec3> {
        Some(self.deforming.as_ref()?.displacement(&self.shape, x))
    }
}

impl Walls {
    /// Displacement over the substep of the part of a moving solid that is at `x` in the middle of it [m]. `body` is its shape if it is
    /// none of planes.
    #[inline]
    pub(super) fn displacement(&self, mover: usize, body: Option<&Body>, x: Vec3) -> Vec3 {
        let mover = &self.movers[mover];
        let rigid = mover.displacement(x);
        let deformed = body.and_then(|body| body.deformed(mover.now.to_local(x)));
        deformed.map_or(rigid, |by| rigid + mover.now.rotation * by)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::Kernel,
        solid::{Deformation, Interpolation, Keyframe, MeshShape, Motion, Shape, Solid},
    };
    use std::sync::Arc;

    /// A box of 1 m whose top rises by 1 m/s from time 0 to 1 s, then rests.
    fn rising() -> Solid {
        let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
        let block: Vec<Vec3> = (0..8).map(|i| Vec3::from_fn(|axis, _| corner(i, axis))).collect();
        let raised = block.iter().map(|x| if x.z > 0.0 { x + Vec3::z() } else { *x }).collect();
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let motion = Deformation::new(faces, vec![block, raised], vec![0.0, 1.0], 32).unwrap();
        let mut mesh = MeshShape::new("made here");
        mesh.fill_deforming(Arc::new(motion));
        Solid { friction: 0.5, ..Solid::fixed(Shape::Mesh(mesh)) }
    }

    #[test]
    fn a_rising_surface_displaces_pushes_and_does_work() {
        let rest = RestState::new(Kernel::Poly6Spiky, 0.1, 2.0);
        let mut walls = Walls::new(&[rising()], &rest);
        assert!(walls.has_moving_solids());
        assert!((walls.max_speed(0.5) - 1.0).abs() < 1e-5);
        walls.move_to(0.25);
        walls.move_to(0.3);
        let top = 0.8;
        let at = |z: f32| Vec3::new(0.1, -0.2, z);
        assert!((walls.distance(at(top + 0.05)) - 0.05).abs() < 2e-3);
        // A particle that was 0.03 m above the top is lifted with it, out to the contact distance.
        let (swept, stuck) = walls.collide_moving(at(0.78), at(0.78));
        assert!(!stuck && (swept.z - (top + 0.05)).abs() < 3e-3, "{swept:?}");
        let work = walls.work(at(0.78), swept);
        assert!((work / (f64::from(swept.z - 0.78) * 0.05) - 1.0).abs() < 0.03, "{work}");
        let (density, gradient) = walls.boundary_density(at(top + 0.05));
        assert!(density > 0.1 && gradient.z < 0.0, "{density} {gradient:?}");
        assert!(gradient.xy().norm() < 0.1 * gradient.z.abs(), "{gradient:?}");
        let expected = walls.boundary_density(at(top + 0.05)).1.z * -0.05;
        let found = walls.pressure_work(at(top + 0.05), -1.0) as f32;
        assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
        // The sides rest: they neither move nor do work, also beyond the grid of the mesh, which ends 0.25 m off them.
        for off in [0.02, 0.2, 0.3, 0.5] {
            let side = Vec3::new(-0.5 - off, 0.0, 0.0);
            let by = walls.displacement(0, Some(&walls.bodies[0]), side);
            assert!(by.norm() < 1e-6, "{off}: {by:?}");
        }
        // Without motion in the substep nothing is displaced.
        walls.place_at(0.3);
        assert!(walls.displacement(0, Some(&walls.bodies[0]), at(top)).norm() < 1e-6);
        walls.move_to(1.5);
        assert_eq!(walls.max_speed(0.5), 0.0, "the motion has ended");
    }

    #[test]
    fn a_growing_ball_pushes_what_is_near_it_as_a_mesh_does() {
        let size = |frame: u32, scale: f32| Keyframe {
            frame,
            position: [1.0, 0.0, 0.0],
            rotation: [0.0; 3],
            quaternion: None,
            scale,
        };
        let motion = Motion::new(&[size(0, 1.0), size(1, 3.0)], Interpolation::Linear, 1.0, 0);
        let ball = Shape::Sphere { center: [0.0; 3], radius: 0.2 };
        let rest = RestState::new(Kernel::Wendland, 0.05, 2.0);
        let mut walls = Walls::new(&[Solid { motion, ..Solid::fixed(ball) }], &rest);
        assert!(walls.has_moving_solids() && (walls.max_speed(1.0) - 0.4).abs() < 1e-6);
        let mut x = Vec3::new(1.0, 0.0, 0.25);
        for step in 1..=10 {
            walls.move_to(0.1 * f64::from(step));
            let surface = 0.2 + 0.04 * step as f32;
            assert!((walls.distance(Vec3::new(1.0, surface + 0.1, 0.0)) - 0.1).abs() < 1e-5, "{step}");
            let (moved, stuck) = walls.collide_moving(x, x);
            assert!(!stuck, "{step}");
            let moved_by = walls.displacement(0, Some(&walls.bodies[0]), moved);
            assert!((moved_by - Vec3::z() * 0.04).norm() < 1e-5, "{moved_by:?}");
            x = moved;
        }
        assert!((x - Vec3::new(1.0, 0.0, 0.625)).norm() < 1e-4, "{x:?}");
        assert!((walls.distance(Vec3::new(1.0, 0.7, 0.0)) - 0.1).abs() < 1e-5);
    }

    #[test]
    fn a_thin_part_that_crosses_a_particle_takes_it_along() {
        let corner = |i: usize, axis: usize| if i >> axis & 1 == 1 { 0.5 } else { -0.5 };
        let plate = |shift: f32| -> Vec<Vec3> {
            (0..8).map(|i| Vec3::new(corner(i, 0), corner(i, 1), 0.12 * corner(i, 2) + shift)).collect()
        };
        let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let faces = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let motion = Deformation::new(faces, vec![plate(0.0), plate(0.6)], vec![0.0, 0.1], 32).unwrap();
        let mut mesh = MeshShape::new("made here");
        mesh.fill_deforming(Arc::new(motion));
        let rest = RestState::new(Kernel::Poly6Spiky, 0.05, 2.0);
        let mut walls = Walls::new(&[Solid::fixed(Shape::Mesh(mesh))], &rest);
        let mut x = Vec3::new(0.05, 0.1, 0.1);
        for step in 1..=20 {
            walls.move_to(0.005 * f64::from(step));
            let (moved, stuck) = walls.collide_moving(x, x);
            assert!(!stuck, "{step}");
            x = moved;
        }
        assert!((x.z - (0.66 + 0.025)).abs() < 0.01, "{x:?}");
        // In one substep the plate passes farther than half of its thickness, and its nearest face is the one on the other side.
        walls.place_at(0.02);
        walls.move_to(0.036);
        let above = Vec3::new(0.05, 0.1, 0.12 + 0.06 + 0.005);
        let (moved, stuck) = walls.collide_moving(above, above);
        assert!(!stuck && moved.z > 0.216 + 0.06, "{moved:?}");
    }
}
