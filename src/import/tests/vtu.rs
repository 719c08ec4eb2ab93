//! VTU and VTP.

use super::*;
use flate2::{Compression, write::ZlibEncoder};

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    Ascii,
    Inline,
    AppendedBase64,
    AppendedRaw,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    pub(super) place: Place,
    pub(super) big: bool,
    pub(super) wide: bool,
    /// Bytes of a part of a compressed block; 0: plain.
    pub(super) part: usize,
}

pub(super) fn layouts() -> Vec<Layout> {
    let mut all = vec![Layout { place: Place::Ascii, big: false, wide: false, part: 0 }];
    for place in [Place::Inline, Place::AppendedBase64, Place::AppendedRaw] {
        for big in [false, true] {
            for wide in [false, true] {
                all.extend([0, 7, 12, 1 << 15].map(|part| Layout { place, big, wide, part }));
            }
        }
    }
    all
}

fn base64(bytes: &[u8]) -> Vec<u8> {
    let alphabet = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let four = |three: &[u8]| {
        let bits = three.iter().chain(&[0; 2]).take(3).fold(0, |all, &byte| all << 8 | usize::from(byte));
        let mut out = [18, 12, 6, 0].map(|shift| alphabet[bits >> shift & 63]);
        out[three.len() + 1..].fill(b'=');
        out
    };
    bytes.chunks(3).flat_map(four).collect()
}

/// A file under construction.
pub(super) struct Vtu {
    layout: Layout,
    text: String,
    appended: Vec<u8>,
}

impl Vtu {
    pub(super) fn new(layout: Layout, kind: &str) -> Self {
        let Layout { big, wide, part, .. } = layout;
        let order = if big { "BigEndian" } else { "LittleEndian" };
        let header = if wide { "UInt64" } else { "UInt32" };
        let compressor = if part > 0 { " compressor=\"vtkZLibDataCompressor\"" } else { "" };
        let text = format!(
            "<?xml version=\"1.0\"?>\n<!-- a test -->\n<VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"{order}\" \
             header_type=\"{header}\"{compressor}>\n<{kind}>\n"
        );
        Self { layout, text, appended: Vec::new() }
    }

    fn array<T: Put + std::fmt::Display>(&mut self, name: &str, kind: &str, components: usize, values: &[T]) {
        let Layout { place, big, wide, part } = self.layout;
        let head =
            format!("<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=");
        self.text += &head;
        if place == Place::Ascii {
            let words: Vec<String> = values.iter().map(T::to_string).collect();
            // Newer files have the range of an array's values in its element.
            self.text += &format!(
                "\"ascii\">\n <InformationKey name=\"L2\"><Value index=\"0\">7</Value></InformationKey>\n {}\n</DataArray>\n",
                words.join("\n ")
            );
            return;
        }
        let mut plain = Vec::new();
        put(&mut plain, big, values);
        let word = |value: usize| {
            let mut out = Vec::new();
            if wide {
                put(&mut out, big, &[value as i64])
            } else {
                put(&mut out, big, &[value as u32])
            }
            out
        };
        let (head, body) = if part == 0 {
            (word(plain.len()), plain)
        } else {
            let packed = plain.chunks(part).map(|part| {
                let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
                encoder.write_all(part).unwrap();
                encoder.finish().unwrap()
            });
            let packed: Vec<Vec<u8>> = packed.collect();
            let mut head = [packed.len(), part, plain.len() % part].map(word).concat();
            head.extend(packed.iter().flat_map(|part| word(part.len())));
            (head, packed.concat())
        };
        let encoded = match (place, part) {
            (Place::AppendedRaw, _) => [head, body].concat(),
            (_, 0) => base64(&[head, body].concat()),
            _ => [base64(&head), base64(&body)].concat(),
        };
        if place == Place::Inline {
            let text = String::from_utf8(encoded).unwrap();
            self.text += &format!("\"binary\">\n  {text}\n</DataArray>\n");
        } else {
            self.text += &format!("\"appended\" offset=\"{}\"/>\n", self.appended.len());
            self.appended.extend(encoded);
        }
    }

    pub(super) fn piece(&mut self, points: &[[f32; 3]], velocities: &[[f32; 3]], ids: &[u32]) {
        let doubles: Vec<f64> = points.as_flattened().iter().map(|&x| f64::from(x)).collect();
        self.text +=
            &format!("<Piece NumberOfPoints=\"{}\" NumberOfCells=\"0\">\n<PointData>\n", points.len());
        self.array("velocity", "Float32", 3, velocities.as_flattened());
        self.array("id", "UInt32", 1, ids);
        self.array("level", "Int8", 1, &vec![3_u8; points.len()]);
        self.text += "</PointData>\n<CellData>\n";
        self.array("quality", "Float32", 1, &[1.0_f32]);
        self.text += "</CellData>\n<Points>\n";
        self.array("Points", "Float64", 3, &doubles);
        self.text += "</Points>\n<Cells>\n";
        self.array("connectivity", "Int64", 1, &[0_i64]);
        self.text += "</Cells>\n</Piece>\n";
    }

    pub(super) fn finish(mut self, kind: &str) -> Vec<u8> {
        self.text += &format!("</{kind}>\n");
        let encoding = match self.layout.place {
            Place::AppendedRaw => "raw",
            Place::AppendedBase64 => "base64",
            _ => return (self.text + "</VTKFile>\n").into_bytes(),
        };
        self.text += &format!("<AppendedData encoding=\"{encoding}\">\n_");
        [self.text.as_bytes(), &self.appended, b"\n</AppendedData>\n</VTKFile>\n"].concat()
    }
}

pub(super) fn vtu(layout: Layout) -> Vec<u8> {
    let mut file = Vtu::new(layout, "UnstructuredGrid");
    file.piece(&X, &V, &ID);
    file.finish("UnstructuredGrid")
}

#[test]
fn vtu_in_every_layout() {
    for layout in layouts() {
        let imported = import("a.vtu", &vtu(layout)).unwrap_or_else(|error| panic!("{layout:?}: {error}"));
        check(&imported);
        assert_eq!(imported.stream.u32("level").unwrap(), [3; 3]);
        assert_eq!(imported.ignored, ["quality: of the cells, not of the points"]);
        let mut parts = Vtu::new(layout, "PolyData");
        parts.piece(&X[..1], &V[..1], &ID[..1]);
        parts.piece(&[], &[], &[]);
        parts.piece(&X[1..], &V[1..], &ID[1..]);
        check(&import("a.vtp", &parts.finish("PolyData")).unwrap());
        let mut none = Vtu::new(layout, "PolyData");
        none.piece(&[], &[], &[]);
        let none = import("a.vtp", &none.finish("PolyData")).unwrap();
        assert!(none.stream.is_empty() && none.stream.vec3("velocity").is_some());
    }
}

#[test]
fn lengths_and_numbers_may_be_padded_apart() {
    // As some writers do it: the length in base64 of its own, though nothing is compressed.
    let layout = Layout { place: Place::Inline, big: false, wide: false, part: 0 };
    let mut bytes = Vec::new();
    put(&mut bytes, false, &[36_u32]);
    put(&mut bytes, false, V.as_flattened());
    let text = String::from_utf8(vtu(layout)).unwrap();
    let (together, apart) = (base64(&bytes), [base64(&bytes[..4]), base64(&bytes[4..])].concat());
    let [together, apart] = [together, apart].map(|text| String::from_utf8(text).unwrap());
    assert!(text.contains(&together));
    check(&import("a.vtu", text.replace(&together, &apart).as_bytes()).unwrap());
}

#[test]
fn an_attribute_that_a_piece_lacks_is_listed() {
    let layout = Layout { place: Place::Ascii, big: false, wide: false, part: 0 };
    let mut file = Vtu::new(layout, "UnstructuredGrid");
    file.piece(&X[..1], &V[..1], &ID[..1]);
    file.text += "<Piece NumberOfPoints=\"1\"><PointData>";
    file.array("id", "Float32", 1, &[1.0_f32]);
    file.array("velocity", "Float64", 3, &[1.0_f64; 3]);
    file.text += "</PointData><Points>";
    file.array("", "Float32", 3, &[1.0_f32; 3]);
    file.text += "</Points></Piece>";
    let imported = import("a.vtu", &file.finish("UnstructuredGrid")).unwrap();
    assert_eq!(imported.stream.len(), 2);
    assert_eq!(imported.stream.vec3("velocity").unwrap()[1], crate::math::Vec3::repeat(1.0));
    assert!(imported.ignored.contains(&"id: not in every piece".to_owned()), "{:?}", imported.ignored);
}

#[test]
fn broken_vtu_is_refused() {
    for layout in layouts() {
        let whole = vtu(layout);
        // Behind the last array of the points, a file may end as it likes.
        let end = match layout.place {
            Place::Ascii | Place::Inline => {
                whole.windows(9).position(|window| window == b"</Points>").unwrap() - 14
            }
            Place::AppendedBase64 | Place::AppendedRaw => {
                whole.windows(13).position(|window| window == b"<AppendedData").unwrap() + 24
            }
        };
        for length in (9..end).step_by(5) {
            assert!(import("a.vtu", &whole[..length]).is_err(), "{layout:?} cut to {length}");
        }
    }
    let ascii = Layout { place: Place::Ascii, big: false, wide: false, part: 0 };
    let with = |layout: Layout, from: &str, to: &str| {
        let whole = vtu(layout);
        let at = whole.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()
    };
    for layout in layouts() {
        let count = "NumberOfPoints=\"3\"";
        let message = broken("a.vtu", &with(layout, count, "NumberOfPoints=\"2147483648\""));
        assert!(message.contains("array Points at byte"), "{message}");
        broken("a.vtu", &with(layout, count, "NumberOfPoints=\"18446744073709551615\""));
        broken("a.vtu", &with(layout, count, "NumberOfPoints=\"2\""));
        broken("a.vtu", &with(layout, count, "NumberOfPoints=\"many\""));
    }
    assert!(broken("a.vtu", &with(ascii, "0.5", "half")).contains("found \"half\", expected number 0 of 9"));
    assert!(
        broken("a.vtu", &with(ascii, "Float32", "Float16")).contains("type \"Float16\" of array velocity")
    );
    assert!(broken("a.vtu", &with(ascii, "\"ascii\"", "\"morse\"")).contains("morse"));
    assert!(broken("a.vtu", &with(ascii, "<Points>", "<Dots>")).contains("well-formed"));
    assert!(broken("a.vtu", &with(ascii, "LittleEndian", "Middle")).contains("byte_order"));
    assert!(broken("a.vtu", &with(ascii, "UInt32", "UInt16")).contains("header_type"));
    let inline = Layout { place: Place::Inline, ..ascii };
    assert!(
        broken("a.vtu", &with(inline, "\"binary\"", "\"appended\" offset=\"0\"")).contains("AppendedData")
    );
    let raw = Layout { place: Place::AppendedRaw, ..ascii };
    assert!(broken("a.vtu", &with(raw, "offset=\"0\"", "offset=\"99999\"")).contains("offset 99999"));
    let unsupported = |from: &str, to: &str| match import("a.vtu", &with(ascii, from, to)) {
        Err(error @ ImportError::Unsupported { .. }) => error.to_string(),
        other => panic!("{from} {to}: {other:?}"),
    };
    assert!(unsupported("type=\"UnstructuredGrid\"", "type=\"ImageData\"").contains("ImageData"));
    assert!(unsupported(">\n<Unstr", " compressor=\"vtkLZ4DataCompressor\">\n<Unstr").contains("vtkLZ4"));
    assert!(matches!(import("a.vtu", b"<svg></svg>"), Err(ImportError::Unsupported { .. })));
}

#[test]
fn arrays_that_share_their_bytes_take_no_more_than_the_file() {
    let layout = Layout { place: Place::AppendedRaw, big: false, wide: false, part: 0 };
    let mut file = Vtu::new(layout, "PolyData");
    let count = 4000;
    file.text += &format!("<Piece NumberOfPoints=\"{count}\"><Points>");
    file.array("Points", "Float32", 3, &vec![0.5_f32; 3 * count]);
    file.text += "</Points><PointData>";
    for index in 0..20_000 {
        file.text += &format!(
            "<DataArray type=\"Float32\" Name=\"a{index}\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/>"
        );
    }
    file.text += "</PointData></Piece>";
    let why = damaged::read("a.vtp", &file.finish("PolyData")).unwrap_err().to_string();
    assert!(why.contains("arrays that do not overlap"), "{why}");
}

#[test]
fn a_bomb_is_cut_off_at_the_length_it_claims() {
    // In less than the longest part that is read for 36 bytes.
    let zeros = [0_u8; 200 << 10];
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&zeros).unwrap();
    let packed = encoder.finish().unwrap();
    assert!(packed.len() < 296, "{} bytes", packed.len());
    let mut bytes = Vec::new();
    put(&mut bytes, false, &[1, 36, 0, packed.len() as u32]);
    bytes.extend(packed);
    let layout = Layout { place: Place::AppendedRaw, big: false, wide: false, part: 1 };
    let mut file = Vtu::new(layout, "PolyData");
    file.text += "<Piece NumberOfPoints=\"3\"><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/></Points></Piece>";
    file.appended = bytes;
    assert!(broken("a.vtp", &file.finish("PolyData")).contains("found 37 bytes or more"));
}
