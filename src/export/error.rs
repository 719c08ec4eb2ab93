//! Why a file could not be written.

use crate::{cache::is_full, control::printable_path, frame::COLOR, mesh::Mesh};
use std::{
    collections::HashSet,
    io,
    path::{Path, PathBuf},
};

/// Why a file could not be written. Nothing is left behind under its name or a temporary one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The system refused.
    #[error("{}: cannot write: {source}; {}", printable_path(path), remedy(source.kind()))]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the system; [`io::ErrorKind::StorageFull`] is a full disk.
        source: io::Error,
    },
    /// The mesh cannot be written in this format.
    #[error("{}: cannot write: {what}; {next}", printable_path(path))]
    Mesh {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        what: String,
        /// The next step to take.
        next: &'static str,
    },
    /// A grid has a value that the file cannot hold.
    #[error("{}: cannot write: {what}; {next}", printable_path(path))]
    Volume {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        what: String,
        /// The next step to take.
        next: &'static str,
    },
}

impl ExportError {
    /// Whether the disk (or the quota on it) is full: later frames would fail alike.
    pub fn is_disk_full(&self) -> bool {
        matches!(self, Self::Write { source, .. } if is_full(source))
    }

    /// An error of the system at `path`.
    pub(super) fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// Something in the mesh that the format cannot hold.
    pub(super) fn mesh(path: &Path, what: String, next: &'static str) -> Self {
        Self::Mesh { path: path.to_owned(), what, next }
    }
}

/// The step that helps against a kind of error.
fn remedy(kind: io::ErrorKind) -> &'static str {
    match kind {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
            "free space there or choose another folder, then run the same command again"
        }
        io::ErrorKind::FileTooLarge => {
            "raise `ulimit -f`, or choose a folder on a file system that holds files of this size"
        }
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "make the folder writable or choose another one"
        }
        io::ErrorKind::NotFound | io::ErrorKind::NotADirectory => "create the folder or choose another one",
        io::ErrorKind::IsADirectory => "remove the folder of that name or choose another file name",
        _ => "check the disk, then run the same command again",
    }
}

/// Checks that columns have one entry a vertex and triangles name vertices that exist.
pub(super) fn check_columns(mesh: &Mesh, path: &Path) -> Result<(), ExportError> {
    const NEXT: &str = "check the mesh before writing it";
    let vertices = mesh.positions.len();
    let mut columns = vec![("normals", mesh.normals.len())];
    if mesh.normals.is_empty() {
        columns.clear();
    }
    columns.extend(mesh.attributes.iter().map(|channel| (channel.name.as_str(), channel.data.len())));
    if let Some((name, len)) = columns.iter().find(|column| column.1 != vertices) {
        let what = format!("`{name}` has {len} entries, expected one for each of the {vertices} vertices");
        return Err(ExportError::mesh(path, what, NEXT));
    }
    if let Some(t) = mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertices)) {
        let what = format!("triangle {t} is {:?}, expected vertices below {vertices}", mesh.triangles[t]);
        return Err(ExportError::mesh(path, what, NEXT));
    }
    Ok(())
}

/// The names of the file properties that hold an attribute of that name: a vector or a number.
pub(super) fn property_names(name: &str, is_vector: bool) -> Vec<String> {
    match (is_vector, name) {
        (true, "velocity") => ["vx", "vy", "vz"].map(String::from).into(),
        (true, COLOR) => ["red", "green", "blue"].map(String::from).into(),
        (true, _) => ["x", "y", "z"].map(|axis| format!("{name}_{axis}")).into(),
        (false, _) => vec![name.to_owned()],
    }
}

/// Checks that property names are words and that none occurs twice.
pub(super) fn check_names(names: &[String], path: &Path) -> Result<(), ExportError> {
    let mut seen = HashSet::new();
    for name in names {
        let word = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_graphic());
        if !word || !seen.insert(name) {
            let fault = if word { "occurs twice" } else { "is not one word of ASCII characters" };
            let what = format!("the property name `{}` {fault}", name.escape_debug());
            return Err(ExportError::mesh(path, what, "rename the attribute"));
        }
    }
    Ok(())
}
