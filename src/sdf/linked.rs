//! Bricks as the second-order solve reads them.

use super::{brick_blocks::BrickBlocks, second::Nodes};
use crate::grid::{BRICK, BRICK_NODES, Bricks};

/// Bricks linked to their face neighbours. Missing bricks have no nodes.
pub(super) struct LinkedBricks {
    blocks: BrickBlocks,
    neighbours: Vec<[Option<u32>; 6]>,
}

impl LinkedBricks {
    /// Links the bricks, to be swept in blocks of `block`³ bricks.
    pub(super) fn new(bricks: &Bricks, block: usize) -> Self {
        Self { blocks: BrickBlocks::new(bricks, block), neighbours: bricks.neighbours() }
    }
}

impl Nodes for LinkedBricks {
    type At = usize;

    fn blocks(&self) -> usize {
        self.neighbours.len()
    }

    fn size(&self, _: usize) -> usize {
        BRICK_NODES
    }

    fn wavefront(&self, order: [i32; 3], work: impl Fn(usize) + Sync) {
        self.blocks.wavefront(order, work);
    }

    fn for_each_near(&self, brick: usize, mut f: impl FnMut(usize)) {
        self.neighbours[brick].into_iter().flatten().for_each(|other| f(other as usize));
    }

    #[inline(always)]
    fn for_each(&self, brick: usize, order: [i32; 3], mut f: impl FnMut(usize, usize)) {
        let run = |axis: usize, i: usize| if order[axis] > 0 { i } else { BRICK - 1 - i };
        for i in 0..BRICK_NODES {
            let node = [run(0, i % BRICK), run(1, i / BRICK % BRICK), run(2, i / (BRICK * BRICK))];
            let place = node[0] + BRICK * (node[1] + BRICK * node[2]);
            f(place, brick * BRICK_NODES + place);
        }
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
