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

/// The distance from the field by the plane rule, and from an exact band of three voxels.
fn both_ways(shape: Shape, half: usize, order: Order) -> [DenseDistance; 2] {
    let params = DenseParams { order, ..DenseParams::default() };
    let exact = sampled(half, shape);
    let pins = pin_band(&exact, 3.0);
    let from_band = from_pins(exact.voxel, exact.first, exact.nodes, &pins, &params);
    [from_density(&field(shape, half), 1.0, &params), from_band]
}

#[test]
fn both_orders_converge_as_they_should() {
    for (name, shape) in SHAPES {
        for order in [Order::First, Order::Second] {
            let found = RESOLUTIONS.map(|half| {
                both_ways(shape, half, order).map(|found| {
                    assert_eq!(found.unreached, 0);
                    errors(&found.grid, shape)
                })
            });
            for (way, from) in ["field", "band"].into_iter().enumerate() {
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
            }
        }
    }
}
