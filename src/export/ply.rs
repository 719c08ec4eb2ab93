//! Binary little-endian PLY: `docs/formats/mesh.md` has the layout.

use super::{
    ExportError,
    error::{check_columns, check_names, property_names},
    key::key_comment,
};
use crate::{
    cache::{WrittenFile, write_atomically},
    frame::{COLOR, Channel, ChannelData},
    math::{Vec3, srgb},
    mesh::{Mesh, Points},
    par,
};
use ply_rs_bw::{
    ply::{ElementDef, Encoding, Header, Key, PropertyAccess, PropertyDef, PropertyType, ScalarType},
    writer::Writer,
};
use std::{
    io::{self, Write},
    path::Path,
};

/// Elements that a task encodes: below some hundred the hand-over costs, above the cache's size nothing is gained.
const BLOCK: usize = 4096;

/// Elements encoded before they are written, which happens while the next are encoded: enough tasks for many threads, and
/// few megabytes.
const AT_ONCE: usize = 64 * BLOCK;

/// Writes `mesh` to `path`, with `comments` (one line each) in its header, and returns its size and checksum.
///
/// A mesh without vertices gives a file with zero vertices and faces, with normals among its properties
/// and the attributes it names.
///
/// # Errors
/// If the system refuses, if columns have the wrong length, or if two properties would share a name.
pub fn write(mesh: &Mesh, path: &Path, comments: &[String]) -> Result<WrittenFile, ExportError> {
    check_columns(mesh, path)?;
    let columns = columns(mesh);
    let names: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    check_names(&names, path)?;
    write_atomically(path, |out| encode(mesh, &columns, true, comments, out))
        .map_err(|error| ExportError::write(path, error))
}

/// Writes `points` to `path` with a key of what they were made from, and returns its size and checksum: positions, `radius`,
/// attributes, no normals and no faces.
///
/// # Errors
/// As [`write`].
pub fn write_points(points: &Points, path: &Path, key: u64) -> Result<WrittenFile, ExportError> {
    let radius = Channel { name: "radius".into(), data: points.radii.clone().into() };
    let attributes = [radius].into_iter().chain(points.attributes.iter().cloned()).collect();
    let (positions, origin) = (points.positions.clone(), points.origin);
    let mesh = Mesh { positions, origin, attributes, ..Mesh::default() };
    check_columns(&mesh, path)?;
    let mut columns = columns(&mesh);
    columns.retain(|(name, _)| !["nx", "ny", "nz"].contains(&name.as_str()));
    let names: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
    check_names(&names, path)?;
    write_atomically(path, |out| encode(&mesh, &columns, false, &[key_comment(key)], out))
        .map_err(|error| ExportError::write(path, error))
}

/// Writes header, vertices and faces.
fn encode(
    mesh: &Mesh,
    columns: &[(String, Column)],
    with_faces: bool,
    comments: &[String],
    out: &mut (dyn Write + Send),
) -> io::Result<()> {
    let vertex = vertex_definition(mesh, columns);
    let face = face_definition(mesh);
    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header
        .comments
        .push("Meniscus: metres, metres a second, Z up, counter-clockwise seen from outside".into());
    header.comments.extend_from_slice(comments);
    header.elements.insert(vertex.get_key(), vertex.clone());
    if with_faces {
        header.elements.insert(face.get_key(), face.clone());
    }

    let mut head = Vec::new();
    let writer = Writer::<Vertex>::new();
    writer.write_header(&mut head, &header)?;
    out.write_all(&head)?;
    each(mesh.positions.len(), out, |index, block| {
        writer.write_little_endian_element(block, &Vertex { columns, index }, &vertex).map(drop)
    })?;
    let writer = Writer::<Face>::new();
    each(mesh.triangles.len(), out, |index, block| {
        writer.write_little_endian_element(block, &Face { corners: &mesh.triangles[index] }, &face).map(drop)
    })
}

/// Encodes `count` elements by `encode`, many at once, and writes them in their order.
fn each(
    count: usize,
    out: &mut (dyn Write + Send),
    encode: impl Fn(usize, &mut Vec<u8>) -> io::Result<()> + Sync,
) -> io::Result<()> {
    let blocks = |start: usize| {
        par::map_chunks(AT_ONCE.min(count.saturating_sub(start)), BLOCK, |range| {
            let mut block = Vec::new();
            range.into_iter().try_for_each(|index| encode(start + index, &mut block)).map(|()| block)
        })
    };
    let mut encoded = blocks(0);
    for next in (AT_ONCE..count + AT_ONCE).step_by(AT_ONCE) {
        let now = std::mem::take(&mut encoded);
        let write = || now.into_iter().try_for_each(|block| out.write_all(&block?));
        let (written, following) = par::join(write, || blocks(next));
        written?;
        encoded = following;
    }
    Ok(())
}

/// The values of one vertex property.
#[derive(Clone, Copy)]
enum Column<'a> {
    /// Coordinates from an origin [m], in double precision.
    Coordinate(&'a [Vec3], usize, f64),
    Axis(&'a [Vec3], usize),
    /// A component of linear colours, as a byte in sRGB.
    ColorComponent(&'a [Vec3], usize),
    Number(&'a [f32]),
    Integer(&'a [u32]),
}

/// Every vertex property, in the order written.
fn columns(mesh: &Mesh) -> Vec<(String, Column<'_>)> {
    let axes = |names: Vec<String>, values| {
        (0..).zip(names).map(move |(axis, name)| (name, Column::Axis(values, axis)))
    };
    let (coordinates, positions) = (["x", "y", "z"].map(String::from), mesh.positions.as_slice());
    let mut columns: Vec<_> = if mesh.origin == nalgebra::Vector3::zeros() {
        axes(coordinates.into(), positions).collect()
    } else {
        let coordinate = |(axis, name)| (name, Column::Coordinate(positions, axis, mesh.origin[axis]));
        (0..).zip(coordinates).map(coordinate).collect()
    };
    // An empty mesh does not show whether it would have normals; a sequence keeps its columns.
    if !mesh.normals.is_empty() || mesh.positions.is_empty() {
        columns.extend(axes(["nx", "ny", "nz"].map(String::from).into(), mesh.normals.as_slice()));
    }
    for channel in &mesh.attributes {
        let names = property_names(&channel.name, matches!(channel.data, ChannelData::Vec3(_)));
        match &channel.data {
            ChannelData::Vec3(values) if channel.name == COLOR => {
                columns.extend(
                    (0..).zip(names).map(|(part, name)| (name, Column::ColorComponent(values, part))),
                );
            }
            ChannelData::Vec3(values) => columns.extend(axes(names, values)),
            ChannelData::F32(values) => {
                columns.extend(names.into_iter().map(|name| (name, Column::Number(values))))
            }
            ChannelData::U32(values) => {
                columns.extend(names.into_iter().map(|name| (name, Column::Integer(values))))
            }
        }
    }
    columns
}

/// The key by which the writer requests column `index`: a character of that number, which is cheaper to read back than a name.
/// The name itself is only in the header.
fn key(index: usize) -> String {
    char::from_u32(index as u32).expect("a mesh has fewer than 55 296 properties").to_string()
}

/// The number in a [`key`].
fn index_of(key: &str) -> Option<usize> {
    key.chars().next().map(|c| c as usize)
}

fn vertex_definition(mesh: &Mesh, columns: &[(String, Column)]) -> ElementDef {
    let mut element = ElementDef::new("vertex".into());
    element.count = mesh.positions.len();
    for (index, (name, column)) in columns.iter().enumerate() {
        let scalar = match column {
            Column::Coordinate(..) => ScalarType::Double,
            Column::Axis(..) | Column::Number(_) => ScalarType::Float,
            Column::Integer(_) => ScalarType::UInt,
            Column::ColorComponent(..) => ScalarType::UChar,
        };
        element.properties.insert(key(index), PropertyDef::new(name.clone(), PropertyType::Scalar(scalar)));
    }
    element
}

fn face_definition(mesh: &Mesh) -> ElementDef {
    let mut element = ElementDef::new("face".into());
    element.count = mesh.triangles.len();
    let list = PropertyType::List(ScalarType::UChar, ScalarType::UInt);
    element.properties.insert(key(0), PropertyDef::new("vertex_indices".into(), list));
    element
}

/// One vertex with the properties that the writer requests.
struct Vertex<'a> {
    columns: &'a [(String, Column<'a>)],
    index: usize,
}

impl PropertyAccess for Vertex<'_> {
    fn new() -> Self {
        Self { columns: &[], index: 0 }
    }

    #[inline]
    fn get_float(&self, key: &str) -> Option<f32> {
        match self.columns.get(index_of(key)?)?.1 {
            Column::Axis(values, axis) => values.get(self.index).map(|value| value[axis]),
            Column::Number(values) => values.get(self.index).copied(),
            Column::Integer(_) | Column::Coordinate(..) | Column::ColorComponent(..) => None,
        }
    }

    #[inline]
    fn get_uchar(&self, key: &str) -> Option<u8> {
        match self.columns.get(index_of(key)?)?.1 {
            Column::ColorComponent(values, part) => {
                values.get(self.index).map(|value| srgb::to_byte(value[part]))
            }
            _ => None,
        }
    }

    #[inline]
    fn get_double(&self, key: &str) -> Option<f64> {
        match self.columns.get(index_of(key)?)?.1 {
            Column::Coordinate(values, axis, origin) => {
                values.get(self.index).map(|value| f64::from(value[axis]) + origin)
            }
            _ => None,
        }
    }

    #[inline]
    fn get_uint(&self, key: &str) -> Option<u32> {
        match self.columns.get(index_of(key)?)?.1 {
            Column::Integer(values) => values.get(self.index).copied(),
            _ => None,
        }
    }
}

/// One face with the properties that the writer requests.
struct Face<'a> {
    corners: &'a [u32],
}

impl PropertyAccess for Face<'_> {
    fn new() -> Self {
        Self { corners: &[] }
    }

    #[inline]
    fn get_list_uint(&self, _key: &str) -> Option<&[u32]> {
        Some(self.corners)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Channel;
    use ply_rs_bw::{
        parser::Parser,
        ply::{DefaultElement, Property},
    };

    fn mesh() -> Mesh {
        let at = |i: usize| Vec3::new(i as f32 * 0.1, -1.5, 1e-7 * i as f32);
        Mesh {
            origin: nalgebra::Vector3::zeros(),
            positions: (0..5).map(at).collect(),
            triangles: vec![[0, 1, 2], [3, 4, 0]],
            normals: vec![Vec3::new(0.0, 0.6, 0.8); 5],
            attributes: vec![
                Channel {
                    name: "velocity".into(),
                    data: (0..5).map(|i| at(i) * 7.0).collect::<Vec<_>>().into(),
                },
                Channel { name: "age".into(), data: vec![0.25_f32; 5].into() },
                Channel { name: "spin".into(), data: vec![Vec3::new(1.0, 2.0, 3.0); 5].into() },
                Channel { name: "id".into(), data: vec![7, 8, 9, 10, u32::MAX].into() },
            ],
        }
    }

    fn written(mesh: &Mesh) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let written = write(mesh, &path, &[]).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!(written.bytes, bytes.len() as u64);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary stays");
        bytes
    }

    /// The header's lines and where the data begins.
    fn header(bytes: &[u8]) -> (Vec<String>, usize) {
        let mark = b"\nend_header\n";
        let end = bytes.windows(mark.len()).position(|window| window == mark).unwrap();
        let text = std::str::from_utf8(&bytes[..end]).unwrap();
        (
            text.lines().filter(|line| !line.starts_with("comment")).map(String::from).collect(),
            end + mark.len(),
        )
    }

    const VERTEX: [&str; 9] = ["x", "y", "z", "nx", "ny", "nz", "vx", "vy", "vz"];

    #[test]
    fn the_layout_is_the_documented_one() {
        let mesh = mesh();
        let bytes = written(&mesh);
        let (lines, data) = header(&bytes);
        let mut expected =
            vec!["ply".to_owned(), "format binary_little_endian 1.0".into(), "element vertex 5".into()];
        let floats = VERTEX.into_iter().chain(["age", "spin_x", "spin_y", "spin_z"]);
        expected.extend(floats.map(|name| format!("property float {name}")));
        expected.push("property uint id".into());
        expected.push("element face 2".into());
        expected.push("property list uchar uint vertex_indices".into());
        assert_eq!(lines, expected);

        let word = |at: usize| <[u8; 4]>::try_from(&bytes[at..at + 4]).unwrap();
        let float = |row: usize, column: usize| f32::from_le_bytes(word(data + row * 56 + column * 4));
        let velocity = (0..3).map(|axis| float(3, 6 + axis)).collect::<Vec<_>>();
        assert_eq!(velocity, (mesh.positions[3] * 7.0).iter().copied().collect::<Vec<_>>());
        assert_eq!((float(4, 5), float(4, 9), float(4, 11)), (0.8, 0.25, 2.0));
        assert_eq!(u32::from_le_bytes(word(data + 4 * 56 + 52)), u32::MAX);
        let faces = data + 5 * 56;
        assert_eq!(bytes.len(), faces + 2 * 13);
        assert_eq!(bytes[faces + 13], 3);
        assert_eq!([14, 18, 22].map(|at| u32::from_le_bytes(word(faces + at))), [3, 4, 0]);
    }

    #[test]
    fn another_reader_reads_the_same_values() {
        let mesh = mesh();
        let ply = Parser::<DefaultElement>::new().read_ply(&mut written(&mesh).as_slice()).unwrap();
        for (i, vertex) in ply.payload["vertex"].iter().enumerate() {
            for (axis, names) in VERTEX.chunks(3).enumerate() {
                let vector = match axis {
                    0 => mesh.positions[i],
                    1 => mesh.normals[i],
                    _ => mesh.positions[i] * 7.0,
                };
                for (d, name) in names.iter().enumerate() {
                    assert_eq!(vertex[*name], Property::Float(vector[d]), "{name} of vertex {i}");
                }
            }
        }
        for (face, triangle) in ply.payload["face"].iter().zip(&mesh.triangles) {
            assert_eq!(face["vertex_indices"], Property::ListUInt(triangle.to_vec()));
        }
    }

    #[test]
    fn a_large_mesh_is_written_whole_in_blocks() {
        let n = 2 * AT_ONCE as u32 + 1_001;
        let mesh = Mesh {
            positions: (0..n).map(|i| Vec3::new(i as f32, 0.5, -(i as f32))).collect(),
            triangles: (0..n - 2).map(|i| [i, i + 1, i + 2]).collect(),
            ..Mesh::default()
        };
        let bytes = written(&mesh);
        let (lines, data) = header(&bytes);
        assert_eq!(lines.len(), 8, "without normals and velocity there is no column for them: {lines:?}");
        assert_eq!(bytes.len(), data + n as usize * 12 + (n as usize - 2) * 13);
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        assert_eq!(ply.payload["vertex"][n as usize - 1]["z"], Property::Float(1.0 - n as f32));
        assert_eq!(
            ply.payload["face"][n as usize - 3]["vertex_indices"],
            Property::ListUInt(vec![n - 3, n - 2, n - 1])
        );
    }

    #[test]
    fn an_empty_mesh_is_a_valid_file() {
        let empty = Mesh {
            attributes: vec![Channel { name: "velocity".into(), data: Vec::<Vec3>::new().into() }],
            ..Mesh::default()
        };
        let bytes = written(&empty);
        let (lines, data) = header(&bytes);
        assert!(lines.contains(&"element vertex 0".into()) && lines.contains(&"element face 0".into()));
        let floats: Vec<&str> =
            lines.iter().filter_map(|line| line.strip_prefix("property float ")).collect();
        assert_eq!(floats, VERTEX);
        assert_eq!(data, bytes.len());
        let ply = Parser::<DefaultElement>::new().read_ply(&mut bytes.as_slice()).unwrap();
        assert!(ply.payload["vertex"].is_empty() && ply.payload["face"].is_empty());
    }

    #[test]
    fn positions_far_from_the_origin_are_double_precision() {
        let origin = nalgebra::Vector3::new(1e4, -3e5, 0.0);
        let far = Mesh { origin, ..mesh() };
        let ply = Parser::<DefaultElement>::new().read_ply(&mut written(&far).as_slice()).unwrap();
        for (vertex, x) in ply.payload["vertex"].iter().zip(&far.positions) {
            for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
                assert_eq!(vertex[name], Property::Double(f64::from(x[axis]) + origin[axis]));
            }
            assert!(matches!(vertex["nx"], Property::Float(_)));
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        let points = Points {
            positions: vec![Vec3::new(0.25, 2.0, 3.0)],
            origin,
            radii: vec![0.5],
            ..Points::default()
        };
        write_points(&points, &path, 7).unwrap();
        let ply =
            Parser::<DefaultElement>::new().read_ply(&mut std::fs::read(&path).unwrap().as_slice()).unwrap();
        assert_eq!(ply.payload["vertex"][0]["x"], Property::Double(10_000.25));
    }

    #[test]
    fn points_have_radii_and_no_faces() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("points.ply");
        let points = Points {
            origin: nalgebra::Vector3::zeros(),
            positions: vec![Vec3::new(1.0, 2.0, 3.0)],
            radii: vec![0.5],
            attributes: vec![Channel {
                name: "velocity".into(),
                data: vec![Vec3::new(4.0, 5.0, 6.0)].into(),
            }],
        };
        write_points(&points, &path, 7).unwrap();
        let ply =
            Parser::<DefaultElement>::new().read_ply(&mut std::fs::read(&path).unwrap().as_slice()).unwrap();
        let names = ["x", "y", "z", "radius", "vx", "vy", "vz"];
        for (name, value) in names.into_iter().zip([1.0, 2.0, 3.0, 0.5, 4.0, 5.0, 6.0]) {
            assert_eq!(ply.payload["vertex"][0][name], Property::Float(value), "{name}");
        }
        assert!(ply.payload["vertex"][0].len() == 7 && !ply.payload.contains_key("face"));
        let attributes = vec![Channel { name: "velocity".into(), data: Vec::<Vec3>::new().into() }];
        write_points(&Points { attributes, ..Points::default() }, &path, 7).unwrap();
        let (lines, _) = header(&std::fs::read(&path).unwrap());
        let floats: Vec<&str> =
            lines.iter().filter_map(|line| line.strip_prefix("property float ")).collect();
        assert!(floats == names && lines.contains(&"element vertex 0".into()));
    }

    #[test]
    fn errors_name_path_cause_and_next_step_and_leave_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("not_there/a.ply");
        let message = write(&mesh(), &missing, &[]).unwrap_err().to_string();
        assert!(message.contains("not_there/a.ply") && message.contains("create the folder"), "{message}");

        let taken = folder.path().join("taken.ply");
        std::fs::create_dir_all(taken.join("full")).unwrap();
        assert!(matches!(write(&mesh(), &taken, &[]), Err(ExportError::Write { .. })));

        let mut broken = mesh();
        broken.triangles.push([0, 1, 5]);
        let message = write(&broken, &folder.path().join("a.ply"), &[]).unwrap_err().to_string();
        assert!(message.contains("triangle 2 is [0, 1, 5]"), "{message}");

        for name in ["vx", "two words", "", "x\nelement face 9"] {
            let mut clash = mesh();
            clash.attributes[1].name = name.into();
            let error = write(&clash, &folder.path().join("a.ply"), &[]).unwrap_err();
            assert!(matches!(error, ExportError::Mesh { .. }), "{name}: {error}");
        }
        let mut short = mesh();
        short.normals.pop();
        assert!(write(&short, &folder.path().join("a.ply"), &[]).is_err());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "only what was there before");
    }

    #[test]
    fn a_full_disk_is_recognised() {
        let error = |kind: io::ErrorKind| ExportError::write(Path::new("a.ply"), kind.into());
        assert!(error(io::ErrorKind::StorageFull).is_disk_full());
        assert!(error(io::ErrorKind::StorageFull).to_string().contains("free space"));
        assert!(!error(io::ErrorKind::PermissionDenied).is_disk_full());
    }
}
