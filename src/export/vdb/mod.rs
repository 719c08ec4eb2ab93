//! OpenVDB files, version 224: `docs/formats/volume.md` has every byte.
//!
//! A brick of 8³ nodes becomes a leaf of a tree whose inner nodes have 16³ and 32³ places. A file is encoded in memory,
//! leaves on all threads, and written whole; equal grids give equal bytes.

mod blosc;
mod grid;
mod header;
mod leaf;
mod params;
mod tree;

pub use grid::{Class, Grid};
pub use header::made_from;
pub use params::{Compression, Precision, VolumeGrid, VolumeParams};

use super::ExportError;
use crate::{
    cache::{WrittenFile, write_atomically},
    grid::{BRICK_NODES, is_set, node_of},
    par,
};
use std::path::Path;

/// Writes `grids` to `path`, with a key of what they were made from; returns its size and checksum.
///
/// # Errors
/// If the system refuses, or if an active value is not finite or too large for half precision; the message names
/// grid and node.
///
/// # Panics
/// If a grid has not as many masks and values as bricks, or lists one of its bricks as inside, or if two share a name.
pub fn write(
    grids: &[Grid],
    path: &Path,
    params: &VolumeParams,
    key: u64,
) -> Result<WrittenFile, ExportError> {
    for (place, grid) in grids.iter().enumerate() {
        assert!(
            grids[..place].iter().all(|other| other.name != grid.name),
            "every grid has a name of its own"
        );
        check(grid, path, params.precision)?;
    }
    let bytes = encode(grids, params, key);
    write_atomically(path, |out| out.write_all(&bytes)).map_err(|error| ExportError::write(path, error))
}

/// The bytes of a file.
fn encode(grids: &[Grid], params: &VolumeParams, key: u64) -> Vec<u8> {
    let mut out = header::file(key, &grids.iter().map(|grid| grid.name).collect::<Vec<_>>());
    for grid in grids {
        let tree = tree::Tree::new(grid);
        let start = out.len() + header::descriptor(grid, params, [0; 3]).len();
        let mut head = header::grid(grid, params, &tree);
        tree.write_topology(grid, params, &mut head);
        let leaves = tree.encode_leaves(grid, params);
        let blocks = start + head.len();
        let end = blocks + leaves.iter().map(Vec::len).sum::<usize>();
        out.extend(header::descriptor(grid, params, [start, blocks, end].map(|place| place as i64)));
        out.extend(head);
        out.extend(leaves.into_iter().flatten());
    }
    out
}

/// Checks that active values can be stored.
fn check(grid: &Grid, path: &Path, precision: Precision) -> Result<(), ExportError> {
    let count = grid.bricks.len();
    assert_eq!(grid.active.len(), count, "a mask a brick");
    assert_eq!(grid.class.len(), count * BRICK_NODES, "512 values a brick");
    let largest = match precision {
        Precision::Half => f32::from(half::f16::MAX),
        Precision::Float => f32::MAX,
    };
    // The first value, in the order of bricks and nodes, that is too large or no number.
    let faults = par::map_chunks(count, 64, |range| {
        range
            .flat_map(|brick| (0..BRICK_NODES).map(move |place| (brick, place)))
            .filter(|&(brick, place)| is_set(&grid.active[brick], place))
            .find_map(|(brick, place)| {
                let mut parts = grid.class.components(brick * BRICK_NODES + place).into_iter().flatten();
                let fault = parts.find(|part| part.abs() > largest || part.is_nan())?;
                Some((node_of(grid.bricks.coords()[brick], place), fault))
            })
    });
    let Some((node, value)) = faults.into_iter().flatten().next() else { return Ok(()) };
    let (what, next) = if value.is_finite() {
        ("at most 65504, the largest half float", "write floats: `volume.precision = \"float\"`")
    } else {
        ("a finite number", "check the velocities and positions of the frame's particles")
    };
    let what = format!("node {node:?} of grid `{}` is {value}, expected {what}", grid.name);
    Err(ExportError::Volume { path: path.to_owned(), what, next })
}

#[cfg(test)]
mod tests;
