//! A box of nodes as the second-order solve sees it.

use super::layout::Layout;
use crate::sdf::second::Nodes;

impl Nodes for Layout {
    type At = (usize, [usize; 3]);

    fn blocks(&self) -> usize {
        self.len()
    }

    fn size(&self, block: usize) -> usize {
        Layout::size(self, block).iter().product()
    }

    fn wavefront(&self, order: [i32; 3], work: impl Fn(usize) + Sync) {
        Layout::wavefront(self, order, work);
    }

    fn for_each_near(&self, block: usize, mut f: impl FnMut(usize)) {
        for (face, other) in self.around(block).into_iter().enumerate() {
            let Some(other) = other else { continue };
            f(other);
            if Layout::size(self, other)[face / 2] == 1
                && let Some(beyond) = self.around(other)[face]
            {
                f(beyond);
            }
        }
    }

    #[inline(always)]
    fn for_each(&self, block: usize, order: [i32; 3], mut f: impl FnMut(usize, Self::At)) {
        let (first, size) = (self.first(block), Layout::size(self, block));
        let run = |axis: usize, i: usize| if order[axis] > 0 { i } else { size[axis] - 1 - i };
        for z in 0..size[2] {
            for y in 0..size[1] {
                let (y, z) = (run(1, y), run(2, z));
                let row = size[0] * (y + size[1] * z);
                let start = first[0] + self.nodes[0] * (first[1] + y + self.nodes[1] * (first[2] + z));
                for x in 0..size[0] {
                    let x = run(0, x);
                    f(row + x, (start + x, [first[0] + x, first[1] + y, first[2] + z]));
                }
            }
        }
    }

    #[inline(always)]
    fn slot(&self, at: Self::At) -> usize {
        at.0
    }

    #[inline(always)]
    fn next(&self, (slot, mut node): Self::At, face: usize) -> Option<Self::At> {
        let axis = face / 2;
        if face.is_multiple_of(2) {
            if node[axis] == 0 {
                return None;
            }
            node[axis] -= 1;
        } else {
            node[axis] += 1;
            if node[axis] == self.nodes[axis] {
                return None;
            }
        }
        Some((self.step(slot, face), node))
    }

    #[inline(always)]
    fn step(&self, slot: usize, face: usize) -> usize {
        let stride = [1, self.nodes[0], self.nodes[0] * self.nodes[1]][face / 2];
        if face.is_multiple_of(2) { slot - stride } else { slot + stride }
    }
}
