//! Files read back by `vdb-rs`, and the same files written out for OpenVDB to read: `tools/blender/tests/volumes.py` does that.

use super::*;
use crate::{
    grid::{BRICK, Bricks, NodeMask, SparseGrid, mask_of, offset},
    math::Vec3,
};
use std::{collections::BTreeSet, fs};

/// The folder that gets the files of [`every_case_reads_back`], if it is set; otherwise they are thrown away.
const KEEP: &str = "MENISCUS_VDB_DIR";

const EVERY: [(&str, VolumeParams); 6] = {
    const fn with(precision: Precision, compression: Compression) -> VolumeParams {
        VolumeParams { precision, compression }
    }
    [
        ("float_blosc", with(Precision::Float, Compression::Blosc)),
        ("float_zip", with(Precision::Float, Compression::Zip)),
        ("float_none", with(Precision::Float, Compression::None)),
        ("half_blosc", with(Precision::Half, Compression::Blosc)),
        ("half_zip", with(Precision::Half, Compression::Zip)),
        ("half_none", with(Precision::Half, Compression::None)),
    ]
};

/// Grids that own what they hold.
struct Case {
    name: &'static str,
    voxel: f32,
    bricks: Bricks,
    fog: Vec<f32>,
    fog_active: Vec<NodeMask>,
    distance: Vec<f32>,
    half_width: f32,
    near: Vec<NodeMask>,
    inside: Vec<[i32; 3]>,
    velocity: Vec<Vec3>,
}

impl Case {
    /// A case with fog and velocity where `fog` is above zero, and distances nearer than three voxels.
    fn new(
        name: &'static str,
        voxel: f32,
        bricks: Bricks,
        fog: impl Fn([i32; 3]) -> f32,
        distance: impl Fn([i32; 3]) -> f32,
    ) -> Self {
        let half_width = 3.0 * voxel;
        let nodes: Vec<[i32; 3]> = bricks
            .coords()
            .iter()
            .flat_map(|&coord| (0..BRICK_NODES).map(move |place| node_of(coord, place)))
            .collect();
        let fog: Vec<f32> = nodes.iter().map(|&node| fog(node)).collect();
        let distance: Vec<f32> = nodes.iter().map(|&node| distance(node)).collect();
        let velocity = fog
            .iter()
            .zip(&nodes)
            .map(|(v, n)| Vec3::new(v - 0.5, (n[1] % 100) as f32 / 7.0, -n[2] as f32 * 1e-6));
        Self {
            name,
            voxel,
            velocity: velocity.collect(),
            fog_active: masks(&fog, |v| v > 0.0),
            near: masks(&distance, |d| d.abs() < half_width),
            inside: Vec::new(),
            half_width,
            bricks,
            fog,
            distance,
        }
    }

    fn grids(&self) -> [Grid<'_>; 3] {
        let Self { voxel, bricks, half_width, .. } = self;
        let (voxel, half_width) = (*voxel, *half_width);
        let grid = |name, class, active| Grid { name, class, voxel, bricks, active };
        [
            grid("density", Class::FogVolume(&self.fog), &self.fog_active),
            grid(
                "surface",
                Class::LevelSet { values: &self.distance, half_width, inside: &self.inside },
                &self.near,
            ),
            grid("velocity", Class::Vector(&self.velocity), &self.fog_active),
        ]
    }

    /// What was written, for another program: active values, and for each grid its leaves, tiles that are inside and
    /// nodes in leaves that are inactive and inside.
    fn describe(&self) -> serde_json::Value {
        let grids = self.grids().map(|grid| {
            let nodes =
                |brick: usize| (0..BRICK_NODES).map(move |place| (place, brick * BRICK_NODES + place));
            let (mut active, mut minus, mut leaves) = (Vec::new(), Vec::new(), Vec::new());
            let mut tiles = self.inside.clone();
            for (brick, &coord) in grid.bricks.coords().iter().enumerate() {
                let inside = nodes(brick).filter(|&(_, index)| grid.class.is_inside(index)).count();
                match (grid.active[brick] != [0; 8], inside) {
                    (false, 0) => continue,
                    (false, BRICK_NODES) => tiles.push(coord),
                    _ => leaves.push(coord),
                }
                for (place, index) in nodes(brick).filter(|_| leaves.last() == Some(&coord)) {
                    let [i, j, k] = node_of(coord, place);
                    if is_set(&grid.active[brick], place) {
                        let parts = grid.class.components(index).into_iter().flatten();
                        active.push(serde_json::json!([i, j, k, parts.collect::<Vec<f32>>()]));
                    } else if grid.class.is_inside(index) {
                        minus.push([i, j, k]);
                    }
                }
            }
            let level_set = matches!(grid.class, Class::LevelSet { .. });
            let class = match grid.class {
                Class::FogVolume(_) => "fog volume",
                Class::LevelSet { .. } => "level set",
                Class::Vector(_) => "unknown",
            };
            serde_json::json!({
                "name": grid.name, "class": class, "voxel": grid.voxel, "background": grid.class.background(),
                "active": active, "minus": minus, "leaves": leaves,
                "tiles": if level_set { tiles } else { Vec::new() },
            })
        });
        serde_json::json!({ "name": self.name, "grids": grids })
    }
}

fn masks(values: &[f32], is_active: impl Fn(f32) -> bool) -> Vec<NodeMask> {
    values.chunks(BRICK_NODES).map(|values| mask_of(values, |&v| is_active(v))).collect()
}

/// Numbers in 0..1 that look random.
fn noise(node: [i32; 3]) -> f32 {
    let key = node
        .iter()
        .fold(7_u64, |key, &v| (key ^ v as u32 as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
    (key >> 40) as f32 / (1 << 24) as f32
}

fn cases() -> Vec<Case> {
    // A ball across the corners of eight upper nodes, thick enough to have bricks inside.
    let ball = SparseGrid::sample(0.1, Vec3::repeat(-2.4), Vec3::repeat(2.3), |x| x.norm() - 1.71);
    let value = |grid: &SparseGrid, node| grid.get(node).unwrap();
    let mut solid = Case::new(
        "ball",
        0.1,
        ball.bricks.clone(),
        |node| (0.2 - value(&ball, node)).clamp(0.0, 1.0),
        |node| value(&ball, node),
    );
    // Two bricks without values, one of them in a lower node of its own.
    solid.inside = vec![[100, 5, -7], [101, 5, -7]];

    let one = |name, node: [i32; 3]| {
        let bricks = Bricks::new(vec![node.map(|v| v.div_euclid(BRICK as i32))]);
        let at = move |other| if other == node { 0.25 } else { 0.0 };
        Case::new(name, 0.25, bricks, at, move |other| if other == node { -0.125 } else { 1.0 })
    };
    let corners: Vec<[i32; 3]> = (0..8)
        .map(|corner| [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { 1_000_000 } else { -1_000_000 }))
        .chain([[1 << 30, -(1 << 30), 0]])
        .collect();
    let far = Case::new(
        "far",
        0.5,
        Bricks::new(corners.iter().map(|c| c.map(|v| v.div_euclid(BRICK as i32))).collect()),
        |node| f32::from(corners.contains(&node)),
        |node| if corners.contains(&node) { 0.5 } else { 2.0 },
    );
    // Bricks that are full, half full and nearly empty, of numbers that do not pack; both sides in every leaf.
    let coords = (0..40).map(|i| [i * 7 % 23 - 11, i * 5 % 17 - 8, i % 37 * 3 - 50]).collect();
    let wild = [-0.0_f32, 1e-40, 6e-8, 1e-5, 65504.0, -65504.0, 2049.0, 0.1];
    let mixed = Case::new(
        "noise",
        1.0 / 3.0,
        Bricks::new(coords),
        |node| {
            let part = [0.0, 0.5, 0.97][node[2].div_euclid(8).rem_euclid(3) as usize];
            let value = noise(node) - part;
            if value > 0.3 { wild[(value * 1e4) as usize % 8].abs() } else { value.max(0.0) }
        },
        |node| 4.0 * noise(node) - 2.0,
    );
    vec![
        solid,
        Case::new("empty", 0.1, Bricks::default(), |_| 0.0, |_| 0.0),
        one("one", [0, 0, 0]),
        one("minus_one", [-1, -1, -1]),
        far,
        mixed,
    ]
}

#[test]
fn every_case_reads_back() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = std::env::var_os(KEEP).map_or(temporary.path().to_owned(), std::path::PathBuf::from);
    for case in cases() {
        fs::write(folder.join(format!("{}.json", case.name)), case.describe().to_string()).unwrap();
        for (kind, params) in EVERY {
            let path = folder.join(format!("{}_{kind}.vdb", case.name));
            let written = write(&case.grids(), &path, &params, 0xfeed).unwrap();
            assert_eq!(written.bytes, fs::metadata(&path).unwrap().len());
            let names = case.grids().iter().map(|grid| grid.name.to_owned()).collect();
            assert_eq!(made_from(&path), Some((0xfeed, names)));
            if params.precision == Precision::Float {
                read_back(&case, &path);
            }
        }
    }
}

/// Compares every active value with what `vdb-rs` reads.
fn read_back(case: &Case, path: &Path) {
    let mut reader = vdb_rs::VdbReader::new(fs::File::open(path).unwrap()).unwrap();
    for grid in case.grids().iter().filter(|grid| grid.class.width() == 1) {
        let read = reader.read_grid::<f32>(grid.name).unwrap();
        let found: BTreeSet<([i32; 3], u32)> = read
            .iter()
            .map(|(at, value, level)| {
                assert_eq!(level.scale(), 1.0, "no tile is active");
                ([at.x as i32, at.y as i32, at.z as i32], value.to_bits())
            })
            .collect();
        let mut written = BTreeSet::new();
        for (brick, &coord) in grid.bricks.coords().iter().enumerate() {
            for place in (0..BRICK_NODES).filter(|&place| is_set(&grid.active[brick], place)) {
                let value = grid.class.components(brick * BRICK_NODES + place)[0].unwrap();
                written.insert((node_of(coord, place), value.to_bits()));
            }
        }
        assert!(found == written, "{} of {}", grid.name, path.display());
        assert_eq!(read.descriptor.voxel_count().unwrap(), written.len() as i64);
        let low = [0, 1, 2].map(|axis| written.iter().map(|(node, _)| node[axis]).min());
        let min = read.descriptor.aabb_min().unwrap();
        assert_eq!(low.map(|low| low.unwrap_or(i32::MAX)), [min.x, min.y, min.z]);
    }
}

#[test]
fn equal_grids_give_equal_bytes_on_any_number_of_threads() {
    for case in cases() {
        let once =
            |threads| par::with_threads(threads, || encode(&case.grids(), &VolumeParams::default(), 1));
        let one = once(1);
        for threads in [2, 3, 8] {
            assert!(one == once(threads), "{} on {threads} threads", case.name);
        }
    }
}

#[test]
fn a_value_that_cannot_be_stored_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.vdb");
    let mut case = cases().pop().unwrap();
    let coord = case.bricks.coords()[3];
    let place = (0..BRICK_NODES).find(|&place| is_set(&case.fog_active[3], place)).unwrap();
    let params = |precision| VolumeParams { precision, ..VolumeParams::default() };
    for (value, precision, expected) in [
        (f32::NAN, Precision::Float, "a finite number"),
        (f32::NEG_INFINITY, Precision::Half, "a finite number"),
        (65520.0, Precision::Half, "65504"),
    ] {
        case.velocity[3 * BRICK_NODES + place].y = value;
        let why = write(&case.grids(), &path, &params(precision), 0).unwrap_err().to_string();
        let node = format!("node {:?} of grid `velocity`", node_of(coord, place));
        assert!(why.contains(&node) && why.contains(expected), "{why}");
        assert!(!path.exists());
    }
    write(&case.grids(), &path, &params(Precision::Float), 0).unwrap();

    // What is not active is not looked at.
    let idle = (0..BRICK_NODES).find(|&place| !is_set(&case.fog_active[3], place)).unwrap();
    case.velocity[3 * BRICK_NODES + idle].y = f32::NAN;
    write(&case.grids(), &path, &params(Precision::Float), 0).unwrap();
}

#[test]
fn half_floats_take_half_the_bytes_and_empty_space_none() {
    let solid = &cases()[0];
    let size = |precision, compression| {
        encode(&solid.grids(), &VolumeParams { precision, compression }, 0).len() as f64
    };
    let float = size(Precision::Float, Compression::None);
    let half = size(Precision::Half, Compression::None);
    let packed = size(Precision::Half, Compression::Blosc);
    let zipped = size(Precision::Half, Compression::Zip);
    println!("bytes: float {float}, half {half}, with blosc {packed}, with zip {zipped}");
    // Masks, most of them of eight upper nodes, take a third of the smaller file.
    assert!(half < 0.7 * float && packed < half && zipped < half);
    assert!(encode(&cases()[1].grids(), &VolumeParams::default(), 0).len() < 2000);
}

#[test]
fn masks_turn_into_the_order_of_the_file() {
    // The node one step along z is the second of the file, the one along x the 65th.
    let mut mask = [0; 8];
    for local in [[0, 0, 1], [1, 0, 0]] {
        mask[offset(local) / 64] |= 1 << (offset(local) % 64);
    }
    let bytes = leaf::mask_bytes(&mask);
    assert_eq!((bytes[0], bytes[8]), (2, 1));
    assert_eq!(bytes.iter().map(|byte| byte.count_ones()).sum::<u32>(), 2);
}

#[test]
fn other_files_are_made_from_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("volume.vdb");
    assert_eq!(made_from(&path), None);
    for text in ["", "not a volume, but longer than the head of one".repeat(9).as_str()] {
        fs::write(&path, text).unwrap();
        assert_eq!(made_from(&path), None);
    }
}
