//! NPY and NPZ.

use super::*;
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// An array as numpy writes it.
pub(super) fn npy(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
    let fortran = if fortran { "True" } else { "False" };
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}");
    header += &" ".repeat(63 - (header.len() + 10) % 64);
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    put(&mut out, false, &[header.len() as u16]);
    out.extend(header.bytes());
    out.extend(data);
    out
}

fn bytes<T: Put>(big: bool, values: &[T]) -> Vec<u8> {
    let mut out = Vec::new();
    put(&mut out, big, values);
    out
}

/// x of every particle, then y, then z.
fn transposed(vectors: &[[f32; 3]]) -> Vec<f32> {
    (0..3).flat_map(|axis| vectors.iter().map(move |vector| vector[axis])).collect()
}

fn positions(imported: &Imported) -> Vec<[f32; 3]> {
    imported.stream.vec3("position").unwrap().iter().map(|&x| x.into()).collect()
}

pub(super) fn npz(members: &[(&str, Vec<u8>)], deflated: bool) -> Vec<u8> {
    let mut archive = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let method = if deflated { CompressionMethod::Deflated } else { CompressionMethod::Stored };
    for (name, bytes) in members {
        // numpy declares members to be large, whatever their size.
        let options = SimpleFileOptions::default().compression_method(method).large_file(true);
        archive.start_file(*name, options).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap().into_inner()
}

/// Positions, velocities and ids under these names.
pub(super) fn members() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        ("position.npy", npy("<f4", false, "(3, 3)", &bytes(false, X.as_flattened()))),
        ("velocity.npy", npy("<f4", true, "(3, 3)", &bytes(false, &transposed(&V)))),
        ("id.npy", npy("<u4", false, "(3,)", &bytes(false, &ID))),
    ]
}

#[test]
fn npy_in_every_type_and_order() {
    let doubles = |big| bytes(big, &X.as_flattened().iter().map(|&x| f64::from(x)).collect::<Vec<_>>());
    for (descr, fortran, data) in [
        ("<f4", false, bytes(false, X.as_flattened())),
        (">f4", false, bytes(true, X.as_flattened())),
        ("<f8", false, doubles(false)),
        (">f8", false, doubles(true)),
        ("<f4", true, bytes(false, &transposed(&X))),
    ] {
        let file = npy(descr, fortran, "(3, 3)", &data);
        assert_eq!(positions(&import("a.npy", &file).unwrap()), X, "{descr} {fortran}");
        let mut second = b"\x93NUMPY\x02\x00".to_vec();
        put(&mut second, false, &[u32::from(file[8]) + 256 * u32::from(file[9])]);
        second.extend(&file[10..]);
        assert_eq!(positions(&import("a.npy", &second).unwrap()), X, "version 2");
    }
    assert!(import("a.npy", &npy("<f4", false, "(0, 3)", &[])).unwrap().stream.is_empty());
    let old = npy("<f4", false, "(3L, 3L)", &bytes(false, X.as_flattened()));
    assert_eq!(positions(&import("a.npy", &old).unwrap()), X);
}

#[test]
fn broken_npy_is_refused() {
    let data = bytes(false, X.as_flattened());
    let whole = npy("<f4", false, "(3, 3)", &data);
    for length in 6..whole.len() {
        broken("a.npy", &whole[..length]);
    }
    assert!(
        broken("a.npy", &[&whole[..], b"?"].concat()).contains("byte 128: found 37 bytes, expected 3 × 3")
    );
    let huge = broken("a.npy", &npy("<f4", false, "(2147483648, 3)", &data));
    assert!(huge.contains("found 36 bytes, expected 2147483648 × 3 numbers of 4 bytes"), "{huge}");
    broken("a.npy", &npy("<f4", false, "(18446744073709551615, 3)", &data));
    broken("a.npy", &npy("<f4", false, "(99999999999999999999, 3)", &data));
    broken("a.npy", &npy("<f4", false, "3, 3", &data));
    let unsupported = |descr: &str, shape: &str| match import("a.npy", &npy(descr, false, shape, &data)) {
        Err(error @ ImportError::Unsupported { .. }) => error.to_string(),
        other => panic!("{descr} {shape}: {other:?}"),
    };
    assert!(unsupported("<f2", "(6, 3)").contains("type <f2"));
    assert!(unsupported("<i4", "(3, 3)").contains("integers"));
    assert!(unsupported("<f4", "(9,)").contains("shape [9]"));
    assert!(unsupported("<f4", "(3, 3, 1)").contains("3 axes"));
    assert!(unsupported("<f4", "()").contains("0 axes"));
    let mut other = whole.clone();
    other[6] = 9;
    assert!(broken("a.npy", &other).contains("version 9"));
}

#[test]
fn npz_stored_and_deflated() {
    for deflated in [false, true] {
        let mut members = members();
        members.push(("heat.npy", npy(">f8", false, "(3, 1)", &bytes(true, &[0.5, 1.5, 2.5]))));
        members.push(("time.npy", npy("<f8", false, "()", &bytes(false, &[0.25]))));
        members.push(("name.npy", npy("<U5", false, "(3,)", &[0; 60])));
        members.push(("box.npy", npy("<f4", false, "(2, 3)", &bytes(false, &[0.0_f32; 6]))));
        members.push(("read.me", b"no array".to_vec()));
        let imported = import("a.npz", &npz(&members, deflated)).unwrap();
        check(&imported);
        assert_eq!(imported.stream.f32("heat").unwrap(), [0.5, 1.5, 2.5]);
        assert_eq!(
            imported.ignored,
            [
                "time: 0 axes",
                "name: type <U5",
                "read.me: not an array",
                "box: shape [2, 3], not one entry for each of 3 particles",
            ]
        );
    }
}

#[test]
fn positions_are_found_under_many_names() {
    let vectors = |data: &[[f32; 3]; 3]| npy("<f4", false, "(3, 3)", &bytes(false, data.as_flattened()));
    for name in ["positions.npy", "Position.npy", "pos.npy", "x.npy", "points.npy"] {
        let file = npz(&[("v.npy", vectors(&V)), (name, vectors(&X))], true);
        let imported = import("a.npz", &file).unwrap();
        assert_eq!(positions(&imported), X, "{name}");
        assert!(imported.stream.vec3("velocity").is_some());
    }
    assert_eq!(positions(&import("a.npz", &npz(&[("arr_0.npy", vectors(&X))], false)).unwrap()), X);
    let axis = |data: &[[f32; 3]; 3], axis: usize| {
        npy("<f4", false, "(3,)", &bytes(false, &transposed(data)[3 * axis..3 * axis + 3]))
    };
    let mut separate: Vec<(&str, Vec<u8>)> =
        ["x.npy", "y.npy", "z.npy"].into_iter().enumerate().map(|(i, name)| (name, axis(&X, i))).collect();
    separate
        .extend(["vx.npy", "vy.npy", "vz.npy"].into_iter().enumerate().map(|(i, name)| (name, axis(&V, i))));
    separate.push(("ids.npy", npy("<i8", false, "(3,)", &bytes(false, &ID.map(i64::from)))));
    check(&import("a.npz", &npz(&separate, false)).unwrap());
    let message = broken("a.npz", &npz(&[("a.npy", vectors(&X)), ("b.npy", vectors(&V))], false));
    assert!(message.contains("[a [3, 3], b [3, 3]]") && message.contains("position (N × 3)"), "{message}");
    assert!(broken("a.npz", &npz(&[], false)).contains("the arrays []"));
}

#[test]
fn broken_npz_is_refused() {
    for deflated in [false, true] {
        let whole = npz(&members(), deflated);
        for length in 4..whole.len() {
            assert!(import("a.npz", &whole[..length]).is_err(), "cut to {length}");
        }
    }
    let huge = [("position.npy", npy("<f4", false, "(2147483648, 3)", &bytes(false, X.as_flattened())))];
    let message = broken("a.npz", &npz(&huge, true));
    assert!(message.contains("member position.npy, byte 128: found 36 bytes"), "{message}");
    let mut flipped = npz(&members(), false);
    let at = flipped.windows(4).position(|window| window == X[0][1].to_le_bytes()).unwrap();
    flipped[at] ^= 1;
    assert!(broken("a.npz", &flipped).contains("member position.npy"), "by its checksum");
}
