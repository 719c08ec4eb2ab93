//! Sparse grids: cubes of 8³ nodes, stored only where something is.
//!
//! Node (i, j, k) stands at (i, j, k) · voxel in world space, in every frame, so that surfaces do not crawl.
//! Brick (a, b, c) holds the nodes 8a..8a+8, 8b..8b+8, 8c..8c+8; inside a brick x runs fastest, then y, then z.

use crate::math::Vec3;
use std::collections::HashMap;

/// Nodes along a brick's edge.
pub const BRICK: usize = 8;

/// Nodes in a brick.
pub const BRICK_NODES: usize = BRICK * BRICK * BRICK;

/// Which bricks exist, in ascending (z, y, x) order: the layout does not depend on how it was built.
#[derive(Clone, Debug, Default)]
pub struct Bricks {
    coords: Vec<[i32; 3]>,
    index: HashMap<[i32; 3], u32>,
}

impl Bricks {
    /// A set of bricks from their coordinates (x, y, z), in any order, repeats allowed.
    pub fn new(mut coords: Vec<[i32; 3]>) -> Self {
        coords.sort_unstable_by_key(|c| [c[2], c[1], c[0]]);
        coords.dedup();
        let index = coords.iter().enumerate().map(|(i, &c)| (c, i as u32)).collect();
        Self { coords, index }
    }

    /// How many bricks there are.
    pub fn len(&self) -> usize {
        self.coords.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.coords.is_empty()
    }

    /// The coordinates of every brick.
    pub fn coords(&self) -> &[[i32; 3]] {
        &self.coords
    }

    /// The place of the brick at `coord`, if it exists.
    pub fn find(&self, coord: [i32; 3]) -> Option<usize> {
        self.index.get(&coord).map(|&i| i as usize)
    }
}

/// One number a node, on bricks.
#[derive(Clone, Debug)]
pub struct SparseGrid {
    /// Distance between nodes [m].
    pub voxel: f32,
    /// The bricks that exist.
    pub bricks: Bricks,
    /// 512 numbers a brick, in the bricks' order.
    pub values: Vec<f32>,
}

impl SparseGrid {
    /// A grid with `value` at every node of `bricks`.
    pub fn new(voxel: f32, bricks: Bricks, value: f32) -> Self {
        let values = vec![value; bricks.len() * BRICK_NODES];
        Self { voxel, bricks, values }
    }

    /// The number at node (i, j, k), if its brick exists.
    pub fn get(&self, node: [i32; 3]) -> Option<f32> {
        let coord = node.map(|v| v.div_euclid(BRICK as i32));
        let brick = self.bricks.find(coord)?;
        Some(self.values[brick * BRICK_NODES + offset(node.map(|v| v.rem_euclid(BRICK as i32) as usize))])
    }

    /// Where node (i, j, k) stands [m].
    pub fn position(&self, node: [i32; 3]) -> Vec3 {
        let at = |i: i32| (f64::from(i) * f64::from(self.voxel)) as f32;
        Vec3::new(at(node[0]), at(node[1]), at(node[2]))
    }
}

/// The place of a node inside its brick; every coordinate is in 0..8.
pub fn offset(local: [usize; 3]) -> usize {
    local[0] + BRICK * (local[1] + BRICK * local[2])
}
