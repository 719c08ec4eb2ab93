//! A shape that a file gives: a sampled distance field, placed and scaled.

use super::{
    Pose,
    deformation::{Deformation, KeyTime},
};
use crate::{
    math::{Vec3, rotation::from_euler_angles},
    sdf::Sampled,
};
use nalgebra::Matrix3;
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
    /// parts may overlap; a part thinner than a voxel only repels. A collider may deform: "walk/####.obj" is a file for each
    /// frame of that number, with the same faces in all.
    pub file: String,
    /// A PC2 point cache with the positions of the file's vertices over time, as Blender's Mesh Cache modifier reads it: the
    /// collider deforms. Frames are those of its header. Between its samples vertices move at constant velocity; before the first and
    /// after the last they are at rest. Friction of liquids takes the motion along the surface's normal alone.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub point_cache: Option<String>,
    /// Factor from the file's unit to metres: 0.001 for millimetres. Range: above 0.
    #[serde(default = "one")]
    pub scale: f32,
    /// The file's axis that points up, where the world has z.
    #[serde(default, skip_serializing_if = "is_z")]
    pub up: Axis,
    /// Then, with `up` as the world has it, turned about the world's X, then Y, then Z axis [deg] (Euler XYZ, as Blender).
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
    /// The motion of its vertices, once it is there.
    #[serde(skip)]
    deformation: Option<Arc<Deformation>>,
}

/// A field with its place in the world.
#[derive(Debug, PartialEq)]
struct Placed {
    field: Arc<Sampled>,
    /// A second field, and its part of the distance.
    next: Option<(Arc<Sampled>, f32)>,
    pose: Pose,
    scale: f32,
}

/// The axis of a file that points up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Axis {
    /// As in Meniscus, Blender and 3ds Max.
    #[default]
    Z,
    /// As in Maya, Houdini and most OBJ files: the file's y becomes z, its z becomes −y.
    Y,
}

fn is_z(up: &Axis) -> bool {
    *up == Axis::Z
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
            point_cache: None,
            scale: one(),
            up: Axis::Z,
            rotate: [0.0; 3],
            translate: [0.0; 3],
            resolution: resolution(),
            field: None,
            deformation: None,
        }
    }

    /// Gives the shape the distances of its mesh, in the file's units. Such a mesh keeps its form, whatever `point_cache` names: motion is
    /// read from presets.
    pub fn fill(&mut self, field: Arc<Sampled>) {
        self.place_fields(field, None);
    }

    /// Gives the shape the distances of its mesh at time 0 and its motion.
    pub(crate) fn fill_deforming(&mut self, deformation: Arc<Deformation>) {
        self.deformation = Some(deformation);
        *self = self.at(0.0).expect("it deforms");
    }

    fn place_fields(&mut self, field: Arc<Sampled>, next: Option<(Arc<Sampled>, f32)>) {
        self.field = Some(Arc::new(Placed { field, next, pose: self.pose(), scale: self.scale }));
    }

    /// Whether it names files with the motion of its vertices.
    #[cfg(feature = "presets")]
    pub(crate) fn names_motion(&self) -> bool {
        self.point_cache.is_some() || self.is_sequence()
    }

    /// Whether `file` stands for the files of a sequence.
    pub(crate) fn is_sequence(&self) -> bool {
        self.file.contains('#')
    }

    /// The names of its files.
    pub(crate) fn files(&self) -> impl Iterator<Item = &str> {
        [self.file.as_str()].into_iter().chain(self.point_cache.as_deref())
    }

    /// The motion of its vertices, if it has some.
    pub(crate) fn deformation(&self) -> Option<&Deformation> {
        self.deformation.as_deref()
    }

    /// The shape at `time` [s]; `None` if it does not deform.
    pub(crate) fn at(&self, time: f64) -> Option<Self> {
        let deformation = self.deformation.as_ref()?;
        let at @ KeyTime { keys, .. } = deformation.key_time(time);
        Some(self.interpolated(keys.map(|key| deformation.field(key)), at))
    }

    /// Largest speed of its vertices between two times [m/s].
    pub(crate) fn fastest(&self, from: f64, to: f64) -> f64 {
        self.deformation().map_or(0.0, |deformation| f64::from(self.scale) * deformation.fastest(from, to))
    }

    /// The shape at a key of its motion; `None` if it does not deform.
    pub(crate) fn at_key(&self, key: usize) -> Option<Self> {
        let field = self.deformation.as_ref()?.field(key);
        let mut shape = self.clone();
        shape.place_fields(field, None);
        Some(shape)
    }

    /// The shape with the distances of two keys, interpolated.
    pub(crate) fn interpolated(
        &self,
        [from, to]: [Arc<Sampled>; 2],
        KeyTime { keys, part }: KeyTime,
    ) -> Self {
        let mut shape = self.clone();
        let next = (keys[0] != keys[1] && part > 0.0).then_some((to, part));
        shape.place_fields(from, next);
        shape
    }

    /// The shape `scale` times as large, about its own origin.
    pub(super) fn scaled(&self, scale: f32) -> Self {
        let mut shape =
            Self { scale: self.scale * scale, translate: self.translate.map(|c| c * scale), ..self.clone() };
        if let Some(placed) = &self.field {
            shape.place_fields(placed.field.clone(), placed.next.clone());
        }
        shape
    }

    /// The distances, in the file's units and axes, to be shared.
    pub(crate) fn field(&self) -> Arc<Sampled> {
        self.placed().field.clone()
    }

    /// Rotation and translation of the file's mesh, after its scale.
    pub(super) fn pose(&self) -> Pose {
        let angles = self.rotate.map(|angle| f64::from(angle).to_radians());
        let rotation = from_euler_angles(angles.into()).to_rotation_matrix().matrix().cast();
        let rotation = match self.up {
            Axis::Z => rotation,
            // Columns: where the file's x, y and z go.
            Axis::Y => rotation * Matrix3::from_columns(&[Vec3::x(), Vec3::z(), -Vec3::y()]),
        };
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

    /// The distances of one time or of two, and the part of each, in the file's units and axes.
    pub(super) fn fields(&self) -> impl Iterator<Item = (&Sampled, f32)> {
        let Placed { field, next, .. } = self.placed();
        let part = next.as_ref().map_or(0.0, |(_, part)| *part);
        [(field.as_ref(), 1.0 - part)]
            .into_iter()
            .chain(next.as_ref().map(|(next, part)| (next.as_ref(), *part)))
    }

    /// Distance and unit normal at `x`, as [`Sampled::sample`] has them.
    #[inline]
    pub fn contact(&self, x: Vec3) -> (f32, Vec3) {
        let Placed { field, next, pose, scale } = self.placed();
        let local = pose.to_local(x) / *scale;
        let (mut d, mut n) = field.sample(local);
        if let Some((next, part)) = next {
            let (d_next, n_next) = next.sample(local);
            d += (d_next - d) * part;
            n = (n + (n_next - n) * *part).try_normalize(1e-6).unwrap_or(n_next);
        }
        (d * scale, pose.rotation * n)
    }

    /// Distance at `x`, a lower bound off the grid.
    #[inline]
    pub(super) fn distance(&self, x: Vec3) -> f32 {
        let Placed { field, next, pose, scale } = self.placed();
        let local = pose.to_local(x) / *scale;
        let d = field.distance(local);
        scale * next.as_ref().map_or(d, |(next, part)| d + (next.distance(local) - d) * part)
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

    /// Radius of a ball about `center` that contains the mesh [m], at most one and a half diagonals of a voxel too large; of one
    /// that deforms, the radius to the corners of its bounds.
    pub(super) fn radius_about(&self, center: Vec3) -> f32 {
        let to_corners = self.corners().iter().map(|corner| (corner - center).norm()).fold(0.0, f32::max);
        if self.deformation().is_some() {
            return to_corners;
        }
        let Placed { field, pose, scale, .. } = self.placed();
        // Every point of the surface has a node within half a voxel's diagonal, whose distance is no larger. Where parts overlap distances
        // are swept, and up to a third of a voxel too large: the other half.
        let diagonal = 3.0_f32.sqrt() * field.voxel;
        let center = pose.to_local(center) / *scale;
        let near = (0..field.values.len()).filter(|&i| field.values[i] <= diagonal / 2.0);
        let farthest = near.map(|i| (field.node(i) - center).norm()).fold(0.0, f32::max);
        ((farthest + diagonal) * scale).min(to_corners)
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

    /// The corners of the box around the field's grid, in the world [m]; of a mesh that deforms, around the mesh at all times.
    pub(super) fn corners(&self) -> [Vec3; 8] {
        let Placed { field, pose, scale, .. } = self.placed();
        let (low, high) = match self.deformation() {
            Some(deformation) => deformation.bounds(),
            None => (field.origin, field.end()),
        };
        std::array::from_fn(|i| {
            pose.to_world(
                Vec3::from_fn(|axis, _| if i >> axis & 1 == 1 { high[axis] } else { low[axis] }) * *scale,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_with_y_up_stand_upright_before_they_are_turned() {
        let mut mesh = MeshShape::new("made here");
        mesh.up = Axis::Y;
        let [right, up, near] = [Vec3::x(), Vec3::y(), Vec3::z()];
        let placed = |mesh: &MeshShape| mesh.place(&[right, up, near]);
        // What faces the viewer in a file with y up has the world's −y.
        let expected = [Vec3::x(), Vec3::z(), -Vec3::y()];
        assert!(placed(&mesh).iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-6));
        mesh.rotate = [0.0, 0.0, 90.0];
        let expected = [Vec3::y(), Vec3::z(), Vec3::x()];
        assert!(placed(&mesh).iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-6));
    }
}
