//! PC2 point caches: positions of the same points in many frames (`export::pc2` has the layout).

use super::ImportError;
use crate::math::Vec3;
use std::path::Path;

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

/// The point cache that a file's bytes hold; errors name `path`.
///
/// # Errors
/// [`ImportError`] if it is not one, or has other than `points` points, or one that is not finite.
pub(crate) fn parse_point_cache(path: &Path, bytes: &[u8], points: usize) -> Result<Pc2, ImportError> {
    let fault = |place: &str, found: String, expected: String| {
        Err(ImportError::malformed(path, place.to_owned(), found, &expected))
    };
    let Some((header, data)) = bytes.split_at_checked(HEADER) else {
        return fault("header", format!("{} bytes", bytes.len()), format!("{HEADER} bytes and more"));
    };
    let word = |at: usize| [0, 1, 2, 3].map(|byte| header[at + byte]);
    let [version, count, samples] = [12, 16, 28].map(|at| i32::from_le_bytes(word(at)));
    let [start, step] = [20, 24].map(|at| f32::from_le_bytes(word(at)));
    if !header.starts_with(MAGIC) || version != 1 {
        return fault("header", "other bytes".to_owned(), "`POINTCACHE2` and version 1".to_owned());
    }
    if usize::try_from(count) != Ok(points) {
        return fault("header", format!("{count} points"), format!("{points}, as the mesh has vertices"));
    }
    let is_frame = |frame: f32| frame.abs() <= MAX_FRAME;
    if !is_frame(start) || !is_frame(step) || step < 1.0 / 1024.0 {
        let found = format!("{start} as its first frame and {step} as frames between samples");
        return fault("header", found, "frames within 1e7, with 1/1024 and more between samples".to_owned());
    }
    let size = points.checked_mul(12).filter(|&size| size > 0);
    let expected = size.and_then(|size| size.checked_mul(usize::try_from(samples).ok()?));
    if samples < 1 || expected != Some(data.len()) {
        let found = format!("{samples} samples in {} bytes", data.len());
        return fault("header", found, format!("one sample and more, of {points} points with 12 bytes each"));
    }
    let number = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    let position = |bytes: &[[u8; 4]]| Vec3::new(number(&bytes[0]), number(&bytes[1]), number(&bytes[2]));
    let positions = |sample: &[u8]| sample.as_chunks().0.chunks_exact(3).map(position).collect();
    let read: Vec<Vec<Vec3>> = data.chunks_exact(12 * points).map(positions).collect();
    for (sample, positions) in read.iter().enumerate() {
        if let Some(point) = positions.iter().position(|x| x.iter().any(|c| !c.is_finite())) {
            let found = format!("{:?}", positions[point].as_slice());
            return fault(&format!("sample {sample}, point {point}"), found, "finite coordinates".to_owned());
        }
    }
    Ok(Pc2 { start: f64::from(start), step: f64::from(step), samples: read })
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
