//! Solids that deform or change their size: shape and density map at the end of a substep, and how far the surface moves in it.
//!
//! *Method*: the displacement of a surface along its normal is the decrease of the distance over the substep. How it slides in
//! itself is not known, so friction and viscous drag act against the motion along the normal alone.

use crate::{
    math::Vec3,
    sdf::Sampled,
    sim::liquid::{calibration::RestState, density_map},
    solid::{MeshShape, Motion, Shape, Solid},
};
use std::sync::Arc;

/// Most steps along the normal out of a part that moved over a particle. Each is as long as the distance to the nearest surface.
const MAX_MARCHING_STEPS: usize = 8;

/// A solid whose shape or size changes.
#[derive(Debug)]
pub(super) struct Deforming {
    solid: Solid,
    /// The shape at the start of the substep, in its own axes.
    before: Shape,
    /// Density maps of the keys of a mesh that were used last.
    maps: Vec<(usize, Option<Arc<Sampled>>)>,
}

impl Deforming {
    /// The changing shape of a solid; `None` if it keeps its form.
    pub(super) fn of(solid: &Solid) -> Option<Self> {
        let made = || Self { solid: solid.clone(), before: solid.shape.clone(), maps: Vec::new() };
        solid.is_deforming().then(made)
    }

    /// Replaces `shape`, that of the start of the substep, by the one at `time` [s]. Returns its density map, if it has one.
    pub(super) fn advance(&mut self, shape: &mut Shape, time: f64, rest: &RestState) -> Option<MeshShape> {
        let now = self.solid.shape_at(time).into_owned();
        self.before = std::mem::replace(shape, now);
        self.density_map(time, rest)
    }

    /// Takes `shape` for that of the start of the substep, in which it then does not move.
    pub(super) fn rest(&mut self, shape: &Shape) {
        self.before = shape.clone();
    }

    /// Displacement of the surface near `x` over the substep, along its normal, in its own axes [m].
    #[inline]
    pub(super) fn displacement(&self, shape: &Shape, x: Vec3) -> Vec3 {
        shape.displacement_since(&self.before, x)
    }

    /// Where the path of a particle relative to the surface starts that was at `x` at the start of the substep, in its own axes: as far off
    /// the surface as it was then, on the side on which it was.
    #[inline]
    pub(super) fn swept_start(&self, shape: &Shape, x: Vec3) -> Vec3 {
        let ((d, n), (d_before, n_before)) = (shape.contact(x), self.before.contact(x));
        if d >= 0.0 || d_before <= 0.0 {
            return x + n * (d_before - d);
        }
        // Inside now: the nearest surface may be the one on the other side of a thin part.
        let mut start = x;
        for _ in 0..MAX_MARCHING_STEPS {
            let missing = d_before - shape.signed_distance(start);
            if missing <= 1e-3 * d_before {
                break;
            }
            start += n_before * missing;
        }
        start
    }

    /// Largest size over the present one, or a bound of it.
    pub(super) fn growth(&self) -> f64 {
        let [smallest, largest] = self.solid.scales();
        f64::from(largest / smallest)
    }

    /// The density map of a mesh at a time; `None` of other shapes, and where the size changes, for which it does not hold.
    fn density_map(&mut self, time: f64, rest: &RestState) -> Option<MeshShape> {
        let Shape::Mesh(mesh) = &self.solid.shape else { return None };
        if self.solid.motion.as_ref().is_some_and(Motion::is_scaling) {
            return None;
        }
        let at = mesh.deformation()?.key_time(time);
        let [first, last] = at.keys;
        self.maps.retain(|&(key, _)| (first..=last).contains(&key));
        for key in at.keys {
            if self.maps.iter().all(|&(known, _)| known != key) {
                let mesh = mesh.at_key(key).expect("it deforms");
                self.maps.push((key, density_map::equivalent_distances(&mesh, rest).map(|map| map.field())));
            }
        }
        let map = |key: usize| self.maps.iter().find(|&&(known, _)| known == key)?.1.clone();
        Some(mesh.interpolated([map(first)?, map(last)?], at))
    }
}
