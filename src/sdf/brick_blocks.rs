//! Blocks of bricks, the tasks of a sweep's wavefront.
//!
//! A thread takes one block at a time. Larger blocks are scheduled less often; smaller ones let more threads
//! work at once. A brick runs after its predecessors in the sweep's direction for any size, so the size
//! changes no bit.

use crate::{grid::Bricks, par};

/// No brick at this place of a block.
const NONE: u32 = u32::MAX;

/// Bricks by blocks of `edge`³ of them.
#[derive(Debug)]
pub(super) struct BrickBlocks {
    edge: usize,
    /// `edge`³ places per block, x fastest.
    bricks: Vec<u32>,
    /// The face neighbours of every block.
    neighbours: Vec<[Option<u32>; 6]>,
}

impl BrickBlocks {
    /// Groups bricks into blocks of `edge` bricks along each axis, aligned to multiples of it.
    ///
    /// # Panics
    /// If `edge` is 0.
    pub(super) fn new(bricks: &Bricks, edge: usize) -> Self {
        assert!(edge > 0, "a block has at least one brick along each axis");
        let step = edge as i32;
        let block = |coord: &[i32; 3]| coord.map(|c| c.div_euclid(step));
        let blocks = Bricks::new(bricks.coords().iter().map(block).collect());
        let mut places = vec![NONE; blocks.len() * edge.pow(3)];
        for (brick, coord) in bricks.coords().iter().enumerate() {
            let [x, y, z] = coord.map(|c| c.rem_euclid(step) as usize);
            let at = blocks.find(block(coord)).expect("every brick has its block");
            places[at * edge.pow(3) + x + edge * (y + edge * z)] = brick as u32;
        }
        Self { edge, bricks: places, neighbours: blocks.neighbours() }
    }

    /// Calls `work` for every brick, after its predecessors in the direction of the sweep.
    pub(super) fn wavefront(&self, order: [i32; 3], work: impl Fn(usize) + Sync) {
        let adjacent = |block: usize, ahead: bool| {
            let faces = self.neighbours[block];
            (0..3).filter_map(move |axis| faces[2 * axis + usize::from((order[axis] > 0) == ahead)])
        };
        let before = |block: usize| adjacent(block, false).count();
        let next = |block: usize| adjacent(block, true).map(|i| i as usize);
        let edge = self.edge;
        let run = |axis: usize, i: usize| if order[axis] > 0 { i } else { edge - 1 - i };
        par::wavefront(self.neighbours.len(), before, next, |block| {
            let places = &self.bricks[block * edge.pow(3)..][..edge.pow(3)];
            for i in 0..edge.pow(3) {
                let [x, y, z] = [run(0, i % edge), run(1, i / edge % edge), run(2, i / (edge * edge))];
                let brick = places[x + edge * (y + edge * z)];
                if brick != NONE {
                    work(brick as usize);
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;

    #[test]
    fn every_brick_runs_once_and_after_its_predecessors() {
        let coord = |i: i32| [i % 7 - 3, i / 7 % 5 - 2, i / 35 % 6 - 4];
        let bricks = Bricks::new((0..210).filter(|i| i % 4 != 1).map(coord).collect());
        for edge in [1, 2, 3, 16] {
            let blocks = BrickBlocks::new(&bricks, edge);
            for order in [[1, 1, 1], [-1, 1, -1], [1, -1, -1]] {
                let ran = Mutex::new(Vec::new());
                par::with_threads(3, || {
                    blocks.wavefront(order, |brick| ran.lock().unwrap().push(brick));
                });
                let ran = ran.into_inner().unwrap();
                let mut turn = vec![None; bricks.len()];
                for (i, &brick) in ran.iter().enumerate() {
                    assert!(turn[brick].replace(i).is_none(), "brick {brick} ran twice");
                }
                for (brick, faces) in bricks.neighbours().iter().enumerate() {
                    for axis in 0..3 {
                        let before = faces[2 * axis + usize::from(order[axis] < 0)];
                        assert!(before.is_none_or(|before| turn[before as usize] < turn[brick]));
                    }
                    assert!(turn[brick].is_some());
                }
            }
        }
    }
}
