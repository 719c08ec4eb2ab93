//! The Eikonal solves on dense grids and on bricks against exact distances, at either order.

use super::sdf::{SHAPES, Shape, sphere};
use meniscus::grid::{BRICK_NODES, DenseGrid, SparseGrid, node_of};
use meniscus::math::Vec3;
use meniscus::sdf::dense::{DenseDistance, DenseParams, from_density, from_pins, pin_band};
use meniscus::sdf::{self, Order, SdfParams, SeedRule};

/// Voxels along half the box −1..1 of each resolution.
const RESOLUTIONS: [usize; 4] = [8, 16, 32, 64];

/// `f` on a grid over the box −1..1 that has `half` voxels along half its side.
fn sampled(half: usize, f: impl Fn(Vec3) -> f32 + Sync) -> DenseGrid {
    DenseGrid::sample(1.0 / half as f32, [-(half as i32); 3], [2 * half; 3], f)
}

/// A field whose level 1 is the shape's surface, not linear across it.
fn field(shape: Shape, half: usize) -> DenseGrid {
    sampled(half, |x| (-2.0 * shape(x)).exp())
}

/// Mean and largest error over all nodes, and the largest over those at least a tenth outside [voxels].
fn errors(found: &DenseGrid, shape: Shape) -> [f64; 3] {
    let (mut sum, mut worst, mut outside) = (0.0, 0.0_f64, 0.0_f64);
    for (i, &value) in found.values.iter().enumerate() {
        let exact = shape(found.position(found.node(i)));
        let error = f64::from((value - exact).abs() / found.voxel);
        sum += error;
        worst = worst.max(error);
        if exact > 0.1 {
            outside = outside.max(error);
        }
    }
    [sum / found.values.len() as f64, worst, outside]
}

/// The distance from the field by the plane rule, and from an exact band of a given width [voxels].
fn both_ways(shape: Shape, half: usize, width: f32, order: Order) -> [DenseDistance; 2] {
    let params = DenseParams { order, ..DenseParams::default() };
    let exact = sampled(half, shape);
    let pins = pin_band(&exact, width);
    let from_band = from_pins(exact.voxel, exact.first, exact.nodes, &pins, &params);
    [from_density(&field(shape, half), 1.0, &params), from_band]
}

#[test]
fn both_orders_converge_as_they_should() {
    // The order expected at least, of the mean and of the largest error outside: from the field, from the band.
    // A box has edges, behind which a field's seeds and one-sided differences have first order. Where fronts meet, in
    // the hole of the torus and between the spheres, the largest error stays of first order.
    let expected = |name: &str, order: Order| match (name, order) {
        (_, Order::First) => ([0.75, 0.7], [0.75, 0.7]),
        ("box", Order::Second) => ([1.15, 0.9], [1.15, 0.9]),
        ("sphere", Order::Second) => ([1.8, 1.5], [1.8, 1.5]),
        (_, Order::Second) => ([1.7, 0.9], [1.7, 0.9]),
    };
    for (name, shape) in SHAPES {
        for order in [Order::First, Order::Second] {
            // A band of the same width in space at every resolution.
            let found = RESOLUTIONS.map(|half| {
                both_ways(shape, half, 0.2 * half as f32, order).map(|found| {
                    assert_eq!(found.unreached, 0);
                    errors(&found.grid, shape)
                })
            });
            let (of_field, of_band) = expected(name, order);
            for (way, (from, expected)) in [("field", of_field), ("band", of_band)].into_iter().enumerate() {
                for (half, found) in RESOLUTIONS.iter().zip(&found) {
                    let [l1, worst, outside] = found[way];
                    println!(
                        "{name:12} {order:?} from {from:5} h 1/{half:<3} voxels: L1 {l1:.4} L∞ {worst:.3}, outside {outside:.4}"
                    );
                }
                // Of the distance, not in voxels: one more.
                let slope = |k: usize| (found[0][way][k] / found[3][way][k]).log2() / 3.0 + 1.0;
                println!(
                    "{name:12} {order:?} from {from:5} order: L1 {:.2}, L∞ {:.2}, outside {:.2}",
                    slope(0),
                    slope(1),
                    slope(2)
                );
                assert!(slope(0) > expected[0] && slope(2) > expected[1], "{name} {order:?} from {from}");
                assert!(slope(1) > 0.6, "{name} {order:?} from {from}");
            }
        }
    }
}

/// Mean error [voxels] of a ball of a fifth of the side in a box of 128³ nodes, from a band of three voxels.
fn ball_error(order: Order) -> f64 {
    let exact = |x: Vec3| (x - Vec3::new(0.005, -0.003, 0.001)).norm() - 0.4;
    let level = sampled(64, exact);
    let pins = pin_band(&level, 3.0);
    let params = DenseParams { order, ..DenseParams::default() };
    let found = from_pins(level.voxel, level.first, level.nodes, &pins, &params);
    errors_of(&found.grid, exact)
}

fn errors_of(found: &DenseGrid, exact: impl Fn(Vec3) -> f32) -> f64 {
    let sum: f64 = (0..found.values.len())
        .map(|i| f64::from((found.values[i] - exact(found.position(found.node(i)))).abs() / found.voxel))
        .sum();
    sum / found.values.len() as f64
}

#[test]
fn a_ball_from_a_band_is_within_four_tenths_and_a_hundredth_of_a_voxel() {
    let (first, second) = (ball_error(Order::First), ball_error(Order::Second));
    println!("mean error [voxels]: first order {first:.4}, second {second:.4}");
    assert!(first < 0.36 && second < 0.01 && second < first / 20.0);
}

#[test]
fn a_narrow_band_has_the_bits_of_the_full_solve_on_dense_grids_and_on_bricks() {
    for (name, shape) in SHAPES {
        let half = 24;
        let field = field(shape, half);
        let voxel = field.voxel;
        let on_bricks = SparseGrid::sample(voxel, Vec3::repeat(-1.0), Vec3::repeat(1.0 - voxel), |x| {
            (-2.0 * shape(x)).exp()
        });
        for order in [Order::First, Order::Second] {
            let params = DenseParams { order, ..DenseParams::default() };
            let full = from_density(&field, 1.0, &params);
            for band in [2.0, 4.0, 9.0] {
                let narrow = from_density(&field, 1.0, &DenseParams { band, block: [8; 3], ..params });
                let mut within = 0;
                for (value, exact) in narrow.grid.values.iter().zip(&full.grid.values) {
                    if exact.abs() < narrow.band {
                        assert_eq!(value.to_bits(), exact.to_bits(), "{name}, {order:?}, band {band}");
                        within += 1;
                    } else {
                        assert_eq!(*value, narrow.band.copysign(*exact));
                    }
                }
                assert!(within > 5000 && narrow.unreached == full.grid.values.len() - within);
            }

            // The box is a whole number of bricks, and the field is below the threshold on its outside.
            let bricks = sdf::from_density(
                &on_bricks,
                1.0,
                &SdfParams { order, band: f32::INFINITY, ..SdfParams::default() },
            );
            assert_eq!(bricks.pinned, full.pinned);
            for (i, &value) in bricks.grid.values.iter().enumerate() {
                let node = node_of(bricks.grid.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
                let local = node.map(|v| (v + half as i32) as usize);
                assert_eq!(value.to_bits(), full.grid.values[full.grid.index(local)].to_bits());
            }
        }
    }
}

#[test]
fn the_nearest_edge_alone_costs_accuracy_at_either_order() {
    for order in [Order::First, Order::Second] {
        let mean = |seed: SeedRule| {
            let params = DenseParams { seed, order, ..DenseParams::default() };
            errors(&from_density(&field(sphere, 32), 1.0, &params).grid, sphere)[0]
        };
        let (plane, edge) = (mean(SeedRule::Plane), mean(SeedRule::NearestEdge));
        println!("{order:?}: mean error [voxels] plane {plane:.4}, nearest edge {edge:.4}");
        assert!(plane < if order == Order::First { 0.9 } else { 0.1 } * edge);
    }
}
