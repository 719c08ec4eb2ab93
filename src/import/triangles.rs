//! Meshes: PLY, ASCII or binary of either byte order, and OBJ.
//!
//! Positions and faces are read. Faces are cut into triangles, or quads are kept on request. Of a PLY file the vertices'
//! `PAINTED` factors can be requested as well. Everything else is passed over.

use super::{
    ImportError,
    ply_numbers::{Fault, Numbers},
    polygons::cut,
};
use crate::{math::Vec3, sdf::Triangles};
use ply_rs_bw::{
    parser::{Parser, Reader},
    ply::{DefaultElement, PropertyType},
};
use std::path::Path;
use xxhash_rust::xxh3::xxh3_64;

/// Parses the mesh of a file's bytes; the extension of `path` determines the format, and errors name it.
///
/// # Errors
/// [`ImportError`], with the line, or the entry, at fault. A mesh has at least one face.
pub(crate) fn parse_triangles(path: &Path, bytes: &[u8]) -> Result<Triangles, ImportError> {
    Ok(parse_faces(path, bytes)?.0)
}

/// As [`parse_triangles`], with what was done to its faces.
///
/// # Errors
/// As [`parse_triangles`].
pub(crate) fn parse_faces(path: &Path, bytes: &[u8]) -> Result<(Triangles, FaceCounts), ImportError> {
    Ok(parse(path, bytes)?.triangles())
}

/// Counts of faces that were no triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct FaceCounts {
    /// Faces of five corners and more.
    pub(crate) polygons: usize,
    /// Faces that their triangles do not cover once: they cross themselves, or have very many corners.
    pub(crate) folded: usize,
    /// Identifies the corners of all faces, whatever triangles became of them.
    pub(crate) digest: u64,
}

impl FaceCounts {
    /// The counts in words, with what becomes of each; empty if there is nothing to report.
    pub(crate) fn report(&self) -> Vec<String> {
        let counted = [
            (self.polygons, "faces of five and more corners, cut into triangles"),
            (
                self.folded,
                "faces that cross themselves or have thousands of corners, whose triangles overlap; triangulate them where the mesh was made",
            ),
        ];
        counted
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect()
    }
}

/// The properties of a PLY's vertices that are factors painted on a sheet.
pub(crate) const PAINTED: [&str; 3] = ["stiffness", "rest", "damping"];

/// The mesh of a sheet.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SheetFaces {
    /// Positions [m].
    pub positions: Vec<Vec3>,
    /// Corners; a triangle names its last twice.
    pub faces: Vec<[u32; 4]>,
    /// What the vertices have of the properties `PAINTED`, in their order; empty if there is none.
    pub painted: [Vec<f32>; 3],
}

/// The mesh that a file's bytes hold, with its quads; faces of more corners are cut into triangles.
///
/// # Errors
/// As `parse_triangles`.
pub fn parse_sheet(path: &Path, bytes: &[u8]) -> Result<SheetFaces, ImportError> {
    let mesh = parse(path, bytes)?;
    let (mut faces, mut triangles) = (Vec::new(), Vec::new());
    for corners in mesh.faces() {
        match *corners {
            [a, b, c, d] => faces.push([a, b, c, d]),
            _ => {
                cut(corners, &mesh.positions, &mut triangles);
                faces.extend(triangles.drain(..).map(|[a, b, c]| [a, b, c, c]));
            }
        }
    }
    Ok(SheetFaces { faces, positions: mesh.positions, painted: mesh.painted })
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Polygons, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::EmptyFile { path: path.to_path_buf() });
    }
    let is = |ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    let mesh = match (is("ply"), is("obj")) {
        (true, _) => ply(path, bytes)?,
        (_, true) => obj(path, bytes)?,
        _ => return Err(ImportError::unsupported(path, "another kind of file", "a mesh in .ply or .obj")),
    };
    if let Some(i) = mesh.positions.iter().position(|x| x.iter().any(|c| !c.is_finite())) {
        let found = format!("{:?}", mesh.positions[i].as_slice());
        return Err(ImportError::malformed(path, format!("vertex {i}"), found, "finite coordinates"));
    }
    if mesh.ends.is_empty() {
        let found = format!("{} vertices and no face", mesh.positions.len());
        return Err(ImportError::malformed(path, "the whole file", found, "a surface of faces"));
    }
    Ok(mesh)
}

/// A mesh as it is in a file.
#[derive(Default)]
struct Polygons {
    positions: Vec<Vec3>,
    /// The corners of all faces, and where those of each end.
    corners: Vec<u32>,
    ends: Vec<usize>,
    painted: [Vec<f32>; 3],
}

impl Polygons {
    /// Adds a face; fails with the index that names no vertex.
    fn add(&mut self, corners: &[i64]) -> Result<(), i64> {
        if let Some(&wrong) = corners.iter().find(|&&c| c < 0 || c >= self.positions.len() as i64) {
            return Err(wrong);
        }
        self.corners.extend(corners.iter().map(|&c| c as u32));
        self.ends.push(self.corners.len());
        Ok(())
    }

    fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let starts = [0].into_iter().chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start..end])
    }

    fn triangles(self) -> (Triangles, FaceCounts) {
        let digest = xxh3_64(bytemuck::cast_slice(&self.corners))
            ^ xxh3_64(bytemuck::cast_slice(&self.ends)).rotate_left(1);
        let mut counts = FaceCounts { digest, ..FaceCounts::default() };
        let mut triangles = Vec::with_capacity(self.corners.len() - 2 * self.ends.len());
        for corners in self.faces() {
            counts.polygons += usize::from(corners.len() > 4);
            counts.folded += usize::from(!cut(corners, &self.positions, &mut triangles));
        }
        (Triangles { positions: self.positions, triangles }, counts)
    }
}

fn obj(path: &Path, bytes: &[u8]) -> Result<Polygons, ImportError> {
    let mut mesh = Polygons::default();
    let mut corners = Vec::new();
    for (number, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        let mut words = line.split_whitespace();
        let read: Result<(), Fault> = match words.next() {
            Some("v") => (|| {
                let mut x = Vec3::zeros();
                for axis in 0..3 {
                    let word = words.next().unwrap_or("the end of the line");
                    x[axis] = word.parse().map_err(|_| (word.to_owned(), "three coordinates"))?;
                }
                mesh.positions.push(x);
                Ok(())
            })(),
            Some("f") => (|| {
                corners.clear();
                for word in words {
                    let index = word.split('/').next().unwrap_or_default();
                    let index: i64 =
                        index.parse().map_err(|_| (word.to_owned(), "the number of a vertex, from 1"))?;
                    // Negative numbers count back from the last vertex so far.
                    corners.push(if index < 0 { mesh.positions.len() as i64 + index } else { index - 1 });
                }
                if corners.len() < 3 {
                    return Err((format!("a face of {} corners", corners.len()), "three or more"));
                }
                mesh.add(&corners)
                    .map_err(|_| (line.trim().to_owned(), "vertices that stand above this line"))
            })(),
            _ => Ok(()),
        };
        read.map_err(|(found, expected)| {
            ImportError::malformed(path, format!("line {}", number + 1), found, expected)
        })?;
    }
    Ok(mesh)
}

fn ply(path: &Path, bytes: &[u8]) -> Result<Polygons, ImportError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<DefaultElement>::new().read_header(&mut reader).map_err(|error| {
        let place = format!("header, line {}", error.line().unwrap_or(reader.line()));
        let found = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
        ImportError::malformed(path, place, found, "a PLY header")
    })?;
    let mut numbers = Numbers { rest: reader.get_ref(), encoding: header.encoding };
    let mut mesh = Polygons::default();
    let mut faces = Vec::new();
    let (mut scalars, mut list) = ([0.0; 3], Vec::new());
    for (name, element) in &header.elements {
        let axes = ["x", "y", "z"];
        if name == "vertex" && axes.iter().any(|axis| !element.properties.contains_key(*axis)) {
            let found = format!("the properties {:?}", element.properties.keys().collect::<Vec<_>>());
            return Err(ImportError::malformed(path, "header, element vertex", found, "x, y and z"));
        }
        // Every entry has a byte at least, so a count beyond the file's size is found before memory is taken for it.
        for entry in 0..element.count {
            let fail = |(found, expected): Fault| {
                ImportError::malformed(path, format!("element {name}, entry {entry}"), found, expected)
            };
            for (property, definition) in &element.properties {
                match &definition.data_type {
                    PropertyType::Scalar(kind) => {
                        let value = numbers.next(kind).map_err(fail)?;
                        if let Some(axis) = axes.iter().position(|axis| axis == property) {
                            scalars[axis] = value;
                        }
                        let paint = PAINTED.iter().position(|painted| painted == property);
                        if let (Some(paint), "vertex") = (paint, name.as_str()) {
                            mesh.painted[paint].push(value as f32);
                        }
                    }
                    PropertyType::List(count, kind) => {
                        let length = numbers.next(count).map_err(fail)?;
                        list.clear();
                        for _ in 0..length as usize {
                            list.push(numbers.next(kind).map_err(fail)? as i64);
                        }
                        if name == "face" && ["vertex_indices", "vertex_index"].contains(&property.as_str()) {
                            if list.len() < 3 {
                                let found = format!("a face of {} corners", list.len());
                                return Err(fail((found, "three or more")));
                            }
                            faces.push((entry, list.clone()));
                        }
                    }
                }
            }
            if element.properties.is_empty() {
                break;
            }
            if name == "vertex" {
                mesh.positions.push(Vec3::from(scalars.map(|c| c as f32)));
            }
        }
    }
    // Faces may stand before the vertices they name.
    for (entry, corners) in faces {
        mesh.add(&corners).map_err(|wrong| {
            let expected = format!("numbers below the {} of vertices", mesh.positions.len());
            ImportError::malformed(
                path,
                format!("element face, entry {entry}"),
                format!("vertex {wrong}"),
                expected,
            )
        })?;
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const FACES: [[u32; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]];

    fn expected() -> Triangles {
        Triangles { positions: CORNERS.map(Vec3::from).to_vec(), triangles: FACES.to_vec() }
    }

    fn read(name: &str, bytes: &[u8]) -> Result<Triangles, ImportError> {
        parse_triangles(Path::new(name), bytes)
    }

    fn header(format: &str) -> String {
        format!(
            "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty uchar red\nproperty float y\n\
             property float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
        )
    }

    fn binary(big: bool) -> Vec<u8> {
        let mut out = header(if big { "binary_big_endian" } else { "binary_little_endian" }).into_bytes();
        let float = |c: f32| if big { c.to_be_bytes() } else { c.to_le_bytes() };
        for [x, y, z] in CORNERS {
            out.extend(float(x));
            out.push(7);
            out.extend(float(y));
            out.extend(float(z));
        }
        for face in FACES {
            out.push(3);
            face.iter().for_each(|&c| out.extend(if big { c.to_be_bytes() } else { c.to_le_bytes() }));
        }
        out
    }

    fn ascii() -> String {
        let mut out = header("ascii");
        CORNERS.iter().for_each(|[x, y, z]| out += &format!("{x} 7 {y} {z}\n"));
        FACES.iter().for_each(|[a, b, c]| out += &format!("3 {a} {b} {c}\n"));
        out
    }

    fn wavefront() -> String {
        let mut out = "# made here\no thing\n".to_owned();
        CORNERS.iter().for_each(|[x, y, z]| out += &format!("v {x} {y} {z}\nvn 0 0 1\n"));
        FACES
            .iter()
            .for_each(|[a, b, c]| out += &format!("f {}//1 {}/2 {}\r\n", a + 1, b + 1, *c as i32 - 4));
        out
    }

    #[test]
    fn every_form_of_a_mesh_reads_the_same() {
        assert_eq!(read("a.ply", &binary(false)).unwrap(), expected());
        assert_eq!(read("a.PLY", &binary(true)).unwrap(), expected());
        assert_eq!(read("a.ply", ascii().as_bytes()).unwrap(), expected());
        assert_eq!(read("a.obj", wavefront().as_bytes()).unwrap(), expected());
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";
        assert_eq!(read("a.obj", square.as_bytes()).unwrap().triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn concave_faces_leave_no_wall_beyond_their_outline() {
        // A prism over the letter L; a fan from the caps' first corner would cover a part of its notch.
        let text = "v 2 0 0\nv 2 1 0\nv 1 1 0\nv 1 2 0\nv 0 2 0\nv 0 0 0\n\
            v 2 0 1\nv 2 1 1\nv 1 1 1\nv 1 2 1\nv 0 2 1\nv 0 0 1\nf 6 5 4 3 2 1\nf 7 8 9 10 11 12\n\
            f 1 2 8 7\nf 2 3 9 8\nf 3 4 10 9\nf 4 5 11 10\nf 5 6 12 11\nf 6 1 7 12\n";
        let (mesh, counts) = parse_faces(Path::new("a.obj"), text.as_bytes()).unwrap();
        assert_eq!((counts.polygons, counts.folded), (2, 0));
        let field = crate::sdf::from_triangles(&mesh, 40).unwrap().field;
        for height in [0.0, 0.5, 1.0] {
            let distance = field.distance(Vec3::new(1.3, 1.3, height));
            assert!((distance - 0.3).abs() < 0.02, "{distance} at {height}");
        }
    }

    #[test]
    fn sheets_keep_their_quads_and_what_is_painted_on_them() {
        let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float damping\nproperty float x\nproperty float y\n\
                    property float z\nproperty float stiffness\nelement face 3\nproperty uchar rest\n\
                    property list uchar int vertex_indices\nend_header\n\
                    3 0 0 0 1\n4 1 0 0 0.5\n5 1 1 0 0\n6 0 1 0 2\n7 2 0 0 1\n9 4 0 1 2 3\n9 3 1 4 2\n9 5 0 1 4 2 3\n";
        let found = parse_sheet(Path::new("a.ply"), text.as_bytes()).unwrap();
        assert_eq!(found.faces, [[0, 1, 2, 3], [1, 4, 2, 2], [0, 1, 4, 4], [0, 4, 2, 2], [0, 2, 3, 3]]);
        // What faces have under such a name is not painted on points.
        let painted = [vec![1.0, 0.5, 0.0, 2.0, 1.0], vec![], vec![3.0, 4.0, 5.0, 6.0, 7.0]];
        assert_eq!((found.painted, found.positions.len()), (painted, 5));
        assert_eq!(
            parse_sheet(Path::new("a.ply"), text.replace("damping", "rest").as_bytes()).unwrap().painted[1]
                [4],
            7.0
        );
        let plain =
            parse_sheet(Path::new("a.obj"), b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
        assert_eq!((plain.faces, plain.painted), (vec![[0, 1, 2, 3]], Default::default()));
    }

    #[test]
    fn faults_are_named_with_their_place() {
        let cases: [(&str, Vec<u8>, &[&str]); 12] = [
            ("a.obj", b"v 0 0 0\nv 1 x 0\n".to_vec(), &["line 2", "found x", "three coordinates"]),
            ("a.obj", b"v 0 0\n".to_vec(), &["line 1", "end of the line"]),
            ("a.obj", b"v 0 0 0\nf 1 1 2\n".to_vec(), &["line 2", "f 1 1 2", "above this line"]),
            ("a.obj", b"v 0 0 0\nf 1 0 1\n".to_vec(), &["line 2"]),
            ("a.obj", b"v 0 0 0\nf 1 1\n".to_vec(), &["line 2", "a face of 2 corners"]),
            ("a.obj", b"v 0 0 0\n".to_vec(), &["1 vertices and no face"]),
            ("a.obj", b"v 0 nan 0\nf 1 1 1\n".to_vec(), &["vertex 0", "NaN", "finite"]),
            ("a.ply", b"solid ascii".to_vec(), &["header", "a PLY header"]),
            (
                "a.ply",
                binary(false)[..binary(false).len() - 3].to_vec(),
                &["element face, entry 3", "end of"],
            ),
            (
                "a.ply",
                ascii().replace("3 0 3 2", "3 0 3 9").into_bytes(),
                &["entry 3", "vertex 9", "of vertices"],
            ),
            ("a.ply", ascii().replace("3 0 3 2", "3 0 x 2").into_bytes(), &["entry 3", "found x"]),
            ("a.ply", ascii().replace("float z", "float w").into_bytes(), &["element vertex", "x, y and z"]),
        ];
        for (name, bytes, words) in cases {
            let message = read(name, &bytes).unwrap_err().to_string();
            assert!(words.iter().all(|word| message.contains(word)), "{message}: expected {words:?}");
        }
        assert!(matches!(read("a.ply", b""), Err(ImportError::EmptyFile { .. })));
        assert!(read("a.stl", b"solid").unwrap_err().to_string().contains(".ply or .obj"));
        let huge = ascii().replace("vertex 4", "vertex 4000000000000");
        assert!(read("a.ply", huge.as_bytes()).is_err());
    }
}
