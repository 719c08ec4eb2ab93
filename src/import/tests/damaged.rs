//! Files that are not what they should be: no reader panics, returns numbers that are none, or takes memory for what is
//! only claimed.

use super::*;
use proptest::prelude::*;

/// Names of sound files and their bytes, in every format.
fn sound() -> Vec<(&'static str, Vec<u8>)> {
    let mut files = vec![
        ("a.ply", ply("ascii")),
        ("a.ply", ply("binary_little_endian")),
        ("a.ply", ply("binary_big_endian")),
        ("a.vtk", vtk(false, 5, "POLYDATA")),
        ("a.vtk", vtk(true, 5, "UNSTRUCTURED_GRID")),
        ("a.bgeo", bgeo(&X, 3)),
        ("a.bgeo", gzip(&bgeo(&X, 3))),
        ("a.xyz", b"3\n# x y z id\n1 2 3 4\n5 6 7 8\n9 10 11 12\n".to_vec()),
        ("a.npz", numpy::npz(&numpy::members(), false)),
        ("a.npz", numpy::npz(&numpy::members(), true)),
    ];
    files.extend(numpy::members().into_iter().take(2).map(|(_, bytes)| ("a.npy", bytes)));
    files.extend(vtu::layouts().into_iter().map(|layout| ("a.vtu", vtu::vtu(layout))));
    files
}

/// A sound file, damaged: bytes replaced, numbers made large, then cut.
fn damaged() -> impl Strategy<Value = (&'static str, Vec<u8>)> {
    let place = any::<prop::sample::Index>;
    let edits = proptest::collection::vec((place(), any::<u8>()), 0..6);
    let digits = proptest::option::of((place(), 0_usize..12));
    (prop::sample::select(sound()), edits, digits, place(), any::<bool>()).prop_map(
        |((name, mut bytes), edits, digits, end, cut)| {
            for (at, byte) in edits {
                let at = at.index(bytes.len());
                bytes[at] = byte;
            }
            // A count in a text becomes a far larger one.
            if let Some((at, more)) = digits {
                let places: Vec<usize> = (0..bytes.len()).filter(|&at| bytes[at].is_ascii_digit()).collect();
                if !places.is_empty() {
                    let at = places[at.index(places.len())];
                    bytes.splice(at..at, vec![b'9'; more]);
                }
            }
            if cut {
                bytes.truncate(end.index(bytes.len()));
            }
            (name, bytes)
        },
    )
}

/// Reads a file; what it took must be in proportion to its bytes.
pub(super) fn read(name: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    let mut result = None;
    let took = allocation_counter::measure(|| result = Some(import(name, bytes)));
    let limit = FIXED + PER_BYTE * bytes.len() as u64;
    assert!(took.bytes_max <= limit, "{name}: {} bytes taken for a file of {}", took.bytes_max, bytes.len());
    result.expect("it was read")
}

/// Memory for a file of a few bytes: inflating takes most, 32 KiB of window and as much of buffers.
const FIXED: u64 = 256 << 10;

/// Allocated bytes per byte of a file: the maximum is a text of single digits, 16 bytes for each word, twice while it grows.
const PER_BYTE: u64 = 64;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2048))]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        for name in ["a.xyz", "a.ply", "a.vtk", "a.bgeo", "a.npy", "a.npz", "a.vtu"] {
            let _ = read(name, &bytes);
        }
        let _ = read("a.bgeo", &[b"BgeoV\0\0\0\x05", &bytes[..]].concat());
        let _ = read("a.bgeo", &gzip(&[b"BgeoV\0\0\0\x05", &bytes[..]].concat()));
        let _ = read("a.ply", &[b"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\n", &bytes[..]].concat());
        let _ = read("a.npy", &[b"\x93NUMPY\x01\0", &bytes[..]].concat());
        let _ = read("a.npz", &numpy::npz(&[("x.npy", bytes.clone())], true));
        let _ = read("a.vtu", &[b"<VTKFile type=\"PolyData\"><Piece NumberOfPoints=\"9\"><Points>", &bytes[..]].concat());
        for format in ["ASCII", "BINARY"] {
            let head = format!("# vtk DataFile Version 4.1\n\n{format}\nDATASET POLYDATA\n");
            let _ = read("a.vtk", &[head.as_bytes(), &bytes].concat());
        }
    }

    #[test]
    fn damaged_files_never_panic((name, bytes) in damaged()) {
        if let Ok(imported) = read(name, &bytes) {
            prop_assert!(imported.stream.vec3("position").unwrap().iter().all(|x| x.iter().all(|x| x.is_finite())));
        }
    }
}

/// Sections of legacy VTK, each sound by itself.
const SECTIONS: [&str; 11] = [
    "POINTS 1 float\n0 0 0\n",
    "POINTS 0 float\n",
    "POINT_DATA 0\n",
    "POINT_DATA 1\n",
    "CELL_DATA 1\n",
    "SCALARS a float 1\nLOOKUP_TABLE default\n",
    "SCALARS b float 1\nLOOKUP_TABLE default\n1\n",
    "FIELD FieldData 1\nv 3 0 float\n\n",
    "FIELD FieldData 1\nw 3 1 float\n1 2 3\n",
    "VERTICES 1 2\n1 0\n",
    "METADATA\n\n",
];

/// A legacy VTK file of some of these in any order.
fn shuffled() -> impl Strategy<Value = String> {
    let sections = proptest::collection::vec(prop::sample::select(&SECTIONS[..]), 0..7);
    sections.prop_map(|sections| {
        format!("# vtk DataFile Version 4.1\n\nASCII\nDATASET POLYDATA\n{}", sections.concat())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn sections_in_any_order_never_panic(text in shuffled()) {
        let _ = read("a.vtk", text.as_bytes());
    }
}

#[test]
fn a_hundred_bytes_that_claim_two_thousand_million_particles() {
    const CLAIM: &str = "2147483648";
    let ply = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {CLAIM}\nproperty uchar x\nproperty uchar y\nproperty uchar z\nend_header\n"
    );
    let vtk = format!("# vtk DataFile Version 4.1\n\nBINARY\nDATASET POLYDATA\nPOINTS {CLAIM} float\n");
    let vtu = |format: &str| {
        format!(
            "<VTKFile type=\"PolyData\"><Piece NumberOfPoints=\"{CLAIM}\"><Points><DataArray type=\"Float32\" \
             NumberOfComponents=\"3\" format=\"{format}\">AAAABgAAAAYA</DataArray></Points></Piece></VTKFile>"
        )
    };
    let npy = numpy::npy("<f4", false, &format!("({CLAIM}, 3)"), &[0; 12]);
    for (name, bytes) in [
        ("a.ply", ply.into_bytes()),
        ("a.vtk", vtk.into_bytes()),
        ("a.vtu", vtu("ascii").into_bytes()),
        ("a.vtu", vtu("binary").into_bytes()),
        ("a.xyz", format!("{CLAIM}\n1 2 3\n").into_bytes()),
        ("a.bgeo", bgeo(&[], 1 << 31)),
        ("a.npz", numpy::npz(&[("x.npy", npy.clone())], true)),
        ("a.npy", npy),
    ] {
        let message = match read(name, &bytes) {
            Err(error @ ImportError::Malformed { .. }) => error.to_string(),
            other => panic!("{name}: {other:?}"),
        };
        assert!(message.contains(": found ") && message.contains("expected"), "{message}");
    }
}
