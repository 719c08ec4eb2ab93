//! Neighbour lists.

use super::CellGrid;
use crate::{math::Vec3, par};

/// Every particle's neighbours, as one list and offsets into it.
#[derive(Debug, Default)]
pub struct Neighbours {
    start: Vec<usize>,
    list: Vec<u32>,
}

impl Neighbours {
    /// Lists, for every particle, the others closer than `radius` (≤ the grid's cell), in cell order.
    pub fn build(grid: &CellGrid, positions: &[Vec3], radius: f32) -> Self {
        let chunks = par::map_chunks(positions.len(), par::CHUNK, |range| {
            let mut counts = Vec::with_capacity(range.len());
            let mut list = Vec::new();
            for i in range {
                let before = list.len();
                grid.for_each_within(positions, positions[i], radius, |j, _| {
                    if j != i {
                        list.push(j as u32);
                    }
                });
                counts.push(list.len() - before);
            }
            (counts, list)
        });
        let mut built = Self { start: vec![0], list: Vec::new() };
        for (counts, list) in chunks {
            for count in counts {
                built.start.push(built.start.last().expect("starts with 0") + count);
            }
            built.list.extend_from_slice(&list);
        }
        built
    }

    /// The neighbours of particle `i`.
    #[inline]
    pub fn of(&self, i: usize) -> &[u32] {
        &self.list[self.start[i]..self.start[i + 1]]
    }
}
