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
        ("a.csv", b"x,y,z,vx,vy,vz,id\n1,2,3,4,5,6,7\n8,9,10,11,12,13,14\n".to_vec()),
        ("a.txt", b"1;2;3\n\"4\"; 5; 6\n".to_vec()),
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
        for name in ["a.xyz", "a.csv", "a.ply", "a.vtk", "a.bgeo", "a.npy", "a.npz", "a.vtu"] {
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

/// A BGEO file of points at the origin, with so many attributes of an integer.
fn equal_bgeo(points: usize, attributes: usize) -> Vec<u8> {
    let mut out = b"BgeoV".to_vec();
    put(&mut out, true, &[5, points as u32, 0, 0, 0, attributes as u32, 0, 0, 0]);
    for i in 0..attributes {
        let name = format!("a{i}");
        put(&mut out, true, &[name.len() as u16]);
        out.extend(name.as_bytes());
        put(&mut out, true, &[1_u16]);
        put(&mut out, true, &[1_u32, 0]);
    }
    out.resize(out.len() + points * (16 + 4 * attributes), 0);
    out
}

/// A compressed VTU file of points at the origin.
fn equal_vtu(points: usize) -> Vec<u8> {
    let layout = vtu::Layout { place: vtu::Place::AppendedRaw, big: false, wide: true, part: 1 << 20 };
    let mut file = vtu::Vtu::new(layout, "PolyData");
    file.piece(&vec![[0.0; 3]; points], &vec![[0.0; 3]; points], &vec![0; points]);
    file.finish("PolyData")
}

/// The memory that content made of equal numbers takes, which compressed files hold in a thousandth.
const UNPACKED: u64 = 4 << 20;

#[test]
fn content_is_not_unpacked_beyond_what_the_user_allows() {
    let points = UNPACKED as usize / 16;
    let array = |count: usize| numpy::npy("<f4", false, &format!("({count}, 3)"), &vec![0; 12 * count]);
    let compressed = [
        ("a.bgeo", gzip(&equal_bgeo(points, 0))),
        ("a.npz", numpy::npz(&[("x.npy", array(points))], true)),
        ("a.vtu", equal_vtu(points)),
    ];
    for (name, bytes) in compressed {
        assert!((bytes.len() as u64) < UNPACKED / 64, "{name}: {} bytes", bytes.len());
        assert_eq!(import(name, &bytes).unwrap().stream.len(), points);
        for allowed in [100, bytes.len() as u64, UNPACKED / 16, UNPACKED / 2] {
            let mut refused = None;
            let took =
                allocation_counter::measure(|| refused = Some(import_within(name, &bytes, Some(allowed))));
            let refused = refused.expect("it was read");
            assert!(
                matches!(refused, Err(ImportError::OverMemory { allowed: limit, .. }) if limit == allowed),
                "{name}: {refused:?}"
            );
            let limit = FIXED + 2 * allowed;
            assert!(took.bytes_max <= limit, "{name}: {} bytes taken of {allowed} allowed", took.bytes_max);
        }
        assert!(import_within(name, &bytes, Some(16 * UNPACKED)).is_ok(), "{name}: enough is enough");
    }
}

#[test]
fn plain_files_are_read_within_what_the_user_allows() {
    for (name, bytes) in sound() {
        let need = (1..)
            .map(|step| step * bytes.len() as u64 / 4)
            .find(|&allowed| import_within(name, &bytes, Some(allowed)).is_ok());
        let need = need.expect("some memory is enough");
        assert!(need <= PER_BYTE * bytes.len() as u64, "{name}");
        let mut result = None;
        let took = allocation_counter::measure(|| result = Some(import_within(name, &bytes, Some(need))));
        assert!(result.unwrap().is_ok() && took.bytes_max <= FIXED + 2 * need, "{name}: {}", took.bytes_max);
    }
}

#[test]
fn files_of_very_many_attributes_are_refused_or_read_in_time_that_grows_with_their_size() {
    // Comparing each name with all before it would take minutes.
    const ATTRIBUTE_COUNT: usize = 100_000;
    let names =
        |separator: &str| (0..ATTRIBUTE_COUNT).map(|i| format!("a{i}")).collect::<Vec<_>>().join(separator);
    let numbers = |count: usize| "0 ".repeat(count);
    let xyz = format!("# x y z {}\n0 0 0 {}\n", names(" "), numbers(ATTRIBUTE_COUNT));
    let unnamed = format!("0 0 0 {}\n", numbers(ATTRIBUTE_COUNT));
    let properties = names("\nproperty uchar ");
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar {properties}\nend_header\n0 0 0 {}\n",
        numbers(ATTRIBUTE_COUNT)
    );
    let field: String = (0..ATTRIBUTE_COUNT).map(|i| format!("a{i} 1 1 int\n0\n")).collect();
    let head = "# vtk DataFile Version 4.1\n\nASCII\nDATASET POLYDATA\nPOINTS 1 float\n0 0 0\n";
    let vtk = |owner: &str| format!("{head}{owner}_DATA 1\nFIELD FieldData {ATTRIBUTE_COUNT}\n{field}");
    let arrays: String = (0..ATTRIBUTE_COUNT)
        .map(|i| format!("<DataArray type=\"UInt8\" Name=\"a{i}\" format=\"ascii\">0</DataArray>"))
        .collect();
    let piece = "<Piece NumberOfPoints=\"1\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">0 0 0</DataArray></Points><PointData>";
    let vtu = format!("<VTKFile type=\"PolyData\">{piece}{arrays}</PointData></Piece></VTKFile>");
    for (name, bytes) in [
        ("a.csv", xyz.clone().into_bytes()),
        ("a.xyz", xyz.into_bytes()),
        ("a.ply", ply.into_bytes()),
        ("a.vtk", vtk("POINT").into_bytes()),
        ("a.vtu", vtu.into_bytes()),
        ("a.bgeo", equal_bgeo(1, ATTRIBUTE_COUNT)),
    ] {
        let message = import(name, &bytes).unwrap_err().to_string();
        assert!(message.contains("more than 4096 attributes"), "{name}: {message}");
    }
    let unnamed = unnamed.into_bytes();
    for (name, bytes) in [("a.csv", unnamed.clone()), ("a.xyz", unnamed), ("a.vtk", vtk("CELL").into_bytes())]
    {
        let ignored = import(name, &bytes).unwrap().ignored;
        assert!(ignored.len() < 300 && ignored.last().unwrap().contains("more attributes"), "{name}");
    }
}
#[test]
fn elements_of_a_ply_file_without_bytes_take_no_time() {
    // Each claims as many entries as there are bytes: 10¹¹ in all.
    let elements: String = (0..100_000).map(|i| format!("element e{i} 1000000\n")).collect();
    let head = format!("ply\nformat binary_little_endian 1.0\n{elements}");
    let vertex = "element vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    let bytes = [head.as_bytes(), vertex.as_bytes(), &[0; 1_000_000]].concat();
    assert_eq!(import("a.ply", &bytes).unwrap().stream.len(), 1);
}

#[test]
fn arrays_of_a_vtu_file_that_share_their_bytes_read_no_more_than_they_hold() {
    // Each array unpacks the same bytes, 10¹⁰ in all: parts that hold nothing, or one part of blocks that hold nothing.
    const LENGTH: usize = 3 << 20;
    let file = |appended: &[u8]| {
        let array = |tag: &str, components: u32, offset: usize| {
            format!(
                "<DataArray type=\"Float32\" NumberOfComponents=\"{components}\" Name=\"{tag}\" format=\"appended\" offset=\"{offset}\"/>"
            )
        };
        let arrays: String = (0..4000).map(|i| array(&format!("a{i}"), 1, 64)).collect();
        let points = array("p", 3, 0);
        let head = "<VTKFile type=\"PolyData\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\"><Piece NumberOfPoints=\"1\">";
        let xml = format!(
            "{head}<Points>{points}</Points><PointData>{arrays}</PointData></Piece><AppendedData encoding=\"raw\">_"
        );
        [xml.as_bytes(), appended].concat()
    };
    let words = |numbers: &[u64]| numbers.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>();
    let zlib = |bytes: &[u8]| {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        std::io::Write::write_all(&mut encoder, bytes).unwrap();
        encoder.finish().unwrap()
    };
    let packed = zlib(&[0; 12]);
    let mut points = words(&[1, 12, 12, packed.len() as u64]);
    points.extend(packed);
    points.resize(64, 0);
    let number = zlib(&[0; 4]);
    let good = [&points[..], &words(&[1, 4, 4, number.len() as u64]), &number].concat();
    assert_eq!(import("a.vtu", &file(&good)).unwrap().stream.channels().len(), 4001);
    let (nothing, parts) = (zlib(&[]), LENGTH / 16);
    let lengths = [vec![nothing.len() as u64; parts - 1], vec![number.len() as u64]].concat();
    let empty =
        [&points[..], &words(&[parts as u64, 0, 4]), &words(&lengths), &nothing.repeat(parts - 1), &number]
            .concat();
    // The last block and the checksum of what it holds.
    let end = [1, 4, 0, 0xfb, 0xff, 0, 0, 0, 0, 0, 4, 0, 1];
    let blocks = [&[0x78, 1][..], &[0, 0, 0, 0xff, 0xff].repeat(LENGTH / 5), &end].concat();
    let long = [&points[..], &words(&[1, 4, 4, blocks.len() as u64]), &blocks].concat();
    for (bytes, found) in [(empty, "parts of 0 bytes"), (long, "a part of 3145740 bytes")] {
        let message = import("a.vtu", &file(&bytes)).unwrap_err().to_string();
        assert!(message.contains(found), "{message}");
    }
}

#[test]
fn grids_of_a_volume_do_not_share_their_metadata() {
    let number = |out: &mut Vec<u8>, number: u32| out.extend(number.to_le_bytes());
    let text = |out: &mut Vec<u8>, text: &str| {
        out.extend((text.len() as u32).to_le_bytes());
        out.extend(text.as_bytes());
    };
    let mut file = b" BDV\0\0\0\0".to_vec();
    [224, 6, 2].iter().for_each(|&version| number(&mut file, version));
    file.push(1);
    file.extend([b'0'; 36]);
    // The file's metadata hold what every grid takes for its own: compression, and a class of 100 kB.
    number(&mut file, 1);
    text(&mut file, "shared");
    text(&mut file, "string");
    let mut shared = Vec::new();
    number(&mut shared, 0);
    number(&mut shared, 1);
    ["class", "string"].iter().for_each(|word| text(&mut shared, word));
    text(&mut shared, &"c".repeat(100_000));
    number(&mut file, shared.len() as u32);
    let place = file.len() as u64;
    file.extend(&shared);
    number(&mut file, 2000);
    for grid in 0..2000 {
        text(&mut file, &format!("g{grid}"));
        text(&mut file, "Tree_float_5_4_3");
        text(&mut file, "");
        let end = file.len() as u64 + 24;
        [place, place, end].iter().for_each(|place| file.extend(place.to_le_bytes()));
    }
    let mut refused = None;
    let took = allocation_counter::measure(|| refused = parse_level_set("a.vdb", &file, None).err());
    let refused = refused.expect("it is no level set").to_string();
    assert!(refused.contains("a grid in front of its descriptor"), "{refused}");
    assert!(took.bytes_max <= FIXED + PER_BYTE * file.len() as u64, "{} bytes", took.bytes_max);
}
