//! Sampled distance fields on disk, so that a mesh is sampled once.
//!
//! `KEY.mcd`, little-endian: the magic `MCSDF\0\0\x01`; the key (u64), a hash of all that decided the samples; nodes
//! along each axis (3 × u32); voxel (f32); origin (3 × f32); the length of the rest (u64); the samples, f32, x fastest,
//! as one zstd frame; xxh3-64 of everything before it (u64).

use super::{
    CacheError,
    error::Damage,
    open::{open_inside, read_bytes},
    write_atomically,
};
use crate::{
    math::Vec3,
    sdf::{Sampled, SampledGrid},
};
use std::path::{Path, PathBuf};
use xxhash_rust::xxh3::xxh3_64;

const MAGIC: &[u8; 8] = b"MCSDF\0\0\x01";

/// Bytes before the samples.
pub(super) const HEAD: usize = 8 + 8 + 12 + 4 + 12 + 8;

/// The samples' file in `dir`.
pub(crate) fn samples_path(dir: &Path, key: u64) -> PathBuf {
    dir.join(format!("{key:016x}.mcd"))
}

/// Writes `field` to `dir`, which exists, whole or not at all.
///
/// # Errors
/// [`CacheError`] if it cannot be written.
pub(crate) fn write_samples(dir: &Path, key: u64, field: &Sampled) -> Result<(), CacheError> {
    let path = samples_path(dir, key);
    let failed = |error| CacheError::from_io(&path, "write the samples", error);
    let raw: Vec<u8> = field.values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let packed = zstd::bulk::compress(&raw, 1).map_err(failed)?;
    let mut bytes = Vec::with_capacity(HEAD + packed.len() + 8);
    bytes.extend(MAGIC);
    bytes.extend(key.to_le_bytes());
    field.nodes.iter().for_each(|n| bytes.extend(n.to_le_bytes()));
    bytes.extend(field.voxel.to_le_bytes());
    field.origin.iter().for_each(|c| bytes.extend(c.to_le_bytes()));
    bytes.extend((packed.len() as u64).to_le_bytes());
    bytes.extend(packed);
    bytes.extend(xxh3_64(&bytes).to_le_bytes());
    write_atomically(&path, |out| out.write_all(&bytes)).map(|_| ()).map_err(failed)
}

/// Reads what [`write_samples`] wrote under this key for a mesh with this grid, every byte of it verified.
///
/// Checksum and key do not prove that the samples are those of the mesh: whoever writes a file can write them too. The grid is
/// compared, and what distances to any surface have in common; a made-up field that passes is taken for the mesh's.
///
/// # Errors
/// [`CacheError::NotFound`] if it is not there, [`CacheError::Corrupt`] if it is not what was written.
pub(crate) fn read_samples(dir: &Path, key: u64, grid: &SampledGrid) -> Result<Sampled, CacheError> {
    let path = samples_path(dir, key);
    let failed = |error| CacheError::from_io(&path, "read the samples", error);
    let shot = dir.parent().unwrap_or(Path::new(""));
    let (file, length) = open_inside(shot, &path).map_err(failed)?;
    let max = HEAD as u64 + 8 + zstd::zstd_safe::compress_bound(4 * grid.count()) as u64;
    if length > max {
        let (found, expected) =
            (format!("{length} bytes"), format!("at most {max} for the grid of the mesh"));
        return Err(Damage::new("length of the file", found, expected).of(&path));
    }
    let bytes = read_bytes(file, length).map_err(failed)?;
    decode(&bytes, key, grid).map_err(|damage| damage.of(&path))
}

pub(super) fn decode(bytes: &[u8], key: u64, grid: &SampledGrid) -> Result<Sampled, Damage> {
    let size = || format!("{} bytes", bytes.len());
    let Some((body, sum)) = bytes.split_last_chunk::<8>().filter(|(body, _)| body.len() >= HEAD) else {
        return Err(Damage::new("header", size(), format!("at least {} bytes", HEAD + 8)));
    };
    let (found, expected) = (xxh3_64(body), u64::from_le_bytes(*sum));
    if found != expected {
        let message = |hash: u64| format!("checksum {hash:016x}");
        return Err(Damage::new("the whole file", message(found), message(expected)));
    }
    let word = |at: usize| -> [u8; 4] { std::array::from_fn(|i| body[at + i]) };
    let long = |at: usize| -> u64 { u64::from_le_bytes(std::array::from_fn(|i| body[at + i])) };
    if &body[..8] != MAGIC || long(8) != key {
        return Err(Damage::new("header", format!("key {:016x}", long(8)), format!("key {key:016x}")));
    }
    let nodes: [u32; 3] = std::array::from_fn(|axis| u32::from_le_bytes(word(16 + 4 * axis)));
    let voxel = f32::from_le_bytes(word(28));
    let origin = Vec3::from_fn(|axis, _| f32::from_le_bytes(word(32 + 4 * axis)));
    let found = SampledGrid { origin, voxel, nodes };
    if found != *grid {
        return Err(Damage::new("header", format!("{found:?}"), format!("{grid:?}, the grid of the mesh")));
    }
    let count = grid.count();
    if long(44) != (body.len() - HEAD) as u64 {
        return Err(Damage::new("samples", size(), format!("{} bytes of samples", long(44))));
    }
    let raw = zstd::bulk::decompress(&body[HEAD..], 4 * count)
        .map_err(|error| Damage::new("samples", error.to_string(), "a zstd frame"))?;
    if raw.len() != 4 * count {
        return Err(Damage::new("samples", format!("{} bytes", raw.len()), format!("{} bytes", 4 * count)));
    }
    let values = raw.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
    let field = Sampled { origin, voxel, nodes, values };
    match field.fault() {
        Some(found) => Err(Damage::new("samples", found, "distances to a closed surface")),
        None => Ok(field),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A field that is inside at one node.
    fn field() -> Sampled {
        let values =
            (0..60).map(|i| if i == 3 * (4 * 2 + 2) + 1 { -0.2 } else { (i as f32).sin().abs() }).collect();
        Sampled { origin: Vec3::new(1.0, -2.0, 3.5), voxel: 0.25, nodes: [3, 4, 5], values }
    }

    fn grid_of(field: &Sampled) -> SampledGrid {
        SampledGrid { origin: field.origin, voxel: field.voxel, nodes: field.nodes }
    }

    #[test]
    fn samples_of_another_mesh_or_of_none_are_refused_though_their_checksum_is_right() {
        let dir = tempfile::tempdir().unwrap();
        let good = field();
        let grid = grid_of(&good);
        let refused = |field: &Sampled, grid: &SampledGrid| {
            write_samples(dir.path(), 7, field).unwrap();
            match read_samples(dir.path(), 7, grid) {
                Err(error @ CacheError::Corrupt { .. }) => error.to_string(),
                other => panic!("{other:?}"),
            }
        };
        let with = |change: &dyn Fn(&mut Sampled)| {
            let mut field = good.clone();
            change(&mut field);
            field
        };
        let other = SampledGrid { voxel: 0.5, ..grid };
        assert!(refused(&good, &other).contains("the grid of the mesh"));
        // Grids whose nodes are none, one, or more than can be counted.
        for nodes in [[0, 4, 5], [1, 1, 1], [u32::MAX; 3], [3, 4, 6]] {
            let made_up = with(&|field| field.nodes = nodes);
            assert!(refused(&made_up, &grid).contains("the grid of the mesh"), "{nodes:?}");
        }
        write_samples(dir.path(), 9, &good).unwrap();
        let long = std::fs::OpenOptions::new().write(true).open(samples_path(dir.path(), 9)).unwrap();
        long.set_len(2 << 30).unwrap();
        let long = read_samples(dir.path(), 9, &grid).unwrap_err().to_string();
        assert!(long.contains("2147483648 bytes") && long.contains("for the grid of the mesh"), "{long}");
        let short = refused(&with(&|field| field.values.truncate(59)), &grid);
        assert!(short.contains("236 bytes"), "{short}");
        for (at, value, words) in [
            (7, f32::NAN, "NaN at node [1, 2, 0]"),
            (7, f32::INFINITY, "inf"),
            (7, 1e30, "longer than the grid"),
            (0, -1.0, "edge"),
            (31, 0.2, "no node inside"),
        ] {
            let message = refused(&with(&|field| field.values[at] = value), &grid);
            assert!(message.contains(words), "{message}");
        }
        let too_thin = Sampled { nodes: [1, 12, 5], ..good.clone() };
        assert!(refused(&too_thin, &grid_of(&too_thin)).contains("nodes"));
    }

    #[test]
    fn samples_come_back_and_damage_is_found_wherever_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let field = field();
        let grid = grid_of(&field);
        write_samples(dir.path(), 7, &field).unwrap();
        assert_eq!(read_samples(dir.path(), 7, &grid).unwrap(), field);
        assert!(matches!(read_samples(dir.path(), 8, &grid), Err(CacheError::NotFound { .. })));

        let path = samples_path(dir.path(), 7);
        let good = std::fs::read(&path).unwrap();
        std::fs::write(samples_path(dir.path(), 9), &good).unwrap();
        assert!(matches!(read_samples(dir.path(), 9, &grid), Err(CacheError::Corrupt { .. })), "another key");
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            assert!(decode(&bad, 7, &grid).is_err(), "byte {at}");
            assert!(decode(&good[..at], 7, &grid).is_err(), "cut at {at}");
        }
    }
}
