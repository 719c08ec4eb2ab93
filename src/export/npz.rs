//! NPZ files: NumPy arrays in a ZIP archive, stored without compression.
//!
//! *Layout*: one `NAME.npy` per array, format version 1.0: the magic number, the length of a header padded to 64 bytes, a Python
//! dictionary with type, order and shape, then the numbers, little endian. Times of entries are fixed, so that equal arrays give equal bytes.

use super::ExportError;
use crate::{
    cache::{WrittenFile, write_atomically},
    frame::ChannelData,
};
use std::{
    io::{Cursor, Write},
    path::Path,
};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// Writes arrays of one length to `path`, whole or not at all; returns its size and checksum.
///
/// # Errors
/// If the system refuses, or an array has more bytes than an entry may have (4 GiB).
pub(crate) fn write(path: &Path, arrays: &[(&str, &ChannelData)]) -> Result<WrittenFile, ExportError> {
    let archive = archive(arrays).map_err(|error| ExportError::write(path, error))?;
    write_atomically(path, |out| out.write_all(&archive)).map_err(|error| ExportError::write(path, error))
}

/// The bytes of the archive.
fn archive(arrays: &[(&str, &ChannelData)]) -> std::io::Result<Vec<u8>> {
    let options = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Stored)
        .last_modified_time(zip::DateTime::default());
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, data) in arrays {
        archive.start_file(format!("{name}.npy"), options)?;
        let (kind, components, bytes) = numbers(data);
        let shape = match components {
            1 => format!("({},)", data.len()),
            _ => format!("({}, {components})", data.len()),
        };
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
        // Magic number, version and length take 10 bytes; a line feed ends the header.
        let padding = 63 - (10 + header.len()) % 64;
        header.extend(std::iter::repeat_n(' ', padding));
        header.push('\n');
        archive.write_all(b"\x93NUMPY\x01\x00")?;
        archive.write_all(&(header.len() as u16).to_le_bytes())?;
        archive.write_all(header.as_bytes())?;
        archive.write_all(&bytes)?;
    }
    Ok(archive.finish()?.into_inner())
}

/// Type, components and bytes of a channel.
fn numbers(data: &ChannelData) -> (&'static str, usize, Vec<u8>) {
    match data {
        ChannelData::F32(values) => ("<f4", 1, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        ChannelData::U32(values) => ("<u4", 1, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        ChannelData::Vec3(values) => {
            ("<f4", 3, values.iter().flat_map(|v| [v.x, v.y, v.z]).flat_map(f32::to_le_bytes).collect())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;

    #[test]
    fn what_is_written_is_read_and_equal_arrays_have_equal_bytes() {
        let positions = ChannelData::Vec3(vec![Vec3::new(1.0, 2.0, 3.0), Vec3::new(-4.0, 0.5, 1e-3)]);
        let (ids, radii) = (ChannelData::U32(vec![7, u32::MAX]), ChannelData::F32(vec![0.1, 0.2]));
        let arrays = [("position", &positions), ("id", &ids), ("radius", &radii)];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spray.npz");
        let written = write(&path, &arrays).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert_eq!((written.bytes, &bytes), (bytes.len() as u64, &archive(&arrays).unwrap()));
        let read = crate::import::read_particles(&path).unwrap();
        assert_eq!(read.stream.vec3("position").unwrap()[1], Vec3::new(-4.0, 0.5, 1e-3));
        assert_eq!(read.stream.f32("radius").unwrap(), [0.1, 0.2]);
        // Each header ends at a multiple of 64 bytes.
        let magic = bytes.windows(6).position(|six| six == b"\x93NUMPY").unwrap();
        let length = u16::from_le_bytes([bytes[magic + 8], bytes[magic + 9]]);
        assert_eq!((length + 10) % 64, 0);
        // An empty frame is a file, too.
        let none = ChannelData::Vec3(Vec::new());
        write(&path, &[("position", &none)]).unwrap();
    }
}
