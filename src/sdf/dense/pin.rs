//! The first stages on a dense grid: indicator, immediate distances, pinned nodes.
//!
//! *Method* [gourlay17], "Finding Surfaces Using the Indicator Function" and "Signed Distance Function"; the rules are
//! those of `sdf/seed.rs`. *Departs from the paper*: [`pin_band`] pins what is known of a distance already.

use crate::{
    grid::DenseGrid,
    par,
    sdf::{
        SeedRule,
        seed::{NEAREST, count},
    },
};

/// The nodes whose distance is known, and on which side every node lies.
#[derive(Clone, Debug, PartialEq)]
pub struct Pins {
    /// One number a node [voxels]: pinned distances as negative numbers, ∞ at all other nodes.
    pub distance: Vec<f32>,
    /// The indicator.
    pub inside: Vec<bool>,
    /// How many nodes are pinned.
    pub pinned: usize,
    /// How many of them were nearer to the surface than the smallest distance stored, 10⁻⁶ voxel.
    pub on_surface: usize,
}

/// The indicator: whether the field is at or above the threshold. A NaN is outside.
pub fn indicator(field: &DenseGrid, threshold: f32) -> Vec<bool> {
    let mut inside = vec![false; field.values.len()];
    par::fill(&mut inside, |i| field.values[i] >= threshold);
    inside
}

/// Pins the nodes beside the surface where `field` crosses `threshold`, at their immediate distances by `rule`. Beyond the
/// grid's outside lies the side of its last nodes: no surface is found there.
pub fn pin_surface(field: &DenseGrid, threshold: f32, rule: SeedRule) -> Pins {
    let inside = indicator(field, threshold);
    let strides = [1, field.nodes[0], field.nodes[0] * field.nodes[1]];
    let mut distance = vec![f32::INFINITY; field.values.len()];
    par::for_chunks(&mut distance, field.nodes[0].max(1), |start, row| {
        let [_, y, z] = field.node(start);
        for (x, distance) in row.iter_mut().enumerate() {
            let (node, at) = ([x, y, z], start + x);
            // The neighbour beyond each face; a node of the grid's outside is its own.
            let neighbours: [usize; 6] = std::array::from_fn(|face| {
                let (axis, stride) = (face / 2, strides[face / 2]);
                match face % 2 {
                    0 if node[axis] > 0 => at - stride,
                    1 if node[axis] + 1 < field.nodes[axis] => at + stride,
                    _ => at,
                }
            });
            if neighbours.iter().any(|&other| inside[other] != inside[at]) {
                let pairs = neighbours.map(|other| (field.values[at], field.values[other]));
                *distance = -rule.distance(pairs, threshold).max(NEAREST);
            }
        }
    });
    Pins::counted(distance, inside)
}

/// Pins the nodes within `width` [voxels] of the surface, where `level`, negative inside, holds the distance [m]. A NaN is
/// outside and not pinned.
pub fn pin_band(level: &DenseGrid, width: f32) -> Pins {
    let mut distance = vec![f32::INFINITY; level.values.len()];
    par::fill(&mut distance, |i| {
        let size = level.values[i].abs() / level.voxel;
        if size < width { -size.max(NEAREST) } else { f32::INFINITY }
    });
    let mut inside = vec![false; level.values.len()];
    par::fill(&mut inside, |i| level.values[i] < 0.0);
    Pins::counted(distance, inside)
}

impl Pins {
    fn counted(distance: Vec<f32>, inside: Vec<bool>) -> Self {
        let [pinned, on_surface] = count(&distance);
        Self { distance, inside, pinned, on_surface }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        grid::{BRICK_NODES, SparseGrid, node_of},
        math::Vec3,
        sdf::{SdfParams, seeds},
    };

    /// A ball of radius 9.3 in a box of 32³ nodes: its distance, and a field whose level 1 it is.
    fn ball() -> (DenseGrid, DenseGrid) {
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
    fn a_line_has_its_crossings_where_the_field_says() {
        // [gourlay17] Figure 3: the surface lies a quarter of the way from outside to inside.
        let mut field = DenseGrid::new(1.0, [0; 3], [6, 1, 1], 0.0);
        field.values = vec![0.0, 0.0, 2.0, 2.0, 0.5, 0.0];
        for rule in [SeedRule::Plane, SeedRule::NearestEdge] {
            let pins = pin_surface(&field, 0.5, rule);
            let free = f32::INFINITY;
            // A node at the threshold is inside, as near as can be stored; its neighbour outside is a voxel away.
            assert_eq!(pins.inside, [false, false, true, true, true, false]);
            assert_eq!(pins.distance, [free, -0.25, -0.75, free, -NEAREST, -1.0]);
            assert_eq!((pins.pinned, pins.on_surface), (4, 1));
        }
    }

    #[test]
    fn exactly_the_nodes_beside_a_crossing_are_pinned() {
        let (level, field) = ball();
        let pins = pin_surface(&field, 1.0, SeedRule::Plane);
        let beside = |i: usize| {
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
            assert_eq!(pins.distance[i].is_finite(), beside(i));
            assert!(pins.distance[i] < 0.0 || pins.distance[i] == f32::INFINITY);
        }
        assert!(pins.pinned > 1000);
    }

    #[test]
    fn both_rules_have_the_bits_of_the_bricks_and_the_plane_is_closer() {
        let (level, field) = ball();
        let on_bricks = SparseGrid::sample(1.0, Vec3::repeat(-16.0), Vec3::repeat(15.0), |x| {
            let node: [usize; 3] = std::array::from_fn(|axis| (x[axis] as i32 + 16) as usize);
            field.values[field.index(node)]
        });
        let mut means = Vec::new();
        for rule in [SeedRule::Plane, SeedRule::NearestEdge] {
            let pins = pin_surface(&field, 1.0, rule);
            let sparse = seeds(&on_bricks, 1.0, &SdfParams { seed: rule, ..SdfParams::default() });
            for (i, &value) in sparse.distance.iter().enumerate().filter(|(_, d)| **d < 0.0) {
                let node = node_of(sparse.bricks.coords()[i / BRICK_NODES], i % BRICK_NODES);
                assert_eq!(value, pins.distance[field.index(node.map(|v| (v + 16) as usize))]);
            }
            assert_eq!((sparse.pinned, sparse.on_surface), (pins.pinned, pins.on_surface));
            let errors = pins.distance.iter().zip(&level.values).filter(|(d, _)| **d < 0.0);
            let sum: f64 = errors.map(|(d, exact)| f64::from((-d - exact.abs()).abs())).sum();
            means.push(sum / pins.pinned as f64);
        }
        println!("mean error [voxels]: plane {:.4}, nearest edge {:.4}", means[0], means[1]);
        assert!(means[0] < 0.02 && means[1] < 0.09 && means[0] < 0.25 * means[1]);
    }

    #[test]
    fn a_band_is_pinned_as_it_stands() {
        let (mut level, _) = ball();
        level.values[0] = 0.0;
        let pins = pin_band(&level, 2.0);
        for (i, (&d, &exact)) in pins.distance.iter().zip(&level.values).enumerate().skip(1) {
            assert_eq!(d, if exact.abs() < 2.0 { -exact.abs() } else { f32::INFINITY });
            assert_eq!(pins.inside[i], exact < 0.0);
        }
        assert_eq!((pins.distance[0], pins.on_surface), (-NEAREST, 1));
    }
}
