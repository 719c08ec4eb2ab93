//! A shape that a file gives: a sampled distance field, placed and scaled.

use super::Pose;
use crate::{
    math::{Vec3, rotation::from_euler_angles},
    sdf::Sampled,
};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A closed triangle mesh from a PLY or OBJ file.
///
/// The preset names the file; its reader calls [`MeshShape::fill`] before the shape's distance is evaluated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct MeshShape {
    /// The file, .ply or .obj, in the preset's folder or below it: "duck.ply", "meshes/duck.obj". Holes are closed and
    /// parts may overlap; a part thinner than a voxel only repels.
    pub file: String,
    /// Factor from the file's unit to metres. Range: above 0.
    #[serde(default = "one")]
    pub scale: f32,
    /// Then turned about the world's X, then Y, then Z axis [deg] (Euler XYZ, as Blender).
    #[serde(default)]
    pub rotate: [f32; 3],
    /// Then moved [m].
    #[serde(default)]
    pub translate: [f32; 3],
    /// Voxels along the longest side of the mesh. More shows finer detail and costs memory with the cube of it: 8 MB
    /// at 128. A voxel of about half the liquid's spacing is enough. Range: 8 to 1024.
    #[serde(default = "resolution")]
    pub resolution: u32,
    /// The distances, once they are there.
    #[serde(skip)]
    field: Option<Arc<Placed>>,
}

/// A field with its place in the world.
#[derive(Debug, PartialEq)]
struct Placed {
    field: Arc<Sampled>,
    pose: Pose,
    scale: f32,
}

fn one() -> f32 {
    1.0
}

fn resolution() -> u32 {
    128
}

impl MeshShape {
    /// The mesh of a file as it stands there, in metres, sampled with the default resolution.
    pub fn new(file: &str) -> Self {
        Self {
            file: file.to_owned(),
            scale: one(),
            rotate: [0.0; 3],
            translate: [0.0; 3],
            resolution: resolution(),
            field: None,
        }
    }

    /// Gives the shape the distances of its mesh, in the file's units.
    pub fn fill(&mut self, field: Arc<Sampled>) {
        self.field = Some(Arc::new(Placed { field, pose: self.pose(), scale: self.scale }));
    }

    /// Rotation and translation of the file's mesh, after its scale.
    fn pose(&self) -> Pose {
        let angles = self.rotate.map(|angle| f64::from(angle).to_radians());
        let rotation = from_euler_angles(angles.into()).to_rotation_matrix().matrix().cast();
        Pose { position: self.translate.into(), rotation }
    }

    /// Positions of the file's mesh, scaled, rotated and translated [m].
    pub(crate) fn place(&self, positions: &[Vec3]) -> Vec<Vec3> {
        let pose = self.pose();
        positions.iter().map(|x| pose.to_world(x * self.scale)).collect()
    }

    /// # Panics
    /// If the shape was not filled: a fault of the program, not of the preset.
    #[inline]
    fn placed(&self) -> &Placed {
        self.field.as_deref().expect("mesh shapes are sampled before they are queried")
    }

    /// The distances, in the file's units and axes.
    pub fn samples(&self) -> &Sampled {
        &self.placed().field
    }

    /// Distance and unit normal at `x`, as [`Sampled::sample`] has them.
    #[inline]
    pub fn contact(&self, x: Vec3) -> (f32, Vec3) {
        let Placed { field, pose, scale } = self.placed();
        let (d, n) = field.sample(pose.to_local(x) / *scale);
        (d * scale, pose.rotation * n)
    }

    /// Distance at `x`, a lower bound off the grid.
    #[inline]
    pub(super) fn distance(&self, x: Vec3) -> f32 {
        let Placed { field, pose, scale } = self.placed();
        field.distance(pose.to_local(x) / *scale) * scale
    }

    /// The volume of the cells around samples inside [m³]; `None` if it was not filled.
    pub fn volume(&self) -> Option<f64> {
        let Placed { field, scale, .. } = self.field.as_deref()?;
        let inside = field.values.iter().filter(|d| **d < 0.0).count();
        Some(inside as f64 * f64::from(field.voxel * scale).powi(3))
    }

    /// The depth of the deepest sample [m], and no less than half a voxel.
    pub(super) fn inner_radius(&self) -> f32 {
        let Placed { field, scale, .. } = self.placed();
        field.values.iter().fold(0.5 * field.voxel, |deepest, d| deepest.max(-d)) * scale
    }

    /// Whether `x` lies within the mesh.
    pub fn contains(&self, x: Vec3) -> bool {
        self.distance(x) < 0.0
    }

    /// The lowest and highest corner of a box in the world that the mesh lies in [m].
    pub fn bounds(&self) -> (Vec3, Vec3) {
        let [first, rest @ ..] = self.corners();
        rest.iter().fold((first, first), |(low, high), x| (low.inf(x), high.sup(x)))
    }

    /// The corners of the box around the field's grid, in the world [m].
    pub(super) fn corners(&self) -> [Vec3; 8] {
        let Placed { field, pose, scale } = self.placed();
        let (low, high) = (field.origin, field.end());
        std::array::from_fn(|i| {
            pose.to_world(
                Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { high[axis] } else { low[axis] }) * *scale,
            )
        })
    }
}
