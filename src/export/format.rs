//! The mesh formats by name, and the key that a file carries.

use super::{ExportError, obj, ply};
use crate::mesh::Mesh;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::{
    fs::File,
    io::{Read, Result},
    path::Path,
};

/// A mesh file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MeshFormat {
    /// Binary PLY, with velocities.
    Ply,
    /// Wavefront OBJ.
    Obj,
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

    /// Writes `mesh` to `path` with a key that tells what it was made from; returns the file's size [bytes].
    ///
    /// # Errors
    /// As [`ply::write`] and [`obj::write`].
    pub fn write(self, mesh: &Mesh, path: &Path, key: u64) -> std::result::Result<u64, ExportError> {
        let comment = key_comment(key);
        match self {
            Self::Ply => ply::write(mesh, path, &[comment]),
            Self::Obj => obj::write(mesh, path, &[comment]),
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

/// The comment that carries a key.
pub(super) fn key_comment(key: u64) -> String {
    format!("{KEY}{key:016x}")
}

/// What introduces the key in a comment.
const KEY: &str = "meniscus key ";

/// The first bytes of a file, as text; the key stands in them.
fn start_of(path: &Path) -> Result<String> {
    let mut start = Vec::new();
    File::open(path)?.take(1024).read_to_end(&mut start)?;
    Ok(String::from_utf8_lossy(&start).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_carry_their_key() {
        let folder = tempfile::tempdir().unwrap();
        for format in [MeshFormat::Ply, MeshFormat::Obj] {
            let path = folder.path().join(format!("mesh.{}", format.extension()));
            assert_eq!(format.key_in(&path), None);
            format.write(&Mesh::default(), &path, 0xfeed).unwrap();
            assert_eq!(format.key_in(&path), Some(0xfeed));
            std::fs::write(&path, "ply\nformat ascii 1.0\n").unwrap();
            assert_eq!(format.key_in(&path), None);
            assert_eq!(MeshFormat::from_extension(format.extension()), Some(format));
        }
    }
}
