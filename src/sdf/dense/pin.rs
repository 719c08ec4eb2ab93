//! The first stages on a dense grid: indicator, immediate distances, pinned nodes.
//!
//! *Method* [gourlay17], "Finding Surfaces Using the Indicator Function" and "Signed Distance Function"; the rules are
//! those of `sdf/seed.rs`. *Departs from the paper*: [`pin_band`] pins what is known of a distance already.

use crate::{
    grid::DenseGrid,
    par,
    sdf::{SeedRule, seed::NEAREST},
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

/// Pins the nodes beside the surface where `field` crosses `threshold`, at their immediate distances by `rule`. No
/// surface crosses the grid's outside.
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

/// Pins the nodes within `width` [voxels] of the surface, where `level`, negative inside, holds the distance [m].
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
        let count = |what: fn(f32) -> bool| {
            let counts = par::map_chunks(distance.len(), par::CHUNK, |range| {
                distance[range].iter().filter(|&&d| what(d)).count()
            });
            counts.into_iter().sum()
        };
        let (pinned, on_surface) = (count(|d| d < 0.0), count(|d| d == -NEAREST));
        Self { distance, inside, pinned, on_surface }
    }
}
