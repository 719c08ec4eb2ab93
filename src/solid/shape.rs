//! The shapes of colliders and sources.

use super::MeshShape;
use serde::{Deserialize, Serialize};

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
