//! PC2 point caches: the places of the same points in many frames, one file for all of them.
//!
//! *Layout*, little endian: `POINTCACHE2\0`, version 1 (i32), points (i32), the first frame and the frames between two samples
//! (f32 each), samples (i32); then each sample's x, y, z (f32) of every point. Blender's Mesh Cache modifier and Houdini read it.
//!
//! Samples are written as they come, so a sequence of any length takes the memory of one.

use super::ExportError;
use crate::{
    cache::{WrittenFile, write_atomically},
    math::Vec3,
};
use std::{io, path::Path};

/// The bytes before the first sample.
pub const HEAD: u64 = 32;

/// What a cache holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Head {
    /// Points of every sample.
    pub points: usize,
    /// The frame of the first sample.
    pub start: f32,
    /// Frames between two samples.
    pub step: f32,
    /// Samples.
    pub samples: usize,
}

/// Why a cache was not written.
#[derive(Debug)]
#[non_exhaustive]
pub enum Pc2Error<E> {
    /// The file.
    Export(ExportError),
    /// A sample could not be had.
    Sample(E),
}

/// Writes `head.samples` samples [m] to `path`, whole or not at all, and returns its size and checksum; `sample` is called once for
/// each, with its number.
///
/// # Errors
/// If the system refuses, if there are more points or samples than the format counts (2³¹ − 1), if a sample has another number of
/// points, or with what `sample` returns.
pub fn write<E: Send>(
    path: &Path,
    head: Head,
    mut sample: impl FnMut(usize) -> Result<Vec<Vec3>, E> + Send,
) -> Result<WrittenFile, Pc2Error<E>> {
    let counts = [("points", head.points), ("samples", head.samples)];
    if let Some((what, count)) = counts.into_iter().find(|&(_, count)| i32::try_from(count).is_err()) {
        let found = format!("found {count} {what}, expected at most 2147483647");
        return Err(Pc2Error::Export(ExportError::mesh(path, found, "write fewer of them")));
    }
    let mut failed = None;
    let written = write_atomically(path, |out| {
        out.write_all(&head.bytes())?;
        for number in 0..head.samples {
            let places = match sample(number) {
                Ok(places) if places.len() == head.points => places,
                Ok(places) => return Err(io::Error::other(Uneven { number, found: places.len(), head })),
                Err(error) => {
                    failed = Some(error);
                    return Err(io::Error::other("no sample"));
                }
            };
            out.write_all(&encoded(&places))?;
        }
        Ok(())
    });
    match (written, failed) {
        (Ok(written), _) => Ok(written),
        (Err(_), Some(error)) => Err(Pc2Error::Sample(error)),
        (Err(error), None) => Err(Pc2Error::Export(match error.downcast::<Uneven>() {
            Ok(uneven) => ExportError::mesh(path, uneven.to_string(), "simulate the shot again"),
            Err(error) => ExportError::write(path, error),
        })),
    }
}

/// A sample whose number of points is not that of the cache.
#[derive(Debug, thiserror::Error)]
#[error("sample {number} has {found} points, expected {}", head.points)]
struct Uneven {
    number: usize,
    found: usize,
    head: Head,
}

impl Head {
    /// The bytes of the whole file.
    pub fn size(&self) -> u64 {
        HEAD + 12 * self.points as u64 * self.samples as u64
    }

    /// As it is in the file.
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = b"POINTCACHE2\0".to_vec();
        bytes.extend(1_i32.to_le_bytes());
        bytes.extend((self.points as i32).to_le_bytes());
        bytes.extend(self.start.to_le_bytes());
        bytes.extend(self.step.to_le_bytes());
        bytes.extend((self.samples as i32).to_le_bytes());
        bytes
    }
}

fn encoded(places: &[Vec3]) -> Vec<u8> {
    places.iter().flat_map(|x| [x.x, x.y, x.z]).flat_map(f32::to_le_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: Head = Head { points: 2, start: 7.0, step: 1.0, samples: 3 };

    fn places(number: usize) -> Vec<Vec3> {
        (0..2).map(|i| Vec3::new(number as f32, 0.5 * i as f32, -1.0)).collect()
    }

    #[test]
    fn the_bytes_are_those_of_the_format() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flag.pc2");
        let written = write(&path, TWO, |number| Ok::<_, ()>(places(number))).unwrap();
        let found = std::fs::read(&path).unwrap();
        assert_eq!((written.bytes, written.bytes), (found.len() as u64, TWO.size()));
        assert_eq!(&found[..16], b"POINTCACHE2\0\x01\0\0\0");
        let whole = |at: usize| i32::from_le_bytes(found[at..at + 4].try_into().unwrap());
        let real = |at: usize| f32::from_le_bytes(found[at..at + 4].try_into().unwrap());
        assert_eq!((whole(16), real(20), real(24), whole(28)), (2, 7.0, 1.0, 3));
        let all: Vec<f32> = (0..18).map(|i| real(32 + 4 * i)).collect();
        let wanted: Vec<f32> = (0..3).flat_map(places).flat_map(|x| [x.x, x.y, x.z]).collect();
        assert_eq!(all, wanted);
    }

    #[test]
    fn a_failed_write_leaves_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flag.pc2");
        let lost = write(&path, TWO, |number| if number < 2 { Ok(places(number)) } else { Err("gone") });
        assert!(matches!(lost, Err(Pc2Error::Sample("gone"))), "{lost:?}");
        let uneven = write(&path, TWO, |number| Ok::<_, ()>(places(number)[number..].to_vec()));
        let Err(Pc2Error::Export(error)) = uneven else { panic!("{uneven:?}") };
        assert!(error.to_string().contains("sample 1 has 1 points, expected 2"), "{error}");
        let many = write(&path, Head { points: 1 << 31, ..TWO }, |_| Ok::<_, ()>(Vec::new()));
        let Err(Pc2Error::Export(error)) = many else { panic!("{many:?}") };
        assert!(error.to_string().contains("2147483648 points"), "{error}");
        let nowhere = write(&folder.path().join("a/b.pc2"), TWO, |number| Ok::<_, ()>(places(number)));
        let Err(Pc2Error::Export(error)) = nowhere else { panic!("{nowhere:?}") };
        assert!(error.to_string().contains("create the folder"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
