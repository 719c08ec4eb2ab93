//! The mesh of a sheet in a frame.

use crate::{
    frame::{Channel, ChannelData, Stream},
    mesh::{Mesh, normals_from_faces, shell},
    sim::sheet::{CORNER_CHANNELS, faces_stream},
};

/// Raised whenever a change of what a file holds gives the same sheet another one.
pub(in crate::product) const SHEET_VERSION: u32 = 1;

/// Why nothing is made of a frame.
pub(in crate::product) const MISSING_PARTS: &str =
    "the sheet has no positions or faces, or positions that are not finite; simulate the shot again";

/// The mesh of a sheet, with velocities: its points are in `stream`, its faces in another of `streams`. `None` if a part is
/// missing, or a position is not finite.
pub(in crate::product) fn sheet_mesh(
    stream: &Stream,
    streams: &[Stream],
    thickness: Option<f32>,
) -> Option<Mesh> {
    let name = faces_stream(&stream.name);
    let faces = streams.iter().find(|other| other.name == name)?;
    let corners = CORNER_CHANNELS.map(|corner| faces.u32(corner));
    let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
    let positions = stream.vec3("position")?.to_vec();
    if positions.iter().flatten().any(|c| !c.is_finite()) {
        return None;
    }
    let mut triangles = Vec::with_capacity(2 * faces.len());
    for i in 0..faces.len() {
        triangles.push([a[i], b[i], c[i]]);
        // A triangle names its last corner twice.
        if d[i] != c[i] {
            triangles.push([a[i], c[i], d[i]]);
        }
    }
    if triangles.iter().flatten().any(|&v| v as usize >= positions.len()) {
        return None;
    }
    let velocity =
        Channel { name: "velocity".into(), data: ChannelData::Vec3(stream.vec3("velocity")?.to_vec()) };
    let mut mesh = Mesh { positions, triangles, attributes: vec![velocity], ..Mesh::default() };
    match thickness {
        Some(thickness) => Some(shell(&mesh, thickness)),
        None => {
            mesh.normals = normals_from_faces(&mesh);
            Some(mesh)
        }
    }
}
