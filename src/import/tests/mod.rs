//! Every format from files made here: what is taken, and what is refused.

mod damaged;
mod numpy;
mod vtu;

use super::*;
use std::io::Write;

/// Reads bytes as if from a file of that name.
fn import(name: &str, bytes: &[u8]) -> Result<Imported, ImportError> {
    import_within(name, bytes, None)
}

/// Reads bytes as if from a file of that name, with a limit of memory.
fn import_within(name: &str, bytes: &[u8], max_memory: Option<u64>) -> Result<Imported, ImportError> {
    let path = Path::new(name);
    let budget = MemoryBudget::new(path, bytes.len() as u64, max_memory)?;
    parse(path, Format::of(path).unwrap(), bytes, &budget)
}

/// The message with which bytes are refused as broken.
fn broken(name: &str, bytes: &[u8]) -> String {
    match import(name, bytes) {
        Err(error @ ImportError::Malformed { .. }) => error.to_string(),
        other => panic!("{name}: {other:?}"),
    }
}

/// Three particles: positions, velocities, ids.
const X: [[f32; 3]; 3] = [[0.5, -1.25, 2.0], [1e-7, 3.0e5, -0.0], [0.1, 0.2, 0.3]];
const V: [[f32; 3]; 3] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [-7.0, 8.5, -9.25]];
const ID: [u32; 3] = [7, 4_000_000_000, 0];

fn check(imported: &Imported) {
    let stream = &imported.stream;
    assert_eq!((stream.name.as_str(), stream.len()), ("particles", 3));
    let vectors = |name| -> Vec<[f32; 3]> { stream.vec3(name).unwrap().iter().map(|&v| v.into()).collect() };
    assert_eq!(vectors("position"), X);
    assert_eq!(vectors("velocity"), V);
    assert_eq!(stream.u32("id").unwrap(), ID);
}

/// Bytes of numbers, little- or big-endian.
trait Put {
    fn put(&self, big: bool, out: &mut Vec<u8>);
}

macro_rules! put {
    ($($number:ty),*) => {$(
        impl Put for $number {
            fn put(&self, big: bool, out: &mut Vec<u8>) {
                out.extend(if big { self.to_be_bytes() } else { self.to_le_bytes() });
            }
        }
    )*};
}
put!(u8, u16, i16, u32, i32, i64, f32, f64);

fn put<T: Put>(out: &mut Vec<u8>, big: bool, values: &[T]) {
    values.iter().for_each(|value| value.put(big, out));
}

const PLY: &str = "comment made by a test\nelement vertex 3\nproperty float x\nproperty double y\nproperty float z\n\
    property uint id\nproperty float vx\nproperty float vy\nproperty float vz\nproperty uchar phase\n\
    property list uchar int links\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

fn ply(format: &str) -> Vec<u8> {
    let mut out = format!("ply\nformat {format} 1.0\n{PLY}").into_bytes();
    let big = format == "binary_big_endian";
    for i in 0..3 {
        if format == "ascii" {
            let ([x, y, z], [u, v, w]) = (X[i], V[i]);
            writeln!(out, "{x} {y} {z} {} {u} {v} {w} {i} 2 5 6", ID[i]).unwrap();
        } else {
            put(&mut out, big, &[X[i][0]]);
            put(&mut out, big, &[f64::from(X[i][1])]);
            put(&mut out, big, &[X[i][2]]);
            put(&mut out, big, &[ID[i]]);
            put(&mut out, big, &V[i]);
            out.extend([i as u8, 2]);
            put(&mut out, big, &[5, 6]);
        }
    }
    out.extend(if format == "ascii" { b"3 0 1 2\n".to_vec() } else { vec![0] });
    out
}

#[test]
fn ply_in_every_encoding() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let imported = import("a.ply", &ply(format)).unwrap();
        check(&imported);
        assert_eq!(imported.stream.u32("phase").unwrap(), [0, 1, 2]);
        assert_eq!(imported.ignored, ["links: a list", "face: 1 entries that are no vertices"]);
    }
}

#[test]
fn broken_ply_is_refused() {
    for format in ["ascii", "binary_little_endian"] {
        let whole = ply(format);
        let header = whole.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let text = String::from_utf8_lossy(&whole[..header]).into_owned();
        let with = |from: &str, to: &str| [text.replace(from, to).as_bytes(), &whole[header..]].concat();
        for length in 5..whole.len() - 12 {
            assert!(import("a.ply", &whole[..length]).is_err(), "{format} cut to {length}");
        }
        let message = broken("a.ply", &with("vertex 3", "vertex 2147483648"));
        assert!(message.contains("element vertex") && message.contains("2147483648 entries"), "{message}");
        assert!(broken("a.ply", &with("element vertex", "element point")).contains("an element vertex"));
        assert!(broken("a.ply", &with("property float z", "property float w")).contains("x, y and z"));
        assert!(
            broken("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n")
                .contains("99999999999")
        );
        let empty = text.replace("vertex 3", "vertex 0").replace("face 1", "face 0");
        assert!(import("a.ply", empty.as_bytes()).unwrap().stream.is_empty());
    }
    for id in ["7.5", "nan", "inf"] {
        let bad = String::from_utf8(ply("ascii")).unwrap().replacen(" 7 1 2 3", &format!(" {id} 1 2 3"), 1);
        assert!(broken("a.ply", bad.as_bytes()).contains("an integer"));
    }
    let bad = String::from_utf8(ply("ascii")).unwrap().replacen("0.5 ", "half ", 1);
    let line = bad.lines().position(|line| line.starts_with("half")).unwrap() + 1;
    assert!(
        broken("a.ply", bad.as_bytes()).contains(&format!("line {line}")),
        "{}",
        broken("a.ply", bad.as_bytes())
    );
}

#[test]
fn xyz_as_text() {
    let columns = |head: &str| {
        let mut out = head.to_owned();
        for i in 0..3 {
            let ([x, y, z], [u, v, w]) = (X[i], V[i]);
            out += &format!("{x} {y}\t{z}  {u} {v} {w} {} 0.5\r\n", ID[i]);
        }
        out
    };
    let imported =
        import("a.xyz", columns("3\n# a comment\n# x y z vx vy vz id pscale\n").as_bytes()).unwrap();
    check(&imported);
    assert_eq!(imported.stream.f32("pscale").unwrap(), [0.5; 3]);
    assert!(imported.ignored.is_empty());
    for head in ["", "3\n", "3\n\n", "3\na comment\n", "3\n1 2 3\n", "# nothing\n\n", "X Y Z\n"] {
        let imported = import("a.xyz", columns(head).as_bytes()).unwrap();
        let positions: Vec<[f32; 3]> =
            imported.stream.vec3("position").unwrap().iter().map(|&x| x.into()).collect();
        assert_eq!(positions, X, "{head:?}");
        assert_eq!(imported.ignored.len(), 5);
        assert!(imported.ignored[0].starts_with("column 4: no line names the columns"));
    }
    assert!(broken("a.xyz", columns("9\n").as_bytes()).contains("line 1: found a count of 9"));
    assert!(broken("a.xyz", columns("18446744073709551615\n").as_bytes()).contains("3 lines"));
    assert!(broken("a.xyz", b"1 2 3\n4 5\n").contains("line 2, particle 1: found 2 columns"));
    assert!(broken("a.xyz", b"1 2 3\n4 5 six\n").contains("line 2, particle 1, column 3: found \"six\""));
    assert!(broken("a.xyz", b"1 2\n").contains("expected x y z"));
    for none in ["# x y z\n", "\n\n", "0\n", "0\ncomment\n"] {
        assert!(import("a.xyz", none.as_bytes()).unwrap().stream.is_empty(), "{none:?}");
    }
    let named = import("a.xyz", b"# x y z vx vy vz\n").unwrap();
    assert_eq!(named.stream.vec3("velocity"), Some(&[][..]), "an empty frame has the channels of the others");
}

#[test]
fn many_lines_that_are_no_particles_are_read_once() {
    // Were each line compared with all before it, this test would not come to its end.
    for line in ["7\n", "7\nx y z\n"] {
        assert!(broken("a.xyz", line.repeat(400_000).as_bytes()).contains("expected"));
    }
}

#[test]
fn xyz_as_raw_floats() {
    let mut bytes = Vec::new();
    put(&mut bytes, false, X.as_flattened());
    let imported = import("a.xyz", &bytes).unwrap();
    let positions: Vec<[f32; 3]> =
        imported.stream.vec3("position").unwrap().iter().map(|&x| x.into()).collect();
    assert_eq!(positions, X);
    for length in (1..bytes.len()).filter(|length| length % 12 != 0) {
        assert!(import("a.xyz", &bytes[..length]).is_err(), "cut to {length}");
    }
    // Floats start with any byte, and with any two: only longer marks are those of another format.
    for start in [&b"<"[..], b"\x1f\x8b\x00", b"PK", b"B", b"#"] {
        let mut raw = bytes.clone();
        raw[..start.len()].copy_from_slice(start);
        assert_eq!(import("a.xyz", &raw).unwrap().stream.len(), 3, "{start:?}");
    }
    assert!(broken("a.xyz", &bytes[..30]).contains("byte 24: found 6 bytes"));
    // Few floats may hold no control character.
    let mut few = Vec::new();
    put(&mut few, false, &X[2]);
    assert!(few.iter().all(|&byte| byte >= 32 && byte != 127));
    for count in [1, 2, 3] {
        let imported = import("a.xyz", &few.repeat(count)).unwrap();
        assert_eq!(imported.stream.vec3("position").unwrap(), vec![crate::math::Vec3::from(X[2]); count]);
    }
    let latin = b"# x y z of the f\xf6hn\n1 2 3\n";
    assert!(broken("a.xyz", latin).contains("bytes that are no text"));
}

/// A block of numbers, written out or big-endian.
fn block<T: Put + std::fmt::Display>(out: &mut Vec<u8>, binary: bool, values: &[T]) {
    if binary {
        put(out, true, values);
    } else {
        values.iter().for_each(|value| write!(out, "{value} ").unwrap());
    }
    out.push(b'\n');
}

fn vtk(binary: bool, version: u32, kind: &str) -> Vec<u8> {
    let mut out = format!("# vtk DataFile Version {version}.1\na title\n").into_bytes();
    writeln!(out, "{}\nDATASET {kind}", if binary { "BINARY" } else { "ASCII" }).unwrap();
    out.extend(b"FIELD FieldData 1\nTIME 1 1 double\n");
    block(&mut out, binary, &[0.25_f64]);
    out.extend(b"POINTS 3 float\n");
    block(&mut out, binary, X.as_flattened());
    out.extend(b"METADATA\nINFORMATION 0\n\n");
    let cells = if kind == "POLYDATA" { "VERTICES" } else { "CELLS" };
    if version < 5 {
        writeln!(out, "{cells} 3 6").unwrap();
        block(&mut out, binary, &[1, 0, 1, 1, 1, 2]);
    } else {
        writeln!(out, "{cells} 4 3\nOFFSETS vtktypeint64").unwrap();
        block(&mut out, binary, &[0_i64, 1, 2, 3]);
        out.extend(b"CONNECTIVITY vtktypeint64\n");
        block(&mut out, binary, &[0_i64, 1, 2]);
    }
    if kind != "POLYDATA" {
        out.extend(b"CELL_TYPES 3\n");
        block(&mut out, binary, &[1, 1, 1]);
    }
    out.extend(b"CELL_DATA 3\nSCALARS quality float 1\nLOOKUP_TABLE default\n");
    block(&mut out, binary, &[1.0_f32; 3]);
    out.extend(b"POINT_DATA 3\nSCALARS id unsigned_int 1\nLOOKUP_TABLE id_table\n");
    block(&mut out, binary, &ID);
    out.extend(b"TENSORS stress float\n");
    block(&mut out, binary, &[0.0_f32; 27]);
    out.extend(b"FIELD FieldData 3\nvelocity 3 3 double\n");
    block(&mut out, binary, &V.as_flattened().iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
    out.extend(b"METADATA\nCOMPONENT_NAMES\nVx\n\na%20b 1 3 short\n");
    block(&mut out, binary, &[-1_i16, 2, 3]);
    out.extend(b"density 1 3 float\n");
    block(&mut out, binary, &[1000.0_f32, 999.5, 1e3]);
    out
}

/// A file of version 5.1 in the layout of meshio 5.3.5, which names types of integers by their sizes; its own connectivity has 64 bits.
fn meshio_vtk(binary: bool) -> Vec<u8> {
    let mut out = b"# vtk DataFile Version 5.1\nwritten by meshio v5.3.5\n".to_vec();
    writeln!(out, "{}\nDATASET UNSTRUCTURED_GRID\nPOINTS 3 float", if binary { "BINARY" } else { "ASCII" })
        .unwrap();
    block(&mut out, binary, X.as_flattened());
    out.extend(b"CELLS 4 3\nOFFSETS vtktypeint64\n");
    block(&mut out, binary, &[0_i64, 1, 2, 3]);
    out.extend(b"CONNECTIVITY vtktypeint32\n");
    block(&mut out, binary, &[0_i32, 1, 2]);
    out.extend(b"CELL_TYPES 3\n");
    block(&mut out, binary, &[1, 1, 1]);
    out.extend(b"POINT_DATA 3\nFIELD FieldData 4\nvelocity 3 3 double\n");
    block(&mut out, binary, &V.as_flattened().iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
    out.extend(b"id 1 3 vtktypeuint32\n");
    block(&mut out, binary, &ID);
    out.extend(b"material 1 3 vtktypeint32\n");
    block(&mut out, binary, &[3_i32, 1, 2]);
    out.extend(b"flag 1 3 vtktypeuint8\n");
    block(&mut out, binary, &[0_u8, 1, 255]);
    out
}

#[test]
fn vtk_with_types_named_by_size() {
    for binary in [false, true] {
        let imported = import("a.vtk", &meshio_vtk(binary)).unwrap();
        check(&imported);
        assert_eq!(imported.stream.u32("material").unwrap(), [3, 1, 2]);
        assert_eq!(imported.stream.u32("flag").unwrap(), [0, 1, 255]);
        assert!(imported.ignored.is_empty(), "{:?}", imported.ignored);
    }
}

#[cfg(unix)]
#[test]
fn a_pipe_named_like_a_particle_file_is_refused_at_once() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["a.xyz", "a.bgeo", "a.vdb"] {
        let path = dir.path().join(name);
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let refused = match name {
            "a.vdb" => read_level_set(&path).unwrap_err(),
            _ => read_particles(&path).unwrap_err(),
        };
        assert!(refused.to_string().contains("it is a pipe or a device, not a regular file"), "{refused}");
        let refused = expand(&[path.to_str().unwrap().to_owned()]).unwrap_err();
        assert!(refused.to_string().contains("a pipe or a device, expected a file"), "{refused}");
    }
}

#[test]
fn vtk_in_every_layout() {
    for binary in [false, true] {
        for version in 2..=5 {
            for kind in ["UNSTRUCTURED_GRID", "POLYDATA"] {
                let imported = import("a.vtk", &vtk(binary, version, kind)).unwrap();
                check(&imported);
                assert_eq!(imported.stream.f32("density").unwrap(), [1000.0, 999.5, 1000.0]);
                assert_eq!(
                    imported.ignored,
                    [
                        "stress: 9 components, only 1 or 3 floats are taken",
                        "a b: -1 of particle 0 is not from 0 to 4294967295",
                        "TIME: of the whole dataset, not of the points",
                        "quality: of the cells, not of the points",
                    ]
                );
            }
        }
    }
    let mut double = b"# vtk DataFile Version 3.0\n\nBINARY\nDATASET POLYDATA\nPOINTS 1 double\n".to_vec();
    put(&mut double, true, &[0.5_f64, -1.25, 2.0]);
    double.extend(b"POINT_DATA 1\nVECTORS v float\n");
    put(&mut double, true, &V[0]);
    let imported = import("a.vtk", &double).unwrap();
    assert_eq!(imported.stream.vec3("position").unwrap()[0], crate::math::Vec3::from(X[0]));
    assert_eq!(imported.stream.vec3("velocity").unwrap()[0], crate::math::Vec3::from(V[0]));
}

#[test]
fn broken_vtk_is_refused() {
    for binary in [false, true] {
        let whole = vtk(binary, 4, "POLYDATA");
        // The shortest sound beginnings end behind a whole attribute; inside a block nothing is accepted.
        let start = whole.windows(14).position(|window| window == b"POINTS 3 float").unwrap();
        for length in 14..start + 20 {
            assert!(import("a.vtk", &whole[..length]).is_err(), "cut to {length}");
        }
        for length in whole.len() - 10..whole.len() - 5 {
            let message = broken("a.vtk", &whole[..length]);
            assert!(message.contains("3 numbers") || message.contains("number 2 of 3"), "{message}");
        }
    }
    let text = String::from_utf8(vtk(false, 4, "POLYDATA")).unwrap();
    let with = |from: &str, to: &str| text.replacen(from, to, 1).into_bytes();
    assert!(broken("a.vtk", &with("POINTS 3", "POINTS 2147483648")).contains("6442450944 numbers"));
    assert!(broken("a.vtk", &with("POINTS 3", "POINTS 18446744073709551615")).contains("bytes left"));
    assert!(
        broken("a.vtk", &with("POINTS 3", "POINTS 2")).contains("line 9"),
        "a number where a keyword should be"
    );
    assert!(broken("a.vtk", &with("POINT_DATA 3", "POINT_DATA 4")).contains("attributes of 3 points"));
    assert!(broken("a.vtk", &with("density 1 3", "density 1 4")).contains("3 entries, one a point"));
    assert!(broken("a.vtk", &with("0.5 -1.25", "0.5 what")).contains("found \"what\""));
    assert!(broken("a.vtk", &with("ASCII", "EBCDIC")).contains("line 3"));
    assert!(
        broken("a.vtk", b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\n").contains("a line POINTS")
    );
    let early = b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINT_DATA 0\nSCALARS a float 1\n\
        LOOKUP_TABLE default\nPOINTS 1 float\n0 0 0\n";
    assert!(broken("a.vtk", early).contains("POINTS before POINT_DATA"));
    let grid = import("a.vtk", &with("DATASET POLYDATA", "DATASET STRUCTURED_POINTS"));
    assert!(matches!(grid, Err(ImportError::Unsupported { .. })));
    let none = b"# vtk DataFile Version 3.0\n\nASCII\nDATASET POLYDATA\nPOINTS 0 float\n";
    assert!(import("a.vtk", none).unwrap().stream.is_empty());
}

fn bgeo(points: &[[f32; 3]], count: u32) -> Vec<u8> {
    let mut out = b"BgeoV".to_vec();
    put(&mut out, true, &[5, count, 1, 0, 0, 5, 0, 0, 0]);
    let mut attribute = |name: &str, size: u16, kind: u32, defaults: &[u32]| {
        put(&mut out, true, &[name.len() as u16]);
        out.extend(name.as_bytes());
        put(&mut out, true, &[size]);
        put(&mut out, true, &[kind]);
        put(&mut out, true, defaults);
    };
    attribute("v", 3, 5, &[0; 3]);
    attribute("id", 1, 1, &[0]);
    attribute("pscale", 1, 0, &[0]);
    attribute("uv", 2, 0, &[0; 2]);
    attribute("group", 1, 4, &[2]);
    let at = out.len();
    out.splice(at.., *b"\0\x01a\0\x02bc");
    for (i, point) in points.iter().enumerate() {
        put(&mut out, true, point);
        put(&mut out, true, &[1.0_f32]);
        put(&mut out, true, &V[i]);
        put(&mut out, true, &[[7, 4, 0][i]]);
        put(&mut out, true, &[0.5_f32, 0.0, 1.0]);
        put(&mut out, true, &[1]);
    }
    out
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn bgeo_plain_and_gzipped() {
    let plain = bgeo(&X, 3);
    for (name, bytes) in [("a.bgeo", plain.clone()), ("a.bgeo", gzip(&plain)), ("A.BGEO.GZ", gzip(&plain))] {
        let imported = import(name, &bytes).unwrap();
        let vectors = |name| -> Vec<[f32; 3]> {
            imported.stream.vec3(name).unwrap().iter().map(|&v| v.into()).collect()
        };
        assert_eq!((vectors("position"), vectors("velocity")), (X.to_vec(), V.to_vec()));
        assert_eq!(imported.stream.u32("id").unwrap(), [7, 4, 0]);
        assert_eq!(imported.stream.f32("pscale").unwrap(), [0.5; 3]);
        assert_eq!(
            imported.ignored,
            [
                "uv: 2 components, only 1 or 3 floats are taken",
                "group: indices into a table of names",
                "primitives: 1, not of the points",
            ]
        );
    }
    let mut weighted = plain.clone();
    let at = plain.len() - 3 * 48 + 12;
    weighted[at..at + 4].copy_from_slice(&2.0_f32.to_be_bytes());
    assert!(import("a.bgeo", &weighted).unwrap().ignored[0].starts_with("w: 1 points have a weight"));
}

#[test]
fn broken_bgeo_is_refused() {
    let whole = bgeo(&X, 3);
    for length in 5..whole.len() {
        broken("a.bgeo", &whole[..length]);
    }
    let packed = gzip(&whole);
    for length in 2..packed.len() {
        broken("a.bgeo", &packed[..length]);
    }
    assert!(broken("a.bgeo", &bgeo(&X, 1 << 31)).contains("2147483648 points of 48 bytes"));
    assert!(import("a.bgeo", &bgeo(&[], 0)).unwrap().stream.is_empty());
    let mut other = whole.clone();
    other[8] = 6;
    assert!(matches!(import("a.bgeo", &other), Err(ImportError::Unsupported { .. })));
    other[4] = b'W';
    assert!(matches!(import("a.bgeo", &other), Err(ImportError::Unsupported { .. })));
    assert!(matches!(import("a.bgeo", &gzip(b"something else")), Err(ImportError::Unsupported { .. })));
    let mut huge = whole;
    huge[25..29].copy_from_slice(&u32::MAX.to_be_bytes());
    assert!(broken("a.bgeo", &huge).contains("attribute"));
}

#[test]
fn a_position_or_velocity_that_is_not_finite_is_named() {
    let refusal = |name: &str, bytes: &[u8]| match import(name, bytes) {
        Err(ImportError::NotFinite { channel, particle, .. }) => (channel, particle),
        other => panic!("{name}: {other:?}"),
    };
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let points = [X[0], X[1], [0.0, bad, 0.0]];
        assert_eq!(refusal("a.bgeo", &bgeo(&points, 3)), ("position", 2));
        let mut raw = Vec::new();
        put(&mut raw, false, points.as_flattened());
        assert_eq!(refusal("a.xyz", &raw), ("position", 2));
        let text = format!("# x y z vx vy vz pscale\n1 2 3 4 5 6 7\n1 2 3 4 {bad} 6 7\n");
        assert_eq!(refusal("a.xyz", text.as_bytes()), ("velocity", 1));
        let text = String::from_utf8(ply("ascii")).unwrap().replacen("-1.25", &bad.to_string(), 1);
        assert_eq!(refusal("a.ply", text.as_bytes()), ("position", 0));
        let text = String::from_utf8(vtk(false, 3, "POLYDATA")).unwrap().replacen("8.5", &bad.to_string(), 1);
        assert_eq!(refusal("a.vtk", text.as_bytes()), ("velocity", 2));
        let array = |vectors: &[[f32; 3]; 3]| {
            let mut bytes = Vec::new();
            put(&mut bytes, false, vectors.as_flattened());
            numpy::npy("<f4", false, "(3, 3)", &bytes)
        };
        assert_eq!(refusal("a.npy", &array(&points)), ("position", 2));
        let members = [("position.npy", array(&X)), ("velocity.npy", array(&points))];
        assert_eq!(refusal("a.npz", &numpy::npz(&members, true)), ("velocity", 2));
        for layout in vtu::layouts() {
            let mut file = vtu::Vtu::new(layout, "PolyData");
            file.piece(&X, &V, &ID);
            file.piece(&points, &V, &ID);
            assert_eq!(refusal("a.vtp", &file.finish("PolyData")), ("position", 5), "{layout:?}");
        }
    }
    // A double that single precision cannot hold is not finite here.
    assert_eq!(refusal("a.xyz", b"1 2 3\n1 2 1e39\n"), ("position", 1));
    let error = import("a.xyz", b"1 2 3\n1 nan 3\n").unwrap_err().to_string();
    assert!(error.contains("a.xyz: particle 1: found (1, NaN, 3) as position"), "{error}");
    // In an attribute that nothing depends on it costs the attribute, and this is reported.
    let imported = import("a.xyz", b"# x y z heat\n1 2 3 4.5\n1 2 3 nan\n").unwrap();
    assert_eq!(imported.ignored, ["heat: particle 1 holds NaN"]);
}

#[test]
fn the_content_must_match_the_name() {
    let files = [
        ("a.ply", ply("ascii")),
        ("a.vtk", vtk(true, 4, "POLYDATA")),
        ("a.bgeo", bgeo(&X, 3)),
        ("a.xyz", b"1 2 3\n".to_vec()),
        ("a.npy", numpy::npy("<f4", false, "(0, 3)", b"")),
        ("a.npz", numpy::npz(&numpy::members(), true)),
        ("a.vtu", vtu::vtu(vtu::layouts()[0])),
    ];
    for (name, _) in &files {
        assert!(matches!(import(name, b""), Err(ImportError::EmptyFile { .. })));
        for (other, bytes) in &files {
            let result = import(name, bytes);
            assert_eq!(
                matches!(result, Err(ImportError::Unsupported { .. })),
                name != other,
                "{name}: {result:?}"
            );
        }
    }
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("Frame.PLY");
    std::fs::write(&path, ply("ascii")).unwrap();
    check(&read_particles(&path).unwrap());
    assert!(matches!(read_particles(&dir.path().join("no.ply")), Err(ImportError::NotFound { .. })));
    assert!(matches!(read_particles(&dir.path().join("a.abc")), Err(ImportError::Unsupported { .. })));
    assert!(matches!(read_particles(Path::new("ply")), Err(ImportError::Unsupported { .. })));
}

#[test]
fn a_second_attribute_of_one_name_is_listed() {
    let imported = import("a.xyz", b"# x y z id ID\n1 2 3 4 5\n").unwrap();
    assert_eq!(imported.stream.u32("id").unwrap(), [4]);
    assert_eq!(imported.ignored, ["ID: id is there already"]);
}
