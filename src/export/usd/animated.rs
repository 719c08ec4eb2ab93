//! A mesh of constant topology that deforms or moves, as one layer with time samples of all frames.

use super::{
    corner_normals::corner_normals,
    crate_file::{Attribute, CrateFile, Prim, Value},
    geometry::{extent, mesh_constants},
    layer::LayerSettings,
    space::StageSpace,
};
use crate::{
    cache::{WrittenFile, write_atomically},
    math::Vec3,
    mesh::{Mesh, normals_from_faces},
};
use std::{
    io::{self, Write},
    path::Path,
};

/// Positions and rotations of a mesh in consecutive frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Poses {
    /// The frame of the first pose.
    pub(crate) first: u32,
    /// Position [m] and quaternion w, x, y, z.
    pub(crate) poses: Vec<[f32; 7]>,
    /// Sizes over that of the mesh; `None`: it keeps its size.
    pub(crate) scales: Option<Vec<f32>>,
}

/// Positions of the vertices in frames at equal distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PointSamples {
    /// The frame of the first sample.
    pub(crate) first: f64,
    /// Frames between two samples.
    pub(crate) step: f64,
    /// Samples.
    pub(crate) count: usize,
    /// Whether the surface is smooth: each sample has a normal for each vertex, and else one for each corner.
    pub(crate) is_smooth: bool,
}

/// A mesh of constant topology.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AnimatedMesh<'a> {
    /// Group and name of the prim.
    pub(crate) path: (&'a str, &'a str),
    /// Positions at rest [m] and triangles.
    pub(crate) mesh: &'a Mesh,
    /// Motion of the vertices; `None`: they are at rest.
    pub(crate) points: Option<PointSamples>,
    /// Motion of the whole; `None`: it is at rest.
    pub(crate) poses: Option<&'a Poses>,
}

impl AnimatedMesh<'_> {
    /// Writes the layer to `path`, whole or not at all. `sample` gives the positions of the vertices in each sample [m], in order.
    ///
    /// # Errors
    /// Those of the system and of `sample`; if there are too many triangles, or a sample has another number of vertices.
    pub(crate) fn write(
        &self,
        settings: &LayerSettings,
        path: &Path,
        mut sample: impl FnMut(usize) -> io::Result<Vec<Vec3>> + Send,
    ) -> io::Result<WrittenFile> {
        let mut file = CrateFile::new();
        let (group, name) = self.path;
        let fields = settings.fields(&mut file, group, self.frames());
        let mut attributes =
            self.topology(&mut file).ok_or_else(|| io::Error::other("too many triangles"))?;
        match self.points {
            None => {
                let points = settings.space.lengths(&self.mesh.positions);
                expect_finite(&points, || "the mesh".to_owned())?;
                let (points, around) = (file.vectors(&points), file.vectors(&extent(&points, &[])));
                attributes.push(attribute("points", "point3f[]", Some(points), None));
                attributes.push(attribute("extent", "float3[]", Some(around), None));
                let normals = file.vectors(&settings.space.directions(&corner_normals(self.mesh)));
                let interpolation = Some("faceVarying");
                attributes.push(Attribute {
                    interpolation,
                    ..attribute("normals", "normal3f[]", Some(normals), None)
                });
            }
            Some(samples) => attributes.extend(self.deferred(samples, &mut file)),
        }
        attributes.extend(mesh_constants(&mut file));
        if let Some(poses) = self.poses {
            attributes.extend(transforms(poses, settings.space, &mut file));
        }
        let shape = Prim { name: name.into(), type_name: "Mesh", attributes, children: Vec::new() };
        let prim =
            Prim { name: group.into(), type_name: "Scope", attributes: Vec::new(), children: vec![shape] };
        let mut streamed = Streamed {
            space: settings.space,
            mesh: self.mesh,
            samples: self.points.map_or(0, |points| points.count),
            is_smooth: self.points.is_some_and(|points| points.is_smooth),
            extents: Vec::new(),
            normals: Vec::new(),
        };
        write_atomically(path, |mut out| {
            file.write(&fields, &prim, &mut out, |number, out| streamed.fill(number, out, &mut sample))
        })
    }

    /// The first and the last frame that the layer has.
    fn frames(&self) -> Option<(u32, u32)> {
        let points = self.points.filter(|points| points.count > 0).map(|points| {
            // Casts saturate, and frames are whole numbers.
            let last = points.first + points.step * (points.count - 1) as f64;
            (points.first.floor() as u32, last.ceil() as u32)
        });
        let poses = self.poses.filter(|poses| !poses.poses.is_empty());
        let poses =
            poses.map(|poses| (poses.first, poses.first.saturating_add(poses.poses.len() as u32 - 1)));
        points.into_iter().chain(poses).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
    }

    /// Counts and corners of the faces; `None` if there are too many.
    fn topology(&self, file: &mut CrateFile) -> Option<Vec<Attribute>> {
        let triangles = &self.mesh.triangles;
        let corners: Vec<i32> = triangles.as_flattened().iter().map(|&corner| corner as i32).collect();
        let counts = file.integers(vec![3; triangles.len()].into_iter())?;
        let corners = file.integers(corners.into_iter())?;
        Some(vec![
            attribute("faceVertexCounts", "int[]", Some(counts), None),
            attribute("faceVertexIndices", "int[]", Some(corners), None),
        ])
    }

    /// Attributes whose samples are made while the file is written: positions of each sample with its normals, then all extents.
    fn deferred(&self, samples: PointSamples, file: &mut CrateFile) -> Vec<Attribute> {
        let times: Vec<f64> = (0..samples.count).map(|i| samples.first + samples.step * i as f64).collect();
        let times = file.times(&times);
        let vertices = self.mesh.positions.len();
        let (count, interpolation) = match samples.is_smooth {
            true => (vertices, Some("vertex")),
            false => (3 * self.mesh.triangles.len(), Some("faceVarying")),
        };
        let (mut points, mut normals) = (Vec::new(), Vec::new());
        for _ in 0..samples.count {
            points.push(file.deferred_vectors(vertices));
            normals.push(file.deferred_vectors(count));
        }
        let extents: Vec<Value> = (0..samples.count).map(|_| file.deferred_vectors(2)).collect();
        let (points, extents) = (file.samples(times, &points), file.samples(times, &extents));
        let normals = file.samples(times, &normals);
        vec![
            attribute("points", "point3f[]", None, Some(points)),
            attribute("extent", "float3[]", None, Some(extents)),
            Attribute { interpolation, ..attribute("normals", "normal3f[]", None, Some(normals)) },
        ]
    }
}

/// Writes the arrays that are made while a file is written.
struct Streamed<'a> {
    space: StageSpace,
    mesh: &'a Mesh,
    samples: usize,
    is_smooth: bool,
    extents: Vec<[[f32; 3]; 2]>,
    /// Normals of the sample that was written last.
    normals: Vec<[f32; 3]>,
}

impl Streamed<'_> {
    fn fill(
        &mut self,
        number: usize,
        out: &mut dyn Write,
        sample: &mut dyn FnMut(usize) -> io::Result<Vec<Vec3>>,
    ) -> io::Result<()> {
        // Arrays without elements are not written, and so not requested.
        let has_normals = self.is_smooth || !self.mesh.triangles.is_empty();
        let per_sample = 1 + usize::from(has_normals);
        let arrays = if self.mesh.positions.is_empty() { 0 } else { self.samples * per_sample };
        if number >= arrays {
            let empty = extent(&[], &[]);
            let around = self.extents.get(number - arrays).unwrap_or(&empty);
            return write_vectors(around, out);
        }
        if has_normals && number % 2 == 1 {
            return write_vectors(&self.normals, out);
        }
        let positions = sample(number / per_sample)?;
        let (found, expected) = (positions.len(), self.mesh.positions.len());
        if found != expected {
            let why = format!("sample {} has {found} vertices, expected {expected}", number / per_sample);
            return Err(io::Error::new(io::ErrorKind::InvalidData, why));
        }
        let points = self.space.lengths(&positions);
        expect_finite(&points, || format!("sample {}", number / per_sample))?;
        self.extents.push(extent(&points, &[]));
        let triangles = self.mesh.triangles.clone();
        let mesh = Mesh { positions, triangles, ..Mesh::default() };
        let normals = if self.is_smooth { normals_from_faces(&mesh) } else { corner_normals(&mesh) };
        self.normals = self.space.directions(&normals);
        write_vectors(&points, out)
    }
}

/// Refuses points of which one is not finite.
///
/// # Errors
/// [`io::ErrorKind::InvalidData`], with the name of the points.
fn expect_finite(points: &[[f32; 3]], of: impl FnOnce() -> String) -> io::Result<()> {
    let Some(vertex) = points.iter().position(|point| point.iter().any(|c| !c.is_finite())) else {
        return Ok(());
    };
    let why = format!(
        "{}: vertex {vertex} is not at a finite place in units of the stage; use a smaller --scale, or make the file again",
        of()
    );
    Err(io::Error::new(io::ErrorKind::InvalidData, why))
}

fn write_vectors(vectors: &[[f32; 3]], out: &mut dyn Write) -> io::Result<()> {
    let bytes: Vec<u8> = vectors.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    out.write_all(&bytes)
}

fn attribute(
    name: &str,
    type_name: &'static str,
    default: Option<Value>,
    samples: Option<Value>,
) -> Attribute {
    Attribute { name: name.into(), type_name, is_uniform: false, interpolation: None, default, samples }
}

/// The transform of a prim in each frame: a default where it is at rest.
fn transforms(poses: &Poses, space: StageSpace, file: &mut CrateFile) -> Vec<Attribute> {
    let times: Vec<f64> = (0..poses.poses.len()).map(|i| f64::from(poses.first) + i as f64).collect();
    let times = file.times(&times);
    let mut attributes = Vec::new();
    let mut add = |name: &str, type_name, values: Vec<Value>, file: &mut CrateFile| {
        attributes.push(match values[..] {
            [value] => attribute(name, type_name, Some(value), None),
            _ => attribute(name, type_name, None, Some(file.samples(times, &values))),
        });
    };
    let place = |&[x, y, z, ..]: &[f32; 7]| space.position([x, y, z].map(f64::from));
    let places = poses.poses.iter().map(|pose| file.vector(place(pose))).collect();
    add("xformOp:translate", "double3", places, file);
    let turn = |&[_, _, _, w, x, y, z]: &[f32; 7]| space.rotation([w, x, y, z]);
    let turns = poses.poses.iter().map(|pose| file.quaternion(turn(pose))).collect();
    add("xformOp:orient", "quatf", turns, file);
    let mut order = vec!["xformOp:translate", "xformOp:orient"];
    if let Some(scales) = &poses.scales {
        let sizes = scales.iter().map(|&scale| file.single_vector([scale; 3])).collect();
        add("xformOp:scale", "float3", sizes, file);
        order.push("xformOp:scale");
    }
    let order = file.tokens(&order);
    attributes
        .push(Attribute { is_uniform: true, ..attribute("xformOpOrder", "token[]", Some(order), None) });
    attributes
}
