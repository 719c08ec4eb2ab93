//! The shapes of colliders and sources.

use super::MeshShape;
use crate::math::Vec3;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// A shape about its own origin: the world's, unless the shape moves. Lengths are in metres; no dimension may be zero or
/// negative.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
#[non_exhaustive]
pub enum Shape {
    /// Everything behind a plane: unbounded, so no source.
    Plane {
        /// A point on the plane [m].
        point: [f32; 3],
        /// Direction out of the solid; any length but zero.
        normal: [f32; 3],
    },
    /// A box.
    Box {
        /// Lower corner [m].
        min: [f32; 3],
        /// Upper corner [m], above `min` on every axis.
        max: [f32; 3],
    },
    /// A ball.
    Sphere {
        /// Centre [m].
        center: [f32; 3],
        /// Radius [m]. Range: above 0.
        radius: f32,
    },
    /// A cylinder with round ends.
    Capsule {
        /// One end of the axis [m].
        from: [f32; 3],
        /// The other end [m].
        to: [f32; 3],
        /// Radius [m]. Range: above 0.
        radius: f32,
    },
    /// A ring with a round cross-section.
    Torus {
        /// Centre [m].
        center: [f32; 3],
        /// The axis around which the ring runs; any length but zero.
        axis: [f32; 3],
        /// From the centre to the middle of the tube [m]; the hole's radius is `radius` less `tube`. Range: above 0.
        radius: f32,
        /// Radius of the tube [m], below `radius`. Range: above 0.
        tube: f32,
    },
    /// A ball stretched along the axes; keyframes turn it.
    Ellipsoid {
        /// Centre [m].
        center: [f32; 3],
        /// Half of its length along x, y and z [m], each above zero.
        radii: [f32; 3],
    },
    /// A round plate.
    Disc {
        /// Centre [m].
        center: [f32; 3],
        /// Direction of its axis, and of the flow of an emitter; any length but zero.
        normal: [f32; 3],
        /// Radius [m]. Range: above 0.
        radius: f32,
        /// Length along the axis, half of it to either side of the centre [m]. An emitter may do without, other discs may not.
        /// Range: at least 0.
        #[serde(default)]
        thickness: f32,
    },
    /// A closed container, everything outside of a box: unbounded, so no source.
    Tank {
        /// Lower inner corner [m].
        min: [f32; 3],
        /// Upper inner corner [m], above `min` on every axis.
        max: [f32; 3],
    },
    /// The inside of a triangle mesh from a file.
    Mesh(MeshShape),
}

/// A mesh with samples of the given distance on [-1, 1]³.
#[cfg(test)]
pub(crate) fn sampled_mesh(voxel: f32, distance: impl Fn(Vec3) -> f32) -> Shape {
    let n = (2.0 / voxel) as usize + 1;
    let node = |i: usize| Vec3::new((i % n) as f32, (i / n % n) as f32, (i / n / n) as f32) * voxel;
    let values = (0..n * n * n).map(|i| distance(node(i) - Vec3::repeat(1.0))).collect();
    let mut shape = MeshShape::new("made here");
    shape.fill(std::sync::Arc::new(crate::sdf::Sampled {
        origin: Vec3::repeat(-1.0),
        voxel,
        nodes: [n as u32; 3],
        values,
    }));
    Shape::Mesh(shape)
}

impl Shape {
    /// The shape at `time` [s] since the shot's start: itself, unless it is a mesh that deforms.
    pub fn at(&self, time: f64) -> Cow<'_, Self> {
        match self {
            Self::Mesh(mesh) => {
                mesh.at(time).map_or(Cow::Borrowed(self), |mesh| Cow::Owned(Self::Mesh(mesh)))
            }
            _ => Cow::Borrowed(self),
        }
    }

    /// The shape `scale` times as large, about its own origin. A plane only moves.
    pub fn scaled(&self, scale: f32) -> Self {
        let at = |x: &[f32; 3]| x.map(|c| c * scale);
        match self {
            Self::Plane { point, normal } => Self::Plane { point: at(point), normal: *normal },
            Self::Box { min, max } => Self::Box { min: at(min), max: at(max) },
            Self::Tank { min, max } => Self::Tank { min: at(min), max: at(max) },
            Self::Sphere { center, radius } => Self::Sphere { center: at(center), radius: radius * scale },
            Self::Capsule { from, to, radius } => {
                Self::Capsule { from: at(from), to: at(to), radius: radius * scale }
            }
            Self::Torus { center, axis, radius, tube } => {
                let (radius, tube) = (radius * scale, tube * scale);
                Self::Torus { center: at(center), axis: *axis, radius, tube }
            }
            Self::Ellipsoid { center, radii } => Self::Ellipsoid { center: at(center), radii: at(radii) },
            Self::Disc { center, normal, radius, thickness } => {
                let (radius, thickness) = (radius * scale, thickness * scale);
                Self::Disc { center: at(center), normal: *normal, radius, thickness }
            }
            Self::Mesh(mesh) => Self::Mesh(mesh.scaled(scale)),
        }
    }

    /// Displacement of the surface near `x` since the shape was `before`, along the normal [m]. Both distances are contacts: beyond the grid of a
    /// mesh the lower bounds of [`Self::signed_distance`] differ from them, and what rests would seem to move.
    #[inline]
    pub(crate) fn displacement_since(&self, before: &Self, x: Vec3) -> Vec3 {
        let (d, n) = self.contact(x);
        n * (before.contact(x).0 - d)
    }

    /// Whether it is a mesh whose vertices move, once its files are read.
    pub fn is_deforming(&self) -> bool {
        matches!(self, Self::Mesh(mesh) if mesh.deformation().is_some())
    }

    /// The names of the files that it is read from.
    pub(crate) fn files(&self) -> impl Iterator<Item = &str> {
        let mesh = if let Self::Mesh(mesh) = self { Some(mesh) } else { None };
        mesh.into_iter().flat_map(MeshShape::files)
    }
}
