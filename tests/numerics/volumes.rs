//! Level sets written, read again and meshed; files that are not what they should be.

use meniscus::{
    export::vdb::{self, Class, Compression, Grid, Precision, VolumeParams},
    grid::{BRICK_NODES, Bricks, NodeMask, SparseGrid, mask_of, node_of},
    import::read_level_set,
    math::Vec3,
    mesh,
};
use std::{fs, path::Path};

/// A level set of three voxels' half width, of some signed distance.
struct Surface {
    grid: SparseGrid,
    active: Vec<NodeMask>,
    inside: Vec<[i32; 3]>,
}

impl Surface {
    fn new(voxel: f32, size: f32, distance: impl Fn(Vec3) -> f32 + Sync) -> Self {
        let band = 3.0 * voxel;
        let whole = SparseGrid::sample(voxel, Vec3::repeat(-size), Vec3::repeat(size), distance);
        // Bricks beyond the band are left out, as the surfacer does.
        let near = |brick: usize| whole.brick(brick).iter().any(|v| v.abs() < band);
        let coords = |wanted: &dyn Fn(usize) -> bool| -> Vec<[i32; 3]> {
            (0..whole.bricks.len()).filter(|&b| wanted(b)).map(|b| whole.bricks.coords()[b]).collect()
        };
        let inside = coords(&|brick| !near(brick) && whole.brick(brick)[0] < 0.0);
        let mut grid = SparseGrid::new(voxel, Bricks::new(coords(&near)), 0.0);
        for index in 0..grid.values.len() {
            let node = node_of(grid.bricks.coords()[index / BRICK_NODES], index % BRICK_NODES);
            grid.values[index] = whole.get(node).unwrap().clamp(-band, band);
        }
        let active = grid.values.chunks(BRICK_NODES).map(|v| mask_of(v, |v| v.abs() < band)).collect();
        Self { grid, active, inside }
    }

    fn ball() -> Self {
        Self::new(0.1, 2.2, |x| (x - Vec3::new(0.03, 0.01, -0.04)).norm() - 1.7)
    }

    fn write(&self, path: &Path, precision: Precision, compression: Compression) {
        let SparseGrid { voxel, bricks, values, .. } = &self.grid;
        let class = Class::LevelSet { values, half_width: 3.0 * voxel, inside: &self.inside };
        let fog = vec![NodeMask::default(); bricks.len()];
        let grids = [
            Grid { name: "density", class: Class::FogVolume(values), voxel: *voxel, bricks, active: &fog },
            Grid { name: "surface", class, voxel: *voxel, bricks, active: &self.active },
        ];
        vdb::write(&grids, path, &VolumeParams { precision, compression }, 0).unwrap();
    }
}

#[test]
fn a_level_set_reads_back_and_becomes_a_closed_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.vdb");
    let ball = Surface::ball();
    assert!(!ball.inside.is_empty());
    for compression in [Compression::Blosc, Compression::Zip, Compression::None] {
        ball.write(&path, Precision::Float, compression);
        let read = read_level_set(&path).unwrap();
        assert_eq!((read.name.as_str(), read.origin, read.grid.voxel), ("surface", Vec3::zeros(), 0.1));
        assert_eq!(read.grid.bricks.coords(), ball.grid.bricks.coords());
        assert!(read.grid.values == ball.grid.values, "{compression:?}");
    }
    let (mesh, stats) = mesh::marching_cubes(&read_level_set(&path).unwrap().grid);
    let check = mesh::check(&mesh);
    assert!(check.is_sound() && check.components == 1 && stats.cut_cells == 0, "{check:?} {stats:?}");
    let exact = 4.0 / 3.0 * std::f64::consts::PI * 1.7_f64.powi(3);
    assert!((check.volume / exact - 1.0).abs() < 0.003, "{} of {exact}", check.volume);
}

#[test]
fn of_several_level_sets_the_one_named_surface_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.vdb");
    let ball = Surface::ball();
    let SparseGrid { bricks, values, .. } = &ball.grid;
    let write = |second: &str| {
        let grid = |name, voxel| {
            let class = Class::LevelSet { values, half_width: 0.3, inside: &ball.inside };
            Grid { name, class, voxel, bricks, active: &ball.active }
        };
        let params = VolumeParams { precision: Precision::Float, compression: Compression::Zip };
        vdb::write(&[grid("coarse", 0.2), grid(second, 0.1)], &path, &params, 0).unwrap();
        read_level_set(&path)
    };
    let read = write("surface").unwrap();
    assert_eq!((read.name.as_str(), read.grid.voxel), ("surface", 0.1));
    let why = write("fine").unwrap_err().to_string();
    assert!(why.contains("coarse, fine") && why.contains("named `surface`"), "{why}");
}

/// What refuses the bytes, or nothing.
fn refusal(folder: &Path, bytes: &[u8]) -> String {
    let path = folder.join("changed.vdb");
    fs::write(&path, bytes).unwrap();
    read_level_set(&path).map_or_else(|why| why.to_string(), |_| String::new())
}

/// The bytes with `old` replaced by `new`, of equal length, wherever it is.
fn replaced(bytes: &[u8], old: &str, new: &str) -> Vec<u8> {
    assert_eq!(old.len(), new.len());
    let mut bytes = bytes.to_vec();
    let places: Vec<usize> =
        (0..bytes.len() - old.len()).filter(|&at| &bytes[at..at + old.len()] == old.as_bytes()).collect();
    assert!(!places.is_empty(), "{old}");
    for at in places {
        bytes[at..at + new.len()].copy_from_slice(new.as_bytes());
    }
    bytes
}

#[test]
fn unreadable_volumes_are_refused_with_a_message() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.vdb");
    let ball = Surface::ball();
    ball.write(&path, Precision::Half, Compression::Blosc);
    let half = fs::read(&path).unwrap();
    ball.write(&path, Precision::Float, Compression::Blosc);
    let good = fs::read(&path).unwrap();
    assert_eq!(refusal(folder.path(), &good), "");

    let version = |number: u8| [&good[..8], &[number], &good[9..]].concat();
    let stream = [&good[..20], &[0], &good[21..]].concat();
    for (bytes, expected) in [
        (half, "half floats"),
        (b"ply\nformat ascii 1.0\n".to_vec(), "another kind of file"),
        (Vec::new(), "an empty file"),
        (version(213), "version 213"),
        (version(99), "version 99"),
        (stream, "without places"),
        (replaced(&good, "level set", "fog volum"), "of class"),
        (replaced(&good, "Tree_float_5_4_3", "Tree_vec3s_5_4_3"), "Tree_vec3s"),
        (replaced(&good, "UniformScaleMap", "NonlinearFrustu"), "NonlinearFrustu"),
        (replaced(&good, "density", "surface"), "two grids"),
        (good[..good.len() - 1].to_vec(), "the end of a grid at byte"),
    ] {
        let why = refusal(folder.path(), &bytes);
        assert!(why.contains(expected) && why.contains("changed.vdb"), "{expected}: {why:?}");
    }
    // A node that is not where nodes can be.
    let root = good.windows(20).position(|words| {
        let word = |at: usize| i32::from_le_bytes(words[at..at + 4].try_into().unwrap());
        [word(0), word(4)] == [0, 8] && [8, 12, 16].iter().all(|&at| word(at) == -4096)
    });
    let root = root.unwrap() + 8;
    let moved = [&good[..root], &4_i32.to_le_bytes(), &good[root + 4..]].concat();
    assert!(refusal(folder.path(), &moved).contains("multiples of 4096"));
    // A distance that is not a number is named by its node.
    let mut wild = Surface::ball();
    let index = (0..BRICK_NODES).find(|&place| meniscus::grid::is_set(&wild.active[0], place)).unwrap();
    wild.grid.values[index] = 0.123_456;
    wild.write(&path, Precision::Float, Compression::None);
    let mark = 0.123_456_f32.to_le_bytes();
    let mut bytes = fs::read(&path).unwrap();
    let at = bytes.windows(4).position(|word| word == mark).unwrap();
    bytes[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let node = node_of(wild.grid.bricks.coords()[0], index);
    assert!(refusal(folder.path(), &bytes).contains(&format!("NaN at node {node:?}")));
}

#[test]
fn no_damage_stops_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.vdb");
    let small = Surface::new(0.5, 1.9, |x| x.norm() - 1.2);
    let mut state = 1_u64;
    let mut random = |below: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let (mut refused, mut tried) = (0, 0);
    let (cuts, changes) = if crate::is_soak() { (150, 600) } else { (50, 200) };
    for compression in [Compression::Blosc, Compression::Zip, Compression::None] {
        small.write(&path, Precision::Float, compression);
        let good = fs::read(&path).unwrap();
        for length in (0..good.len()).step_by(good.len() / cuts) {
            assert!(!refusal(folder.path(), &good[..length]).is_empty(), "{length} of {} bytes", good.len());
        }
        // Where most bytes are masks without a bit, those that matter are at both ends.
        for case in 0..changes {
            let mut bad = good.clone();
            let at = match case % 3 {
                0 => random(1500),
                1 => good.len() - 1 - random(7000),
                _ => random(good.len()),
            };
            bad[at] = [0, 1, 0x7f, 0x80, 0xff, bad[at] ^ 1 << random(8)][random(6)];
            refused += usize::from(!refusal(folder.path(), &bad).is_empty());
            tried += 1;
        }
    }
    println!("{refused} of {tried} damaged files refused");
    assert!(refused > tried / 10);
}
