//! Level sets in OpenVDB files.
//!
//! The crate `vdb-rs` unpacks the values. It stops the program at files that it does not know, so all that it will
//! meet is checked before: header, transform, and every length in the tree. What is read is described in
//! `docs/formats/volume.md`.

mod bytes;
mod header;
mod walk;

use super::{ImportError, MemoryBudget};
use crate::{
    cache::{open_regular, read_bytes},
    grid::{BRICK, BRICK_NODES, Bricks, MAX_BRICK, SparseGrid},
    math::Vec3,
};
use bytes::Bytes;
use std::{
    collections::HashMap,
    path::{Path, PathBuf},
};
use xxhash_rust::xxh3::xxh3_64_with_seed;

/// A signed distance read from a file.
#[derive(Clone, Debug)]
pub struct LevelSet {
    /// The distances [the file's unit], negative inside; where none was stored, plus or minus the half width.
    pub grid: SparseGrid,
    /// Where node (0, 0, 0) stands.
    pub origin: Vec3,
    /// The grid's name in the file.
    pub name: String,
}

/// An OpenVDB file whose bytes are read, and not yet understood.
#[derive(Debug)]
pub(crate) struct LevelSetFile {
    path: PathBuf,
    bytes: Vec<u8>,
    max_memory: Option<u64>,
}

/// Memory of a leaf: its values as they are unpacked and in the grid, and its masks [bytes].
const LEAF_MEMORY: u64 = 2 * 4 * BRICK_NODES as u64 + 512;

impl LevelSetFile {
    /// Reads the bytes of a file, of which bytes and level set together may take `max_memory` [bytes].
    ///
    /// # Errors
    /// [`ImportError`] if it is not there, cannot be read or is longer than that.
    pub(crate) fn open(path: &Path, max_memory: Option<u64>) -> Result<Self, ImportError> {
        let failed = |error| ImportError::from_io(path, "read the file", error);
        let (file, length) = open_regular(path).map_err(failed)?;
        MemoryBudget::new(path, length, max_memory)?;
        let bytes = read_bytes(file, length).map_err(failed)?;
        Ok(Self { path: path.into(), bytes, max_memory })
    }

    /// Identifies what a `version` of the reader's user makes of the file: files of the same bytes have the same.
    pub(crate) fn content_key(&self, version: u64) -> u64 {
        xxh3_64_with_seed(&self.bytes, version)
    }

    /// The level set: the file's only one, or the one named `surface`.
    ///
    /// # Errors
    /// As [`read_level_set`].
    pub(crate) fn level_set(&self) -> Result<LevelSet, ImportError> {
        if self.bytes.is_empty() {
            return Err(ImportError::EmptyFile { path: self.path.clone() });
        }
        let budget = MemoryBudget::new(&self.path, self.bytes.len() as u64, self.max_memory)?;
        parse(&self.path, &self.bytes, &budget)
    }
}

/// Reads the level set of an OpenVDB file: its only one, or the one named `surface`.
///
/// # Errors
/// [`ImportError`], naming the file and the place in it. Half floats, fogs, other types, transforms that turn or
/// stretch, and versions before 222 are refused.
pub fn read_level_set(path: &Path) -> Result<LevelSet, ImportError> {
    LevelSetFile::open(path, None)?.level_set()
}

/// Reads a level set from bytes as from a file of this name, within `max_memory` [bytes].
///
/// # Errors
/// As [`read_level_set`]; [`ImportError::OverMemory`] if it takes more.
#[cfg(all(feature = "cli", any(test, feature = "fuzzing")))]
pub(crate) fn parse_level_set(
    name: &str,
    bytes: &[u8],
    max_memory: Option<u64>,
) -> Result<LevelSet, ImportError> {
    let path = Path::new(name);
    parse(path, bytes, &MemoryBudget::new(path, bytes.len() as u64, max_memory)?)
}

/// Reads the level set of a file's bytes.
fn parse(path: &Path, all: &[u8], budget: &MemoryBudget) -> Result<LevelSet, ImportError> {
    let mut bytes = Bytes { path, all, at: 0 };
    let entries = header::read(&mut bytes)?;
    let readable: Vec<_> = entries.iter().filter(|entry| entry.obstacle().is_none()).collect();
    let entry = match readable[..] {
        [entry] => entry,
        [] => {
            let found: Vec<String> = entries.iter().filter_map(header::Entry::obstacle).collect();
            let found = if found.is_empty() { "no grid".into() } else { found.join(", ") };
            return Err(ImportError::no_level_set(path, found, "a level set of 32-bit floats"));
        }
        _ => readable.iter().copied().find(|entry| entry.name == "surface").ok_or_else(|| {
            let names: Vec<&str> = readable.iter().map(|entry| entry.name.as_str()).collect();
            let found = format!("the level sets {}", names.join(", "));
            ImportError::no_level_set(path, found, "one, or one of them named `surface`")
        })?,
    };
    bytes.at = entry.transform;
    let (voxel, origin) = header::transform(&mut bytes)?;
    let (background, leaves) = walk::walk(&mut bytes, entry)?;

    // A leaf has 128 bytes of masks at least, so this is at most 36 times the file; inner nodes, at most 20, are not counted.
    budget.take(leaves.len() as u64 * LEAF_MEMORY)?;
    let buffers = unpack(&bytes, all, entry)?;
    let grid = assemble(&bytes, voxel as f32, background, &leaves, &buffers)?;
    Ok(LevelSet { grid, origin: Vec3::from(origin.map(|x| x as f32)), name: entry.name.clone() })
}

/// The values of every leaf of a grid, by the leaf's first node. Nothing is left in the file that the crate would stop at.
#[cfg(feature = "vdb")]
fn unpack(
    bytes: &Bytes,
    all: &[u8],
    entry: &header::Entry,
) -> Result<HashMap<[i32; 3], Vec<f32>>, ImportError> {
    let unpacked = vdb_rs::VdbReader::new(std::io::Cursor::new(all))
        .and_then(|mut reader| reader.read_grid::<f32>(&entry.name))
        .map_err(|why| bytes.malformed(format!("values that do not unpack ({why})"), "a sound grid"))?;
    let lower = unpacked.tree.root_nodes.into_iter().flat_map(|root| root.nodes.into_values());
    let leaves = lower.flat_map(|lower| lower.nodes.into_values());
    Ok(leaves.map(|leaf| (leaf.origin.to_array(), leaf.buffer)).collect())
}

/// Refuses the grid: this build has no reader of values.
#[cfg(not(feature = "vdb"))]
fn unpack(bytes: &Bytes, _: &[u8], _: &header::Entry) -> Result<HashMap<[i32; 3], Vec<f32>>, ImportError> {
    Err(bytes.malformed("an OpenVDB file", "a program built with the feature `vdb`"))
}

/// Bricks from leaves: the active values, and the half width on the side of every other node.
fn assemble(
    bytes: &Bytes,
    voxel: f32,
    background: f32,
    leaves: &[walk::Leaf],
    buffers: &HashMap<[i32; 3], Vec<f32>>,
) -> Result<SparseGrid, ImportError> {
    let brick_of = |leaf: &walk::Leaf| leaf.origin.map(|v| v.div_euclid(BRICK as i32));
    let coords: Vec<[i32; 3]> = leaves.iter().map(brick_of).collect();
    if let Some(leaf) = leaves.iter().find(|leaf| brick_of(leaf).iter().any(|v| v.abs() > MAX_BRICK)) {
        return Err(
            bytes.malformed(format!("a leaf at {:?}", leaf.origin), "nodes below 2³⁰ along each axis")
        );
    }
    let mut grid = SparseGrid::new(voxel, Bricks::new(coords), background);
    if grid.bricks.len() < leaves.len() {
        return Err(bytes.malformed("two leaves in one place", "each leaf once"));
    }
    for leaf in leaves {
        let buffer = buffers.get(&leaf.origin).map(Vec::as_slice).unwrap_or_default();
        if buffer.len() != BRICK_NODES {
            return Err(bytes.malformed(format!("{} values of a leaf", buffer.len()), "512"));
        }
        let first = BRICK_NODES * grid.bricks.find(brick_of(leaf)).expect("every leaf has its brick");
        for (index, &value) in buffer.iter().enumerate() {
            let local = [index / (BRICK * BRICK), index / BRICK % BRICK, index % BRICK];
            let inside = match &leaf.inside {
                _ if walk::is_set(&leaf.active, index) => None,
                Some(inside) => Some(walk::is_set(inside, index)),
                None => Some(value < 0.0),
            };
            if inside.is_none() && !value.is_finite() {
                let node = [0, 1, 2].map(|axis| leaf.origin[axis] + local[axis] as i32);
                return Err(bytes.malformed(format!("{value} at node {node:?}"), "a distance"));
            }
            grid.values[first + crate::grid::offset(local)] = match inside {
                None => value,
                Some(true) => -background,
                Some(false) => background,
            };
        }
    }
    Ok(grid)
}
