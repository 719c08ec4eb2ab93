//! Signed distances against exact ones.

use meniscus::grid::{BRICK_NODES, SparseGrid, node_of};
use meniscus::math::Vec3;
use meniscus::sdf::{SdfParams, SeedRule, SignedDistance, from_density};

/// Voxels along half the box −1..1 of each resolution.
const RESOLUTIONS: [usize; 4] = [8, 16, 32, 64];

pub(crate) type Shape = fn(Vec3) -> f32;

pub(crate) fn sphere(x: Vec3) -> f32 {
    (x - Vec3::new(0.031, -0.017, 0.011)).norm() - 0.6
}

fn cuboid(x: Vec3) -> f32 {
    let q = (x - Vec3::new(0.013, 0.021, -0.017)).abs() - Vec3::new(0.61, 0.43, 0.52);
    q.map(|v| v.max(0.0)).norm() + q.max().min(0.0)
}

fn torus(x: Vec3) -> f32 {
    (x.x.hypot(x.y) - 0.55).hypot(x.z - 0.013) - 0.24
}

fn two_spheres(x: Vec3) -> f32 {
    let left = (x - Vec3::new(-0.43, 0.02, 0.01)).norm() - 0.37;
    let right = (x - Vec3::new(0.44, -0.03, 0.02)).norm() - 0.41;
    left.min(right)
}

pub(crate) const SHAPES: [(&str, Shape); 4] =
    [("sphere", sphere), ("box", cuboid), ("torus", torus), ("two spheres", two_spheres)];

/// A field whose level 1 is the shape's surface, not linear across it.
fn field(shape: Shape, half: usize) -> SparseGrid {
    let voxel = 1.0 / half as f32;
    SparseGrid::sample(voxel, Vec3::repeat(-1.0), Vec3::repeat(1.0 - voxel), |x| (-2.0 * shape(x)).exp())
}

/// Mean and largest error over all nodes.
fn errors(sdf: &SignedDistance, shape: Shape) -> (f64, f64) {
    let (mut sum, mut worst) = (0.0, 0.0_f64);
    for (i, &value) in sdf.grid.values.iter().enumerate() {
        let node = node_of(sdf.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
        let error = f64::from((value - shape(sdf.grid.position(node))).abs());
        sum += error;
        worst = worst.max(error);
    }
    (sum / sdf.grid.values.len() as f64, worst)
}

#[test]
fn the_full_solve_converges_with_first_order() {
    for (name, shape) in SHAPES {
        let mut found: Vec<(f64, f64)> = Vec::new();
        for half in RESOLUTIONS {
            let params = SdfParams { band: f32::INFINITY, ..SdfParams::default() };
            let sdf = from_density(&field(shape, half), 1.0, &params);
            assert_eq!(sdf.unreached, 0);
            let (l1, worst) = errors(&sdf, shape);
            println!("{name:12} h 1/{half:<3} L1 {l1:.3e} L∞ {worst:.3e} sweeps {}", sdf.sweeps);
            let h = 1.0 / half as f64;
            assert!(l1 < 0.5 * h && worst < 2.6 * h, "{name} at 1/{half}");
            found.push((l1, worst));
        }

        // Over all resolutions: where a flat face lies between its nodes changes from one to the next.
        let ratio = |of: fn(&(f64, f64)) -> f64| (of(&found[0]) / of(&found[3])).log2() / 3.0;
        let (l1, worst) = (ratio(|e| e.0), ratio(|e| e.1));
        println!("{name:12} observed order: L1 {l1:.2}, L∞ {worst:.2}");
        assert!(l1 > 0.85 && worst > 0.62, "{name}");
    }
}

#[test]
fn the_band_has_the_distances_of_the_full_solve() {
    for (name, shape) in SHAPES {
        let field = field(shape, 24);
        let full = from_density(&field, 1.0, &SdfParams { band: f32::INFINITY, ..SdfParams::default() });
        let band = from_density(&field, 1.0, &SdfParams { band: 4.0, ..SdfParams::default() });
        let mut inside_band = 0;
        for (i, &value) in band.grid.values.iter().enumerate() {
            let node = node_of(band.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
            let Some(exact) = full.grid.get(node) else { continue };
            if exact.abs() < band.band {
                assert_eq!(value.to_bits(), exact.to_bits(), "{name} at {node:?}");
                inside_band += 1;
            } else {
                assert_eq!(value, band.band.copysign(exact));
            }
        }
        assert!(inside_band > 5000);
        assert!(band.grid.bricks.len() <= full.grid.bricks.len());
    }
}

/// Mean and largest distance [voxels] between the surface and the zeros that `values` put on the grid's edges, and
/// how many there are.
fn zeros_off(grid: &SparseGrid, level: f32, shape: Shape) -> (f64, f64, usize) {
    let (mut sum, mut worst, mut count) = (0.0, 0.0_f64, 0);
    for (i, &value) in grid.values.iter().enumerate() {
        let node = node_of(grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
        for axis in 0..3 {
            let mut next = node;
            next[axis] += 1;
            let Some(other) = grid.get(next) else { continue };
            if (value >= level) != (other >= level) {
                let along = (level - value) / (other - value);
                let x = grid.position(node) + (grid.position(next) - grid.position(node)) * along;
                let off = f64::from((shape(x) / grid.voxel).abs());
                sum += off;
                worst = worst.max(off);
                count += 1;
            }
        }
    }
    (sum / count as f64, worst, count)
}

#[test]
fn zeros_of_the_distance_lie_on_the_surface() {
    let mut before = [f64::INFINITY; 2];
    for half in RESOLUTIONS {
        let field = field(sphere, half);
        let found = |seed: SeedRule| {
            let sdf = from_density(&field, 1.0, &SdfParams { seed, ..SdfParams::default() });
            zeros_off(&sdf.grid, 0.0, sphere)
        };
        let (plane, edge) = (found(SeedRule::Plane), found(SeedRule::NearestEdge));
        let straight = zeros_off(&field, 1.0, sphere);
        assert!(plane.2 == straight.2 && edge.2 == straight.2, "every crossing is kept");
        println!(
            "h 1/{half}: mean, worst off [voxels]: plane {:.5} {:.5}, nearest edge {:.5} {:.5}, field {:.5} {:.5}",
            plane.0, plane.1, edge.0, edge.1, straight.0, straight.1
        );
        // In voxels first order, thus second order in space.
        assert!(plane.0 < 0.65 * before[0] && plane.1 < 0.75 * before[1]);
        assert!(plane.1 < edge.1 && plane.0 < 2.0 * straight.0);
        before = [plane.0, plane.1];
    }
    assert!(before[0] < 2.5e-3 && before[1] < 6e-3);
}
