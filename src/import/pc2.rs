//! PC2 point caches: positions of the same points in many frames (`export::pc2` has the layout).

use super::ImportError;
use crate::{cache::open_regular, math::Vec3};
use std::{
    fs::File,
    io::{Read, Seek, SeekFrom},
    path::{Path, PathBuf},
};

/// Bytes before the first sample.
const HEADER: usize = 32;

/// The first bytes of every file.
const MAGIC: &[u8] = b"POINTCACHE2\0";

/// Largest magnitude of a frame number.
const MAX_FRAME: f32 = 1e7;

/// The samples of a point cache.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pc2 {
    /// Frame of the first sample, and frames between two samples.
    pub(crate) start: f64,
    pub(crate) step: f64,
    /// Positions of all points in each sample.
    pub(crate) samples: Vec<Vec<Vec3>>,
}

/// What the header of a point cache has.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Head {
    start: f64,
    step: f64,
    samples: usize,
}

impl Head {
    /// The header of a file that has so many bytes after it, and should have so many points.
    fn parse(path: &Path, header: &[u8; HEADER], data: u64, points: usize) -> Result<Self, ImportError> {
        let fault =
            |found: String, expected: String| Err(ImportError::malformed(path, "header", found, expected));
        let word = |at: usize| [0, 1, 2, 3].map(|byte| header[at + byte]);
        let [version, count, samples] = [12, 16, 28].map(|at| i32::from_le_bytes(word(at)));
        let [start, step] = [20, 24].map(|at| f32::from_le_bytes(word(at)));
        if !header.starts_with(MAGIC) || version != 1 {
            return fault("other bytes".to_owned(), "`POINTCACHE2` and version 1".to_owned());
        }
        if usize::try_from(count) != Ok(points) {
            return fault(format!("{count} points"), format!("{points}, as the mesh has vertices"));
        }
        let is_frame = |frame: f32| frame.abs() <= MAX_FRAME;
        if !is_frame(start) || !is_frame(step) || step < 1.0 / 1024.0 {
            let found = format!("{start} as its first frame and {step} as frames between samples");
            return fault(found, "frames within 1e7, with 1/1024 and more between samples".to_owned());
        }
        let size = (points as u64).checked_mul(12).filter(|&size| size > 0);
        let expected = size.and_then(|size| size.checked_mul(u64::try_from(samples).ok()?));
        if samples < 1 || expected != Some(data) {
            let found = format!("{samples} samples in {data} bytes");
            return fault(found, format!("one sample and more, of {points} points with 12 bytes each"));
        }
        Ok(Self { start: f64::from(start), step: f64::from(step), samples: samples as usize })
    }
}

/// A point cache whose samples are read one at a time.
#[derive(Debug)]
pub(crate) struct PointCacheFile {
    path: PathBuf,
    file: File,
    points: usize,
    /// Frame of the first sample.
    pub(crate) start: f64,
    /// Frames between samples.
    pub(crate) step: f64,
    /// Number of samples, one at least.
    pub(crate) samples: usize,
}

impl PointCacheFile {
    /// Opens the point cache at `path`, which should have so many points.
    ///
    /// # Errors
    /// [`ImportError`] if it cannot be read or is no such point cache.
    pub(crate) fn open(path: &Path, points: usize) -> Result<Self, ImportError> {
        let read = || {
            let (mut file, length) = open_regular(path)?;
            let mut header = [0; HEADER];
            file.read_exact(&mut header).map(|()| (file, header, length))
        };
        let (file, header, length) = read().map_err(|source| ImportError::from_io(path, "read", source))?;
        let Head { start, step, samples } =
            Head::parse(path, &header, length.saturating_sub(HEADER as u64), points)?;
        Ok(Self { path: path.to_path_buf(), file, points, start, step, samples })
    }

    /// Positions of all points in a sample.
    ///
    /// # Errors
    /// [`ImportError`] if they cannot be read, or one is not finite.
    ///
    /// # Panics
    /// If there is no such sample.
    pub(crate) fn sample(&mut self, number: usize) -> Result<Vec<Vec3>, ImportError> {
        assert!(number < self.samples, "there are {} samples", self.samples);
        let mut bytes = vec![0; 12 * self.points];
        let place = HEADER as u64 + bytes.len() as u64 * number as u64;
        let read = self.file.seek(SeekFrom::Start(place)).and_then(|_| self.file.read_exact(&mut bytes));
        read.map_err(|source| ImportError::from_io(&self.path, "read", source))?;
        let positions = positions(&bytes);
        expect_finite(&self.path, number, &positions)?;
        Ok(positions)
    }
}

/// The positions of a sample.
fn positions(sample: &[u8]) -> Vec<Vec3> {
    let number = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    let position = |bytes: &[[u8; 4]]| Vec3::new(number(&bytes[0]), number(&bytes[1]), number(&bytes[2]));
    sample.as_chunks().0.chunks_exact(3).map(position).collect()
}

fn expect_finite(path: &Path, sample: usize, positions: &[Vec3]) -> Result<(), ImportError> {
    let Some(point) = positions.iter().position(|x| x.iter().any(|c| !c.is_finite())) else { return Ok(()) };
    let (place, found) =
        (format!("sample {sample}, point {point}"), format!("{:?}", positions[point].as_slice()));
    Err(ImportError::malformed(path, place, found, "finite coordinates"))
}

/// The point cache that a file's bytes hold; errors name `path`.
///
/// # Errors
/// [`ImportError`] if it is not one, or has other than `points` points, or one that is not finite.
pub(crate) fn parse_point_cache(path: &Path, bytes: &[u8], points: usize) -> Result<Pc2, ImportError> {
    let Some((header, data)) = bytes.split_first_chunk() else {
        let found = format!("{} bytes", bytes.len());
        return Err(ImportError::malformed(path, "header", found, format!("{HEADER} bytes and more")));
    };
    let Head { start, step, .. } = Head::parse(path, header, data.len() as u64, points)?;
    let read: Vec<Vec<Vec3>> = data.chunks_exact(12 * points).map(positions).collect();
    read.iter().enumerate().try_for_each(|(sample, positions)| expect_finite(path, sample, positions))?;
    Ok(Pc2 { start, step, samples: read })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(version: i32, points: i32, [start, step]: [f32; 2], samples: i32, numbers: &[f32]) -> Vec<u8> {
        let mut bytes = MAGIC.to_vec();
        bytes.extend([version, points].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend([start, step].iter().flat_map(|n| n.to_le_bytes()));
        bytes.extend(samples.to_le_bytes());
        bytes.extend(numbers.iter().flat_map(|n| n.to_le_bytes()));
        bytes
    }

    #[test]
    fn samples_are_read_with_their_frames() {
        let bytes =
            file(1, 2, [3.0, 0.5], 2, &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]);
        let read = parse_point_cache(Path::new("a.pc2"), &bytes, 2).unwrap();
        assert_eq!((read.start, read.step), (3.0, 0.5));
        assert_eq!(read.samples.len(), 2);
        assert_eq!(read.samples[1], [Vec3::new(6.0, 7.0, 8.0), Vec3::new(9.0, 10.0, 11.0)]);
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("flag.pc2");
        let head = crate::export::pc2::Head { points: 1, start: 1.0, step: 1.0, samples: 3 };
        let sample = |number: usize| vec![Vec3::new(number as f32, 0.0, -1.0)];
        crate::export::pc2::write(&path, head, |number| Ok::<_, ()>(sample(number))).unwrap();
        let read = parse_point_cache(&path, &std::fs::read(&path).unwrap(), 1).unwrap();
        let samples = (0..3).map(sample).collect();
        assert_eq!(read, Pc2 { start: 1.0, step: 1.0, samples });
    }

    #[test]
    fn broken_files_are_refused_with_what_was_found() {
        let good = file(1, 1, [1.0, 1.0], 1, &[0.0; 3]);
        let mut other = good.clone();
        other[0] = b'Q';
        for (bytes, points, words) in [
            (good[..20].to_vec(), 1, "20 bytes"),
            (other, 1, "POINTCACHE2"),
            (file(2, 1, [1.0, 1.0], 1, &[0.0; 3]), 1, "version 1"),
            (good.clone(), 2, "1 points"),
            (file(1, -1, [1.0, 1.0], 1, &[]), 0, "-1 points"),
            (file(1, 0, [1.0, 1.0], 1, &[]), 0, "1 samples in 0 bytes"),
            (file(1, 1, [f32::NAN, 1.0], 1, &[0.0; 3]), 1, "NaN as its first frame"),
            (file(1, 1, [1.0, 0.0], 1, &[0.0; 3]), 1, "0 as frames between samples"),
            (file(1, 1, [1.0, 1.0], 2, &[0.0; 3]), 1, "2 samples in 12 bytes"),
            (file(1, 1, [1.0, 1.0], 0, &[]), 1, "0 samples"),
            (file(1, 1, [1.0, 1.0], i32::MAX, &[0.0; 3]), 1, "2147483647 samples"),
            (file(1, 1, [1.0, 1.0], 1, &[0.0, f32::INFINITY, 0.0]), 1, "sample 0, point 0"),
        ] {
            let error = parse_point_cache(Path::new("a.pc2"), &bytes, points).unwrap_err().to_string();
            assert!(error.contains(words), "{words}: {error}");
        }
    }
}
