//! Meshes and points of PLY files as this program writes them: every column of the vertices, and triangles.

use super::{ImportError, ply::COLORS};
use crate::{
    frame::{COLOR, Channel, ChannelData},
    math::{Vec3, srgb},
};
use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{DefaultElement, ElementDef, Encoding, PropertyType, ScalarType},
};
use std::path::Path;

/// Mesh or points of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Geometry {
    /// Positions [m].
    pub(crate) positions: Vec<Vec3>,
    /// Whether positions were in double precision and were rounded.
    pub(crate) is_rounded: bool,
    /// Normals of the vertices, if the file has any.
    pub(crate) normals: Option<Vec<Vec3>>,
    /// Triangles, if the file is a mesh.
    pub(crate) triangles: Option<Vec<[u32; 3]>>,
    /// All other columns: three whose names end in those of a vector's components are one.
    pub(crate) attributes: Vec<Channel>,
}

/// The longest header of a file [bytes].
pub(crate) const MAX_GEOMETRY_HEADER: usize = 1 << 16;

/// The largest number of columns: names of attributes are compared with each other.
const MAX_COLUMNS: usize = 256;

/// Bytes of a triangle: the number of corners, and their vertices.
const TRIANGLE_BYTES: usize = 13;

/// The geometry that a PLY file's bytes hold; errors name `path`.
///
/// # Errors
/// [`ImportError`] if it is no binary little endian PLY with vertices, and triangles if any.
pub(crate) fn parse_geometry(path: &Path, bytes: &[u8]) -> Result<Geometry, ImportError> {
    let layout = Layout::read(path, bytes)?;
    let Layout { stride, vertices, .. } = layout;
    let payload = &bytes[layout.start..];
    let split = vertices.checked_mul(stride).and_then(|length| payload.split_at_checked(length));
    let Some((rows, rest)) = split else {
        let found = format!("{} bytes", payload.len());
        let expected = format!("{stride} for each of {vertices} vertices");
        return Err(ImportError::malformed(path, "element vertex", found, expected));
    };
    let mut geometry = layout.geometry(rows);
    match layout.faces {
        Some(faces) => geometry.triangles = Some(triangles(path, rest, faces, vertices)?),
        None if !rest.is_empty() => {
            let found = format!("{} bytes after them", rest.len());
            return Err(ImportError::malformed(path, "element vertex", found, "the end of the file"));
        }
        None => {}
    }
    Ok(geometry)
}

/// The columns of a PLY file whose first bytes these are, without values.
///
/// # Errors
/// As [`parse_geometry`].
pub(crate) fn parse_geometry_header(path: &Path, bytes: &[u8]) -> Result<Geometry, ImportError> {
    let layout = Layout::read(path, bytes)?;
    let mut geometry = layout.geometry(&[]);
    geometry.triangles = layout.faces.map(|_| Vec::new());
    Ok(geometry)
}

/// A column of the vertices.
#[derive(Clone, Debug)]
struct Column {
    name: String,
    kind: ScalarType,
    /// Place of the value in a row [bytes].
    offset: usize,
}

/// What the header of a file has.
struct Layout {
    columns: Vec<Column>,
    /// Bytes of a row.
    stride: usize,
    vertices: usize,
    faces: Option<usize>,
    /// The first byte after the header.
    start: usize,
}

impl Layout {
    fn read(path: &Path, bytes: &[u8]) -> Result<Self, ImportError> {
        let malformed = |place: &str, found: String, expected: &str| {
            Err(ImportError::malformed(path, place.to_owned(), found, expected))
        };
        let first = &bytes[..bytes.len().min(MAX_GEOMETRY_HEADER)];
        let mut reader = Reader::new(first);
        let header = match Parser::<DefaultElement>::new().read_header(&mut reader) {
            Ok(header) => header,
            Err(error) if bytes.len() > MAX_GEOMETRY_HEADER => {
                let found = error.to_string().replace('\n', " ");
                return malformed("header", found, "a PLY header in the first 64 KiB");
            }
            Err(error) => return malformed("header", error.to_string().replace('\n', " "), "a PLY header"),
        };
        if header.encoding != Encoding::BinaryLittleEndian {
            return malformed("header", format!("{:?}", header.encoding), "binary little endian");
        }
        let elements: Vec<(&String, &ElementDef)> = header.elements.iter().collect();
        let (vertex, face) = match elements[..] {
            [(vertex, columns)] if vertex == "vertex" => (columns, None),
            [(vertex, columns), (face, faces)] if vertex == "vertex" && face == "face" => {
                (columns, Some(faces))
            }
            _ => {
                let found = format!("{} elements", elements.len());
                return malformed("header", found, "vertex, and face if any");
            }
        };
        if let Some(face) = face {
            let is_corners =
                |kind: &PropertyType| matches!(kind, PropertyType::List(ScalarType::UChar, ScalarType::UInt));
            let lists = face.properties.iter().filter(|(_, property)| is_corners(&property.data_type));
            if face.properties.len() != 1 || lists.count() != 1 {
                return malformed("element face", "other properties".to_owned(), "the list vertex_indices");
            }
        }
        if vertex.properties.len() > MAX_COLUMNS {
            let found = format!("{} properties", vertex.properties.len());
            return malformed("element vertex", found, "256 at most");
        }
        let (mut columns, mut stride) = (Vec::new(), 0);
        for (name, property) in &vertex.properties {
            let (kind, size) = match &property.data_type {
                PropertyType::Scalar(kind @ ScalarType::UChar) if COLORS.contains(&name.as_str()) => {
                    (kind, 1)
                }
                PropertyType::Scalar(kind @ (ScalarType::UInt | ScalarType::Float)) => (kind, 4),
                PropertyType::Scalar(kind @ ScalarType::Double)
                    if ["x", "y", "z"].contains(&name.as_str()) =>
                {
                    (kind, 8)
                }
                other => {
                    let found = format!("the property {} of type {other:?}", name.escape_debug());
                    return malformed(
                        "element vertex",
                        found,
                        "float or uint; x, y and z also double; red, green and blue uchar",
                    );
                }
            };
            columns.push(Column { name: name.clone(), kind: kind.clone(), offset: stride });
            stride += size;
        }
        if !(0..columns.len()).any(|place| matches!(vector(&columns[place..]), Some(Vector::Position))) {
            let found = format!("{} properties", columns.len());
            return malformed("element vertex", found, "x, y and z, one after the other, of one type");
        }
        let start = first.len() - reader.get_ref().len();
        Ok(Self { columns, stride, vertices: vertex.count, faces: face.map(|face| face.count), start })
    }

    /// The columns of rows, without triangles.
    fn geometry(&self, rows: &[u8]) -> Geometry {
        let mut geometry = Geometry::default();
        let mut columns = self.columns.as_slice();
        while let [first, others @ ..] = columns {
            let group = vector(columns);
            columns = if group.is_some() { &columns[3..] } else { others };
            geometry.add(first, group, rows, self.stride);
        }
        geometry
    }
}

/// What three columns are the components of.
enum Vector {
    Position,
    Normal,
    /// An attribute of this name.
    Attribute(String),
}

/// The vector whose components are the first three columns; `None` if they are none.
fn vector(columns: &[Column]) -> Option<Vector> {
    let [x, y, z, ..] = columns else { return None };
    let names = [x, y, z].map(|column| column.name.as_str());
    if [y, z].iter().any(|column| column.kind != x.kind) {
        return None;
    }
    if x.kind == ScalarType::UChar {
        return (names == COLORS).then(|| Vector::Attribute(COLOR.to_owned()));
    }
    let vector = match names {
        ["x", "y", "z"] => Vector::Position,
        ["nx", "ny", "nz"] => Vector::Normal,
        ["vx", "vy", "vz"] => Vector::Attribute("velocity".to_owned()),
        [x, y, z] => {
            let name = x.strip_suffix("_x")?;
            let is_one = y.strip_suffix("_y") == Some(name) && z.strip_suffix("_z") == Some(name);
            Vector::Attribute(is_one.then_some(name)?.to_owned())
        }
    };
    matches!(x.kind, ScalarType::Float | ScalarType::Double).then_some(vector)
}

impl Geometry {
    /// Adds the first columns of `rows`: the three of a vector, or one.
    fn add(&mut self, first: &Column, vector: Option<Vector>, rows: &[u8], stride: usize) {
        let is_double = first.kind == ScalarType::Double;
        let number = |row: &[u8], offset: usize| match is_double {
            true => f64::from_le_bytes(bytes_at(row, offset)) as f32,
            false => f32::from_le_bytes(bytes_at(row, offset)),
        };
        let rows = rows.chunks_exact(stride);
        let Some(vector) = vector else {
            let data = match first.kind {
                ScalarType::Float | ScalarType::Double => {
                    ChannelData::F32(rows.map(|row| number(row, first.offset)).collect())
                }
                ScalarType::UChar => ChannelData::U32(rows.map(|row| u32::from(row[first.offset])).collect()),
                _ => ChannelData::U32(
                    rows.map(|row| u32::from_le_bytes(bytes_at(row, first.offset))).collect(),
                ),
            };
            self.attributes.push(Channel { name: first.name.clone(), data });
            return;
        };
        let values: Vec<Vec3> = if first.kind == ScalarType::UChar {
            let light = srgb::linear_of_bytes();
            rows.map(|row| Vec3::from_fn(|part, _| light[usize::from(row[first.offset + part])])).collect()
        } else {
            let size = if is_double { 8 } else { 4 };
            rows.map(|row| Vec3::from_fn(|axis, _| number(row, first.offset + axis * size))).collect()
        };
        match vector {
            Vector::Position => {
                self.is_rounded = is_double;
                self.positions = values;
            }
            Vector::Normal => self.normals = Some(values),
            Vector::Attribute(name) => {
                self.attributes.push(Channel { name, data: ChannelData::Vec3(values) });
            }
        }
    }
}

fn bytes_at<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
    std::array::from_fn(|byte| row[offset + byte])
}

/// Reads triangles.
fn triangles(path: &Path, bytes: &[u8], faces: usize, vertices: usize) -> Result<Vec<[u32; 3]>, ImportError> {
    if faces.checked_mul(TRIANGLE_BYTES) != Some(bytes.len()) {
        let found = format!("{} bytes", bytes.len());
        let expected = format!("{TRIANGLE_BYTES} for each of {faces} triangles");
        return Err(ImportError::malformed(path, "element face", found, expected));
    }
    let mut triangles = Vec::with_capacity(faces);
    for (number, row) in bytes.chunks_exact(TRIANGLE_BYTES).enumerate() {
        let corners = [1, 5, 9].map(|offset| u32::from_le_bytes(bytes_at(row, offset)));
        if row[0] != 3 || corners.iter().any(|&corner| corner as usize >= vertices) {
            let found = format!("{} corners {corners:?}", row[0]);
            let expected = format!("3 corners below {vertices}");
            return Err(ImportError::malformed(
                path,
                format!("element face, entry {number}"),
                found,
                expected,
            ));
        }
        triangles.push(corners);
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        export::ply,
        mesh::{Mesh, Points},
    };

    fn mesh() -> Mesh {
        let positions = vec![Vec3::new(0.5, -1.0, 2.0), Vec3::x(), Vec3::y()];
        let channel = |name: &str, data: ChannelData| Channel { name: name.into(), data };
        Mesh {
            normals: vec![Vec3::z(); 3],
            triangles: vec![[0, 1, 2], [2, 1, 0]],
            attributes: vec![
                channel("velocity", ChannelData::Vec3(positions.clone())),
                channel("vorticity", ChannelData::Vec3(positions.clone())),
                channel("odd_x", ChannelData::F32(vec![1.0, f32::NAN, 3.0])),
                channel("source", ChannelData::U32(vec![0, 7, u32::MAX])),
                channel("color", ChannelData::Vec3(vec![Vec3::x(), Vec3::repeat(1.0), Vec3::zeros()])),
            ],
            positions,
            ..Mesh::default()
        }
    }

    fn written<T, E: std::fmt::Debug>(write: impl FnOnce(&Path) -> Result<T, E>) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        write(&path).unwrap();
        std::fs::read(&path).unwrap()
    }

    fn parse(bytes: &[u8]) -> Result<Geometry, ImportError> {
        parse_geometry(Path::new("a.ply"), bytes)
    }

    #[test]
    fn what_was_written_is_read() {
        let mesh = mesh();
        let bytes = written(|path| ply::write(&mesh, path, &[]));
        let read = parse(&bytes).unwrap();
        assert_eq!((&read.positions, read.normals.as_ref()), (&mesh.positions, Some(&mesh.normals)));
        assert_eq!(read.triangles.as_ref(), Some(&mesh.triangles));
        assert!(!read.is_rounded && format!("{:?}", read.attributes) == format!("{:?}", mesh.attributes));
        let header = parse_geometry_header(Path::new("a.ply"), &bytes[..600]).unwrap();
        assert!(header.triangles.is_some() && header.normals.is_some() && header.positions.is_empty());
        let names = |geometry: &Geometry| {
            geometry.attributes.iter().map(|channel| channel.name.clone()).collect::<Vec<_>>()
        };
        assert_eq!(names(&header), names(&read));
    }

    #[test]
    fn points_have_no_triangles_and_doubles_are_rounded() {
        let mesh = mesh();
        let points =
            Points { positions: mesh.positions.clone(), radii: vec![0.1, 0.2, 0.3], ..Points::default() };
        let read = parse(&written(|path| ply::write_points(&points, path, 7))).unwrap();
        assert_eq!((read.triangles, read.normals), (None, None));
        assert_eq!(
            read.attributes,
            [Channel { name: "radius".into(), data: ChannelData::F32(points.radii) }]
        );
        let far = Mesh { origin: nalgebra::Vector3::new(1e6, 0.0, 0.0), ..mesh };
        let read = parse(&written(|path| ply::write(&far, path, &[]))).unwrap();
        assert!(read.is_rounded && read.positions[1].x == 1_000_001.0 && read.attributes.len() == 5);
    }

    #[test]
    fn attributes_named_like_positions_and_normals_stay_attributes() {
        let mesh = mesh();
        let places: Vec<Vec3> = mesh.positions.iter().map(|x| 2.0 * x).collect();
        let channel = |name: &str| Channel { name: name.into(), data: ChannelData::Vec3(places.clone()) };
        let attributes = vec![channel("position"), channel("normal")];
        let mesh = Mesh { attributes: attributes.clone(), ..mesh };
        let read = parse(&written(|path| ply::write(&mesh, path, &[]))).unwrap();
        assert_eq!((read.positions, read.normals), (mesh.positions, Some(mesh.normals)));
        assert_eq!(read.attributes, attributes);
    }

    #[test]
    fn headers_and_columns_are_bounded() {
        let bytes = written(|path| ply::write(&mesh(), path, &[]));
        let at = bytes.windows(14).position(|part| part == b"element vertex").unwrap();
        let long = [&bytes[..at], &b"comment x\n".repeat(7000), &bytes[at..]].concat();
        let why = parse(&long).unwrap_err().to_string();
        assert!(why.contains("in the first 64 KiB"), "{why}");
        let many = Mesh { attributes: (0..250).map(number).collect(), ..mesh() };
        let read = parse(&written(|path| ply::write(&many, path, &[]))).unwrap();
        assert_eq!(read.attributes.len(), 250);
        let more = Mesh { attributes: (0..251).map(number).collect(), ..mesh() };
        let why = parse(&written(|path| ply::write(&more, path, &[]))).unwrap_err().to_string();
        assert!(why.contains("257 properties") && why.contains("256 at most"), "{why}");
    }

    /// A column of numbers.
    fn number(place: usize) -> Channel {
        Channel { name: format!("a{place}"), data: ChannelData::F32(vec![1.0; 3]) }
    }

    #[test]
    fn other_and_damaged_files_are_refused() {
        let bytes = written(|path| ply::write(&mesh(), path, &[]));
        let text = String::from_utf8_lossy(&bytes).into_owned();
        let start = text.find("end_header\n").unwrap() + 11;
        let head = &text[..start];
        for (from, to) in [
            ("element vertex 3", "element vertex 4"),
            ("element vertex 3", "element vertex 18446744073709551615"),
            ("element face 2", "element face 3"),
            ("float x", "list uchar float x"),
            ("property float y", "property double y"),
            ("property float odd_x", "property int odd_x"),
            ("property uint source", "property int source"),
            ("property uchar blue", "property uint blue"),
            ("property uchar blue", "property uchar other"),
            ("uchar uint", "uchar int"),
            ("binary_little_endian", "binary_big_endian"),
            ("element face 2", "element edge 2"),
        ] {
            let changed = [head.replacen(from, to, 1).as_bytes(), &bytes[start..]].concat();
            assert!(changed != bytes && parse(&changed).is_err(), "{from} → {to}");
        }
        for (place, byte) in [(26, 4), (25, 9)] {
            let mut damaged = bytes.clone();
            let at = damaged.len() - place;
            damaged[at] = byte;
            let why = parse(&damaged).unwrap_err().to_string();
            assert!(why.contains("corners below 3"), "{why}");
        }
        assert!(parse(&bytes[..bytes.len() - 1]).is_err() && parse(b"ply").is_err() && parse(b"").is_err());
    }
}
