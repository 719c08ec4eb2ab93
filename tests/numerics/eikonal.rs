//! The Eikonal solves on dense grids and on bricks against exact distances, at either order.

use super::dense::{
    DenseGrid, DenseParams, MIN_PINNED_DISTANCE, Pins, indicator, pin_band, pin_surface, solve,
};
use super::sdf::{SHAPES, Shape, sphere};
use meniscus::grid::{BRICK_NODES, SparseGrid, node_of};
use meniscus::math::Vec3;
use meniscus::sdf::{self, Order, SdfParams, SeedRule, dense::sweep, seeds};

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

/// Signed distance on a dense grid: negative inside, positive outside, never zero and never NaN.
struct DenseDistance {
    /// The distances [m]; ±`band` where no front came.
    grid: DenseGrid,
    /// The largest magnitude in `grid` [m]; infinite after a full solve.
    band: f32,
    /// Nodes without a distance of their own: they hold ±`band`.
    unreached: usize,
}

/// The signed distance to the surface where `field` crosses 1 from below (outside) to above (inside).
fn from_density(field: &DenseGrid, rule: SeedRule, params: &DenseParams) -> DenseDistance {
    from_pins(field, &pin_surface(field, 1.0, rule), params)
}

/// The signed distance from pinned nodes on the nodes of a grid.
fn from_pins(grid: &DenseGrid, pins: &Pins, params: &DenseParams) -> DenseDistance {
    let (swept, band) = (solve(grid.nodes, pins, params), params.band * grid.voxel);
    // The indicator gives the sign, the band the largest magnitude.
    let signed = |(d, inside): (f32, &bool)| {
        let distance = (d.abs() * grid.voxel).min(band);
        if *inside { -distance } else { distance }
    };
    let values = swept.distance.into_iter().zip(&pins.inside).map(signed).collect();
    DenseDistance { grid: DenseGrid { values, ..grid.clone() }, band, unreached: swept.unreached }
}

/// The distance from the field by the plane rule, and from an exact band of a given width [voxels].
fn from_field_and_band(shape: Shape, half: usize, width: f32, order: Order) -> [DenseDistance; 2] {
    let params = DenseParams { order, ..DenseParams::default() };
    let exact = sampled(half, shape);
    let pins = pin_band(&exact, width);
    [from_density(&field(shape, half), SeedRule::Plane, &params), from_pins(&exact, &pins, &params)]
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
    for (name, shape) in SHAPES.into_iter().take(if crate::is_soak() { SHAPES.len() } else { 2 }) {
        for order in [Order::First, Order::Second] {
            // A band of the same width in space at every resolution.
            let found = RESOLUTIONS.map(|half| {
                from_field_and_band(shape, half, 0.2 * half as f32, order).map(|found| {
                    assert_eq!(found.unreached, 0);
                    errors(&found.grid, shape)
                })
            });
            let (of_field, of_band) = expected(name, order);
            for (source, (from, expected)) in [("field", of_field), ("band", of_band)].into_iter().enumerate()
            {
                for (half, found) in RESOLUTIONS.iter().zip(&found) {
                    let [l1, worst, outside] = found[source];
                    println!(
                        "{name:12} {order:?} from {from:5} h 1/{half:<3} voxels: L1 {l1:.4} L∞ {worst:.3}, outside {outside:.4}"
                    );
                }
                // Of the distance, not in voxels: one more.
                let slope = |k: usize| (found[0][source][k] / found[3][source][k]).log2() / 3.0 + 1.0;
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
    let found = from_pins(&level, &pins, &params);
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
            let full = from_density(&field, SeedRule::Plane, &params);
            for band in [2.0, 4.0, 9.0] {
                let narrow =
                    from_density(&field, SeedRule::Plane, &DenseParams { band, block: [8; 3], ..params });
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
            let pins = pin_surface(&field, 1.0, SeedRule::Plane);
            assert_eq!(bricks.pinned, pins.distance.iter().filter(|d| **d < 0.0).count());
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
            let params = DenseParams { order, ..DenseParams::default() };
            errors(&from_density(&field(sphere, 32), seed, &params).grid, sphere)[0]
        };
        let (plane, edge) = (mean(SeedRule::Plane), mean(SeedRule::NearestEdge));
        println!("{order:?}: mean error [voxels] plane {plane:.4}, nearest edge {edge:.4}");
        assert!(plane < if order == Order::First { 0.9 } else { 0.1 } * edge);
    }
}

/// A ball of radius 9.3 in a box of 32³ nodes: its distance, and a field whose level 1 it is.
fn small_ball() -> (DenseGrid, DenseGrid) {
    let exact = |x: Vec3| (x - Vec3::new(0.31, -0.17, 0.05)).norm() - 9.3;
    let sampled = |f: &(dyn Fn(Vec3) -> f32 + Sync)| DenseGrid::sample(1.0, [-16; 3], [32; 3], f);
    (sampled(&exact), sampled(&|x| 1.0 - exact(x) / 16.0))
}

#[test]
fn the_indicator_is_at_or_above_the_threshold() {
    let mut field = DenseGrid::new(1.0, [0; 3], [5, 1, 1], 0.0);
    field.values = vec![0.4, 0.5, f32::INFINITY, f32::NAN, f32::NEG_INFINITY];
    assert_eq!(indicator(&field, 0.5), [false, true, true, false, false]);
}

#[test]
fn a_line_has_the_crossings_of_its_field() {
    // [gourlay17] Figure 3: the surface lies a quarter of the source from outside to inside.
    let mut field = DenseGrid::new(1.0, [0; 3], [6, 1, 1], 0.0);
    field.values = vec![0.0, 0.0, 2.0, 2.0, 0.5, 0.0];
    let free = f32::INFINITY;
    for rule in [SeedRule::Plane, SeedRule::NearestEdge] {
        let pins = pin_surface(&field, 0.5, rule);
        // A node at the threshold is inside, as near as can be stored; its neighbour outside is a voxel away.
        assert_eq!(pins.inside, [false, false, true, true, true, false]);
        assert_eq!(pins.distance, [free, -0.25, -0.75, free, -MIN_PINNED_DISTANCE, -1.0]);
    }
    // By A/M of its full density 1 a cell is filled up to the crossing, whatever the threshold and the density outside.
    field.values = vec![0.25, 0.25, 0.75, 2.0, 0.5, 0.25];
    let pins = pin_surface(&field, 0.5, SeedRule::DensityRatio);
    assert_eq!(pins.distance, [free, -0.25, -0.75, free, -0.5, -0.5]);
    field.values[2] = 2.0;
    let pins = pin_surface(&field, 0.5, SeedRule::DensityRatio);
    assert_eq!(pins.distance, [free, -MIN_PINNED_DISTANCE, -1.0, free, -0.5, -0.5]);
}

#[test]
fn exactly_the_nodes_next_to_a_crossing_are_pinned() {
    let (level, field) = small_ball();
    let pins = pin_surface(&field, 1.0, SeedRule::Plane);
    let has_crossing = |i: usize| {
        let node = level.node(i);
        (0..6).any(|face| {
            let mut other = node;
            let axis = face / 2;
            other[axis] = other[axis].wrapping_add(if face % 2 == 0 { usize::MAX } else { 1 });
            other[axis] < 32 && pins.inside[level.index(other)] != pins.inside[i]
        })
    };
    for i in 0..pins.distance.len() {
        assert_eq!(pins.inside[i], level.values[i] <= 0.0);
        assert_eq!(pins.distance[i].is_finite(), has_crossing(i));
        assert!(pins.distance[i] < 0.0 || pins.distance[i] == f32::INFINITY);
    }
    assert!(pins.distance.iter().filter(|d| d.is_finite()).count() > 1000);
}

#[test]
fn seed_rules_have_the_bits_of_the_bricks_and_the_plane_is_closer() {
    let (level, field) = small_ball();
    let on_bricks = SparseGrid::sample(1.0, Vec3::repeat(-16.0), Vec3::repeat(15.0), |x| {
        let node: [usize; 3] = std::array::from_fn(|axis| (x[axis] as i32 + 16) as usize);
        field.values[field.index(node)]
    });
    let mut means = Vec::new();
    for rule in [SeedRule::Plane, SeedRule::NearestEdge, SeedRule::DensityRatio] {
        let pins = pin_surface(&field, 1.0, rule);
        let sparse = seeds(&on_bricks, 1.0, &SdfParams { seed: rule, ..SdfParams::default() });
        for (i, &value) in sparse.distance.iter().enumerate().filter(|(_, d)| **d < 0.0) {
            let node = node_of(sparse.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
            assert_eq!(value, pins.distance[field.index(node.map(|v| (v + 16) as usize))]);
        }
        let pinned = pins.distance.iter().filter(|d| **d < 0.0).count();
        assert_eq!(sparse.pinned, pinned);
        let errors = pins.distance.iter().zip(&level.values).filter(|(d, _)| **d < 0.0);
        let sum: f64 = errors.map(|(d, exact)| f64::from((-d - exact.abs()).abs())).sum();
        means.push(sum / pinned as f64);
    }
    println!("mean error [voxels]: plane {:.4}, nearest edge {:.4}", means[0], means[1]);
    assert!(means[0] < 0.02 && means[1] < 0.09 && means[0] < 0.25 * means[1]);
}

#[test]
fn a_band_is_pinned_at_the_distances_given() {
    let (mut level, _) = small_ball();
    level.values[0] = 0.0;
    let pins = pin_band(&level, 2.0);
    for (i, (&d, &exact)) in pins.distance.iter().zip(&level.values).enumerate().skip(1) {
        assert_eq!(d, if exact.abs() < 2.0 { -exact.abs() } else { f32::INFINITY });
        assert_eq!(pins.inside[i], exact < 0.0);
    }
    assert_eq!(pins.distance[0], -MIN_PINNED_DISTANCE);
}

/// Pinned nodes and signs: next to a ball, on both sides of a layer, in noise, in a corner, nowhere.
fn pinned_cases() -> Vec<(&'static str, [usize; 3], Pins)> {
    let noise = |i: usize| {
        let mixed = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32 / (1 << 24) as f32
    };
    let case = |name, nodes: [usize; 3], f: &dyn Fn(Vec3, usize) -> (f32, bool)| {
        let (distance, inside) = (0..nodes.iter().product())
            .map(|i| {
                let x = [i % nodes[0], i / nodes[0] % nodes[1], i / (nodes[0] * nodes[1])];
                let (d, pin) = f(Vec3::from(x.map(|v| v as f32)), i);
                (if pin { -d.abs().max(1e-6) } else { f32::INFINITY }, d < 0.0)
            })
            .unzip();
        (name, nodes, Pins { distance, inside })
    };
    let ball = |x: Vec3| (x - Vec3::new(9.3, 12.1, 8.0)).norm() - 5.7;
    vec![
        case("ball", [22, 25, 19], &|x, _| (ball(x), ball(x).abs() < 0.9)),
        case("thick", [31, 16, 14], &|x, _| (x.x - 15.3, (x.x - 15.3).abs() < 2.5)),
        case("noise", [16, 24, 15], &|_, i| (4.0 * noise(i + 7) - 2.0, noise(i) < 0.1)),
        case("corner", [19, 9, 11], &|x, i| (x.x + 0.5, i == 0)),
        case("nothing", [9, 9, 9], &|_, _| (1.0, false)),
    ]
}

#[test]
fn blocks_and_threads_change_no_bit_of_the_second_order() {
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    for (name, nodes, pins) in pinned_cases() {
        let params = |block| DenseParams { order: Order::Second, block, ..DenseParams::default() };
        let first = sweep(nodes, &pins.distance, f32::INFINITY, [8; 3]).distance;
        let reference = meniscus::par::with_threads(1, || solve(nodes, &pins, &params(nodes))).distance;
        for block in [[1, 1, 1], [3, 5, 2], [8, 8, 8], [7, 9, 30], [64, 64, 64]] {
            let mut sweeps = None;
            for threads in [1, 2, 5] {
                let found = meniscus::par::with_threads(threads, || solve(nodes, &pins, &params(block)));
                assert_eq!(bits(&found.distance), bits(&reference), "{name}, {block:?}, {threads}");
                assert_eq!(*sweeps.get_or_insert(found.sweeps), found.sweeps, "{name}, {block:?}");
            }
        }
        for (i, u) in reference.iter().enumerate() {
            assert!(if first[i] < 0.0 { *u == first[i] } else { *u > 0.0 });
            assert_eq!(u.is_finite(), first[i].is_finite());
        }
    }
}
