//! The mesh formats by name, and the key and attributes in a file's header.

use super::{
    ExportError,
    error::property_names,
    key::{KEY, key_comment},
    obj, ply,
};
use crate::{
    cache::{WrittenFile, open_regular},
    frame::COLOR,
    mesh::Mesh,
};
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    io::{BufRead, BufReader, Read, Result},
    path::Path,
};

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum MeshFormat {
    /// Binary PLY, with velocities.
    Ply,
    /// Wavefront OBJ.
    Obj,
}

/// Format of sheet files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "presets", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum SheetFormat {
    /// A mesh and a PC2 point cache of all frames.
    Pc2,
    /// A binary PLY mesh a frame, with velocities.
    Ply,
    /// A Wavefront OBJ mesh a frame.
    Obj,
}

impl SheetFormat {
    /// Every format.
    pub const ALL: [Self; 3] = [Self::Pc2, Self::Ply, Self::Obj];

    /// Name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pc2 => "pc2",
            Self::Ply => "ply",
            Self::Obj => "obj",
        }
    }

    /// The format of the meshes, if it writes one a frame.
    pub fn of_frames(self) -> Option<MeshFormat> {
        match self {
            Self::Pc2 => None,
            Self::Ply => Some(MeshFormat::Ply),
            Self::Obj => Some(MeshFormat::Obj),
        }
    }
}

impl MeshFormat {
    /// Every format.
    pub const ALL: [Self; 2] = [Self::Ply, Self::Obj];

    /// The file name's ending.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Obj => "obj",
        }
    }

    /// The format that a file name's ending means.
    pub fn from_extension(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.extension() == text)
    }

    /// Writes `mesh` to `path` with a key of what it was made from; returns its size and checksum.
    ///
    /// # Errors
    /// As [`ply::write`] and [`obj::write`].
    pub fn write(self, mesh: &Mesh, path: &Path, key: u64) -> std::result::Result<WrittenFile, ExportError> {
        let comment = key_comment(key);
        match self {
            Self::Ply => ply::write(mesh, path, &[comment]),
            Self::Obj => obj::write(mesh, path, &[comment]),
        }
    }

    /// The attributes that the vertices of the file at `path` carry, each with the properties that hold it; none if the format
    /// holds none or the file cannot be read.
    pub fn attributes_in(self, path: &Path) -> BTreeMap<String, Vec<String>> {
        match self {
            Self::Ply => attributes(&header_of(path).unwrap_or_default()),
            Self::Obj => BTreeMap::new(),
        }
    }

    /// The key of the file at `path`; `None` if there is no such file or it has none.
    pub fn key_in(self, path: &Path) -> Option<u64> {
        let start = start_of(path).ok()?;
        let comment = match self {
            Self::Ply => "comment ",
            Self::Obj => "# ",
        };
        let value = start.lines().find_map(|line| line.strip_prefix(comment)?.strip_prefix(KEY))?;
        u64::from_str_radix(value.get(..16)?, 16).ok()
    }
}

/// The longest header of a PLY file that is taken for one [bytes].
const LONGEST_HEADER: u64 = 1 << 20;

/// The header of a PLY file.
fn header_of(path: &Path) -> Result<String> {
    let mut lines = BufReader::new(open_regular(path)?.0).take(LONGEST_HEADER).split(b'\n');
    let mut header = String::new();
    while let Some(line) = lines.next().transpose()?.filter(|line| line != b"end_header") {
        header.extend([&*String::from_utf8_lossy(&line), "\n"]);
    }
    Ok(header)
}

/// The attributes in the header of a PLY file, by the names that [`property_names`] gives. Three numbers in a row with the names of a
/// vector's components are one attribute.
fn attributes(header: &str) -> BTreeMap<String, Vec<String>> {
    let vertex = header.lines().skip_while(|line| !line.starts_with("element vertex")).skip(1);
    let words = vertex.map_while(|line| line.strip_prefix("property ")?.split_once(' '));
    let (types, names): (Vec<&str>, Vec<&str>) = words.map(|(kind, name)| (kind, name.trim())).unzip();
    let own = ["x", "y", "z", "nx", "ny", "nz"];
    let mut rest = names.as_slice();
    let mut found = BTreeMap::new();
    while let [first, after @ ..] = rest {
        let vector = match *first {
            "vx" => Some("velocity"),
            "red" if types[types.len() - rest.len()..].iter().take(3).all(|kind| *kind == "uchar") => {
                Some(COLOR)
            }
            other => other.strip_suffix("_x"),
        };
        let vector = vector.map(|name| (name, property_names(name, true)));
        (rest, _) = match vector.filter(|(_, names)| rest.len() >= 3 && rest[..3] == names[..]) {
            Some((name, names)) => (&rest[3..], found.insert(name.to_owned(), names)),
            None if own.contains(first) => (after, None),
            None => (after, found.insert((*first).to_owned(), property_names(first, false))),
        };
    }
    found
}

/// The first bytes of a file, as text; the key stands in them.
fn start_of(path: &Path) -> Result<String> {
    let mut start = Vec::new();
    open_regular(path)?.0.take(1024).read_to_end(&mut start)?;
    Ok(String::from_utf8_lossy(&start).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{frame::Channel, math::Vec3};

    #[test]
    fn files_carry_their_key() {
        let folder = tempfile::tempdir().unwrap();
        for format in [MeshFormat::Ply, MeshFormat::Obj] {
            let path = folder.path().join(format!("mesh.{}", format.extension()));
            assert_eq!(format.key_in(&path), None);
            format.write(&Mesh::default(), &path, 0xfeed).unwrap();
            assert_eq!(format.key_in(&path), Some(0xfeed));
            assert!(format.attributes_in(&path).is_empty());
            std::fs::write(&path, "ply\nformat ascii 1.0\n").unwrap();
            assert_eq!(format.key_in(&path), None);
            assert_eq!(MeshFormat::from_extension(format.extension()), Some(format));
        }
    }

    #[test]
    fn attributes_are_found_again() {
        let attributes = vec![
            Channel { name: "velocity".into(), data: Vec::<Vec3>::new().into() },
            Channel { name: "source".into(), data: Vec::<u32>::new().into() },
            Channel { name: "vorticity".into(), data: Vec::<Vec3>::new().into() },
            Channel { name: "color".into(), data: Vec::<Vec3>::new().into() },
            Channel { name: "odd_x".into(), data: Vec::<f32>::new().into() },
        ];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.ply");
        MeshFormat::Ply.write(&Mesh { attributes, ..Mesh::default() }, &path, 1).unwrap();
        let found = MeshFormat::Ply.attributes_in(&path);
        let names: Vec<_> = found.iter().map(|(name, files)| (name.as_str(), files.join(" "))).collect();
        let expected = [
            ("color", "red green blue"),
            ("odd_x", "odd_x"),
            ("source", "source"),
            ("velocity", "vx vy vz"),
            ("vorticity", "vorticity_x vorticity_y vorticity_z"),
        ];
        assert_eq!(names, expected.map(|(name, files)| (name, files.to_owned())));
        assert!(MeshFormat::Ply.attributes_in(&folder.path().join("none.ply")).is_empty());
        // Numbers of these names are no colour.
        let number = |name: &str| Channel { name: name.into(), data: Vec::<f32>::new().into() };
        let attributes = ["red", "green", "blue"].map(number).into();
        MeshFormat::Ply.write(&Mesh { attributes, ..Mesh::default() }, &path, 1).unwrap();
        let found = MeshFormat::Ply.attributes_in(&path);
        assert!(found.len() == 3 && !found.contains_key("color"), "{found:?}");
    }
}
