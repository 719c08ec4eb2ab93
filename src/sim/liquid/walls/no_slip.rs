//! Viscous resistance of solids: the liquid sticks to their surfaces.
//!
//! *Method*: the viscous operator integrated over the solid behind its nearest point, as if that were a half space
//! (`viscous_kernel.rs`). It depends on the particle's own velocity alone, so it adds to the diagonal of the system.
//!
//! Limits: bodies are taken as flat; several solids add up, so corners resist up to twice as much. There the liquid
//! hardly moves anyway.

use super::{Body, Walls};
use crate::{math::Vec3, sim::liquid::viscous_kernel::ViscousKernel};

/// Resistance of the solids to a particle's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim::liquid) struct WallDrag {
    /// Symmetric matrix: xx, yy, zz, xy, xz, yz.
    matrix: [f32; 6],
    /// Matrix times the velocity of the surfaces [m/s].
    pub(in crate::sim::liquid) drive: Vec3,
    /// Velocity of the surfaces times `drive` [m²/s²].
    pub(in crate::sim::liquid) work: f32,
    /// Share of the solids in the sum that normalises the kernel.
    pub(in crate::sim::liquid) sum: f32,
}

impl WallDrag {
    /// Matrix times `v`.
    #[inline(always)]
    pub(in crate::sim::liquid) fn times(&self, v: Vec3) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = self.matrix;
        Vec3::new(
            xx * v.x + xy * v.y + xz * v.z,
            xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z,
        )
    }

    /// Multiplies the resistance.
    pub(in crate::sim::liquid) fn scale(&mut self, factor: f32) {
        self.matrix.iter_mut().for_each(|entry| *entry *= factor);
        self.drive *= factor;
        self.work *= factor;
    }

    /// Adds a half space with normal `n` whose surface moves with `u` [m/s].
    fn add(&mut self, n: Vec3, normal: f32, tangential: f32, u: Vec3) {
        let more = normal - tangential;
        let matrix = [
            tangential + more * n.x * n.x,
            tangential + more * n.y * n.y,
            tangential + more * n.z * n.z,
            more * n.x * n.y,
            more * n.x * n.z,
            more * n.y * n.z,
        ];
        self.matrix.iter_mut().zip(matrix).for_each(|(sum, entry)| *sum += entry);
        if u != Vec3::zeros() {
            let drive = u * tangential + n * (more * n.dot(&u));
            self.drive += drive;
            self.work += u.dot(&drive);
        }
    }
}

impl Walls {
    /// Resistance of the solids at `x` in a substep of `dt` [s], before it is normalised.
    pub(in crate::sim::liquid) fn drag(&self, x: Vec3, dt: f32, kernel: &ViscousKernel) -> WallDrag {
        let mut out = WallDrag::default();
        let mut add = |d: f32, n: Vec3, mover: Option<usize>, body: Option<&Body>| {
            let half_space = kernel.half_space(d * self.inv_support);
            let u = mover.map_or(Vec3::zeros(), |mover| self.displacement(mover, body, x) / dt);
            out.sum += half_space.sum;
            out.add(n, half_space.normal, half_space.tangential, u);
        };
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                add(d, plane.n, plane.mover, None);
            }
        }
        for body in self.near(x, self.support).map(|body| &self.bodies[body]) {
            if self.body_distance(body, x) < self.support {
                let (d, n) = match &body.density_map {
                    // The distance of the half space with the same density, which edges reduce.
                    Some(map) => {
                        let pose = body.mover.map(|mover| &self.movers[mover].now);
                        let (d, n) = map.contact(pose.map_or(x, |pose| pose.to_local(x)));
                        (d, pose.map_or(n, |pose| pose.rotation * n))
                    }
                    None => self.body_contact(body, x),
                };
                if d < self.support {
                    add(d, n, body.mover, Some(body));
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        sim::liquid::{Kernel, calibration::RestState},
        solid::{Interpolation, Keyframe, Motion, Shape, Solid},
    };

    #[test]
    fn solids_resist_motion_relative_to_their_surfaces() {
        let rest = RestState::new(Kernel::Wendland, 0.1, 2.0);
        let kernel = ViscousKernel::new(&rest);
        let turn = |frame: u32, rotation: f32| Keyframe {
            frame,
            position: [0.0; 3],
            rotation: [0.0, 0.0, rotation],
            quaternion: None,
            scale: 1.0,
        };
        for shape in [
            Shape::Box { min: [-1.0; 3], max: [1.0; 3] },
            Shape::Plane { point: [0.0, 0.0, 1.0], normal: [0.0, 0.0, 1.0] },
        ] {
            // A turn of 1 rad/s about Z: at x = 0.5, the surface moves with 0.5 m/s along y.
            let motion = Motion::new(
                &[turn(0, 0.0), turn(1, 180.0 / std::f32::consts::PI)],
                Interpolation::Linear,
                1.0,
                0,
            );
            let mut walls = Walls::new(&[Solid { motion, ..Solid::fixed(shape) }], &rest);
            walls.move_to(0.01);
            let x = Vec3::new(0.5, 0.0, 1.05);
            let drag = walls.drag(x, 0.01, &kernel);
            let u = Vec3::new(0.0, 0.5, 0.0);
            assert!((drag.times(u) - drag.drive).norm() < 0.02 * drag.drive.norm(), "{drag:?}");
            assert!(drag.drive.y > 0.0 && drag.work > 0.0 && drag.sum > 0.0);
            assert!(drag.times(Vec3::z()).z > drag.times(Vec3::x()).x, "{drag:?}");
            assert_eq!(walls.drag(Vec3::new(0.0, 0.0, 1.21), 0.01, &kernel), WallDrag::default());
        }
    }
}
