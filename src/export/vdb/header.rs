//! What stands before the values: the file's header, a descriptor, metadata and transform a grid.

use super::{
    Class, Grid, VolumeParams,
    params::{Compression, Precision},
    tree::Tree,
};
use crate::cache::open_regular;
use std::{io::Read, path::Path};

/// The first eight bytes.
const MAGIC: u64 = 0x5644_4220; // " BDV", the letters read backwards

/// Version of the format: what OpenVDB 5 to 12 write; later ones read it.
const FILE_VERSION: u32 = 224;

/// Version of OpenVDB that a reader takes the file to come from: one of those that write this format (5 to 12).
const LIBRARY_VERSION: [u32; 2] = [6, 2];

/// Where other writers have a number that differs in every file. The same bytes should come from the same grids.
const UUID: &str = "6d656e69-7363-7573-8000-766f6c756d65";

/// Metadata name of the key of what a file was made from.
const KEY: &str = "meniscus_key";

/// Metadata name of the list of grids.
const GRIDS: &str = "meniscus_grids";

/// The largest part of a file that [`made_from`] looks at [bytes].
const HEAD: u64 = 512;

/// The bits for what a file does to values.
const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;

/// The start of a file of grids with these names.
pub(super) fn file(key: u64, names: &[&str]) -> Vec<u8> {
    let mut out = Vec::new();
    out.extend(MAGIC.to_le_bytes());
    out.extend(FILE_VERSION.to_le_bytes());
    out.extend(LIBRARY_VERSION.iter().flat_map(|part| part.to_le_bytes()));
    out.push(1); // descriptors hold the offsets of grids
    out.extend(UUID.as_bytes());
    let (key, grids) = (format!("{key:016x}"), names.join(" "));
    let entries = [("creator", "Meniscus"), (KEY, &key), (GRIDS, &grids)];
    metadata(&entries.map(|(name, text)| (name, Value::Text(text))), &mut out);
    out.extend((names.len() as i32).to_le_bytes());
    out
}

/// The key of the file at `path` and the names of its grids; `None` if there is no such file or it is not of this tool.
pub fn made_from(path: &Path) -> Option<(u64, Vec<String>)> {
    let mut head = Vec::new();
    open_regular(path).ok()?.0.take(HEAD).read_to_end(&mut head).ok()?;
    // Up to the key's digits every file is alike; behind them stand the last entry's name, type, length and text.
    let start = file(0, &[]);
    let names = start.len() - 4;
    let last = 4 + GRIDS.len() + 4 + "string".len() + 4;
    let key = names - last - 16;
    if head.get(..key)? != &start[..key] || head.get(key + 16..names - 4)? != &start[key + 16..names - 4] {
        return None;
    }
    let digits = std::str::from_utf8(&head[key..key + 16]).ok()?;
    let length = u32::from_le_bytes(head.get(names - 4..names)?.try_into().ok()?) as usize;
    let grids = std::str::from_utf8(head.get(names..names + length)?).ok()?;
    let grids = grids.split_whitespace().map(String::from).collect();
    Some((u64::from_str_radix(digits, 16).ok()?, grids))
}

/// A grid's name and type, and where in the file are its metadata, its leaves and its end.
pub(super) fn descriptor(grid: &Grid, params: &VolumeParams, places: [i64; 3]) -> Vec<u8> {
    let mut out = Vec::new();
    text(grid.name, &mut out);
    let kind = match grid.class {
        Class::FogVolume(_) | Class::LevelSet { .. } => "Tree_float_5_4_3",
        Class::Vector(_) => "Tree_vec3s_5_4_3",
    };
    let half = match params.precision {
        Precision::Half => "_HalfFloat",
        Precision::Float => "",
    };
    text(&format!("{kind}{half}"), &mut out);
    text("", &mut out); // the grid whose tree it shares
    out.extend(places.iter().flat_map(|place| place.to_le_bytes()));
    out
}

/// A grid's compression, metadata and transform.
pub(super) fn grid(grid: &Grid, params: &VolumeParams, tree: &Tree) -> Vec<u8> {
    let (bit, word) = match params.compression {
        Compression::Blosc => (BLOSC, "blosc + active values"),
        Compression::Zip => (ZIP, "zip + active values"),
        Compression::None => (0, "active values"),
    };
    let mut out = (ACTIVE_MASK | bit).to_le_bytes().to_vec();
    let mut entries = vec![
        (
            "class",
            Value::Text(match grid.class {
                Class::FogVolume(_) => "fog volume",
                Class::LevelSet { .. } => "level set",
                Class::Vector(_) => "unknown",
            }),
        ),
        ("file_bbox_max", Value::Node(tree.bounds[1])),
        ("file_bbox_min", Value::Node(tree.bounds[0])),
        ("file_compression", Value::Text(word)),
        ("file_voxel_count", Value::Long(tree.active as i64)),
        ("is_saved_as_half_float", Value::Flag(params.precision == Precision::Half)),
        ("name", Value::Text(grid.name)),
    ];
    if let Class::Vector(_) = grid.class {
        entries.push(("vector_type", Value::Text("contravariant relative")));
    }
    metadata(&entries, &mut out);

    // One scale along all axes: the scale, its size, 1/s, 1/s², 1/2s, three numbers each.
    text("UniformScaleMap", &mut out);
    let scale = f64::from(grid.voxel);
    let inverse = 1.0 / scale;
    for number in [scale, scale, inverse, inverse * inverse, inverse / 2.0] {
        out.extend(number.to_le_bytes().repeat(3));
    }
    out
}

/// A value of a metadata entry.
#[derive(Clone, Copy)]
enum Value<'a> {
    Text(&'a str),
    Flag(bool),
    Long(i64),
    Node([i32; 3]),
}

/// Appends how many entries there are, then name, type, length and value of each.
fn metadata(entries: &[(&str, Value)], out: &mut Vec<u8>) {
    out.extend((entries.len() as u32).to_le_bytes());
    for (name, value) in entries {
        let (kind, bytes) = match value {
            Value::Text(text) => ("string", text.as_bytes().to_vec()),
            Value::Flag(flag) => ("bool", vec![u8::from(*flag)]),
            Value::Long(number) => ("int64", number.to_le_bytes().to_vec()),
            Value::Node(node) => ("vec3i", node.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        text(name, out);
        text(kind, out);
        out.extend((bytes.len() as u32).to_le_bytes());
        out.extend(bytes);
    }
}

/// Appends a text after its length.
fn text(text: &str, out: &mut Vec<u8>) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}
