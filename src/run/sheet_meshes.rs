//! Sheets as meshes, one a frame.

use super::{
    Control, Failure, RunError, ShotFolder,
    job::{Make, Part, Target},
    ledger::{Made, Piece, Work},
    plan::Product,
    surface::MeshFiles,
};
use crate::{
    export::MeshFormat,
    frame::{Channel, ChannelData, Stream},
    mesh::{Mesh, SurfaceParams, normals_from_faces, thicken},
    sim::sheet::{CORNER_CHANNELS, faces_stream, sheet_of},
};
use xxhash_rust::xxh3::xxh3_64;

/// Raised whenever a change of what a file holds gives the same sheet another one.
pub(super) const SHEET_VERSION: u32 = 1;

/// Makes meshes of sheets.
pub(super) struct SheetMeshes<'a> {
    files: MeshFiles<'a>,
    /// How thick they are [m]; `None`: surfaces.
    thickness: Option<f32>,
    /// Nothing is made into a surface.
    params: SurfaceParams,
}

impl<'a> SheetMeshes<'a> {
    /// Those to be written to `out` in these formats.
    pub(super) fn new(out: &'a ShotFolder, formats: &'a [MeshFormat], thickness: Option<f32>) -> Self {
        let files = MeshFiles { out, folder: "sheet", formats, points: false };
        Self { files, thickness, params: SurfaceParams::default() }
    }
}

impl Make for SheetMeshes<'_> {
    const PRODUCT: Product = Product::Sheets;

    fn params(&self) -> &SurfaceParams {
        &self.params
    }

    fn takes(&self, stream: &str) -> bool {
        sheet_of(stream).is_some()
    }

    fn nothing(&self) -> String {
        NO_SHEETS.into()
    }

    fn key(&self, _: &str, state: u64, _: f32) -> u64 {
        xxh3_64(format!("sheet {SHEET_VERSION} {state:016x} {:?}", self.thickness).as_bytes())
    }

    fn kept(&self, target: &Target) -> Option<Piece> {
        self.files.kept(target)
    }

    fn make(
        &self,
        part: Part<'_>,
        _: f32,
        target: &Target,
        made: &mut Made,
        _: Control,
    ) -> Result<(), RunError> {
        let Some(mesh) = mesh_of(part.stream, part.streams, self.thickness) else {
            made.fail(BROKEN.into(), Failure::Other);
            return Ok(());
        };
        let figures = format!("frame {}  {}  {} triangles", target.index, target.name, mesh.triangles.len());
        let work = Work::on(&mesh, figures, None);
        made.pieces.push(self.files.write(&mesh, None, target, work)?);
        Ok(())
    }
}

/// Why nothing is made of a cache.
pub(super) const NO_SHEETS: &str =
    "no sheets in this cache: `meniscus mesh` makes surfaces of liquids, `meniscus volume` volumes of smoke";

/// Why nothing is made of a frame.
pub(super) const BROKEN: &str = "the sheet lacks its positions or faces; simulate the shot again";

/// A sheet as a mesh, with velocities: its points are in `stream`, its faces in another of `streams`. `None` if it lacks a part.
pub(super) fn mesh_of(stream: &Stream, streams: &[Stream], thickness: Option<f32>) -> Option<Mesh> {
    let name = faces_stream(&stream.name);
    let faces = streams.iter().find(|other| other.name == name)?;
    let corners = CORNER_CHANNELS.map(|corner| faces.u32(corner));
    let [Some(a), Some(b), Some(c), Some(d)] = corners else { return None };
    let positions = stream.vec3("position")?.to_vec();
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
        Some(thickness) => Some(thicken(&mesh, thickness)),
        None => {
            mesh.normals = normals_from_faces(&mesh);
            Some(mesh)
        }
    }
}
