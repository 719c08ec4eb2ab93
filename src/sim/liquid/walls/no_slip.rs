//! Viscous resistance of solids: the liquid sticks to their surfaces.
//!
//! *Method*: the viscous operator integrated over the solid behind its nearest point, as if that were a half space
//! (`viscous_kernel.rs`). It depends on the particle's own velocity alone, so it adds to the diagonal of the system.
//!
//! Limits: bodies are taken as flat; several solids add up, so corners resist up to twice as much. There the liquid
//! hardly moves anyway.

use super::{Body, Walls};
use crate::{
    math::Vec3,
    sim::liquid::viscous_kernel::{HalfSpace, ViscousKernel},
};

/// Symmetric matrix of the resistance to a particle's motion: xx, yy, zz, xy, xz, yz.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim::liquid) struct Resistance([f32; 6]);

impl Resistance {
    /// Of a half space with normal `n`.
    fn of_half_space(n: Vec3, HalfSpace { normal, tangential, .. }: &HalfSpace) -> Self {
        let more = normal - tangential;
        Self([
            tangential + more * n.x * n.x,
            tangential + more * n.y * n.y,
            tangential + more * n.z * n.z,
            more * n.x * n.y,
            more * n.x * n.z,
            more * n.y * n.z,
        ])
    }

    /// Matrix times `v`.
    #[inline(always)]
    pub(in crate::sim::liquid) fn times(&self, v: Vec3) -> Vec3 {
        let [xx, yy, zz, xy, xz, yz] = self.0;
        Vec3::new(
            xx * v.x + xy * v.y + xz * v.z,
            xy * v.x + yy * v.y + yz * v.z,
            xz * v.x + yz * v.y + zz * v.z,
        )
    }

    /// Multiplies the resistance.
    pub(in crate::sim::liquid) fn scale(&mut self, factor: f32) {
        self.0.iter_mut().for_each(|entry| *entry *= factor);
    }
}

/// Resistance of the solids to a particle's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in crate::sim::liquid) struct WallDrag {
    resistance: Resistance,
    /// Matrix times the velocity of the surfaces of colliders [m/s].
    pub(in crate::sim::liquid) drive: Vec3,
    /// Velocity of these surfaces times `drive` [m²/s²].
    pub(in crate::sim::liquid) work: f32,
    /// Share of the solids in the sum that normalises the kernel.
    pub(in crate::sim::liquid) sum: f32,
}

impl WallDrag {
    /// Matrix times `v`.
    #[inline(always)]
    pub(in crate::sim::liquid) fn times(&self, v: Vec3) -> Vec3 {
        self.resistance.times(v)
    }

    /// Multiplies the resistance.
    pub(in crate::sim::liquid) fn scale(&mut self, factor: f32) {
        self.resistance.scale(factor);
        self.drive *= factor;
        self.work *= factor;
    }

    /// Adds a half space with normal `n` whose surface moves with `u` [m/s].
    fn add(&mut self, n: Vec3, half_space: &HalfSpace, u: Vec3) {
        let resistance = Resistance::of_half_space(n, half_space);
        self.resistance.0.iter_mut().zip(resistance.0).for_each(|(sum, entry)| *sum += entry);
        self.sum += half_space.sum;
        if u != Vec3::zeros() {
            let more = half_space.normal - half_space.tangential;
            let drive = u * half_space.tangential + n * (more * n.dot(&u));
            self.drive += drive;
            self.work += u.dot(&drive);
        }
    }
}

impl Walls {
    /// Resistance of the solids at `x` in a substep of `dt` [s], before it is normalised. The velocities of rigid bodies are not in it.
    pub(in crate::sim::liquid) fn drag(&self, x: Vec3, dt: f32, kernel: &ViscousKernel) -> WallDrag {
        let mut out = WallDrag::default();
        let mut add = |d: f32, n: Vec3, mover: Option<usize>, body: Option<&Body>| {
            let driven = mover.filter(|&mover| mover < self.keyframed);
            let u = driven.map_or(Vec3::zeros(), |mover| self.displacement(mover, body, x) / dt);
            out.add(n, &kernel.half_space(d * self.inv_support), u);
        };
        for plane in &self.planes {
            let d = plane.n.dot(&x) - plane.offset;
            if d < self.support {
                add(d, plane.n, plane.mover, None);
            }
        }
        for body in self.near(x, self.support).map(|body| &self.bodies[body]) {
            if let Some((d, n)) = self.resisting_contact(body, x) {
                add(d, n, body.mover, Some(body));
            }
        }
        out
    }

    /// Resistance of a rigid body at `x`, before it is normalised; `None`: it is too far away.
    pub(in crate::sim::liquid) fn rigid_resistance(
        &self,
        body: usize,
        x: Vec3,
        kernel: &ViscousKernel,
    ) -> Option<Resistance> {
        let (d, n) = self.resisting_contact(&self.bodies[self.rigid_index(body)], x)?;
        Some(Resistance::of_half_space(n, &kernel.half_space(d * self.inv_support)))
    }

    /// Distance and normal of the half space that stands for a body; `None`: it is too far away.
    fn resisting_contact(&self, body: &Body, x: Vec3) -> Option<(f32, Vec3)> {
        if self.body_distance(body, x) >= self.support {
            return None;
        }
        let (d, n) = match &body.density_map {
            // The distance of the half space with the same density, which edges reduce.
            Some(map) => {
                let pose = body.mover.map(|mover| &self.movers[mover].now);
                let (d, n) = map.contact(pose.map_or(x, |pose| pose.to_local(x)));
                (d, pose.map_or(n, |pose| pose.rotation * n))
            }
            None => self.body_contact(body, x),
        };
        (d < self.support).then_some((d, n))
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
