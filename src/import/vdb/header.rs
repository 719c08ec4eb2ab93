//! The header of a volume file, checked before any other code sees it.

use super::super::ImportError;
use super::bytes::Bytes;
use std::collections::HashSet;

/// The first eight bytes.
pub(super) const MAGIC: &[u8] = b" BDV\0\0\0\0";

/// The versions of the format that are read. From 222 on, compression stands with each grid; 225 only adds a grid type.
const VERSIONS: std::ops::RangeInclusive<u32> = 222..=225;

/// The bits for what a file does to values.
pub(super) const ZIP: u32 = 1;
pub(super) const ACTIVE_MASK: u32 = 2;
pub(super) const BLOSC: u32 = 4;

/// A grid of the file.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// The name that no other grid of the file has.
    pub(super) name: String,
    /// Type of its tree, without the suffix of half floats.
    kind: String,
    half: bool,
    /// Whether its tree is another grid's.
    shared: bool,
    class: String,
    pub(super) compression: u32,
    /// Where its transform begins.
    pub(super) transform: usize,
    /// Where its values begin.
    pub(super) blocks: i64,
}

impl Entry {
    /// Why this grid is not read, if it is not.
    pub(super) fn obstacle(&self) -> Option<String> {
        let name = self.name.split('\u{1e}').next().unwrap_or_default();
        if self.kind != "Tree_float_5_4_3" {
            return Some(format!("`{name}` of type {}", self.kind));
        }
        if self.class.trim().to_lowercase() != "level set" {
            return Some(format!("`{name}` of class {:?}", self.class));
        }
        if self.half {
            return Some(format!("the level set `{name}` in half floats"));
        }
        self.shared.then(|| format!("the level set `{name}` that shares another's tree"))
    }
}

/// The grids of a file.
pub(super) fn read(bytes: &mut Bytes) -> Result<Vec<Entry>, ImportError> {
    if bytes.take(8, "the mark of a volume file")? != MAGIC {
        bytes.at = 0;
        return Err(bytes.malformed("another kind of file", "an OpenVDB file"));
    }
    let version = bytes.u32("the version")?;
    if !VERSIONS.contains(&version) {
        let expected = format!("{} to {}, which OpenVDB writes since 2013", VERSIONS.start(), VERSIONS.end());
        return Err(bytes.malformed(format!("version {version}"), expected));
    }
    bytes.take(8, "the library's version")?;
    if bytes.take(1, "whether grids can be found")? != [1] {
        return Err(
            bytes.malformed("a stream without places of grids", "a file that a program saved to disk")
        );
    }
    bytes.take(36, "the file's identity")?;
    metadata(bytes)?;
    let count = bytes.u32("the number of grids")?;
    let mut entries: Vec<Entry> = Vec::new();
    let mut names = HashSet::new();
    for _ in 0..count {
        let name = bytes.text("a grid's name")?;
        let kind = bytes.text("a grid's type")?;
        let shared = !bytes.text("the grid whose tree it shares")?.is_empty();
        let [grid, blocks, end] = [
            bytes.i64("where a grid begins")?,
            bytes.i64("where its values begin")?,
            bytes.i64("where it ends")?,
        ];
        if !names.insert(name.clone()) {
            return Err(bytes.malformed(format!("two grids named {name:?}"), "a name for each"));
        }
        // A grid lies behind its descriptor and ends before the next: else many could share the same metadata, whose text is kept.
        let after = bytes.at;
        bytes.seek(grid, "a grid")?;
        if bytes.at < after {
            return Err(bytes.malformed("a grid in front of its descriptor", "grids one after the other"));
        }
        let compression = bytes.u32("a grid's compression")?;
        if compression & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
            return Err(bytes.malformed(format!("compression {compression}"), "0 to 7"));
        }
        let (class, half) = metadata(bytes)?;
        let transform = bytes.at;
        bytes.seek(end, "the end of a grid")?;
        if bytes.at < transform {
            return Err(bytes.malformed("a grid that ends before it begins", "grids one after the other"));
        }
        let (kind, is_half) = match kind.strip_suffix("_HalfFloat") {
            Some(kind) => (kind.to_owned(), true),
            None => (kind, false),
        };
        entries.push(Entry {
            name,
            kind,
            half: half || is_half,
            shared,
            class,
            compression,
            transform,
            blocks,
        });
    }
    Ok(entries)
}

/// Passes over metadata and returns what matters of it: the class, and whether numbers are half floats.
fn metadata(bytes: &mut Bytes) -> Result<(String, bool), ImportError> {
    let (mut class, mut half) = (String::new(), false);
    for _ in 0..bytes.u32("the number of metadata entries")? {
        let name = bytes.text("the name of a metadata entry")?;
        let kind = bytes.text("the type of a metadata entry")?;
        let length = bytes.u32("the length of a metadata entry")? as usize;
        let value = bytes.take(length, "a metadata entry")?;
        let expected = match kind.as_str() {
            "bool" => Some(1),
            "int32" | "float" => Some(4),
            "int64" => Some(8),
            "vec3i" => Some(12),
            _ => None,
        };
        if let Some(expected) = expected.filter(|&expected| expected != length) {
            let found = format!("{length} bytes of type {kind} for `{name}`");
            return Err(bytes.malformed(found, format!("{expected} bytes")));
        }
        match (name.as_str(), kind.as_str()) {
            ("class", "string") => class = String::from_utf8_lossy(value).into_owned(),
            ("is_saved_as_half_float", "bool") => half = value != [0],
            _ => {}
        }
    }
    Ok((class, half))
}

/// The distance between nodes [m] and where node (0, 0, 0) stands [m].
pub(super) fn transform(bytes: &mut Bytes) -> Result<(f64, [f64; 3]), ImportError> {
    let name = bytes.text("the type of a transform")?;
    let origin = match name.as_str() {
        "UniformScaleMap" => [0.0; 3],
        "UniformScaleTranslateMap" | "ScaleTranslateMap" => bytes.vector("a translation")?,
        _ => return Err(bytes.malformed(format!("a transform of type {name}"), EXPECTED)),
    };
    let scale = bytes.vector("a scale")?;
    bytes.take(4 * 24, "the scale's powers")?;
    let even = scale.iter().all(|s| (s / scale[0] - 1.0).abs() < 1e-6);
    // Both become single precision.
    let is_near = origin.iter().all(|&x| (x as f32).is_finite());
    if !(even && scale[0] > 0.0 && (scale[0] as f32).is_normal() && is_near) {
        return Err(bytes.malformed(format!("a scale of {scale:?} about {origin:?}"), EXPECTED));
    }
    Ok((scale[0], origin))
}

/// What a transform may be.
const EXPECTED: &str =
    "one scale along all axes, above 0, and maybe a translation; resample the grid without rotation";

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    /// The voxel and offset of a transform of `scale` that moves by `origin`.
    fn read(origin: [f64; 3], scale: [f64; 3]) -> Result<(f64, [f64; 3]), String> {
        let name = "UniformScaleTranslateMap";
        let mut all = (name.len() as u32).to_le_bytes().to_vec();
        all.extend(name.bytes());
        all.extend(origin.iter().chain(&scale).flat_map(|number| number.to_le_bytes()));
        all.extend([0; 4 * 24]);
        transform(&mut Bytes { path: Path::new("a.vdb"), all: &all, at: 0 }).map_err(|why| why.to_string())
    }

    #[test]
    fn a_transform_moves_and_neither_stretches_nor_leaves_single_precision() {
        assert_eq!(read([1.0, -2.0, 3.0], [0.1; 3]), Ok((0.1, [1.0, -2.0, 3.0])));
        for (origin, scale) in [
            ([1e300, 0.0, 0.0], [0.1; 3]),
            ([0.0, f64::NAN, 0.0], [0.1; 3]),
            ([0.0; 3], [0.1, 0.1, 0.2]),
            ([0.0; 3], [-0.1; 3]),
            ([0.0; 3], [1e-60; 3]),
        ] {
            let why = read(origin, scale).unwrap_err();
            assert!(why.contains("a.vdb") && why.contains("a scale of"), "{why}");
        }
    }
}
