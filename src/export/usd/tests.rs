//! Layers are read back by a small reader of their own, written from the description of the format.

use super::{
    compress::{decompress, decompress_integers, max_encoded},
    geometry::{GeometryFault, GeometryRemarks},
    *,
};
use crate::{
    frame::{Channel, ChannelData},
    import::Geometry,
    math::Vec3,
    mesh::Mesh,
};
use std::{collections::BTreeMap, io};

/// A layer that was read: the fields of each path.
struct Read {
    bytes: Vec<u8>,
    tokens: Vec<String>,
    specs: BTreeMap<String, (i32, BTreeMap<String, u64>)>,
}

fn word(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
}

impl Read {
    fn new(bytes: Vec<u8>) -> Self {
        assert_eq!(&bytes[..12], b"PXR-USDC\x00\x08\x00\x00");
        let contents = word(&bytes, 16) as usize;
        let count = word(&bytes, contents) as usize;
        assert_eq!(contents + 8 + 32 * count, bytes.len(), "the file ends with its contents");
        let mut sections = BTreeMap::new();
        for entry in bytes[contents + 8..].chunks_exact(32) {
            let name =
                String::from_utf8(entry[..16].iter().copied().take_while(|&b| b != 0).collect()).unwrap();
            let (start, size) = (word(entry, 16) as usize, word(entry, 24) as usize);
            sections.insert(name, bytes[start..start + size].to_vec());
        }
        let text = &sections["TOKENS"];
        let text = decompress(&text[24..], word(text, 8) as usize);
        let tokens: Vec<String> =
            text.split(|&b| b == 0).map(|token| String::from_utf8(token.to_vec()).unwrap()).collect();
        // A column of integers after its size.
        fn column(bytes: &[u8], at: &mut usize, count: usize) -> Vec<i32> {
            let size = word(bytes, *at) as usize;
            *at += 8 + size;
            decompress_integers(&bytes[*at - size..*at], count)
        }
        let fields = &sections["FIELDS"];
        let (count, mut at) = (word(fields, 0) as usize, 8);
        let names = column(fields, &mut at, count);
        let values = decompress(&fields[at + 8..], max_encoded(2 * count));
        let sets = &sections["FIELDSETS"];
        let sets = column(sets, &mut 8, word(sets, 0) as usize);
        let paths = &sections["PATHS"];
        let (count, mut at) = (word(paths, 8) as usize, 16);
        let [indices, elements, jumps] = [0; 3].map(|_| column(paths, &mut at, count));
        let mut texts = vec![String::new(); count];
        fn walk(
            at: &mut usize,
            parent: &str,
            columns: (&[i32], &[i32], &[i32]),
            tokens: &[String],
            texts: &mut [String],
        ) {
            loop {
                let (start, jump) = (*at, columns.2[*at]);
                let element = columns.1[start];
                let path = match (parent, element) {
                    ("", _) => "/".to_owned(),
                    ("/", _) => format!("/{}", tokens[element as usize]),
                    (_, property @ ..0) => format!("{parent}.{}", tokens[-property as usize]),
                    _ => format!("{parent}/{}", tokens[element as usize]),
                };
                texts[columns.0[start] as usize] = path.clone();
                *at += 1;
                if jump > 0 || jump == -1 {
                    walk(at, &path, columns, tokens, texts);
                }
                if jump > 0 {
                    assert_eq!(*at, start + jump as usize, "the jump leads to the sibling");
                }
                if jump < 0 {
                    return;
                }
            }
        }
        walk(&mut 0, "", (&indices, &elements, &jumps), &tokens, &mut texts);
        let specs = &sections["SPECS"];
        let (count, mut at) = (word(specs, 0) as usize, 8);
        let [of, first, kinds] = [0; 3].map(|_| column(specs, &mut at, count));
        let mut read = BTreeMap::new();
        for spec in 0..count {
            let set = sets[first[spec] as usize..].iter().take_while(|&&field| field >= 0);
            let fields = set.map(|&field| {
                let value = word(&values, 8 * field as usize);
                (tokens[names[field as usize] as usize].clone(), value)
            });
            let known = read.insert(texts[of[spec] as usize].clone(), (kinds[spec], fields.collect()));
            assert!(known.is_none(), "each path has one spec");
        }
        Self { bytes, tokens, specs: read }
    }

    fn field(&self, path: &str, name: &str) -> u64 {
        let (_, fields) = self.specs.get(path).unwrap_or_else(|| panic!("{path} of {:?}", self.specs.keys()));
        *fields.get(name).unwrap_or_else(|| panic!("{path} has no {name}: {:?}", fields.keys()))
    }

    fn token(&self, path: &str, name: &str) -> &str {
        let value = self.field(path, name);
        assert_eq!(value >> 48, 0x400B, "an inlined token");
        &self.tokens[(value & 0xFFFF_FFFF) as usize]
    }

    /// The times of an attribute, and the value at each.
    fn samples(&self, path: &str) -> (Vec<f64>, Vec<u64>) {
        let value = self.field(path, "timeSamples");
        assert_eq!(value >> 48, 46);
        let at = (value & 0xFFFF_FFFF_FFFF) as usize;
        let times = at + word(&self.bytes, at) as usize;
        let times_at = (word(&self.bytes, times) & 0xFFFF_FFFF_FFFF) as usize;
        let count = word(&self.bytes, times_at) as usize;
        let time = |i: usize| f64::from_bits(word(&self.bytes, times_at + 8 + 8 * i));
        let values = times + 8 + word(&self.bytes, times + 8) as usize;
        assert_eq!(word(&self.bytes, values) as usize, count);
        let value = |i: usize| word(&self.bytes, values + 8 + 8 * i);
        ((0..count).map(time).collect(), (0..count).map(value).collect())
    }

    /// The array that a value is, as its bytes and its number of elements.
    fn array(&self, value: u64, kind: u64, size: usize) -> (&[u8], usize) {
        assert_eq!(value >> 48 & 0xFF, kind);
        assert!(value >> 63 == 1 && value >> 62 & 1 == 0, "an array");
        let at = (value & 0xFFFF_FFFF_FFFF) as usize;
        if at == 0 {
            return (&[], 0);
        }
        assert_eq!(at % 8, 0);
        let count = word(&self.bytes, at) as usize;
        (&self.bytes[at + 8..at + 8 + count * size], count)
    }

    fn vectors(&self, value: u64) -> Vec<[f32; 3]> {
        let (bytes, _) = self.array(value, 24, 12);
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        bytes.chunks_exact(12).map(|v| [number(&v[..4]), number(&v[4..8]), number(&v[8..])]).collect()
    }

    fn integers(&self, value: u64) -> Vec<i32> {
        if value >> 61 & 1 == 0 {
            let (bytes, _) = self.array(value, 3, 4);
            return bytes.chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
        }
        let at = (value & 0xFFFF_FFFF_FFFF) as usize;
        let size = word(&self.bytes, at + 8) as usize;
        decompress_integers(&self.bytes[at + 16..at + 16 + size], word(&self.bytes, at) as usize)
    }
}

fn channel(name: &str, data: impl Into<ChannelData>) -> Channel {
    Channel { name: name.into(), data: data.into() }
}

/// A strip of so many vertices with every kind of column.
fn strip(vertices: u32) -> Geometry {
    let at = |i: u32| Vec3::new(i as f32, (i % 2) as f32, 0.25 * i as f32);
    let places: Vec<Vec3> = (0..vertices).map(at).collect();
    Geometry {
        normals: Some(vec![Vec3::z(); vertices as usize]),
        triangles: Some((2..vertices).map(|i| [i - 2, i - 1, i]).collect()),
        attributes: vec![
            channel("velocity", places.iter().map(|x| 2.0 * x).collect::<Vec<_>>()),
            channel("vorticity", places.clone()),
            channel("age", (0..vertices).map(|i| i as f32).collect::<Vec<_>>()),
            channel("source", (0..vertices).collect::<Vec<_>>()),
        ],
        positions: places,
        is_rounded: false,
    }
}

fn settings(up: UpAxis, scale: f64) -> LayerSettings {
    LayerSettings { space: StageSpace { up, scale }, fps: 25.0 }
}

fn read_layer(geometry: &Geometry, settings: &LayerSettings, names: NameScheme) -> Read {
    let layer = GeometryLayer::new(geometry, settings, names, 7, ("mesh", "liquid")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdc");
    let written = layer.write(&path).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(written.bytes, bytes.len() as u64);
    Read::new(bytes)
}

#[test]
fn a_mesh_is_read_back_with_every_column_at_its_frame() {
    let geometry = strip(40);
    let read = read_layer(&geometry, &settings(UpAxis::Z, 1.0), NameScheme::Usd);
    assert_eq!(read.token("/", "defaultPrim"), "mesh");
    assert_eq!(read.token("/", "upAxis"), "Z");
    assert_eq!(read.token("/mesh", "typeName"), "Scope");
    assert_eq!(read.token("/mesh/liquid", "typeName"), "Mesh");
    assert_eq!(read.token("/mesh/liquid.subdivisionScheme", "default"), "none");
    assert_eq!(read.token("/mesh/liquid.primvars:age", "interpolation"), "vertex");
    assert_eq!(read.token("/mesh/liquid.velocities", "typeName"), "vector3f[]");
    let one = |name: &str| {
        let (times, values) = read.samples(&format!("/mesh/liquid.{name}"));
        assert_eq!(times, [7.0], "{name}");
        values[0]
    };
    let arrays = |values: &[Vec3]| values.iter().map(|&v| v.into()).collect::<Vec<[f32; 3]>>();
    assert_eq!(read.vectors(one("points")), arrays(&geometry.positions));
    assert_eq!(read.vectors(one("extent")), [[0.0; 3], [39.0, 1.0, 9.75]]);
    assert_eq!(read.vectors(one("normals")), [[0.0, 0.0, 1.0]; 40]);
    let ChannelData::Vec3(velocity) = &geometry.attributes[0].data else { unreachable!() };
    assert_eq!(read.vectors(one("velocities")), arrays(velocity));
    assert_eq!(read.vectors(one("primvars:vorticity")), arrays(&geometry.positions));
    assert_eq!(read.integers(one("faceVertexCounts")), [3; 38]);
    let corners: Vec<i32> = (2..40).flat_map(|i| [i - 2, i - 1, i]).collect();
    assert_eq!(read.integers(one("faceVertexIndices")), corners);
    assert_eq!(read.integers(one("primvars:source")), (0..40).collect::<Vec<i32>>());
    let (age, count) = read.array(one("primvars:age"), 8, 4);
    assert_eq!((count, &age[4..8]), (40, 1.0_f32.to_le_bytes().as_slice()));
}

#[test]
fn lengths_are_scaled_and_directions_are_turned() {
    let read = read_layer(&strip(3), &settings(UpAxis::Y, 100.0), NameScheme::Maya);
    assert_eq!(read.token("/", "upAxis"), "Y");
    let meters = (read.field("/", "metersPerUnit") & 0xFFFF_FFFF_FFFF) as usize;
    assert_eq!(f64::from_bits(word(&read.bytes, meters)), 0.01);
    let one = |name: &str| read.vectors(read.samples(&format!("/mesh/liquid.{name}")).1[0]);
    assert_eq!(one("points")[1], [100.0, 25.0, -100.0]);
    assert_eq!(one("velocities")[1], [200.0, 50.0, -200.0]);
    assert_eq!(one("normals")[1], [0.0, 1.0, 0.0]);
    assert_eq!(one("primvars:vorticity")[1], [1.0, 0.25, -1.0], "no length");
    // The name of another program shares the values.
    let value = |name: &str| read.samples(&format!("/mesh/liquid.{name}")).1[0];
    assert_eq!(value("primvars:velocityPV"), value("velocities"));
    assert_eq!(read.token("/mesh/liquid.primvars:velocityPV", "typeName"), "color3f[]");
}

#[test]
fn points_have_widths_ids_and_a_box_around_them() {
    let geometry = Geometry {
        positions: vec![Vec3::new(1.0, 2.0, 3.0), Vec3::zeros()],
        attributes: vec![
            channel("radius", vec![0.5_f32, 0.25]),
            channel("id", vec![7_u32, u32::MAX]),
            channel("kind", vec![1_u32, u32::MAX]),
        ],
        ..Geometry::default()
    };
    let read = read_layer(&geometry, &settings(UpAxis::Z, 2.0), NameScheme::Houdini);
    let value = |name: &str| read.samples(&format!("/mesh/liquid.{name}")).1[0];
    assert_eq!(read.token("/mesh/liquid", "typeName"), "Points");
    let (widths, _) = read.array(value("widths"), 8, 4);
    assert_eq!(widths, [2.0_f32, 1.0].map(f32::to_le_bytes).as_flattened());
    let (pscale, _) = read.array(value("primvars:pscale"), 8, 4);
    assert_eq!(pscale, [1.0_f32, 0.5].map(f32::to_le_bytes).as_flattened());
    let (ids, _) = read.array(value("ids"), 5, 8);
    assert_eq!(ids, [7_i64, u32::MAX.into()].map(i64::to_le_bytes).as_flattened());
    assert_eq!(read.vectors(value("extent")), [[-0.5; 3], [3.0, 5.0, 7.0]]);
    let layer =
        GeometryLayer::new(&geometry, &settings(UpAxis::Z, 1.0), NameScheme::Usd, 1, ("a", "b")).unwrap();
    assert_eq!(layer.remarks, GeometryRemarks { not_finite: 0, wrapped: 1 });
}

#[test]
fn an_empty_frame_has_all_columns_without_values() {
    let read = read_layer(&strip(0), &settings(UpAxis::Y, 100.0), NameScheme::Houdini);
    for name in ["points", "velocities", "normals", "primvars:v", "primvars:N"] {
        assert_eq!(read.vectors(read.samples(&format!("/mesh/liquid.{name}")).1[0]).len(), 0, "{name}");
    }
    assert_eq!(read.integers(read.samples("/mesh/liquid.faceVertexIndices").1[0]), [0; 0]);
    let extent = read.vectors(read.samples("/mesh/liquid.extent").1[0]);
    assert!(extent[0][0] > extent[1][0], "as OpenUSD computes it");
}

#[test]
fn places_that_are_not_finite_are_refused_and_values_are_counted() {
    let mut geometry = strip(4);
    let make = |geometry: &Geometry, scale| {
        GeometryLayer::new(geometry, &settings(UpAxis::Z, scale), NameScheme::Usd, 1, ("a", "b"))
            .map(|layer| layer.remarks)
    };
    geometry.attributes[2] = channel("age", vec![f32::NAN, 0.0, f32::INFINITY, 1.0]);
    assert_eq!(make(&geometry, 1.0).unwrap(), GeometryRemarks { not_finite: 2, wrapped: 0 });
    geometry.positions[2].y = 1e36;
    assert!(make(&geometry, 1.0).is_ok());
    assert_eq!(make(&geometry, 1e4).unwrap_err(), GeometryFault::NotFinite { vertex: 2 });
    geometry.positions[1].x = f32::NAN;
    assert_eq!(make(&geometry, 1.0).unwrap_err(), GeometryFault::NotFinite { vertex: 1 });
}

#[test]
fn attributes_of_any_name_are_identifiers_and_unique() {
    let mut geometry = strip(3);
    let odd =
        ["v", "a b", "a-b", "\"]\n", "velocityPV", "points", "2nd", "colour", "Cd", "velocity", "normals"];
    geometry.attributes.extend(odd.map(|name| channel(name, vec![Vec3::zeros(); 3])));
    for scheme in NameScheme::ALL {
        let names: Vec<String> =
            attributes(&geometry, scheme).into_iter().map(|attribute| attribute.name).collect();
        let unique: std::collections::BTreeSet<&String> = names.iter().collect();
        assert_eq!(unique.len(), names.len(), "{names:?}");
        let plain = |c: char| c.is_ascii_alphanumeric() || "_:".contains(c);
        assert!(names.iter().all(|name| name.chars().all(plain)), "{names:?}");
        assert!(names.contains(&"primvars:displayColor".to_owned()));
    }
    let names: Vec<String> =
        attributes(&geometry, NameScheme::Houdini).into_iter().map(|attribute| attribute.name).collect();
    assert!(names.contains(&"primvars:v".into()) && names.contains(&"primvars:v_2".into()), "{names:?}");
    for name in ["velocities", "primvars:velocity", "primvars:Cd", "primvars:Cd_2", "primvars:normals_2"] {
        assert_eq!(names.iter().filter(|known| *known == name).count(), 1, "{name}: {names:?}");
    }
    // Values of the second columns are their own.
    let mut points = Geometry { positions: vec![Vec3::zeros()], ..Geometry::default() };
    points.attributes = vec![
        channel("radius", vec![Vec3::x()]),
        channel("radius", vec![0.5_f32]),
        channel("id", vec![7_u32]),
    ];
    let read = read_layer(&points, &settings(UpAxis::Z, 1.0), NameScheme::Usd);
    let (_, extent) = read.samples("/mesh/liquid.extent");
    assert_eq!(read.vectors(extent[0]), [[-0.5; 3], [0.5; 3]], "a vector of the same name");
    read_layer(&geometry, &settings(UpAxis::Z, 1.0), NameScheme::Houdini);
}

/// A mesh that deforms and moves in three frames.
fn animated(mesh: &Mesh, samples: usize, fails: bool) -> io::Result<Vec<u8>> {
    let turn = 0.5_f32.sqrt();
    let pose = |x: f32| [x, 2.0, 3.0, turn, 0.0, 0.0, turn];
    let poses = Poses { first: 5, poses: vec![pose(0.0), pose(1.0)], scales: Some(vec![1.0, 2.0]) };
    let points = Some(PointSamples { first: 4.0, step: 1.0, count: samples, is_smooth: true });
    let animated = AnimatedMesh { path: ("collider", "box"), mesh, points, poses: Some(&poses) };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdc");
    let sample = |number: usize| {
        let count = if fails && number == 1 { 1 } else { mesh.positions.len() };
        Ok(mesh.positions.iter().take(count).map(|x| x + Vec3::new(number as f32, 0.0, 0.0)).collect())
    };
    let written = animated.write(&settings(UpAxis::Y, 10.0), &path, sample);
    assert_eq!(written.is_ok(), path.exists(), "whole or not at all");
    written.map(|_| std::fs::read(&path).unwrap())
}

#[test]
fn a_mesh_that_moves_has_samples_of_points_and_of_transforms() {
    let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let read = Read::new(animated(&mesh, 3, false).unwrap());
    let (times, points) = read.samples("/collider/box.points");
    assert_eq!(times, [4.0, 5.0, 6.0]);
    assert_eq!(read.vectors(points[2]), [[20.0, 0.0, 0.0], [30.0, 0.0, 0.0], [20.0, 0.0, -10.0]]);
    let (_, extents) = read.samples("/collider/box.extent");
    assert_eq!(read.vectors(extents[2]), [[20.0, 0.0, -10.0], [30.0, 0.0, 0.0]]);
    let (_, normals) = read.samples("/collider/box.normals");
    assert_eq!(read.vectors(normals[1]), [[0.0, 1.0, 0.0]; 3]);
    let (times, places) = read.samples("/collider/box.xformOp:translate");
    assert_eq!(times, [5.0, 6.0]);
    let at = (places[1] & 0xFFFF_FFFF_FFFF) as usize;
    let place = [0, 8, 16].map(|i| f64::from_bits(word(&read.bytes, at + i)));
    assert_eq!(place, [10.0, 30.0, -20.0]);
    let (_, turns) = read.samples("/collider/box.xformOp:orient");
    let at = (turns[0] & 0xFFFF_FFFF_FFFF) as usize;
    let turn = [0, 4, 8, 12].map(|i| f32::from_le_bytes(read.bytes[at + i..at + i + 4].try_into().unwrap()));
    // Imaginary parts first: a turn about Z is one about Y.
    assert_eq!(turn.map(|c| c + 0.0), [0.0, 0.5_f32.sqrt(), 0.0, 0.5_f32.sqrt()]);
    assert_eq!(read.token("/", "upAxis"), "Y");
}

#[test]
fn a_solid_that_deforms_has_normals_of_corners_in_each_sample() {
    let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
    let deforming = |triangles: Vec<[u32; 3]>| {
        let mesh = Mesh { positions: positions.clone(), triangles, ..Mesh::default() };
        let points = Some(PointSamples { first: 1.0, step: 1.0, count: 2, is_smooth: false });
        let animated = AnimatedMesh { path: ("collider", "fish"), mesh: &mesh, points, poses: None };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.usdc");
        let turned = |number: usize| if number == 0 { positions.clone() } else { turn(&positions) };
        animated.write(&settings(UpAxis::Z, 1.0), &path, |number| Ok(turned(number))).unwrap();
        Read::new(std::fs::read(&path).unwrap())
    };
    let read = deforming(vec![[0, 1, 2], [2, 1, 0]]);
    assert_eq!(read.token("/collider/fish.normals", "interpolation"), "faceVarying");
    let (_, normals) = read.samples("/collider/fish.normals");
    assert_eq!(
        read.vectors(normals[0]),
        [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]].map(|normal| [normal; 3]).concat()
    );
    assert_eq!(read.vectors(normals[1])[..3], [[1.0, 0.0, 0.0]; 3]);
    let (_, extents) = read.samples("/collider/fish.extent");
    assert_eq!(read.vectors(extents[1]), [[0.0; 3], [0.0, 1.0, 1.0]]);
    // Without faces there are no normals, and the arrays after them are where they should be.
    let (read, second) = (deforming(Vec::new()), turn(&positions));
    let (_, points) = read.samples("/collider/fish.points");
    assert_eq!(read.vectors(points[1]), second.iter().map(|&x| x.into()).collect::<Vec<[f32; 3]>>());
}

/// Positions with x as y, y as z and z as x.
fn turn(positions: &[Vec3]) -> Vec<Vec3> {
    positions.iter().map(|x| Vec3::new(x.z, x.x, x.y)).collect()
}

#[test]
fn a_mesh_at_rest_that_is_too_far_in_units_of_the_stage_is_refused() {
    let positions = vec![Vec3::zeros(), Vec3::x() * 1e36, Vec3::y()];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let animated = AnimatedMesh { path: ("collider", "box"), mesh: &mesh, points: None, poses: None };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.usdc");
    let write = |scale| animated.write(&settings(UpAxis::Y, scale), &path, |_| unreachable!("at rest"));
    let error = write(1e4).unwrap_err();
    assert!(error.kind() == io::ErrorKind::InvalidData && error.to_string().contains("vertex 1"), "{error}");
    assert!(!path.exists() && write(1.0).is_ok());
}

#[test]
fn samples_of_other_lengths_leave_no_file() {
    let positions = vec![Vec3::zeros(), Vec3::x(), Vec3::y()];
    let mesh = Mesh { positions, triangles: vec![[0, 1, 2]], ..Mesh::default() };
    let error = animated(&mesh, 3, true).unwrap_err();
    assert!(error.to_string().contains("sample 1 has 1 vertices, expected 3"), "{error}");
    assert!(animated(&Mesh::default(), 3, false).is_ok(), "no vertices");
}

#[test]
fn a_stage_quotes_titles_and_joins_layers() {
    let geometry = strip(3);
    let clips = Content::Clips {
        schema: "Mesh",
        attributes: attributes(&geometry, NameScheme::Usd),
        files: vec![(3, "mesh-liquid_0003.usdc".into()), (9, "mesh-liquid_0009.usdc".into())],
    };
    let layer = Content::Layer { file: "collider-box.usdc".into(), is_hidden: true };
    let member =
        |group: &str, name: &str, content| Member { group: group.into(), name: name.into(), content };
    let members = group_members(vec![
        member("mesh", "liquid", clips.clone()),
        member("collider", "box", layer),
        member("mesh", "other", clips),
    ]);
    assert_eq!(
        members.iter().map(|member| member.name.as_str()).collect::<Vec<_>>(),
        ["liquid", "other", "box"]
    );
    let camera = StageCamera { position: [0.0, 0.0, 5.0], target: [0.0; 3], focal_length: 50.0 };
    let stage = Stage {
        title: "A \"title\" \\ of\n\u{1b}two lines",
        settings: settings(UpAxis::Y, 100.0),
        frames: (3, 9),
        camera: Some(camera),
        members: &members,
    };
    let root = stage.root();
    for part in [
        "doc = \"A \\\"title\\\" \\\\ of  two lines\"",
        "metersPerUnit = 0.01",
        "double2[] active = [(3, 0), (9, 1)]",
        "double2[] times = [(3, 3), (9, 9)]",
        "prepend references = @./collider-box.usdc@</collider/box>",
        "token visibility = \"invisible\"",
        "float[] primvars:age (",
        "float focalLength = 50\n",
        "float horizontalAperture = 36\n",
        // It looks straight down.
        "((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 500, 0, 1))",
    ] {
        assert!(root.replace("( (", "((").replace(") )", "))").contains(part), "{part}\n{root}");
    }
    let manifest = stage.manifest();
    assert!(
        manifest.contains("over \"liquid\"\n    {\n        point3f[] points\n")
            && !manifest.contains("box\"\n    {")
    );
}
