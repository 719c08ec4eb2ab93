//! Particle files that other solvers wrote, as a [`Stream`]; triangle meshes for solids;
//! level sets of OpenVDB files ([`read_level_set`]).
//!
//! [`read_particles`] reads PLY, XYZ, tables, legacy VTK, VTU, NPY, NPZ and classic BGEO by the file's extension and refuses a
//! file whose content is something else; [`expand`] turns the patterns of a command line into a sorted sequence of
//! files. What is read of each format is described in `docs/formats/import.md`. Positions keep their axes and
//! units. Counts are compared with the size of the file before memory is taken, content is unpacked within the limits of
//! `budget.rs`, and what is not taken is listed.

mod bgeo;
mod budget;
mod error;
mod expand;
mod gather;
mod geometry;
mod imported;
mod npy;
#[cfg(feature = "npz")]
mod npz;
mod numbers;
mod pc2;
mod ply;
mod ply_numbers;
mod polygons;
mod sequence;
mod table;
mod triangles;
mod vdb;
mod vtk;
#[cfg(feature = "vtk")]
mod vtu;
mod xyz;

#[cfg(test)]
mod tests;

pub use error::ImportError;
pub use expand::expand;
pub(crate) use expand::folders;
pub(crate) use geometry::{Geometry, MAX_GEOMETRY_HEADER, parse_geometry, parse_geometry_header};
pub use imported::Imported;
pub(crate) use pc2::{PointCacheFile, parse_point_cache};
pub use sequence::Sequence;
pub use triangles::{SheetFaces, parse_sheet};
pub(crate) use triangles::{parse_faces, parse_triangles};
pub(crate) use vdb::LevelSetFile;
#[cfg(all(feature = "cli", any(test, feature = "fuzzing")))]
pub(crate) use vdb::parse_level_set;
pub use vdb::{LevelSet, read_level_set};

use crate::cache::{open_regular, read_bytes};
use budget::MemoryBudget;
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// What a ZIP archive starts with, and so an NPZ file.
const ZIP_STARTS: [&[u8]; 2] = [b"PK\x03\x04", b"PK\x05\x06"];

/// What an XML file of VTK starts with, after white space.
const XML_STARTS: [&[u8]; 3] = [b"<?xml", b"<VTKFile", b"<!--"];

/// A format by its extension.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Format {
    Ply,
    Xyz,
    Table,
    Vtk,
    Vtu,
    Bgeo,
    Npy,
    Npz,
}

impl Format {
    fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let name = name.strip_suffix(".gz").filter(|name| name.ends_with(".bgeo")).unwrap_or(&name);
        match name.rsplit_once('.')?.1 {
            "ply" => Some(Self::Ply),
            "xyz" => Some(Self::Xyz),
            "csv" | "tsv" | "txt" => Some(Self::Table),
            "vtk" => Some(Self::Vtk),
            "vtu" | "vtp" => Some(Self::Vtu),
            "bgeo" => Some(Self::Bgeo),
            "npy" => Some(Self::Npy),
            "npz" => Some(Self::Npz),
            _ => None,
        }
    }

    /// The format by a file's first bytes; XYZ and tables have no mark of their own. Marks are three bytes and more: raw floats start with any two
    /// once in 65 536 files.
    fn of_content(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(b"ply\n") || bytes.starts_with(b"ply\r") {
            Some(Self::Ply)
        } else if bytes.starts_with(b"# vtk DataFile") {
            Some(Self::Vtk)
        } else if bytes.starts_with(bgeo::MAGIC) || bgeo::is_gzip(bytes) {
            Some(Self::Bgeo)
        } else if bytes.starts_with(npy::MAGIC) {
            Some(Self::Npy)
        } else if ZIP_STARTS.iter().any(|magic| bytes.starts_with(magic)) {
            Some(Self::Npz)
        } else if XML_STARTS.iter().any(|start| bytes.trim_ascii_start().starts_with(start)) {
            Some(Self::Vtu)
        } else {
            None
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Ply => "PLY",
            Self::Xyz => "XYZ",
            Self::Table => "table",
            Self::Vtk => "legacy VTK",
            Self::Vtu => "VTK XML",
            Self::Bgeo => "BGEO",
            Self::Npy => "NPY",
            Self::Npz => "NPZ",
        }
    }
}

/// Raised whenever a change reads other particles from the same bytes, so that what was made of them is made again.
const READER_VERSION: u32 = 1;

/// A particle file whose bytes are read, and not yet understood.
#[derive(Debug)]
pub struct ParticleFile {
    path: PathBuf,
    format: Format,
    bytes: Vec<u8>,
    max_memory: Option<u64>,
}

impl ParticleFile {
    /// Reads the bytes of a file, of which bytes and particles together may take `max_memory` [bytes].
    ///
    /// # Errors
    /// [`ImportError`] if it is not there, cannot be read, has a name of no format or is longer than that.
    pub fn open(path: &Path, max_memory: Option<u64>) -> Result<Self, ImportError> {
        let Some(format) = Format::of(path) else {
            let expected =
                "a name that ends in .ply, .xyz, .csv, .tsv, .txt, .vtk, .vtu, .vtp, .npy, .npz or .bgeo";
            return Err(ImportError::unsupported(path, "another kind of file", expected));
        };
        let failed = |error| ImportError::from_io(path, "read the file", error);
        let (file, length) = open_regular(path).map_err(failed)?;
        MemoryBudget::new(path, length, max_memory)?;
        let bytes = read_bytes(file, length).map_err(failed)?;
        Ok(Self { path: path.into(), format, bytes, max_memory })
    }

    /// Identifies what the file holds: files of the same bytes, whenever and wherever they were written, have the same.
    pub fn content_key(&self) -> u64 {
        xxh3_64_with_seed(&self.bytes, READER_VERSION.into())
    }

    /// The particles.
    ///
    /// # Errors
    /// As [`read_particles`]; [`ImportError::OverMemory`] if they take more memory than was allowed.
    pub fn particles(&self) -> Result<Imported, ImportError> {
        let budget = MemoryBudget::new(&self.path, self.bytes.len() as u64, self.max_memory)?;
        parse(&self.path, self.format, &self.bytes, &budget)
    }
}

/// Reads the particles of one file.
///
/// # Errors
/// [`ImportError`], naming the file and the place in it. A file without a byte is
/// [`ImportError::EmptyFile`]; a sound one without particles is an empty stream.
pub fn read_particles(path: &Path) -> Result<Imported, ImportError> {
    ParticleFile::open(path, None)?.particles()
}

/// Reads particles from bytes as from a file of this name, within `max_memory` [bytes].
///
/// # Errors
/// As [`ParticleFile::open`] and [`ParticleFile::particles`].
#[cfg(all(feature = "cli", any(test, feature = "fuzzing")))]
pub(crate) fn parse_particles(
    name: &str,
    bytes: &[u8],
    max_memory: Option<u64>,
) -> Result<Imported, ImportError> {
    let path = Path::new(name);
    let format =
        Format::of(path).ok_or_else(|| ImportError::unsupported(path, "another name", "a format"))?;
    parse(path, format, bytes, &MemoryBudget::new(path, bytes.len() as u64, max_memory)?)
}

/// Reads the particles of a file's bytes.
fn parse(path: &Path, format: Format, bytes: &[u8], budget: &MemoryBudget) -> Result<Imported, ImportError> {
    if bytes.is_empty() {
        return Err(ImportError::EmptyFile { path: path.to_path_buf() });
    }
    let content = Format::of_content(bytes);
    let has_no_mark = matches!(format, Format::Xyz | Format::Table);
    if content.map_or(!has_no_mark, |content| content != format) {
        let found = match content {
            Some(other) => format!("the start of a {} file", other.name()),
            None => format!("a start of {:?}", String::from_utf8_lossy(&bytes[..bytes.len().min(12)])),
        };
        return Err(ImportError::unsupported(path, found, format!("{}, by its name", format.name())));
    }
    match format {
        Format::Ply => ply::read(path, bytes, budget),
        Format::Xyz => xyz::read(path, bytes, budget),
        Format::Table => table::read(path, bytes, budget),
        Format::Vtk => vtk::read(path, bytes, budget),
        #[cfg(feature = "vtk")]
        Format::Vtu => vtu::read(path, bytes, budget),
        #[cfg(not(feature = "vtk"))]
        Format::Vtu => {
            Err(ImportError::unsupported(path, "a VTK XML file", "a program built with the feature `vtk`"))
        }
        Format::Bgeo => bgeo::read(path, bytes, budget),
        Format::Npy => npy::read(path, bytes, budget),
        #[cfg(feature = "npz")]
        Format::Npz => npz::read(path, bytes, budget),
        #[cfg(not(feature = "npz"))]
        Format::Npz => {
            Err(ImportError::unsupported(path, "an NPZ file", "a program built with the feature `npz`"))
        }
    }
}
