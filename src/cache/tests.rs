//! The container as a whole: round trips, damage, resuming.

use super::format::{END, FORMAT_VERSION, MAGIC, PROLOGUE, head_bytes, head_checksum, trailer_bytes};
use super::read::Source;
use super::write::{PreparedFrame, encode, write_through};
use super::*;
use crate::frame::{ChannelData, Frame, FrameIndex, Stream, StreamKind};
use crate::math::Vec3;
use crate::par;
use proptest::prelude::*;
use std::fs;
use std::io::{self, Cursor, Write};
use std::path::Path;

const KEY: u64 = 0xfedc_ba98_7654_3210;

/// A frame of two systems with every type, `len` particles in the first.
pub(super) fn frame(index: u32, len: usize) -> Frame {
    let value = |i: usize| (i as f32 * 0.37).sin() * 3.0;
    let position = |i: usize| Vec3::new(value(i), value(2 * i), value(3 * i + 1));
    let mut liquid = Stream::new("liquid", StreamKind::Particles, len)
        .with("position", (0..len).map(position).collect::<Vec<_>>())
        .with("id", (0..len as u32).rev().collect::<Vec<_>>())
        .with("density", (0..len).map(value).collect::<Vec<_>>());
    liquid.scalars =
        vec![("density_dev_avg".into(), 0.1 + 0.2), ("κ".into(), -0.0), ("none".into(), f64::NAN)];
    let empty = Stream::new("foam", StreamKind::Tracers, 0).with("position", Vec::<Vec3>::new());
    Frame {
        index: FrameIndex(index),
        time: 1.0 / 24.0,
        streams: vec![liquid, empty, Stream::new("bare", StreamKind::Unknown, 7)],
    }
}

fn bytes_of(frame: &Frame) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(&mut bytes, frame, KEY).unwrap();
    bytes
}

fn read(bytes: &[u8]) -> Result<(Frame, FrameInfo), CacheError> {
    Source::new(Cursor::new(bytes), Path::new("test.mcf"), bytes.len() as u64).frame(None, |_| true)
}

fn verify(bytes: &[u8]) -> Result<FrameInfo, CacheError> {
    Source::new(Cursor::new(bytes), Path::new("test.mcf"), bytes.len() as u64).verify()
}

/// Whether both readers refuse the bytes as corrupt or of another version.
fn refused(bytes: &[u8]) -> bool {
    let refusal =
        |error: CacheError| matches!(error, CacheError::Corrupt { .. } | CacheError::Version { .. });
    read(bytes).is_err_and(refusal) && verify(bytes).is_err_and(refusal)
}

/// Every bit of a frame's numbers: equality of floats would hide NaN and the sign of zero.
fn bits(frame: &Frame) -> Vec<u64> {
    let mut bits = vec![u64::from(frame.index.0), frame.time.to_bits()];
    for stream in &frame.streams {
        bits.push(stream.len() as u64);
        for channel in stream.channels() {
            bits.extend(chunks::words(&channel.data).iter().map(|&word| u64::from(word)));
        }
        bits.extend(stream.scalars.iter().map(|(_, value)| value.to_bits()));
    }
    bits
}

#[test]
fn every_type_comes_back_bit_for_bit() {
    let dir = tempfile::tempdir().unwrap();
    // 150 000 entries are three chunks, the last one partial.
    for len in [0, 1, 5, 65_536, 150_000] {
        let frame = frame(12, len);
        let bytes = write_frame(dir.path(), &frame, KEY).unwrap();
        let path = frame_path(dir.path(), FrameIndex(12));
        assert_eq!(bytes, fs::metadata(&path).unwrap().len());
        let (back, info) = read_frame(&path).unwrap();
        assert_eq!(bits(&back), bits(&frame));
        for (stream, other) in frame.streams.iter().zip(&back.streams) {
            assert_eq!((&stream.name, stream.kind), (&other.name, other.kind));
            assert_eq!(stream.channels(), other.channels());
            let names =
                |stream: &Stream| stream.scalars.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
            assert_eq!(names(stream), names(other));
        }
        assert_eq!((info.key, info.version, info.bytes), (KEY, FORMAT_VERSION, bytes));
        assert_eq!(info.tool, env!("CARGO_PKG_VERSION"));
        assert_eq!(format!("{info:?}"), format!("{:?}", read_header(&path).unwrap()));
        assert_eq!(format!("{info:?}"), format!("{:?}", verify_frame(&path).unwrap()));
    }
}

#[test]
fn bits_that_are_no_numbers_survive() {
    let odd = [0x7fc0_0001, 0xffff_ffff, 0x7f80_0001, 0x8000_0000, 0x0000_0001, 0x7f80_0000, 0xff80_0000];
    let floats: Vec<f32> = odd.iter().map(|&bits| f32::from_bits(bits)).collect();
    let vectors: Vec<Vec3> = floats.iter().map(|&value| Vec3::new(value, -0.0, value)).collect();
    let stream = Stream::new("liquid", StreamKind::Particles, odd.len())
        .with("a", floats)
        .with("b", vectors)
        .with("c", odd.to_vec());
    let frame = Frame {
        index: FrameIndex(u32::MAX),
        time: f64::from_bits(0xfff8_0000_0000_0001),
        streams: vec![stream],
    };
    let (back, _) = read(&bytes_of(&frame)).unwrap();
    assert_eq!(bits(&back), bits(&frame));
    assert_eq!(back.streams[0].u32("c").unwrap(), odd);
}

#[test]
fn the_bytes_do_not_depend_on_the_number_of_threads() {
    let frame = frame(1, 300_000);
    let one = par::with_threads(1, || bytes_of(&frame));
    for threads in [2, 3] {
        assert!(one == par::with_threads(threads, || bytes_of(&frame)), "{threads} threads");
        let (back, _) = par::with_threads(threads, || read(&one)).unwrap();
        assert!(bits(&back) == bits(&frame), "{threads} threads");
    }
}

#[test]
fn every_flipped_byte_is_refused() {
    let good = bytes_of(&frame(1, 9));
    assert!(read(&good).is_ok() && verify(&good).is_ok());
    for at in 0..good.len() {
        for mask in [0x01, 0x80, 0xff] {
            let mut bad = good.clone();
            bad[at] ^= mask;
            assert!(refused(&bad), "byte {at} of {} flipped by {mask:#x}", good.len());
        }
    }
}

#[test]
fn every_cut_and_every_addition_is_refused() {
    let good = bytes_of(&frame(1, 9));
    for length in 0..good.len() {
        assert!(refused(&good[..length]), "cut to {length} of {}", good.len());
        let header = Source::new(Cursor::new(&good[..length]), Path::new("test.mcf"), length as u64).head();
        assert!(header.is_err(), "the header alone is read from a file cut to {length}");
    }
    for more in [&[0_u8][..], &[0; 24], &good[good.len() - 24..], &good] {
        assert!(refused(&[&good, more].concat()), "{} bytes added", more.len());
    }
}

#[test]
fn swapped_chunks_are_refused() {
    // Two columns of equal values but for one have chunks of equal length and valid checksums of their own.
    let stream = Stream::new("s", StreamKind::Unknown, 8).with("a", vec![1_u32; 8]).with("b", vec![2_u32; 8]);
    let good = bytes_of(&Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] });
    let start = PROLOGUE + u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    let chunk = (good.len() - 24 - start) / 2;
    let mut bad = good.clone();
    bad[start..start + 2 * chunk].rotate_left(chunk);
    assert_ne!(bad, good);
    let error = read(&bad).unwrap_err();
    assert!(error.to_string().contains("seal"), "{error}");
    assert!(verify(&bad).is_err());
}

/// A file with this prologue and header, its checksums in order, no columns.
fn with_header(version: u32, header: &[u8]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(version.to_le_bytes());
    bytes.extend((header.len() as u32).to_le_bytes());
    let checksum = head_checksum(&bytes, header);
    bytes.extend(checksum.to_le_bytes());
    bytes.extend(header);
    let length = bytes.len() as u64 + 24;
    bytes.extend(trailer_bytes(length, chunks::Seal::new(checksum).finish()));
    assert!(bytes.ends_with(&END));
    bytes
}

#[test]
fn another_version_is_named() {
    let (head, _) = head_bytes(&frame(1, 0), KEY);
    assert!(read(&with_header(FORMAT_VERSION, &head[PROLOGUE..])).is_ok());
    for other in [0, 3] {
        let Err(CacheError::Version { found, expected: 2, .. }) =
            read(&with_header(other, &head[PROLOGUE..]))
        else {
            panic!("version {other} cannot be read")
        };
        assert_eq!(found, other);
    }
}

#[test]
fn version_1_has_no_kinds_and_its_streams_are_known_by_name() {
    use StreamKind::{MeshFaces, MeshPoints, Particles, Tracers, Unknown, Vortons};
    let expected = [
        ("liquid", Particles),
        ("smoke", Vortons),
        ("smoke_tracers", Tracers),
        ("sheet.flag", MeshPoints),
        ("sheet.flag.faces", MeshFaces),
        ("foam", Unknown),
    ];
    let streams = expected.map(|(name, _)| Stream::new(name, Unknown, 0)).into();
    let (head, _) = head_bytes(&Frame { index: FrameIndex(1), time: 0.0, streams }, KEY);
    // Without the byte of the kind, which follows a name.
    let mut header = head[PROLOGUE..].to_vec();
    for (name, _) in expected {
        let text = [&(name.len() as u32).to_le_bytes()[..], name.as_bytes()].concat();
        let at = header.windows(text.len()).position(|window| window == text).unwrap() + text.len();
        assert_eq!(header.remove(at), 0);
    }
    let (frame, info) = read(&with_header(1, &header)).unwrap();
    assert_eq!(info.version, 1);
    assert_eq!(frame.streams.iter().map(|stream| (&*stream.name, stream.kind)).collect::<Vec<_>>(), expected);
}

#[test]
fn a_kind_of_a_later_build_is_unknown() {
    let stream = Stream::new("s", StreamKind::Particles, 0);
    let (head, _) = head_bytes(&Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] }, KEY);
    let mut header = head[PROLOGUE..].to_vec();
    let at = header.windows(6).position(|window| window == b"\x01\0\0\0s\x01").unwrap() + 5;
    header[at] = 200;
    let (frame, _) = read(&with_header(FORMAT_VERSION, &header)).unwrap();
    assert_eq!(frame.streams[0].kind, StreamKind::Unknown);
}

#[test]
fn a_length_that_the_file_cannot_hold_is_refused_before_memory_is_taken() {
    for len in [1_u64, 1 << 31, 1 << 62, u64::MAX] {
        let stream = Stream::new("s", StreamKind::Unknown, 0).with("a", vec![0_u32; 0]);
        let (head, _) = head_bytes(&Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream] }, KEY);
        let mut header = head[PROLOGUE..].to_vec();
        let at = header.windows(9).position(|window| window == b"\x01\0\0\0s\0\0\0\0").unwrap() + 6;
        header[at..at + 8].copy_from_slice(&len.to_le_bytes());
        let bytes = with_header(FORMAT_VERSION, &header);
        assert!(bytes.len() < 150);
        let error = read(&bytes).unwrap_err().to_string();
        assert!(error.contains("length of the columns"), "{len}: {error}");
    }
}

#[test]
fn a_header_that_makes_no_sense_is_refused_even_with_a_valid_checksum() {
    let (head, _) = head_bytes(&frame(1, 0), KEY);
    let header = &head[PROLOGUE..];
    for cut in 0..header.len() {
        assert!(refused(&with_header(FORMAT_VERSION, &header[..cut])), "header cut to {cut}");
    }
    assert!(refused(&with_header(FORMAT_VERSION, &[header, &[0]].concat())));
    // Any byte may lie in a name or a number and then means something else; none may end in a panic.
    for at in 0..header.len() {
        let mut other = header.to_vec();
        other[at] ^= 0xff;
        let _ = read(&with_header(FORMAT_VERSION, &other));
    }
    let stream = |name: &str| {
        Stream::new("s", StreamKind::Unknown, 0).with("same", vec![0_u32; 0]).with(name, vec![0_u32; 0])
    };
    let (head, _) =
        head_bytes(&Frame { index: FrameIndex(1), time: 0.0, streams: vec![stream("samf")] }, KEY);
    let twice: Vec<u8> =
        head[PROLOGUE..].iter().map(|&byte| if byte == b'f' { b'e' } else { byte }).collect();
    let error = read(&with_header(FORMAT_VERSION, &twice)).unwrap_err().to_string();
    assert!(error.contains("a second channel \"same\""), "{error}");
    let streams =
        vec![Stream::new("same", StreamKind::Unknown, 0), Stream::new("samf", StreamKind::Unknown, 0)];
    let (head, _) = head_bytes(&Frame { index: FrameIndex(1), time: 0.0, streams }, KEY);
    let twice: Vec<u8> =
        head[PROLOGUE..].iter().map(|&byte| if byte == b'f' { b'e' } else { byte }).collect();
    let error = read(&with_header(FORMAT_VERSION, &twice)).unwrap_err().to_string();
    assert!(error.contains("a second stream \"same\""), "{error}");
}

#[test]
fn a_frame_under_another_number_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    write_frame(dir.path(), &frame(3, 4), KEY).unwrap();
    let (three, four) = (frame_path(dir.path(), FrameIndex(3)), frame_path(dir.path(), FrameIndex(4)));
    fs::rename(&three, &four).unwrap();
    let error = read_frame(&four).unwrap_err().to_string();
    assert!(error.contains("frame 3 under the name of frame 4"), "{error}");
    let free = dir.path().join("copy.mcf");
    fs::rename(&four, &free).unwrap();
    assert!(read_frame(&free).is_ok());
}

/// Takes `space` bytes, then reports a full disk.
struct Failing<'a> {
    out: &'a mut dyn Write,
    space: usize,
}

impl Write for Failing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if bytes.len() > self.space {
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.space -= bytes.len();
        self.out.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[test]
fn a_full_disk_keeps_the_old_frame_and_leaves_no_part() {
    let dir = tempfile::tempdir().unwrap();
    write_frame(dir.path(), &frame(1, 10), KEY).unwrap();
    let path = frame_path(dir.path(), FrameIndex(1));
    let old = fs::read(&path).unwrap();
    let whole = bytes_of(&frame(1, 20)).len();
    for space in [0, 10, 100, whole - 1] {
        let result =
            write_through(path.clone(), |out| encode(&mut Failing { out, space }, &frame(1, 20), KEY))
                .and_then(PreparedFrame::commit);
        assert!(matches!(&result, Err(CacheError::Full { path: place, .. }) if *place == path), "{result:?}");
        assert_eq!(fs::read(&path).unwrap(), old);
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }
    let result =
        write_through(path.clone(), |out| encode(&mut Failing { out, space: whole }, &frame(1, 20), KEY))
            .and_then(PreparedFrame::commit);
    assert_eq!(result.unwrap(), whole as u64);
}

#[test]
fn a_folder_lists_its_frames_in_order() {
    let dir = tempfile::tempdir().unwrap();
    assert!(matches!(list(dir.path()), Err(CacheError::NotFound { .. })));
    assert!(matches!(list(&dir.path().join("missing")), Err(CacheError::NotFound { .. })));
    for index in [12_345, 2, 10, 0] {
        write_frame(dir.path(), &frame(index, 1), KEY).unwrap();
    }
    for other in ["frame_01.mcf", "frame_00002.mcf", "frame_.mcf", "frame_0001.ply", "frame_99999999999.mcf"]
    {
        fs::write(dir.path().join(other), "").unwrap();
    }
    let frames = list(dir.path()).unwrap();
    assert_eq!(frames.iter().map(|(index, _)| index.0).collect::<Vec<_>>(), [0, 2, 10, 12_345]);
    assert!(frames[1].1.ends_with("frame_0002.mcf"));
    let missing = write_frame(&dir.path().join("missing"), &frame(1, 1), KEY);
    assert!(matches!(missing, Err(CacheError::NotFound { .. })));
    assert!(matches!(read_frame(&dir.path().join("no.mcf")), Err(CacheError::NotFound { .. })));
}

#[test]
fn a_frame_of_other_settings_is_stale() {
    let dir = tempfile::tempdir().unwrap();
    write_frame(dir.path(), &frame(1, 10), 7).unwrap();
    let path = frame_path(dir.path(), FrameIndex(1));
    let info = verify_frame(&path).unwrap();
    assert!(info.expect_key(&path, 7).is_ok());
    assert!(matches!(info.expect_key(&path, KEY), Err(CacheError::Stale { found: 7, expected: KEY, .. })));
}

#[test]
fn messages_name_place_finding_expectation_and_next_step() {
    let good = bytes_of(&frame(1, 9));
    let mut bad = good.clone();
    let at = good.len() - 30;
    bad[at] ^= 4;
    let error = read(&bad).unwrap_err().to_string();
    for part in
        ["test.mcf", "liquid.density, chunk 0 at byte", "found checksum", "expected", "simulate again"]
    {
        assert!(error.contains(part), "{part} in: {error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn random_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(read(&bytes).is_err());
        prop_assert!(read(&[&MAGIC[..], &1_u32.to_le_bytes(), &bytes].concat()).is_err());
    }

    #[test]
    fn a_random_header_with_a_valid_checksum_never_panics(header in proptest::collection::vec(0_u8..4, 0..200)) {
        let _ = read(&with_header(FORMAT_VERSION, &header));
    }

    #[test]
    fn any_columns_come_back(words in proptest::collection::vec(any::<u32>(), 0..300), time in any::<u64>()) {
        let floats: Vec<f32> = words.iter().map(|&word| f32::from_bits(word)).collect();
        let stream = Stream::new("x", StreamKind::Unknown, words.len()).with("f", floats).with("u", ChannelData::U32(words));
        let frame = Frame { index: FrameIndex(0), time: f64::from_bits(time), streams: vec![stream] };
        prop_assert_eq!(bits(&read(&bytes_of(&frame)).unwrap().0), bits(&frame));
    }
}
