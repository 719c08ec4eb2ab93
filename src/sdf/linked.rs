//! Bricks as the second-order solve reads them.

use super::second::Nodes;
use crate::grid::{BRICK, BRICK_NODES, Bricks};

/// Bricks linked to their face neighbours. Missing bricks have no nodes.
pub(super) struct LinkedBricks {
    neighbours: Vec<[Option<u32>; 6]>,
}

impl LinkedBricks {
    pub(super) fn new(bricks: &Bricks) -> Self {
        Self { neighbours: bricks.neighbours() }
    }
}

impl Nodes for LinkedBricks {
    type At = usize;

    fn blocks(&self) -> usize {
        self.neighbours.len()
    }

    fn for_each_near(&self, brick: usize, mut f: impl FnMut(usize)) {
        self.neighbours[brick].into_iter().flatten().for_each(|other| f(other as usize));
    }

    #[inline(always)]
    fn for_each(&self, brick: usize, f: impl FnMut(usize)) {
        (brick * BRICK_NODES..(brick + 1) * BRICK_NODES).for_each(f);
    }

    #[inline(always)]
    fn block_of(&self, slot: usize) -> usize {
        slot / BRICK_NODES
    }

    #[inline(always)]
    fn slot(&self, slot: usize) -> usize {
        slot
    }

    #[inline(always)]
    fn next(&self, slot: usize, face: usize) -> Option<usize> {
        let stride = [1, BRICK, BRICK * BRICK][face / 2];
        let at = slot / stride % BRICK;
        let to_brick =
            || Some(self.neighbours[slot / BRICK_NODES][face]? as usize * BRICK_NODES + slot % BRICK_NODES);
        match (face % 2, at) {
            (0, 0) => Some(to_brick()? + (BRICK - 1) * stride),
            (0, _) => Some(slot - stride),
            (_, at) if at + 1 == BRICK => Some(to_brick()? - (BRICK - 1) * stride),
            _ => Some(slot + stride),
        }
    }

    #[inline(always)]
    fn step(&self, slot: usize, face: usize) -> usize {
        self.next(slot, face).expect("a node of the stencil exists")
    }
}
